//! The result of one phase of a cycle, and the removal from a part, as the findings of its cycle report it.

use panelprep_base::verdict::{Check, Judgement};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The removal by one contact path, from the poses that the robot reported.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathRemoval {
    /// Number of the pass, from 1.
    pub pass: u8,
    /// Expected depth over the treated grids, mean, µm.
    pub mean_um: f64,
    /// Upper bound of the depth at any place of the part over all passes so far, 95 %, µm.
    pub bound_um: f64,
}

/// Returns the removal path by path; empty if the recipe does not require a removal.
pub fn removed(findings: &[Finding]) -> Vec<PathRemoval> {
    let of_path = |finding: &Finding| {
        let [mean_um, bound_um] = [name::REMOVED_MEAN, name::REMOVED_BOUND].map(|name| finding.number(name));
        Some(PathRemoval { pass: finding.pass, mean_um: mean_um?, bound_um: bound_um? })
    };
    findings.iter().filter(|finding| finding.kind == Kind::Abrade).filter_map(of_path).collect()
}

/// Returns the upper 95 % bound of the removal anywhere on a part that was abraded in this number of passes of this
/// cycle, µm, including the removal of earlier cycles. If a pass has no report, its plan counts, since the whole plan
/// may have been executed. `None` if the bound is not known.
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

/// The phase that produced a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names are the phases of the cycle")]
#[strum(serialize_all = "lowercase")]
pub enum Kind {
    Locate,
    Refine,
    /// The grids of the panel that the arm can reach, checked before the panel is wetted.
    Reach,
    Inspect,
    Plan,
    Verify,
    Abrade,
    /// The gate before a motion.
    Gate,
    /// A report of the robot or its link.
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

/// Names of numbers that the program looks up by name.
pub mod name {
    /// Largest distance of today's panel from the taught panel.
    pub const DEVIATION: &str = "deviation from the taught panel, largest";
    /// Largest distance of today's panel from its drawing, if the panel was taught from the drawing, mm.
    pub const DEVIATION_FROM_DRAWING: &str = "deviation from the drawing, largest";
    /// Profile of the surface over the region, twice the largest deviation from the taught panel, mm.
    pub const PROFILE: &str = "profile of the surface, from the taught panel";
    /// Profile of the surface over the region, twice the largest deviation from the nominal surface, if the panel was
    /// taught from its drawing, mm.
    pub const PROFILE_FROM_DRAWING: &str = "profile of the surface, from the drawing (nominal)";
    /// Uncertainty of the profile, 95 %, mm.
    pub const PROFILE_UNCERTAINTY: &str = "profile of the surface, uncertainty, 95 %";
    /// The largest deviation in front of the reference, mm.
    pub const PROFILE_FRONT: &str = "profile of the surface, farthest in front (+)";
    /// The largest deviation behind the reference, mm, negative.
    pub const PROFILE_BEHIND: &str = "profile of the surface, farthest behind (−)";
    /// Flatness of the region, minimum zone, mm.
    pub const FLATNESS: &str = "flatness of the region, minimum zone";
    /// Uncertainty of the flatness, 95 %, mm.
    pub const FLATNESS_UNCERTAINTY: &str = "flatness of the region, uncertainty, 95 %";
    /// Time for which a film was watched, s.
    pub const WATCHED_TIME_NAME: &str = "watched";
    /// The water, as the recipe states it.
    pub const WATER: &str = "water, as the recipe states it";
    /// The lamp, as the recipe states it.
    pub const LAMP: &str = "lamp, as the recipe states it";
    /// Time from a scan in memory to the gate's verdict, ms.
    pub const SCAN_TO_VERDICT: &str = "scan to verdict";
    /// Time from a decoded wet picture to its result, median, ms.
    pub const PER_PICTURE: &str = "a picture takes, median";
    /// Waypoints of a plan, including the first one, in air, at which the approach ends.
    pub const PLANNED: &str = "waypoints";
    /// Waypoints of a contact path that the robot executed, without the one at which the approach ended.
    pub const EXECUTED_WAYPOINTS_NAME: &str = "waypoints executed";
    /// Expected depth of removal by a path on the treated grids, mean, µm.
    pub const REMOVED_MEAN: &str = "expected removal, mean";
    /// Largest deviation from the target for 95 % of the treated area, %.
    pub const REMOVED_EVEN: &str = "removal even within";
    /// Largest removal at any place of the part over all passes so far, as the upper 95 % bound, µm.
    pub const REMOVED_BOUND: &str = "largest removal over all passes, upper 95 % bound";
    /// Contact force of a compliant tool at the poses that the robot reported on the panel, mean, N.
    pub const FORCE_MEAN: &str = "force in contact, mean";
    /// Smallest contact force of a compliant tool at the reported poses, N.
    pub const FORCE_MIN: &str = "force in contact, least";
    /// Largest contact force of a compliant tool at the reported poses, N.
    pub const FORCE_MAX: &str = "force in contact, most";
    /// Number of corners seen so far.
    pub const CORNERS: &str = "corners seen";
    /// Wear of the disc in use after treating the largest grid.
    pub const WORN_BY_A_GRID: &str = "worn of the disc after the largest grid";
    /// Grids that were begun but not covered as planned.
    pub const BEGUN_GRIDS_NAME: &str = "grids that were not covered as planned";
    /// Number of moves of the corner correction.
    pub const CORRECTION_MOVES_NAME: &str = "moves after the first picture";
    /// Localization: residual along the surface's normals, about the smooth deviation, rms, mm.
    pub const RESIDUAL: &str = "residual, point to plane, rms";
    /// Localization: largest smooth deviation of the panel from the taught panel, mm.
    pub const BEND_NAME: &str = "smooth deviation from the taught panel, at most";
    /// Localization: residual of the outline, rms, px.
    pub const OUTLINE_RESIDUAL: &str = "residual of the outline, rms";
    /// Localization: stated error at the panel's worst place, 95 %, mm.
    pub const LOCATION_ERROR: &str = "error at the worst place, 95 %";
    /// Change of the panel by the film, grey levels.
    pub const FILM_CHANGE: &str = "change of the panel by the film";
    /// Smallest light of a film relative to the dry picture, %.
    pub const LIGHT_MIN: &str = "change of the light, least";
    /// Largest light of a film relative to the dry picture, %.
    pub const MAX_LIGHT_NAME: &str = "change of the light, most";

    /// The smallest area of broken film that is surely found at the panel's pose, mm².
    pub const SMALLEST_BREAK: &str = "smallest break that is surely found";
    /// Covered fraction of the worst grid of a plan.
    pub const COVERAGE: &str = "coverage of the worst of them";
    /// Fraction of the water breaks that the disc reaches, if areas around breaks are planned.
    pub const BREAKS_REACHED: &str = "share of the broken places that the disc reaches";
    /// Uncertainty of the panel's pose, compared with the uncertainty in the margin around breaks, mm.
    pub const BREAKS_UNCERTAIN: &str = "uncertainty of the panel's pose, in the margin around breaks";
    /// Total area of the areas around breaks, on the surface, mm².
    pub const AROUND_BREAKS: &str = "area around the breaks";
    /// Ratio of the longest to the shortest dwell of a plan: over all grids together, or the worst grid's.
    pub const DWELL_RATIO: &str = "their ratio, all together or the worst grid's";
    /// Largest ratio of a grid's time under the disc to the planned time, in an abrasion.
    pub const DWELL_RATIO_NAME: &str = "time under the disc beside its plan, the worst grid's ratio";
    /// Largest distance of a reported position from the planned path of an abrasion, mm.
    pub const PATH_DEVIATION_NAME: &str = "farthest of them from the planned path";

    const BROKEN_FILM: &str = "broken film in ";
    const OVERLAPPED_SHARE: &str = "share under the disc, beside the planned grids, of ";

    /// Returns the name of the number: the area of a grid on which the film broke, mm².
    pub fn broken_film(grid: impl std::fmt::Display) -> String {
        format!("{BROKEN_FILM}{grid}")
    }

    /// Returns the grid of a [`broken_film`] name; `None` for another name.
    pub fn broken_film_grid(name: &str) -> Option<&str> {
        name.strip_prefix(BROKEN_FILM)
    }

    /// Returns the name of the number: the share of a grid beside the planned ones that was under the disc, 0…1.
    pub fn overlapped_share(grid: impl std::fmt::Display) -> String {
        format!("{OVERLAPPED_SHARE}{grid}")
    }

    /// Returns the grid of an [`overlapped_share`] name; `None` for another name.
    pub fn overlapped_grid(name: &str) -> Option<&str> {
        name.strip_prefix(OVERLAPPED_SHARE)
    }

    /// Returns the name of the number: the time after which a grid failed, s.
    pub fn break_time_name(grid: impl std::fmt::Display) -> String {
        format!("{grid} failed after")
    }
}

/// A picture to show.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Picture {
    /// Short name of the picture, such as `corner_before`.
    pub name: String,
    /// Caption of the picture.
    pub caption: String,
    /// The JPEG's hash in the store.
    pub hash: String,
}

/// The result of one phase.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Phase of the finding.
    pub kind: Kind,
    /// Number of abrasions planned before the finding: 0 before the first.
    pub pass: u8,
    /// Judgement of the gate.
    pub judgement: Judgement,
    /// Every number on which the finding is based, with its limit.
    #[serde(rename = "numbers")]
    pub checks: Vec<Check>,
    /// Details that are not a single number, such as `base_from_panel`, by their names in the commands' JSON.
    pub details: BTreeMap<String, serde_json::Value>,
    /// Pictures for people that show the result.
    pub pictures: Vec<Picture>,
    /// The original pictures of the cameras.
    pub shots: Vec<KeptFile>,
}

impl Finding {
    /// Creates a finding without checks and pictures.
    pub fn new(kind: Kind, pass: u8, judgement: Judgement) -> Self {
        let (checks, details) = (Vec::new(), BTreeMap::new());
        Finding { kind, pass, judgement, checks, details, pictures: Vec::new(), shots: Vec::new() }
    }

    /// Adds these checks to the existing ones. A good finding becomes a review if one of these checks violates a
    /// limit and no rule states the consequence.
    pub fn with_checks(mut self, checks: impl IntoIterator<Item = Check>) -> Self {
        let more: Vec<Check> = checks.into_iter().collect();
        self.judgement = self.judgement.with_checks(&more);
        self.checks.extend(more);
        self
    }

    /// Adds a detail.
    pub fn with_detail(mut self, name: &str, value: impl Into<serde_json::Value>) -> Self {
        self.details.insert(name.to_owned(), value.into());
        self
    }

    /// Returns the names that this detail lists; none if there is no such list.
    pub fn names(&self, detail: &str) -> Vec<String> {
        let value = self.details.get(detail);
        value.and_then(|value| serde_json::from_value(value.clone()).ok()).unwrap_or_default()
    }

    /// Returns the value of the number with this name.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.checks.iter().find(|check| check.name == name)?.value
    }
}

/// A stored file: its use and its hash.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptFile {
    /// Use of the file, such as `base_from_camera`.
    pub name: String,
    /// The file's hash in the store.
    pub hash: String,
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::{Check, Judgement};

    /// A plan has not removed anything, and without `[removal]` in the recipe the removal of a path is not known.
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
        assert_eq!(removed(&findings), [PathRemoval { pass: 1, mean_um: 19.5, bound_um: 24.0 }]);
    }

    /// Two passes reported their removal; for a third one only its plan is known.
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
