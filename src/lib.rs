//! Panelprep: finds a free-form panel, watches water run off it, abrades where the film broke.
//!
//! The map of the house. Each paragraph of `pub mod` lines is a layer; a module may name only modules of earlier
//! paragraphs. `tests/layers.rs` reads this file and the code and holds both to it.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// `println!` and its kin panic where nobody reads: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod words;

pub mod geometry;

pub mod sim;

pub mod config;
pub mod imaging;
pub mod phase;
pub mod verdict;

pub mod krl;

pub mod cell;
pub mod recipe;

pub mod panel;

pub mod calib;
pub mod inspect;
pub mod locate;
pub mod surface;

pub mod path;

pub mod cycle;
pub mod requirements;

pub mod check;
pub mod eki;

pub mod files;
pub mod labels;
pub mod record;

pub mod report;
pub mod tape;

pub mod disk;
pub mod store;
pub mod supervision;

pub mod backup;

pub mod devices;

pub mod daemon;
pub mod page;

pub mod cli;
