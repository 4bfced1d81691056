//! The command line: reads files, calls the phases, writes files and words. The only place with a clock and a disk
//! beside the store, and the one place that turns errors into words.

pub mod args;
mod disk;
mod fault;
mod outcome;
