//! Strict reading of configuration: every problem of a file at once, each with line, key and the nearest right name.
//!
//! `serde` stops at the first unknown field, so a file is parsed to toml's spanned tree and each known key is
//! *taken* from it; what was not taken is unknown. Nothing is repaired: a value out of range is a problem, and a
//! file with one problem yields no checked form. Text in, values out; reading the disk is the caller's work.

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

pub use document::{check, top_keys};
pub use edit::set_value;
pub use nearest::nearest;
pub use place::line_of_key;
pub use problem::{Problem, Problems};
pub use section::Section;
pub use value::{Choice, Setting};

pub(crate) use settings::{same, settings};
