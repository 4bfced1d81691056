//! A search for cycles, and its results: pages of cycles, the newest first. The store executes the search. Dates in a
//! search are typed by people as a day, or as a day and a time, in UTC as on all pages.

use jiff::civil::{Date, DateTime};
use jiff::tz::Offset;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::record::{CycleId, PartNames};
use serde::Serialize;
use thiserror::Error;

/// Maximum number of cycles on one page of results.
pub const MAX_HITS_PER_PAGE: usize = 1_000;

/// How a cycle must have ended to match a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RequiredEnd {
    /// With this verdict.
    With(Verdict),
    /// The cycle has not ended yet.
    Running,
}

/// The criteria of a search. A criterion that is `None` or empty matches every cycle. In names, `*` matches any
/// characters, and upper and lower case of A to Z are equal; without `*`, the whole name must match.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Query {
    /// The part's serial number.
    pub serial: Option<String>,
    /// The work order of the part.
    pub order: Option<String>,
    /// The name of the panel.
    pub panel: Option<String>,
    /// The name of the operator, as stated at the start.
    pub operator: Option<String>,
    /// Earliest start time of the cycle, s since 1970.
    pub from_unix_s: Option<i64>,
    /// The cycle must have started before this time, s since 1970.
    pub until_unix_s: Option<i64>,
    /// How the cycle must have ended.
    pub end: Option<RequiredEnd>,
    /// Words that must all occur in the verdict's reasons, in a code or a message.
    pub words: Vec<String>,
    /// Only cycles before this one match; it is [`Hits::next`] of the previous page.
    pub before_cycle: Option<CycleId>,
    /// Maximum number of cycles, 1 to [`MAX_HITS_PER_PAGE`]; a value outside of this range is set to the nearest limit.
    pub limit: usize,
}

/// A cycle that matches a search.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Hit {
    /// Number of the cycle.
    pub cycle: CycleId,
    /// Start time of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// End time of the cycle, s since 1970; `None` while it runs.
    pub ended_unix_s: Option<i64>,
    /// Name of the panel.
    pub panel: String,
    /// The names of the part, as stated at the start.
    pub part: PartNames,
    /// The verdict; `None` while the cycle runs.
    pub verdict: Option<Verdict>,
    /// Whether the cycle was an air-run, whose verdict refers to the motions, not to the panel.
    pub is_air_run: bool,
    /// The reasons for the verdict.
    pub reasons: Vec<Reason>,
}

/// A page of search results.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Hits {
    /// The cycles, the newest first.
    pub hits: Vec<Hit>,
    /// The value of [`Query::before_cycle`] for the next page; `None` if there is no next page.
    pub next: Option<CycleId>,
}

impl Query {
    /// Returns the number of cycles on a page, within its limits.
    pub fn page_size(&self) -> usize {
        self.limit.clamp(1, MAX_HITS_PER_PAGE)
    }
}

/// Which time is meant by a date without a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// The first second of the day.
    Start,
    /// The first second of the next day.
    Behind,
}

/// The error for a text that is not a date.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "{found} is not a date: write a day as 2026-05-31, or a day and a time as 2026-05-31T09:00, both in UTC, years \
     1 to 9998"
)]
pub struct DateError {
    found: String,
}

/// Parses a date to seconds since 1970. If the text contains no time, `edge` determines whether the start or the end of
/// the day is returned.
///
/// # Errors
/// If the text is not a date.
pub fn unix_s(text: &str, edge: Edge) -> Result<i64, DateError> {
    let refused = || DateError { found: text.escape_debug().to_string() };
    // The library also parses other forms, such as week dates and time zones. They are refused, because their result
    // may not be what the person intended.
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

    /// Expected values: the output of `date -u -d 2024-02-29 +%s` and similar commands. The day after the leap day is
    /// in March.
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
