//! What the arm reaches of the panel: each grid before the panel is wetted, and the plan before it is taken.
//!
//! Before contact the arm stands at the corner pose, where it came by a line from the ready pose, or from the park pose
//! where that lies inside of the box; lines keep its configuration. So the way from there is part of what is looked at.
//! What moves is looked at again from the actual axes: see `routes`.

use super::Job;
use crate::geometry::{Base, Flange, Panel, Rigid, Tool};
use crate::path::Kinematics;
use crate::path::disc::DiscUse;
use crate::path::panel_reach::{self, GridReach, Stand};
use crate::path::reach::{Leg, follow};
use crate::surface::Fit;
use crate::verdict::{Judgement, Reason};

/// Speed at which the way to the corner pose is looked at, mm/s.
const AIR_MM_S: f64 = 200.0;

/// The panel before the arm as it will stand there, with its sanding tool.
///
/// # Errors
/// Where no corner was taught, or the arm does not come to the first one's pose.
pub fn stand<'a>(
    job: &Job<'_>,
    arm: &'a Kinematics,
    base_from_panel: Rigid<Base, Panel>,
) -> Result<Stand<'a>, Reason> {
    let camera: Rigid<Flange, Tool> = Rigid::claim(*job.calibrations.flange_from_camera.isometry());
    let park_is_inside = job.limits.workspace().is_some_and(|workspace| {
        arm.base_from_flange(&job.park).is_some_and(|flange| workspace.holds((flange * camera).origin()))
    });
    let start = job.ready.filter(|_| !park_is_inside).unwrap_or(job.park);
    let corner = job.corners.first().ok_or_else(|| Reason::new("no_corner", "no corner was taught"))?;
    let base_from_camera = base_from_panel * corner.teaching.panel_from_camera;
    let leg =
        Leg { base_from_tool: Rigid::claim(*base_from_camera.isometry()), feed_mm_s: AIR_MM_S, blend_mm: 0.0 };
    let travel = follow(arm, camera, Some(&start), &[leg])
        .map_err(|fault| Reason::new("out_of_reach", format!("on the way to the corner: {}", fault.obstacle)))?;
    let flange_from_tool = job.calibrations.flange_from_tool;
    Ok(Stand { arm, flange_from_tool, base_from_panel, from: travel.joints.last().copied() })
}

/// Every grid by the path that would abrade it alone, with the gate's word on all of them.
pub(super) fn survey(
    job: &Job<'_>,
    fit: &Fit,
    base_from_panel: Rigid<Base, Panel>,
    worn_mm2: f64,
) -> (Vec<GridReach>, Judgement) {
    let arm = Kinematics::new(job.arm);
    let rejected = |reason| (Vec::new(), Judgement::of(vec![reason], vec![]));
    let stand = match stand(job, &arm, base_from_panel) {
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
