//! Strict reading of configuration: every problem of a file at once, each with line, key and the nearest valid name.
//!
//! `serde` stops at the first unknown field. Therefore a file is parsed to toml's spanned tree, and each known key is
//! *taken* from it; a key that was not taken is unknown. Nothing is corrected: a value out of range is a problem, and
//! a file with one problem gives no checked form. The input is a text, the result is its values; the caller reads the
//! file.

mod document;
mod edit;
mod nearest;
mod place;
mod problem;
mod reading;
mod section;
mod settings;
mod syntax;
mod value;

#[cfg(test)]
mod tests;

pub use document::{parse_file, top_keys};
pub use edit::set_value;
pub use nearest::nearest;
pub use place::key_line;
pub use problem::{Problem, Problems};
pub use section::Section;
pub use value::{Choice, Setting};

pub use settings::{copy_value, settings};
