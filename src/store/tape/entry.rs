//! The content of a recording, and its data for people: poses and findings, as text. The data for people are not read
//! back.

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

/// One exchange of the loop with its environment.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Its topic.
    pub topic: Topic,
    /// Time of the exchange, ns since the recording began, on the loop's clock.
    pub at_ns: u64,
    /// The loop's action; null if the loop only received an input.
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
    /// Returns the topic of the shot's message.
    pub fn topic(&self) -> Topic {
        match self {
            Shot::Points(_) => Topic::Points,
            Shot::Scanner(_) => Topic::ScannerPicture,
            Shot::Flange(_) => Topic::FlangePicture,
        }
    }

    /// Returns the number of columns and rows.
    pub fn size_px(&self) -> [usize; 2] {
        match self {
            Shot::Points(cloud) => [cloud.width(), cloud.height()],
            Shot::Scanner(picture) | Shot::Flange(picture) => [picture.width, picture.height],
        }
    }

    /// Returns the memory that the shot needs, bytes.
    pub fn bytes(&self) -> usize {
        let [width, height] = self.size_px();
        width * height * if matches!(self, Shot::Points(_)) { 15 } else { 3 }
    }
}

/// The state at the loop's start, in addition to its input files.
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
    /// The loop's memory at the start, in addition to the state machine's state.
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
    /// The program has just started: there is no memory.
    #[default]
    Boot,
    /// The loop had run before, and was idle.
    Cycle {
        /// The robot's last report of its state.
        robot: Option<Box<eki::State>>,
        /// The deadlines that were armed.
        armed: Vec<ArmedDeadline>,
        /// The motion from the panel's nominal pose to its last pose in the earlier cycles, in the base frame.
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

/// The content of the last record of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordingEnd {
    /// Entries that were not recorded: a recording with lost entries is incomplete.
    pub lost: Vec<LostEntries>,
    /// The reason why the recording ended before the cycle; `None` if it did not.
    pub stopped: Option<String>,
}

/// The pose of one frame in another, mm and degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FramePose {
    /// The frame of reference: `base`, `flange`.
    pub parent: &'static str,
    /// The frame.
    pub child: &'static str,
    /// Pose of the child frame in the parent frame.
    pub pose: KukaPose,
}

/// A camera's lens, and the topic and frame of its pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// [`Topic::ScannerLens`] or [`Topic::FlangeLens`].
    pub topic: Topic,
    /// The calibrated camera.
    pub camera: PinholeCamera,
}

impl Lens {
    /// Returns the frame of the lens's pictures and points.
    pub(super) fn frame(&self) -> &'static str {
        if self.topic == Topic::FlangeLens { FLANGE_FRAME } else { SCANNER_FRAME }
    }
}

/// Name of the frame of the 3D camera's pictures and points.
pub(super) const SCANNER_FRAME: &str = "scanner";
pub(super) const FLANGE_FRAME: &str = "flange_camera";

/// The note about units at the beginning of each recording.
pub(super) const UNITS_NOTE: &str = "all lengths in this recording are mm: a viewer that reads them as metres shows the \
                                scene 1000 times too large";

/// The form in which an entry is shown to people.
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
