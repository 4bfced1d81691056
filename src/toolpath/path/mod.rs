//! Tool paths over the grids of a surface (thesis 4.6–4.8, Fig. 4.29), in the panel's frame.
//!
//! - `areas`: which grids form one area, and in which order · `raster`, `slanted`, `rings`, `lines`: the lines over
//!   an area
//! - `breaks`: the areas around breaks, if not whole grids are abraded
//! - `orientation`: the tool's orientation · `contact`: how the tool lands, continues and retracts · `plan`: all of
//!   these
//!   joined · `planned`: the data of a plan
//! - `piece`: the lines of one area, laid until they keep their limits · `evenness`: the feeds that make times
//!   under the disc even
//! - `coverage`, `edge`, `dwell`, `disc`, `touching`: the results of a plan, and of its execution · `gate`: judges
//!   a plan
//! - `kinematics`, `reach`, `panel_reach`: whether the arm can follow a path at the panel's pose
//! - `approach`: the axis angles before contact · `routes`: paths as they are sent, each through the gates · `trace`:
//!   where the tool was
//! - `waypoint_gate`: the last check of a motion before it starts, in the base frame · `krl`: a program that a person
//!   runs by hand

pub mod approach;
mod areas;
mod boxes;
pub mod breaks;
mod contact;
mod coverage;
pub mod disc;
pub mod dwell;
mod edge;
mod evenness;
mod gate;
mod kinematics;
mod krl;
mod lines;
mod obstacles;
mod orientation;
pub mod panel_reach;
mod piece;
mod plan;
mod planned;
mod raster;
pub mod reach;
mod rings;
pub mod routes;
mod slanted;
pub mod touching;
pub mod trace;
mod waypoint_gate;

pub use crate::surface::DwellSpread;
pub use coverage::{GridCoverage, MIN_COVERAGE, step_overs_mm};
pub use edge::{DiscOverhang, Outline};
pub use gate::{
    GRID_CHECK_PREFIX, PanelPoses, TOOL_ERROR, check_pad, judge, judge_pad, judge_plan, taught_axis,
    violated_in_base,
};
pub use kinematics::Kinematics;
pub use krl::{Program, ProgramName, ProgramNameError, to_krl};
pub use orientation::{OrientationError, SpinReference, ToolOrientation, panel_from_tool};
pub use plan::{plan, plan_beyond_borders, plan_over_holes};
pub use planned::{Plan, PlanError, StepOver, ToolPath, TreatmentCost, TreatmentCosts, Waypoint};
pub use raster::{Raster, RasterError, raster};
pub use waypoint_gate::{Route, WaypointLimits, judge_joints, judge_route};

#[cfg(test)]
mod simulated;
#[cfg(test)]
mod tests;
