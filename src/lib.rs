//! Panelprep: finds a free-form panel, watches water run off it, abrades the places at which the film broke.
//!
//! The crates below `src/` contain the modules; each crate uses only crates before it in this list. This crate adds the
//! commands, and the names under which tests and benches reach all modules.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// Every result is handled, or an `expect` attribute next to it states why it is ignored.
#![cfg_attr(not(test), deny(clippy::let_underscore_must_use))]
// `println!` and similar macros panic if nothing reads the output: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub use panelprep_base::{config, disk, geometry, number_text, phase, random, supervision, trust, verdict};
pub use panelprep_cell::{
    accounts, cell, controller, cycle, files, force, imaging, labels, line, panel, recipe, record,
};
pub use panelprep_devices as devices;
#[cfg(feature = "plant")]
pub use panelprep_interfaces::{archive, broker};
pub use panelprep_interfaces::{packml, page, sparkplug};
pub use panelprep_kuka::{eki, krl};
pub use panelprep_service::{check, daemon, report, requirements, setup, stages};
pub use panelprep_sim as sim;
pub use panelprep_store::{backup, history, office, signing, store, tape};
pub use panelprep_toolpath::{path, removal, surface};
pub use panelprep_vision::{calib, inspect, locate, nominal};

pub mod cli;
