//! The names of the controller's files.

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
/// Name of KUKA's own program of the submit interpreter, which calls the cycle of `cell_submit.src`.
pub const SUBMIT: &str = "sps.sub";
/// Names of the release's files whose texts are in the sum, in the order of the sum. `CONFIG` is in the sum by its
/// values, and `USER` by the value CELL_USER_REVISION, which states the sum of its text.
pub const PROGRAMS: [&str; 6] =
    [DATA, "cell_judge.src", "cell_link.src", MOTION, "cell_submit.src", "cell_tell.src"];

/// Returns whether a file, given with or without its folder, has this name. The controller distinguishes no upper and
/// lower case.
pub fn is_named(file: &str, name: &str) -> bool {
    file.rsplit(['/', '\\']).next().unwrap_or(file).eq_ignore_ascii_case(name)
}
