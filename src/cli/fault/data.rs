//! Errors of data that stop a command: of teaching and taught panels, of a clip and its labels, and of the records and
//! history of cycles and parts.

use panelprep_base::number_text::distinguishable_texts;
use std::path::PathBuf;

/// The reason why a panel cannot be taught, or why its taught data cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TeachingFault {
    /// No scan was given for teaching.
    #[error(
        "no scan for teaching: name a scan with --scan FILE, take a scan now with --live DIR, or name the panel's \
         drawing with --nominal FILE"
    )]
    NoScan,
    /// Standard input is closed, so no person can answer.
    #[error(
        "no answer from the terminal: the files taken so far are in the folder of --live; name these files with --scan, \
         --corner and --flange to continue"
    )]
    NoAnswer,
    /// The number of `--corner` options differs from the number of `--flange` options.
    #[error(
        "{found} --corner and {flanges} --flange were given: each corner picture needs the flange's pose at that picture"
    )]
    CornerWithoutFlange {
        /// Number of `--corner` options.
        found: usize,
        /// Number of `--flange` options.
        flanges: usize,
    },
    /// No corner picture for a cell that runs cycles.
    #[error(
        "no corner picture was given, but a cycle of this cell measures taught corners before each contact: name one \
         or, better, two pictures, each with --corner FILE --flange POSE.json (a cell without [calibration] \
         flange_camera needs none)"
    )]
    NoCorner,
    /// No corner view was given for a panel that is taught from its drawing, although the cell measures corners in each
    /// cycle.
    #[error(
        "no corner view was given, but a cycle of this cell measures taught corners before each contact: name the \
         flange's pose of one or, better, two views, each with --flange POSE.json; the pictures are computed from the \
         drawing"
    )]
    NoCornerView,
    /// A drawing was given, but the recipe does not state its pose.
    #[error(
        "{}: [nominal] is missing: state the pose of the drawing's frame in the robot's base, by base_from_drawing or by datum points",
        recipe.display()
    )]
    NoNominalPlace {
        /// The recipe's file.
        recipe: PathBuf,
    },
    /// A scan was given, but the recipe states that the panel is taught from its drawing.
    #[error(
        "{}: [nominal] states that the panel is taught from its drawing: name the drawing with --nominal FILE, or remove [nominal]",
        recipe.display()
    )]
    NominalByScan {
        /// The recipe's file.
        recipe: PathBuf,
    },
    /// The 3D camera does not see a corner of the region on the drawing.
    #[error(
        "[nominal] region_mm: the 3D camera sees no point of the drawing at corner {number}; choose four corners on \
         the visible surface, in mm of the drawing's frame"
    )]
    RegionOffDrawing {
        /// The number of the corner, from 1.
        number: usize,
    },
    /// A corner of the region is not on the surface of the drawing.
    #[error(
        "[nominal] region_mm: corner {number} is {} mm in front of or behind the drawing's surface (limit {} mm); \
         state the coordinates of a point on the surface",
        distinguishable_texts(*away_mm, *limit_mm, 1)[0], distinguishable_texts(*away_mm, *limit_mm, 1)[1]
    )]
    RegionBesideDrawing {
        /// The number of the corner, from 1.
        number: usize,
        /// The distance of the corner from the surface along the camera's ray, mm.
        away_mm: f64,
        /// The limit, mm.
        limit_mm: f64,
    },
    /// The region would be stated twice, by the recipe and by drawing it.
    #[error("{}: [nominal] region_mm already states the region: remove region_mm to draw the region, or leave out --draw", recipe.display())]
    RegionInDrawing {
        /// The recipe's file.
        recipe: PathBuf,
    },
    /// The flange camera does not see the panel of the drawing.
    #[error("{}: from this pose the flange camera does not see the drawing; choose a pose that sees a corner", flange.display())]
    DrawingNotSeen {
        /// The file with the flange pose.
        flange: PathBuf,
    },
    /// There are more corner pictures than taught corners.
    #[error(
        "{found} corner pictures, but only {taught} corners of this panel were taught; teach more corners with --corner"
    )]
    CornersNotTaught {
        /// Number of pictures.
        found: usize,
        /// Number of taught corners.
        taught: usize,
    },
}

/// The reason why a clip or its labels cannot be used or written.
#[derive(Debug, thiserror::Error)]
pub enum ClipFault {
    /// A new film would overwrite an existing one.
    #[error("{} already contains a film (clip.csv or 00001.png); name another folder", folder.display())]
    ClipExists {
        /// The folder.
        folder: PathBuf,
    },
    /// The folder contains no clip.
    #[error(
        "{}: there is no clip.csv; a clip is a folder of numbered pictures with a clip.csv that states the time of each \
         picture, as `panelprep shoot film` writes it", folder.display()
    )]
    NoClip {
        /// The folder.
        folder: PathBuf,
    },
    /// A clip of a labelled set has no labels.
    #[error(
        "{}: the clip has no labels: no mask.png in its folder truth or next to its pictures; mark the breaks with \
         `panelprep label --clip {}`",
        clip.display(), clip.display()
    )]
    NoLabels {
        /// The clip's folder.
        clip: PathBuf,
    },
    /// The file of labels cannot be parsed.
    #[error("{}: {cause}; move the file away to begin with new labels", file.display())]
    BadLabels {
        /// The file.
        file: PathBuf,
        /// The reason why the labels cannot be parsed.
        cause: panelprep_cell::labels::FormError,
    },
    /// The labels belong to another clip, or the clip has changed since.
    #[error(
        "{}: these labels were made for other pictures than those of {}; check each break again with `panelprep \
         label --clip {}`",
        labels.display(), clip.display(), clip.display()
    )]
    OtherClip {
        /// The labels' file.
        labels: PathBuf,
        /// The clip's folder.
        clip: PathBuf,
    },
    /// A mask would overwrite the labels that a person made.
    #[error(
        "{}: contains labels of a person, which the mask of this inspection would overwrite; name another folder for --pictures",
        folder.display()
    )]
    HoldsLabels {
        /// The folder.
        folder: PathBuf,
    },
    /// No picture of the film would be marked as wet, so that it could not be inspected.
    #[error("--wet-from-s is {wet_from_s} s; the limits are 0 to {seconds} s, the length of the film")]
    NeverWet {
        /// The requested time.
        wet_from_s: f64,
        /// Duration of the film, s.
        seconds: f64,
    },
    /// The time is not stated from which the sprayed panel is wet.
    #[error(
        "--spray-from-s is {spray_from_s} s, but --wet-from-s is missing; give --wet-from-s, the time at which the \
         spray is off"
    )]
    NoFirstWetPicture {
        /// The requested time.
        spray_from_s: f64,
    },
    /// The phases of the film are not in the order that the inspection needs.
    #[error(
        "--spray-from-s is {spray_from_s} s, --wet-from-s is {wet_from_s} s, and the film lasts {seconds} s; the spray \
         must begin at 0 s or later, the wet pictures after the spray, and both within the film"
    )]
    SprayAfterWet {
        /// The requested time.
        spray_from_s: f64,
        /// The requested time.
        wet_from_s: f64,
        /// Duration of the film, s.
        seconds: f64,
    },
}

/// The reason why the records do not contain what was requested, or do not accept a part.
#[derive(Debug, thiserror::Error)]
pub enum RecordFault {
    /// A text in a search is not a date.
    #[error("{option}: {cause}")]
    Date {
        /// The option.
        option: &'static str,
        /// The reason why the text is not a date.
        cause: panelprep_store::history::DateError,
    },
    /// Search conditions were given to a subcommand that is not the search.
    #[error(
        "conditions such as --part are valid only for the search, `panelprep history` without a subcommand; remove them"
    )]
    SearchBesideTask,
    /// The store contains no cycle of this panel.
    #[error("the store contains no cycle of panel {panel}; {}", describe_panels(panels))]
    NoCyclesOf {
        /// The name of the panel as the user typed it.
        panel: String,
        /// The panels of which the store contains cycles.
        panels: Vec<String>,
    },
    /// The cycles of the panel have no quantity with this name.
    #[error(
        "no cycle of panel {panel} has a quantity {found}{}; valid: {}; or, in quotes, the name of a check on the page \
         of a cycle",
        nearest.as_ref().map_or(String::new(), |nearest| format!(": did you mean {nearest}?")), words.join(", ")
    )]
    NoSuchNumber {
        /// The name as the user typed it.
        found: String,
        /// The panel.
        panel: String,
        /// The existing name that is most similar to the typed one.
        nearest: Option<String>,
        /// The keywords of the existing quantities.
        words: Vec<&'static str>,
    },
    /// A cycle with an unsigned record.
    #[error(
        "the record of cycle {cycle} is not signed: the cycle has not ended, or signing failed; `panelprep store \
         verify` reports details"
    )]
    NotSigned {
        /// The cycle.
        cycle: i64,
    },
    /// There is no public key for the verification.
    #[error(
        "no public key for the verification ({problem}): name the cell's public key with --public-key FILE; `panelprep record export` writes this file"
    )]
    NoPublicKey {
        /// The reason why the cell's own store has no public key.
        problem: String,
    },
}

fn describe_panels(panels: &[String]) -> String {
    match panels {
        [] => "the store contains no cycles".to_owned(),
        _ => format!("panels in the store: {}", panels.join(", ")),
    }
}
