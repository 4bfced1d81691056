//! The state of an interpreter (frames, stack, local variables, interrupts), its memory, and the result of a step.
//!
//! If a cell that is popped from the stack is not of the expected kind, an error with the reason is returned. Behaviour
//! that public documents do not specify is selected by [`UndocumentedBehaviour`].

use crate::krl::code::{Cell, MemoryAddress, MemorySpace, Program};

pub(super) const INVALID: &str = "a variable is used before a value is assigned to the variable";

/// One interpreter. The program is passed with each call, and must always be the same.
#[derive(Debug, Clone)]
pub struct Interpreter {
    pub(super) meaning: UndocumentedBehaviour,
    /// Whether this is the robot interpreter, which moves the arm, waits for it, and has interrupts.
    pub(super) moves: bool,
    pub(super) step_index: usize,
    pub(super) stack: Vec<Cell>,
    /// The parameters and local variables of all frames.
    pub(super) cells: Vec<Cell>,
    pub(super) frames: Vec<Frame>,
    pub(super) interrupts: Vec<Interrupt>,
    /// The triggers of the next motion and of the planned motions.
    pub(super) armed: Vec<Trigger>,
    pub(super) waits_until_ms: Option<u64>,
    /// Set if BRAKE was executed in this interrupt; true if the planned motions are lost.
    pub(super) braked: Option<bool>,
    /// Whether the motion of the current statement is already planned.
    pub(super) planned: bool,
    /// The statement to which CONTINUE applies.
    pub(super) continue_statement: Option<usize>,
    /// The state of ON_ERROR_PROCEED, which suppresses the error of the next statement.
    pub(super) error_suppression: u8,
    /// For each interrupted statement, its saved `planned`, `continue_statement` and `statement`.
    pub(super) saved: Vec<(bool, Option<usize>, usize)>,
    pub(super) statement: usize,
    pub(super) statement_height: usize,
    /// Set while the condition of an interrupt is evaluated: the first cell of the routine that declared the interrupt,
    /// and the number of frames before the condition calls functions.
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

    /// Resets the interpreter and starts this routine, which must have no parameters.
    pub fn start_routine(&mut self, program: &Program, routine: u32) {
        self.clear();
        self.enter_routine(program, routine, usize::MAX, 0);
    }

    /// Clears all memory.
    pub fn clear(&mut self) {
        let Interpreter { stack, cells, frames, interrupts, armed, saved, .. } = self;
        // The allocated memory is reused, because a program is restarted 83 times a second.
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

    /// Returns whether the interpreter has nothing to execute.
    #[inline]
    pub fn is_idle(&self) -> bool {
        self.frames.is_empty()
    }

    /// Returns the file and the line of the current statement.
    pub fn current_location(&self, program: &Program) -> String {
        let location = program.statements.get(self.statement);
        location.map_or(String::new(), |at| format!("{}:{}", program.files[at.file], at.line))
    }

    pub(super) fn enter_routine(&mut self, program: &Program, routine: u32, return_to: usize, height: usize) {
        let entry = &program.routines[routine as usize];
        let base = self.cells.len();
        // New variables are unset instead of zero: a controller stops when an unassigned variable is read, and this
        // interpreter must do the same.
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

    /// Pops the top `N` cells from the stack.
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
        program
            .texts
            .get(index)
            .map(String::as_str)
            .ok_or_else(|| "internal error of the KRL interpreter: a text is missing".into())
    }

    /// Pops a text from the stack, as its index in the list of the program's texts.
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
    /// Index of the first cell of the frame.
    pub(super) base: usize,
    /// The height of the stack when the routine was called.
    pub(super) height: usize,
    /// Set if an interrupt or a trigger called the routine: the priority, and for what the interrupted program was
    /// waiting.
    pub(super) interrupt_entry: Option<InterruptEntry>,
}

#[derive(Debug, Clone)]
pub(super) struct InterruptEntry {
    pub(super) priority: i32,
    /// The index of the frame that declared the interrupt.
    pub(super) declared_in: usize,
    pub(super) waits_until_ms: Option<u64>,
    pub(super) braked: Option<bool>,
}

/// A declared interrupt.
#[derive(Debug, Clone)]
pub(super) struct Interrupt {
    pub(super) number: i32,
    pub(super) global: bool,
    /// The index of the frame that declared the interrupt.
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
    /// The sequence number of the trigger's motion, once this motion is planned.
    pub(super) sequence: Option<u64>,
    pub(super) call: usize,
    pub(super) base: usize,
}

/// Behaviour of a controller that public documents do not specify. Each item may be true or false on a real controller,
/// so the cell's programs must work in both cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct UndocumentedBehaviour {
    /// RESUME requires `$ADVANCE` = 0 when it is executed; otherwise the program stops.
    pub resume_needs_advance_0: bool,
    /// INTERRUPT ON triggers the interrupt immediately if its condition is already TRUE.
    pub on_fires_at_once: bool,
    /// AND and OR do not evaluate the right operand if the left one decides the result.
    pub short_circuit: bool,
    /// Assigning `{X 1}` to a variable leaves the other components unchanged; otherwise they become invalid.
    pub aggregate_keeps_rest: bool,
    /// A trigger may fire some time after the arm has reached its point, even after the advance run has continued.
    pub late_triggers: bool,
    /// An approximated motion from standstill does not start before the next motion is planned, or a statement stops
    /// the advance run.
    pub lone_approximation_waits: bool,
    /// EKI_Clear stops the interpreter if the channel was never initialised.
    pub clear_of_unknown_stops: bool,
    /// EKI_Open fails within two cycles after EKI_Clear, because the old server still exists.
    pub immediate_reopen_fails: bool,
    /// If no motion is planned after a motion, the trigger of that motion may not fire at all.
    pub triggers_get_lost: bool,
    /// A program that the safety controller stops continues to execute statements for a few cycles before it is
    /// reported as stopped.
    pub stops_late: bool,
}

/// The memory that both interpreters share, and statistics of the executed statements.
#[derive(Debug, Clone)]
pub struct Memory {
    /// The cells of all data lists.
    pub cells: Vec<Cell>,
    /// The number of executions of each statement.
    pub hits: Vec<u32>,
    /// For each condition, indexed by its step: whether it was ever TRUE, and whether it was ever FALSE.
    pub branches: Vec<[bool; 2]>,
}

impl Memory {
    /// Creates the memory with the initial values of the data lists.
    pub fn new(program: &Program) -> Self {
        Memory {
            cells: program.memory.clone(),
            hits: vec![0; program.statements.len()],
            branches: vec![[false; 2]; program.code.len()],
        }
    }

    /// Returns the value of a shared INT; 0 if the cell contains no INT.
    #[inline]
    pub fn shared_int(&self, cell: Option<u32>) -> i32 {
        match cell.and_then(|cell| self.cells.get(cell as usize)) {
            Some(Cell::Int(number)) => *number,
            _ => 0,
        }
    }

    /// Returns the value of a shared BOOL; FALSE if the cell contains no BOOL.
    #[inline]
    pub fn bool(&self, cell: Option<u32>) -> bool {
        matches!(cell.and_then(|cell| self.cells.get(cell as usize)), Some(Cell::Bool(true)))
    }
}

/// The reason why the interpreter returns from a call of [`Interpreter::step`].
#[derive(Debug, Clone, PartialEq)]
pub enum StepPause {
    /// The statement is completed.
    Statement,
    /// The statement waits for the arm or for a time.
    Waits,
    /// The program has reached its end.
    Ended,
    /// The program has an error; the message contains file, line and reason.
    Fault(String),
}

/// How the execution continues after a step.
pub(super) enum StepFlow {
    Next,
    /// The step must wait, and is executed again at the next call.
    Wait,
    Ended,
}

/// The error message of a step. It is boxed, so that the result of a successful step stays small.
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
