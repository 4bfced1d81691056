//! The state of a run: frames, stack, local variables, interrupts.

use super::memory::{Memory, UndocumentedBehaviour};
use crate::krl::code::{Cell, MemorySpace};
use crate::krl::program::Program;

#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub(super) routine: u32,
    pub(super) return_to: usize,
    /// Its first cell.
    pub(super) base: usize,
    /// Height of the stack when the routine was called.
    pub(super) height: usize,
    /// Present if an interrupt or trigger broke in: its priority, and what the interrupted program waited for.
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
    /// The saved `planned`, `continue_statement` and `statement` of each statement that an interrupt broke into.
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
        // Unset and not zero: a controller stops at a variable that was never assigned, and so must the execution here.
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
