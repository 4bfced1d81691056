//! Tool paths over the grids of a surface (thesis 4.6–4.8, Fig. 4.29), in the panel's frame.
//!
//! - `areas`: combines grids to areas, orders the areas, and lays the lines of each area until they meet their limits ·
//!   `raster`, `lines`: the lines over a patch
//! - `breaks`: the areas around breaks, which are sanded instead of whole grids
//! - `orientation`: the tool's orientation · `plan`: a whole plan with landing, lines and retraction · `planned`: the
//!   data of a plan
//! - `dwell`: the dwell times, and the feeds that make them uniform · `coverage`, `disc`, `touching`: the other results
//!   of a plan, and of its execution
//! - `gate`: the acceptance checks of a plan, and of a motion before its start, in the base frame
//! - `kinematics`, `reach`, `panel_reach`: whether the arm can follow a path at the panel's pose
//! - `approach`: the motion before contact · `routes`: paths as they are sent, after their acceptance checks · `trace`:
//!   the executed path of the tool · `krl`: a program that a person runs manually

pub mod approach;
mod areas;
pub mod breaks;
mod coverage;
pub mod disc;
pub mod dwell;
mod gate;
mod kinematics;
mod krl;
mod lines;
mod obstacles;
mod orientation;
pub mod panel_reach;
mod plan;
mod planned;
mod raster;
pub mod reach;
pub mod routes;
pub mod touching;
pub mod trace;

pub use crate::surface::DwellSpread;
pub use coverage::{DiscOverhang, GridCoverage, MIN_COVERAGE, Outline, step_overs_mm};
pub use gate::{
    GRID_CHECK_PREFIX, PanelPoses, Route, TOOL_ERROR, WaypointLimits, check_pad, judge, judge_joints, judge_pad,
    judge_plan, judge_route, taught_axis, violated_in_base,
};
pub use kinematics::Kinematics;
pub use krl::{Program, ProgramName, ProgramNameError, to_krl};
pub use orientation::{OrientationError, SpinReference, ToolOrientation, panel_from_tool};
pub use plan::{plan, plan_beyond_borders, plan_over_holes};
pub use planned::{Plan, PlanError, StepOver, ToolPath, TreatmentCost, TreatmentCosts, Waypoint};
pub use raster::{Raster, RasterError, raster};

#[cfg(test)]
mod simulated;
#[cfg(test)]
mod tests;
