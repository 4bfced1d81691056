//! What stops a command at a panel that is taught, or was.

use std::path::PathBuf;

/// Why a panel cannot be taught, or what was taught not be used.
#[derive(Debug, thiserror::Error)]
pub enum TeachingFault {
    /// There is nothing to teach by.
    #[error("there is no scan to teach with: name it with --scan FILE, or take it now with --live DIR")]
    NoScan,
    /// The terminal is closed.
    #[error(
        "nobody answers at the terminal: the files taken so far are in the folder of --live, and can be named with \
         --scan, --corner and --flange"
    )]
    NobodyAnswers,
    /// Options that do not go together.
    #[error("{found} --corner and {flanges} --flange: each corner picture needs the flange's pose at that picture")]
    CornerWithoutFlange {
        /// Corner pictures named.
        found: usize,
        /// Flange poses named.
        flanges: usize,
    },
    /// Corner pictures that show no corner: all of them.
    #[error("{}", .0.join("; "))]
    Corners(Vec<String>),
    /// No corner picture for a cell that runs cycles.
    #[error(
        "a cycle of this cell looks at taught corners before each contact, and no corner picture was given: name one or, better, \
         two with --corner FILE --flange POSE.json each (a cell without [calibration] flange_camera needs none)"
    )]
    NoCorner,
    /// More corner pictures than corners were taught.
    #[error("{found} corner pictures, but {taught} corners were taught of this panel; teach them with --corner")]
    CornersNotTaught {
        /// Pictures named.
        found: usize,
        /// Corners taught.
        taught: usize,
    },
    /// The recipe is not the one that was taught.
    #[error(
        "{}: [{table}] differs from the recipe with which panel \"{panel}\" was taught (version {version}); \
         teach it again or take the change back", recipe.display()
    )]
    TaughtOtherwise {
        /// The recipe's file.
        recipe: PathBuf,
        /// The table that differs.
        table: &'static str,
        /// The panel.
        panel: String,
        /// Its taught version.
        version: String,
    },
    /// A corner picture in the store that measures nothing.
    #[error("the corner picture {number} that was taught: {cause}; then teach the panel again with it")]
    TaughtCorner {
        /// Which, from 1.
        number: usize,
        /// What is wrong with it.
        cause: String,
    },
}
