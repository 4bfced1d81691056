//! KUKA's robot language: read, checked, and, as far as the cell's programs use it, compiled to steps that the mock
//! controller executes. `panelprep check` uses the same reader for programs of other people.
//!
//! Three groups are distinguished. Read and executed: the statements of the shipped programs. Read and only checked,
//! so that execution stops with a message that has the line: GOTO, circles, splines, relative motions, texts in
//! variables, names that no file declares. Not read: the rest, with a warning that has the line and begins with "not
//! checked". README.md beside this file states the source of each rule.
//!
//! - the text: `lex` (a line to tokens), `parse`, `statement` and `expression` (lines to a tree), `syntax` (the
//!   tree, and upper bounds of time, memory and recursion depth for any input)
//! - the meaning: `types` (and the memory that each needs), `system` (the controller's own variables), `routines`
//!   (its own routines), `compile` (names, types, steps), `code` (the steps, and several of them as one), `machine`
//!   (executes them)

mod code;
mod compile;
mod expression;
mod lex;
mod machine;
mod outline;
mod parse;
mod routines;
mod statement;
mod syntax;
mod system;
#[cfg(test)]
mod tests;
mod types;

pub use code::{Cell, Entry, LocalVariable, Location, MemoryAddress, MemorySpace, Op, Program, Shared};
pub use compile::{Analysis, analyse};
pub use lex::RESERVED;
pub use machine::{
    Caller, EkiAnswer, Host, Interpreter, MAX_DECLARED_INTERRUPTS, Memory, MotionRequest, StepPause,
    UndocumentedBehaviour,
};
pub use outline::{
    DeclaredVariable, StatedCall, StatedCase, StatedRoutine, StatedSwitch, StatedValue, UnreadValue,
};
pub use parse::parse;
pub use routines::Builtin;
pub use syntax::{Approximation, Binary, File, Motion};
pub use system::{Kss, LOWEST_KSS, SYSTEM_VARIABLES, SystemVariable};
