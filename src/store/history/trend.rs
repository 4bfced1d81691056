//! The measured values of a panel over many cycles.
//!
//! [`trend`] returns the development of a quantity, with the limit of each value at that time. A [`Quantity`] is a
//! value of a cycle for which a trend is useful; it has a keyword for the command line and a location in a record.
//! [`heat_map`] shows where the film breaks first: statistics of all grids of a panel over many parts of the same kind,
//! from the first valid film of each cycle.

use super::past_cycle::{PastCycle, grid_row_and_column};
use super::western_electric::{Hint, UsualRange, find_violations, usual_range};
use panelprep_base::geometry::interpolated_median;
use panelprep_base::verdict::{Check, Limit};
use panelprep_cell::record::{CycleId, Kind, name};
use serde::Serialize;
use std::collections::BTreeMap;
use std::str::FromStr;
use strum::IntoEnumIterator;

/// A value of a trend.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrendPoint {
    /// The cycle; `None` for a verification, which belongs to no cycle.
    pub cycle: Option<CycleId>,
    /// Start time of the cycle, or time of the verification, s since 1970.
    pub at_unix_s: i64,
    /// The part's serial number.
    pub serial: Option<String>,
    /// The value of the quantity.
    pub value: f64,
    /// The limit of the value at that time.
    pub limit: Limit,
}

/// The trend of a quantity, the oldest value first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trend {
    /// Title of the trend.
    pub title: String,
    /// Unit of the values; empty for ratios and counts.
    pub unit: String,
    /// The values, the oldest first.
    pub points: Vec<TrendPoint>,
    /// Number of cycles without this quantity.
    pub without: usize,
    /// Mean and standard deviation of the usual values; `None` if there are too few values.
    pub usual: Option<UsualRange>,
    /// Hints: points that violate a Western Electric rule, in the order of the points.
    pub hints: Vec<Hint>,
}

impl Trend {
    /// Creates a trend from points, the oldest first.
    pub fn from_points((title, unit): (String, String), points: Vec<TrendPoint>, without: usize) -> Self {
        let values: Vec<f64> = points.iter().map(|point| point.value).collect();
        let usual = usual_range(&values);
        let hints = usual.map_or(Vec::new(), |usual| find_violations(&values, usual));
        Trend { title, unit, points, without, usual, hints }
    }
}

/// Returns the trend of a quantity over cycles, the oldest first. Air-runs and cycles without a part are excluded.
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

/// A measured value that a cycle may contain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Quantity {
    /// A predefined quantity with a keyword.
    Known(KnownQuantity),
    /// The check with this name, in the last finding that contains it.
    Check(String),
}

/// The predefined quantities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumIter, strum::EnumString, strum::IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum KnownQuantity {
    /// Localization: point-to-plane residual, rms, mm.
    LocalizationResidual,
    /// Localization: residual of the outline, rms, px.
    OutlineResidual,
    /// Localization: error at the worst place of the panel, 95 %, mm.
    LocalizationError,
    /// Largest deviation of the panel's shape from the taught panel, mm.
    DeviationFromTaught,
    /// Error in the verifications of the 3D camera, mm at the panel.
    ScannerVerification,
    /// Error in the verifications of the flange camera, mm at the panel.
    FlangeCameraVerification,
    /// Error in the verifications of the tool, mm.
    ToolVerification,
    /// Error in the verifications of the force of a compliant tool, N.
    ForceVerification,
    /// Minimum change of the illumination since the dry picture over all films, %; negative for a decrease.
    LightLeast,
    /// Maximum change of the illumination since the dry picture over all films, %.
    LightMost,
    /// Change of the panel's brightness by the film, in the film with the smallest change, grey levels.
    FilmChange,
    /// Time from the start of the first film to its first break, s.
    TimeToBreak,
    /// Number of sanding passes.
    Passes,
    /// Mean contact force of a compliant tool on the last path, N.
    ForceInContact,
    /// Removed depth by the last path, mean over the sanded grids, µm.
    RemovedMean,
    /// Upper 95 % bound of the removed depth at the deepest place of the part over all passes, µm.
    RemovedDeepest,
    /// Area that the disc has swept in the cycle, mm².
    DiscSwept,
    /// Area that the disc has swept since it was mounted, mm².
    DiscWorn,
    /// Duration of the cycle by the wall clock, s.
    CycleTime,
    /// Total observation time of the valid films, s.
    FilmTime,
    /// Total error at the tool from all components, 95 %, mm.
    ErrorAtTool,
}

/// Which of several checks with the same name is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CheckSelection {
    Last,
    Least,
    Most,
}

impl KnownQuantity {
    /// Returns the keyword for the command line and for URLs, such as `localization-residual`.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns the quantity's title and its unit.
    pub fn title_and_unit(self) -> (&'static str, &'static str) {
        match self {
            KnownQuantity::LocalizationResidual => ("localization: point-to-plane residual, rms", "mm"),
            KnownQuantity::OutlineResidual => ("localization: outline residual, rms", "px"),
            KnownQuantity::LocalizationError => ("localization: stated error at the worst point, 95 %", "mm"),
            KnownQuantity::DeviationFromTaught => {
                ("localization: largest smooth deviation from the taught panel", "mm")
            }
            KnownQuantity::ScannerVerification => ("verification of the scanner", "mm"),
            KnownQuantity::FlangeCameraVerification => ("verification of the camera on the flange", "mm"),
            KnownQuantity::ToolVerification => ("verification of the tool", "mm"),
            KnownQuantity::ForceVerification => ("verification of the tool's force", "N"),
            KnownQuantity::LightLeast => ("minimum change of the light", "%"),
            KnownQuantity::LightMost => ("maximum change of the light", "%"),
            KnownQuantity::FilmChange => ("change of the panel's brightness by the film", "grey levels"),
            KnownQuantity::TimeToBreak => ("time to the first break", "s"),
            KnownQuantity::Passes => ("passes over the panel", ""),
            KnownQuantity::ForceInContact => ("mean force in contact", "N"),
            KnownQuantity::RemovedMean => ("mean removal by the last path", "µm"),
            KnownQuantity::RemovedDeepest => ("removal over all passes at the deepest point, 95 %", "µm"),
            KnownQuantity::DiscSwept => ("area swept by the disc in the cycle", "mm²"),
            KnownQuantity::DiscWorn => ("area swept by the disc since it was mounted", "mm²"),
            KnownQuantity::CycleTime => ("cycle time", "s"),
            KnownQuantity::FilmTime => ("total time of the films", "s"),
            KnownQuantity::ErrorAtTool => ("position error at the tool, 95 %", "mm"),
        }
    }

    /// Returns the device whose verifications give this quantity; `None` if cycles give it.
    pub fn verified_subject(self) -> Option<&'static str> {
        match self {
            KnownQuantity::ScannerVerification => Some("scanner"),
            KnownQuantity::FlangeCameraVerification => Some("flange_camera"),
            KnownQuantity::ToolVerification => Some("tool"),
            KnownQuantity::ForceVerification => Some("tool_force"),
            _ => None,
        }
    }

    /// Returns the keywords of all quantities.
    pub fn keywords() -> Vec<&'static str> {
        KnownQuantity::iter().map(KnownQuantity::keyword).collect()
    }

    /// Returns the value and the limit in a cycle; `None` if the cycle does not have the quantity, or verifications
    /// give it.
    fn value_and_limit(self, past: &PastCycle) -> Option<(f64, Limit)> {
        let unlimited = |value: f64| (value, Limit::Unlimited);
        match self {
            KnownQuantity::LocalizationResidual => {
                picked_value(past, Kind::Locate, name::RESIDUAL, CheckSelection::Last)
            }
            KnownQuantity::OutlineResidual => {
                picked_value(past, Kind::Locate, name::OUTLINE_RESIDUAL, CheckSelection::Last)
            }
            KnownQuantity::LocalizationError => {
                picked_value(past, Kind::Locate, name::LOCATION_ERROR, CheckSelection::Last)
            }
            KnownQuantity::DeviationFromTaught => {
                picked_value(past, Kind::Locate, name::BEND_NAME, CheckSelection::Last)
            }
            KnownQuantity::LightLeast => picked_value(past, Kind::Inspect, name::LIGHT_MIN, CheckSelection::Least),
            KnownQuantity::LightMost => {
                picked_value(past, Kind::Inspect, name::MAX_LIGHT_NAME, CheckSelection::Most)
            }
            KnownQuantity::FilmChange => {
                picked_value(past, Kind::Inspect, name::FILM_CHANGE, CheckSelection::Least)
            }
            KnownQuantity::TimeToBreak => {
                let times = past.grids().into_values().filter_map(|grid| grid.time_to_break_s);
                times.min_by(f64::total_cmp).map(unlimited)
            }
            KnownQuantity::Passes => past.films().next().map(|_| unlimited(f64::from(past.touching_passes()))),
            KnownQuantity::ForceInContact => {
                picked_value(past, Kind::Abrade, name::FORCE_MEAN, CheckSelection::Last)
            }
            KnownQuantity::RemovedMean => {
                picked_value(past, Kind::Abrade, name::REMOVED_MEAN, CheckSelection::Last)
            }
            KnownQuantity::RemovedDeepest => {
                picked_value(past, Kind::Abrade, name::REMOVED_BOUND, CheckSelection::Most)
            }
            KnownQuantity::DiscSwept => past.disc.map(|disc| unlimited(disc.swept_mm2)),
            KnownQuantity::DiscWorn => past.disc.map(|disc| unlimited(disc.worn_mm2)),
            KnownQuantity::CycleTime => past.cycle_time_s().map(|s| unlimited(s as f64)),
            KnownQuantity::FilmTime => super::past_cycle::films(past).watched_s.map(unlimited),
            KnownQuantity::ErrorAtTool => past.record.budget?.total_mm().map(unlimited),
            KnownQuantity::ScannerVerification
            | KnownQuantity::FlangeCameraVerification
            | KnownQuantity::ToolVerification
            | KnownQuantity::ForceVerification => None,
        }
    }
}

fn picked_value(past: &PastCycle, kind: Kind, name: &str, pick: CheckSelection) -> Option<(f64, Limit)> {
    let checks = past.findings(kind).flat_map(|finding| &finding.checks).filter(|check| check.name == name);
    let mut values = checks.filter_map(|check| Some((check.value?, check.limit)));
    match pick {
        CheckSelection::Last => values.next_back(),
        CheckSelection::Least => values.min_by(|one, other| one.0.total_cmp(&other.0)),
        CheckSelection::Most => values.max_by(|one, other| one.0.total_cmp(&other.0)),
    }
}

impl Quantity {
    /// Returns the predefined quantity with this keyword, otherwise the check with this name.
    pub fn from_keyword(text: &str) -> Self {
        KnownQuantity::from_str(text).map_or_else(|_| Quantity::Check(text.to_owned()), Quantity::Known)
    }

    /// Returns the value and the limit in a cycle; `None` if the cycle does not have the quantity.
    pub fn value_and_limit(&self, past: &PastCycle) -> Option<(f64, Limit)> {
        match self {
            Quantity::Known(known) => known.value_and_limit(past),
            Quantity::Check(name) => {
                self.find_check(past, name).and_then(|check| Some((check.value?, check.limit)))
            }
        }
    }

    /// Returns the title of the quantity and its unit in these cycles.
    pub fn title_and_unit(&self, cycles: &[PastCycle]) -> (String, String) {
        match self {
            Quantity::Known(known) => {
                let (title, unit) = known.title_and_unit();
                (title.to_owned(), unit.to_owned())
            }
            Quantity::Check(name) => {
                let unit = cycles.iter().rev().find_map(|past| self.find_check(past, name));
                (name.clone(), unit.map_or(String::new(), |check| check.unit.clone()))
            }
        }
    }

    fn find_check<'p>(&self, past: &'p PastCycle, name: &str) -> Option<&'p Check> {
        past.record.findings.iter().rev().find_map(|finding| finding.checks.iter().find(|check| check.name == name))
    }
}

/// Statistics of all grids of a panel over many cycles.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct HeatMap {
    /// Number of cycles with a valid film.
    pub films: usize,
    /// The grids, row by row.
    pub grids: Vec<HeatCell>,
}

/// Statistics of a grid over many cycles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeatCell {
    /// Name of the grid.
    pub grid: String,
    /// The grid's row, from 1.
    pub row: u32,
    /// The grid's column, from 1.
    pub column: u32,
    /// Number of first films that report the grid.
    pub films: usize,
    /// Number of first films that broke on the grid.
    pub breaks: usize,
    /// Median time until the film on the grid broke, s; `None` if it never broke.
    pub median_s: Option<f64>,
}

/// Returns the statistics of all grids. Air-runs have no film and are excluded. Only cycles with the taught panel of
/// the newest cycle are used, because on another taught panel, a grid of the same name may be another place.
pub fn heat_map(cycles: &[PastCycle]) -> HeatMap {
    let newest = cycles.iter().max_by_key(|past| past.record.id).map(|past| &past.record.taught_version);
    let cycles = cycles.iter().filter(|past| Some(&past.record.taught_version) == newest);
    let mut films = 0;
    let mut all: BTreeMap<(u32, u32), (String, usize, usize, Vec<f64>)> = BTreeMap::new();
    for past in cycles.filter(|past| past.films().next().is_some()) {
        films += 1;
        for (grid, result) in past.grids() {
            let (Some(at), Some(failed)) = (grid_row_and_column(&grid), result.failed_first) else { continue };
            let (_, seen, breaks, times_s) = all.entry(at).or_insert((grid, 0, 0, Vec::new()));
            *seen += 1;
            *breaks += usize::from(failed);
            times_s.extend(result.time_to_break_s.filter(|_| failed));
        }
    }
    let cell =
        |((row, column), (grid, films, breaks, mut times_s)): ((u32, u32), (String, usize, usize, Vec<f64>))| {
            HeatCell { grid, row, column, films, breaks, median_s: interpolated_median(&mut times_s) }
        };
    HeatMap { films, grids: all.into_iter().map(cell).collect() }
}
