//! The programs of one controller while they run.

use super::super::log::StopCause;
use super::super::setup::Setup;
use super::held::HeldDocuments;
use super::programs::Programs;
use super::values::ControllerValues;
use panelprep_kuka::krl::{Cell, Interpreter, Memory};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::collections::VecDeque;

/// The programs of one controller while they run.
pub(in super::super) struct RunningPrograms {
    pub(super) programs: Programs,
    pub(super) memory: Memory,
    pub(super) robot: Interpreter,
    pub(super) submit: Interpreter,
    pub(super) values: ControllerValues,
    pub(super) cells: SharedCells,
    pub(super) random: Pcg64,
    /// The scheduler's present bias towards one of the interpreters; the next field is the time at which it ends.
    pub(super) scheduler_bias: SchedulerBias,
    pub(super) bias_until_ms: u64,
    /// The time at which the submit interpreter begins.
    pub(super) boots_at_ms: u64,
    pub(super) initialised: bool,
    /// The numbers of the motions that the mover has, oldest first.
    pub(super) sequences: VecDeque<u64>,
    pub(super) next_sequence: u64,
    /// Triggers that are due: the number of the motion, and the time at which the trigger becomes due.
    pub(super) due_triggers: VecDeque<(u64, u64)>,
    /// Errors that stopped an interpreter although no stop was intended.
    pub(super) faults: Vec<String>,
    pub(super) was_open: bool,
    /// The last stop of the arm by the safety controller or a person: its time and cause.
    pub(super) last_stop: Option<(u64, StopCause)>,
    pub(super) reset_since_ms: Option<u64>,
    /// The time at which a program that the safety controller stops is reported as stopped.
    pub(super) stops_at_ms: Option<u64>,
    /// The time at which the foreign program that a person selects begins.
    pub(super) foreign_at_ms: Option<u64>,
    /// In lock step, the documents that have arrived and are not yet handed over.
    pub(super) held_documents: HeldDocuments,
}

/// Shared variables that are read from outside the programs.
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
    /// Variables for the motions that the robot program has planned: the next motion to be executed. The next
    /// fields are the next motion to be planned, and whether each motion ends in contact.
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

    /// Starts the controller again: interpreters, flags and channels are new; the data lists keep their values over
    /// a warm start.
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

/// Limits that fit any cell; the shipped file has the limits of one cell.
const WIDE_LIMITS: [(&str, usize, f32); 4] = [
    ("CELL_BOX_MIN", 3, -10_000.0),
    ("CELL_BOX_MAX", 3, 10_000.0),
    ("CELL_STEP_MM", 1, 2_000.0),
    ("CELL_VEL_MAX", 1, 2.0),
];

/// Sets the inputs and outputs of `cell_config.dat` to those of this controller; the user's own `cell_config.dat`
/// is kept.
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

/// The scheduler's bias towards one of the interpreters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SchedulerBias {
    Fair,
    StarvesSubmit,
    StarvesRobot,
}
