//! The faults of a teaching, new or existing, that stop a command.

use std::path::PathBuf;

/// Why a panel cannot be taught, or why its taught data cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TeachingFault {
    /// There is no scan for the teaching.
    #[error("there is no scan to teach with: name it with --scan FILE, or take it now with --live DIR")]
    NoScan,
    /// The terminal is closed, so that no person can answer.
    #[error(
        "nobody answers at the terminal: the files taken so far are in the folder of --live, and can be named with \
         --scan, --corner and --flange"
    )]
    NobodyAnswers,
    /// The numbers of `--corner` and `--flange` options differ.
    #[error("{found} --corner and {flanges} --flange: each corner picture needs the flange's pose at that picture")]
    CornerWithoutFlange {
        /// Corner pictures named.
        found: usize,
        /// Flange poses named.
        flanges: usize,
    },
    /// All corner pictures in which no corner was found.
    #[error("{}", .0.join("; "))]
    Corners(Vec<String>),
    /// No corner picture for a cell that runs cycles.
    #[error(
        "a cycle of this cell looks at taught corners before each contact, and no corner picture was given: name one or, better, \
         two with --corner FILE --flange POSE.json each (a cell without [calibration] flange_camera needs none)"
    )]
    NoCorner,
    /// More corner pictures than corners were taught.
    #[error("{found} corner pictures, but {taught} corners of this panel were taught; teach them with --corner")]
    CornersNotTaught {
        /// Pictures named.
        found: usize,
        /// Corners taught.
        taught: usize,
    },
    /// The recipe differs from the one with which the panel was taught.
    #[error(
        "{}: [{table}] differs from the recipe with which panel \"{panel}\" was taught (version {version}); \
         teach it again or take the change back", recipe.display()
    )]
    TaughtOtherwise {
        /// The recipe's file.
        recipe: PathBuf,
        /// The table that differs between the recipes.
        table: &'static str,
        /// The panel.
        panel: String,
        /// Its taught version.
        version: String,
    },
    /// A taught corner picture in the store that cannot be used for measurements.
    #[error(
        "the taught corner picture {number} cannot be used: {cause}; correct this, then teach the panel again with the new picture"
    )]
    TaughtCorner {
        /// Which, from 1.
        number: usize,
        /// The problem of the corner picture.
        cause: String,
    },
}
