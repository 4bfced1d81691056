//! What the arm reaches of the panel where it stands: every grid before the panel is wetted, and the plan before it is taken.
//!
//! Before contact the arm stands at the last corner that Verify looks at, where it came from the park pose: by way of the
//! ready pose, unless the park pose lies inside of the box, and then by lines from corner to corner; lines keep its
//! configuration. So that way is part of what is looked at, through the same gate and beside the same things.
//! What moves is looked at again from the actual axes: see `routes`.

use super::routes::{self, Standing};
use super::{Job, corners};
use crate::geometry::{Base, Flange, Joints, Panel, Rigid, Tool};
use crate::path::Kinematics;
use crate::path::disc::DiscUse;
use crate::path::panel_reach::{self, GridReach, Stand};
use crate::path::reach::{Obstacles, joint_motion};
use crate::surface::Fit;
use crate::verdict::{Judgement, Reason};
use std::sync::Arc;

/// Where the panel stands, the corners that are looked at before contact, in this order, and what the arm keeps off on its
/// way to them.
#[derive(Debug, Clone, Copy)]
pub struct Approached<'a> {
    /// The place.
    pub base_from_panel: Rigid<Base, Panel>,
    /// Numbers of taught corners, from 0.
    pub corners: &'a [usize],
    /// The panel and what else a scan showed; `None` where there is no scan.
    pub things: Option<&'a Arc<Obstacles>>,
}

/// The panel before the arm as it will stand there, with its sanding tool.
///
/// # Errors
/// Where there is no corner, or the arm does not come to one of them.
pub fn stand<'a>(job: &Job<'_>, arm: &'a Kinematics, panel: &Approached<'_>) -> Result<Stand<'a>, Reason> {
    let mut at = begin(job, arm, panel.things)?;
    for &corner in panel.corners {
        at = to_corner(job, arm, (at, corner), panel)?;
    }
    if panel.corners.is_empty() {
        return Err(no_corner());
    }
    let (flange_from_tool, base_from_panel) = (job.calibrations.flange_from_tool, panel.base_from_panel);
    Ok(Stand { arm, flange_from_tool, base_from_panel, from: Some(at) })
}

/// The corners that the corner loop would look at where nothing is in the way but what the cell's file says.
///
/// # Errors
/// Where no corner was taught, or the arm comes to none of them.
pub fn corners_in_reach(
    job: &Job<'_>,
    arm: &Kinematics,
    base_from_panel: Rigid<Base, Panel>,
) -> Result<Vec<usize>, Reason> {
    let panel = Approached { base_from_panel, corners: &[], things: None };
    let (mut at, mut chosen, mut why) = (begin(job, arm, None)?, Vec::new(), None);
    for corner in 0..job.corners.len() {
        match to_corner(job, arm, (at, corner), &panel) {
            Ok(joints) => {
                at = joints;
                chosen.push(corner);
            }
            Err(reason) => why = why.or(Some(reason)),
        }
        if chosen.len() >= corners::most(job) {
            break;
        }
    }
    if chosen.is_empty() { Err(why.unwrap_or_else(no_corner)) } else { Ok(chosen) }
}

fn no_corner() -> Reason {
    Reason::new("no_corner", "no corner was taught")
}

/// The camera as the tool that the arm has on this way.
fn camera(job: &Job<'_>) -> Rigid<Flange, Tool> {
    Rigid::claim(*job.calibrations.flange_from_camera.isometry())
}

/// How the axes stand where the first line begins.
fn begin(job: &Job<'_>, arm: &Kinematics, things: Option<&Arc<Obstacles>>) -> Result<Joints, Reason> {
    let park_is_inside = job.limits.workspace().is_some_and(|workspace| {
        arm.base_from_flange(&job.park).is_some_and(|flange| workspace.holds((flange * camera(job)).origin()))
    });
    let Some(ready) = job.ready.filter(|_| !park_is_inside) else { return Ok(job.park) };
    let beside = match things {
        Some(things) => arm.clone().beside(things.clone()),
        None => arm.clone(),
    };
    let met =
        |obstacle| Reason::new("out_of_reach", format!("on the way from the park to the ready pose: {obstacle}"));
    joint_motion(&beside, camera(job), &job.park, &ready).map_err(met)?;
    Ok(ready)
}

/// How the axes stand at a corner, where they come by a line from `at`.
fn to_corner(
    job: &Job<'_>,
    arm: &Kinematics,
    (at, corner): (Joints, usize),
    panel: &Approached<'_>,
) -> Result<Joints, Reason> {
    let taught = job.corners.get(corner).ok_or_else(no_corner)?;
    let flange_from_tool = camera(job);
    let not_finite = || Reason::new("out_of_reach", "the axes of the park or ready pose are no numbers");
    let from = arm.base_from_flange(&at).ok_or_else(not_finite)? * flange_from_tool;
    let to = Rigid::claim(*(panel.base_from_panel * taught.teaching.panel_from_camera).isometry());
    let standing =
        Standing { limits: job.limits, arm: job.arm, flange_from_tool, joints: at, things: panel.things };
    let gated = routes::view(&standing, from, to);
    let refused = gated.judgement.reasons.into_iter().next();
    let on_the_way = |reason: Reason| Reason {
        message: format!("on the way to corner {}: {}", corner + 1, reason.message),
        ..reason
    };
    gated.joints.ok_or_else(|| refused.map_or_else(not_finite, on_the_way))
}

/// Every grid by the path that would abrade it alone, with the gate's word on all of them.
pub(super) fn survey(
    job: &Job<'_>,
    fit: &Fit,
    panel: &Approached<'_>,
    worn_mm2: f64,
) -> (Vec<GridReach>, Judgement) {
    let arm = Kinematics::new(job.arm);
    let rejected = |reason| (Vec::new(), Judgement::of(vec![reason], vec![]));
    let stand = match stand(job, &arm, panel) {
        Ok(stand) => stand,
        Err(reason) => return rejected(reason),
    };
    let (around, settings) = ((&job.panel.region, job.panel.outline.as_slice()), job.recipe.path());
    match panel_reach::of_grids(&fit.surface, around, &stand, settings) {
        Ok(grids) => {
            let pad = crate::path::judge_pad(settings, job.limits.tool_error_mm());
            let disc = Judgement::of(vec![], worn_out(&grids, settings.disc_life_mm2(), worn_mm2));
            let judgement = panel_reach::judge_grids(&grids).and(pad).and(disc);
            (grids, judgement)
        }
        Err(error) => rejected(Reason::new("no_path", error.to_string())),
    }
}

/// A disc that would not last for the largest grid is changed before the panel is wet.
fn worn_out(grids: &[GridReach], life_mm2: Option<f64>, worn_mm2: f64) -> Vec<Reason> {
    let largest_mm2 = grids.iter().map(|grid| grid.swept_mm2).fold(0.0, f64::max);
    let needed = DiscUse { swept_mm2: largest_mm2, worn_after_mm2: worn_mm2 + largest_mm2, life_mm2 };
    needed.change("one grid").into_iter().collect()
}
