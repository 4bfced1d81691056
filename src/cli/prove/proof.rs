//! A row of the installation page, and its result.

use panelprep_cell::cell::ProofStage;

/// A row of the table on the installation page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Assumption {
    /// The stage in which it is proven.
    pub(super) stage: ProofStage,
    /// The row's number on the installation page.
    pub(super) number: u32,
    pub(super) assumed: String,
    pub(super) to_do: String,
    /// Expected observation if the assumption holds.
    pub(super) to_see: String,
    /// Consequence if the assumption does not hold.
    pub(super) otherwise: String,
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
    pub(super) fn keyword(self) -> &'static str {
        self.into()
    }
}

/// Why a row is open that was not reached.
const NOT_DONE: &str = "not done";

impl Proof {
    /// Returns the proof of a row before anything was done.
    pub(super) fn open(assumption: Assumption) -> Self {
        Proof { assumption, finding: Finding::Open, evidence: NOT_DONE.to_owned(), tried: false }
    }

    /// Returns whether the row is proven, with evidence.
    pub(super) fn is_proven(&self) -> bool {
        self.finding == Finding::Proven && !self.evidence.is_empty()
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
