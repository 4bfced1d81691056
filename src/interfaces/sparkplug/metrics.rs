//! The published values of the cell, from the control loop and from the store, and the table of their metrics: name,
//! data type, description and the source of the value. The alias of a metric is its position in the table, from 1. New
//! metrics are added at the end, so that existing aliases do not change.

use super::payload::{DataType, Value};
use crate::packml::{UnitMode, UnitState};
use DataType::{Double, Int64};
use panelprep_cell::cycle::{Robot, State};

/// The published values of the cell. An unknown value is `None`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CellView {
    /// The values of the control loop.
    pub now: LoopView,
    /// The values of the store and its disk, which may be older than those of the control loop.
    pub kept: StoreView,
}

/// The present values of the control loop; all are `None` if the loop does not reply.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LoopView {
    /// The state of the cycle's state table.
    pub table: Option<State>,
    /// The phase; in a held cycle, the phase in which the cycle will be resumed.
    pub phase: Option<String>,
    /// The number of the cycle in progress, or of the last cycle since the service started.
    pub cycle: Option<i64>,
    /// The panel of this cycle.
    pub panel: Option<String>,
    /// Number of sanding passes in the cycle so far.
    pub pass: Option<u8>,
    /// Elapsed time of the current film, s.
    pub film_s: Option<f64>,
    /// Total observation time of a film, s.
    pub film_total_s: Option<f64>,
    /// Number of executed waypoints of the current path.
    pub waypoint: Option<u32>,
    /// Total number of waypoints of the current path.
    pub waypoints: Option<u32>,
}

/// The values of the store and its disk.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StoreView {
    /// The serial number of the part in the newest cycle.
    pub serial: Option<String>,
    /// The work order of the part in the newest cycle.
    pub work_order: Option<String>,
    /// The grids that failed in the last film of the newest cycle; `None` before its first valid film.
    pub failed_grids: Option<Vec<String>>,
    /// The number of the newest ended cycle.
    pub last_cycle: Option<i64>,
    /// The verdict of the newest ended cycle.
    pub last_verdict: Option<&'static str>,
    /// Number of active alarms.
    pub active_alarms: Option<usize>,
    /// The code of the newest alarm.
    pub newest_alarm: Option<String>,
    /// Time since the last verification of the 3D camera, in whole hours.
    pub scanner_verified_h: Option<i64>,
    /// Time since the last verification of the flange camera, in whole hours.
    pub flange_camera_verified_h: Option<i64>,
    /// Time since the last verification of the tool, in whole hours.
    pub tool_verified_h: Option<i64>,
    /// Area that the mounted disc has swept, mm².
    pub disc_worn_mm2: Option<f64>,
    /// Free space on the store's disk, MB.
    pub free_mb: Option<u64>,
    /// Number of ended cycles.
    pub cycles: Option<i64>,
    /// Number of ended cycles with the verdict pass.
    pub passed: Option<i64>,
    /// Number of contact paths that were started.
    pub abrasions: Option<i64>,
}

/// Returns the PackML state of the unit.
fn unit_state(now: &LoopView) -> Option<UnitState> {
    now.table.map(|state| UnitState::from_state(state.at))
}

/// Returns the PackML mode of the unit; `None` while the robot sends no reports.
pub(super) fn unit_mode(now: &LoopView) -> Option<UnitMode> {
    let state = now.table.filter(|state| !matches!(state.facts.robot, Robot::Unknown | Robot::LinkLost))?;
    Some(UnitMode::from_state(&state))
}

/// A metric of the edge node.
pub struct MetricDefinition {
    /// Name of the metric.
    pub name: &'static str,
    /// Data type of the metric.
    pub datatype: DataType,
    /// The description of the metric for the manual.
    pub meaning: &'static str,
    value: fn(&CellView) -> Value,
}

const fn define_metric(
    name: &'static str,
    datatype: DataType,
    meaning: &'static str,
    value: fn(&CellView) -> Value,
) -> MetricDefinition {
    MetricDefinition { name, datatype, meaning, value }
}

/// All metrics of the cell, except those of the commands.
pub const METRICS: [MetricDefinition; 29] = [
    define_metric("Properties/program", DataType::String, "the program and its version", |_| {
        Value::Text(concat!("panelprep ", env!("CARGO_PKG_VERSION")).to_owned())
    }),
    define_metric("State/number", Int64, "number of the PackML state", |view| {
        Value::as_integer(unit_state(&view.now).map(UnitState::number))
    }),
    define_metric("State/word", DataType::String, "the PackML state", |view| {
        Value::text(view.now.table.map(|state| state.at.keyword()))
    }),
    define_metric("Mode/number", Int64, "number of the mode: 1 production, 2 maintenance, 3 manual", |view| {
        Value::as_integer(unit_mode(&view.now).map(UnitMode::number))
    }),
    define_metric(
        "Mode/word",
        DataType::String,
        "production; maintenance during an air-run; manual while the robot is in T1 or T2",
        |view| Value::text(unit_mode(&view.now).map(UnitMode::name).map(str::to_lowercase).as_deref()),
    ),
    define_metric(
        "Cycle/number",
        Int64,
        "number of the running cycle, or of the last cycle since the service started",
        |view| Value::as_integer(view.now.cycle),
    ),
    define_metric("Cycle/panel", DataType::String, "panel of the current or last cycle", |view| {
        Value::text(view.now.panel.as_deref())
    }),
    define_metric("Cycle/serial", DataType::String, "serial number of the part in the newest cycle", |view| {
        Value::text(view.kept.serial.as_deref())
    }),
    define_metric("Cycle/work_order", DataType::String, "work order of the part in the newest cycle", |view| {
        Value::text(view.kept.work_order.as_deref())
    }),
    define_metric(
        "Cycle/phase",
        DataType::String,
        "phase within Execute; while held, the phase in which the cycle will continue",
        |view| Value::text(view.now.phase.as_deref()),
    ),
    define_metric("Cycle/pass", Int64, "number of sanding passes in the cycle so far", |view| {
        Value::as_integer(view.now.pass)
    }),
    define_metric("Cycle/film_s", Double, "elapsed time of the current film, s", |view| {
        Value::as_number(view.now.film_s)
    }),
    define_metric("Cycle/film_total_s", Double, "observation time of a film, s", |view| {
        Value::as_number(view.now.film_total_s)
    }),
    define_metric("Cycle/waypoint", Int64, "number of executed waypoints of the current path", |view| {
        Value::as_integer(view.now.waypoint)
    }),
    define_metric("Cycle/waypoints", Int64, "total number of waypoints of the current path", |view| {
        Value::as_integer(view.now.waypoints)
    }),
    define_metric(
        "Cycle/grids_failed",
        Int64,
        "number of grids on which the newest cycle's last film broke",
        |view| Value::as_integer(count(view.kept.failed_grids.as_ref().map(Vec::len))),
    ),
    define_metric(
        "Cycle/grids_failed_names",
        DataType::String,
        "names of the grids on which the newest cycle's last film broke",
        |view| Value::text(view.kept.failed_grids.as_ref().map(|names| names.join(",")).as_deref()),
    ),
    define_metric("LastCycle/number", Int64, "number of the newest cycle that has ended", |view| {
        Value::as_integer(view.kept.last_cycle)
    }),
    define_metric("LastCycle/verdict", DataType::String, "verdict of the newest cycle that has ended", |view| {
        Value::text(view.kept.last_verdict)
    }),
    define_metric("Alarms/active", Int64, "number of active alarms", |view| {
        Value::as_integer(count(view.kept.active_alarms))
    }),
    define_metric("Alarms/newest", DataType::String, "code of the newest active alarm", |view| {
        Value::text(view.kept.newest_alarm.as_deref())
    }),
    define_metric(
        "Calibration/scanner_verified_h",
        Int64,
        "whole hours since the last verification of the 3D camera",
        |view| Value::as_integer(view.kept.scanner_verified_h),
    ),
    define_metric(
        "Calibration/flange_camera_verified_h",
        Int64,
        "whole hours since the last verification of the flange camera",
        |view| Value::as_integer(view.kept.flange_camera_verified_h),
    ),
    define_metric(
        "Calibration/tool_verified_h",
        Int64,
        "whole hours since the last verification of the tool by touch",
        |view| Value::as_integer(view.kept.tool_verified_h),
    ),
    define_metric("Disc/worn_mm2", Double, "area swept by the disc in use, mm²", |view| {
        Value::as_number(view.kept.disc_worn_mm2)
    }),
    define_metric("Disk/free_MB", Int64, "free space on the store's disk, in steps of 100 MB", |view| {
        Value::as_integer(view.kept.free_mb.and_then(|mb| i64::try_from(mb / 100 * 100).ok()))
    }),
    define_metric("Counters/cycles", Int64, "number of cycles that have ended", |view| {
        Value::as_integer(view.kept.cycles)
    }),
    define_metric("Counters/passed", Int64, "number of ended cycles with the verdict pass", |view| {
        Value::as_integer(view.kept.passed)
    }),
    define_metric("Counters/abrasions", Int64, "number of paths in contact that were started", |view| {
        Value::as_integer(view.kept.abrasions)
    }),
];

fn count(number: Option<usize>) -> Option<i64> {
    number.and_then(|number| i64::try_from(number).ok())
}

/// Returns the values of all metrics, in the order of the table.
pub fn values(view: &CellView) -> Vec<Value> {
    METRICS.iter().map(|metric| (metric.value)(view)).collect()
}

/// Returns the alias of the metric with this index in the table.
pub(super) fn alias(place: usize) -> u64 {
    place as u64 + 1
}
