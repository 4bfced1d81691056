//! Tests of the controller's stops: abort, underrun in contact, watchdog, lost link, emergency stop. An ended epoch
//! never moves the arm. Also tests which outputs the end of an epoch switches off and when, and how far one request can
//! raise the epoch number.

use super::*;

/// Creates a controller in contact: 60 of 200 points are sent, the tool is on and moves.
fn sanding(clock: Clock) -> Rig {
    let mut rig = Rig::ready(clock);
    rig.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0; 2], [0.0; 6]);
    rig.line(200, 60, true);
    rig.beats(5);
    assert!(rig.tool_on() && rig.flag(3), "it sands");
    rig
}

/// Asserts that the tool is off, that the arm has stopped 50 mm above its line on the panel, and that the epoch has
/// ended.
fn assert_retracted(rig: &mut Rig) {
    rig.settle();
    let tip = rig.tool_tip().mm;
    // The Z axes of base and tool point down, so −Z points up.
    assert!((tip.z - (BASE_MM[2] + 50.0)).abs() < 1e-6 && tip.y.abs() < 1e-6, "{tip}");
    assert!(tip.x < BASE_MM[0] && !rig.tool_on() && rig.flag(7) && !rig.flag(3));
    let (executed, there) = (rig.ids().len(), rig.tool_tip());
    rig.line(60, 10, true);
    rig.beats(5);
    assert!(
        rig.ids().len() == executed && rig.tool_tip().distance_mm(there) < 1e-12,
        "an ended epoch moved the arm"
    );
}

#[test]
fn abort_in_contact_switches_the_tool_off_and_retracts() {
    let mut rig = sanding(Clock::LockStep);
    let (at, done) = (rig.tool_tip(), rig.ids().len());
    rig.ask(11, 2);
    assert_eq!((rig.state("Ep"), rig.flag(7), rig.tool_on()), (2, true, false));
    assert_eq!(rig.wires.changes().last(), Some(&(TOOL_OUTPUT, false, rig.controller.time_ms())));
    rig.beat();
    // Expected values, calculated by hand: braking from 100 mm/s at 5000 mm/s² takes 20 ms and 1 mm.
    let braked_mm = at.mm.x - rig.tool_tip().mm.x;
    assert!((braked_mm - 1.0).abs() < 1e-6, "{braked_mm}");
    (rig.epoch, rig.id) = (2, 0);
    assert_retracted(&mut rig);
    assert!(rig.ids().len() <= done + 1 && rig.causes() == [StopCause::Abort]);
    // In the ended epoch, commands are refused because it was stopped; the new epoch begins without a refusal.
    assert_eq!(rig.ack("Err"), Refusal::Stopped as i32);
    rig.open();
    assert_eq!((rig.state("Ep"), rig.flag(7), rig.state("Done")), (3, false, 0));
}

/// The client may open the next epoch while the arm is retracting; the commands of the new epoch wait.
#[test]
fn a_new_epoch_waits_for_the_retract() {
    let mut rig = sanding(Clock::LockStep);
    rig.ask(11, 2);
    (rig.epoch, rig.id) = (2, 0);
    rig.open();
    rig.prepare();
    assert_eq!((rig.ack("Rx"), rig.flag(3)), (3, true), "it retracts");
    rig.settle();
    assert!((rig.tool_tip().mm.z - (BASE_MM[2] + 50.0)).abs() < 1e-6);
    assert_eq!(rig.state("Done"), 3);
}

/// Without contact there is no retract; the arm brakes and stops.
#[test]
fn abort_in_the_air_only_stops() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.line(60, 60, false);
    rig.beats(5);
    rig.ask(11, 2);
    rig.settle();
    assert!((rig.tool_tip().mm.z - BASE_MM[2]).abs() < 1e-6 && rig.ids().len() < 60);
    // An abort stops the arm even if its epoch number is not higher than the current one.
    let mut rig = sanding(Clock::LockStep);
    rig.ask(11, 0);
    assert_eq!((rig.state("Ep"), rig.flag(7)), (1, true));
}

#[test]
fn a_missing_point_in_contact_retracts() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0; 2], [0.0; 6]);
    rig.line(40, 10, true);
    assert_retracted(&mut rig);
    assert_eq!((rig.state("Under"), rig.causes(), rig.ids().len()), (1, vec![StopCause::Underrun], 10));
    assert!((rig.tool_tip().mm.x - (BASE_MM[0] - 50.0)).abs() < 1e-6, "stood exactly on the tenth point");
    // The arm also retracts after a path whose last point is in contact.
    let mut rig = Rig::ready(Clock::LockStep);
    rig.line(10, 10, true);
    assert_retracted(&mut rig);
}

/// Expected time, calculated by hand: the last message arrives at the end of a granted period. After 34 ticks (408 ms),
/// nothing was received for 400 ms.
#[test]
fn silence_of_the_client_stops_queued_commands() {
    let mut rig = sanding(Clock::Free);
    let heard_ms = rig.controller.last_frame_ms;
    rig.controller.advance_ms(3200);
    rig.listen();
    let stop = rig.controller.program_stops()[0].clone();
    assert_eq!(
        (stop.cause, stop.contact, stop.epoch, stop.time_ms),
        (StopCause::Watchdog, true, 1, heard_ms + 408)
    );
    // The tool leaves the surface within 500 ms of the last message: the first sample after the stop is not a sanding
    // sample.
    let last = rig.controller.trace().last().expect("some").time_ms;
    assert!(last <= heard_ms + 500, "{last} {heard_ms}");
    assert_eq!(rig.controller.close_reason(Channel::State), Some(EkiFault::NoContact));
    assert!([Channel::Command, Channel::State].map(|channel| rig.controller.connect(channel)) == [true; 2]);
    assert_retracted(&mut rig);
    // If no command is queued, the client is treated as lost after three seconds.
    let mut quiet = Rig::ready(Clock::Free);
    quiet.controller.advance_ms(2_900);
    assert_eq!(quiet.causes(), []);
    quiet.controller.advance_ms(200);
    assert_eq!((quiet.causes(), quiet.controller.is_connected(Channel::State)), (vec![StopCause::LinkLost], false));
}

/// The client of the command channel has disconnected, and that of the state channel has disappeared without closing
/// its connection. The attempts of a new client, every second, must not keep the old connection open; the new client is
/// accepted after three seconds.
#[test]
fn attempts_of_a_new_client_do_not_keep_a_lost_client_connected() {
    let mut rig = Rig::ready(Clock::Free);
    rig.controller.disconnect(Channel::Command);
    for _ in 0..3 {
        rig.controller.advance_ms(1_000);
        if !rig.controller.is_connected(Channel::State) {
            break;
        }
        assert!(rig.controller.connect(Channel::Command) && !rig.controller.connect(Channel::State));
        rig.controller.disconnect(Channel::Command);
    }
    rig.controller.advance_ms(100);
    assert!([Channel::Command, Channel::State].map(|channel| rig.controller.connect(channel)) == [true; 2]);
}

#[test]
fn a_lost_link_stops_queued_commands() {
    for channel in [Channel::Command, Channel::State] {
        let mut rig = sanding(Clock::Free);
        rig.controller.disconnect(channel);
        assert!(!rig.controller.connect(channel), "the program has not opened it again");
        rig.controller.advance_ms(24);
        assert!(rig.controller.connect(channel));
        assert_retracted(&mut rig);
        assert_eq!(rig.causes(), [StopCause::LinkLost]);
    }
}

#[test]
fn a_gap_of_ids_in_contact_retracts() {
    let mut rig = sanding(Clock::LockStep);
    rig.id += 1;
    rig.line(1, 1, true);
    rig.beat();
    assert_eq!(rig.ack("Err"), Refusal::IdGap as i32);
    assert_retracted(&mut rig);
}

/// If a point far ahead on the path is out of reach, the path is not executed up to this point, and the message names
/// the point.
#[test]
fn an_unreachable_point_stops_the_path() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.line(12, 10, false);
    let id = rig.command(2, [1, 0], [0.0; 2], [0.0, 900.0, 0.0, 0.0, 0.0, 0.0]);
    rig.settle();
    assert_eq!((rig.ack("Err"), rig.ack("ErrId")), (Refusal::Unreachable as i32, id));
    assert!(rig.ids().len() < 10, "{:?}", rig.ids());
    assert!(
        rig.controller.program_stops()[0].detail.contains("mm from axis 2"),
        "{:?}",
        rig.controller.program_stops()
    );
}

/// Contact requires the sanding tool, because only for this tool the direction of the retract (−Z) is known.
#[test]
fn contact_without_the_sanding_tool_is_refused() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.command(4, [0, 0], [0.0; 2], [0.0, 0.0, TOOL_MM, 0.0, 0.0, 0.0]);
    rig.line(1, 1, true);
    rig.beat();
    assert_eq!(rig.ack("Err"), Refusal::OutOfRange as i32);
}

#[test]
fn the_e_stop_stops_at_once_and_its_release_continues_nothing() {
    let mut rig = sanding(Clock::LockStep);
    let at = rig.tool_tip();
    rig.controller.press_e_stop();
    assert!(!rig.tool_on());
    rig.beats(3);
    assert!(rig.tool_tip().distance_mm(at) < 1e-12 && rig.causes() == [StopCause::EStop]);
    // Of the flags, only "guard closed" and "stopped" remain set.
    assert_eq!(rig.state("Flags") & !(1 << 5 | 1 << 6), 1 << 2 | 1 << 7);
    rig.controller.release_e_stop();
    rig.controller.switch_drives(true);
    rig.ask(11, 2);
    rig.beats(3);
    assert!(rig.tool_tip().distance_mm(at) < 1e-12, "nothing continues, nothing retracts later");
    // After a reset of the program no motion is possible until the program is started, and the TCP position is unknown.
    assert!(!rig.flag(4) && rig.states.contains("<Tcp X=\"0.000000\" Y=\"0.000000\" Z=\"0.000000\""));
    (rig.epoch, rig.id) = (2, 0);
    rig.open();
    rig.command(1, [0, 0], [10.0, 0.0], START_DEG);
    rig.beat();
    assert_eq!(rig.ack("Err"), Refusal::NoMotion as i32);
    rig.controller.start_program();
    rig.open();
    rig.prepare();
    rig.command(2, [0, 0], [0.0; 2], [50.0, 0.0, -30.0, 0.0, 0.0, 0.0]);
    rig.settle();
    assert!((rig.tool_tip().mm.z - (BASE_MM[2] + 30.0)).abs() < 1e-6);
}

#[test]
fn drives_guard_and_mode_end_the_epoch_at_once() {
    let acts: [(fn(&mut Controller), StopCause); 3] = [
        (|controller| controller.switch_drives(false), StopCause::Drives),
        (|controller| controller.set_guard(false), StopCause::Guard),
        (|controller| controller.select_mode(Mode::T2), StopCause::Mode),
    ];
    for (act, cause) in acts {
        let mut rig = sanding(Clock::LockStep);
        let at = rig.tool_tip();
        act(&mut rig.controller);
        rig.beats(2);
        assert!(rig.tool_tip().distance_mm(at) < 1e-12 && !rig.tool_on() && rig.flag(7));
        assert_eq!((rig.causes(), rig.flag(4)), (vec![cause], false));
    }
}

/// In T1 the release of the Start key pauses the program. A stop during the pause resets the program: there is no
/// retract, and the Start key does not continue the motion.
#[test]
fn a_stop_while_the_program_is_paused_resets_it() {
    let mut rig = Rig::new(Clock::LockStep);
    rig.controller.select_mode(Mode::T1);
    rig.controller.set_start_key(true);
    rig.open();
    rig.prepare();
    rig.line(200, 60, true);
    rig.beats(5);
    rig.controller.set_start_key(false);
    rig.beats(2);
    let (at, executed) = (rig.tool_tip(), rig.ids().len());
    rig.ask(11, rig.epoch + 1);
    assert!(rig.flag(7) && !rig.flag(3) && !rig.flag(4));
    rig.controller.set_start_key(true);
    rig.beats(10);
    assert!(rig.tool_tip().distance_mm(at) < 1e-12 && rig.ids().len() == executed, "the key went on");
    assert!(rig.flag(4), "and the program runs again");
}

/// If no program is running, a command cannot be executed, and the epoch ends.
#[test]
fn without_a_program_a_command_ends_the_epoch() {
    let mut rig = Rig::new(Clock::LockStep);
    rig.controller.deselect_program();
    rig.open();
    rig.command(6, [1, 1], [0.0; 2], [0.0; 6]);
    rig.beat();
    assert!(rig.flag(7) && rig.wires.changes().is_empty());
    assert_eq!(rig.causes(), [StopCause::Deselected; 2]);
}

/// If the submit interpreter has not run for 400 ms, the robot program stops by itself and retracts from the panel.
#[test]
fn a_dead_submit_interpreter_stops_the_arm() {
    let mut rig = sanding(Clock::Free);
    let from_ms = rig.controller.time_ms();
    rig.controller.apply_fault(Fault::Stall { for_ms: Some(2_000) });
    rig.controller.advance_ms(1_500);
    let stop = rig.controller.program_stops()[0].clone();
    assert_eq!((stop.cause, stop.contact), (StopCause::SubmitDead, true));
    assert!(stop.time_ms <= from_ms + 412, "{stop:?}");
    assert!((rig.tool_tip().mm.z - (BASE_MM[2] + 50.0)).abs() < 1e-6 && !rig.tool_on());
}

/// The tool is on without contact and no command is queued: after 400 ms without a message the tool is still switched
/// off. A client that sends commands but no requests keeps it on for up to 3 s.
#[test]
fn the_watchdog_covers_a_running_tool() {
    let mut rig = Rig::ready(Clock::Free);
    rig.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0; 2], [0.0; 6]);
    rig.beat();
    assert!(rig.tool_on());
    rig.controller.advance_ms(420);
    assert_eq!((rig.causes(), rig.tool_on()), (vec![StopCause::Watchdog], false));
    let mut rig = Rig::ready(Clock::Free);
    rig.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0; 2], [0.0; 6]);
    for _ in 0..28 {
        rig.command(6, [1, 1], [0.0; 2], [0.0; 6]);
        rig.controller.advance_ms(100);
    }
    assert_eq!(rig.causes(), []);
    rig.controller.advance_ms(300);
    assert_eq!(rig.causes(), [StopCause::LinkLost], "a client that asks nothing for 3 s is none");
}

/// Each executed command is logged once, in order, up to the stop and during braking. Done reports the same number.
#[test]
fn done_counts_the_executed_commands() {
    let mut rig = sanding(Clock::Free);
    rig.controller.advance_ms(900);
    rig.beat();
    let ids = rig.ids();
    assert!(ids.windows(2).all(|pair| pair[1] == pair[0] + 1));
    assert_eq!(rig.state("Done"), *ids.last().expect("some"));
}

/// A person sets the override to 90 % during contact: the tool is switched off, the arm retracts, and the reason is
/// reported.
#[test]
fn a_changed_override_in_contact_retracts() {
    let mut rig = sanding(Clock::LockStep);
    rig.controller.apply_fault(Fault::Override { percent: 90, for_ms: None });
    rig.beat();
    assert_eq!((rig.causes(), rig.tool_on()), (vec![StopCause::Refused(Refusal::Override)], false));
    assert_eq!((rig.state("Ov"), rig.ack("Err")), (90, 11));
    assert_retracted(&mut rig);
}

/// At an override of 50 %, a path without contact runs at half of its speed, and a path with contact is refused.
#[test]
fn contact_at_another_override_is_refused() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.controller.apply_fault(Fault::Override { percent: 50, for_ms: None });
    rig.line(20, 5, false);
    rig.beats(3);
    assert_eq!(rig.causes(), []);
    rig.line(20, 5, true);
    rig.beat();
    assert_eq!((rig.causes(), rig.ack("Err")), (vec![StopCause::Refused(Refusal::Override)], 11));
}

/// The reported pose has an error while the arm moves to the commanded positions; the client must detect the
/// difference.
#[test]
fn a_measured_pose_with_a_deviation_is_reported() {
    let mut rig = sanding(Clock::LockStep);
    let z_mm = |rig: &Rig| {
        let tcp = &rig.states[rig.states.rfind("<Tcp ").expect("reported")..];
        last(&tcp[..tcp.find("/>").or(tcp.find('>')).expect("closed")], "Z").parse::<f64>().expect("a number")
    };
    let before_mm = z_mm(&rig);
    rig.controller.apply_fault(Fault::Measured { deviation_mm: 60, for_ms: None });
    rig.beat();
    // The arm itself moves at most 10 mm per heartbeat.
    assert!((45.0..75.0).contains(&(z_mm(&rig) - before_mm)), "{before_mm}");
    assert_eq!(rig.causes(), []);
}

const LIGHT: u16 = 1;
const SPRAY: u16 = 2;
const SHUTTER: u16 = 3;
const EXTRACTION: u16 = 4;
const ALL: [u16; 5] = [LIGHT, SPRAY, SHUTTER, EXTRACTION, TOOL_OUTPUT];

/// Creates a controller with every output on, an open epoch, no queued commands, and a client that sends messages.
fn all_on() -> Rig {
    let mut rig = Rig::ready(Clock::Free);
    for output in ALL {
        rig.command(6, [i32::from(output), 1], [0.0; 2], [0.0; 6]);
    }
    rig.beats(2);
    assert_eq!(on(&rig), ALL);
    rig
}

fn on(rig: &Rig) -> Vec<u16> {
    rig.controller.outputs().iter().filter(|(_, on)| **on).map(|(number, _)| *number).collect()
}

/// Sends a request, which is processed in the next ticks.
fn ask(rig: &mut Rig, operation: i32, number: i32) {
    rig.ask(operation, number);
    rig.controller.advance_ms(24);
    rig.listen();
}

#[test]
fn every_end_of_an_epoch_switches_outputs_off_in_time() {
    type End = fn(&mut Rig);
    let ends: [(&str, u64, End); 8] = [
        ("an abort", 24, |rig| rig.ask(11, 2)),
        ("a command channel that is cut", 24, |rig| rig.controller.disconnect(Channel::Command)),
        ("a state channel that is cut", 24, |rig| rig.controller.disconnect(Channel::State)),
        ("a cable that is pulled", 420, |rig| rig.controller.apply_fault(Fault::Unplug { for_ms: None })),
        ("a client that is silent", 420, |_| {}),
        ("an emergency stop", 24, |rig| rig.controller.press_e_stop()),
        ("a program that is deselected", 24, |rig| rig.controller.deselect_program()),
        ("a gap in the commands", 24, |rig| {
            rig.id += 1;
            rig.line(1, 1, false);
        }),
    ];
    for (name, at_once_ms, end) in ends {
        let mut rig = all_on();
        end(&mut rig);
        rig.controller.advance_ms(at_once_ms);
        assert_eq!(on(&rig), [LIGHT, SHUTTER, EXTRACTION], "{name}: tool and water go off at once");
        rig.controller.advance_ms(30_000 - at_once_ms - 24);
        assert_eq!(on(&rig), [LIGHT, SHUTTER, EXTRACTION], "{name}: the extraction runs on");
        rig.controller.advance_ms(24 + at_once_ms + 24);
        assert_eq!(on(&rig), [LIGHT, SHUTTER], "{name}: for its time");
        rig.controller.advance_ms(30_000);
        assert_eq!(on(&rig), [SHUTTER], "{name}");
    }
}

/// The submit interpreter counts the switch-off delays. If it does not run, the robot program switches all outputs off
/// immediately.
#[test]
fn a_dead_submit_interpreter_leaves_no_output_on() {
    let mut rig = all_on();
    rig.controller.apply_fault(Fault::Stall { for_ms: None });
    rig.controller.advance_ms(424);
    assert_eq!(on(&rig), [SHUTTER]);
}

/// The next epoch can set its outputs, and a second stop does not extend the delays of the first stop.
#[test]
fn an_open_epoch_keeps_its_outputs_and_a_second_stop_changes_nothing() {
    let mut rig = all_on();
    rig.ask(11, 2);
    (rig.epoch, rig.id) = (2, 0);
    rig.controller.advance_ms(20_000);
    rig.controller.connect(Channel::Command);
    rig.controller.connect(Channel::State);
    rig.ask(11, 2);
    rig.controller.advance_ms(10_024);
    assert_eq!(on(&rig), [LIGHT, SHUTTER]);
    let mut rig = all_on();
    rig.ask(11, 2);
    (rig.epoch, rig.id) = (2, 0);
    rig.open();
    rig.command(6, [i32::from(SPRAY), 1], [0.0; 2], [0.0; 6]);
    rig.beats(900);
    assert_eq!(on(&rig), [LIGHT, SPRAY, SHUTTER, EXTRACTION], "90 s in the next epoch");
}

/// Regression test: a single request with the maximum number once left no epoch numbers for further requests.
#[test]
fn no_request_exhausts_the_epoch_numbers() {
    for operation in [11, 12] {
        for number in [i32::MAX, i32::MAX - 1, 1_000_002, i32::MIN, -1, 0, 1] {
            let mut rig = all_on();
            ask(&mut rig, operation, number);
            assert_eq!(rig.state("Ep"), 1, "operation {operation}, number {number}");
            // An abort stops with any epoch number; a reset with an invalid number has no effect.
            assert_eq!((rig.flag(7), rig.tool_on()), (operation == 11, operation == 12));
            ask(&mut rig, 11, 2);
            assert_eq!((rig.state("Ep"), rig.flag(7), rig.tool_on()), (2, true, false));
            (rig.epoch, rig.id) = (2, 0);
            rig.open();
            rig.prepare();
            assert_eq!((rig.state("Ep"), rig.ack("Rx")), (3, 3));
        }
    }
    let mut rig = Rig::new(Clock::Free);
    ask(&mut rig, 12, 1_000_001);
    assert_eq!(rig.state("Ep"), 1_000_001, "a step is allowed");
}

/// If a heartbeat names a command that never arrives, it blocks the time in lock step, but not an abort that follows
/// it.
#[test]
fn an_abort_passes_a_heartbeat_that_waits_for_ever() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.line(60, 60, false);
    rig.beats(3);
    let states = rig.states.len();
    rig.ask(10, i32::MAX);
    assert_eq!(rig.states.len(), states, "it waits");
    rig.ask(11, 2);
    assert_eq!((rig.state("Ep"), rig.flag(7)), (2, true));
}
