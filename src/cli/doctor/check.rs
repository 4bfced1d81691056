//! One line of the doctor's list.

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::cli) struct Check {
    /// What it is.
    pub name: String,
    /// Nothing is wrong with it.
    pub ok: bool,
    /// What was found.
    pub found: String,
    /// What to do about it; empty where it is right.
    pub advice: String,
}

impl Check {
    pub(super) fn right(name: impl Into<String>, found: impl Into<String>) -> Self {
        Check { name: name.into(), ok: true, found: found.into(), advice: String::new() }
    }

    pub(super) fn wrong(name: impl Into<String>, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Check { name: name.into(), ok: false, found: found.into(), advice: advice.into() }
    }
}
