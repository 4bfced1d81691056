//! Tests that a client can do without a person: over the two ports, without a motion.

use super::super::live;
use super::link_trials;
use super::raw_client::{RawClient, STATE_TIMEOUT, pose};
use super::trial::{
    InEpoch, NO_STATE_MESSAGE, TestResult, command, in_a_new_epoch, make_finding, no_program, open, program_runs,
    set_base, shown,
};
use panelprep_base::geometry::KukaPose;
use panelprep_cell::cell::Cell;
use panelprep_kuka::eki::Command;
use panelprep_service::daemon::SingleRobot;
use std::time::{Duration, Instant};

/// A test of a row.
pub(super) type Attempt = fn(&Cell) -> TestResult;

/// The test for a row of the installation page; `None` if a person must look.
pub(super) fn for_row(number: u32) -> Option<Attempt> {
    match number {
        1 => Some(a_frame_comes_in_any_order),
        2 => Some(no_old_command_is_left),
        3 => Some(a_command_is_read_whole),
        5 => Some(link_trials::check_names_read),
        6 => Some(link_trials::what_is_no_document_does_nothing),
        7 => Some(link_trials::check_second_client_refused),
        15 => Some(time_is_in_ms),
        18 => Some(large_numbers_are_decimal),
        27 => Some(a_line_without_frames_is_refused),
        33 => Some(link_trials::check_epoch_range),
        35 => Some(link_trials::check_vanished_client),
        39 => Some(check_decimals),
        _ => None,
    }
}

/// Checks that the base comes back as it was sent: both texts are compared as numbers, with a smaller tolerance
/// than the link's own.
fn check_base_echo(cell: &Cell, x_mm: f64, most_mm: f64) -> TestResult {
    // The connections of earlier tests may still be closing.
    if RawClient::patient(cell).is_none() {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    }
    std::thread::sleep(Duration::from_millis(500));
    let (mut robot, _) = live::robot_alone(cell)?;
    let mut single = match SingleRobot::connect(&mut robot, cell.arm()) {
        Ok(single) => single,
        Err(error) => return make_finding(false, error.to_string()),
    };
    if !single.state().motion_possible {
        return no_program();
    }
    let base = KukaPose { x_mm, ..KukaPose::default() };
    match single.set(Command::SetBase(base), cell) {
        Ok(()) => {
            let told_mm = single.state().active_base.x_mm;
            let evidence = format!("base X {x_mm} mm was sent, {told_mm} mm was reported back");
            make_finding((told_mm - x_mm).abs() <= most_mm, evidence)
        }
        Err(error) => make_finding(false, format!("base X {x_mm} mm: {error}")),
    }
}

fn check_decimals(cell: &Cell) -> TestResult {
    check_base_echo(cell, 1.2345, 0.000_01)
}

/// The six attributes in reverse: each must still reach its own coordinate.
fn a_frame_comes_in_any_order(cell: &Cell) -> TestResult {
    const SENT: &str = "<P C=\"6.0\" B=\"5.0\" A=\"4.0\" Z=\"3.0\" Y=\"2.0\" X=\"1.0\"></P>";
    const EXPECTED: [f64; 6] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    const MAX_DIFFERENCE: f64 = 0.001;
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    if !program_runs(&heard) {
        return no_program();
    }
    let head = format!("<Cmd Id=\"1\" Ep=\"{epoch}\" Op=\"3\" N1=\"0\" N2=\"0\" R1=\"0.0\" R2=\"0.0\">");
    if client.send_on_command(format!("{head}{SENT}</Cmd>").as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let state = client.listen(STATE_TIMEOUT, |_| false).state.unwrap_or_default();
    let base = pose(&state, "Base").unwrap_or_default();
    let is_right = base.iter().zip(EXPECTED).all(|(text, expected)| {
        text.parse::<f64>().is_ok_and(|number| (number - expected).abs() <= MAX_DIFFERENCE)
    });
    make_finding(
        is_right,
        format!("sent as C 6, B 5, A 4, Z 3, Y 2, X 1; the state has X to C {}", base.join(", ")),
    )
}

/// Thirty commands are written at once and the link is cut, so that entries stay unread. They belong to the epoch that
/// is opened next: an old entry would be read with the next command, and would be refused or executed in its place.
fn no_old_command_is_left(cell: &Cell) -> TestResult {
    const COMMANDS: i32 = 30;
    let Some((mut first, heard)) = RawClient::patient(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let epoch = heard.state_value("Ep").unwrap_or_default() + 2;
    let old: String = (1..=COMMANDS).map(|id| set_base(id, epoch, &format!("{id}.0"))).collect();
    if first.send_on_command(old.as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    drop(first);
    let Some(InEpoch { mut client, epoch: opened, heard }) = in_a_new_epoch(cell) else {
        return make_finding(false, "no epoch was opened after the link was cut".to_owned());
    };
    // A command that is queued and not executed would end the epoch.
    if !program_runs(&heard) {
        return no_program();
    }
    let before = heard.ack_value("Rx");
    if client.send_on_command(set_base(1, opened, "100.0").as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let after = client.listen(STATE_TIMEOUT, |_| false);
    let numbers = (before, after.ack_value("Rx"), after.ack_value("Err"));
    make_finding(
        opened == epoch && numbers == (Some(0), Some(1), Some(0)),
        format!(
            "{COMMANDS} commands of epoch {epoch} were cut off; in epoch {opened}: Rx {}, after one new command Rx {}, Err {}",
            shown(numbers.0),
            shown(numbers.1),
            shown(numbers.2)
        ),
    )
}

/// The program takes a command only if all its elements have the same counter.
fn a_command_is_read_whole(cell: &Cell) -> TestResult {
    check_base_echo(cell, 1.0, 0.000_01)
}

fn time_is_in_ms(cell: &Cell) -> TestResult {
    const WATCHED: Duration = Duration::from_secs(5);
    /// A state comes every 100 ms.
    const MAX_DIFFERENCE_MS: i64 = 500;
    /// Half of the states that are due.
    const MIN_STATES: i64 = 25;
    let Some((mut client, first)) = RawClient::patient(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let begun = Instant::now();
    let last = client.listen(WATCHED, |_| false);
    let passed = begun.elapsed();
    let (Some(from), Some(to)) = (first.state_value("T"), last.state_value("T")) else {
        return make_finding(false, "no state at the end of 5 s".to_owned());
    };
    let passed_ms = i64::try_from(passed.as_millis()).unwrap_or(i64::MAX);
    let states = last.state_value("Seq").zip(first.state_value("Seq")).map_or(0, |(last, first)| last - first);
    let evidence = format!(
        "T counted {} in {passed_ms} ms of this computer (largest difference {MAX_DIFFERENCE_MS}), over {states} states (at least \
         {MIN_STATES})",
        to - from
    );
    // A link that ended early compares two states of nearly the same moment.
    if passed < WATCHED || states < MIN_STATES {
        return open(evidence);
    }
    make_finding((to - from - passed_ms).abs() <= MAX_DIFFERENCE_MS, evidence)
}

fn large_numbers_are_decimal(cell: &Cell) -> TestResult {
    const SENT: &str = "2000000.0";
    const EXPECTED: &str = "2000000.000000";
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    if !program_runs(&heard) {
        return no_program();
    }
    if client.send_on_command(set_base(1, epoch, SENT).as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let state = client.listen(STATE_TIMEOUT, |_| false).state.unwrap_or_default();
    let written = pose(&state, "Base").map_or("nothing", |[x, ..]| x);
    make_finding(written == EXPECTED, format!("base X {SENT} mm was sent, the state contains {written}"))
}

/// The line goes to the pose at which the arm is, at 1 mm/s: a controller that executes it moves nothing.
fn a_line_without_frames_is_refused(cell: &Cell) -> TestResult {
    const NO_FRAMES: i64 = 6;
    const SPEED_M_S: &str = "0.001";
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let tip = heard.state.as_deref().and_then(|state| pose(state, "Tcp"));
    let (true, Some(tip)) = (program_runs(&heard), tip) else {
        return no_program();
    };
    if client.send_on_command(command(1, epoch, 2, SPEED_M_S, tip).as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let after = client.listen(STATE_TIMEOUT, |heard| heard.ack_value("Err").is_some_and(|refusal| refusal != 0));
    let refusal = after.ack_value("Err").unwrap_or_default();
    make_finding(
        refusal == NO_FRAMES && after.ack_value("ErrId") == Some(1),
        format!(
            "a line without base and tool: Err {refusal} (expected {NO_FRAMES}), and it led to where the arm was"
        ),
    )
}
