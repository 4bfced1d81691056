//! The state of the executed programs of one controller: the interpreters, the values of the system variables, and, in
//! lock step, the documents that have arrived and are held back.

use super::super::channel_file::EkiFault;
use super::super::codec::{Value, decode};
use super::super::framer::Framer;
use super::super::log::StopCause;
use super::super::setup::{Programs, Setup};
use super::super::wire::Channel;
use panelprep_base::geometry::{Joints, KukaPose};
use panelprep_kuka::krl::{Cell, Interpreter, Memory};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::collections::VecDeque;

/// Limits in `cell_config.dat` that are wide enough for any cell; the shipped file has the limits of one cell.
const WIDE_LIMITS: [(&str, usize, f32); 4] = [
    ("CELL_BOX_MIN", 3, -10_000.0),
    ("CELL_BOX_MAX", 3, 10_000.0),
    ("CELL_STEP_MM", 1, 2_000.0),
    ("CELL_VEL_MAX", 1, 2.0),
];

/// The executed programs of one controller, and their state.
pub(in super::super) struct RunningPrograms {
    pub(super) programs: Programs,
    pub(super) memory: Memory,
    pub(super) robot: Interpreter,
    pub(super) submit: Interpreter,
    pub(super) values: ControllerValues,
    pub(super) cells: SharedCells,
    pub(super) random: Pcg64,
    /// The interpreter that the scheduler prefers at present; the next field is the time at which this ends.
    pub(super) scheduler_bias: SchedulerBias,
    pub(super) bias_until_ms: u64,
    /// The time at which the submit interpreter starts.
    pub(super) boots_at_ms: u64,
    pub(super) initialised: bool,
    /// The sequence numbers of the planned motions, oldest first.
    pub(super) sequences: VecDeque<u64>,
    pub(super) next_sequence: u64,
    /// The triggers that will fire: the sequence number of the motion, and the time at which its trigger is due.
    pub(super) due_triggers: VecDeque<(u64, u64)>,
    /// The error messages of interpreters that stopped unexpectedly.
    pub(super) faults: Vec<String>,
    pub(super) was_open: bool,
    /// The time and cause of the last stop of the arm by the safety controller or a person.
    pub(super) last_stop: Option<(u64, StopCause)>,
    pub(super) reset_since_ms: Option<u64>,
    /// The time at which a program that the safety controller stops is reported as stopped.
    pub(super) stops_at_ms: Option<u64>,
    /// The time at which another program starts that a person has selected.
    pub(super) foreign_at_ms: Option<u64>,
    /// In lock step: the documents that have arrived and are held back.
    pub(super) held_documents: HeldDocuments,
}

/// The memory cells of shared variables that are read from outside of the programs.
#[derive(Debug, Clone, Copy)]
pub(super) struct SharedCells {
    pub(super) epoch: Option<u32>,
    pub(super) open: Option<u32>,
    pub(super) stopped: Option<u32>,
    pub(super) received: Option<u32>,
    pub(super) done: Option<u32>,
    pub(super) run_epoch: Option<u32>,
    pub(super) dead_epoch: Option<u32>,
    pub(super) behind: Option<u32>,
    pub(super) retract: Option<u32>,
    /// Variables of the motions that the robot program has planned: the next motion to be executed, the next motion to
    /// be planned, and whether each motion ends in contact.
    pub(super) queue_read: Option<u32>,
    pub(super) queue_write: Option<u32>,
    pub(super) queue_touch: Option<u32>,
    pub(super) queue_places: Option<u32>,
    pub(super) under_air: Option<u32>,
    pub(super) under_touch: Option<u32>,
    pub(super) sequence: Option<u32>,
}

impl RunningPrograms {
    pub(in super::super) fn new(programs: Programs, setup: &Setup) -> Self {
        let program = programs.program.clone();
        let mut memory = Memory::new(&program);
        configure(&mut memory, &programs, setup);
        let cell = |name: &str| program.cell(name);
        let cells = SharedCells {
            epoch: cell("CELL_EP"),
            open: cell("CELL_OPEN"),
            stopped: cell("CELL_STOPPED"),
            received: cell("CELL_RX"),
            done: cell("CELL_DONE"),
            run_epoch: cell("CELL_RUN_EP"),
            dead_epoch: cell("CELL_DEAD_EP"),
            behind: cell("CELL_BEHIND"),
            retract: cell("CELL_RETRACT"),
            queue_read: cell("CELL_QR"),
            queue_write: cell("CELL_QW"),
            queue_touch: cell("CELL_Q_TOUCH"),
            queue_places: cell("CELL_Q_N"),
            under_air: cell("CELL_UNDER_AIR"),
            under_touch: cell("CELL_UNDER_TOUCH"),
            sequence: cell("CELL_SEQ"),
        };
        RunningPrograms {
            robot: Interpreter::new(programs.meaning, true),
            submit: Interpreter::new(programs.meaning, false),
            values: ControllerValues::new(setup),
            memory,
            cells,
            random: Pcg64::seed_from_u64(programs.seed),
            scheduler_bias: SchedulerBias::Fair,
            bias_until_ms: 0,
            boots_at_ms: 0,
            initialised: false,
            sequences: VecDeque::new(),
            next_sequence: 1,
            due_triggers: VecDeque::new(),
            faults: Vec::new(),
            was_open: false,
            last_stop: None,
            reset_since_ms: None,
            stops_at_ms: None,
            foreign_at_ms: None,
            held_documents: HeldDocuments::new(setup),
            programs,
        }
    }

    /// Restarts the controller: interpreters, flags and channels are reset. On a warm start the data lists keep their
    /// values.
    pub(super) fn reboot(&mut self, at_ms: u64, setup: &Setup) {
        if self.programs.cold_start {
            let (hits, branches) = (self.memory.hits.clone(), self.memory.branches.clone());
            self.memory = Memory { hits, branches, ..Memory::new(&self.programs.program) };
            configure(&mut self.memory, &self.programs, setup);
        }
        self.robot.clear();
        self.submit.clear();
        self.values = ControllerValues::new(setup);
        self.sequences.clear();
        self.due_triggers.clear();
        (self.boots_at_ms, self.initialised) = (at_ms, false);
    }
}

/// Sets the inputs and outputs of the shipped `cell_config.dat` to those of this controller. A user's own
/// `cell_config.dat` is not changed.
fn configure(memory: &mut Memory, programs: &Programs, setup: &Setup) {
    let program = &programs.program;
    let mut set = |name: &str, index: usize, value: i32| {
        let cell = program.cell(name).and_then(|cell| memory.cells.get_mut(cell as usize + index));
        if let Some(cell) = cell {
            *cell = Cell::Int(value);
        }
    };
    let count = |list: usize| i32::try_from(list).unwrap_or(i32::MAX);
    set("CELL_SEQ", 0, setup.first_state);
    if programs.uses_config_io {
        return;
    }
    for (name, places, value) in WIDE_LIMITS {
        for index in 0..places {
            let cell = program.cell(name).and_then(|cell| memory.cells.get_mut(cell as usize + index));
            cell.into_iter().for_each(|cell| *cell = Cell::Real(value));
        }
    }
    let mut set = |name: &str, index: usize, value: i32| {
        let cell = program.cell(name).and_then(|cell| memory.cells.get_mut(cell as usize + index));
        if let Some(cell) = cell {
            *cell = Cell::Int(value);
        }
    };
    set("CELL_OFF_N", 0, count(setup.off_delays_ms.len().min(31)));
    for (index, (number, after_ms)) in setup.off_delays_ms.iter().take(31).enumerate() {
        set("CELL_OFF", index, i32::from(*number));
        set("CELL_OFF_MS", index, i32::try_from(*after_ms).unwrap_or(i32::MAX));
    }
    for (size, list, numbers) in
        [("CELL_OUT_N", "CELL_OUT", &setup.outputs), ("CELL_IN_N", "CELL_IN", &setup.inputs)]
    {
        set(size, 0, count(numbers.len().min(31)));
        for (index, number) in numbers.iter().take(31).enumerate() {
            set(list, index, i32::from(*number));
        }
    }
    for (index, number) in setup.line_outputs.iter().enumerate() {
        set("CELL_LINE", index, i32::from(*number));
    }
    set("CELL_VIN_N", 0, count(setup.mapped_inputs.len().min(8)));
    for (index, (input, flag)) in setup.mapped_inputs.iter().take(8).enumerate() {
        set("CELL_VIN", index, i32::from(*input));
        set("CELL_VIN_FLAG", index, i32::from(*flag));
    }
}

/// The interpreter that the scheduler prefers, if any.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SchedulerBias {
    Fair,
    StarvesSubmit,
    StarvesRobot,
}

/// A received document and the fields in it; `None` for a field that the document does not contain.
#[derive(Debug)]
pub(super) struct Document {
    pub(super) bytes: Vec<u8>,
    pub(super) epoch: Option<i32>,
    pub(super) id: Option<i32>,
    pub(super) operation: Option<i32>,
    pub(super) number: Option<i32>,
}

/// The received documents that are held back until the programs are permitted to read them.
#[derive(Debug)]
pub(super) struct HeldDocuments {
    pub(super) framers: [Framer; 2],
    pub(super) commands: VecDeque<Document>,
    pub(super) requests: VecDeque<Document>,
    /// The epoch and the id of the last command that arrived.
    pub(super) arrived: (i32, i32),
    /// Whether commands that a heartbeat names may still arrive; false if their channel was lost.
    pub(super) awaits_commands: bool,
    /// Whether a request is being processed.
    pub(super) is_serving: bool,
}

impl HeldDocuments {
    pub(super) fn new(setup: &Setup) -> Self {
        HeldDocuments {
            framers: [&setup.commands, &setup.states].map(|file| Framer::new(file.limit_bytes)),
            commands: VecDeque::new(),
            requests: VecDeque::new(),
            arrived: (0, 0),
            awaits_commands: true,
            is_serving: false,
        }
    }

    pub(super) fn queue_mut(&mut self, channel: Channel) -> &mut VecDeque<Document> {
        match channel {
            Channel::Command => &mut self.commands,
            Channel::State => &mut self.requests,
        }
    }

    pub(super) fn is_delivered(&self, heartbeat: &Document, epoch: i32) -> bool {
        let (Some(of), Some(last)) = (heartbeat.epoch, heartbeat.number) else { return true };
        last <= 0 || !self.awaits_commands || of < epoch || self.arrived >= (of, last)
    }

    /// Removes and returns the commands up to the one that a heartbeat names.
    pub(super) fn take_up_to(&mut self, heartbeat: &Document) -> Vec<Document> {
        let named = heartbeat.epoch.zip(heartbeat.number);
        let is_later = |command: &Document| match (command.epoch.zip(command.id), named) {
            (Some(key), Some(named)) => key > named,
            _ => false,
        };
        let count = self.commands.iter().position(is_later).unwrap_or(self.commands.len());
        self.commands.drain(..count).collect()
    }
}

impl Document {
    pub(super) fn new(bytes: Vec<u8>, elements: &[super::super::channel_file::Element]) -> Self {
        let arrived: Result<_, EkiFault> = decode(elements, &bytes);
        let arrived = arrived.unwrap_or_default();
        let int = |ending: &str| {
            arrived.iter().find_map(|arrival| {
                match (&arrival.value, elements[arrival.element].tag.ends_with(ending)) {
                    (Some(Value::Int(number)), true) => Some(*number),
                    _ => None,
                }
            })
        };
        Document { epoch: int("/@Ep"), id: int("/@Id"), operation: int("/@Op"), number: int("/@N1"), bytes }
    }
}

/// A timer variable of the controller, which counts milliseconds.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Timer {
    pub(super) value: i64,
    pub(super) set_ms: u64,
    pub(super) runs: bool,
}

impl Timer {
    pub(super) fn value(&self, now_ms: u64) -> i64 {
        if self.runs { self.value + (now_ms - self.set_ms) as i64 } else { self.value }
    }
}

/// A frame variable that a program assigns component by component.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct WrittenFrame {
    pub(super) now: Option<[f32; 6]>,
    pub(super) parts: [f32; 6],
}

/// The values on which $POS_ACT depends, as the key of a cached value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PoseInputs {
    pub(super) joints: Joints,
    pub(super) base: Option<[f32; 6]>,
    pub(super) tool: Option<[f32; 6]>,
}

/// The state of a channel for the program.
#[derive(Debug, Clone, Default)]
pub(super) struct ChannelState {
    pub(super) initialised: bool,
    pub(super) listens: bool,
    pub(super) cleared_ms: u64,
    pub(super) set: Vec<super::super::codec::Value>,
    /// The index after the element that was set last.
    pub(super) set_next: usize,
}

/// The values of the controller that are not in data lists.
#[derive(Debug, Clone)]
pub(in super::super) struct ControllerValues {
    pub(super) state: RobotState,
    pub(super) stop_message: bool,
    pub(super) advance: i32,
    pub(super) base: WrittenFrame,
    pub(super) tool: WrittenFrame,
    /// $VEL.CP, $ACC.CP, $APO.CDIS.
    pub(super) velocity: f32,
    pub(super) acceleration: f32,
    pub(super) distance: f32,
    pub(super) axis_velocity: [i32; 6],
    pub(super) axis_acceleration: [i32; 6],
    pub(super) timers: [Timer; 65],
    pub(super) words: [u16; 2],
    /// Values of system variables that a program writes and that have no effect in this model.
    pub(super) others: std::collections::BTreeMap<(u16, u32), Cell>,
    pub(super) channels: [ChannelState; 2],
    /// The time until which EKI_Init and EKI_Open fail.
    pub(super) channels_fail_until_ms: u64,
    /// Whether the condition of an interrupt may have changed.
    pub(super) changed: bool,
    /// Whether an approximated motion from standstill may start without a next motion.
    pub(super) released: bool,
    /// The reason why the arm abandoned the last motion.
    pub(super) abandon_reason: Option<String>,
    /// Whether the next motion will be abandoned.
    pub(super) abandons_next_motion: bool,
    pub(super) reset_asked: bool,
    /// The value of `$ROB_TIMER` at the start of the controller.
    pub(super) uptime_ms: u64,
    /// The last value of $POS_ACT, and the values from which it was calculated.
    pub(super) pose: Option<(PoseInputs, [f64; 6])>,
}

impl ControllerValues {
    pub(super) fn new(setup: &Setup) -> Self {
        let channel = |elements: usize| ChannelState {
            set: vec![super::super::codec::Value::Unset; elements],
            ..ChannelState::default()
        };
        ControllerValues {
            state: RobotState::Reset,
            stop_message: false,
            advance: 3,
            base: WrittenFrame::default(),
            tool: WrittenFrame::default(),
            velocity: 0.1,
            acceleration: 1.0,
            distance: 0.0,
            axis_velocity: [100; 6],
            axis_acceleration: [100; 6],
            timers: [Timer::default(); 65],
            words: [0; 2],
            others: std::collections::BTreeMap::new(),
            channels: [channel(setup.commands.sent.len()), channel(setup.states.sent.len())],
            channels_fail_until_ms: 0,
            changed: true,
            released: false,
            abandon_reason: None,
            abandons_next_motion: false,
            reset_asked: false,
            uptime_ms: setup.programs.as_ref().map_or(0, |programs| programs.uptime_ms),
            pose: None,
        }
    }

    pub(super) fn init_motion(&mut self) {
        (self.velocity, self.acceleration, self.advance) = (0.1, 1.0, 3);
        (self.axis_velocity, self.axis_acceleration) = ([100; 6], [100; 6]);
    }

    /// Returns whether the pose of the TCP is known: a program must have set base and tool.
    pub(super) fn knows_tcp(&self) -> bool {
        let has_program = matches!(self.state, RobotState::Active | RobotState::Stopped | RobotState::Ended);
        has_program && self.base.now.is_some() && self.tool.now.is_some()
    }
}

/// Converts the six numbers of a frame to a pose.
pub(super) fn frame(numbers: [f32; 6]) -> KukaPose {
    let [x_mm, y_mm, z_mm, a_deg, b_deg, c_deg] = numbers.map(f64::from);
    KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg }
}

/// `$PRO_STATE1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotState {
    /// No program is selected.
    Free,
    /// The program is selected and is at its first line.
    Reset,
    /// The program runs.
    Active,
    /// The program was stopped; the Start key continues it.
    Stopped,
    /// The program has reached its end.
    Ended,
}
