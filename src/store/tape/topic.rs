//! Topics and the schemas of their messages.

use super::well_known;
use strum::{IntoStaticStr, VariantArray};

/// A topic of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, IntoStaticStr, VariantArray)]
pub enum Topic {
    /// Reports of the robot's link.
    #[strum(serialize = "/robot/report")]
    Report,
    /// Commands to the robot, and their results.
    #[strum(serialize = "/robot/command")]
    Command,
    /// Commands to the compliant tool, and its reports.
    #[strum(serialize = "/tool")]
    Tool,
    /// Readings of the clock that the loop uses, if they differ from the one before.
    #[strum(serialize = "/clock")]
    Clock,
    /// Requests to the loop.
    #[strum(serialize = "/request")]
    Request,
    /// Results of computations outside the loop, in the order in which the loop receives them.
    #[strum(serialize = "/result")]
    Result,
    /// The events of the state machine: the journal's lines.
    #[strum(serialize = "/cycle/event")]
    Event,
    /// Findings of the stages.
    #[strum(serialize = "/cycle/finding")]
    Finding,
    /// Other data written to the store, and data read from the store.
    #[strum(serialize = "/cycle/store")]
    Store,
    /// Requests to the cameras, and their answers; a picture or points follow in a separate message.
    #[strum(serialize = "/camera")]
    Camera,
    /// The 3D camera's points.
    #[strum(serialize = "/scanner/points")]
    Points,
    /// The 3D camera's pictures.
    #[strum(serialize = "/scanner/picture")]
    ScannerPicture,
    /// The flange camera's pictures.
    #[strum(serialize = "/flange/picture")]
    FlangePicture,
    /// For people: the lens of the 3D camera's pictures.
    #[strum(serialize = "/scanner/calibration")]
    ScannerLens,
    /// For people: the lens of the flange camera.
    #[strum(serialize = "/flange/calibration")]
    FlangeLens,
    /// For people: the poses.
    #[strum(serialize = "/tf")]
    Transform,
    /// For people: the findings, as text.
    #[strum(serialize = "/log")]
    Log,
}

impl Topic {
    /// All topics.
    pub const ALL: &'static [Topic] = <Self as VariantArray>::VARIANTS;

    /// The topic's name in the file.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the topic with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Topic::ALL.iter().copied().find(|topic| topic.name() == name)
    }

    /// Returns whether the topic's messages are [`Entry`](super::Entry)s, which are required to run the recording
    /// again.
    pub fn is_entry(self) -> bool {
        !self.is_shot() && !matches!(self, Topic::ScannerLens | Topic::FlangeLens | Topic::Transform | Topic::Log)
    }

    /// Returns whether the topic's messages belong to the preceding camera entry.
    pub(super) fn is_shot(self) -> bool {
        matches!(self, Topic::Points | Topic::ScannerPicture | Topic::FlangePicture)
    }

    pub(super) fn schema(self) -> Schema {
        let foxglove = |name| Schema { name, encoding: "protobuf", text: well_known::descriptors() };
        match self {
            Topic::Points => foxglove("foxglove.PointCloud"),
            Topic::ScannerPicture | Topic::FlangePicture => foxglove("foxglove.CompressedImage"),
            Topic::ScannerLens | Topic::FlangeLens => foxglove("foxglove.CameraCalibration"),
            Topic::Transform => foxglove("foxglove.FrameTransform"),
            Topic::Log => foxglove("foxglove.Log"),
            _ => Schema { name: "panelprep.Entry", encoding: JSON, text: ENTRY_SCHEMA.as_bytes().to_vec() },
        }
    }
}

pub(super) const JSON: &str = "jsonschema";

const ENTRY_SCHEMA: &str = r#"{"title": "panelprep.Entry", "type": "object", "properties": {
    "said": {"description": "what the loop did"}, "heard": {"description": "what came to it"}}}"#;

/// The form of a message, for readers of the file.
pub(super) struct Schema {
    pub name: &'static str,
    pub encoding: &'static str,
    pub text: Vec<u8>,
}

impl Schema {
    /// The encoding of the topic's messages.
    pub fn message_encoding(&self) -> &'static str {
        if self.encoding == JSON { "json" } else { "protobuf" }
    }
}
