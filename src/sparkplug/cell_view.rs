//! What is published about the cell: the loop's values and the store's values.

use crate::cycle::{Robot, State};
use crate::packml::{UnitMode, UnitState};

/// What the cell shows. What is not known is `None`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CellView {
    /// The loop's present values.
    pub now: LoopView,
    /// The values of the store and the disk, a little later.
    pub kept: StoreView,
}

/// The loop's present values; all empty if the loop does not answer.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LoopView {
    /// The state of the cycle's table.
    pub table: Option<State>,
    /// The phase, or the phase in which a held cycle continues.
    pub phase: Option<String>,
    /// The cycle that runs, or ran last since the service started.
    pub cycle: Option<i64>,
    /// Its panel.
    pub panel: Option<String>,
    /// Its abrasions so far.
    pub pass: Option<u8>,
    /// How long the film was watched, s, and how long it is to be watched.
    pub film_s: Option<f64>,
    /// How long it is to be watched, s.
    pub film_total_s: Option<f64>,
    /// Waypoints executed of the path that is under way.
    pub waypoint: Option<u32>,
    /// All of its waypoints.
    pub waypoints: Option<u32>,
}

/// The values of the store and the disk.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StoreView {
    /// The part's serial number in the newest cycle.
    pub serial: Option<String>,
    /// Its work order.
    pub work_order: Option<String>,
    /// The grids on which the film broke last in the newest cycle; `None` before its first valid film.
    pub failed_grids: Option<Vec<String>>,
    /// The newest cycle that is over.
    pub last_cycle: Option<i64>,
    /// Its verdict.
    pub last_verdict: Option<&'static str>,
    /// Alarms that last.
    pub active_alarms: Option<usize>,
    /// The code of the one that was raised last.
    pub newest_alarm: Option<String>,
    /// Whole hours since the last verification of the 3D camera.
    pub scanner_verified_h: Option<i64>,
    /// … of the flange camera.
    pub flange_camera_verified_h: Option<i64>,
    /// … of the tool.
    pub tool_verified_h: Option<i64>,
    /// What the disc in use has swept, mm².
    pub disc_worn_mm2: Option<f64>,
    /// Free room on the store's disk, MB.
    pub free_mb: Option<u64>,
    /// Cycles that are over.
    pub cycles: Option<i64>,
    /// … of them with the verdict pass.
    pub passed: Option<i64>,
    /// Abrasions that began.
    pub abrasions: Option<i64>,
}

/// The unit's state.
pub(super) fn unit_state(now: &LoopView) -> Option<UnitState> {
    now.table.map(|state| UnitState::from_state(state.at))
}

/// The unit's mode; not known while nothing is heard from the robot.
pub(super) fn unit_mode(now: &LoopView) -> Option<UnitMode> {
    let state = now.table.filter(|state| !matches!(state.facts.robot, Robot::Unknown | Robot::LinkLost))?;
    Some(UnitMode::from_state(&state))
}
