//! A search for cycles and what it finds: the newest first, page by page. The store executes it.

use crate::record::{CycleId, PartNames};
use crate::verdict::{Reason, Verdict};
use serde::Serialize;

/// Cycles on one page of results at most.
pub const MAX_HITS: usize = 1_000;

/// How a cycle must have ended to be found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// With this verdict.
    With(Verdict),
    /// Not at all so far.
    Running,
}

/// The search criteria; one that is `None` or empty does not matter. In names `*` matches any characters, and the
/// letters A to Z equal a to z; without `*` the whole name must match.
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
    /// Begun at this time or later, s since 1970.
    pub from_unix_s: Option<i64>,
    /// Begun before this time, s since 1970.
    pub until_unix_s: Option<i64>,
    /// How it ended.
    pub end: Option<End>,
    /// Each of these words is in a reason of the verdict: in its code or its sentence.
    pub words: Vec<String>,
    /// Cycles before this one: the [`Hits::next`] of the page before.
    pub before: Option<CycleId>,
    /// Cycles at most, 1 to [`MAX_HITS`]; what is outside of that counts as the nearest of them.
    pub limit: usize,
}

/// A cycle that was found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Hit {
    /// Its number.
    pub cycle: CycleId,
    /// When it began, s since 1970.
    pub started_unix_s: i64,
    /// When it ended, s since 1970; `None` while it runs.
    pub ended_unix_s: Option<i64>,
    /// The panel.
    pub panel: String,
    /// The part, as it was named.
    pub part: PartNames,
    /// How it ended; `None` while it runs.
    pub verdict: Option<Verdict>,
    /// Whether the path was run in the air: its verdict is of the motions, not of the panel.
    pub is_air_run: bool,
    /// Why it ended so.
    pub reasons: Vec<Reason>,
}

/// One page of a search.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Hits {
    /// The cycles, the newest first.
    pub hits: Vec<Hit>,
    /// The start of the next page, as [`Query::before`]; `None` if there is no next page.
    pub next: Option<CycleId>,
}

impl Query {
    /// The limit that counts.
    pub fn page_size(&self) -> usize {
        self.limit.clamp(1, MAX_HITS)
    }
}
