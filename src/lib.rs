//! Panelprep: finds a free-form panel, watches water run off it, abrades the places at which the film broke.
//!
//! The map of the code. Each paragraph of `pub mod` lines is a layer; a module may name only modules of earlier
//! paragraphs. `tests/layers.rs` reads this file and the code and checks that both follow this rule. Only `disk`,
//! `supervision`, `trust`, `store`, `backup`, `broker`, `page`, `devices`, `archive`, `daemon` and `cli` use disk,
//! sockets, processes and clocks.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// Every result is handled, or an `expect` attribute next to it states why it is ignored.
#![cfg_attr(not(test), deny(clippy::let_underscore_must_use))]
// `println!` and similar macros panic if nothing reads the output: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod config;
pub mod disk;
pub mod number_text;
pub mod phase;
pub mod random;
pub mod supervision;
pub mod verdict;

pub mod accounts;
pub mod cycle;
pub mod geometry;
pub mod krl;
pub mod trust;

pub mod cell;
pub mod eki;
pub mod files;
pub mod imaging;
pub mod labels;
pub mod recipe;
pub mod record;
pub mod sim;

pub mod controller;
pub mod force;
pub mod history;
pub mod line;
pub mod nominal;
pub mod panel;
pub mod signing;
pub mod tape;

pub mod calib;
pub mod inspect;
pub mod locate;
pub mod office;
pub mod surface;

pub mod broker;
pub mod packml;
pub mod page;
pub mod path;
pub mod removal;
pub mod report;
pub mod store;

pub mod archive;
pub mod backup;
pub mod devices;
pub mod requirements;
pub mod sparkplug;
pub mod stages;

pub mod check;
pub mod daemon;

pub mod cli;
