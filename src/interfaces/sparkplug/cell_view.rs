//! Published values of the cell, from the loop and from the store.

use crate::packml::{UnitMode, UnitState};
use panelprep_cell::cycle::{Robot, State};

/// The published values of the cell. Unknown values are `None`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CellView {
    /// The loop's present values.
    pub now: LoopView,
    /// The values of the store and the disk, which may be older than the loop's values.
    pub kept: StoreView,
}

/// The loop's present values; all empty if the loop does not answer.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LoopView {
    /// The state of the cycle's state machine.
    pub table: Option<State>,
    /// The phase, or the phase in which a held cycle continues.
    pub phase: Option<String>,
    /// The cycle that runs, or the last cycle since the service started.
    pub cycle: Option<i64>,
    /// Its panel.
    pub panel: Option<String>,
    /// The number of abrasions in this cycle so far.
    pub pass: Option<u8>,
    /// How long the film was watched, s.
    pub film_s: Option<f64>,
    /// How long the film is to be watched, s.
    pub film_total_s: Option<f64>,
    /// Number of executed waypoints of the present path.
    pub waypoint: Option<u32>,
    /// Number of all waypoints of the present path.
    pub waypoints: Option<u32>,
}

/// The values of the store and the disk.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StoreView {
    /// The part's serial number in the newest cycle.
    pub serial: Option<String>,
    /// Its work order.
    pub work_order: Option<String>,
    /// The grids on which the film broke in the last film of the newest cycle; `None` before its first valid film.
    pub failed_grids: Option<Vec<String>>,
    /// The newest cycle that has ended.
    pub last_cycle: Option<i64>,
    /// Its verdict.
    pub last_verdict: Option<&'static str>,
    /// Alarms that last.
    pub active_alarms: Option<usize>,
    /// The code of the alarm that was raised last.
    pub newest_alarm: Option<String>,
    /// Whole hours since the last verification of the 3D camera.
    pub scanner_verified_h: Option<i64>,
    /// Whole hours since the last verification of the flange camera.
    pub flange_camera_verified_h: Option<i64>,
    /// Whole hours since the last verification of the tool.
    pub tool_verified_h: Option<i64>,
    /// Area that the disc in use has swept, mm².
    pub disc_worn_mm2: Option<f64>,
    /// Free space on the store's disk, MB.
    pub free_mb: Option<u64>,
    /// Number of cycles that have ended.
    pub cycles: Option<i64>,
    /// Number of ended cycles with the verdict pass.
    pub passed: Option<i64>,
    /// Abrasions that began.
    pub abrasions: Option<i64>,
}

/// The unit's state.
pub(super) fn unit_state(now: &LoopView) -> Option<UnitState> {
    now.table.map(|state| UnitState::from_state(state.at))
}

/// Returns the unit's mode; `None` while the robot sends no reports.
pub(super) fn unit_mode(now: &LoopView) -> Option<UnitMode> {
    let state = now.table.filter(|state| !matches!(state.facts.robot, Robot::Unknown | Robot::LinkLost))?;
    Some(UnitMode::from_state(&state))
}
