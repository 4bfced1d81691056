//! The faults of a teaching, new or existing, that stop a command.

use panelprep_base::number_text::distinguishable_texts;
use std::path::PathBuf;

/// The reason why a panel cannot be taught, or why its taught data cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TeachingFault {
    /// There is no scan for the teaching.
    #[error(
        "no scan for teaching: name a scan with --scan FILE, take a scan now with --live DIR, or name the panel's drawing with \
         --nominal FILE"
    )]
    NoScan,
    /// The terminal is closed, so that no person can answer.
    #[error(
        "no answer from the terminal: the files taken so far are in the folder of --live; name these files with --scan, \
         --corner and --flange to continue"
    )]
    NoAnswer,
    /// The numbers of `--corner` and `--flange` options differ.
    #[error(
        "{found} --corner and {flanges} --flange were given: each corner picture needs the flange's pose at that picture"
    )]
    CornerWithoutFlange {
        /// Number of corner pictures.
        found: usize,
        /// Number of flange poses.
        flanges: usize,
    },
    /// All corner pictures in which no corner was found.
    #[error("{}", .0.join("; "))]
    Corners(Vec<String>),
    /// No corner picture for a cell that runs cycles.
    #[error(
        "no corner picture was given, but a cycle of this cell measures taught corners before each contact: name one or, better, \
         two pictures, each with --corner FILE --flange POSE.json (a cell without [calibration] flange_camera needs none)"
    )]
    NoCorner,
    /// No corner view for a cell that runs cycles, and a panel that is taught from its drawing.
    #[error(
        "no corner view was given, but a cycle of this cell measures taught corners before each contact: name the flange's pose of \
         one or, better, two views, each with --flange POSE.json; the pictures are computed from the drawing"
    )]
    NoCornerView,
    /// A drawing for a recipe that does not state its place.
    #[error(
        "{}: [nominal] is missing: state the pose of the drawing's frame in the robot's base, by base_from_drawing or by datum points",
        recipe.display()
    )]
    NoNominalPlace {
        /// The recipe's file.
        recipe: PathBuf,
    },
    /// A scan for a recipe whose panel is taught from a drawing.
    #[error(
        "{}: [nominal] states that the panel is taught from its drawing: name the drawing with --nominal FILE, or remove [nominal]",
        recipe.display()
    )]
    NominalByScan {
        /// The recipe's file.
        recipe: PathBuf,
    },
    /// A corner of the region that the 3D camera does not see on the drawing.
    #[error(
        "[nominal] region_mm: the 3D camera sees no point of the drawing at corner {number}; choose four corners on the visible surface, in mm \
         of the drawing's frame"
    )]
    RegionOffDrawing {
        /// Number of the corner, from 1.
        number: usize,
    },
    /// A corner of the region that is not on the drawing's surface.
    #[error(
        "[nominal] region_mm: corner {number} is {} mm in front of or behind the drawing's surface (limit {} mm); state the \
         coordinates of a point on the surface",
        distinguishable_texts(*away_mm, *limit_mm, 1)[0], distinguishable_texts(*away_mm, *limit_mm, 1)[1]
    )]
    RegionBesideDrawing {
        /// Number of the corner, from 1.
        number: usize,
        /// Its distance along the camera's ray, mm.
        away_mm: f64,
        /// The limit, mm.
        limit_mm: f64,
    },
    /// A region that would be stated twice.
    #[error("{}: [nominal] region_mm already states the region: remove region_mm to draw the region, or leave out --draw", recipe.display())]
    RegionInDrawing {
        /// The recipe's file.
        recipe: PathBuf,
    },
    /// The flange camera does not see the drawing.
    #[error("{}: from this pose the flange camera does not see the drawing; choose a pose that sees a corner", flange.display())]
    DrawingNotSeen {
        /// The file of the flange's pose.
        flange: PathBuf,
    },
    /// More corner pictures than corners were taught.
    #[error(
        "{found} corner pictures, but only {taught} corners of this panel were taught; teach more corners with --corner"
    )]
    CornersNotTaught {
        /// Number of pictures.
        found: usize,
        /// Number of taught corners.
        taught: usize,
    },
    /// The recipe differs from the one with which the panel was taught.
    #[error(
        "{}: [{table}] differs from the recipe with which panel \"{panel}\" was taught (version {version}); \
         teach the panel again or undo the change", recipe.display()
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
        /// Number of the corner, from 1.
        number: usize,
        /// The problem of the corner picture.
        cause: String,
    },
}
