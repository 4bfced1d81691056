//! One line of the doctor's list.

/// The status of a checked item.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cli) enum Status {
    /// The item was checked and nothing is wrong.
    Right,
    /// Something is wrong with the item.
    Wrong,
    /// The item was not checked, which counts as a failure.
    Open,
}

/// One item on the list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::cli) struct Check {
    /// Name of the checked item.
    pub name: String,
    /// Its status.
    pub status: Status,
    /// Result of the check.
    pub found: String,
    /// Remedy; empty if the check passed.
    pub advice: String,
}

impl Check {
    /// Whether the item was checked and nothing is wrong with it.
    pub fn is_passed(&self) -> bool {
        self.status == Status::Right
    }

    pub(super) fn passed(name: impl Into<String>, found: impl Into<String>) -> Self {
        Check { name: name.into(), status: Status::Right, found: found.into(), advice: String::new() }
    }

    pub(super) fn open(name: impl Into<String>, why: &str, advice: impl Into<String>) -> Self {
        Check { name: name.into(), status: Status::Open, found: format!("not checked{why}"), advice: advice.into() }
    }

    pub(super) fn failed(name: impl Into<String>, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Check { name: name.into(), status: Status::Wrong, found: found.into(), advice: advice.into() }
    }
}
