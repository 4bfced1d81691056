//! The controller's programs as they ship, executed: two interpreters, EthernetKRL, the states of the robot program.
//!
//! Replaces the hand-written model of `submit`, `program` and `answer` where [`Setup::programs`] names programs; the arm,
//! people's doings, faults and channels' bytes are the same. In each tick a seeded scheduler gives statements to the two
//! interpreters in turns of any length, and starves one of them now and then: any order that a controller could choose
//! must be good.
//!
//! - `values` (system variables), `around` (what a program touches), `ethernet` (the EKI functions)
//! - `states` (selected, started, stopped, reset), `schedule` (one tick), `lock_step` (what lets time pass), `seen` (what
//!   tests look at)
//!
//! Not modelled: motions inside of interrupt programs, going on with a braked motion, triggers other than at a motion's
//! end, HALT.
//!
//! [`Setup::programs`]: super::Setup

mod around;
mod ethernet;
mod lock_step;
mod schedule;
mod seen;
mod states;
mod values;

pub use states::RobotState;

use super::error::MockError;
use super::setup::{CHECKSUM, Setup};
use crate::krl::{Cell, Interpreter, Kss, Meaning, Memory, Program, analyse, parse};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::collections::VecDeque;
use std::sync::Arc;
use values::Values;

/// Programs that a mock controller executes, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Programs {
    program: Arc<Program>,
    /// What public documents leave open.
    pub meaning: Meaning,
    /// Of the scheduler.
    pub seed: u64,
    /// The scheduler chooses turns of any length; else each interpreter runs until it waits.
    pub adverse: bool,
    /// A start of the controller begins with the values of the data lists; else with those of its end.
    pub cold_start: bool,
    /// What `$ROB_TIMER` counts at the start, ms.
    pub uptime_ms: u64,
    /// The submit interpreter begins its next cycle at once where one ends without waiting; else with the next tick.
    pub busy_submit: bool,
    /// Told in place of the checksum that the programs make, so that no client takes a mock controller for a real one.
    pub checksum: Option<i32>,
}

/// Programs and data lists as they ship.
const SHIPPED: [(&str, &str); 8] = [
    ("cell_config.dat", include_str!("../../../../config/kuka/cell_config.dat")),
    ("cell_data.dat", include_str!("../../../../config/kuka/cell_data.dat")),
    ("cell_judge.src", include_str!("../../../../config/kuka/cell_judge.src")),
    ("cell_link.src", include_str!("../../../../config/kuka/cell_link.src")),
    ("cell_motion.src", include_str!("../../../../config/kuka/cell_motion.src")),
    ("cell_submit.src", include_str!("../../../../config/kuka/cell_submit.src")),
    ("cell_tell.src", include_str!("../../../../config/kuka/cell_tell.src")),
    ("cell_user.src", include_str!("../../../../config/kuka/cell_user.src")),
];

impl Programs {
    /// Reads programs and data lists, each a name and a text.
    ///
    /// # Errors
    /// Where a file is not right, with file and line.
    pub fn load(files: &[(&str, &str)]) -> Result<Self, MockError> {
        let (read, told): (Vec<_>, Vec<_>) = files.iter().map(|(name, text)| parse(name, text)).unzip();
        // The versions of KSS differ in what they lack; a program that asks for it is told so by `panelprep check`.
        let analysis = analyse(&read, Kss { major: 8, minor: 7 });
        let all = told.into_iter().zip(analysis.problems).zip(analysis.warnings);
        for ((name, _), ((told, problems), warnings)) in files.iter().zip(all) {
            if let Some(problem) = told.iter().chain(&problems).chain(&warnings).next() {
                let message = format!("{name}:{}: {}: {}", problem.line, problem.key, problem.message);
                return Err(MockError::Program(message));
            }
        }
        for name in ["CELL_INIT", "CELL_CYCLE", "CELL_MOTION"] {
            if analysis.program.routine(name).is_none() {
                return Err(MockError::Program(format!("the programs define no {name}")));
            }
        }
        let program = Arc::new(analysis.program);
        Ok(Programs {
            program,
            meaning: Meaning::default(),
            seed: 0,
            adverse: false,
            cold_start: false,
            uptime_ms: 0,
            busy_submit: false,
            checksum: None,
        })
    }

    /// The programs that ship, as a mock controller executes them: told by its own checksum.
    ///
    /// # Errors
    /// Never for the files that this program was built with; they are read as every other.
    pub fn shipped() -> Result<Self, MockError> {
        Ok(Programs { checksum: Some(CHECKSUM), ..Programs::load(&SHIPPED)? })
    }

    /// The program, for what a test says of its statements.
    pub fn program(&self) -> &Program {
        &self.program
    }
}

/// The programs of one controller while they run.
pub(super) struct Running {
    pub(super) programs: Programs,
    pub(super) memory: Memory,
    robot: Interpreter,
    submit: Interpreter,
    pub(super) values: Values,
    cells: Cells,
    draw: Pcg64,
    /// What the scheduler does to the interpreters at present, and until when.
    mood: schedule::Mood,
    mood_until_ms: u64,
    /// The submit interpreter has not begun yet.
    boots_at_ms: u64,
    initialised: bool,
    /// The motions that the mover has, oldest first, by number.
    sequences: VecDeque<u64>,
    next_sequence: u64,
    /// Triggers that are due: number of the motion, and from when.
    fired: VecDeque<(u64, u64)>,
    /// What stopped an interpreter that nobody wanted to stop.
    pub(super) faults: Vec<String>,
    was_open: bool,
    /// Why the safety controller or a person stopped the arm last.
    pub(super) pressed: Option<(u64, super::log::StopCause)>,
    reset_since_ms: Option<u64>,
    /// When a program that the safety controller stops is told as stopped.
    stops_at_ms: Option<u64>,
    /// When the foreign program that a person selects begins.
    foreign_at_ms: Option<u64>,
    /// In lock step, what has arrived and is not yet handed over.
    held: lock_step::Held,
}

/// Shared variables that are looked at from outside.
#[derive(Debug, Clone, Copy)]
struct Cells {
    epoch: Option<u32>,
    open: Option<u32>,
    stopped: Option<u32>,
    received: Option<u32>,
    done: Option<u32>,
    run_epoch: Option<u32>,
    dead_epoch: Option<u32>,
    behind: Option<u32>,
    retract: Option<u32>,
    /// Of the motions that the robot program has planned: the next to be executed, the next to be planned, and whether
    /// each ends in contact.
    queue_read: Option<u32>,
    queue_write: Option<u32>,
    queue_touch: Option<u32>,
    queue_places: Option<u32>,
    under_air: Option<u32>,
    under_touch: Option<u32>,
    sequence: Option<u32>,
}

impl Running {
    pub(super) fn new(programs: Programs, setup: &Setup) -> Self {
        let program = programs.program.clone();
        let mut memory = Memory::new(&program);
        configure(&mut memory, &program, setup);
        let cell = |name: &str| program.cell(name);
        let cells = Cells {
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
        Running {
            robot: Interpreter::new(programs.meaning, true),
            submit: Interpreter::new(programs.meaning, false),
            values: Values::new(setup),
            memory,
            cells,
            draw: Pcg64::seed_from_u64(programs.seed),
            mood: schedule::Mood::Fair,
            mood_until_ms: 0,
            boots_at_ms: 0,
            initialised: false,
            sequences: VecDeque::new(),
            next_sequence: 1,
            fired: VecDeque::new(),
            faults: Vec::new(),
            was_open: false,
            pressed: None,
            reset_since_ms: None,
            stops_at_ms: None,
            foreign_at_ms: None,
            held: lock_step::Held::new(setup),
            programs,
        }
    }

    /// The controller starts again: interpreters, flags and channels are as new; data lists keep their values over a
    /// warm start.
    fn reboot(&mut self, at_ms: u64, setup: &Setup) {
        if self.programs.cold_start {
            let (hits, branches) = (self.memory.hits.clone(), self.memory.branches.clone());
            self.memory = Memory { hits, branches, ..Memory::new(&self.programs.program) };
            configure(&mut self.memory, &self.programs.program, setup);
        }
        self.robot.clear();
        self.submit.clear();
        self.values = Values::new(setup);
        self.sequences.clear();
        self.fired.clear();
        (self.boots_at_ms, self.initialised) = (at_ms, false);
    }
}

/// Sets what `cell_config.dat` says of inputs and outputs to what this controller has.
fn configure(memory: &mut Memory, program: &Program, setup: &Setup) {
    let mut set = |name: &str, index: usize, value: i32| {
        let cell = program.cell(name).and_then(|cell| memory.cells.get_mut(cell as usize + index));
        if let Some(cell) = cell {
            *cell = Cell::Int(value);
        }
    };
    let count = |list: usize| i32::try_from(list).unwrap_or(i32::MAX);
    set("CELL_OFF_N", 0, count(setup.off_after_ms.len().min(31)));
    for (index, (number, after_ms)) in setup.off_after_ms.iter().take(31).enumerate() {
        set("CELL_OFF", index, i32::from(*number));
        set("CELL_OFF_MS", index, i32::try_from(*after_ms).unwrap_or(i32::MAX));
    }
    set("CELL_SEQ", 0, setup.first_state);
    for (size, list, numbers) in
        [("CELL_OUT_N", "CELL_OUT", &setup.outputs), ("CELL_IN_N", "CELL_IN", &setup.inputs)]
    {
        set(size, 0, count(numbers.len().min(31)));
        for (index, number) in numbers.iter().take(31).enumerate() {
            set(list, index, i32::from(*number));
        }
    }
    set("CELL_VIN_N", 0, count(setup.mapped_inputs.len().min(8)));
    for (index, (input, flag)) in setup.mapped_inputs.iter().take(8).enumerate() {
        set("CELL_VIN", index, i32::from(*input));
        set("CELL_VIN_FLAG", index, i32::from(*flag));
    }
}
