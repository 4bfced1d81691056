//! Executes a program, one statement at a time: one interpreter of a controller over memory that it shares with
//! another.
//!
//! The [`Host`] provides all that lies outside of the language (system variables, the arm, EthernetKRL). Between two
//! statements the host may let the other interpreter run, or an interrupt may occur. A statement that waits for the arm
//! can be interrupted while it waits. An invalid value, an index outside of its array or a division by zero stops the
//! interpreter.

mod host;
mod interpreter;
mod interrupt;
mod step;
mod values;

pub use host::{Caller, EkiAnswer, Host, MotionRequest};
pub use interpreter::{Interpreter, Memory, StepPause, UndocumentedBehaviour};
pub use interrupt::MAX_DECLARED_INTERRUPTS;
