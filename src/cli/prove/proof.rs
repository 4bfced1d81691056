//! A row of the installation page, and its result.

/// A row of the table on the installation page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Assumption {
    /// The row's number on the installation page.
    pub(super) number: u32,
    pub(super) assumed: String,
    pub(super) to_do: String,
}

/// The result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub(super) enum Finding {
    Proven,
    Wrong,
    Open,
}

impl Finding {
    pub(super) fn word(self) -> &'static str {
        self.into()
    }
}

/// One line of the page of proofs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Proof {
    pub(super) assumption: Assumption,
    pub(super) finding: Finding,
    pub(super) evidence: String,
    /// Whether this program tested the assumption; otherwise the person reported the result.
    pub(super) tried: bool,
}
