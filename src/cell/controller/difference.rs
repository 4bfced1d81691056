//! The findings when files contradict each other.

use panelprep_base::config::Problem;

/// A contradiction between two files.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// The name of the controller's file, without its folder.
    pub file: &'static str,
    /// Line and key, the value that was found, the expected value, and what to do.
    pub problem: Problem,
}

/// The differences found so far.
#[derive(Default)]
pub(super) struct Differences(pub(super) Vec<Difference>);

impl Differences {
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
