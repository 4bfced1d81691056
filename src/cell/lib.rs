//! The data types of a cell and its work: cell, recipe, panel, cycle, record, and their files.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// Every result is handled, or an `expect` attribute next to it states why it is ignored.
#![cfg_attr(not(test), deny(clippy::let_underscore_must_use))]
// `println!` and similar macros panic if nothing reads the output: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod accounts;
pub mod cycle;

pub mod cell;
pub mod imaging;
pub mod labels;
pub mod recipe;
pub mod record;

pub mod controller;
pub mod force;
pub mod line;
pub mod panel;

pub mod files;
