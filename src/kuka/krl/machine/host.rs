//! The interface to everything outside of the language: the controller around an interpreter.

use super::interpreter::Interpreter;
use super::memory::Memory;
use crate::krl::code::Cell;
use crate::krl::program::Program;
use crate::krl::routines::Builtin;
use crate::krl::syntax::{Approximation, Motion};

/// A motion as stated in the program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionRequest {
    /// PTP or LIN.
    pub motion: Motion,
    /// True if the target is axes; false if it is a pose.
    pub axes: bool,
    /// The target: degrees for axes, mm and degrees for a pose.
    pub target: [f32; 6],
    /// The approximation of the motion's end.
    pub approximates: Option<Approximation>,
}

/// The answer of EthernetKRL: `EKI_STATUS`, and the value that was read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EkiAnswer {
    /// Number of entries left.
    pub buff: i32,
    /// Number of entries read.
    pub read: i32,
    /// The number of the message; 0 for no message.
    pub msg_no: i32,
    /// Whether a client is connected.
    pub connected: bool,
    /// The counter of the message that brought the entry.
    pub counter: i32,
    /// The value that was read: a simple value, or six numbers.
    pub value: [Cell; 6],
}

/// The controller around an interpreter.
pub trait Host {
    /// Reads a cell of a system variable.
    ///
    /// # Errors
    /// If reading it stops an interpreter.
    fn read(&mut self, variable: u16, offset: u32) -> Result<Cell, String>;

    /// Writes a cell of a system variable.
    ///
    /// # Errors
    /// If the value is not allowed.
    fn write(&mut self, variable: u16, offset: u32, value: Cell) -> Result<(), String>;

    /// Returns the time since the controller's start, ms.
    fn now_ms(&self) -> u64;

    /// Returns whether no motion is planned and the arm does not move.
    fn is_arm_at_rest(&self) -> bool;

    /// Returns the number of planned motions, including the present one.
    fn planned_motions(&self) -> usize;

    /// `$ADVANCE`.
    fn advance(&self) -> usize;

    /// Plans a motion and returns its number among all motions; its end is reported with this number.
    ///
    /// # Errors
    /// If the controller cannot plan the motion.
    fn plan(&mut self, request: &MotionRequest, caller: &Caller<'_>) -> Result<u64, String>;

    /// Executes all planned motions to their end, because a statement waits for the arm.
    fn finish_motions(&mut self);

    /// Brakes; the arm has stopped once [`Host::is_arm_at_rest`] is true.
    fn start_braking(&mut self, fast: bool);

    /// Discards the planned motions after RESUME.
    fn discard(&mut self);

    /// EthernetKRL.
    ///
    /// # Errors
    /// If the call stops an interpreter.
    fn eki(&mut self, what: Builtin, channel: &str, tag: &str, value: &[Cell]) -> Result<EkiAnswer, String>;

    /// CWRITE to `$CMD`.
    ///
    /// # Errors
    /// If the command is not known.
    fn command(&mut self, text: &str) -> Result<(), String>;

    /// Sets speeds and accelerations to their defaults: BAS(#INITMOV,…).
    fn init_motion(&mut self);

    /// Returns whether a system variable has a value.
    fn is_initialized(&mut self, name: &str) -> bool;
}

/// The interpreter's frames when it requests a motion, for logs that state which command it belongs to.
pub struct Caller<'a> {
    pub(super) program: &'a Program,
    pub(super) interpreter: &'a Interpreter,
    pub(super) memory: &'a Memory,
}

impl Caller<'_> {
    /// Returns this many cells of the innermost local variable of this name.
    pub fn local_cells(&self, name: &str, cells: usize) -> Option<Vec<Cell>> {
        self.interpreter.local_cells(self.program, self.memory, name, cells)
    }
}
