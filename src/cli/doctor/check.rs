//! One line of the doctor's list.

/// What is known of a thing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cli) enum Status {
    /// Nothing is wrong with it.
    Right,
    /// Something is wrong with it.
    Wrong,
    /// It was not looked at, which counts as a failure.
    Open,
}

/// One thing on the list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::cli) struct Check {
    /// What it is.
    pub name: String,
    /// Its status.
    pub status: Status,
    /// What was found.
    pub found: String,
    /// What to do about it; empty if it is right.
    pub advice: String,
}

impl Check {
    /// Whether nothing is wrong with it, by what was looked at.
    pub fn is_right(&self) -> bool {
        self.status == Status::Right
    }

    pub(super) fn right(name: impl Into<String>, found: impl Into<String>) -> Self {
        Check { name: name.into(), status: Status::Right, found: found.into(), advice: String::new() }
    }

    pub(super) fn open(name: impl Into<String>, why: &str, advice: impl Into<String>) -> Self {
        Check {
            name: name.into(),
            status: Status::Open,
            found: format!("not looked at{why}"),
            advice: advice.into(),
        }
    }

    pub(super) fn wrong(name: impl Into<String>, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Check { name: name.into(), status: Status::Wrong, found: found.into(), advice: advice.into() }
    }
}
