//! The requirements on a cell's file, and which of them it does not meet.

use crate::config::{Problem, line_of_key};

/// What is to be done with a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// One function of the robot at a time.
    Robot,
    /// A cycle, or its path in the air.
    Cycle,
}

impl Purpose {
    /// The commands that do it.
    pub fn commands(self) -> &'static str {
        match self {
            Purpose::Robot => "`panelprep robot` and `mock-robot`",
            Purpose::Cycle => "`panelprep cycle`, `air-run` and `run`",
        }
    }
}

/// A requirement that a cell's file does not state, or states in a way that cannot be done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unmet {
    /// The key with its tables, `poses.park.a1_deg`.
    pub key: String,
    /// What was found, what is needed, what to do.
    pub message: String,
    /// What is the matter.
    pub lack: Lack,
}

/// In what a cell's file falls short.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lack {
    /// A value is not there, or cannot be done.
    Value,
    /// A file that it names is not there: it may still be made.
    MissingFile,
    /// A file that it names exists and is not right.
    WrongFile,
}

impl Unmet {
    pub(super) fn new(key: impl Into<String>, message: impl Into<String>) -> Self {
        Unmet { key: key.into(), message: message.into(), lack: Lack::Value }
    }
}

/// What a file with this text falls short of, each at the line of its key, in the order of the lines.
pub fn problems_of(text: &str, unmet: Vec<Unmet>) -> Vec<Problem> {
    let problem = |Unmet { key, message, .. }| Problem { line: line_of_key(text, &key), key, message };
    let mut problems: Vec<Problem> = unmet.into_iter().map(problem).collect();
    problems.sort_by_key(|problem| problem.line);
    problems
}
