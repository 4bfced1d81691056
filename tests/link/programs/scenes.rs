//! Short scenes with one fault each, whose messages are written directly to the channels, and the required reaction of
//! the programs.

use super::super::cell::{TOOL_OUTPUT, height_mm};
use super::raw::{Raw, started};
use panelprep::devices::mock::{Channel, Fault, Programs, RobotState};
use panelprep::krl::{Cell, UndocumentedBehaviour};

/// Number of runs of a path that ends in contact, each with another order of the interpreters.
const ORDER_COUNT: u64 = 150;

/// Minimum height above the panel at which a retract of 50 mm ends, mm.
const MIN_RETRACT_HEIGHT_MM: f64 = 40.0;
/// Number of aborts, each one tick later than the previous one.
const ABORT_COUNT: u64 = 80;

/// Number of the output that runs the tool in the shipped `cell_config.dat`.
const CONFIGURED_TOOL_OUTPUT: i32 = 21;

type Scene = fn(&Programs) -> bool;

/// The scenes; a scene passes if it returns true.
const SCENES: [(&str, Scene); 27] = [
    ("thirty commands at once are all executed", |programs| {
        let mut raw = Raw::opened(programs.clone());
        (0..30).for_each(|_| raw.command(6, [1, 0], [0.0, 0.0], [0.0; 6]));
        raw.run(1_000);
        raw.int("CELL_DONE") == 33
    }),
    ("a reset and a command behind it in the same moment", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.begin();
        raw.command(6, [1, 0], [0.0, 0.0], [0.0; 6]);
        raw.run(300);
        raw.int("CELL_DONE") == 1
    }),
    ("a command of an ended epoch is dropped", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.begin();
        raw.run(100);
        raw.stale();
        raw.run(100);
        raw.int("CELL_ERR") == 0 && raw.int("CELL_RX") == 0 && raw.is("CELL_OPEN")
    }),
    ("a speed above the robot's is refused", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.command(5, [50, 50], [2.5, 1.0], [0.0; 6]);
        raw.run(100);
        raw.int("CELL_ERR") == 5
    }),
    ("a line without a base is refused by the robot program", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.begin();
        raw.line(0, false, [0.0, 0.0, -10.0]);
        raw.run(200);
        raw.int("CELL_ERR") == 6
    }),
    ("one request does not use the epoch's number up", |programs| {
        let mut raw = Raw::opened(programs.clone());
        let before = raw.int("CELL_EP");
        raw.request(12, i32::MAX);
        raw.run(100);
        raw.int("CELL_EP") == before
    }),
    ("silence switches the tool off", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0, 0.0], [0.0; 6]);
        raw.run(200);
        raw.controller.advance_ms(700);
        raw.controller.outputs().get(&TOOL_OUTPUT) == Some(&false)
    }),
    ("an ended epoch keeps its count", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0, 0.0], [0.0; 6]);
        raw.run(200);
        let done = raw.int("CELL_DONE");
        // Silence ends the epoch; its number of executed commands is reported as long as it is the last epoch.
        raw.controller.advance_ms(1_200);
        done == 4 && !raw.is("CELL_OPEN") && raw.int("CELL_DONE") == done
    }),
    ("an emergency stop ends the path for good", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0, 0.0], [0.0; 6]);
        (0..40).for_each(|point| raw.line(39 - point, false, [6.0 * f64::from(point), 0.0, -20.0]));
        raw.run(400);
        raw.controller.press_e_stop();
        raw.run(100);
        let is_off = raw.controller.outputs().get(&TOOL_OUTPUT) == Some(&false);
        let executed = raw.controller.executed_motions().len();
        raw.controller.release_e_stop();
        raw.controller.switch_drives(true);
        raw.run(4_000);
        is_off && executed > 0 && raw.controller.executed_motions().len() == executed && !raw.is("CELL_OPEN")
    }),
    ("an epoch whose program is gone is over", |programs| {
        let mut raw = Raw::opened(programs.clone());
        (0..40).for_each(|point| raw.line(39 - point, false, [6.0 * f64::from(point), 0.0, -20.0]));
        raw.run(400);
        raw.controller.deselect_program();
        raw.run(200);
        !raw.is("CELL_OPEN") && raw.int("CELL_QR") == raw.int("CELL_QW")
    }),
    ("an epoch of before the program's start stays without motion", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.controller.deselect_program();
        raw.run(200);
        raw.begin();
        raw.run(100);
        raw.controller.select();
        raw.run(1_000);
        !raw.is("CELL_OPEN")
    }),
    ("an abort next to a contact retracts where a trigger is late", |programs| {
        (0..ABORT_COUNT).all(|tick| leaves_after_an_abort(programs, tick))
    }),
    ("in contact nothing waits long, whatever comes next", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.line(9, false, [0.0, 0.0, -10.0]);
        raw.line(8, true, [6.0, 0.0, 0.0]);
        (0..9).for_each(|_| raw.command(8, [0, 0], [0.0, 0.0], [0.0; 6]));
        raw.run(1_000);
        !raw.is("CELL_OPEN") && height_mm(&raw.controller) > 1.0
    }),
    ("both channels come back where a client vanished unseen", |programs| {
        let mut controller = started(programs.clone());
        for channel in [Channel::Command, Channel::State] {
            controller.connect(channel);
            controller.disconnect(channel);
        }
        controller.advance_ms(5_000);
        [Channel::Command, Channel::State].into_iter().all(|channel| controller.connect(channel))
    }),
    ("a channel that did not open is tried again soon", |programs| {
        let mut programs = programs.clone();
        programs.meaning =
            UndocumentedBehaviour { immediate_reopen_fails: true, ..UndocumentedBehaviour::default() };
        let mut raw = Raw::opened(programs);
        raw.controller.disconnect(Channel::Command);
        raw.run(300);
        raw.controller.connect(Channel::Command)
    }),
    ("an ended epoch leaves the whole ring free", |programs| reports_the_free_places_of_the_ring(programs)),
    ("a base that is reported as executed is reported as set", |programs| {
        (0..ORDER_COUNT).all(|seed| echoes_the_base(programs, seed))
    }),
    ("no path that ends in contact is left there", |programs| {
        (0..ORDER_COUNT).all(|seed| !is_left_in_contact(programs, seed))
    }),
    ("an epoch that replaces one in contact lifts the tool off", |programs| {
        let mut raw = Raw::opened(programs.clone());
        let begun = is_in_contact(&mut raw);
        raw.begin();
        raw.run(2_000);
        let tool_off = raw.controller.outputs().get(&TOOL_OUTPUT) == Some(&false);
        begun && tool_off && height_mm(&raw.controller) > MIN_RETRACT_HEIGHT_MM
    }),
    ("another program that was selected before the controller started is not reset", |programs| {
        // The first cycle of the submit interpreter follows immediately; if it came later, the watchdog's timer would
        // show that the interpreter was not running.
        let mut programs = programs.clone();
        programs.busy_submit = true;
        let mut raw = Raw::opened(programs);
        raw.controller.deselect_program();
        raw.controller.select_foreign_program();
        raw.controller.reboot(1_500);
        raw.controller.advance_ms(5_000);
        let is_at_work = raw.controller.robot_state() == Some(RobotState::Active);
        let connected = [Channel::Command, Channel::State].map(|channel| raw.controller.connect(channel));
        raw.controller.switch_drives(false);
        raw.run(300);
        raw.request(11, raw.int("CELL_EP") + 1);
        raw.run(300);
        raw.controller.switch_drives(true);
        raw.run(1_000);
        let stays = raw.controller.robot_state() == Some(RobotState::Stopped);
        is_at_work && connected == [true; 2] && stays && raw.controller.foreign_program_resets() == 0
    }),
    ("contact at another override is refused", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.controller.apply_fault(Fault::Override { percent: 50, for_ms: None });
        raw.line(1, false, [0.0, 0.0, -10.0]);
        raw.run(100);
        let in_air = raw.int("CELL_ERR");
        raw.line(0, true, [0.0, 0.0, 0.0]);
        raw.run(200);
        (in_air, raw.int("CELL_ERR")) == (0, 11)
    }),
    ("an override that is changed in contact leaves the panel", |programs| {
        let mut raw = Raw::opened(programs.clone());
        let begun = is_in_contact(&mut raw);
        raw.controller.apply_fault(Fault::Override { percent: 90, for_ms: None });
        raw.run(100);
        let tool_off = raw.controller.outputs().get(&TOOL_OUTPUT) == Some(&false);
        raw.run(2_000);
        begun && tool_off && raw.int("CELL_ERR") == 11 && height_mm(&raw.controller) > MIN_RETRACT_HEIGHT_MM
    }),
    ("a line that ends outside of the box is refused", |programs| {
        let mut raw = Raw::opened(with_shipped_limits(programs));
        raw.line(0, false, [0.0, 500.0, -10.0]);
        raw.run(300);
        raw.int("CELL_ERR") == 12 && raw.has_not_moved()
    }),
    ("a line in contact that is longer than a step is refused", |programs| {
        let mut raw = Raw::opened(with_shipped_limits(programs));
        raw.line(1, false, [-40.0, 0.0, -10.0]);
        raw.line(0, true, [110.0, 0.0, 0.0]);
        raw.run(1_500);
        raw.int("CELL_ERR") == 12
    }),
    ("a line in the air at another override is refused while the tool runs", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0, 0.0], [0.0; 6]);
        raw.run(100);
        let is_on = raw.controller.outputs().get(&TOOL_OUTPUT) == Some(&true);
        raw.controller.apply_fault(Fault::Override { percent: 50, for_ms: None });
        raw.line(0, false, [0.0, 0.0, -10.0]);
        raw.run(100);
        is_on && raw.int("CELL_ERR") == 11 && raw.controller.outputs().get(&TOOL_OUTPUT) == Some(&false)
    }),
    ("a line in the air that is longer than a step is refused while the tool runs", |programs| {
        let refusal = |runs: bool| {
            let mut raw = Raw::opened(with_shipped_limits(programs));
            if runs {
                raw.command(6, [CONFIGURED_TOOL_OUTPUT, 1], [0.0, 0.0], [0.0; 6]);
                raw.run(100);
            }
            raw.line(1, false, [-40.0, 0.0, -10.0]);
            raw.line(0, false, [110.0, 0.0, -10.0]);
            raw.run(1_500);
            raw.int("CELL_ERR")
        };
        (refusal(false), refusal(true)) == (0, 12)
    }),
    ("a line that is the first command beside a running tool stops no interpreter", |programs| {
        let mut raw = Raw::opened(programs.clone());
        raw.begin();
        raw.run(100);
        raw.controller.switch_output(TOOL_OUTPUT, true);
        raw.line(0, false, [0.0, 0.0, -10.0]);
        raw.run(200);
        raw.int("CELL_ERR") == 6
    }),
];

/// Starts a path in contact with the tool on, and runs it until ten commands are executed; returns whether they were
/// executed.
fn is_in_contact(raw: &mut Raw) -> bool {
    raw.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0, 0.0], [0.0; 6]);
    raw.line(30, false, [-40.0, 0.0, -10.0]);
    (0..30).for_each(|point| raw.line(29 - point, true, [3.0 * f64::from(point) - 37.0, 0.0, 0.0]));
    (0..200).any(|_| {
        raw.run(12);
        raw.int("CELL_DONE") >= 10
    })
}

/// Returns the programs with the limits of the shipped `cell_config.dat`, not those of a cell.
fn with_shipped_limits(programs: &Programs) -> Programs {
    let mut programs = programs.clone();
    programs.uses_config_io = true;
    programs
}

/// Sends an abort shortly before or after the landing, delayed by this number of ticks. Returns whether the tool is off
/// the panel at the end.
fn leaves_after_an_abort(programs: &Programs, tick: u64) -> bool {
    let mut programs = programs.clone();
    programs.meaning = UndocumentedBehaviour { late_triggers: true, ..UndocumentedBehaviour::default() };
    programs.seed = tick;
    let mut raw = Raw::opened(programs);
    raw.line(9, false, [-40.0, 0.0, -10.0]);
    (0..9).for_each(|point| raw.line(8 - point, true, [3.0 * f64::from(point) - 37.0, 0.0, 0.0]));
    while raw.controller.executed_motions().is_empty() {
        raw.run(12);
    }
    raw.run(12 * (tick % 8));
    raw.request(11, raw.controller.epoch() + 1);
    raw.run(1_000);
    height_mm(&raw.controller) > MIN_RETRACT_HEIGHT_MM
}

/// Sends more commands than the ring buffer holds, and then starts the robot program again. Returns whether the
/// acknowledgements report the true number of free places, because a client accepts no other number.
fn reports_the_free_places_of_the_ring(programs: &Programs) -> bool {
    let mut raw = Raw::opened(programs.clone());
    for _ in 0..12 {
        (0..10).for_each(|_| raw.command(6, [1, 0], [0.0, 0.0], [0.0; 6]));
        raw.run(300);
    }
    let received = raw.int("CELL_RX");
    raw.controller.deselect_program();
    raw.run(100);
    raw.controller.select();
    raw.run(600);
    let mut told = String::new();
    for _ in 0..60 {
        raw.controller.advance_ms(12);
        raw.request(10, 0);
        raw.controller.take_output_bytes(Channel::State);
        told.push_str(&String::from_utf8_lossy(&raw.controller.take_output_bytes(Channel::Command)));
    }
    received > 110 && told.contains("Free=\"100\"") && !told.contains("Free=\"-")
}

/// Returns whether each state that counts the command for the base as executed reports a base, with this order of the
/// interpreters.
fn echoes_the_base(programs: &Programs, seed: u64) -> bool {
    let mut programs = programs.clone();
    (programs.seed, programs.is_adverse_scheduling) = (seed, true);
    let mut raw = Raw::opened(programs);
    raw.begin();
    raw.run(60);
    raw.command(3, [0, 0], [0.0, 0.0], [390.0, 0.0, 530.0, 180.0, 0.0, 180.0]);
    let mut told = String::new();
    for _ in 0..10 {
        (0..6).for_each(|_| raw.request(9, 0));
        raw.controller.advance_ms(12);
        told.push_str(&String::from_utf8_lossy(&raw.controller.take_output_bytes(Channel::State)));
    }
    let number =
        |state: &str, name: &str| -> Option<i32> { state.split_once(name)?.1.split('"').next()?.parse().ok() };
    let begun = format!("Ep=\"{}\"", raw.controller.epoch());
    let is_right = |state: &str| match (number(state, " Flags=\""), number(state, " Done=\"")) {
        (Some(flags), Some(done)) => done < 1 || flags & 32 != 0 || !state.contains(&begun),
        _ => true,
    };
    told.split("<St ").all(is_right)
}

/// Returns the name of the first scene that fails.
pub fn first_wrong(programs: &Programs) -> Option<&'static str> {
    SCENES.iter().find(|(_, scene)| !scene(programs)).map(|(name, _)| *name)
}

/// Runs a path that ends in contact and is stopped by the programs. Returns whether the arm stays on the panel with
/// this order of the interpreters.
pub fn is_left_in_contact(programs: &Programs, seed: u64) -> bool {
    let mut programs = programs.clone();
    (programs.seed, programs.is_adverse_scheduling) = (seed, true);
    let mut raw = Raw::opened(programs);
    raw.line(4, false, [0.0, 0.0, -10.0]);
    for point in 0..4 {
        raw.line(3 - point, true, [6.0 * f64::from(point), 0.0, 0.0]);
    }
    raw.run(3_000);
    height_mm(&raw.controller) < 1.0
}

impl Raw {
    /// Opens a new epoch, without base and tool.
    fn begin(&mut self) {
        let next = self.controller.epoch() + 1;
        self.request(12, next);
        self.count_from(next);
    }

    /// Sends a command of the previous epoch.
    fn stale(&mut self) {
        let epoch = self.controller.epoch();
        self.count_from(epoch - 1);
        self.command(6, [1, 0], [0.0, 0.0], [0.0; 6]);
        self.count_from(epoch);
    }

    fn is(&self, name: &str) -> bool {
        self.controller.shared(name) == Some(Cell::Bool(true))
    }
}

/// Two faults that walks on both controllers have detected: each scene fails if only its fix is undone.
#[test]
fn scenes_fail_if_a_repair_is_undone() {
    let undone = [
        (
            "an ended epoch leaves the whole ring free",
            "  IF (NOT CELL_OPEN) OR (FREE<0) THEN\n    FREE=CELL_RING_N\n  ENDIF\n",
            "",
        ),
        (
            "a base that is reported as executed is reported as set",
            "\"St/@Done\",DONE)",
            "\"St/@Done\",CELL_DONE_NOW( ))",
        ),
    ];
    for (name, ships, before) in undone {
        let mut texts = super::texts("config/kuka");
        let (_, text) = texts.iter_mut().find(|(file, _)| file == "cell_tell.src").expect("a file");
        assert_eq!(text.matches(ships).count(), 1, "{name}");
        *text = text.replace(ships, before);
        assert_eq!(first_wrong(&super::load(&texts)), Some(name));
    }
}

/// The PC computes the checksum from the files, and the controller from its loaded values. Both are equal for the
/// shipped files and for edited ones.
#[test]
fn the_checksum_of_the_files_is_that_of_the_loaded_programs() {
    for (from, to) in [("CELL_OUT[1]=17", "CELL_OUT[1]=17"), ("CELL_OFF_MS[1]=60000", "CELL_OFF_MS[1]=61000")] {
        let mut texts = super::texts("config/kuka");
        texts[0].1 = texts[0].1.replacen(from, to, 1);
        let files: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
        let computed = panelprep::controller::program_sum(&files).expect("all files");
        let controller = started(with_shipped_limits(&super::load(&texts)));
        assert_eq!(controller.shared("CELL_SUM"), Some(Cell::Int(computed)), "{to}");
    }
}

#[test]
fn every_scene_passes_with_the_shipped_programs() {
    let programs = super::load(&super::texts("config/kuka"));
    assert_eq!(first_wrong(&programs), None);
}
