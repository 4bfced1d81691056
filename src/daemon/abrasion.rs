//! What is still to be abraded, the plan over it, and what of it was executed.

use super::ports::{Finding, Record};
use super::routes::waypoints;
use super::sight::{grade, reason};
use super::{DaemonError, Job};
use crate::cycle::{Answer, Grade, Trouble};
use crate::files::content_hash;
use crate::inspect::Inspection;
use crate::panel::GridId;
use crate::path::{self, Plan};
use crate::surface;
use crate::verdict::{Judgement, Reason};
use serde_json::json;
use std::collections::BTreeMap;

/// The plan and what was done of all of them.
#[derive(Debug, Default, Clone)]
pub(super) struct Abrasion {
    plan: Option<(u64, Plan)>,
    /// In how many passes a grid was touched, and the last of them.
    touched: BTreeMap<GridId, (usize, u8)>,
    /// The last pass in which a grid was abraded whole.
    done: BTreeMap<GridId, u8>,
}

impl Abrasion {
    /// The plan with this number.
    pub fn plan(&self, number: u64) -> Option<&Plan> {
        self.plan.as_ref().filter(|(known, _)| *known == number).map(|(_, plan)| plan)
    }

    /// The last plan.
    pub fn latest(&self) -> Option<&Plan> {
        self.plan.as_ref().map(|(_, plan)| plan)
    }

    /// Plans a path over the failed grids that this pass has not yet abraded; in pass 0, an air-run, over all grids.
    pub fn make(
        &mut self,
        job: &Job<'_>,
        (pass, inspection): (u8, Option<&Inspection>),
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let failed: Vec<GridId> = match (pass, inspection) {
            // An air-run has no film and shows the whole region.
            (0, _) => job.panel.region.ids().collect(),
            (_, Some(film)) => film.grids.iter().filter(|grid| grid.failed).map(|grid| grid.id).collect(),
            (_, None) => return Ok(Answer::Failed(Trouble::Unexpected)),
        };
        self.plan = None;
        let most = job.recipe.process().max_passes_per_grid();
        let left: Vec<GridId> = failed.into_iter().filter(|grid| self.done.get(grid) != Some(&pass)).collect();
        let worn: Vec<String> =
            left.iter().filter(|grid| self.is_worn(grid, pass, most)).map(ToString::to_string).collect();
        let grids: Vec<GridId> = left.into_iter().filter(|grid| !self.is_worn(grid, pass, most)).collect();
        if grids.is_empty() && worn.is_empty() {
            return Ok(Answer::Planned { plan: 0, waypoints: 0 });
        }
        let planned = if grids.is_empty() {
            let message = format!("{} broke again after {most} abrasions, max_passes_per_grid", worn.join(", "));
            Err(Reason::new("passes_used", message))
        } else {
            self.over(job, &grids)
        };
        let (judgement, numbers, plan) = match planned {
            Ok((plan, deviation)) => {
                let judgement = path::judge(&plan, job.recipe.path());
                let numbers = numbers(job, &plan, &deviation, &grids);
                (judgement, numbers, Some(plan))
            }
            Err(reason) => (Judgement::of(vec![reason], vec![]), json!({}), None),
        };
        let grade = grade(&judgement);
        record.finding(&Finding { stage: "plan", pass, judgement, numbers })?;
        Ok(match plan.filter(|_| grade == Grade::Accept) {
            Some(plan) => self.keep(plan),
            // A doubtful plan is not executed either.
            None => Answer::Graded(Grade::Reject),
        })
    }

    fn is_worn(&self, grid: &GridId, pass: u8, most: usize) -> bool {
        // The rest of a pass that was left belongs to that pass.
        self.touched.get(grid).is_some_and(|(times, last)| *times >= most && *last != pass)
    }

    fn over(&self, job: &Job<'_>, grids: &[GridId]) -> Result<(Plan, surface::Deviation), Reason> {
        let fit = surface::fit(job.panel, job.recipe.surface()).map_err(|error| reason("no_surface", &error))?;
        let (region, outline) = (&job.panel.region, &job.panel.outline);
        let plan = path::plan(&fit.surface, region, grids, outline, job.recipe.path());
        Ok((plan.map_err(|error| reason("no_path", &error))?, fit.deviation))
    }

    fn keep(&mut self, plan: Plan) -> Answer {
        let all = waypoints(&plan);
        let text: Vec<String> = all.iter().map(|waypoint| format!("{:?}", waypoint.pose)).collect();
        let hash = content_hash(text.join("\n").as_bytes());
        // Sixty-four bits of hexadecimal digits always are a number.
        let number = hash.get(..16).and_then(|digits| u64::from_str_radix(digits, 16).ok()).unwrap_or_default();
        self.plan = Some((number, plan));
        // The first point is the air point of the approach.
        Answer::Planned { plan: number, waypoints: u32::try_from(all.len().saturating_sub(1)).unwrap_or(u32::MAX) }
    }

    /// Of the plan's path this many waypoints were executed.
    pub fn executed(&mut self, pass: u8, done: u32) {
        let Some((_, plan)) = &self.plan else { return };
        // Waypoints are counted from the second one on.
        let executed = done as usize + 1;
        let mut before = 0;
        for path in &plan.paths {
            let contact =
                |reached: usize| path.waypoints.iter().take(reached).filter(|waypoint| waypoint.contact).count();
            let (reached, all) = (contact(executed.saturating_sub(before)), contact(usize::MAX));
            before += path.waypoints.len();
            for grid in path.grids.iter().filter(|_| reached > 0) {
                let (times, last) = self.touched.entry(*grid).or_insert((0, 0));
                *times += usize::from(*last != pass);
                *last = pass;
                if reached == all {
                    self.done.insert(*grid, pass);
                }
            }
        }
    }

    /// In how many passes each grid was touched.
    pub fn passes(&self) -> impl Iterator<Item = (GridId, usize)> + '_ {
        self.touched.iter().map(|(grid, (times, _))| (*grid, *times))
    }
}

fn numbers(job: &Job<'_>, plan: &Plan, deviation: &surface::Deviation, grids: &[GridId]) -> serde_json::Value {
    let grids: Vec<String> = grids.iter().map(ToString::to_string).collect();
    json!({
        "grids": grids, "paths": plan.paths.len(), "waypoints": waypoints(plan).len(), "length_mm": plan.length_mm,
        "duration_s": plan.duration_s, "coverage": plan.coverage,
        "surface_rms_mm": deviation.rms_mm, "max_rms_mm": job.recipe.surface().max_rms_mm(),
        "max_passes_per_grid": job.recipe.process().max_passes_per_grid(),
    })
}
