//! KUKA's robot language KRL: parser, checker, and compiler for the language features that the cell's programs use. The
//! mock controller executes the compiled programs. `panelprep check` uses the same parser for the programs of other
//! people.
//!
//! There are three groups of statements. Supported and executed: the statements of the shipped programs. Only checked,
//! so that the execution stops with a message that contains the line: GOTO, circles, splines, relative motions, strings
//! in variables, names that no file declares. Not parsed: all others, with a warning that contains the line and begins
//! with "not checked". README.md beside this file states the source of each rule.
//!
//! - the text: `lex` (a line to tokens), `parse`, `statement` and `expression` (lines to a tree), `syntax` (the tree,
//!   and the limits of time, memory and recursion depth for any input)
//! - the meaning: `types` (with the memory size of each), `system` (the controller's system variables), `routines` (the
//!   controller's own routines), `compile` (names, types, steps), `code` (the steps, and their combined form),
//!   `machine` (executes the steps)

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
pub use lex::RESERVED_WORDS;
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
