//! What is still to be abraded, the plan over it, and what of it was executed.

use super::ports::{Finding, Record};
use super::routes::waypoints;
use super::sight::{Sight, grade, reason};
use super::{DaemonError, Job, figures, findings};
use crate::cycle::{Answer, Grade, Trouble};
use crate::files::content_hash;
use crate::panel::GridId;
use crate::path::{self, Plan};
use crate::record::{Budget, Kind};
use crate::surface;
use crate::verdict::Reason;
use std::collections::BTreeMap;

/// The plan and what was done of all of them.
#[derive(Debug, Default, Clone)]
pub(super) struct Abrasion {
    plan: Option<(u64, Plan)>,
    /// In how many passes a grid was touched, and the last of them.
    touched: BTreeMap<GridId, (usize, u8)>,
    /// The last pass in which a grid was abraded whole.
    done: BTreeMap<GridId, u8>,
    /// How often a grid may be abraded, as the last plan's recipe says.
    most_passes: usize,
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
        let (plan, deviation) = match planned {
            Ok(planned) => planned,
            Err(reason) => {
                record.finding(&findings::rejected(Kind::Plan, pass, reason))?;
                return Ok(Answer::Graded(Grade::Reject));
            }
        };
        let judgement = path::judge(&plan, job.recipe.path());
        let grade = grade(&judgement);
        if let (Some(film), Some(place)) = (&sight.film_picture, sight.place()) {
            record.figure(&figures::planned(job, &plan, film, place))?;
        }
        record.finding(&findings::planned((&plan, &deviation), &grids, (pass, judgement), job))?;
        record.budget(&Budget { fit_mm: Some(deviation.p95_mm), ..Budget::default() })?;
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
        // The rest of a pass that was left belongs to that pass.
        self.touched.get(grid).is_some_and(|(times, last)| *times >= most && *last != pass)
    }

    fn over(&self, job: &Job<'_>, grids: &[GridId]) -> Result<(Plan, surface::Deviation), Reason> {
        let fit = surface::fit(job.panel, job.recipe.surface()).map_err(|error| reason("no_surface", &error))?;
        let (region, outline) = (&job.panel.region, &job.panel.outline);
        let plan = path::plan(&fit.surface, region, grids, outline, job.recipe.path());
        Ok((plan.map_err(|error| reason("no_path", &error))?, fit.deviation))
    }

    /// Keeps a plan: its number, and its waypoints after the air point of the approach.
    fn keep(&mut self, plan: Plan) -> (u64, u32) {
        let all = waypoints(&plan);
        let text: Vec<String> = all.iter().map(|waypoint| format!("{:?}", waypoint.pose)).collect();
        let hash = content_hash(text.join("\n").as_bytes());
        // Sixty-four bits of hexadecimal digits always are a number.
        let number = hash.get(..16).and_then(|digits| u64::from_str_radix(digits, 16).ok()).unwrap_or_default();
        self.plan = Some((number, plan));
        (number, u32::try_from(all.len().saturating_sub(1)).unwrap_or(u32::MAX))
    }

    /// Of the plan's path so many waypoints of all were executed.
    pub fn executed(&mut self, pass: u8, (waypoints, done): (u32, u32)) -> Finding {
        let (mut whole, mut begun) = (Vec::new(), Vec::new());
        let paths = self.plan.iter().flat_map(|(_, plan)| &plan.paths);
        // Waypoints are counted from the second one on.
        let executed = done as usize + 1;
        let mut before = 0;
        for path in paths {
            let contact =
                |reached: usize| path.waypoints.iter().take(reached).filter(|waypoint| waypoint.contact).count();
            let (reached, all) = (contact(executed.saturating_sub(before)), contact(usize::MAX));
            before += path.waypoints.len();
            if reached > 0 {
                let grids = if reached == all { &mut whole } else { &mut begun };
                grids.extend(path.grids.iter().copied());
            }
        }
        for grid in whole.iter().chain(&begun) {
            let (times, last) = self.touched.entry(*grid).or_insert((0, 0));
            *times += usize::from(*last != pass);
            *last = pass;
        }
        self.done.extend(whole.iter().map(|grid| (*grid, pass)));
        findings::abraded(pass, (waypoints, done), (&whole, &begun), self.most_passes)
    }

    /// In how many passes each grid was touched.
    pub fn passes(&self) -> impl Iterator<Item = (GridId, usize)> + '_ {
        self.touched.iter().map(|(grid, (times, _))| (*grid, *times))
    }
}
