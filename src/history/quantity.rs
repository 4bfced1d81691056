//! Numbers of a cycle whose trend is worth watching: their keywords on the command line, and their location in a
//! record.

use super::past_cycle::PastCycle;
use crate::record::{Kind, name};
use crate::verdict::{Check, Limit};
use std::str::FromStr;
use strum::IntoEnumIterator;

/// A number that a cycle may have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Quantity {
    /// A quantity with a keyword.
    Known(Known),
    /// The check with this name, in the last finding that has it.
    Check(String),
}

/// A quantity with a keyword.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumIter, strum::EnumString, strum::IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Known {
    /// Localization: residual, point to plane, rms, mm.
    LocalizationResidual,
    /// Localization: residual of the outline, rms, px.
    OutlineResidual,
    /// Localization: stated error at the panel's worst place, 95 %, mm.
    LocalizationError,
    /// The largest deviation of the panel's shape from the taught panel, mm.
    DeviationFromTaught,
    /// The result of verifications of the scanner, mm at the panel.
    ScannerVerification,
    /// The result of verifications of the camera on the flange, mm at the panel.
    FlangeCameraVerification,
    /// The result of verifications of the tool, mm.
    ToolVerification,
    /// The result of verifications of the force of a compliant tool, N.
    ForceVerification,
    /// The largest loss of light relative to the dry picture over all films, %.
    LightLeast,
    /// The largest gain of light relative to the dry picture over all films, %.
    LightMost,
    /// The change of the panel by the film, for the film with the smallest change, grey levels.
    FilmChange,
    /// Time from the begin of the first film to its first break, s.
    TimeToBreak,
    /// Passes over the panel.
    Passes,
    /// Contact force of a compliant tool on the last path, mean, N.
    ForceInContact,
    /// Mean removal of the last path on the treated grids, µm.
    RemovedMean,
    /// Upper 95 % bound of the removal at the deepest place of the part, over all passes, µm.
    RemovedDeepest,
    /// The area that the disc swept in the cycle, mm².
    DiscSwept,
    /// The area that the disc had swept since it was mounted, mm².
    DiscWorn,
    /// Duration of the cycle by the wall clock, s.
    CycleTime,
    /// Total time for which the valid films were watched, s.
    FilmTime,
    /// The total error at the tool from all parts, 95 %, mm.
    ErrorAtTool,
}

/// Selects which of several checks of a cycle counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pick {
    Last,
    Least,
    Most,
}

impl Known {
    /// Returns the quantity's keyword on the command line and in addresses, `localization-residual`.
    pub fn word(self) -> &'static str {
        self.into()
    }

    /// Returns the quantity's title and its unit.
    pub fn title_and_unit(self) -> (&'static str, &'static str) {
        match self {
            Known::LocalizationResidual => ("localization: point-to-plane residual, rms", "mm"),
            Known::OutlineResidual => ("localization: outline residual, rms", "px"),
            Known::LocalizationError => ("localization: stated error at the worst point, 95 %", "mm"),
            Known::DeviationFromTaught => ("localization: largest smooth deviation from the taught panel", "mm"),
            Known::ScannerVerification => ("verification of the scanner", "mm"),
            Known::FlangeCameraVerification => ("verification of the camera on the flange", "mm"),
            Known::ToolVerification => ("verification of the tool", "mm"),
            Known::ForceVerification => ("verification of the tool's force", "N"),
            Known::LightLeast => ("smallest change of the light", "%"),
            Known::LightMost => ("largest change of the light", "%"),
            Known::FilmChange => ("change of the panel's brightness by the film", "grey levels"),
            Known::TimeToBreak => ("time to the first break", "s"),
            Known::Passes => ("passes over the panel", ""),
            Known::ForceInContact => ("mean force in contact", "N"),
            Known::RemovedMean => ("mean removal by the last path", "µm"),
            Known::RemovedDeepest => ("removal over all passes at the deepest point, 95 %", "µm"),
            Known::DiscSwept => ("area swept by the disc in the cycle", "mm²"),
            Known::DiscWorn => ("area swept by the disc since it was mounted", "mm²"),
            Known::CycleTime => ("cycle time", "s"),
            Known::FilmTime => ("total time of the films", "s"),
            Known::ErrorAtTool => ("position error at the tool, 95 %", "mm"),
        }
    }

    /// The subject of the verifications from which the number comes; `None` if the number comes from cycles.
    pub fn verified_subject(self) -> Option<&'static str> {
        match self {
            Known::ScannerVerification => Some("scanner"),
            Known::FlangeCameraVerification => Some("flange_camera"),
            Known::ToolVerification => Some("tool"),
            Known::ForceVerification => Some("tool_force"),
            _ => None,
        }
    }

    /// All words.
    pub fn words() -> Vec<&'static str> {
        Known::iter().map(Known::word).collect()
    }

    /// Returns the value in a cycle, and its limit. A quantity that comes from verifications has no value in a cycle.
    fn value_and_limit(self, past: &PastCycle) -> Option<(f64, Limit)> {
        let unlimited = |value: f64| (value, Limit::Unlimited);
        match self {
            Known::LocalizationResidual => picked(past, Kind::Locate, name::RESIDUAL, Pick::Last),
            Known::OutlineResidual => picked(past, Kind::Locate, name::OUTLINE_RESIDUAL, Pick::Last),
            Known::LocalizationError => picked(past, Kind::Locate, name::LOCATION_ERROR, Pick::Last),
            Known::DeviationFromTaught => picked(past, Kind::Locate, name::BEND, Pick::Last),
            Known::LightLeast => picked(past, Kind::Inspect, name::LIGHT_MIN, Pick::Least),
            Known::LightMost => picked(past, Kind::Inspect, name::LIGHT_MAX, Pick::Most),
            Known::FilmChange => picked(past, Kind::Inspect, name::FILM_CHANGE, Pick::Least),
            Known::TimeToBreak => {
                let times = past.grids().into_values().filter_map(|grid| grid.time_to_break_s);
                times.min_by(f64::total_cmp).map(unlimited)
            }
            Known::Passes => past.films().next().map(|_| unlimited(f64::from(past.passes()))),
            Known::ForceInContact => picked(past, Kind::Abrade, name::FORCE_MEAN, Pick::Last),
            Known::RemovedMean => picked(past, Kind::Abrade, name::REMOVED_MEAN, Pick::Last),
            Known::RemovedDeepest => picked(past, Kind::Abrade, name::REMOVED_BOUND, Pick::Most),
            Known::DiscSwept => past.disc.map(|disc| unlimited(disc.swept_mm2)),
            Known::DiscWorn => past.disc.map(|disc| unlimited(disc.worn_mm2)),
            Known::CycleTime => past.cycle_time_s().map(|s| unlimited(s as f64)),
            Known::FilmTime => super::summary::films(past).watched_s.map(unlimited),
            Known::ErrorAtTool => past.record.budget?.total_mm().map(unlimited),
            Known::ScannerVerification
            | Known::FlangeCameraVerification
            | Known::ToolVerification
            | Known::ForceVerification => None,
        }
    }
}

fn picked(past: &PastCycle, kind: Kind, name: &str, pick: Pick) -> Option<(f64, Limit)> {
    let checks = past.findings(kind).flat_map(|finding| &finding.checks).filter(|check| check.name == name);
    let mut values = checks.filter_map(|check| Some((check.value?, check.limit)));
    match pick {
        Pick::Last => values.next_back(),
        Pick::Least => values.min_by(|one, other| one.0.total_cmp(&other.0)),
        Pick::Most => values.max_by(|one, other| one.0.total_cmp(&other.0)),
    }
}

impl Quantity {
    /// Returns the quantity with this keyword; otherwise the check with this name.
    pub fn named(text: &str) -> Self {
        Known::from_str(text).map_or_else(|_| Quantity::Check(text.to_owned()), Quantity::Known)
    }

    /// The value in a cycle and its limit; `None` if the cycle has none.
    pub fn value_and_limit(&self, past: &PastCycle) -> Option<(f64, Limit)> {
        match self {
            Quantity::Known(known) => known.value_and_limit(past),
            Quantity::Check(name) => self.check(past, name).and_then(|check| Some((check.value?, check.limit))),
        }
    }

    /// Returns the quantity's title and its unit in these cycles.
    pub fn title_and_unit(&self, cycles: &[PastCycle]) -> (String, String) {
        match self {
            Quantity::Known(known) => {
                let (title, unit) = known.title_and_unit();
                (title.to_owned(), unit.to_owned())
            }
            Quantity::Check(name) => {
                let unit = cycles.iter().rev().find_map(|past| self.check(past, name));
                (name.clone(), unit.map_or(String::new(), |check| check.unit.clone()))
            }
        }
    }

    fn check<'p>(&self, past: &'p PastCycle, name: &str) -> Option<&'p Check> {
        past.record.findings.iter().rev().find_map(|finding| finding.checks.iter().find(|check| check.name == name))
    }
}
