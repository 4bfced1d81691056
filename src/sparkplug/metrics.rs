//! The metrics: each with its name, its type, its meaning and the source of its value. The alias of a metric is its
//! position in the table, from 1, so that it stays the same as long as new metrics are added at the end.

use super::cell_view::{CellView, unit_mode, unit_state};
use super::value::{DataType, Value};
use crate::packml::{UnitMode, UnitState};

/// One metric of the node.
pub struct Definition {
    /// Its name.
    pub name: &'static str,
    /// Its type.
    pub datatype: DataType,
    /// The metric's meaning, in a sentence for the manual.
    pub meaning: &'static str,
    value: fn(&CellView) -> Value,
}

const fn metric(
    name: &'static str,
    datatype: DataType,
    meaning: &'static str,
    value: fn(&CellView) -> Value,
) -> Definition {
    Definition { name, datatype, meaning, value }
}

use DataType::{Double, Int64, String};

/// All metrics of the cell, except those that a host may write.
pub const METRICS: [Definition; 29] = [
    metric("Properties/program", String, "the program and its version", |_| {
        Value::Text(concat!("panelprep ", env!("CARGO_PKG_VERSION")).to_owned())
    }),
    metric("State/number", Int64, "the number of the PackML state", |view| {
        Value::whole(unit_state(&view.now).map(UnitState::number))
    }),
    metric("State/word", String, "the PackML state", |view| {
        Value::text(view.now.table.map(|state| state.at.word()))
    }),
    metric("Mode/number", Int64, "1 production, 2 maintenance, 3 manual", |view| {
        Value::whole(unit_mode(&view.now).map(UnitMode::number))
    }),
    metric(
        "Mode/word",
        String,
        "production; maintenance in a run in the air; manual while the robot is in T1 or T2",
        |view| Value::text(unit_mode(&view.now).map(UnitMode::name).map(str::to_lowercase).as_deref()),
    ),
    metric("Cycle/number", Int64, "the cycle that runs, or ran last since the service started", |view| {
        Value::whole(view.now.cycle)
    }),
    metric("Cycle/panel", String, "its panel", |view| Value::text(view.now.panel.as_deref())),
    metric("Cycle/serial", String, "the part's serial number in the newest cycle", |view| {
        Value::text(view.kept.serial.as_deref())
    }),
    metric("Cycle/work_order", String, "the part's work order in the newest cycle", |view| {
        Value::text(view.kept.work_order.as_deref())
    }),
    metric(
        "Cycle/phase",
        String,
        "the phase inside of Execute; while held, the phase in which it will continue",
        |view| Value::text(view.now.phase.as_deref()),
    ),
    metric("Cycle/pass", Int64, "its abrasions so far", |view| Value::whole(view.now.pass)),
    metric("Cycle/film_s", Double, "for how long the film was watched, s", |view| Value::real(view.now.film_s)),
    metric("Cycle/film_total_s", Double, "for how long the film is to be watched, s", |view| {
        Value::real(view.now.film_total_s)
    }),
    metric("Cycle/waypoint", Int64, "waypoints executed of the path that is under way", |view| {
        Value::whole(view.now.waypoint)
    }),
    metric("Cycle/waypoints", Int64, "all waypoints of that path", |view| Value::whole(view.now.waypoints)),
    metric("Cycle/grids_failed", Int64, "grids on which the newest cycle's last film broke", |view| {
        Value::whole(count(view.kept.failed_grids.as_ref().map(Vec::len)))
    }),
    metric("Cycle/grids_failed_names", String, "their names", |view| {
        Value::text(view.kept.failed_grids.as_ref().map(|names| names.join(",")).as_deref())
    }),
    metric("LastCycle/number", Int64, "the newest cycle that is over", |view| Value::whole(view.kept.last_cycle)),
    metric("LastCycle/verdict", String, "its verdict", |view| Value::text(view.kept.last_verdict)),
    metric("Alarms/active", Int64, "alarms that last", |view| Value::whole(count(view.kept.active_alarms))),
    metric("Alarms/newest", String, "the code of the one that was raised last", |view| {
        Value::text(view.kept.newest_alarm.as_deref())
    }),
    metric("Calibration/scanner_verified_h", Int64, "whole hours since the 3D camera was verified", |view| {
        Value::whole(view.kept.scanner_verified_h)
    }),
    metric(
        "Calibration/flange_camera_verified_h",
        Int64,
        "whole hours since the flange camera was verified",
        |view| Value::whole(view.kept.flange_camera_verified_h),
    ),
    metric("Calibration/tool_verified_h", Int64, "whole hours since the tool was touched", |view| {
        Value::whole(view.kept.tool_verified_h)
    }),
    metric("Disc/worn_mm2", Double, "the area that the disc in use has swept, mm²", |view| {
        Value::real(view.kept.disc_worn_mm2)
    }),
    metric("Disk/free_MB", Int64, "free room on the store's disk, in steps of 100 MB", |view| {
        Value::whole(view.kept.free_mb.and_then(|mb| i64::try_from(mb / 100 * 100).ok()))
    }),
    metric("Counters/cycles", Int64, "cycles that are over", |view| Value::whole(view.kept.cycles)),
    metric("Counters/passed", Int64, "of them those with the verdict pass", |view| Value::whole(view.kept.passed)),
    metric("Counters/abrasions", Int64, "paths in contact that began", |view| Value::whole(view.kept.abrasions)),
];

fn count(number: Option<usize>) -> Option<i64> {
    number.and_then(|number| i64::try_from(number).ok())
}

/// Returns the value of each metric, in the order of the table.
pub fn values(view: &CellView) -> Vec<Value> {
    METRICS.iter().map(|metric| (metric.value)(view)).collect()
}

/// Returns the alias of the metric at this position of the table.
pub(super) fn alias(place: usize) -> u64 {
    place as u64 + 1
}
