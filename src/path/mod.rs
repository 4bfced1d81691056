//! Tool paths over the grids of a surface (thesis 4.6–4.8, Fig. 4.29), in the panel's frame.
//!
//! `raster` lays rows, `orientation` stands the tool on them, `plan` joins both into paths, `coverage` and `edge`
//! measure what a plan reaches, `gate` judges it, `krl` writes it for those who run it by hand. None of these knows the
//! robot's reach or where the panel stands now. `waypoint_gate` is the last look at what is about to move, in the base.

mod areas;
mod contact;
mod coverage;
pub mod disc;
pub mod dwell;
mod edge;
mod gate;
mod kinematics;
mod krl;
mod lines;
mod orientation;
mod plan;
mod raster;
pub mod reach;
mod rings;
mod slanted;
mod waypoint_gate;

pub use coverage::GridCoverage;
pub use edge::{Outline, Overhang};
pub use gate::judge;
pub use kinematics::Kinematics;
pub use krl::{ProgramName, ProgramNameError, krl};
pub use orientation::{OrientationError, Reference, Stance, panel_from_tool};
pub use plan::{Plan, PlanError, StepOver, ToolPath, Waypoint, plan};
pub use raster::{Raster, RasterError, raster};
pub use waypoint_gate::{Route, WaypointLimits, judge_joints, judge_route};

#[cfg(test)]
mod simulated;
#[cfg(test)]
mod tests;
