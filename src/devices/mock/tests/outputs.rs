//! What the end of an epoch switches off and when, and how far one request can raise the epoch count.

use super::*;

const LIGHT: u16 = 1;
const SPRAY: u16 = 2;
const SHUTTER: u16 = 3;
const EXTRACTION: u16 = 4;
const ALL: [u16; 5] = [LIGHT, SPRAY, SHUTTER, EXTRACTION, TOOL_OUTPUT];

/// Creates a rig with every output on, an open epoch, nothing queued and a client that is not silent.
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

/// Sends a request, which is served in the next ticks.
fn ask(rig: &mut Rig, operation: i32, number: i32) {
    rig.ask(operation, number);
    rig.controller.advance_ms(24);
    rig.listen();
}

#[test]
fn every_end_of_an_epoch_switches_its_outputs_off_in_time() {
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

/// The submit interpreter counts the delays; if it is dead, the robot program switches all outputs off at once.
#[test]
fn a_dead_submit_interpreter_leaves_nothing_on() {
    let mut rig = all_on();
    rig.controller.apply_fault(Fault::Stall { for_ms: None });
    rig.controller.advance_ms(424);
    assert_eq!(on(&rig), [SHUTTER]);
}

/// The next epoch sets its outputs freely; a second stop does not lengthen the times of the first stop.
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

/// In an earlier version, a single request with the highest number left no numbers for further requests.
#[test]
fn no_request_uses_the_count_up() {
    for operation in [11, 12] {
        for number in [i32::MAX, i32::MAX - 1, 1_000_002, i32::MIN, -1, 0, 1] {
            let mut rig = all_on();
            ask(&mut rig, operation, number);
            assert_eq!(rig.state("Ep"), 1, "operation {operation}, number {number}");
            // An abort stops with any number; a reset with a number that is not allowed has no effect.
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

/// A heartbeat that names a command that never arrives blocks lock step; an abort behind the heartbeat is not
/// blocked.
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
