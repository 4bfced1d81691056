//! Strict reading of configuration: every problem of a file at once, each with line, key and the nearest valid name.
//!
//! `serde` stops at the first unknown field. Therefore a file is parsed to toml's spanned tree, and each known key is
//! *taken* from it; a key that was not taken is unknown. Nothing is corrected: a value out of range is a problem, and
//! a file with one problem gives no checked form. The input is a text, the result is its values; the caller reads the
//! file.

mod document;
mod problem;
mod value;

#[cfg(test)]
mod tests;

pub use document::{Section, copy_value, parse_file, settings, top_keys};
pub use problem::{Problem, Problems, key_line, nearest};
pub use value::{Choice, Setting, set_value};
