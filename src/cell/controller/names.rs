//! The names of the controller's files, the numbers with which the PC plans motions, and the type of a contradiction
//! between two files.

use panelprep_base::config::Problem;

/// Name of the data list that a cell engineer edits.
pub const CONFIG: &str = "cell_config.dat";
/// Name of the data list of the protocol.
pub const DATA: &str = "cell_data.dat";
/// Name of the command channel's file.
pub const COMMANDS: &str = "CELLCMD.xml";
/// Name of the state channel's file.
pub const STATES: &str = "CELLSTAT.xml";
/// Name of the robot program; its interrupts name flags and a timer by their numbers.
pub const MOTION: &str = "cell_motion.src";
/// Name of the program with the cell's own subroutines.
pub const USER: &str = "cell_user.src";
/// Name of KUKA's program for the submit interpreter; it calls the routines of `cell_submit.src`.
pub const SUBMIT: &str = "sps.sub";
/// Names of the files of the release whose texts are part of the checksum, in this order. Of `CONFIG`, only the values
/// are part of it; `USER` contributes through the value CELL_USER_REVISION, the checksum of its text.
pub const PROGRAMS: [&str; 6] =
    [DATA, "cell_judge.src", "cell_link.src", MOTION, "cell_submit.src", "cell_tell.src"];

/// Returns whether a path ends with this file name. Upper and lower case are equal, as on the controller.
pub fn is_named(file: &str, name: &str) -> bool {
    file.rsplit(['/', '\\']).next().unwrap_or(file).eq_ignore_ascii_case(name)
}

/// Distance by which the controller's program lifts the tool off the panel at a stop in contact, mm: CELL_RETRACT_MM.
pub const RETRACT_MM: f64 = 50.0;
/// Speed of the retract, mm/s: CELL_RETRACT_VEL. It may be lower in a cell with a lower speed limit.
pub const RETRACT_MM_S: f64 = 200.0;
/// Lowest acceleration of the retract, m/s²: CELL_RETRACT_ACC. The safety concept calculates the worst case of Abort
/// with this value: the arm needs 0.2 / 2 = 0.1 s to reach 0.2 m/s, and the same time to stop.
pub const RETRACT_M_S2: f64 = 2.0;
/// Acceleration of all motions in the air, m/s². CELL_ACC_MAX must not be lower.
pub const AIR_ACCELERATION_M_S2: f64 = 1.0;

/// A contradiction between two files.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// The name of the controller's file, without its folder.
    pub file: &'static str,
    /// The line, the key, the value found, the expected value, and how to correct it.
    pub problem: Problem,
}

/// The differences that were found so far.
#[derive(Default)]
pub(super) struct Differences(pub(super) Vec<Difference>);

impl Differences {
    pub(super) fn push(&mut self, difference: Difference) {
        self.0.push(difference);
    }

    pub(super) fn note(
        &mut self,
        file: &'static str,
        line: usize,
        key: impl Into<String>,
        message: impl Into<String>,
    ) {
        self.0.push(Difference { file, problem: Problem { line, key: key.into(), message: message.into() } });
    }
}
