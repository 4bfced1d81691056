//! KUKA's robot language, as far as the cell's programs and an integrator's additions use it: read, checked, and made
//! into steps that the mock controller executes. `panelprep check` uses the same reader.
//!
//! - the text: `lex` (a line to tokens), `parse`, `statement` and `expression` (lines to a tree), `syntax` (the tree)
//! - the meaning: `types` (and how much memory each takes), `system` (the controller's own variables and routines),
//!   `compile` (names, types, steps), `code` (the steps), `program` (all of them), `condense` (several of them as one),
//!   `machine` (executes them)
//!
//! Not supported, and reported with file and line: GOTO, CIRC and spline motions, relative motions, PULSE, SIGNAL,
//! analog inputs and outputs, CREAD and its kin.

mod code;
mod compile;
mod condense;
mod expression;
mod lex;
mod machine;
mod parse;
mod program;
mod statement;
mod syntax;
mod system;
#[cfg(test)]
mod tests;
mod types;

pub use code::{Address, Cell, Entry, LocalVariable, Location, Op, Shared, Space};
pub use compile::{Analysis, RESERVED, analyse};
pub use machine::{Caller, EkiAnswer, Host, INTERRUPT_DEPTH, Interpreter, Meaning, Memory, MotionRequest, Pause};
pub use parse::parse;
pub use program::Program;
pub use syntax::{Approximation, Binary, File, Motion};
pub use system::{Builtin, Kss, LOWEST_KSS, SYSTEM_VARIABLES, SystemVariable};
