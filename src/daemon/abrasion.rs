//! What is still to be abraded, the plan over it, and what of it was executed.

use super::computing::Note;
use super::ports::Record;
use super::reaching::Approached;
use super::routes::waypoints;
use super::sight::{Sight, grade, reason};
use super::trace::Trace;
use super::{DaemonError, Job, figures, findings, reaching};
use crate::cycle::{Answer, Grade, Trouble};
use crate::files::content_hash;
use crate::panel::GridId;
use crate::path::disc::DiscUse;
use crate::path::dwell::{self, Dwell};
use crate::path::{self, Kinematics, Plan, panel_reach, touching};
use crate::record::{Budget, EarlierPass, Kind, PASSES_USED, Reached};
use crate::surface::{self, Fit};
use crate::verdict::{Judgement, Reason};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The plan and what was done of all of them.
#[derive(Debug, Default, Clone)]
pub(super) struct Abrasion {
    /// The taught region's surface, once it is known.
    fit: Option<Arc<Fit>>,
    plan: Option<(u64, Plan)>,
    /// In how many passes a grid was touched, and the last of them.
    touched: BTreeMap<GridId, (usize, u8)>,
    /// The last pass in which a grid was abraded whole.
    done: BTreeMap<GridId, u8>,
    /// How often a grid may be abraded, as the last plan's recipe says.
    most_passes: usize,
    /// What the disc in use has swept so far, as the store says, mm².
    pub worn_mm2: f64,
    /// Where the tool was in earlier cycles of this panel, or may have been.
    pub earlier: Vec<EarlierPass>,
}

/// A report may lie this far beside the planned lines where they are straight, mm: what the drives leave.
const OFF_PATH_MM: f64 = 1.0;
/// An executed grid may be covered by so much less than planned: reports are some millimetres apart.
const SHORT_OF_PLAN: f64 = 0.01;

impl Abrasion {
    /// The plan with this number.
    pub fn plan(&self, number: u64) -> Option<&Plan> {
        self.plan.as_ref().filter(|(known, _)| *known == number).map(|(_, plan)| plan)
    }

    /// The last plan.
    pub fn latest(&self) -> Option<&Plan> {
        self.plan.as_ref().map(|(_, plan)| plan)
    }

    /// Of the plan with this number: from which waypoint on each grid is reached, when each waypoint is, s, and what it
    /// wears of the disc, mm².
    pub fn contact(&self, job: &Job<'_>, number: u64) -> Option<(Vec<Reached>, Vec<f64>, f64)> {
        let (plan, fit) = (self.plan(number)?, self.fit.as_ref()?);
        let radius_mm = job.recipe.path().disc_diameter_mm() / 2.0;
        let reached = |(grid, first): (GridId, usize)| Reached {
            grid: grid.to_string(),
            first: u32::try_from(first).unwrap_or(u32::MAX),
        };
        let first = touching::first_reached(plan, &fit.surface, &job.panel.region, radius_mm);
        let planned = dwell::planned(plan);
        let reached_s = planned.iter().scan(0.0, |at_s, waypoint| {
            *at_s += waypoint.seconds;
            Some(*at_s)
        });
        let wears_mm2 = DiscUse::of(plan, job.recipe.path(), 0.0).swept_mm2;
        Some((first.into_iter().map(reached).collect(), reached_s.collect(), wears_mm2))
    }

    /// Once the panel is localized as well as it will be: its surface, and the arm's reach of every grid. `found` is
    /// the localization's own grade.
    pub fn survey(
        &mut self,
        job: &Job<'_>,
        (pass, found, panel): (u8, Grade, &Approached<'_>),
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let fit = match self.fitted(job, record)? {
            Ok(fit) => fit,
            Err(reason) => {
                record.finding(&findings::rejected(Kind::Reach, pass, reason))?;
                return Ok(Answer::Graded(Grade::Reject));
            }
        };
        let (grids, judgement) = reaching::survey(job, &fit, panel, self.worn_mm2);
        let own = grade(&judgement);
        record.figure(&figures::surface(&fit.map))?;
        record.finding(&findings::surveyed(&fit.deviation, &grids, (pass, judgement), job))?;
        record.budget(&Budget { fit_mm: Some(fit.deviation.p95_mm), ..Budget::default() })?;
        let both = if own == Grade::Accept { found } else { own };
        Ok(Answer::Graded(both))
    }

    /// The surface; a refusal leaves its picture.
    fn fitted(&mut self, job: &Job<'_>, record: &mut dyn Record) -> Result<Result<Arc<Fit>, Reason>, DaemonError> {
        if let Some(fit) = &self.fit {
            return Ok(Ok(fit.clone()));
        }
        match surface::examine(job.panel, job.recipe.surface()) {
            Ok(fit) => Ok(Ok(self.fit.insert(Arc::new(fit)).clone())),
            Err(refusal) => {
                if let Some(map) = &refusal.map {
                    record.figure(&figures::surface(map))?;
                }
                Ok(Err(reason("no_surface", &refusal.error)))
            }
        }
    }

    /// Plans a path over the failed grids that this pass has not yet abraded; in pass 0, an air-run, over all grids.
    pub fn make(
        &mut self,
        job: &Job<'_>,
        (pass, sight): (u8, &Sight),
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let failed: Vec<GridId> = match (pass, sight.inspections.last()) {
            // An air-run has no film and shows the whole region.
            (0, _) => job.panel.region.ids().collect(),
            (_, Some(film)) => film.grids.iter().filter(|grid| grid.failed).map(|grid| grid.id).collect(),
            (_, None) => return Ok(Answer::Failed(Trouble::Unexpected)),
        };
        self.plan = None;
        self.most_passes = job.recipe.process().max_passes_per_grid();
        let most = self.most_passes;
        let left = failed.into_iter().filter(|grid| self.done.get(grid) != Some(&pass));
        let (worn, grids): (Vec<GridId>, Vec<GridId>) = left.partition(|grid| self.is_worn(grid, pass, most));
        if grids.is_empty() && worn.is_empty() {
            return Ok(Answer::Planned { plan: 0, waypoints: 0 });
        }
        let Some(panel) = sight.approached() else { return Ok(Answer::Failed(Trouble::Unexpected)) };
        let place = panel.base_from_panel;
        let planned = if grids.is_empty() {
            Err(self.passes_used(&worn, most))
        } else {
            self.fitted(job, record)?.and_then(|fit| self.over(job, (&fit, &grids), &panel))
        };
        let Planned { plan, reached, disc, judgement } = match planned {
            Ok(planned) => planned,
            Err(reason) => {
                record.finding(&findings::rejected(Kind::Plan, pass, reason))?;
                return Ok(Answer::Graded(Grade::Reject));
            }
        };
        let grade = grade(&judgement);
        if let Some(film) = &sight.film_picture {
            record.figure(&figures::planned(job, &plan, film, place))?;
        }
        let evidence = (&plan, reached.as_ref(), &disc);
        let earlier = self.counted_before(&grids);
        let finding = findings::planned(evidence, &grids, (pass, judgement), job);
        record.finding(&match earlier.is_empty() {
            true => finding,
            false => finding.detail("abraded in earlier cycles, counted", earlier),
        })?;
        if grade == Grade::Reject {
            return Ok(Answer::Graded(grade));
        }
        let (plan, waypoints) = self.keep(plan);
        Ok(match grade {
            Grade::Accept => Answer::Planned { plan, waypoints },
            _ => Answer::PlannedForReview { plan, waypoints },
        })
    }

    fn is_worn(&self, grid: &GridId, pass: u8, most: usize) -> bool {
        let (times, last) = self.touched.get(grid).map_or((0, None), |(times, last)| (*times, Some(*last)));
        // An air-run abrades nothing; the rest of a pass that was left belongs to that pass.
        pass > 0 && times + self.before(grid).count() >= most && last != Some(pass)
    }

    /// The passes of earlier cycles that count for this grid.
    fn before(&self, grid: &GridId) -> impl Iterator<Item = &EarlierPass> {
        let grid = grid.to_string();
        self.earlier.iter().filter(move |earlier| earlier.grid.as_ref().is_none_or(|known| *known == grid))
    }

    /// What of earlier cycles counts for these grids, in words.
    fn counted_before(&self, grids: &[GridId]) -> Vec<String> {
        let words = |grid: &GridId, earlier: &EarlierPass| {
            let how = if earlier.is_sure { "abraded" } else { "perhaps abraded" };
            format!("{grid} {how} in cycle {}, pass {}", earlier.cycle, earlier.pass)
        };
        grids.iter().flat_map(|grid| self.before(grid).map(move |earlier| words(grid, earlier))).collect()
    }

    fn passes_used(&self, worn: &[GridId], most: usize) -> Reason {
        let names = worn.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        let earlier = self.counted_before(worn);
        let message = match earlier.is_empty() {
            true => format!("{names} broke again after {most} abrasions, max_passes_per_grid"),
            false => format!(
                "{names} broke, and may not be abraded again: allowed are {most} abrasions, max_passes_per_grid, and \
                 those of earlier cycles of this panel count, also where it is not known how far they went: {}; take this \
                 part out, the next cycle counts from zero",
                earlier.join("; ")
            ),
        };
        Reason::new(PASSES_USED, message)
    }

    /// A plan over these grids, the tool turned as the arm reaches best, with every gate's word.
    fn over(
        &self,
        job: &Job<'_>,
        (fit, grids): (&Fit, &[GridId]),
        panel: &Approached<'_>,
    ) -> Result<Planned, Reason> {
        let (taught, settings) = (job.panel, job.recipe.path());
        let holes = fit.map.holes(&taught.region, settings.lift_hole_mm());
        let around = (taught.outline.as_slice(), &holes);
        let plan = path::plan_around(&fit.surface, &taught.region, grids, around, settings)
            .map_err(|error| reason("no_path", &error))?;
        let arm = Kinematics::new(job.arm);
        let reached = panel_reach::of_plan(&plan, &reaching::stand(job, &arm, panel)?, settings);
        let disc = DiscUse::of(&plan, settings, self.worn_mm2);
        let worn = disc.change("this path").into_iter().collect();
        let judgement = panel_reach::judge_plan(&reached, (&fit.surface, &taught.region))
            .and(path::judge(&plan, settings))
            .and(path::judge_pad(settings, job.limits.tool_error_mm()))
            .and(Judgement::of(vec![], worn));
        let reached = reached.ok();
        let plan = match &reached {
            Some(reached) => panel_reach::turned(&plan, reached.spin),
            None => plan,
        };
        Ok(Planned { plan, reached, disc, judgement })
    }

    /// Keeps a plan: its number, and its waypoints after the air point of the approach.
    fn keep(&mut self, plan: Plan) -> (u64, u32) {
        let all = waypoints(&plan);
        let text: Vec<String> = all.iter().map(|waypoint| format!("{:?}", waypoint.pose())).collect();
        let hash = content_hash(text.join("\n").as_bytes());
        // Sixty-four bits of hexadecimal digits always are a number.
        let number = hash.get(..16).and_then(|digits| u64::from_str_radix(digits, 16).ok()).unwrap_or_default();
        self.plan = Some((number, plan));
        (number, u32::try_from(all.len().saturating_sub(1)).unwrap_or(u32::MAX))
    }

    /// Of the plan's path so many waypoints of all were executed, by way of these reports. What the disc wore comes
    /// beside the finding, mm².
    pub fn executed(
        &mut self,
        job: &Job<'_>,
        (pass, trace): (u8, &Trace),
        (all, done): (u32, u32),
    ) -> (Vec<Note>, f64) {
        let (Some(fit), Some((_, plan))) = (self.fit.clone(), &self.plan) else { return (Vec::new(), 0.0) };
        let settings = job.recipe.path();
        let disc_mm = settings.disc_diameter_mm();
        // A rounded corner leaves the lines by less than its rounding.
        let off_mm = OFF_PATH_MM + settings.blend_share() * settings.waypoint_spacing_mm();
        let walked = trace.walked(&waypoints(plan), done);
        let planned: Vec<GridId> = plan.grids.iter().map(|grid| grid.id).collect();
        let region = &job.panel.region;
        let dwell = dwell::simulate(&fit.surface, region, &planned, &walked.poses, disc_mm / 2.0);
        let (whole, begun) = judged(plan, &dwell, done);
        for grid in whole.iter().chain(&begun) {
            let (times, last) = self.touched.entry(*grid).or_insert((0, 0));
            *times += usize::from(*last != pass);
            *last = pass;
        }
        self.done.extend(whole.iter().map(|grid| (*grid, pass)));
        let finding =
            findings::abraded((pass, self.most_passes), (all, done), (&whole, &begun), (&walked, &dwell), off_mm);
        let figures = figures::dwelt(job, &dwell).map(Note::Figure);
        let notes = figures.into_iter().chain([Note::Finding(finding)]).collect();
        (notes, walked.contact_mm * disc_mm)
    }

    /// In how many passes each grid was touched.
    pub fn passes(&self) -> impl Iterator<Item = (GridId, usize)> + '_ {
        self.touched.iter().map(|(grid, (times, _))| (*grid, *times))
    }
}

/// A plan with every gate's word on it.
struct Planned {
    plan: Plan,
    reached: Option<panel_reach::Reached>,
    disc: DiscUse,
    judgement: Judgement,
}

/// Of the areas that were begun, the grids that were covered as planned, and the others.
fn judged(plan: &Plan, dwell: &Dwell, done: u32) -> (Vec<GridId>, Vec<GridId>) {
    // Waypoints are counted from the second one on.
    let executed = done as usize + 1;
    let mut before = 0;
    let (mut whole, mut begun) = (Vec::new(), Vec::new());
    for path in &plan.paths {
        let reached = executed.saturating_sub(before);
        let touched = path.waypoints.iter().take(reached).any(|waypoint| waypoint.contact);
        before += path.waypoints.len();
        for id in path.grids.iter().filter(|_| touched) {
            let planned = plan.grids.iter().find(|grid| grid.id == *id).map_or(1.0, |grid| grid.share());
            let found = dwell.of_grid(*id).map_or(0.0, |grid| grid.share());
            // Of an area that was cut short, the grids that the disc did not come to.
            if found <= 0.0 {
                continue;
            }
            let grids = if found >= planned - SHORT_OF_PLAN { &mut whole } else { &mut begun };
            grids.push(*id);
        }
    }
    (whole, begun)
}
