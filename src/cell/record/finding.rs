//! The finding of a phase, and the removal from a part according to the findings of its cycle.

use panelprep_base::verdict::{Check, Judgement};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The material removed by one contact path, computed from the poses that the robot reported.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathRemoval {
    /// Number of the sanding pass, from 1.
    pub pass: u8,
    /// Expected depth, mean over the sanded grids, µm.
    pub mean_um: f64,
    /// Upper 95 % bound of the depth at any place of the part over all passes so far, µm.
    pub bound_um: f64,
}

/// Returns the material removed by each contact path; empty if the recipe requires no removal.
pub fn path_removals(findings: &[Finding]) -> Vec<PathRemoval> {
    let of_path = |finding: &Finding| {
        let [mean_um, bound_um] = [name::REMOVED_MEAN, name::REMOVED_BOUND].map(|name| finding.number(name));
        Some(PathRemoval { pass: finding.pass, mean_um: mean_um?, bound_um: bound_um? })
    };
    findings.iter().filter(|finding| finding.kind == Kind::Abrade).filter_map(of_path).collect()
}

/// Returns the upper 95 % bound of the depth, µm, at any place of a part after this number of passes of the cycle,
/// including the removal in earlier cycles. A pass without a reported removal is treated as completely executed, as
/// planned. `None` if the bound is unknown.
pub fn removed_bound_um(findings: &[Finding], passes: usize) -> Option<f64> {
    let bounds_of = |kind: Kind| -> Vec<f64> {
        let of_kind = findings.iter().filter(move |finding| finding.kind == kind);
        let checks = of_kind.flat_map(|finding| &finding.checks).filter(|check| check.name == name::REMOVED_BOUND);
        checks.filter_map(|check| check.value).collect()
    };
    let (executed, planned) = (bounds_of(Kind::Abrade), bounds_of(Kind::Plan));
    let is_whole = executed.len() >= passes;
    let known = planned.into_iter().filter(|_| !is_whole).chain(executed.iter().copied());
    let enough = is_whole || bounds_of(Kind::Plan).len() >= passes;
    known.reduce(f64::max).filter(|_| enough)
}

/// Number of a cycle in its store, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct CycleId(pub i64);

impl std::fmt::Display for CycleId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

/// The phase or device from which a finding comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names are the phases of the cycle")]
#[strum(serialize_all = "lowercase")]
pub enum Kind {
    Locate,
    Refine,
    /// The check of which grids the arm can reach, made before the panel is wetted.
    Reach,
    Inspect,
    Plan,
    Verify,
    Abrade,
    /// The checks before a motion.
    Gate,
    /// A report of the robot or of the robot link.
    Robot,
    /// The self-test before a cycle.
    SelfTest,
    /// A report of the compliant tool.
    Tool,
}

impl Kind {
    /// Returns the keyword under which the kind is stored.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}

/// Names of measured numbers that the program looks up by name.
pub mod name {
    /// Largest distance between the present panel and the taught panel, mm.
    pub const DEVIATION: &str = "deviation from the taught panel, largest";
    /// Largest distance between the present panel and its drawing, if the panel was taught from the drawing, mm.
    pub const DEVIATION_FROM_DRAWING: &str = "deviation from the drawing, largest";
    /// Profile of the surface over the region, twice the largest deviation from the taught panel, mm.
    pub const PROFILE: &str = "profile of the surface, from the taught panel";
    /// Profile of the surface over the region, twice the largest deviation from the nominal surface, if the panel was
    /// taught from its drawing, mm.
    pub const PROFILE_FROM_DRAWING: &str = "profile of the surface, from the drawing (nominal)";
    /// Uncertainty of the profile, 95 %, mm.
    pub const PROFILE_UNCERTAINTY: &str = "profile of the surface, uncertainty, 95 %";
    /// Largest deviation in front of the reference surface, mm.
    pub const PROFILE_FRONT: &str = "profile of the surface, farthest in front (+)";
    /// Largest deviation behind the reference surface, mm, negative.
    pub const PROFILE_BEHIND: &str = "profile of the surface, farthest behind (−)";
    /// Flatness of the region, minimum zone, mm.
    pub const FLATNESS: &str = "flatness of the region, minimum zone";
    /// Uncertainty of the flatness, 95 %, mm.
    pub const FLATNESS_UNCERTAINTY: &str = "flatness of the region, uncertainty, 95 %";
    /// Time for which a film was observed, s.
    pub const WATCHED_TIME_NAME: &str = "watched";
    /// The water, as stated in the recipe.
    pub const WATER: &str = "water, as the recipe states it";
    /// The lamp, as stated in the recipe.
    pub const LAMP: &str = "lamp, as the recipe states it";
    /// Time from a scan in memory to the verdict of the localization, ms.
    pub const SCAN_TO_VERDICT: &str = "scan to verdict";
    /// Median time to process a decoded wet picture, ms.
    pub const PER_PICTURE: &str = "a picture takes, median";
    /// Number of waypoints of a plan, including the first one, in the air, at which the approach ends.
    pub const PLANNED: &str = "waypoints";
    /// Number of executed waypoints of a contact path, without the one at which the approach ends.
    pub const EXECUTED_WAYPOINTS_NAME: &str = "waypoints executed";
    /// Expected depth of a path, mean over the sanded grids, µm.
    pub const REMOVED_MEAN: &str = "expected removal, mean";
    /// Largest deviation from the target depth in 95 % of the sanded area, %.
    pub const REMOVED_EVEN: &str = "removal even within";
    /// Upper 95 % bound of the depth at any place of the part over all passes so far, µm.
    pub const REMOVED_BOUND: &str = "largest removal over all passes, upper 95 % bound";
    /// Mean contact force of a compliant tool at the poses that the robot reported on the panel, N.
    pub const FORCE_MEAN: &str = "force in contact, mean";
    /// Smallest contact force of a compliant tool at the reported poses, N.
    pub const FORCE_MIN: &str = "force in contact, least";
    /// Largest contact force of a compliant tool at the reported poses, N.
    pub const FORCE_MAX: &str = "force in contact, most";
    /// Number of corners found so far.
    pub const CORNERS: &str = "corners seen";
    /// Wear of the mounted disc after the largest grid is sanded.
    pub const WORN_BY_A_GRID: &str = "worn of the disc after the largest grid";
    /// Number of grids that were begun but not sanded as planned.
    pub const BEGUN_GRIDS_NAME: &str = "grids that were not covered as planned";
    /// Number of motions for the correction with corner pictures.
    pub const CORRECTION_MOVES_NAME: &str = "moves after the first picture";
    /// Localization: residual along the surface normals, without the smooth deviation, rms, mm.
    pub const RESIDUAL: &str = "residual, point to plane, rms";
    /// Localization: largest smooth deviation of the panel from the taught panel, mm.
    pub const BEND_NAME: &str = "smooth deviation from the taught panel, at most";
    /// Localization: residual of the outline, rms, px.
    pub const OUTLINE_RESIDUAL: &str = "residual of the outline, rms";
    /// Localization: error at the worst place of the panel, 95 %, mm.
    pub const LOCATION_ERROR: &str = "error at the worst place, 95 %";
    /// Change of the panel's brightness by the film, grey levels.
    pub const FILM_CHANGE: &str = "change of the panel by the film";
    /// Minimum illumination during a film, relative to the dry picture, %.
    pub const LIGHT_MIN: &str = "change of the light, least";
    /// Maximum illumination during a film, relative to the dry picture, %.
    pub const MAX_LIGHT_NAME: &str = "change of the light, most";

    /// Area of the smallest break that is reliably detected at the panel's pose, mm².
    pub const SMALLEST_BREAK: &str = "smallest break that is surely found";
    /// Covered fraction of the grid with the lowest coverage in a plan.
    pub const COVERAGE: &str = "coverage of the worst of them";
    /// Fraction of the water breaks that the disc reaches, if a plan covers the areas around breaks.
    pub const BREAKS_REACHED: &str = "share of the broken places that the disc reaches";
    /// Uncertainty of the panel's pose, compared with the uncertainty contained in the margin around breaks, mm.
    pub const BREAKS_UNCERTAIN: &str = "uncertainty of the panel's pose, in the margin around breaks";
    /// Total size of the areas around breaks, on the surface, mm².
    pub const AROUND_BREAKS: &str = "area around the breaks";
    /// Ratio of the longest to the shortest dwell time of a plan: over all grids together, or in the worst grid.
    pub const DWELL_RATIO: &str = "their ratio, all together or the worst grid's";
    /// Largest ratio of executed to planned dwell time of a grid in a sanding pass.
    pub const DWELL_RATIO_NAME: &str = "time under the disc beside its plan, the worst grid's ratio";
    /// Largest distance of a reported position from the planned path in a sanding pass, mm.
    pub const PATH_DEVIATION_NAME: &str = "farthest of them from the planned path";

    const BROKEN_FILM: &str = "broken film in ";
    const OVERLAPPED_SHARE: &str = "share under the disc, beside the planned grids, of ";

    /// Returns the name of this number: the area of broken film in a grid, mm².
    pub fn broken_film(grid: impl std::fmt::Display) -> String {
        format!("{BROKEN_FILM}{grid}")
    }

    /// Returns the grid in a name from [`broken_film`]; `None` for any other name.
    pub fn broken_film_grid(name: &str) -> Option<&str> {
        name.strip_prefix(BROKEN_FILM)
    }

    /// Returns the name of this number: the fraction of a grid that was not planned but was under the disc, 0…1.
    pub fn overlapped_share(grid: impl std::fmt::Display) -> String {
        format!("{OVERLAPPED_SHARE}{grid}")
    }

    /// Returns the grid in a name from [`overlapped_share`]; `None` for any other name.
    pub fn overlapped_grid(name: &str) -> Option<&str> {
        name.strip_prefix(OVERLAPPED_SHARE)
    }

    /// Returns the name of this number: the time after which the film in a grid broke, s.
    pub fn break_time_name(grid: impl std::fmt::Display) -> String {
        format!("{grid} failed after")
    }
}

/// A picture that is displayed with a finding.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Picture {
    /// Short name of the picture, such as `corner_before`.
    pub name: String,
    /// Caption of the picture.
    pub caption: String,
    /// The hash of the JPEG file in the store.
    pub hash: String,
}

/// The finding of a phase.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// The phase or device from which the finding comes.
    pub kind: Kind,
    /// Number of sanding passes that were planned before the finding; 0 before the first.
    pub pass: u8,
    /// The verdict of the acceptance check, with its reasons.
    pub judgement: Judgement,
    /// All measured numbers of the finding, each with its limit.
    #[serde(rename = "numbers")]
    pub checks: Vec<Check>,
    /// Further results, such as `base_from_panel`, under their names in the JSON output of the commands.
    pub details: BTreeMap<String, serde_json::Value>,
    /// Pictures that show the result to a person.
    pub pictures: Vec<Picture>,
    /// The original pictures and scans of the cameras.
    pub shots: Vec<KeptFile>,
}

impl Finding {
    /// Creates a finding without checks and pictures.
    pub fn new(kind: Kind, pass: u8, judgement: Judgement) -> Self {
        let (checks, details) = (Vec::new(), BTreeMap::new());
        Finding { kind, pass, judgement, checks, details, pictures: Vec::new(), shots: Vec::new() }
    }

    /// Returns the finding with additional checks. A good finding becomes a review if one of these checks violates its
    /// limit and no rule states another consequence.
    pub fn with_checks(mut self, checks: impl IntoIterator<Item = Check>) -> Self {
        let more: Vec<Check> = checks.into_iter().collect();
        self.judgement = self.judgement.with_checks(&more);
        self.checks.extend(more);
        self
    }

    /// Adds a detail to the finding.
    pub fn with_detail(mut self, name: &str, value: impl Into<serde_json::Value>) -> Self {
        self.details.insert(name.to_owned(), value.into());
        self
    }

    /// Returns the names in the list `detail`; empty if there is no such list.
    pub fn names(&self, detail: &str) -> Vec<String> {
        let value = self.details.get(detail);
        value.and_then(|value| serde_json::from_value(value.clone()).ok()).unwrap_or_default()
    }

    /// Returns the value of the check with this name.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.checks.iter().find(|check| check.name == name)?.value
    }
}

/// A file in the store: its purpose and its hash.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptFile {
    /// The purpose of the file, such as `base_from_camera`.
    pub name: String,
    /// The file's hash in the store.
    pub hash: String,
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::{Check, Judgement};

    /// A plan alone removes no material, and without `[removal]` in the recipe the removal of a path is unknown.
    #[test]
    fn the_removal_of_each_path_is_listed() {
        let told = |kind: Kind, numbers: [Option<f64>; 2]| {
            let [mean_um, bound_um] = numbers;
            let mean = Check::new(name::REMOVED_MEAN, "µm", mean_um);
            Finding::new(kind, 1, Judgement::new(vec![], vec![]))
                .with_checks([mean, Check::new(name::REMOVED_BOUND, "µm", bound_um)])
        };
        let known = [Some(19.5), Some(24.0)];
        let findings = [told(Kind::Plan, known), told(Kind::Abrade, known), told(Kind::Abrade, [None; 2])];
        assert_eq!(path_removals(&findings), [PathRemoval { pass: 1, mean_um: 19.5, bound_um: 24.0 }]);
    }

    /// The removal of two passes was reported; for the third pass, only its plan is known.
    #[test]
    fn the_plan_counts_if_no_removal_was_reported() {
        let told = |kind: Kind, pass: u8, um: Option<f64>| {
            let judgement = panelprep_base::verdict::Judgement::new(vec![], vec![]);
            Finding::new(kind, pass, judgement).with_checks([panelprep_base::verdict::Check::new(
                name::REMOVED_BOUND,
                "µm",
                um,
            )])
        };
        let both = [
            told(Kind::Plan, 1, Some(20.0)),
            told(Kind::Abrade, 1, Some(18.0)),
            told(Kind::Plan, 2, Some(41.0)),
            told(Kind::Abrade, 2, Some(38.0)),
        ];
        assert_eq!(removed_bound_um(&both, 2), Some(38.0));
        assert_eq!(removed_bound_um(&both[..3], 2), Some(41.0), "the second pass broke off");
        assert_eq!(removed_bound_um(&both[..2], 2), None, "the second pass is not known");
        assert_eq!(removed_bound_um(&[told(Kind::Abrade, 1, None)], 1), None);
    }
}
