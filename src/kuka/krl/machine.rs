//! Executes a program statement by statement: one of the controller's interpreters, whose memory is shared with the
//! other one.
//!
//! The [`Host`] provides everything outside of the language: system variables, the arm, EthernetKRL. Between two
//! statements the host may run the other interpreter, or an interrupt may occur. A statement that waits for the arm can
//! be interrupted. An invalid value, an index outside of its array or a division by zero stops the interpreter.

mod host;
mod interpreter;
mod interrupt;
mod step;
mod values;

pub use host::{Caller, EkiAnswer, Host, MotionRequest};
pub use interpreter::{Interpreter, Memory, StepPause, UndocumentedBehaviour};
pub use interrupt::MAX_DECLARED_INTERRUPTS;
