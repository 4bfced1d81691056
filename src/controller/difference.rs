//! The findings when files contradict each other.

use crate::config::Problem;

/// A place at which two files contradict each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// The controller's file, by its name without folder.
    pub file: &'static str,
    /// Line, key, and what was found, what is expected and what to do.
    pub problem: Problem,
}

/// What was found so far.
#[derive(Default)]
pub(super) struct Found(pub(super) Vec<Difference>);

impl Found {
    pub(super) fn push(&mut self, difference: Difference) {
        self.0.push(difference);
    }

    pub(super) fn note(
        &mut self,
        file: &'static str,
        line: usize,
        key: impl Into<String>,
        message: impl Into<String>,
    ) {
        self.0.push(Difference { file, problem: Problem { line, key: key.into(), message: message.into() } });
    }
}
