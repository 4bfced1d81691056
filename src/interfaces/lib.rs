//! The interfaces to other programs and to people: pages, PackML, Sparkplug, broker and archive.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// Every result is handled, or an `expect` attribute next to it states why it is ignored.
#![cfg_attr(not(test), deny(clippy::let_underscore_must_use))]
// `println!` and similar macros panic if nothing reads the output: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

#[cfg(feature = "plant")]
pub mod broker;
pub mod packml;
pub mod page;

#[cfg(feature = "plant")]
pub mod archive;
pub mod sparkplug;
