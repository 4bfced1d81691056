//! `panelprep new cell` and `new recipe`: a commented file to start from.
//!
//! The text is that of the samples in `config/`, with its comments; answers are set in it. The written file has passed
//! the checks of `panelprep check`, and no file is overwritten.
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
/// If a question has no answer, an answer is not accepted, or the file exists already.
pub fn run(args: &New, common: &Common) -> Result<Outcome, Fault> {
    match &args.what {
        NewFile::Cell(args) => cell::run(args, common),
        NewFile::Recipe(args) => recipe::run(args, common),
    }
}
