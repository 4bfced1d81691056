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
mod setting;

use super::args::{Common, New, NewFile};
use super::fault::Fault;
use super::outcome::Outcome;

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
