//! A search for cycles and its results: the newest first, page by page. The store executes the search. The dates of a
//! search are parsed as people type them: a day, or a day with a time, in UTC as on all pages.

use jiff::civil::{Date, DateTime};
use jiff::tz::Offset;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::record::{CycleId, PartNames};
use serde::Serialize;
use thiserror::Error;

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
    /// Whether the cycle was an air-run: the verdict is then about the motions, not about the panel.
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

/// The second of the day that is used if a typed date has no time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// The first second of the day.
    Start,
    /// The first second of the next day.
    Behind,
}

/// The typed text is not a date.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "{found} is not a date: write a day as 2026-05-31, or a day and a time as 2026-05-31T09:00, both in UTC, years \
     1 to 9998"
)]
pub struct DateError {
    found: String,
}

/// Returns a typed date as seconds since 1970. If it has no time, `edge` selects the second of the day.
///
/// # Errors
/// If the text is not a date.
pub fn unix_s(text: &str, edge: Edge) -> Result<i64, DateError> {
    let refused = || DateError { found: text.escape_debug().to_string() };
    // The calendar library also reads other forms, such as week dates and time zones. It would accept them with a
    // meaning that the person did not intend.
    let is_plain = text.bytes().all(|byte| byte.is_ascii_digit() || b"-:T".contains(&byte));
    let time = match (is_plain, text.len()) {
        (true, 10) => {
            let day: Date = text.parse().map_err(|_| refused())?;
            match edge {
                Edge::Start => day,
                Edge::Behind => day.tomorrow().map_err(|_| refused())?,
            }
            .to_datetime(jiff::civil::Time::midnight())
        }
        (true, 16 | 19) => text.parse::<DateTime>().map_err(|_| refused())?,
        _ => return Err(refused()),
    };
    Offset::UTC.to_timestamp(time).map(|at| at.as_second()).map_err(|_| refused())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values from `date -u -d 2024-02-29 +%s` and similar commands; the day after a leap day is in March.
    #[test]
    fn a_day_begins_and_ends_as_in_the_calendar() {
        for (text, edge, expected) in [
            ("1970-01-01", Edge::Start, 0),
            ("1970-01-01", Edge::Behind, 86_400),
            ("2024-02-29", Edge::Start, 1_709_164_800),
            ("2024-02-29", Edge::Behind, 1_709_251_200),
            ("2026-11-21T21:43", Edge::Start, 1_795_297_380),
            ("2026-11-21T21:43:52", Edge::Behind, 1_795_297_432),
        ] {
            assert_eq!(unix_s(text, edge), Ok(expected), "{text}");
        }
    }

    #[test]
    fn an_invalid_date_is_refused_with_the_valid_form() {
        for text in
            ["", "2026-02-30", "31.05.2026", "2026-5-31", "2026-W22-7", "2026-05-31T25:00", "2026-05-31Z", "<b>"]
        {
            let error = unix_s(text, Edge::Start).expect_err(text).to_string();
            assert!(error.contains("2026-05-31T09:00"), "{error}");
        }
    }
}
