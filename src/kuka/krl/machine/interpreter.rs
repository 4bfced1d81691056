//! The state of a run: frames, stack, local variables, interrupts; the interpreter's memory, and the result of a
//! step.
//!
//! If a cell is removed from the stack and is not of the expected kind, the reason is returned. Points that public
//! documents do not specify are interpreted by [`UndocumentedBehaviour`].

use crate::krl::code::{Cell, MemoryAddress, MemorySpace, Program};

pub(super) const INVALID: &str = "a variable is used before a value is assigned to the variable";

/// One interpreter: the state of a run. The program is passed with each call; it must always be the same program.
#[derive(Debug, Clone)]
pub struct Interpreter {
    pub(super) meaning: UndocumentedBehaviour,
    /// Whether this is the robot interpreter: it moves the arm, waits for it, and has interrupts.
    pub(super) moves: bool,
    pub(super) step_index: usize,
    pub(super) stack: Vec<Cell>,
    /// Parameters and local variables.
    pub(super) cells: Vec<Cell>,
    pub(super) frames: Vec<Frame>,
    pub(super) interrupts: Vec<Interrupt>,
    /// Triggers of the next motion and of the planned motions.
    pub(super) armed: Vec<Trigger>,
    pub(super) waits_until_ms: Option<u64>,
    /// Present if BRAKE was requested in this interrupt; true if the planned motions are lost.
    pub(super) braked: Option<bool>,
    /// Whether the motion of this statement is planned.
    pub(super) planned: bool,
    /// The statement to which CONTINUE applies.
    pub(super) continue_statement: Option<usize>,
    /// The effect of ON_ERROR_PROCEED: the error of the next statement is ignored.
    pub(super) error_suppression: u8,
    /// The saved `planned`, `continue_statement` and `statement` of each interrupted statement.
    pub(super) saved: Vec<(bool, Option<usize>, usize)>,
    pub(super) statement: usize,
    pub(super) statement_height: usize,
    /// Present while an interrupt's condition is evaluated: the first cell of the routine that declared it, and the
    /// number of frames before the condition calls functions.
    pub(super) condition_base: Option<(usize, usize)>,
}

impl Interpreter {
    /// Creates an interpreter without a program; `moves` is true for the robot interpreter.
    pub fn new(meaning: UndocumentedBehaviour, moves: bool) -> Self {
        Interpreter {
            meaning,
            moves,
            step_index: 0,
            stack: Vec::new(),
            cells: Vec::new(),
            frames: Vec::new(),
            interrupts: Vec::new(),
            armed: Vec::new(),
            waits_until_ms: None,
            braked: None,
            planned: false,
            continue_statement: None,
            error_suppression: 0,
            saved: Vec::new(),
            statement: 0,
            statement_height: 0,
            condition_base: None,
        }
    }

    /// Resets the interpreter and begins at this routine, which has no arguments.
    pub fn start_routine(&mut self, program: &Program, routine: u32) {
        self.clear();
        self.enter_routine(program, routine, usize::MAX, 0);
    }

    /// Clears all memory.
    pub fn clear(&mut self) {
        let Interpreter { stack, cells, frames, interrupts, armed, saved, .. } = self;
        // The allocated memory is reused: a cycle begins 83 times a second.
        stack.clear();
        cells.clear();
        frames.clear();
        interrupts.clear();
        armed.clear();
        saved.clear();
        (self.step_index, self.statement, self.statement_height) = (0, 0, 0);
        (self.waits_until_ms, self.braked, self.planned, self.continue_statement) = (None, None, false, None);
        (self.error_suppression, self.condition_base) = (0, None);
    }

    /// Returns whether there is nothing to execute.
    #[inline]
    pub fn is_idle(&self) -> bool {
        self.frames.is_empty()
    }

    /// Returns the file and the line that are executed.
    pub fn current_location(&self, program: &Program) -> String {
        let location = program.statements.get(self.statement);
        location.map_or(String::new(), |at| format!("{}:{}", program.files[at.file], at.line))
    }

    pub(super) fn enter_routine(&mut self, program: &Program, routine: u32, return_to: usize, height: usize) {
        let entry = &program.routines[routine as usize];
        let base = self.cells.len();
        // Unset and not zero: a controller stops at a variable that was never assigned, and this interpreter must stop
        // as well.
        self.cells.resize(base + entry.frame_cells as usize, Cell::Unset);
        let parameters = entry.parameter_cells as usize;
        let given = self.stack.len().saturating_sub(parameters);
        for (cell, value) in self.cells[base..].iter_mut().zip(&self.stack[given..]) {
            *cell = *value;
        }
        self.stack.truncate(given);
        self.step_index = entry.start as usize;
        self.frames.push(Frame { routine, return_to, base, height, interrupt_entry: None });
    }

    pub(super) fn local_cells(
        &self,
        program: &Program,
        memory: &Memory,
        name: &str,
        cells: usize,
    ) -> Option<Vec<Cell>> {
        for frame in self.frames.iter().rev().filter(|frame| frame.interrupt_entry.is_none()) {
            let entry = &program.routines[frame.routine as usize];
            let Some(local) = entry.locals.iter().find(|local| local.name == name) else { continue };
            let at = frame.base + local.offset as usize;
            if !local.by_reference {
                return self.cells.get(at..at + cells).map(<[Cell]>::to_vec);
            }
            let Some(Cell::Address(address)) = self.cells.get(at) else { continue };
            let from = address.offset as usize;
            let within = match address.space {
                MemorySpace::Frame => &self.cells,
                _ => &memory.cells,
            };
            return within.get(from..from + cells).map(<[Cell]>::to_vec);
        }
        None
    }
}

impl Interpreter {
    #[inline]
    pub(super) fn pop(&mut self) -> Result<Cell, StepError> {
        self.stack.pop().ok_or_else(|| "internal error of the KRL interpreter: its stack is empty".into())
    }

    #[inline]
    pub(super) fn pop_int(&mut self) -> Result<i32, StepError> {
        match self.pop()? {
            Cell::Int(number) => Ok(number),
            _ => Err(INVALID.into()),
        }
    }

    #[inline]
    pub(super) fn pop_real(&mut self) -> Result<f32, StepError> {
        match self.pop()? {
            Cell::Real(number) => Ok(number),
            _ => Err(INVALID.into()),
        }
    }

    #[inline]
    pub(super) fn pop_bool(&mut self) -> Result<bool, StepError> {
        match self.pop()? {
            Cell::Bool(value) => Ok(value),
            _ => Err(INVALID.into()),
        }
    }

    #[inline]
    pub(super) fn pop_address(&mut self) -> Result<MemoryAddress, StepError> {
        match self.pop()? {
            Cell::Address(address) => Ok(address),
            _ => Err("internal error of the KRL interpreter: an address is missing".into()),
        }
    }

    /// Removes the newest cells from the stack and returns them.
    pub(super) fn pop_block<const N: usize>(&mut self) -> Result<[Cell; N], StepError> {
        let at =
            self.stack.len().checked_sub(N).ok_or("internal error of the KRL interpreter: its stack is empty")?;
        let mut cells = [Cell::Unset; N];
        cells.copy_from_slice(&self.stack[at..]);
        self.stack.truncate(at);
        Ok(cells)
    }

    pub(super) fn pop_text<'a>(&mut self, program: &'a Program) -> Result<&'a str, StepError> {
        let index = self.pop_text_index()?;
        program.texts.get(index).map(String::as_str).ok_or_else(|| "a text is missing".into())
    }

    /// Removes a text's index among the program's texts from the stack and returns it.
    pub(super) fn pop_text_index(&mut self) -> Result<usize, StepError> {
        match self.pop()? {
            Cell::Text(index) => Ok(index as usize),
            _ => Err(
                "a string in quotation marks is required here; this interpreter does not execute CHAR variables"
                    .into(),
            ),
        }
    }
}

#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub(super) routine: u32,
    pub(super) return_to: usize,
    /// Its first cell.
    pub(super) base: usize,
    /// Height of the stack when the routine was called.
    pub(super) height: usize,
    /// Present if an interrupt or trigger called the routine: its priority, and what the interrupted program waited
    /// for.
    pub(super) interrupt_entry: Option<InterruptEntry>,
}

#[derive(Debug, Clone)]
pub(super) struct InterruptEntry {
    pub(super) priority: i32,
    /// The frame that declared the interrupt.
    pub(super) declared_in: usize,
    pub(super) waits_until_ms: Option<u64>,
    pub(super) braked: Option<bool>,
}

/// A declared interrupt.
#[derive(Debug, Clone)]
pub(super) struct Interrupt {
    pub(super) number: i32,
    pub(super) global: bool,
    /// The frame that declared the interrupt.
    pub(super) declared_in: usize,
    pub(super) condition: usize,
    pub(super) call: usize,
    pub(super) on: bool,
    /// The value of the condition at its last evaluation.
    pub(super) last_condition: bool,
    pub(super) pending: bool,
}

/// A trigger that belongs to a motion.
#[derive(Debug, Clone)]
pub(super) struct Trigger {
    /// The number of the trigger's motion, as soon as this motion is planned.
    pub(super) sequence: Option<u64>,
    pub(super) call: usize,
    pub(super) base: usize,
}

/// Behaviour that public documents do not specify. Each item may be true or false on a controller; the programs must
/// work in both cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct UndocumentedBehaviour {
    /// RESUME requires `$ADVANCE` = 0 at the time of its execution; otherwise the program stops.
    pub resume_needs_advance_0: bool,
    /// INTERRUPT ON fires if the condition already holds.
    pub on_fires_at_once: bool,
    /// AND and OR leave out their right side if the left one decides.
    pub short_circuit: bool,
    /// `{X 1}` assigned to a variable leaves the other components unchanged; otherwise they become invalid.
    pub aggregate_keeps_rest: bool,
    /// A trigger may fire a while after the arm has reached its point, even when the advance run already continues.
    pub late_triggers: bool,
    /// An approximated motion from standstill waits for the next motion, or for a statement that stops the advance run.
    pub lone_approximation_waits: bool,
    /// EKI_Clear of a channel that was never initialised stops the interpreter.
    pub clear_of_unknown_stops: bool,
    /// EKI_Open within two cycles after EKI_Clear fails: the server exists already.
    pub immediate_reopen_fails: bool,
    /// If no motion is planned after a motion, its trigger may not fire at all.
    pub triggers_get_lost: bool,
    /// A program that the safety controller stops is reported as stopped a few cycles later, and executes
    /// statements until then.
    pub stops_late: bool,
}

/// The memory that both interpreters share, and a record of the executed statements.
#[derive(Debug, Clone)]
pub struct Memory {
    /// The data lists' cells.
    pub cells: Vec<Cell>,
    /// The number of executions of each statement.
    pub hits: Vec<u32>,
    /// For each condition, whether it was ever TRUE and ever FALSE; indexed by the step.
    pub branches: Vec<[bool; 2]>,
}

impl Memory {
    /// Creates the memory with the values of the data lists.
    pub fn new(program: &Program) -> Self {
        Memory {
            cells: program.memory.clone(),
            hits: vec![0; program.statements.len()],
            branches: vec![[false; 2]; program.code.len()],
        }
    }

    /// Returns a shared INT; 0 if the cell holds none.
    #[inline]
    pub fn shared_int(&self, cell: Option<u32>) -> i32 {
        match cell.and_then(|cell| self.cells.get(cell as usize)) {
            Some(Cell::Int(number)) => *number,
            _ => 0,
        }
    }

    /// Returns a shared BOOL; FALSE if the cell holds none.
    #[inline]
    pub fn bool(&self, cell: Option<u32>) -> bool {
        matches!(cell.and_then(|cell| self.cells.get(cell as usize)), Some(Cell::Bool(true)))
    }
}

/// The way in which a step ended.
#[derive(Debug, Clone, PartialEq)]
pub enum StepPause {
    /// The statement has ended.
    Statement,
    /// The step waits, for the arm or for time.
    Waits,
    /// The program has reached its end.
    Ended,
    /// The interpreter cannot continue: file, line and reason.
    Fault(String),
}

/// The result of a step.
pub(super) enum StepFlow {
    Next,
    /// The same step must be executed again later.
    Wait,
    Ended,
}

/// The error of a step: a message, boxed so that the result of a successful step stays small.
#[derive(Debug)]
#[allow(clippy::box_collection, reason = "a result is twice as large with the text itself")]
pub(super) struct StepError(Box<String>);

impl From<String> for StepError {
    fn from(message: String) -> Self {
        StepError(Box::new(message))
    }
}

impl From<&str> for StepError {
    fn from(message: &str) -> Self {
        StepError(Box::new(message.to_owned()))
    }
}

impl From<StepError> for String {
    fn from(wrong: StepError) -> Self {
        *wrong.0
    }
}

/// The result of a step, or its error.
pub(super) type StepResult = Result<StepFlow, StepError>;
