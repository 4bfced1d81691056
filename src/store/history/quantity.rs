//! Numbers of a cycle whose trend is worth watching: their keywords on the command line, and their location in a
//! record.

use super::past_cycle::PastCycle;
use panelprep_base::verdict::{Check, Limit};
use panelprep_cell::record::{Kind, name};
use std::str::FromStr;
use strum::IntoEnumIterator;

/// A number that a cycle may have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Quantity {
    /// A quantity with a keyword.
    Known(KnownQuantity),
    /// The check with this name, in the last finding that has it.
    Check(String),
}

/// A quantity with a keyword.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumIter, strum::EnumString, strum::IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum KnownQuantity {
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
enum CheckSelection {
    Last,
    Least,
    Most,
}

impl KnownQuantity {
    /// Returns the quantity's keyword on the command line and in addresses, `localization-residual`.
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
            KnownQuantity::LightLeast => ("smallest change of the light", "%"),
            KnownQuantity::LightMost => ("largest change of the light", "%"),
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

    /// The subject of the verifications from which the number comes; `None` if the number comes from cycles.
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

    /// Returns the value in a cycle, and its limit. A quantity that comes from verifications has no value in a cycle.
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
            KnownQuantity::FilmTime => super::summary::films(past).watched_s.map(unlimited),
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
    /// Returns the quantity with this keyword; otherwise the check with this name.
    pub fn from_keyword(text: &str) -> Self {
        KnownQuantity::from_str(text).map_or_else(|_| Quantity::Check(text.to_owned()), Quantity::Known)
    }

    /// The value in a cycle and its limit; `None` if the cycle has none.
    pub fn value_and_limit(&self, past: &PastCycle) -> Option<(f64, Limit)> {
        match self {
            Quantity::Known(known) => known.value_and_limit(past),
            Quantity::Check(name) => {
                self.find_check(past, name).and_then(|check| Some((check.value?, check.limit)))
            }
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
                let unit = cycles.iter().rev().find_map(|past| self.find_check(past, name));
                (name.clone(), unit.map_or(String::new(), |check| check.unit.clone()))
            }
        }
    }

    fn find_check<'p>(&self, past: &'p PastCycle, name: &str) -> Option<&'p Check> {
        past.record.findings.iter().rev().find_map(|finding| finding.checks.iter().find(|check| check.name == name))
    }
}
