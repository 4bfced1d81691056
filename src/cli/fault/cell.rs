//! The faults of the cell that stop a command: of a controller, a camera or a tool, real or simulated, and of a
//! calibration that is missing, contradicts another one, or lacks the data for its measurement.

use panelprep_cell::cell::{Cell, ProofStage, Unsigned};
use panelprep_service::requirements::CALIBRATION_ADVICE;
use std::path::PathBuf;

/// The reason why a device cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DeviceFault {
    /// The controller's files and the cell's file state different ports.
    #[error(
        "{}: CELLCMD.xml and CELLSTAT.xml listen on ports {files}, but the cell's file states {cells}; set the same \
         ports in PORT of the XML files and in [robot] command_port and state_port", folder.display()
    )]
    OtherPorts {
        /// The folder of the controller's files.
        folder: PathBuf,
        /// Ports in the files.
        files: String,
        /// Ports in the cell's file.
        cells: String,
    },
    /// No simulated tool exists that could have the fault.
    #[error("--tool-fault needs [tool] kind = \"simulated\" and [robot] kind = \"mock\" in the cell's file")]
    NoFailingTool,
    /// An option that is simulated only in a whole cycle.
    #[error("{option} is for a whole cycle, not for single pictures and scans; leave the option out")]
    CycleOnlyOption {
        /// The option.
        option: &'static str,
    },
    /// Only the mock robot in this program can simulate the arm's errors.
    #[error(
        "--arm-error-mm needs [robot] kind = \"mock\": the option has no effect on a controller in another process"
    )]
    ArmErrorInRehearsal,
    /// A simulated camera without a simulated world.
    #[error(
        "a simulated camera needs the simulated cell; set [robot] kind = \"mock\", or use a real or a recorded camera"
    )]
    NoWorld,
    /// A simulated tool without a simulated world.
    #[error(
        "[tool] kind = \"simulated\", but the cell is not simulated: a simulated tool may not determine how a real \
         arm moves"
    )]
    NoWorldForTool,
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
    /// A camera without settings for taking a shot.
    #[error(
        "[scanner] {key} is missing; kind = \"zivid\" needs this key to take a shot: name the settings file that Zivid Studio saved \
         (settings for 3D shots with colour, settings_2d for pictures)"
    )]
    NoCameraSettings {
        /// The key.
        key: &'static str,
    },
    /// The configured cameras are not those in use.
    #[error(
        "a camera's settings, or the serial number or size in its calibration, have changed since the service \
         started, and the service still uses the old values; restart the service"
    )]
    CamerasChanged,
    /// A calibration that does not fit any simulated scanner.
    #[error(
        "the scanner's calibration is for {}×{} px, which the simulated scanner does not deliver; the nearest size is {}×{} \
         px: render the cell's files with `panelprep render`", found_px[0], found_px[1], nearest_px[0], nearest_px[1]
    )]
    NoSuchSimulatedSize {
        /// Size in the calibration, px.
        found_px: [usize; 2],
        /// The nearest size that is delivered, px.
        nearest_px: [usize; 2],
    },
    /// The stage of proofs that the command needs is not signed.
    #[error(transparent)]
    Unsigned(#[from] Unsigned),
    /// A stage is to be proven before the one on which it depends is signed.
    #[error(
        "stage {} is proven after stage {before} is signed: sign the page of stage {before}, store the signature with \
         `panelprep robot prove --stage {before} --sign --out FILE --by NAME`, then set signed_stage = \"{before}\" in [robot] of \
         the cell's file", stage.letter(), before = before.letter()
    )]
    ProvenTooEarly {
        /// The stage to be proven.
        stage: ProofStage,
        /// The stage that must be proven first.
        before: ProofStage,
    },
    /// The controller executes other programs than the accepted ones, so proofs on it would not be valid for the
    /// accepted programs.
    #[error(
        "the proofs are of programs with the checksum {reported}, but [robot] programs_sum is {}: accept the programs first with \
         `panelprep doctor --kuka DIR --accept`, and add the line that it prints to the cell's file",
        .accepted.map_or("missing".to_owned(), |sum| sum.to_string())
    )]
    ProofsOfOtherPrograms {
        /// The checksum that the controller reports, or that the page states.
        reported: i32,
        /// The checksum with which the cell was accepted.
        accepted: Option<i32>,
    },
    /// A stage is to be proven in another mode than its own.
    #[error(
        "stage {} is proven in {}, but the controller reports {mode}: turn the mode switch, then run the command again",
        stage.letter(), if *stage == ProofStage::A { "T1" } else { "AUT or EXT" }
    )]
    ProvenInOtherMode {
        /// The stage to be proven.
        stage: ProofStage,
        /// The name of the reported mode.
        mode: &'static str,
    },
    /// No controller answers, so nothing can be proven.
    #[error(
        "no controller answers, so nothing can be proven: connect it, and end the service while this runs, since a \
         controller serves one client; `panelprep doctor` reports what is missing"
    )]
    NoControllerToProve,
    /// A page is to be signed that this store does not know as proven.
    #[error(
        "{} is not the newest page of stage {} of which each row was proven: a page that was changed, has an open row or is \
         of a mock controller cannot be signed. Prove the stage again with `panelprep robot prove --stage {} --out FILE --by NAME`",
        page.display(), stage.letter(), stage.letter()
    )]
    PageNotProven {
        /// The page.
        page: PathBuf,
        /// The stage to be signed.
        stage: ProofStage,
    },
    /// Foam for a path that touches nothing.
    #[error("--on-foam is for `panelprep cycle`: an air-run touches nothing, so leave it out")]
    FoamInTheAir,
    /// A simulated controller proves nothing about a real one.
    #[error(
        "[robot] kind is \"mock\", which has no controller to test; set kind = \"eki\" and host in the cell's file (to try \
         the command, run panelprep mock-robot and set host = \"127.0.0.1\")"
    )]
    NothingToProve,
}

impl DeviceFault {
    /// Returns the fault of a cell whose file names a system of the plant that this program was built without; `None` if
    /// there is none.
    pub fn missing_plant(cell: &Cell) -> Option<Self> {
        let tables = cell.plant_tables();
        let is_missing = !cfg!(feature = "plant") && !tables.is_empty();
        is_missing.then(|| DeviceFault::BuiltWithoutPlant { what: tables.join(", ") })
    }
}

/// The reason why a calibration cannot be used or made.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationFault {
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
    /// The controller's axis angles are not numbers.
    #[error("the controller reports axis angles that are not numbers: the flange's pose is not known")]
    NoAxes,
    /// A tool or touch calibration without poses.
    #[error(
        "no poses are given: name the file of the poses, or read the poses from the controller with --live DIR"
    )]
    NoPoses,
    /// A live calibration that names no camera.
    #[error("--live takes pictures: name the camera, --camera scanner or --camera flange-camera")]
    NoLiveCamera,
    /// A board of a kind that is not simulated.
    #[error("the simulated cell has only chessboards: use --board COLUMNSxROWS with --square-mm")]
    NoSimulatedBoard,
    /// A force calibration, but the tool is a spring and has no force.
    #[error("the cell's [tool] is a spring, which has no force to verify")]
    NoCompliantTool,
    /// A readings file without a reading.
    #[error("the file has no [[readings]]")]
    NoReadings,
}

fn describe_correction(hash: Option<&str>) -> String {
    match hash {
        None => "no correction of the arm".to_owned(),
        Some(hash) => format!("the correction of the arm {}", hash.get(..12).unwrap_or(hash)),
    }
}
