//! Notes on problems that are found while a file is read.

use panelprep_base::config::Problem;

/// Errors and doubts in one file, in the order in which they were found.
#[derive(Debug, Default)]
pub struct Findings {
    /// Entries that the controller refuses or cannot work with.
    pub problems: Vec<Problem>,
    /// Entries that the controller accepts but that cause problems, with all entries of `unknown`.
    pub warnings: Vec<Problem>,
    /// Names and texts that are in no manual.
    pub unknown: Vec<Problem>,
}

impl Findings {
    /// Notes a problem.
    pub fn add_problem(&mut self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        self.problems.push(Problem { line, key: key.into(), message: message.into() });
    }

    /// Notes a warning.
    pub fn warn(&mut self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        self.warnings.push(Problem { line, key: key.into(), message: message.into() });
    }

    /// Notes a name or a text that is in no manual, which is a warning.
    pub(super) fn unknown(&mut self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        let warning = Problem { line, key: key.into(), message: message.into() };
        self.unknown.push(warning.clone());
        self.warnings.push(warning);
    }
}
