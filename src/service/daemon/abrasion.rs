//! The area that still must be sanded, the plan for it, and the executed part of the plan.

use super::answers::{figure, figure_without_picture, grade_judgement, reason};
use super::error::DaemonError;
use super::perception::{Perception, view};
use super::ports::{Note, Record};
use crate::setup::CycleSetup;
use crate::stages::abrade::{self, Progress};
use crate::stages::plan::{self, PlanOutcome, ReachStart};
use crate::stages::rejected_finding;
use crate::stages::removal::RemovalInputs;
use crate::stages::survey::{self, ToolState};
use crate::stages::treat::{self, Broken};
use panelprep_base::geometry::Mask;
use panelprep_base::geometry::statistics::NORMAL_TWO_SIDED_95;
use panelprep_base::verdict::{Check, Limit, LimitSource, Reason, Severity};
use panelprep_cell::cycle::{Answer, Grade, Trouble};
use panelprep_cell::files::content_hash;
use panelprep_cell::panel::GridId;
use panelprep_cell::record::{Budget, EarlierPass, FirstReached, Kind, PASSES_USED};
use panelprep_toolpath::path::approach::Approach;
use panelprep_toolpath::path::disc::DiscWearPlan;
use panelprep_toolpath::path::routes::waypoints;
use panelprep_toolpath::path::trace::Trace;
use panelprep_toolpath::path::{Kinematics, Plan, dwell, touching};
use panelprep_toolpath::removal::map::RemovalMap;
use panelprep_toolpath::surface::{self, Fit, TodaysScan, Treated};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The last plan, and the work done by all plans of the cycle.
#[derive(Debug, Default, Clone)]
pub(super) struct AbrasionWork {
    /// The taught region's surface, once it is known.
    pub(super) taught: Option<Arc<Fit>>,
    /// The surface fitted to the region in the scan of this cycle; paths are planned on it.
    pub(super) fit: Option<Arc<Fit>>,
    pub(super) plan: Option<(u64, Plan)>,
    /// For each grid the number of passes that touched it, and the last of these passes.
    pub(super) touched: BTreeMap<GridId, (usize, u8)>,
    /// The last pass in which a grid was abraded completely.
    pub(super) done: BTreeMap<GridId, u8>,
    /// The maximum number of abrasions of a grid, from the last plan's recipe.
    pub(super) most_passes: usize,
    /// The area that the disc in use has swept so far, from the store, mm².
    pub worn_mm2: f64,
    /// The material that the passes of this cycle have removed so far, if it is known.
    pub(super) removed: Option<RemovalMap>,
    /// The taught pixels that the disc touched in this cycle, or may have touched: the dry picture does not show their
    /// present appearance.
    pub(super) sanded: Option<Arc<Mask>>,
    /// The passes of earlier cycles of this panel that touched a grid, or may have touched it.
    pub earlier: Vec<EarlierPass>,
    /// Whether the cycle is an air-run.
    pub is_air: bool,
    /// The grade of the check of the last executed contact path; `None` while a path is in progress, and before the
    /// first path.
    pub executed_grade: Option<Grade>,
}

impl AbrasionWork {
    /// Returns the plan with this number, if it is the last one.
    pub fn plan(&self, number: u64) -> Option<&Plan> {
        self.plan.as_ref().filter(|(known, _)| *known == number).map(|(_, plan)| plan)
    }

    /// The last plan.
    pub fn latest_plan(&self) -> Option<&Plan> {
        self.plan.as_ref().map(|(_, plan)| plan)
    }

    /// For the plan with this number, returns the first waypoint at which each grid is reached, the time of each
    /// waypoint, s, and the wear of the disc, mm².
    pub fn contact(&self, cycle: &CycleSetup, number: u64) -> Option<(Vec<FirstReached>, Vec<f64>, f64)> {
        let (plan, fit) = (self.plan(number)?, self.fit.as_ref()?);
        let radius_mm = cycle.recipe.path().disc_diameter_mm() / 2.0;
        let reached = |(grid, first): (GridId, usize)| FirstReached {
            grid: grid.to_string(),
            first: u32::try_from(first).unwrap_or(u32::MAX),
        };
        let first = touching::first_waypoints(plan, &fit.surface, &cycle.panel.region, radius_mm);
        let planned = dwell::timed_poses(plan);
        let reached_s = planned.iter().scan(0.0, |at_s, waypoint| {
            *at_s += waypoint.seconds;
            Some(*at_s)
        });
        let wears_mm2 = DiscWearPlan::compute(plan, cycle.recipe.path(), 0.0).swept_mm2;
        Some((first.into_iter().map(reached).collect(), reached_s.collect(), wears_mm2))
    }

    /// Records that the motion of the plan with this number begins. The motion may touch the whole planned area,
    /// whatever the robot reports later.
    pub fn note_contact_start(&mut self, cycle: &CycleSetup, number: u64) {
        let Some(plan) = self.plan(number) else { return };
        // The whole plan is added, not only its executed part. If an untouched place is treated as sanded, only its dry
        // reference is lost. If a touched place were not treated as sanded, it would be compared with a dry reference
        // that is no longer valid.
        let touched = touching::taught_pixels(plan, &cycle.panel, cycle.recipe.path());
        let before = self.sanded.take();
        let is_sanded = |index: usize| before.as_ref().is_some_and(|before| before.inside[index]);
        let inside =
            touched.inside.iter().enumerate().map(|(index, touched)| *touched || is_sanded(index)).collect();
        self.sanded = Some(Arc::new(Mask { inside, ..touched }));
    }

    /// Records that a new dry picture shows the present appearance of all places that were sanded so far.
    pub fn note_dry_picture(&mut self) {
        self.sanded = None;
    }

    /// Returns the taught pixels whose present appearance is not shown by any dry picture of this cycle.
    pub fn sanded_pixels(&self) -> Option<Arc<Mask>> {
        self.sanded.clone()
    }

    /// After the localization is final, determines the panel's surface and which grids the arm can reach. `found` is
    /// the grade of the localization.
    pub fn survey_region(
        &mut self,
        cycle: &CycleSetup,
        (pass, found, panel): (u8, Grade, &Approach<'_>),
        scan: &TodaysScan,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let taught = match self.as_taught(cycle, record)? {
            Ok(taught) => taught,
            Err(check) => {
                record.finding(&rejected_finding(Kind::Reach, pass, *check))?;
                return Ok(Answer::Graded(Grade::Reject));
            }
        };
        record.figure(&figure_without_picture(survey::draw_surface(&taught.map)))?;
        let today = survey::correct_by_scan((&cycle.panel, &taught), scan, cycle.recipe.surface());
        if let Some(drawing) = today.drawing {
            record.figure(&figure_without_picture(drawing))?;
        }
        // From here on, every path is planned on the surface in today's scan, because the panel may have another shape
        // than the taught panel.
        let fit = self.fit.insert(Arc::new(today.fit)).clone();
        let kinematics = Kinematics::new(&cycle.cell.arm);
        let stand = cycle.corner_tour().reach_setup(&kinematics, panel);
        let surveyed = survey::survey_grids((&cycle.panel, &fit), stand, &cycle.recipe, self.tool(cycle));
        let surveyed = surveyed.with_todays_checks(today.checks);
        let found_reach = surveyed.finding(pass, &fit.deviation, (&cycle.panel, &cycle.recipe));
        let own = grade_judgement(&found_reach.judgement);
        record.finding(&found_reach)?;
        let fit_mm = today
            .rms_mm
            .map_or(fit.deviation.p95_mm, |rms_mm| fit.deviation.p95_mm.max(NORMAL_TWO_SIDED_95 * rms_mm));
        record.budget(&Budget { fit_mm: Some(fit_mm), ..Budget::default() })?;
        // If the localization is doubtful, the result stays doubtful, even if the arm reaches all grids.
        let both = if own == Grade::Accept { found } else { own };
        Ok(Answer::Graded(both))
    }

    /// Returns the surface from today's scan, or the taught surface if today's is not determined yet.
    fn current_surface(
        &mut self,
        cycle: &CycleSetup,
        record: &mut dyn Record,
    ) -> Result<Result<Arc<Fit>, Box<Check>>, DaemonError> {
        match &self.fit {
            Some(fit) => Ok(Ok(fit.clone())),
            None => self.as_taught(cycle, record),
        }
    }

    /// Returns the taught surface; if the surface is refused, records its picture.
    fn as_taught(
        &mut self,
        cycle: &CycleSetup,
        record: &mut dyn Record,
    ) -> Result<Result<Arc<Fit>, Box<Check>>, DaemonError> {
        if let Some(taught) = &self.taught {
            return Ok(Ok(taught.clone()));
        }
        match surface::examine_fit(&cycle.panel, cycle.recipe.surface()) {
            Ok(taught) => Ok(Ok(self.taught.insert(Arc::new(taught)).clone())),
            Err(refusal) => {
                if let Some(map) = &refusal.map {
                    record.figure(&figure_without_picture(survey::draw_surface(map)))?;
                }
                Ok(Err(Box::new(refusal.error.failed_check())))
            }
        }
    }

    /// Plans a path over the failed grids that this pass has not sanded yet. Pass 0 is an air-run; its path covers all
    /// grids.
    pub fn plan_failed_grids(
        &mut self,
        cycle: &CycleSetup,
        (pass, perception): (u8, &Perception),
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let failed: Vec<GridId> = match (pass, perception.inspections.last()) {
            // An air-run has no film, so its path covers the whole region.
            (0, _) => cycle.panel.region.ids().collect(),
            (_, Some(film)) => film.grids.iter().filter(|grid| grid.failed).map(|grid| grid.id).collect(),
            (_, None) => return Ok(Answer::Failed(Trouble::Unexpected)),
        };
        // The former plan is deleted before a new one is computed, so that after a refused plan no path can be sent.
        self.plan = None;
        self.most_passes = cycle.recipe.process().max_passes_per_grid();
        let max_passes = self.most_passes;
        let left = failed.into_iter().filter(|grid| self.done.get(grid) != Some(&pass));
        let (worn, grids): (Vec<GridId>, Vec<GridId>) =
            left.partition(|grid| self.has_reached_pass_limit(grid, pass, max_passes));
        if grids.is_empty() && worn.is_empty() {
            return Ok(Answer::Planned { plan: 0, waypoints: 0 });
        }
        let Some(panel) = perception.approach() else { return Ok(Answer::Failed(Trouble::Unexpected)) };
        let place = panel.base_from_panel;
        let planned = if grids.is_empty() {
            Err(self.passes_used(&worn, max_passes))
        } else {
            self.current_surface(cycle, record)?.and_then(|fit| {
                let treated = self.treated(cycle, (&fit, &grids), (pass, perception));
                self.plan_grids(cycle, (&fit, &treated, &grids), &panel)
            })
        };
        let planned = match planned {
            Ok(planned) => planned,
            Err(check) => {
                record.finding(&rejected_finding(Kind::Plan, pass, *check))?;
                return Ok(Answer::Graded(Grade::Reject));
            }
        };
        let planned = planned.with_break_position_check(perception.located_mm, &cycle.recipe);
        let finding = planned.finding(pass, &grids);
        let grade = grade_judgement(&finding.judgement);
        if let Some(film) = &perception.film_picture {
            record.figure(&figure(planned.draw_plan(&cycle.panel, &view(cycle, film, place)), film))?;
        }
        if let Some(drawing) = planned.draw_removal(&cycle.panel) {
            record.figure(&figure_without_picture(drawing))?;
        }
        let earlier = self.describe_earlier_passes(planned.plan.treated.grids());
        record.finding(&match earlier.is_empty() {
            true => finding,
            false => finding.with_detail("sanded in earlier cycles, counted", earlier),
        })?;
        if grade == Grade::Reject {
            return Ok(Answer::Graded(grade));
        }
        let (plan, waypoints) = self.store_plan(planned.plan);
        Ok(match grade {
            Grade::Accept => Answer::Planned { plan, waypoints },
            _ => Answer::PlannedForReview { plan, waypoints },
        })
    }

    /// Returns the area that a pass sands because of these failed grids: whole grids, or areas around their water
    /// breaks. An area may extend into a grid that did not fail; this grid is then recorded as sanded. Therefore no
    /// area extends into a grid that has reached its maximum number of passes, or that an interrupted path of this pass
    /// has already sanded.
    fn treated(
        &self,
        cycle: &CycleSetup,
        (fit, failed): (&Fit, &[GridId]),
        (pass, perception): (u8, &Perception),
    ) -> Treated {
        let Some(film) = perception.inspections.last().filter(|_| pass > 0) else {
            return Treated::from_grids(failed);
        };
        let is_spared = |grid: &GridId| {
            self.done.get(grid) == Some(&pass) || self.has_reached_pass_limit(grid, pass, self.most_passes)
        };
        let spared: Vec<GridId> = cycle.panel.region.ids().filter(is_spared).collect();
        treat::treated((&cycle.panel, fit), &Broken::from_film(film), (failed, &spared), &cycle.recipe)
    }

    fn has_reached_pass_limit(&self, grid: &GridId, pass: u8, most: usize) -> bool {
        let last = self.touched.get(grid).map(|(_, last)| *last);
        // An air-run sands nothing. The rest of an interrupted pass is not a new pass.
        pass > 0 && self.times(grid) >= most && last != Some(pass)
    }

    /// Returns the number of passes over a grid, in this cycle and in the earlier cycles that are counted for it.
    fn times(&self, grid: &GridId) -> usize {
        self.touched.get(grid).map_or(0, |(times, _)| *times) + self.earlier_passes(grid).count()
    }

    /// Returns the passes of earlier cycles that are counted for this grid.
    fn earlier_passes(&self, grid: &GridId) -> impl Iterator<Item = &EarlierPass> {
        let grid = grid.to_string();
        self.earlier.iter().filter(move |earlier| earlier.grid.as_ref().is_none_or(|known| *known == grid))
    }

    /// Describes the passes of earlier cycles that are counted for these grids.
    fn describe_earlier_passes(&self, grids: &[GridId]) -> Vec<String> {
        let words = |grid: &GridId, earlier: &EarlierPass| {
            let EarlierPass { cycle, pass, .. } = earlier;
            if earlier.is_stated {
                return format!(
                    "{grid} sanded in cycles that are not in the restored store, as stated at the start of cycle \
                     {cycle}, pass {pass}"
                );
            }
            let how = if earlier.is_sure { "sanded" } else { "perhaps sanded" };
            format!("{grid} {how} in cycle {cycle}, pass {pass}")
        };
        grids.iter().flat_map(|grid| self.earlier_passes(grid).map(move |earlier| words(grid, earlier))).collect()
    }

    fn passes_used(&self, worn: &[GridId], most: usize) -> Box<Check> {
        let names = worn.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        let earlier = self.describe_earlier_passes(worn);
        let message = match earlier.is_empty() {
            true => {
                format!("the film broke again on {names} after {most} sanding passes (limit max_passes_per_grid)")
            }
            false => format!(
                "the film broke on {names}, and the limit of {most} sanding passes (max_passes_per_grid) is reached. \
                 Passes in earlier cycles of this panel are counted, even if they may be incomplete: {}. Take this \
                 part out. If it is another part, name its serial number or start with --another-part: the count \
                 then begins at zero",
                earlier.join("; ")
            ),
        };
        let times = worn.iter().map(|grid| self.times(grid)).max().unwrap_or(most);
        let check = Check::new("sanding passes over a grid so far", "", times as f64)
            .with_limit(Limit::Below(most as f64), LimitSource::recipe("process.max_passes_per_grid"));
        Box::new(check.or_reject(PASSES_USED, || message))
    }

    /// Plans over these areas if this sands less surface in less time, otherwise over the complete failed grids. The
    /// tool is rotated to the angle at which the arm reaches the path best. The plan must pass all plan checks.
    fn plan_grids(
        &self,
        cycle: &CycleSetup,
        (fit, treated, failed): (&Fit, &Treated, &[GridId]),
        panel: &Approach<'_>,
    ) -> Result<PlanOutcome, Box<Check>> {
        let on = (&cycle.panel, fit);
        let plan = plan::lay_lesser_paths(on, (treated, failed), (&cycle.recipe, self.tool(cycle)))
            .map_err(|error| refused(reason("no_path", &error)))?;
        let kinematics = Kinematics::new(&cycle.cell.arm);
        let reach = ReachStart::From(cycle.corner_tour().reach_setup(&kinematics, panel).map_err(refused)?);
        Ok(plan::judge(
            plan,
            on,
            reach,
            (&cycle.recipe, self.tool(cycle)),
            (self.removed.as_ref(), cycle.removed_before),
        ))
    }

    fn tool(&self, cycle: &CycleSetup) -> ToolState {
        let removal = cycle.calibrations.removal;
        let stroke_mm = cycle.cell.tool.as_ref().map(|tool| tool.stroke_mm);
        ToolState {
            error_mm: cycle.cell.limits.tool_error_mm(),
            worn_mm2: self.worn_mm2,
            removal,
            stroke_mm,
            in_air: self.is_air,
        }
    }

    /// Stores a plan. Returns the plan's number, and the number of waypoints after the air point of the approach.
    fn store_plan(&mut self, plan: Plan) -> (u64, u32) {
        let all = waypoints(&plan);
        let text: Vec<String> = all.iter().map(|waypoint| format!("{:?}", waypoint.pose())).collect();
        // The plan's number is computed from the poses: if a replay plans another path, the number differs and the
        // replay reports the difference.
        let hash = content_hash(text.join("\n").as_bytes());
        // Sixteen hexadecimal digits always fit into 64 bits.
        let number = hash.get(..16).and_then(|digits| u64::from_str_radix(digits, 16).ok()).unwrap_or_default();
        self.plan = Some((number, plan));
        (number, u32::try_from(all.len().saturating_sub(1)).unwrap_or(u32::MAX))
    }

    /// Evaluates the executed part of the plan's path from the number of all waypoints, the number of executed
    /// waypoints, and the robot's reports. Also returns the wear of the disc, mm².
    pub fn evaluate_executed(
        &mut self,
        cycle: &CycleSetup,
        (pass, trace): (u8, &Trace),
        (all, done): (u32, u32),
    ) -> (Vec<Note>, f64) {
        let (Some(fit), Some((_, plan))) = (self.fit.clone(), &self.plan) else { return (Vec::new(), 0.0) };
        let (on, progress) = ((&fit.surface, &cycle.panel.region), Progress { waypoints: all, done });
        let (panel, recipe) = (&cycle.panel, &cycle.recipe);
        let removal = RemovalInputs {
            panel,
            fit: &fit,
            recipe,
            tool: self.tool(cycle),
            earlier: self.removed.as_ref(),
            earlier_removal: cycle.removed_before,
        };
        let abraded = abrade::evaluate_abrasion(plan, on, cycle.recipe.path(), (trace, progress), Some(&removal));
        if let Some(removed) = &abraded.removed {
            self.removed = Some(removed.map.clone());
        }
        for grid in abraded.completed.iter().chain(&abraded.incomplete) {
            let (times, last) = self.touched.entry(*grid).or_insert((0, 0));
            // The rest of an interrupted pass is part of the same pass over the grid, and is not counted again.
            *times += usize::from(*last != pass);
            *last = pass;
        }
        self.done.extend(abraded.completed.iter().map(|grid| (*grid, pass)));
        let drawn = abraded.draw_dwell(&cycle.panel.region).into_iter().chain(abraded.draw_removal(&cycle.panel));
        let figures = drawn.map(|drawing| Note::Figure(figure_without_picture(drawing)));
        let finding = abraded.finding(pass, self.most_passes);
        self.executed_grade = Some(grade_judgement(&abrade::executed_checks(&finding)));
        let notes = figures.chain([Note::Finding(finding)]).collect();
        (notes, abraded.swept_mm2)
    }

    /// Returns the number of passes that touched each grid.
    pub fn pass_counts(&self) -> impl Iterator<Item = (GridId, usize)> + '_ {
        self.touched.iter().map(|(grid, (times, _))| (*grid, *times))
    }
}

/// Returns the failed check for a path that cannot be planned or reached.
fn refused(reason: Reason) -> Box<Check> {
    Box::new(Check::new("a path over these grids", "", None).with_reason(Some(reason), Severity::Reject))
}
