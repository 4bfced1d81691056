//! The interface to the KUKA controller: the language KRL, and the messages of EthernetKRL.
//!
//! Each paragraph of `pub mod` lines is a layer; a module may use only modules of earlier paragraphs.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// Every result is handled, or an `expect` attribute next to it states why it is ignored.
#![cfg_attr(not(test), deny(clippy::let_underscore_must_use))]
// `println!` and similar macros panic if nothing reads the output: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod krl;

pub mod eki;
