//! The content of a recording.

use super::Topic;
use panelprep_base::geometry::{Camera, ColorPicture, KukaPose, OrganizedCloud};
use panelprep_cell::cycle::{Deadline, Id, State};
use panelprep_kuka::eki;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::sync::Arc;

/// One exchange of the loop with its environment.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Its topic.
    pub topic: Topic,
    /// Time of the exchange, ns since the recording began, on the loop's clock.
    pub at_ns: u64,
    /// The loop's action; null if it only received an input.
    pub action: Value,
    /// The reply or input; null if none was expected.
    pub reply: Value,
    /// The picture or points from a camera, if there are any.
    pub shot: Option<Shot>,
}

/// The picture or points from a camera.
#[derive(Debug, Clone)]
pub enum Shot {
    /// The 3D camera's points and colours.
    Points(Arc<OrganizedCloud<Camera>>),
    /// A picture of the 3D camera's colour sensor.
    Scanner(Arc<ColorPicture>),
    /// A picture of the flange camera.
    Flange(Arc<ColorPicture>),
}

impl Shot {
    /// The topic of the shot's message.
    pub fn topic(&self) -> Topic {
        match self {
            Shot::Points(_) => Topic::Points,
            Shot::Scanner(_) => Topic::ScannerPicture,
            Shot::Flange(_) => Topic::FlangePicture,
        }
    }

    /// Columns and rows.
    pub fn size_px(&self) -> [usize; 2] {
        match self {
            Shot::Points(cloud) => [cloud.width(), cloud.height()],
            Shot::Scanner(picture) | Shot::Flange(picture) => [picture.width, picture.height],
        }
    }

    /// The memory that the shot needs, bytes.
    pub fn bytes(&self) -> usize {
        let [width, height] = self.size_px();
        width * height * if matches!(self, Shot::Points(_)) { 15 } else { 3 }
    }
}

/// The state in which the loop began, in addition to its input files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingStart {
    /// The program's version.
    pub program: String,
    /// Start time by the wall clock, ns since 1970.
    pub unix_ns: u64,
    /// The table's state.
    pub state: State,
    /// Whether time passes only while the loop waits for the robot's messages.
    pub lock_step: bool,
    /// The loop's memory in addition to the state machine's state.
    pub begin: LoopMemoryStart,
    /// Error of the camera mounts at the panel, mm, 95 %, as known at the start.
    pub hand_eye_mm: Option<f64>,
    /// Error of robot and tool, mm, 95 %, as known at the start.
    pub robot_mm: Option<f64>,
}

/// The loop's memory when the recording began, in addition to the state machine's state.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LoopMemoryStart {
    /// No memory: the program started.
    #[default]
    Boot,
    /// The loop had run before, and was idle.
    Cycle {
        /// The robot's last report of its state.
        robot: Option<Box<eki::State>>,
        /// The deadlines that were armed.
        armed: Vec<ArmedDeadline>,
        /// The motion from a panel's nominal pose to its last pose in the cycles before, in the base frame.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        place: Option<KukaPose>,
    },
}

/// A deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmedDeadline {
    /// Id of the action that armed the deadline.
    pub id: Id,
    /// The deadline.
    pub which: Deadline,
    /// Time of the deadline, ns on the loop's clock.
    pub at_ns: u64,
}

/// Entries of one topic that could not be recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LostEntries {
    /// The topic.
    pub topic: Topic,
    /// Time of the first lost entry, ns since the recording began.
    pub from_ns: u64,
    /// Number of lost entries.
    pub count: u64,
}

/// The content of a recording's end.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordingEnd {
    /// Entries that were not recorded: a recording with lost entries is incomplete.
    pub lost: Vec<LostEntries>,
    /// The reason why the recording ends before the cycle, if it does.
    pub stopped: Option<String>,
}
