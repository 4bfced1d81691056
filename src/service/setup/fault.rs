//! The faults of the cell's files, calibrations, taught data and records: the reason why they cannot be used.

use crate::requirements::recipe_fits::ForceMismatch;
use crate::requirements::{CALIBRATION_ADVICE, Purpose, UnmetRequirement};
use panelprep_cell::cell::{Cell, PartNameError};
use panelprep_store::store::UnknownPassCount;
use std::error::Error;
use std::path::{Path, PathBuf};

/// The reason why the set-up of a cell, or its record, cannot be used or written.
#[derive(Debug, thiserror::Error)]
pub enum SetupFault {
    /// A file does not have the required content.
    #[error("{}: {cause}", file.display())]
    File {
        /// The file as the user named it.
        file: PathBuf,
        /// The problem of the file.
        cause: Box<dyn Error + Send + Sync>,
    },
    /// A configuration file has problems; each is listed with its line.
    #[error(transparent)]
    Configuration(#[from] panelprep_base::config::Problems),
    /// The cell's file does not state what the command needs.
    #[error("{}", format_missing(cell, *purpose, unmet))]
    Unmet {
        /// The cell's file.
        cell: PathBuf,
        /// The purpose for which the cell's file is not complete.
        purpose: Purpose,
        /// The missing entries.
        unmet: Vec<UnmetRequirement>,
    },
    /// A program ended while a motion was in progress.
    #[error(
        "a motion is open in the store: a program ended while the robot moved. Nothing moves until a person has \
         checked the cell; check the cell, jog the pad off the panel if it touches, then run `panelprep \
         clear --cell {}`",
        cell.display()
    )]
    MotionOpen {
        /// The cell's file.
        cell: PathBuf,
    },
    /// The last cycle was aborted.
    #[error(
        "the last cycle in this store was aborted, and no person has confirmed that the cause is removed; check the \
         cell, then run `panelprep clear --cell {}`", cell.display()
    )]
    NotCleared {
        /// The cell's file.
        cell: PathBuf,
    },
    /// The content of the store differs from what this program wrote there.
    #[error(
        "the store's content was changed or damaged: `panelprep store verify` lists the differences. Nothing \
         moves until a person has checked the cell and run `panelprep clear --cell {}`", cell.display()
    )]
    StoreChanged {
        /// The cell's file.
        cell: PathBuf,
    },
    /// A recording in a place that is not allowed for a client.
    #[error("--record \"{file}\": {words}")]
    RecordName {
        /// The file name, with unprintable characters as escapes.
        file: String,
        /// The problem of the name, and what is allowed.
        words: &'static str,
    },
    /// The cell's file names no such calibration.
    #[error("{}: [calibration] {key} is missing, and this command needs it: set the key to the path of the calibration file", cell.display())]
    NotCalibrated {
        /// The cell's file.
        cell: PathBuf,
        /// The key.
        key: &'static str,
    },
    /// A mount that was measured with another correction of the arm than the cell's, or with none.
    #[error(
        "{}: was measured with {}, but the cell's file names {}: robot poses would be corrected twice or not at all. \
         Repeat this calibration, or name in [calibration] robot_correction the correction with which it was measured",
        file.display(), describe_correction(found.as_deref()), describe_correction(ours.as_deref())
    )]
    OtherCorrection {
        /// The mount's file.
        file: PathBuf,
        /// The correction's hash in the mount's file.
        found: Option<String>,
        /// The hash of the cell's correction.
        ours: Option<String>,
    },
    /// The correction's file has changed since it was read.
    #[error(
        "{}: the file of [calibration] robot_correction has changed since this program read it; restart the program", cell.display()
    )]
    CorrectionChanged {
        /// The cell's file.
        cell: PathBuf,
    },
    /// The cell's file names a calibration that does not exist.
    #[error(
        "{}: [calibration] {key} names {}, which does not exist; {}", cell.display(), file.display(), CALIBRATION_ADVICE
    )]
    CalibrationAway {
        /// The cell's file.
        cell: PathBuf,
        /// The key.
        key: &'static str,
        /// The calibration's file.
        file: PathBuf,
    },
    /// The tool's TCP was measured, but not its axis.
    #[error(
        "{file}: the tool's axis was not measured (axis_measured is not true); a tilted pad grinds an edge into the panel: \
         run `panelprep calibrate tcp` with [[axis]], or with [[plate]] and [[flat]]"
    )]
    NoAxis {
        /// The tool's file.
        file: String,
    },
    /// A required input or output has no name in the cell's file.
    #[error("the cell's file has no \"{name}\" in [{table}], which a cycle needs; add it")]
    NotWired {
        /// The table.
        table: &'static str,
        /// The name.
        name: &'static str,
    },
    /// A key that a cycle needs is not stated.
    #[error("the cell's file does not contain {key}, which a cycle needs; add it")]
    NotStated {
        /// The key.
        key: &'static str,
    },
    /// No corner was taught.
    #[error("no corner of this panel was taught; teach a corner with --corner and --flange")]
    NoCorner,
    /// A corner was taught in an area of the picture in which measuring is not permitted.
    #[error("a taught corner: {0}")]
    CornerOutsideOfLens(String),
    /// The forces of the recipe and of the tool state do not agree.
    #[error(transparent)]
    Force(#[from] ForceMismatch),
    /// All corner pictures in which no corner was found.
    #[error("{}", .0.join("; "))]
    Corners(Vec<String>),
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
    /// The names of a part that the cell does not accept.
    #[error("{0}")]
    PartNames(PartNameError),
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
    /// A part whose abrasions cannot be counted, because the store was restored from a backup.
    #[error("{0}")]
    CountUnknown(UnknownPassCount),
    /// The configured cameras are not those in use.
    #[error(
        "a camera's settings, or the serial number or size in its calibration, have changed since the service \
         started, and the service still uses the old values; restart the service"
    )]
    CamerasChanged,
    /// A camera without settings for taking a shot.
    #[error(
        "[scanner] {key} is missing; kind = \"zivid\" needs this key to take a shot: name the settings file that Zivid Studio saved \
         (settings for 3D shots with colour, settings_2d for pictures)"
    )]
    NoCameraSettings {
        /// The key.
        key: &'static str,
    },
    /// A flange camera that this program cannot open.
    #[error(
        "[flange_camera] kind = \"gige\": this program was built without the cargo feature gige; use a program with this \
         feature, or set kind = \"simulated\" or \"recorded\""
    )]
    BuiltWithoutGige,
    /// A system of the plant that this program was built without.
    #[error(
        "{what}: this program was built without the cargo feature plant; use the program of the package, or build it with \
         `cargo build --release --features plant`"
    )]
    BuiltWithoutPlant {
        /// The command, or the tables of the cell's file.
        what: String,
    },
    /// A stage refused its input; with the stage's own message.
    #[error(transparent)]
    Stage(Box<dyn Error + Send + Sync>),
}

impl SetupFault {
    /// Creates the fault of a file.
    pub fn file_fault(file: &Path, cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        SetupFault::File { file: file.to_owned(), cause: cause.into() }
    }

    /// Creates the fault of a stage from its error.
    pub fn stage(cause: impl Error + Send + Sync + 'static) -> Self {
        SetupFault::Stage(Box::new(cause))
    }

    /// Returns the fault of a cell whose file names a system of the plant that this program was built without; `None` if
    /// there is none.
    pub fn missing_plant(cell: &Cell) -> Option<Self> {
        let tables = cell.plant_tables();
        let is_missing = !cfg!(feature = "plant") && !tables.is_empty();
        is_missing.then(|| SetupFault::BuiltWithoutPlant { what: tables.join(", ") })
    }
}

/// Returns a line for each missing thing; the first line also names the commands that need these things.
fn format_missing(cell: &Path, purpose: Purpose, unmet: &[UnmetRequirement]) -> String {
    let mut needed_by = format!(" ({} need it)", purpose.commands());
    let mut line = |UnmetRequirement { key, message, .. }: &UnmetRequirement| {
        format!("{}: {key}: {message}{}", cell.display(), std::mem::take(&mut needed_by))
    };
    unmet.iter().map(&mut line).collect::<Vec<_>>().join("\n")
}

fn describe_correction(hash: Option<&str>) -> String {
    match hash {
        None => "no correction of the arm".to_owned(),
        Some(hash) => format!("the correction of the arm {}", hash.get(..12).unwrap_or(hash)),
    }
}
