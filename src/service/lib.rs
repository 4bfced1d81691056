//! The service of a cell: stages, checks, reports, the set-up and the loop.
//!
//! Each paragraph of `pub mod` lines is a layer; a module may name only modules of earlier paragraphs.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// Every result is handled, or an `expect` attribute next to the call states why the result is ignored.
#![cfg_attr(not(test), deny(clippy::let_underscore_must_use))]
// `println!` and similar macros panic if their output is closed: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod report;

pub mod requirements;
pub mod stages;

pub mod check;

pub mod setup;

pub mod daemon;
