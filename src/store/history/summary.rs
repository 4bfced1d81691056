//! The summary of one cycle.

use super::past_cycle::{DiscWear, PastCycle};
use panelprep_base::verdict::{Check, Reason, Verdict};
use panelprep_cell::record::{Budget, Clock, CycleId, Kind, PartNames, name};
use serde::Serialize;

/// The results of one cycle. A value that was not measured is `None`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
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
    /// Whether the path was run in the air: the verdict is then about the motions, not about the panel.
    pub is_air_run: bool,
    /// How the cycle ended; `None` while it runs.
    pub verdict: Option<Verdict>,
    /// The reasons for the verdict.
    pub reasons: Vec<Reason>,
    /// Passes over the panel that are known to have touched it.
    pub passes: u8,
    /// The films.
    pub films: Films,
    /// The residual of the localization, point to plane, mm, with its limit.
    pub localization_residual: Option<Check>,
    /// The residual of the outline, px, with its limit.
    pub outline_residual: Option<Check>,
    /// The stated error of the localization at the panel's worst place, 95 %, mm, with its limit.
    pub localization_error: Option<Check>,
    /// The error at the tool, divided into its parts, mm, 95 %.
    pub budget: Option<Budget>,
    /// The root of the sum of squares of the budget's parts, mm; `None` while a part is not measured.
    pub budget_total_mm: Option<f64>,
    /// Duration of the cycle by the wall clock, s.
    pub cycle_time_s: Option<i64>,
    /// Duration of the cycle by the simulated cell's clock, s.
    pub simulated_s: Option<f64>,
    /// The disc; `None` if the cycle touched nothing.
    pub disc: Option<DiscWear>,
}

/// The films of a cycle.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Films {
    /// Films with a valid result.
    pub valid: usize,
    /// Films without a valid result; they were repeated, or ended the cycle.
    pub invalid: usize,
    /// Total time for which the valid films were watched, s.
    pub watched_s: Option<f64>,
    /// Number of grids that the first valid film reports.
    pub grids: usize,
    /// Grids on which the first valid film broke; `None` without a valid film.
    pub failed_first: Option<Vec<String>>,
    /// Grids on which the last valid film broke; `None` without a valid film.
    pub failed_at_end: Option<Vec<String>>,
}

/// Summarises a cycle.
pub fn summary(past: &PastCycle) -> Summary {
    let record = &past.record;
    let located = |name: &str| past.last_check(Kind::Locate, name).cloned();
    let (verdict, reasons) = match record.judgement.clone() {
        Some(judgement) => (Some(judgement.verdict), judgement.reasons),
        None => (None, Vec::new()),
    };
    Summary {
        cycle: record.id,
        started_unix_s: record.started_unix_s,
        ended_unix_s: record.ended_unix_s,
        panel: record.panel.clone(),
        part: past.part.clone().unwrap_or_default(),
        is_air_run: record.is_air_run(),
        verdict,
        reasons,
        passes: past.touching_passes(),
        films: films(past),
        localization_residual: located(name::RESIDUAL),
        outline_residual: located(name::OUTLINE_RESIDUAL),
        localization_error: located(name::LOCATION_ERROR),
        budget: record.budget,
        budget_total_mm: record.budget.and_then(|budget| budget.total_mm()),
        cycle_time_s: past.cycle_time_s(),
        simulated_s: match record.clocks {
            [Some(Clock::Simulated { at_ms: from }), Some(Clock::Simulated { at_ms: to })] => {
                to.checked_sub(from).map(|ms| ms as f64 / 1_000.0)
            }
            _ => None,
        },
        disc: past.disc,
    }
}

pub(super) fn films(past: &PastCycle) -> Films {
    let valid = past.films().count();
    let watched: Vec<f64> = past.films().filter_map(|film| film.number(name::WATCHED_TIME_NAME)).collect();
    let failed = |film: Option<&panelprep_cell::record::Finding>| film.map(|film| film.names("failed"));
    Films {
        valid,
        invalid: past.findings(Kind::Inspect).count() - valid,
        watched_s: (!watched.is_empty()).then(|| watched.iter().sum()),
        grids: past.films().next().map_or(0, |film| super::grid::reported_grids(film).len()),
        failed_first: failed(past.films().next()),
        failed_at_end: failed(past.films().next_back()),
    }
}
