//! Tool paths over the grids of a surface (thesis 4.6–4.8, Fig. 4.29), in the panel's frame.
//!
//! - `areas`: the grids that form one area, the order of the areas, and the lines of each, laid again until they meet
//!   their limits · `raster`, `lines`: the lines over a patch
//! - `breaks`: the areas around breaks, if these are abraded and not whole grids
//! - `orientation`: the tool's orientation · `plan`: lands, moves and retracts the tool, and combines all of these ·
//!   `planned`: the data of a plan
//! - `dwell`: the times under the disc, and the feeds that make them even · `coverage`, `disc`, `touching`: the other
//!   results of a plan, and of its execution
//! - `gate`: judges a plan, and a motion before it starts, in the base frame
//! - `kinematics`, `reach`, `panel_reach`: whether the arm can follow a path at the panel's pose
//! - `approach`: the axis angles before contact · `routes`: paths as they are sent, each through the gates · `trace`:
//!   where the tool was · `krl`: a program that a person runs by hand

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
