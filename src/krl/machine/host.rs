//! What lies outside of the language: the controller around an interpreter.

use super::interpreter::Interpreter;
use super::memory::Memory;
use crate::krl::code::Cell;
use crate::krl::program::Program;
use crate::krl::routines::Builtin;
use crate::krl::syntax::{Approximation, Motion};

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

    /// ms since the controller's start.
    fn now_ms(&self) -> u64;

    /// Nothing is planned and nothing moves.
    fn arm_stands(&self) -> bool;

    /// Motions planned, the present one included.
    fn planned(&self) -> usize;

    /// `$ADVANCE`.
    fn advance(&self) -> usize;

    /// Plans a motion and returns its number among all motions; its end is reported with this number.
    ///
    /// # Errors
    /// If the controller gives it up.
    fn plan(&mut self, request: &MotionRequest, caller: &Caller<'_>) -> Result<u64, String>;

    /// A statement waits for the arm: what is planned is executed to its end.
    fn let_arm_finish(&mut self);

    /// Brakes; the arm has stopped once [`Host::arm_stands`] is true.
    fn brake(&mut self, fast: bool);

    /// RESUME: what was planned is forgotten.
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

    /// BAS(#INITMOV,…): speeds and accelerations at their defaults.
    fn init_motion(&mut self);

    /// Whether a system variable has a value.
    fn is_initialized(&mut self, name: &str) -> bool;
}

/// The caller of a motion: the interpreter's frames, for logs that state which command it was.
pub struct Caller<'a> {
    pub(super) program: &'a Program,
    pub(super) interpreter: &'a Interpreter,
    pub(super) memory: &'a Memory,
}

impl Caller<'_> {
    /// This many cells of the innermost local variable of this name.
    pub fn local(&self, name: &str, cells: usize) -> Option<Vec<Cell>> {
        self.interpreter.local(self.program, self.memory, name, cells)
    }
}
