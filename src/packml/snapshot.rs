//! What is known of the cell at one moment, as plain data.

use crate::cycle::State;
use crate::history::Alarm;
use crate::record::PartNames;
use crate::verdict::{Reason, Verdict};

/// What is known of the cell at one moment. What is not known is absent, never a default.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Snapshot {
    /// Whether the service's loop answers now; if it does not, all other fields are its last report.
    pub answers: bool,
    /// The state of the cycle's table.
    pub state: Option<State>,
    /// For how many whole seconds the unit has been in its state, and in its mode, as far as this service saw.
    pub in_state_s: u32,
    /// As `in_state_s`, of the mode.
    pub in_mode_s: u32,
    /// The phase inside Execute; if the cycle is held, the phase in which it continues.
    pub phase: Option<String>,
    /// The cycle that runs, or ran last since the service started.
    pub cycle: Option<i64>,
    /// Its panel.
    pub panel: Option<String>,
    /// Its abrasions so far.
    pub pass: Option<u8>,
    /// Seconds of the film that is under way, and of a whole one.
    pub film_s: Option<f64>,
    /// As `film_s`, of a whole film.
    pub film_total_s: Option<f64>,
    /// Waypoints executed of the path that is under way.
    pub waypoint: Option<u32>,
    /// All waypoints of that path.
    pub waypoints: Option<u32>,
    /// The cycle's verdict, once it has one.
    pub verdict: Option<Verdict>,
    /// Why the cell is in its state, and what was found wrong last.
    pub reasons: Vec<Reason>,
    /// Words of the requests that the table would accept now.
    pub possible: Vec<&'static str>,
    /// Whether the cycle waits for a person's word on a result.
    pub is_review: bool,
    /// The part in the cell.
    pub part: PartNames,
    /// The grids of the cycle's panel, in order.
    pub grids: Vec<GridState>,
    /// Verifications, if there were any: of the 3D camera, the camera on the flange, and the tool.
    pub scanner: Option<Verified>,
    /// As `scanner`.
    pub flange_camera: Option<Verified>,
    /// As `scanner`.
    pub tool: Option<Verified>,
    /// Whether a cycle may start with these calibrations, once it was looked at.
    pub may_start: Option<bool>,
    /// Why not, or what is doubtful.
    pub calibration_reasons: Vec<String>,
    /// Each calibration's file with its age, in words.
    pub calibrations: Vec<String>,
    /// The recipes of the folder.
    pub recipes: Vec<RecipeHash>,
    /// The alarms that last: the most urgent first.
    pub alarms: Vec<Alarm>,
    /// Cycles that ended.
    pub counts: CycleCounts,
    /// The last call of a method that was not done.
    pub refusal: Option<LastRefusal>,
    /// The time of all this, ms since 1970.
    pub now_unix_ms: i64,
}

/// A recipe by which a cycle can be started.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecipeHash {
    /// Its file's name.
    pub name: String,
    /// SHA-256 of its text.
    pub sha256: String,
}

/// A grid of the panel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GridState {
    /// Its name, such as `r1c1`.
    pub id: String,
    /// `broke`, `whole`, `abraded`, or `untested`.
    pub state: &'static str,
}

/// The last verification of a camera or the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verified {
    /// When, s since 1970.
    pub at_unix_s: i64,
    /// What was found, mm.
    pub error_mm: f64,
    /// What was allowed, mm.
    pub limit_mm: f64,
}

/// Cycles in the store that ended, without runs in the air.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleCounts {
    /// With the verdict pass.
    pub passed: u32,
    /// With the verdict fail.
    pub failed: u32,
    /// With the verdict reject: the panel was not treated.
    pub rejected: u32,
    /// With the verdict invalid: the test gives no result.
    pub invalid: u32,
    /// Ended by an abort or a stop.
    pub aborted: u32,
    /// With any other verdict.
    pub other: u32,
}

impl CycleCounts {
    /// All of them.
    pub fn processed(&self) -> u32 {
        let CycleCounts { passed, failed, rejected, invalid, aborted, other } = *self;
        passed + failed + rejected + invalid + aborted + other
    }

    /// The cycles in which the panel is not good.
    pub fn defective(&self) -> u32 {
        self.failed + self.rejected
    }
}

/// A call of a method that was not done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LastRefusal {
    /// The method.
    pub method: &'static str,
    /// Who called it.
    pub user: String,
    /// When, ms since 1970.
    pub at_unix_ms: i64,
    /// Why.
    pub reason: Reason,
}

/// The name of an alarm: its cycle (`0` between cycles), code and time, which no two alarms have in common.
pub fn alarm_id(alarm: &Alarm) -> String {
    format!("{}/{}/{}", alarm.cycle.map_or(0, |cycle| cycle.0), alarm.code, alarm.raised_unix_ms)
}
