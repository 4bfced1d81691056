//! The executed part of a contact path, evaluated from the poses that the robot reported.

use super::removal::{PathRemovalTotal, RemovalInputs};
use super::{ResultDrawing, names};
use crate::report::{dwell_map, overlap_map};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Judgement, LimitSource, Severity};
use panelprep_cell::panel::{GridId, Region, TaughtPanel};
use panelprep_cell::recipe;
use panelprep_cell::record::{Check, Finding, Kind, name};
use panelprep_toolpath::path::Plan;
use panelprep_toolpath::path::dwell::{self, Dwell, ExecutedPose, GridDwell};
use panelprep_toolpath::path::routes::waypoints;
use panelprep_toolpath::path::trace::{ExecutedPath, Trace};
use panelprep_toolpath::surface::BSplineSurface;
use std::collections::BTreeSet;

/// Maximum distance of a reported pose from a straight part of the planned path, mm: the usual tracking error of the
/// drives.
const MAX_PATH_DEVIATION_MM: f64 = 1.0;
/// Maximum amount by which the covered fraction of an executed grid may be less than the planned fraction, because the
/// reported poses are some millimetres apart.
const MAX_COVERAGE_DEFICIT: f64 = 0.01;

/// Maximum ratio of a grid's dwell time to the planned dwell time without a review by a person. In bends and on short
/// moves the arm is slower than the planned feed.
const MAX_DWELL_RATIO: f64 = 1.35;
/// Maximum ratio that a person may accept. Above it, the removal is not the planned one, and the part is rejected.
const MAX_REVIEWED_DWELL_RATIO: f64 = 1.6;

/// The executed part of a path, without its first waypoint, which is the end of the approach.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Number of waypoints of the path.
    pub waypoints: u32,
    /// Number of executed waypoints.
    pub done: u32,
}

impl Progress {
    /// Returns whether the whole path was executed.
    pub fn is_complete(self) -> bool {
        self.done >= self.waypoints
    }
}

/// The result of a contact path.
#[derive(Debug, Clone)]
pub struct AbrasionResult {
    /// Grids that were sanded as planned.
    pub completed: Vec<GridId>,
    /// Grids that were begun but not completed.
    pub incomplete: Vec<GridId>,
    /// Area that the disc swept, mm².
    pub swept_mm2: f64,
    /// The removal over all passes on the part; `None` if the recipe does not require a removal, or if it is not known.
    pub removed: Option<PathRemovalTotal>,
    progress: Progress,
    executed_path: ExecutedPath,
    deviation_limit_mm: f64,
    dwell: Dwell,
    /// The grids beside the planned ones that the disc overlapped.
    beside: Vec<GridDwell>,
    longest_dwell: Option<LongestDwell>,
}

/// The grid with the largest ratio of its dwell time to its planned dwell time.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LongestDwell {
    id: GridId,
    /// Executed time divided by planned time; infinite if no time was planned, or if the executed time is not a number.
    ratio: f64,
}

/// Evaluates the effect of the disc on a contact path, from the reported poses in `trace`.
pub fn evaluate_abrasion(
    plan: &Plan,
    (surface, region): (&BSplineSurface, &Region),
    settings: &recipe::Path,
    (trace, progress): (&Trace, Progress),
    removal: Option<&RemovalInputs<'_>>,
) -> AbrasionResult {
    let disc_mm = settings.disc_diameter_mm();
    let walked = trace.executed_path(&waypoints(plan), progress.done);
    let simulated =
        |poses: &[ExecutedPose]| dwell::simulate_treated(surface, region, &plan.treated, poses, disc_mm / 2.0);
    let dwell = simulated(&walked.poses);
    let longer = longest_dwell(&dwell.grids, &simulated(&dwell::timed_poses(plan)).grids);
    let planned: BTreeSet<GridId> = plan.grids.iter().map(|grid| grid.id).collect();
    let others: Vec<GridId> = region.ids().filter(|id| !planned.contains(id)).collect();
    let beside = overlapped_grids(dwell::simulate(surface, region, &others, &walked.poses, disc_mm / 2.0).grids);
    let (whole, begun) = split_covered(plan, &dwell, progress.done);
    let off_limit_mm = deviation_limit_mm(settings);
    let removed = removal.and_then(|removal| removal.executed_removal(&plan.treated, &walked.poses));
    AbrasionResult {
        completed: whole,
        incomplete: begun,
        swept_mm2: walked.contact_mm * disc_mm,
        removed,
        progress,
        executed_path: walked,
        deviation_limit_mm: off_limit_mm,
        dwell,
        beside,
        longest_dwell: longer,
    }
}

/// Returns the grids that the disc reached.
fn overlapped_grids(grids: Vec<GridDwell>) -> Vec<GridDwell> {
    grids.into_iter().filter(|grid| grid.covered_fraction() > 0.0).collect()
}

/// Returns the maximum distance of a measured pose from the planned path, mm. It includes the blending distance,
/// because a blended corner is at most this far from the planned path.
pub fn deviation_limit_mm(settings: &recipe::Path) -> f64 {
    MAX_PATH_DEVIATION_MM + settings.blend_share() * settings.waypoint_spacing_mm()
}

impl AbrasionResult {
    /// Draws the dwell time, and the number of passes, at each point.
    pub fn draw_dwell(&self, region: &Region) -> [ResultDrawing; 2] {
        let time = "Dwell time of the disc at each point, from the poses that the robot reported";
        let often = "Number of passes of the disc over each point, from the poses that the robot reported";
        [
            ResultDrawing::new("executed", time, dwell_map(&self.dwell, region)),
            ResultDrawing::new("overlap", often, overlap_map(&self.dwell, region)),
        ]
    }

    /// Draws the removal, if it is known.
    pub fn draw_removal(&self, panel: &TaughtPanel) -> Option<ResultDrawing> {
        let caption = "Depth removed by this and earlier passes on this part, calculated from the poses that the \
                       robot reported, µm";
        self.removed.as_ref().map(|removed| removed.draw_map(panel, ("removal_executed", caption)))
    }

    /// Returns the checks of the path: it was executed completely, covered the grids, stayed near the planned path, and
    /// was not too slow.
    fn checks(&self) -> [Check; 4] {
        let Progress { waypoints, done } = self.progress;
        let (off_mm, allowed_mm, begun) =
            (self.executed_path.off_mm, self.deviation_limit_mm, self.incomplete.len() as f64);
        // Full coverage is not expected of an interrupted path.
        let is_not_covered = self.progress.is_complete() && begun > 0.0;
        [
            Check::new(name::EXECUTED_WAYPOINTS_NAME, "", f64::from(done))
                .with_min(f64::from(waypoints), LimitSource::Program)
                .or_review("part", || {
                    format!(
                        "the robot executed only {done} of {waypoints} waypoints; the remaining path was not \
                         executed"
                    )
                }),
            Check::new(name::BEGUN_GRIDS_NAME, "", begun).with_max(0.0, LimitSource::Program).with_consequence_if(
                is_not_covered,
                Severity::Review,
                "not_covered",
                || {
                    format!(
                        "according to the poses that the robot reported, the disc did not cover all of the planned \
                         area of {}; the next water-break test will show the result",
                        names(&self.incomplete).join(", ")
                    )
                },
            ),
            Check::new(name::PATH_DEVIATION_NAME, "mm", off_mm)
                .with_max(allowed_mm, LimitSource::Program)
                .or_review("off_path", || {
                    let [off, allowed] = distinguishable_texts(off_mm, allowed_mm, 2);
                    format!("the robot reported a pose {off} mm away from the planned path (limit {allowed} mm)")
                }),
            self.dwell_ratio_check(),
        ]
    }

    /// Checks the dwell time against the planned dwell time. The covered fraction of a grid does not indicate a dwell
    /// time that is too long, because a slow robot covers everything.
    fn dwell_ratio_check(&self) -> Check {
        let Some(LongestDwell { id, ratio }) = self.longest_dwell else {
            return Check::new(name::DWELL_RATIO_NAME, "", None);
        };
        let severity = if ratio <= MAX_REVIEWED_DWELL_RATIO { Severity::Review } else { Severity::Reject };
        Check::new(name::DWELL_RATIO_NAME, "", ratio).with_max(MAX_DWELL_RATIO, LimitSource::Program).with_consequence(
            severity,
            "dwell_too_long",
            || {
                let [found, allowed] = distinguishable_texts(ratio, MAX_DWELL_RATIO, 2);
                format!(
                    "the dwell time of the disc on {id} was {found} times as long as planned (limit {allowed} times; \
                     above {MAX_REVIEWED_DWELL_RATIO} times the part is rejected); check that the override is 100 % \
                     and that the robot reaches the feed"
                )
            },
        )
    }

    /// Returns the mean, minimum and maximum force that a compliant tool measured at the poses in contact; empty for
    /// another tool.
    fn contact_forces(&self) -> Vec<Check> {
        let on_panel = self.executed_path.poses.iter().filter(|pose| pose.contact);
        let forces_n: Vec<f64> = on_panel.filter_map(|pose| pose.force_n).collect();
        if forces_n.is_empty() {
            return vec![];
        }
        let mean_n = forces_n.iter().sum::<f64>() / forces_n.len() as f64;
        let least_n = forces_n.iter().copied().fold(f64::INFINITY, f64::min);
        let most_n = forces_n.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        [(name::FORCE_MEAN, mean_n), (name::FORCE_MIN, least_n), (name::FORCE_MAX, most_n)]
            .map(|(name, force_n)| Check::new(name, "N", force_n))
            .into()
    }

    /// Returns the result for the record; `most_passes` is the maximum number of passes.
    pub fn finding(&self, pass: u8, most_passes: usize) -> Finding {
        let (walked, dwell) = (&self.executed_path, &self.dwell);
        let [executed, begun, off_path, longer] = self.checks();
        let spread = dwell.spread();
        let of_removal = self
            .removed
            .as_ref()
            .map_or_else(Vec::new, |removed| removed.executed_checks(self.progress.is_complete()));
        // The reasons about the removal precede the reason about the dwell time.
        let judgement =
            Judgement::from_checks([&executed, &begun, &off_path].into_iter().chain(&of_removal).chain([&longer]));
        let finding =
            Finding::new(Kind::Abrade, pass, judgement).with_detail("grids", names(&self.completed)).with_checks([
                executed,
                begun,
                Check::new("pass", "", f64::from(pass))
                    .with_max(most_passes as f64, LimitSource::recipe("process.max_passes_per_grid")),
                Check::new("poses reported on the way", "", walked.reports as f64),
                off_path,
                Check::new("way in contact", "mm", walked.contact_mm),
                Check::new("time under the disc, 5 % of the treated area", "s", spread.map(|spread| spread.low_s)),
                Check::new(
                    "time under the disc, 95 % of the treated area",
                    "s",
                    spread.map(|spread| spread.high_s),
                ),
                longer,
            ]);
        let finding = finding.with_checks(dwell.grids.iter().flat_map(|grid| {
            let id = grid.id;
            [
                Check::new(format!("share of {id} under the disc"), "", grid.covered_fraction()),
                Check::new(format!("of {id} left"), "mm²", grid.untreated_mm2()),
            ]
        }));
        let beside = self.beside.iter();
        let of_beside = beside.map(|grid| Check::new(name::overlapped_share(grid.id), "", grid.covered_fraction()));
        let finding = finding.with_checks(of_beside).with_checks(of_removal).with_checks(self.contact_forces());
        if self.incomplete.is_empty() {
            finding
        } else {
            finding.with_detail("grids_in_part", names(&self.incomplete))
        }
    }
}

/// Returns the verdict of the checks on the executed path. A part that was not executed is not a fault of the executed
/// part: the cycle is then held or aborted, and the remaining part is planned again.
pub fn executed_checks(finding: &Finding) -> Judgement {
    Judgement::from_checks(finding.checks.iter().filter(|check| check.name != name::EXECUTED_WAYPOINTS_NAME))
}

/// Returns the grid with the largest ratio of executed to planned dwell time; `None` if the disc touched nothing. The
/// ratio is computed both for the mean time of the grid and for the 95 % quantile over the grid; the quantile also
/// detects a long time in a part of the grid.
fn longest_dwell(executed: &[GridDwell], planned: &[GridDwell]) -> Option<LongestDwell> {
    let high_s = |grid: &GridDwell| grid.spread().map_or(0.0, |spread| spread.high_s);
    let of_grid = |grid: &GridDwell| {
        let found = [grid.mean_dwell_s(), high_s(grid)];
        let plan = planned
            .iter()
            .find(|plan| plan.id == grid.id)
            .map_or([0.0; 2], |plan| [plan.mean_dwell_s(), high_s(plan)]);
        let ratio = |(found, plan): (f64, f64)| {
            let is_known = plan > 0.0 && found.is_finite();
            if is_known { found / plan } else { f64::INFINITY }
        };
        let ratio = found.into_iter().zip(plan).map(ratio).fold(0.0, f64::max);
        LongestDwell { id: grid.id, ratio }
    };
    let touched = executed.iter().filter(|grid| grid.covered_fraction() > 0.0).map(of_grid);
    touched.max_by(|a, b| a.ratio.total_cmp(&b.ratio))
}

/// Returns the grids of the areas that were begun, in two lists: those covered as planned, and the others.
fn split_covered(plan: &Plan, dwell: &Dwell, done: u32) -> (Vec<GridId>, Vec<GridId>) {
    let executed = done as usize + 1;
    let mut before = 0;
    let (mut whole, mut begun) = (Vec::new(), Vec::new());
    for path in &plan.paths {
        let reached = executed.saturating_sub(before);
        let touched = path.waypoints.iter().take(reached).any(|waypoint| waypoint.contact);
        before += path.waypoints.len();
        for id in path.grids.iter().filter(|_| touched) {
            let planned = plan.grids.iter().find(|grid| grid.id == *id).map_or(1.0, |grid| grid.covered_fraction());
            let found = dwell.grid(*id).map_or(0.0, |grid| grid.covered_fraction());
            // The path of this area was interrupted before the disc reached this grid, or the grid is already in a list
            // because of another area.
            if found <= 0.0 || whole.contains(id) || begun.contains(id) {
                continue;
            }
            let grids = if found >= planned - MAX_COVERAGE_DEFICIT { &mut whole } else { &mut begun };
            grids.push(*id);
        }
    }
    (whole, begun)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a grid with four samples of 1 mm² and these dwell times.
    fn grid(column: usize, dwell_s: [f32; 4]) -> GridDwell {
        let passes = dwell_s.map(|time| u16::from(time > 0.0)).to_vec();
        let id = GridId { row: 1, column };
        GridDwell { id, columns: 2, dwell_s: dwell_s.to_vec(), passes, area_mm2: vec![1.0; 4] }
    }

    fn ratio(executed: [f32; 4], planned: [f32; 4]) -> Option<f64> {
        longest_dwell(&[grid(1, executed)], &[grid(1, planned)]).map(|longer| longer.ratio)
    }

    #[test]
    fn only_a_grid_that_the_disc_reached_is_overlapped() {
        let kept = overlapped_grids(vec![grid(1, [0.0; 4]), grid(2, [0.0, 0.0, 0.0, 0.2])]);
        // Expected value, by hand: the disc reached one of four equal samples of the second grid.
        assert_eq!(
            kept.iter().map(|one| (one.id.to_string(), one.covered_fraction())).collect::<Vec<_>>(),
            [("r1c2".to_owned(), 0.25)]
        );
    }

    /// Two areas around water breaks are in one grid. After the first path the grid is begun; after both paths it is
    /// sanded, and it is listed once.
    #[test]
    fn a_grid_with_two_areas_is_abraded_after_both() {
        use panelprep_toolpath::path::plan_beyond_borders;
        use panelprep_toolpath::surface::scene::{ScanDefects, Shape, recipe, taught};
        use panelprep_toolpath::surface::{HoleMap, Parameter, ParameterPatch, Treated, examine_fit};
        let recipe = recipe(Shape::Plane, "[path]\ndisc_diameter_mm = 10\nstep_over_mm = 4\n");
        let panel = taught(Shape::Plane, ScanDefects::default(), &recipe);
        let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
        // Expected values, calculated by hand: r2c3 extends from 0.4 to 0.6 along u; the areas are 16.8 mm and 11.2 mm
        // wide, with a gap of 11.2 mm.
        let area = |low: f64, high: f64| ParameterPatch {
            low: Parameter { u: low, v: 0.4 },
            high: Parameter { u: high, v: 0.5 },
        };
        let treated = Treated::from_areas(&panel.region, vec![area(0.42, 0.48), area(0.52, 0.56)], vec![]);
        let on = (panel.outline.as_slice(), &HoleMap::empty(&panel.region));
        let plan =
            plan_beyond_borders(&fit.surface, &panel.region, &treated, on, (recipe.path(), 0.0)).expect("a plan");
        let first = plan.paths[0].waypoints.len();
        let after = |waypoints: usize| {
            let poses = &dwell::timed_poses(&plan)[..waypoints];
            let dwell = dwell::simulate_treated(&fit.surface, &panel.region, &plan.treated, poses, 5.0);
            split_covered(&plan, &dwell, waypoints as u32 - 1)
        };
        let grid = GridId { row: 2, column: 3 };
        assert_eq!(after(first), (vec![], vec![grid]));
        let all: usize = plan.paths.iter().map(|path| path.waypoints.len()).sum();
        assert_eq!((plan.paths.len(), after(all)), (2, (vec![grid], vec![])));
    }

    /// Expected ratios, calculated by hand: at an override of 50 % the dwell time at each point is twice as long. A
    /// stop at one of four points gives 1.5 times the mean, and 3 times at this point.
    #[test]
    fn the_dwell_time_of_a_grid_is_compared_with_its_plan() {
        assert_eq!(ratio([2.0; 4], [1.0; 4]), Some(2.0));
        assert_eq!(ratio([1.0; 4], [1.0; 4]), Some(1.0));
        assert_eq!(ratio([1.0, 1.0, 1.0, 3.0], [1.0; 4]), Some(3.0));
        assert_eq!(ratio([0.0; 4], [1.0; 4]), None, "the disc was not there");
        assert_eq!(ratio([0.5; 4], [0.0; 4]), Some(f64::INFINITY), "nothing was planned there");
        // Of an interrupted path, only the executed half is evaluated.
        assert_eq!(ratio([1.0, 1.0, 0.0, 0.0], [1.0; 4]), Some(1.0));
    }
}
