//! A planned path as poses with their times, for [`simulate`].

pub use crate::surface::dwell::{Dwell, ExecutedPose, GridDwell, simulate, simulate_treated};

use super::planned::Plan;

/// Returns the plan as poses with their times.
pub fn timed_poses(plan: &Plan) -> Vec<ExecutedPose> {
    let all: Vec<_> = plan.paths.iter().flat_map(|path| &path.waypoints).collect();
    let mut executed: Vec<ExecutedPose> = Vec::with_capacity(all.len());
    for (index, waypoint) in all.iter().enumerate() {
        let panel_from_tool = waypoint.panel_from_tool;
        let before = executed.last().map_or(panel_from_tool, |last| last.panel_from_tool);
        let seconds = before.origin().distance_mm(panel_from_tool.origin()) / waypoint.feed_mm_s;
        // The way down to the first waypoint in contact presses on nothing until its end.
        let contact = waypoint.contact && index > 0 && all[index - 1].contact;
        executed.push(ExecutedPose { panel_from_tool, seconds, contact, force_n: None });
    }
    executed
}
