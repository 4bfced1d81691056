//! Errors of the cell that stop a command: errors of a controller, a camera or a tool, real or simulated; and of a
//! calibration that is missing, contradicts another one, or cannot be measured with the given data.

use panelprep_cell::cell::{ProofStage, Unsigned};
use std::path::PathBuf;

/// The reason why a device cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DeviceFault {
    /// The files of the controller and the cell file state different ports.
    #[error(
        "{}: CELLCMD.xml and CELLSTAT.xml listen on ports {files}, but the cell's file states {cells}; set the same \
         ports in PORT of the XML files and in [robot] command_port and state_port", folder.display()
    )]
    OtherPorts {
        /// The folder with the files of the controller.
        folder: PathBuf,
        /// The ports in the files of the controller.
        files: String,
        /// The ports in the cell file.
        cells: String,
    },
    /// A fault of the tool is to be injected, but the tool is not simulated.
    #[error("--tool-fault needs [tool] kind = \"simulated\" and [robot] kind = \"mock\" in the cell's file")]
    NoFailingTool,
    /// An option is only valid for a complete cycle.
    #[error("{option} is for a whole cycle, not for single pictures and scans; omit the option")]
    CycleOnlyOption {
        /// The option.
        option: &'static str,
    },
    /// Errors of the arm are to be simulated, but the robot is not the mock robot of this program.
    #[error(
        "--arm-error-mm needs [robot] kind = \"mock\": the option has no effect on a controller in another process"
    )]
    ArmErrorInRehearsal,
    /// A camera is simulated, but the cell has no simulated world.
    #[error(
        "a simulated camera needs the simulated cell; set [robot] kind = \"mock\", or use a real or a recorded camera"
    )]
    NoWorld,
    /// The tool is simulated, but the cell has no simulated world.
    #[error(
        "[tool] kind = \"simulated\", but the cell is not simulated: a simulated tool may not determine how a real \
         arm moves"
    )]
    NoWorldForTool,
    /// A calibration that does not fit any simulated scanner.
    #[error(
        "the scanner's calibration is for {}×{} px, which the simulated scanner does not deliver; the nearest size is \
         {}×{} px: render the cell's files with `panelprep \
         render`", found_px[0], found_px[1], nearest_px[0], nearest_px[1]
    )]
    NoSuchSimulatedSize {
        /// Width and height in the calibration, px.
        found_px: [usize; 2],
        /// The nearest size that can be simulated, px.
        nearest_px: [usize; 2],
    },
    /// A stage of the acceptance tests that the command needs is not signed.
    #[error(transparent)]
    Unsigned(#[from] Unsigned),
    /// A stage of the acceptance tests was requested before the previous stage is signed.
    #[error(
        "stage {} can be tested only after stage {before} is signed: sign the page of stage {before}, store the \
         signature with `panelprep robot prove --stage {before} --sign --out FILE --by NAME`, then set signed_stage = \
         \"{before}\" in [robot] of the cell's file", stage.letter(), before = before.letter()
    )]
    ProvenTooEarly {
        /// The stage that was requested.
        stage: ProofStage,
        /// The stage that must be signed first.
        before: ProofStage,
    },
    /// The controller executes other programs than the accepted ones, so acceptance tests on it would not be valid for
    /// the accepted programs.
    #[error(
        "the tests are for programs with the checksum {reported}, but [robot] programs_sum is {}: accept the programs \
         first with `panelprep doctor --kuka DIR --accept`, and add the line that it prints to the cell's file",
        .accepted.map_or("missing".to_owned(), |sum| sum.to_string())
    )]
    ProofsOfOtherPrograms {
        /// The checksum that the controller reports, or that the page states.
        reported: i32,
        /// The program checksum at the acceptance of the cell.
        accepted: Option<i32>,
    },
    /// The operating mode is not that of the requested stage.
    #[error(
        "stage {} is tested in {}, but the controller reports {mode}: turn the mode switch, then run the command again",
        stage.letter(), if *stage == ProofStage::A { "T1" } else { "AUT or EXT" }
    )]
    ProvenInOtherMode {
        /// The stage that was requested.
        stage: ProofStage,
        /// The operating mode that the controller reports.
        mode: &'static str,
    },
    /// No controller responds, so no acceptance test can be run.
    #[error(
        "no controller responds, so no test can be run: connect the controller, and stop the service during the tests, \
         because a controller serves one client; `panelprep doctor` reports what is missing"
    )]
    NoControllerToProve,
    /// The page to be signed is not the newest page of its stage on which every test has passed.
    #[error(
        "{} is not the newest page of stage {} on which every test has passed: a page that was changed, has an open \
         test or is of a mock controller cannot be signed. Test the stage again with `panelprep robot prove --stage {} \
         --out FILE --by NAME`",
        page.display(), stage.letter(), stage.letter()
    )]
    PageNotProven {
        /// The page.
        page: PathBuf,
        /// The stage of the page.
        stage: ProofStage,
    },
    /// A sheet of foam was stated for an air-run, which has no contact.
    #[error("--on-foam is for `panelprep cycle`: an air-run has no contact, so omit the option")]
    FoamInTheAir,
    /// The acceptance tests need a real controller, but the robot is a mock robot.
    #[error(
        "[robot] kind is \"mock\", which has no controller to test; set kind = \"eki\" and host in the cell's file (to \
         try the command, run panelprep mock-robot and set host = \"127.0.0.1\")"
    )]
    NothingToProve,
}

/// The reason why a calibration cannot be used or made.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationFault {
    /// The controller's axis angles are not numbers.
    #[error(
        "the controller reports axis angles that are not numbers, so the flange pose is not known: restart the controller"
    )]
    NoAxes,
    /// No poses were given for a tool or touch calibration.
    #[error(
        "no poses are given: name the file of the poses, or read the poses from the controller with --live DIR"
    )]
    NoPoses,
    /// No camera was named for a live calibration.
    #[error("--live takes pictures: name the camera, --camera scanner or --camera flange-camera")]
    NoLiveCamera,
    /// The requested kind of board cannot be simulated.
    #[error("the simulated cell has only chessboards: use --board COLUMNSxROWS with --square-mm")]
    NoSimulatedBoard,
    /// A force calibration was requested, but the tool is a spring, which has no force control.
    #[error("the cell's [tool] is a spring, which has no force to verify")]
    SpringTool,
    /// The file with force measurements contains none.
    #[error("the file has no [[readings]]")]
    NoReadings,
}
