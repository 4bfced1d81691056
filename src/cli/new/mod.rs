//! `panelprep new cell` and `new recipe`: a commented file to begin with.
//!
//! The text is that of the samples in `config/`, with its comments; answers are set in it. What is written was checked as
//! `panelprep check` checks it, and no file is written over.
//!
//! - `ask`: questions and answers · `connected`: what answers at the cell · `cell` · `recipe`

mod ask;
mod cell;
mod connected;
mod recipe;

use super::args::{Common, New, NewFile};
use super::fault::Fault;
use super::outcome::Outcome;
use crate::config::set_value;
use toml_edit::{DocumentMut, Value};

/// Asks, and writes the file.
///
/// # Errors
/// Where a question has no answer, an answer cannot be taken, or the file is there already.
pub fn run(args: &New, common: &Common) -> Result<Outcome, Fault> {
    match &args.what {
        NewFile::Cell(args) => cell::run(args, common),
        NewFile::Recipe(args) => recipe::run(args, common),
    }
}

/// Sets a value of a file's text, in a table that is there; the comment beside it stays.
fn set(document: &mut DocumentMut, table: &str, key: &str, value: impl Into<Value>) {
    let mut below = table.split('.').filter(|name| !name.is_empty());
    let home = below.try_fold(document.as_table_mut(), |home, name| home.get_mut(name)?.as_table_mut());
    if let Some(home) = home {
        set_value(home, key, value);
    }
}
