//! The known data of the cell at one moment, the PackML number of the cycle's state, the unit's mode, and the values of
//! nodes with their types.
//!
//! The states of the cycle already have their PackML names ([`At`]); the numbers are those in the table of states of
//! ISA-TR88.00.02-2015. Suspending, Suspended and Unsuspending (13, 5, 14) do not occur, because this cell never waits
//! for another machine.

use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle::{At, Robot, State};
use panelprep_cell::record::PartNames;
use panelprep_store::history::Alarm;

/// The known data of the cell at one moment. Unknown data are absent; they are never replaced by a default.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Snapshot {
    /// Whether the service's control loop replies; if not, all other fields are from its last reply.
    pub answers: bool,
    /// The state in the cycle's state table.
    pub state: Option<State>,
    /// Time in the present state, in whole seconds, since this service has observed it.
    pub in_state_s: u32,
    /// Time in the present mode, in whole seconds, since this service has observed it.
    pub in_mode_s: u32,
    /// The phase inside Execute; in a held cycle, the phase in which the cycle will be resumed.
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
    /// The verdict of the cycle; `None` before its end.
    pub verdict: Option<Verdict>,
    /// The reasons for the cell's state, and the last problems that were found.
    pub reasons: Vec<Reason>,
    /// Keywords of the requests that the state table would accept now.
    pub possible: Vec<&'static str>,
    /// Whether a person must decide about a result.
    pub is_review: bool,
    /// The names of the part in the cell.
    pub part: PartNames,
    /// The state of each grid of the panel, in order.
    pub grids: Vec<GridState>,
    /// The last verification of the 3D camera, if there was one.
    pub scanner: Option<Verified>,
    /// The last verification of the flange camera.
    pub flange_camera: Option<Verified>,
    /// The last verification of the tool.
    pub tool: Option<Verified>,
    /// Whether a cycle may start with the present calibrations; `None` before the first check.
    pub may_start: Option<bool>,
    /// The reasons why a cycle may not start, or warnings about the calibrations.
    pub calibration_reasons: Vec<String>,
    /// The file of each calibration and its age, as text.
    pub calibrations: Vec<String>,
    /// The recipes in the folder `[page] recipes`.
    pub recipes: Vec<RecipeHash>,
    /// The active alarms, the most urgent first.
    pub alarms: Vec<Alarm>,
    /// Numbers of ended cycles, by verdict.
    pub counts: CycleCounts,
    /// The last refused method call, if there was one.
    pub refusal: Option<LastRefusal>,
    /// The time of this snapshot, ms since 1970.
    pub now_unix_ms: i64,
}

/// A recipe that can be started.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecipeHash {
    /// The file name of the recipe.
    pub name: String,
    /// SHA-256 of the recipe's text.
    pub sha256: String,
}

/// A grid of the panel, with its state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GridState {
    /// The grid's name, such as `r1c1`.
    pub id: String,
    /// The state: `broke`, `whole`, `abraded`, or `untested`.
    pub state: &'static str,
}

/// The result of the last verification of a camera or the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verified {
    /// Time of the verification, s since 1970.
    pub at_unix_s: i64,
    /// The measured error, mm.
    pub error_mm: f64,
    /// The maximum error, mm.
    pub limit_mm: f64,
}

/// Numbers of the ended cycles in the store, without air-runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleCounts {
    /// Number of cycles with the verdict pass.
    pub passed: u32,
    /// Number of cycles with the verdict fail.
    pub failed: u32,
    /// Number of cycles with the verdict reject.
    pub rejected: u32,
    /// Number of cycles with the verdict invalid: the test has no result.
    pub invalid: u32,
    /// Number of cycles that ended by an abort or a stop.
    pub aborted: u32,
    /// Number of cycles with any other verdict.
    pub other: u32,
}

impl CycleCounts {
    /// Returns the total number of cycles.
    pub fn processed_count(&self) -> u32 {
        let CycleCounts { passed, failed, rejected, invalid, aborted, other } = *self;
        passed + failed + rejected + invalid + aborted + other
    }

    /// Returns the number of cycles with the verdict fail or reject.
    pub fn defective_count(&self) -> u32 {
        self.failed + self.rejected
    }
}

/// A refused method call.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LastRefusal {
    /// Name of the OPC UA method, as a client calls it.
    pub method: &'static str,
    /// Name of the user who called the method.
    pub user: String,
    /// Time of the call, ms since 1970.
    pub at_unix_ms: i64,
    /// The reason for the refusal.
    pub reason: Reason,
}

/// Returns the unique id of an alarm: its cycle (`0` between cycles), code and time.
pub fn alarm_id(alarm: &Alarm) -> String {
    format!("{}/{}/{}", alarm.cycle.map_or(0, |cycle| cycle.0), alarm.code, alarm.raised_unix_ms)
}

/// The PackML state of the unit, with its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr, strum::VariantArray)]
#[expect(missing_docs, reason = "the names are PackML's")]
pub enum UnitState {
    Clearing = 1,
    Stopped = 2,
    Starting = 3,
    Idle = 4,
    Execute = 6,
    Stopping = 7,
    Aborting = 8,
    Aborted = 9,
    Holding = 10,
    Held = 11,
    Unholding = 12,
    Resetting = 15,
    Completing = 16,
    Complete = 17,
}

impl UnitState {
    /// Returns the PackML state for a state of the cycle.
    pub fn from_state(at: At) -> Self {
        match at {
            At::Stopped => UnitState::Stopped,
            At::Resetting => UnitState::Resetting,
            At::Idle => UnitState::Idle,
            At::Starting => UnitState::Starting,
            At::Execute(_) => UnitState::Execute,
            At::Holding(_) => UnitState::Holding,
            At::Held(_) => UnitState::Held,
            At::Unholding { .. } => UnitState::Unholding,
            At::Completing { .. } => UnitState::Completing,
            At::Complete { .. } => UnitState::Complete,
            At::Stopping { .. } => UnitState::Stopping,
            At::Aborting { .. } => UnitState::Aborting,
            At::Aborted { .. } => UnitState::Aborted,
            At::Clearing { .. } => UnitState::Clearing,
        }
    }

    /// Returns the PackML number of the state.
    pub fn number(self) -> i32 {
        self as i32
    }

    /// Returns the PackML name of the state.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns whether this is an acting state of PackML, which ends by itself. In all other states, the unit waits for
    /// a command.
    pub fn is_acting_state(self) -> bool {
        use UnitState::{Aborted, Complete, Held, Idle, Stopped};
        !matches!(self, Stopped | Idle | Held | Complete | Aborted)
    }
}

/// The PackML mode of the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
pub enum UnitMode {
    /// Cycles on panels are executed.
    Production = 1,
    /// An air-run, without water, tool and contact.
    Maintenance = 2,
    /// The robot is in T1 or T2 and is operated manually.
    Manual = 3,
}

impl UnitMode {
    /// Returns the mode for a state of the cycle. The mode switch of the robot has priority over the kind of cycle.
    pub fn from_state(state: &State) -> Self {
        match state.facts.robot {
            Robot::NotAutomatic => UnitMode::Manual,
            _ if state.job.running && state.job.air => UnitMode::Maintenance,
            _ => UnitMode::Production,
        }
    }

    /// Returns the number of the mode.
    pub fn number(self) -> i32 {
        self as i32
    }

    /// Returns the PackML name of the mode.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A value of a node.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// The value is unknown, or does not exist at present.
    Absent,
    /// True or false.
    Boolean(bool),
    /// A signed integer.
    Int32(i32),
    /// An unsigned integer.
    UInt32(u32),
    /// A floating-point number.
    Double(f64),
    /// A text.
    String(String),
    /// A time, ms since 1970.
    DateTime(i64),
    /// Texts, in order.
    Strings(Vec<String>),
    /// A list of times, ms since 1970.
    DateTimes(Vec<i64>),
}

/// The data type of a node's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[expect(missing_docs, reason = "the names are those of OPC UA")]
pub enum Kind {
    Boolean,
    Int32,
    UInt32,
    Double,
    String,
    DateTime,
    #[strum(serialize = "String[]")]
    Strings,
    #[strum(serialize = "DateTime[]")]
    DateTimes,
}

impl Kind {
    /// Returns the name of the data type, as used in the manual.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl Value {
    /// Returns the data type of this value; `None` for an absent value.
    pub fn kind(&self) -> Option<Kind> {
        Some(match self {
            Value::Absent => return None,
            Value::Boolean(_) => Kind::Boolean,
            Value::Int32(_) => Kind::Int32,
            Value::UInt32(_) => Kind::UInt32,
            Value::Double(_) => Kind::Double,
            Value::String(_) => Kind::String,
            Value::DateTime(_) => Kind::DateTime,
            Value::Strings(_) => Kind::Strings,
            Value::DateTimes(_) => Kind::DateTimes,
        })
    }
}
