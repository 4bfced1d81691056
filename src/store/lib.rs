//! Persistent data: the store, recordings, signatures, history, backups, and the messages to the office server.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// Every result is handled, or an `expect` attribute next to it states why it is ignored.
#![cfg_attr(not(test), deny(clippy::let_underscore_must_use))]
// `println!` and similar macros panic if nothing reads the output: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod history;
pub mod signing;
pub mod tape;

pub mod office;

pub mod store;

pub mod backup;
