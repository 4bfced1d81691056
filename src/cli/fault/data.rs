//! The faults of a cell's data that stop a command: of a teaching, new or existing, of a clip and its labels, and of
//! the records of cycles and parts and their history.

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

/// The reason why a clip, or its labels, cannot be used or written.
#[derive(Debug, thiserror::Error)]
pub enum ClipFault {
    /// A film would overwrite another film.
    #[error("{} already contains a film (clip.csv or 00001.png); name another folder", folder.display())]
    ClipExists {
        /// The folder.
        folder: PathBuf,
    },
    /// A folder without a clip.
    #[error(
        "{}: there is no clip.csv; a clip is a folder of numbered pictures with a clip.csv that states the time of each \
         picture, as `panelprep shoot film` writes it", folder.display()
    )]
    NoClip {
        /// The folder.
        folder: PathBuf,
    },
    /// A clip of a set that has no labels.
    #[error(
        "{}: the clip has no labels: no mask.png in its folder truth or next to its pictures; mark the breaks with \
         `panelprep label --clip {}`",
        clip.display(), clip.display()
    )]
    NoLabels {
        /// The clip's folder.
        clip: PathBuf,
    },
    /// Labels that cannot be read.
    #[error("{}: {cause}; move the file away to begin with new labels", file.display())]
    BadLabels {
        /// The file.
        file: PathBuf,
        /// The problem of the labels.
        cause: panelprep_cell::labels::FormError,
    },
    /// A person labelled another clip, or this clip before it was changed.
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
    /// A mask would overwrite the labels of a person.
    #[error(
        "{}: contains labels of a person, which the mask of this inspection would overwrite; name another folder for --pictures",
        folder.display()
    )]
    HoldsLabels {
        /// The folder.
        folder: PathBuf,
    },
    /// No picture of the film would be wet, so that no test could use it.
    #[error("--wet-from-s is {wet_from_s} s; the limits are 0 to {seconds} s, the length of the film")]
    NeverWet {
        /// The requested time.
        wet_from_s: f64,
        /// Length of the film, s.
        seconds: f64,
    },
    /// It is not stated when the sprayed panel is wet.
    #[error(
        "--spray-from-s is {spray_from_s} s, but --wet-from-s is missing; give --wet-from-s, the time at which the \
         spray is off"
    )]
    NoFirstWetPicture {
        /// The requested time.
        spray_from_s: f64,
    },
    /// The phases are in another order than the test needs.
    #[error(
        "--spray-from-s is {spray_from_s} s, --wet-from-s is {wet_from_s} s, and the film lasts {seconds} s; the spray must begin at \
         0 s or later, the wet pictures after the spray, and both within the film"
    )]
    SprayAfterWet {
        /// The requested time.
        spray_from_s: f64,
        /// The requested time.
        wet_from_s: f64,
        /// Length of the film, s.
        seconds: f64,
    },
}

/// The reason why the records cannot answer, or do not accept a part.
#[derive(Debug, thiserror::Error)]
pub enum RecordFault {
    /// A text in a search that is not a date.
    #[error("{option}: {cause}")]
    Date {
        /// The option.
        option: &'static str,
        /// The problem of the date.
        cause: panelprep_store::history::DateError,
    },
    /// Conditions of a search together with another request to the history.
    #[error(
        "conditions such as --part are valid only for the search, `panelprep history` without a subcommand; remove them"
    )]
    SearchBesideTask,
    /// No cycle in the store treated this panel.
    #[error("the store contains no cycle of panel {panel}; {}", describe_panels(panels))]
    NoCyclesOf {
        /// The panel as the user named it.
        panel: String,
        /// The panels that were treated by cycles.
        panels: Vec<String>,
    },
    /// The panel's cycles have no quantity of this name.
    #[error(
        "no cycle of panel {panel} has a quantity {found}{}; valid: {}; or, in quotes, the name of a check on the page of a \
         cycle",
        nearest.as_ref().map_or(String::new(), |nearest| format!(": did you mean {nearest}?")), words.join(", ")
    )]
    NoSuchNumber {
        /// The name as the user typed it.
        found: String,
        /// The panel.
        panel: String,
        /// The existing name that is most similar.
        nearest: Option<String>,
        /// The keywords of the quantities that exist.
        words: Vec<&'static str>,
    },
    /// A part that may not be abraded any more.
    #[error(
        "{part} has reached the limit of {most} passes ([process] max_passes_per_part): {history}; take \
         the part out, and let the inspector decide about the part with the pages of these cycles"
    )]
    PartUsedUp {
        /// The part in words, with its serial number if it has one.
        part: String,
        /// Maximum number of passes.
        most: usize,
        /// The cycles, with the number of passes in each.
        history: String,
    },
    /// The names of a part that the cell does not accept.
    #[error("{0}")]
    PartNames(panelprep_cell::cell::PartNameError),
    /// A part whose abrasions cannot be counted, because the store was restored from a backup.
    #[error("{0}")]
    CountUnknown(panelprep_store::store::UnknownPassCount),
    /// A cycle with an unsigned record.
    #[error(
        "the record of cycle {cycle} is not signed: the cycle has not ended, or signing failed; `panelprep store verify` \
         reports details"
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
    /// A name of the part that is not valid.
    #[error("{option} \"{found}\": {problem}; give the text as it must appear on the cycle's page")]
    PartName {
        /// The option.
        option: &'static str,
        /// The name as given.
        found: String,
        /// The problem.
        problem: String,
    },
}

fn describe_panels(panels: &[String]) -> String {
    match panels {
        [] => "the store contains no cycles".to_owned(),
        _ => format!("panels in the store: {}", panels.join(", ")),
    }
}
