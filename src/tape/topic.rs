//! Topics and the schemas of their messages.

use super::well_known;

/// A topic of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Topic {
    /// What the robot's link tells.
    Report,
    /// What the robot is told, and what comes of it.
    Command,
    /// Readings of the clock that the loop runs by, where they differ from the one before.
    Clock,
    /// What is asked of the loop.
    Request,
    /// Results of what is computed beside the loop, as they come to it.
    Result,
    /// What the table takes: the journal's lines.
    Event,
    /// What a stage found.
    Finding,
    /// What else is kept, and what is read back from the store.
    Store,
    /// What the cameras are asked, and what they say; a picture or points follow in a message of their own.
    Camera,
    /// The 3D camera's points.
    Points,
    /// The 3D camera's pictures.
    ScannerPicture,
    /// The flange camera's pictures.
    FlangePicture,
    /// For people: the lens of the 3D camera's pictures.
    ScannerLens,
    /// For people: the lens of the flange camera.
    FlangeLens,
    /// For people: where things stand.
    Transform,
    /// For people: what was found, in words.
    Log,
}

impl Topic {
    /// All of them.
    pub const ALL: [Topic; 16] = [
        Topic::Report,
        Topic::Command,
        Topic::Clock,
        Topic::Request,
        Topic::Result,
        Topic::Event,
        Topic::Finding,
        Topic::Store,
        Topic::Camera,
        Topic::Points,
        Topic::ScannerPicture,
        Topic::FlangePicture,
        Topic::ScannerLens,
        Topic::FlangeLens,
        Topic::Transform,
        Topic::Log,
    ];

    /// Its name in the file.
    pub fn name(self) -> &'static str {
        match self {
            Topic::Report => "/robot/report",
            Topic::Command => "/robot/command",
            Topic::Clock => "/clock",
            Topic::Request => "/request",
            Topic::Result => "/result",
            Topic::Event => "/cycle/event",
            Topic::Finding => "/cycle/finding",
            Topic::Store => "/cycle/store",
            Topic::Camera => "/camera",
            Topic::Points => "/scanner/points",
            Topic::ScannerPicture => "/scanner/picture",
            Topic::FlangePicture => "/flange/picture",
            Topic::ScannerLens => "/scanner/calibration",
            Topic::FlangeLens => "/flange/calibration",
            Topic::Transform => "/tf",
            Topic::Log => "/log",
        }
    }

    /// The topic of this name.
    pub fn named(name: &str) -> Option<Self> {
        Topic::ALL.into_iter().find(|topic| topic.name() == name)
    }

    /// Whether its messages are [`Entry`](super::Entry)s, without which nothing can be run again.
    pub fn is_entry(self) -> bool {
        !self.is_shot() && !matches!(self, Topic::ScannerLens | Topic::FlangeLens | Topic::Transform | Topic::Log)
    }

    /// Whether its messages belong to the camera entry before them.
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
            _ => Schema { name: "panelprep.Entry", encoding: JSON, text: ENTRY.as_bytes().to_vec() },
        }
    }
}

pub(super) const JSON: &str = "jsonschema";

const ENTRY: &str = r#"{"title": "panelprep.Entry", "type": "object", "properties": {
    "said": {"description": "what the loop did"}, "heard": {"description": "what came to it"}}}"#;

/// What a message looks like, for whoever reads the file.
pub(super) struct Schema {
    pub name: &'static str,
    pub encoding: &'static str,
    pub text: Vec<u8>,
}

impl Schema {
    /// How its messages are written.
    pub fn message_encoding(&self) -> &'static str {
        if self.encoding == JSON { "json" } else { "protobuf" }
    }
}
