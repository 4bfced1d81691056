//! The requirements on a cell's file, and which of them it does not meet.

use panelprep_base::config::{Problem, key_line};

/// The intended use of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// A single function of the robot.
    Robot,
    /// A cycle, or the cycle's path in the air.
    Cycle,
}

impl Purpose {
    /// Returns the commands for this use.
    pub fn commands(self) -> &'static str {
        match self {
            Purpose::Robot => "`panelprep robot` and `mock-robot`",
            Purpose::Cycle => "`panelprep cycle`, `air-run` and `run`",
        }
    }
}

/// A requirement that a cell's file does not state, or states with a value that is not possible.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnmetRequirement {
    /// The key with its tables, `poses.park.a1_deg`.
    pub key: String,
    /// The value found, the value needed, and the action.
    pub message: String,
    /// The kind of the problem.
    pub kind: ProblemKind,
}

/// The kind of problem in a cell's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProblemKind {
    /// A value is missing or not possible.
    Value,
    /// A file that the cell's file names is missing: it may still be created.
    MissingFile,
    /// A file that the cell's file names exists, but is not valid.
    WrongFile,
    /// The programs of a real controller were not accepted: the cell may be commissioned, but no cycle starts.
    Acceptance,
}

impl UnmetRequirement {
    pub(super) fn new(key: impl Into<String>, message: impl Into<String>) -> Self {
        UnmetRequirement { key: key.into(), message: message.into(), kind: ProblemKind::Value }
    }
}

/// Returns the problems of a file with this text, each at the line of its key, in the order of the lines.
pub fn to_problems(text: &str, unmet: Vec<UnmetRequirement>) -> Vec<Problem> {
    let problem = |UnmetRequirement { key, message, .. }| Problem { line: key_line(text, &key), key, message };
    let mut problems: Vec<Problem> = unmet.into_iter().map(problem).collect();
    problems.sort_by_key(|problem| problem.line);
    problems
}
