//! The development of a quantity of a panel over its cycles, with the limit with which each value was compared.

use super::past_cycle::PastCycle;
use super::quantity::Quantity;
use super::western_electric::{Hint, UsualRange, find_violations, usual_range};
use panelprep_base::verdict::Limit;
use panelprep_cell::record::CycleId;
use serde::Serialize;

/// One value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrendPoint {
    /// The cycle; `None` for a verification, which belongs to no cycle.
    pub cycle: Option<CycleId>,
    /// Time at which the cycle began, or the verification was made, s since 1970.
    pub at_unix_s: i64,
    /// The part's serial number.
    pub serial: Option<String>,
    /// The value.
    pub value: f64,
    /// The limit at that time.
    pub limit: Limit,
}

/// A number over time, the oldest first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trend {
    /// Title of the trend.
    pub title: String,
    /// Its unit; empty for ratios and counts.
    pub unit: String,
    /// The values.
    pub points: Vec<TrendPoint>,
    /// Number of cycles that were searched and do not have this quantity.
    pub without: usize,
    /// The usual value and scatter; `None` if there are too few values.
    pub usual: Option<UsualRange>,
    /// Points that violate a Western Electric rule: hints, in the order of the points.
    pub hints: Vec<Hint>,
}

impl Trend {
    /// Creates a trend from values, the oldest first.
    pub fn from_points((title, unit): (String, String), points: Vec<TrendPoint>, without: usize) -> Self {
        let values: Vec<f64> = points.iter().map(|point| point.value).collect();
        let usual = usual_range(&values);
        let hints = usual.map_or(Vec::new(), |usual| find_violations(&values, usual));
        Trend { title, unit, points, without, usual, hints }
    }
}

/// Returns the trend of a quantity over these cycles, the oldest first. Cycles that ran in the air, or that found no
/// part, are left out.
pub fn trend(quantity: &Quantity, cycles: &[PastCycle]) -> Trend {
    let over_panels: Vec<&PastCycle> =
        cycles.iter().filter(|past| !past.record.is_air_run() && !past.record.has_no_part()).collect();
    let point = |past: &&PastCycle| {
        let (value, limit) = quantity.value_and_limit(past)?;
        Some(TrendPoint {
            cycle: Some(past.record.id),
            at_unix_s: past.record.started_unix_s,
            serial: past.part.as_ref().and_then(|part| part.serial.clone()),
            value,
            limit,
        })
    };
    let points: Vec<TrendPoint> = over_panels.iter().filter_map(point).collect();
    let without = over_panels.len() - points.len();
    Trend::from_points(quantity.title_and_unit(cycles), points, without)
}
