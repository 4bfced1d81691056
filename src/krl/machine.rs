//! Executes a program, one statement at a time: one interpreter of a controller over memory that it shares with another.
//!
//! What lies outside of the language (system variables, the arm, EthernetKRL) is the [`Host`]'s. Between two statements
//! the host may let the other interpreter run, or an interrupt break in; a statement that waits for the arm can be
//! interrupted where it waits. An invalid value, an index outside of its array, a division by zero stop the interpreter.

mod access;
mod calculate;
mod expression;
mod host;
mod interpreter;
mod interrupt;
mod memory;
mod outcome;
mod robot;
mod stack;
mod step;
mod values;

pub use host::{Caller, EkiAnswer, Host, MotionRequest};
pub use interpreter::Interpreter;
pub use interrupt::INTERRUPT_DEPTH;
pub use memory::{Meaning, Memory};
pub use outcome::Pause;
