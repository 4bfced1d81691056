//! `panelprep new cell` and `new recipe`: write a file with comments as a starting point.
//!
//! The text is that of the samples in `config/` with their comments, with the answers as values. The written file
//! passes `panelprep check`. No file is overwritten.
//!
//! - `questions`: questions and answers · `cell` · `recipe`

mod cell;
mod questions;
mod recipe;

use super::args::{Common, New, NewFile};
use super::fault::Fault;
use super::output::Outcome;

/// Asks the questions and writes the file.
///
/// # Errors
/// If a question is not answered, an answer is not valid, or the file already exists.
pub fn run(args: &New, common: &Common) -> Result<Outcome, Fault> {
    match &args.what {
        NewFile::Cell(args) => cell::run(args, common),
        NewFile::Recipe(args) => recipe::run(args, common),
    }
}
