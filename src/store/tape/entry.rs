//! The entries of a recording, and the data that are recorded only for people, as texts: poses and findings. The latter
//! are not read back.

use super::topic::{LogLevel, Topic};
use panelprep_base::geometry::{
    Base, Camera, ColorPicture, Flange, KukaPose, OrganizedCloud, PinholeCamera, Rigid, Tool,
};
use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle::{Deadline, Id, State};
use panelprep_cell::record::Finding;
use panelprep_kuka::eki::{self, Report};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::sync::Arc;

/// An exchange between the control loop and its environment.
#[derive(Debug, Clone)]
pub struct Entry {
    /// The topic of the entry.
    pub topic: Topic,
    /// Time of the exchange by the clock of the control loop, ns since the start of the recording.
    pub at_ns: u64,
    /// The action of the control loop; null if the loop only received an input.
    pub action: Value,
    /// The reply to the action, or the input; null if there is none.
    pub reply: Value,
    /// The picture or the points of a camera, if the entry contains any.
    pub shot: Option<Shot>,
}

/// A picture or the points of a camera.
#[derive(Debug, Clone)]
pub enum Shot {
    /// Points and colours of the 3D camera.
    Points(Arc<OrganizedCloud<Camera>>),
    /// A picture of the 3D camera's colour sensor.
    Scanner(Arc<ColorPicture>),
    /// A picture of the flange camera.
    Flange(Arc<ColorPicture>),
}

impl Shot {
    /// Returns the topic on which the picture or the points are recorded.
    pub fn topic(&self) -> Topic {
        match self {
            Shot::Points(_) => Topic::Points,
            Shot::Scanner(_) => Topic::ScannerPicture,
            Shot::Flange(_) => Topic::FlangePicture,
        }
    }

    /// Returns width and height, px.
    pub fn size_px(&self) -> [usize; 2] {
        match self {
            Shot::Points(cloud) => [cloud.width(), cloud.height()],
            Shot::Scanner(picture) | Shot::Flange(picture) => [picture.width, picture.height],
        }
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        let [width, height] = self.size_px();
        width * height * if matches!(self, Shot::Points(_)) { 15 } else { 3 }
    }
}

/// The state of the control loop at the start of a recording, in addition to its input files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingStart {
    /// The version of the program.
    pub program: String,
    /// Start time of the recording by the wall clock, ns since 1970.
    pub unix_ns: u64,
    /// The state of the state table.
    pub state: State,
    /// Whether time passes only while the control loop waits for messages of the robot.
    pub lock_step: bool,
    /// The internal data of the control loop, in addition to the state table's state.
    pub begin: LoopMemoryStart,
    /// Error of the camera mounts at the panel at the start, mm, 95 %.
    pub hand_eye_mm: Option<f64>,
    /// Error of the robot and its tool at the start, mm, 95 %.
    pub robot_mm: Option<f64>,
}

/// The internal data of the control loop at the start of a recording, in addition to the state table's state.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LoopMemoryStart {
    /// The program has just started, so there are no internal data.
    #[default]
    Boot,
    /// The control loop was already running, and was idle.
    Cycle {
        /// The last state message of the robot.
        robot: Option<Box<eki::State>>,
        /// The active deadlines.
        armed: Vec<ArmedDeadline>,
        /// The displacement of the panel from its nominal pose to its last pose in the previous cycles, in the base
        /// frame.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        place: Option<KukaPose>,
    },
}

/// An active deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmedDeadline {
    /// The id of the effect that started the deadline.
    pub id: Id,
    /// The kind of deadline.
    pub which: Deadline,
    /// Time of the deadline by the clock of the control loop, ns.
    pub at_ns: u64,
}

/// Entries of a topic that could not be recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LostEntries {
    /// The topic of the missing entries.
    pub topic: Topic,
    /// Time of the first missing entry, ns since the start of the recording.
    pub from_ns: u64,
    /// Number of missing entries.
    pub count: u64,
}

/// The contents of the last record of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordingEnd {
    /// Entries that could not be recorded; with such entries, the recording is incomplete.
    pub lost: Vec<LostEntries>,
    /// The reason why the recording ended before its cycle; `None` if it contains the whole cycle.
    pub stopped: Option<String>,
}

/// The pose of one frame in another, mm and degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FramePose {
    /// The name of the parent frame: `base`, `flange`.
    pub parent: &'static str,
    /// The name of the child frame.
    pub child: &'static str,
    /// The pose of the child frame in the parent frame.
    pub pose: KukaPose,
}

/// The lens of a camera, with the topic and the frame of its pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// The topic of the lens, [`Topic::ScannerLens`] or [`Topic::FlangeLens`].
    pub topic: Topic,
    /// The calibrated camera.
    pub camera: PinholeCamera,
}

impl Lens {
    /// Returns the frame of the camera's pictures and points.
    pub(super) fn frame(&self) -> &'static str {
        if self.topic == Topic::FlangeLens { FLANGE_FRAME } else { SCANNER_FRAME }
    }
}

/// Name of the frame of the 3D camera's pictures and points.
pub(super) const SCANNER_FRAME: &str = "scanner";
pub(super) const FLANGE_FRAME: &str = "flange_camera";

/// The note about units in the first log message of a recording.
pub(super) const UNITS_NOTE: &str = "all lengths in this recording are mm: a viewer that reads them as metres shows the \
                                scene 1000 times too large";

/// A text about an entry, for people.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum ShownText {
    Status(FramePose),
    Note { level: LogLevel, message: String },
}

pub(super) fn entry_texts(entry: &Entry) -> Vec<ShownText> {
    match entry.topic {
        Topic::Report => {
            Report::deserialize(&entry.reply).map_or_else(|_| Vec::new(), |report| robot_texts(&report))
        }
        Topic::Finding => {
            Finding::deserialize(&entry.action).map_or_else(|_| Vec::new(), |finding| finding_texts(&finding))
        }
        _ => Vec::new(),
    }
}

fn robot_texts(report: &Report) -> Vec<ShownText> {
    match report {
        Report::Connected { state } | Report::State(state) | Report::Rebooted { state } => vec![flange(state)],
        Report::LinkLost { why } => vec![ShownText::Note { level: LogLevel::Warning, message: why.to_string() }],
        _ => Vec::new(),
    }
}

fn flange(state: &eki::State) -> ShownText {
    let base: Rigid<Base, Base> = state.active_base.to_rigid();
    let tip: Rigid<Base, Tool> = state.base_from_tcp.to_rigid();
    let tool: Rigid<Flange, Tool> = state.flange_from_tool.to_rigid();
    let pose = KukaPose::from_rigid(&(base * tip * tool.inverse()));
    ShownText::Status(FramePose { parent: "base", child: "flange", pose })
}

fn finding_texts(finding: &Finding) -> Vec<ShownText> {
    let judgement = &finding.judgement;
    let level = match judgement.verdict {
        Verdict::Accept | Verdict::Pass => LogLevel::Info,
        _ => LogLevel::Warning,
    };
    let reasons = judgement.reasons.iter().map(|reason| format!("; {}", reason.message));
    let message =
        format!("{}: {}{}", finding.kind.keyword(), judgement.verdict.keyword(), reasons.collect::<String>());
    let place = finding.details.get("base_from_panel").and_then(|pose| KukaPose::deserialize(pose).ok());
    let stands = place.map(|pose| ShownText::Status(FramePose { parent: "base", child: "panel", pose }));
    std::iter::once(ShownText::Note { level, message }).chain(stands).collect()
}
