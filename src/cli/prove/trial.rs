//! What each trial of this program uses: its result, a client in a new epoch, commands that move nothing.

use super::super::fault::Fault;
use super::proof::Finding;
use super::raw_client::{Heard, OP_RESET, RawClient};
use panelprep_cell::cell::Cell;
use std::time::Duration;

/// The finding of a trial, with what was commanded and what was reported.
pub(super) type TestResult = Result<(Finding, String), Fault>;

/// The evidence of a trial without an answer of the controller.
pub(super) const NO_STATE_MESSAGE: &str =
    "no state within 10 s; is the submit interpreter running, and is no other client connected?";

/// The evidence of a trial that needs the robot program, which executes the commands.
pub(super) const NO_PROGRAM_MESSAGE: &str =
    "the robot program does not run: select cell_motion, in T1 hold Start, and prove again";

/// The bit of `Flags` that states that a motion is possible.
const MOTION_POSSIBLE: i64 = 16;
/// The bit of `Flags` that states that the program has stopped the epoch.
const STOPPED: i64 = 128;
/// Time in which an epoch that was requested is open, and the program has taken its frames back.
const EPOCH_TIMEOUT: Duration = Duration::from_millis(500);

pub(super) fn make_finding(right: bool, evidence: String) -> TestResult {
    Ok((if right { Finding::Proven } else { Finding::Wrong }, evidence))
}

/// The result of a trial that showed no effect, neither the expected one nor another one.
pub(super) fn open(evidence: impl Into<String>) -> TestResult {
    Ok((Finding::Open, evidence.into()))
}

/// The result of a trial that needs the robot program, if it does not run.
pub(super) fn no_program() -> TestResult {
    open(NO_PROGRAM_MESSAGE)
}

/// Returns whether the robot program runs, which executes the commands.
pub(super) fn program_runs(heard: &Heard) -> bool {
    heard.state_value("Flags").is_some_and(|flags| flags & MOTION_POSSIBLE != 0)
}

/// Returns whether the controller reports that it has stopped the epoch; `None` without a state.
pub(super) fn is_stopped(heard: &Heard) -> Option<bool> {
    heard.state_value("Flags").map(|flags| flags & STOPPED != 0)
}

/// Returns a number as evidence.
pub(super) fn shown(number: Option<i64>) -> String {
    number.map_or("nothing".to_owned(), |number| number.to_string())
}

/// Returns a command that sets the base, which moves nothing.
pub(super) fn set_base(id: i32, epoch: i64, x: &str) -> String {
    command(id, epoch, 3, "0.0", [x, "0.0", "0.0", "0.0", "0.0", "0.0"])
}

/// Returns a command; `speed_m_s` is its `R2`.
pub(super) fn command(
    id: i32,
    epoch: i64,
    operation: i32,
    speed_m_s: &str,
    [x, y, z, a, b, c]: [&str; 6],
) -> String {
    format!(
        "<Cmd Id=\"{id}\" Ep=\"{epoch}\" Op=\"{operation}\" N1=\"0\" N2=\"0\" R1=\"0.0\" R2=\"{speed_m_s}\"><P X=\"{x}\" Y=\"{y}\" \
         Z=\"{z}\" A=\"{a}\" B=\"{b}\" C=\"{c}\"></P></Cmd>"
    )
}

/// A client in a new epoch.
pub(super) struct InEpoch {
    pub(super) client: RawClient,
    pub(super) epoch: i64,
    /// The newest state in it.
    pub(super) heard: Heard,
}

/// Connects and opens the epoch after the next one; `None` if the controller does not report it in time.
pub(super) fn in_a_new_epoch(cell: &Cell) -> Option<InEpoch> {
    let (mut client, heard) = RawClient::patient(cell)?;
    let epoch = heard.state_value("Ep")? + 2;
    client.ask(OP_RESET, i32::try_from(epoch).ok()?).ok()?;
    let heard = client.listen(EPOCH_TIMEOUT, |_| false);
    (heard.state_value("Ep") == Some(epoch)).then_some(InEpoch { client, epoch, heard })
}
