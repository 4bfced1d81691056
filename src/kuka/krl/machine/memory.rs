//! The memory of an interpreter, and its interpretation of points that public documents do not specify.

use crate::krl::code::Cell;
use crate::krl::program::Program;

/// Points that public documents do not specify. Each may be true or false on a controller; the programs must work
/// in both cases.
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

    /// A shared INT; 0 if the cell holds none.
    #[inline]
    pub fn shared_int(&self, cell: Option<u32>) -> i32 {
        match cell.and_then(|cell| self.cells.get(cell as usize)) {
            Some(Cell::Int(number)) => *number,
            _ => 0,
        }
    }

    /// A shared BOOL; FALSE if the cell holds none.
    #[inline]
    pub fn bool(&self, cell: Option<u32>) -> bool {
        matches!(cell.and_then(|cell| self.cells.get(cell as usize)), Some(Cell::Bool(true)))
    }
}
