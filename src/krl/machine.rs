//! Executes a program, one statement at a time: one interpreter of a controller over memory that it shares with another.
//!
//! What lies outside of the language (system variables, the arm, EthernetKRL) is the [`Host`]'s. Between two statements
//! the host may let the other interpreter run, or an interrupt break in; a statement that waits for the arm can be
//! interrupted where it waits. An invalid value, an index outside of its array, a division by zero stop the interpreter.

mod calculate;
mod expression;
mod interrupt;
mod robot;
mod step;

use super::code::{Cell, Program};
use super::syntax::{Approximation, Motion};
use super::system::Builtin;
pub use interrupt::INTERRUPT_DEPTH;
use interrupt::Interrupt;

/// What public documents leave open. Each may be one or the other on a controller; the programs must work with both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Meaning {
    /// RESUME needs `$ADVANCE` = 0 at its moment; else the program stops.
    pub resume_needs_advance_0: bool,
    /// INTERRUPT ON fires where the condition holds already.
    pub on_fires_at_once: bool,
    /// AND and OR leave out their right side where the left one decides.
    pub short_circuit: bool,
    /// `{X 1}` assigned to a variable leaves its other components as they were; else they become invalid.
    pub aggregate_keeps_rest: bool,
    /// A trigger may fire a while after the arm has reached its point, even when the advance run goes on already.
    pub late_triggers: bool,
    /// An approximated motion from standstill waits for the next motion, or for a statement that stops the advance run.
    pub lone_approximation_waits: bool,
    /// EKI_Clear of a channel that was never initialised stops the interpreter.
    pub clear_of_unknown_stops: bool,
    /// EKI_Open within two cycles after EKI_Clear fails: the server exists already.
    pub immediate_reopen_fails: bool,
    /// The trigger of a motion behind which nothing is planned may not fire at all.
    pub triggers_get_lost: bool,
    /// A program that the safety controller stops is told as stopped a few cycles later, and executes statements until then.
    pub stops_late: bool,
}

/// Memory that both interpreters share, and what was executed.
#[derive(Debug, Clone)]
pub struct Memory {
    /// The data lists' cells.
    pub cells: Vec<Cell>,
    /// How often each statement was executed.
    pub hits: Vec<u32>,
    /// Of each condition, whether it was ever TRUE and ever FALSE; by the step's place.
    pub branches: Vec<[bool; 2]>,
}

impl Memory {
    /// As the data lists say it.
    pub fn new(program: &Program) -> Self {
        Memory {
            cells: program.memory.clone(),
            hits: vec![0; program.statements.len()],
            branches: vec![[false; 2]; program.code.len()],
        }
    }

    /// A shared INT; 0 where it holds none.
    #[inline]
    pub fn int(&self, cell: Option<u32>) -> i32 {
        match cell.and_then(|cell| self.cells.get(cell as usize)) {
            Some(Cell::Int(number)) => *number,
            _ => 0,
        }
    }

    /// A shared BOOL; FALSE where it holds none.
    #[inline]
    pub fn bool(&self, cell: Option<u32>) -> bool {
        matches!(cell.and_then(|cell| self.cells.get(cell as usize)), Some(Cell::Bool(true)))
    }
}

/// A motion as the program states it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionRequest {
    /// PTP or LIN.
    pub motion: Motion,
    /// The target is axes; else a pose.
    pub axes: bool,
    /// Degrees, or mm and degrees.
    pub target: [f32; 6],
    /// How its end is rounded.
    pub approximates: Option<Approximation>,
}

/// What EthernetKRL gives back: `EKI_STATUS`, and the value that was read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EkiAnswer {
    /// Entries left.
    pub buff: i32,
    /// Entries read.
    pub read: i32,
    /// 0, or the number of the message.
    pub msg_no: i32,
    /// A client is connected.
    pub connected: bool,
    /// Of the message that brought the entry.
    pub counter: i32,
    /// What was read: a simple value, or six numbers.
    pub value: [Cell; 6],
}

/// The controller around an interpreter.
pub trait Host {
    /// A cell of a system variable.
    ///
    /// # Errors
    /// Where reading it stops an interpreter.
    fn read(&mut self, variable: u16, offset: u32) -> Result<Cell, String>;

    /// Writes a cell of a system variable.
    ///
    /// # Errors
    /// Where the value is not allowed.
    fn write(&mut self, variable: u16, offset: u32, value: Cell) -> Result<(), String>;

    /// ms since the controller's start.
    fn now_ms(&self) -> u64;

    /// Nothing is planned and nothing moves.
    fn arm_stands(&self) -> bool;

    /// Motions planned, the present one included.
    fn planned(&self) -> usize;

    /// `$ADVANCE`.
    fn advance(&self) -> usize;

    /// Plans a motion; its number among all comes back, by which its end is told.
    ///
    /// # Errors
    /// Where the controller gives it up.
    fn plan(&mut self, request: &MotionRequest, caller: &Caller<'_>) -> Result<u64, String>;

    /// A statement waits for the arm: what is planned is executed to its end.
    fn let_arm_finish(&mut self);

    /// Brakes; the arm stands once [`Host::arm_stands`] says so.
    fn brake(&mut self, fast: bool);

    /// RESUME: what was planned is forgotten.
    fn discard(&mut self);

    /// EthernetKRL.
    ///
    /// # Errors
    /// Where the call stops an interpreter.
    fn eki(&mut self, what: Builtin, channel: &str, tag: &str, value: &[Cell]) -> Result<EkiAnswer, String>;

    /// CWRITE to `$CMD`.
    ///
    /// # Errors
    /// Where the command is none that is known.
    fn command(&mut self, text: &str) -> Result<(), String>;

    /// BAS(#INITMOV,…): speeds and accelerations at their defaults.
    fn init_motion(&mut self);

    /// Whether a system variable has a value.
    fn is_initialized(&mut self, name: &str) -> bool;
}

/// Who asks for a motion: the interpreter's frames, for logs that say which command it was.
pub struct Caller<'a> {
    program: &'a Program,
    interpreter: &'a Interpreter,
    memory: &'a Memory,
}

impl Caller<'_> {
    /// So many cells of the innermost local variable of this name.
    pub fn local(&self, name: &str, cells: usize) -> Option<Vec<Cell>> {
        self.interpreter.local(self.program, self.memory, name, cells)
    }
}

/// How a step ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Pause {
    /// The statement is over.
    Statement,
    /// It waits, for the arm or for time.
    Waits,
    /// The program is at its end.
    Ended,
    /// It cannot go on: file, line and reason.
    Fault(String),
}

#[derive(Debug, Clone)]
struct Frame {
    routine: u32,
    return_to: usize,
    /// Its first cell.
    base: usize,
    /// Of the stack when it was called.
    height: usize,
    /// Where an interrupt or trigger broke in: its priority, and what the interrupted program waited for.
    broke_in: Option<BrokeIn>,
}

#[derive(Debug, Clone)]
struct BrokeIn {
    priority: i32,
    /// The frame that declared the interrupt.
    declared_in: usize,
    waits_until_ms: Option<u64>,
    braked: Option<bool>,
}

/// How a step can go wrong: a message, behind a pointer so that what goes right stays small.
#[derive(Debug)]
#[allow(clippy::box_collection, reason = "a result is twice as large with the text itself")]
struct Wrong(Box<String>);

impl From<String> for Wrong {
    fn from(message: String) -> Self {
        Wrong(Box::new(message))
    }
}

impl From<&str> for Wrong {
    fn from(message: &str) -> Self {
        Wrong(Box::new(message.to_owned()))
    }
}

impl From<Wrong> for String {
    fn from(wrong: Wrong) -> Self {
        *wrong.0
    }
}

/// One interpreter: the state of a run. The program is handed over with each call, always the same one.
#[derive(Debug, Clone)]
pub struct Interpreter {
    meaning: Meaning,
    /// The robot interpreter: it moves the arm, waits for it, has interrupts.
    moves: bool,
    at: usize,
    stack: Vec<Cell>,
    /// Parameters and local variables.
    cells: Vec<Cell>,
    frames: Vec<Frame>,
    interrupts: Vec<Interrupt>,
    /// Triggers of the motion that comes next, and of those that are planned.
    armed: Vec<interrupt::Trigger>,
    waits_until_ms: Option<u64>,
    /// In this interrupt BRAKE was asked for; true where what was planned is lost.
    braked: Option<bool>,
    /// The motion of this statement is planned.
    planned: bool,
    /// CONTINUE: of this statement.
    keeps_going: Option<usize>,
    /// ON_ERROR_PROCEED: the next statement's fault is passed over.
    proceeds: u8,
    /// Of the statement that an interrupt broke into.
    saved: Vec<(bool, Option<usize>, usize)>,
    statement: usize,
    statement_height: usize,
    /// While an interrupt's condition is looked at: the first cell of the routine that declared it, and how many frames
    /// there are outside of the functions that the condition calls.
    condition_base: Option<(usize, usize)>,
}

impl Interpreter {
    /// An interpreter without a program to run; `moves` for the robot's.
    pub fn new(meaning: Meaning, moves: bool) -> Self {
        Interpreter {
            meaning,
            moves,
            at: 0,
            stack: Vec::new(),
            cells: Vec::new(),
            frames: Vec::new(),
            interrupts: Vec::new(),
            armed: Vec::new(),
            waits_until_ms: None,
            braked: None,
            planned: false,
            keeps_going: None,
            proceeds: 0,
            saved: Vec::new(),
            statement: 0,
            statement_height: 0,
            condition_base: None,
        }
    }

    /// Forgets everything and begins at this routine, which takes no arguments.
    pub fn begin(&mut self, program: &Program, routine: u32) {
        self.clear();
        self.enter(program, routine, usize::MAX, 0);
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        let Interpreter { stack, cells, frames, interrupts, armed, saved, .. } = self;
        // What was reserved is used again: a cycle begins 83 times a second.
        stack.clear();
        cells.clear();
        frames.clear();
        interrupts.clear();
        armed.clear();
        saved.clear();
        (self.at, self.statement, self.statement_height) = (0, 0, 0);
        (self.waits_until_ms, self.braked, self.planned, self.keeps_going) = (None, None, false, None);
        (self.proceeds, self.condition_base) = (0, None);
    }

    /// Whether there is something to execute.
    #[inline]
    pub fn is_idle(&self) -> bool {
        self.frames.is_empty()
    }

    /// The file and line that is executed.
    pub fn place(&self, program: &Program) -> String {
        let location = program.statements.get(self.statement);
        location.map_or(String::new(), |at| format!("{}:{}", program.files[at.file], at.line))
    }

    fn enter(&mut self, program: &Program, routine: u32, return_to: usize, height: usize) {
        let entry = &program.routines[routine as usize];
        let base = self.cells.len();
        self.cells.resize(base + entry.frame_cells as usize, Cell::Unset);
        let parameters = entry.parameter_cells as usize;
        let given = self.stack.len().saturating_sub(parameters);
        for (cell, value) in self.cells[base..].iter_mut().zip(&self.stack[given..]) {
            *cell = *value;
        }
        self.stack.truncate(given);
        self.at = entry.start as usize;
        self.frames.push(Frame { routine, return_to, base, height, broke_in: None });
    }

    fn local(&self, program: &Program, memory: &Memory, name: &str, cells: usize) -> Option<Vec<Cell>> {
        for frame in self.frames.iter().rev().filter(|frame| frame.broke_in.is_none()) {
            let entry = &program.routines[frame.routine as usize];
            let Some(local) = entry.locals.iter().find(|local| local.name == name) else { continue };
            let at = frame.base + local.offset as usize;
            if !local.by_reference {
                return self.cells.get(at..at + cells).map(<[Cell]>::to_vec);
            }
            let Some(Cell::Address(address)) = self.cells.get(at) else { continue };
            let from = address.offset as usize;
            let within = match address.space {
                super::code::Space::Frame => &self.cells,
                _ => &memory.cells,
            };
            return within.get(from..from + cells).map(<[Cell]>::to_vec);
        }
        None
    }
}
