//! A search for cycles and what it finds: the newest first, page by page. The store executes it.

use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::record::{CycleId, PartNames};
use serde::Serialize;

/// Largest number of cycles on one page of results.
pub const MAX_HITS: usize = 1_000;

/// The required end of a cycle in a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RequiredEnd {
    /// With this verdict.
    With(Verdict),
    /// The cycle has not ended yet.
    Running,
}

/// The search criteria; a criterion that is `None` or empty matches every cycle. In names `*` matches any characters,
/// and the letters A to Z equal a to z; without `*` the whole name must match.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Query {
    /// The part's serial number.
    pub serial: Option<String>,
    /// The work order.
    pub order: Option<String>,
    /// The panel.
    pub panel: Option<String>,
    /// The operator, as named at the start.
    pub operator: Option<String>,
    /// The cycle began at this time or later, s since 1970.
    pub from_unix_s: Option<i64>,
    /// The cycle began before this time, s since 1970.
    pub until_unix_s: Option<i64>,
    /// Required end of the cycle.
    pub end: Option<RequiredEnd>,
    /// Each of these words must occur in a reason of the verdict: in its code or its sentence.
    pub words: Vec<String>,
    /// Only cycles before this one: the [`Hits::next`] of the previous page.
    pub before_cycle: Option<CycleId>,
    /// Largest number of cycles, 1 to [`MAX_HITS`]; a value outside this range is set to the nearest limit.
    pub limit: usize,
}

/// A cycle that was found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Hit {
    /// Its number.
    pub cycle: CycleId,
    /// Time at which the cycle began, s since 1970.
    pub started_unix_s: i64,
    /// Time at which the cycle ended, s since 1970; `None` while it runs.
    pub ended_unix_s: Option<i64>,
    /// The panel.
    pub panel: String,
    /// The part, with the names that were entered.
    pub part: PartNames,
    /// How the cycle ended; `None` while it runs.
    pub verdict: Option<Verdict>,
    /// Whether the path was run in the air: the verdict is then about the motions, not about the panel.
    pub is_air_run: bool,
    /// The reasons for the verdict.
    pub reasons: Vec<Reason>,
}

/// One page of a search.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Hits {
    /// The cycles, the newest first.
    pub hits: Vec<Hit>,
    /// The start of the next page, as [`Query::before_cycle`]; `None` if there is no next page.
    pub next: Option<CycleId>,
}

impl Query {
    /// Returns the page size that applies.
    pub fn page_size(&self) -> usize {
        self.limit.clamp(1, MAX_HITS)
    }
}
