//! The topics of a recording, the schemas of their messages, and the messages of Foxglove's well-known schemas with the
//! descriptors that other programs need.
//!
//! Field numbers and names of the well-known schemas are those of <https://github.com/foxglove/foxglove-sdk>
//! (`schemas/proto`); only the fields that are written are defined here. All lengths are mm.

use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto, FileDescriptorProto,
    FileDescriptorSet, Timestamp,
};
use strum::{IntoStaticStr, VariantArray};

/// A topic of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, IntoStaticStr, VariantArray)]
pub enum Topic {
    /// Reports of the robot link.
    #[strum(serialize = "/robot/report")]
    Report,
    /// Commands to the robot, and their results.
    #[strum(serialize = "/robot/command")]
    Command,
    /// Commands to the compliant tool, and its reports.
    #[strum(serialize = "/tool")]
    Tool,
    /// The times that the control loop has read, if they differ from the previous time.
    #[strum(serialize = "/clock")]
    Clock,
    /// Requests to the control loop.
    #[strum(serialize = "/request")]
    Request,
    /// Results of computations outside of the control loop, in the order in which the loop receives them.
    #[strum(serialize = "/result")]
    Result,
    /// The events of the state table: the lines of the journal.
    #[strum(serialize = "/cycle/event")]
    Event,
    /// Findings of the phases.
    #[strum(serialize = "/cycle/finding")]
    Finding,
    /// Other data that are written to the store, and data that are read from it.
    #[strum(serialize = "/cycle/store")]
    Store,
    /// Requests to the cameras, and their replies; a picture or points follow in another message.
    #[strum(serialize = "/camera")]
    Camera,
    /// Points of the 3D camera.
    #[strum(serialize = "/scanner/points")]
    Points,
    /// Pictures of the 3D camera.
    #[strum(serialize = "/scanner/picture")]
    ScannerPicture,
    /// Pictures of the flange camera.
    #[strum(serialize = "/flange/picture")]
    FlangePicture,
    /// Only for people: the lens of the 3D camera.
    #[strum(serialize = "/scanner/calibration")]
    ScannerLens,
    /// Only for people: the lens of the flange camera.
    #[strum(serialize = "/flange/calibration")]
    FlangeLens,
    /// Only for people: poses.
    #[strum(serialize = "/tf")]
    Transform,
    /// Only for people: findings as text.
    #[strum(serialize = "/log")]
    Log,
}

impl Topic {
    /// All topics.
    pub const ALL: &'static [Topic] = <Self as VariantArray>::VARIANTS;

    /// Returns the topic's name in the file.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the topic with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Topic::ALL.iter().copied().find(|topic| topic.name() == name)
    }

    /// Returns whether the messages of the topic are [`Entry`](super::Entry) values, which are needed to execute the
    /// recording again.
    pub fn is_entry(self) -> bool {
        !self.is_shot() && !matches!(self, Topic::ScannerLens | Topic::FlangeLens | Topic::Transform | Topic::Log)
    }

    /// Returns whether the messages of the topic belong to the previous camera entry.
    pub(super) fn is_shot(self) -> bool {
        matches!(self, Topic::Points | Topic::ScannerPicture | Topic::FlangePicture)
    }

    pub(super) fn schema(self) -> Schema {
        let foxglove = |name| Schema { name, encoding: "protobuf", text: descriptors() };
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

/// The schema of the messages of a topic.
pub(super) struct Schema {
    pub name: &'static str,
    pub encoding: &'static str,
    pub text: Vec<u8>,
}

impl Schema {
    /// Returns the encoding of the topic's messages.
    pub fn message_encoding(&self) -> &'static str {
        if self.encoding == JSON { "json" } else { "protobuf" }
    }
}

/// A compressed picture, such as a JPEG.
#[derive(Clone, PartialEq, Message)]
pub struct CompressedImage {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(bytes = "vec", tag = "2")]
    pub data: Vec<u8>,
    #[prost(string, tag = "3")]
    pub format: String,
    #[prost(string, tag = "4")]
    pub frame_id: String,
}

/// Points with packed fields, which the message itself describes.
#[derive(Clone, PartialEq, Message)]
pub struct PointCloud {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(message, optional, tag = "3")]
    pub pose: Option<Pose>,
    #[prost(fixed32, tag = "4")]
    pub point_stride: u32,
    #[prost(message, repeated, tag = "5")]
    pub fields: Vec<PackedElementField>,
    #[prost(bytes = "vec", tag = "6")]
    pub data: Vec<u8>,
}

/// The description of one field of each point.
#[derive(Clone, PartialEq, Message)]
pub struct PackedElementField {
    #[prost(string, tag = "1")]
    pub name: String,
    #[prost(fixed32, tag = "2")]
    pub offset: u32,
    #[prost(enumeration = "NumericType", tag = "3")]
    pub r#type: i32,
}

/// The number type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, prost::Enumeration)]
pub enum NumericType {
    Unknown = 0,
    Uint8 = 1,
    Float32 = 7,
}

/// The lens of a camera.
#[derive(Clone, PartialEq, Message)]
pub struct CameraCalibration {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(fixed32, tag = "2")]
    pub width: u32,
    #[prost(fixed32, tag = "3")]
    pub height: u32,
    #[prost(string, tag = "4")]
    pub distortion_model: String,
    /// The distortion coefficients k1, k2, p1, p2, k3.
    #[prost(double, repeated, tag = "5")]
    pub d: Vec<f64>,
    /// The camera matrix, row by row.
    #[prost(double, repeated, tag = "6")]
    pub k: Vec<f64>,
    /// The rectification matrix: no rectification.
    #[prost(double, repeated, tag = "7")]
    pub r: Vec<f64>,
    /// The projection matrix of the rectified picture, 3×4, row by row.
    #[prost(double, repeated, tag = "8")]
    pub p: Vec<f64>,
    #[prost(string, tag = "9")]
    pub frame_id: String,
}

/// A position and an orientation.
#[derive(Clone, PartialEq, Message)]
pub struct Pose {
    #[prost(message, optional, tag = "1")]
    pub position: Option<Vector3>,
    #[prost(message, optional, tag = "2")]
    pub orientation: Option<Quaternion>,
}

/// The pose of one frame in another.
#[derive(Clone, PartialEq, Message)]
pub struct FrameTransform {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub parent_frame_id: String,
    #[prost(string, tag = "3")]
    pub child_frame_id: String,
    #[prost(message, optional, tag = "4")]
    pub translation: Option<Vector3>,
    #[prost(message, optional, tag = "5")]
    pub rotation: Option<Quaternion>,
}

#[derive(Clone, PartialEq, Message)]
pub struct Vector3 {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
}

#[derive(Clone, PartialEq, Message)]
pub struct Quaternion {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
    #[prost(double, tag = "4")]
    pub w: f64,
}

/// A message of the log.
#[derive(Clone, PartialEq, Message)]
pub struct Log {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(enumeration = "LogLevel", tag = "2")]
    pub level: i32,
    #[prost(string, tag = "3")]
    pub message: String,
    #[prost(string, tag = "4")]
    pub name: String,
}

/// The severity of a log message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, prost::Enumeration)]
pub enum LogLevel {
    Unknown = 0,
    Info = 2,
    Warning = 3,
}

/// Converts ns since 1970 to a timestamp.
pub fn to_timestamp(unix_ns: u64) -> Timestamp {
    Timestamp { seconds: (unix_ns / NS_PER_S) as i64, nanos: (unix_ns % NS_PER_S) as i32 }
}

const NS_PER_S: u64 = 1_000_000_000;

/// The type of a field in a message.
enum FieldContent {
    Plain(Type),
    Plains(Type),
    Message(&'static str),
    Messages(&'static str),
    Enum(&'static str),
}

const TIMESTAMP: &str = ".google.protobuf.Timestamp";
const VECTOR: FieldContent = FieldContent::Message(".foxglove.Vector3");
const QUATERNION: FieldContent = FieldContent::Message(".foxglove.Quaternion");

/// Returns the descriptors of all messages here as an encoded `FileDescriptorSet`.
fn descriptors() -> Vec<u8> {
    use FieldContent::{Enum, Message as One, Messages, Plain, Plains};
    let double = || Plain(Type::Double);
    let text = || Plain(Type::String);
    let when = || ("timestamp", 1, One(TIMESTAMP));
    let numbers = [("UNKNOWN", 0), ("UINT8", 1), ("FLOAT32", 7)];
    let levels = [("UNKNOWN", 0), ("INFO", 2), ("WARNING", 3)];
    let packed = message(
        "PackedElementField",
        [
            ("name", 1, text()),
            ("offset", 2, Plain(Type::Fixed32)),
            ("type", 3, Enum(".foxglove.PackedElementField.NumericType")),
        ],
    );
    let log = message(
        "Log",
        [when(), ("level", 2, Enum(".foxglove.Log.Level")), ("message", 3, text()), ("name", 4, text())],
    );
    let foxglove = vec![
        message(
            "CompressedImage",
            [when(), ("data", 2, Plain(Type::Bytes)), ("format", 3, text()), ("frame_id", 4, text())],
        ),
        message(
            "PointCloud",
            [
                when(),
                ("frame_id", 2, text()),
                ("pose", 3, One(".foxglove.Pose")),
                ("point_stride", 4, Plain(Type::Fixed32)),
                ("fields", 5, Messages(".foxglove.PackedElementField")),
                ("data", 6, Plain(Type::Bytes)),
            ],
        ),
        add_enum(packed, "NumericType", &numbers),
        message(
            "CameraCalibration",
            [
                when(),
                ("width", 2, Plain(Type::Fixed32)),
                ("height", 3, Plain(Type::Fixed32)),
                ("distortion_model", 4, text()),
                ("D", 5, Plains(Type::Double)),
                ("K", 6, Plains(Type::Double)),
                ("R", 7, Plains(Type::Double)),
                ("P", 8, Plains(Type::Double)),
                ("frame_id", 9, text()),
            ],
        ),
        message("Pose", [("position", 1, VECTOR), ("orientation", 2, QUATERNION)]),
        message(
            "FrameTransform",
            [
                when(),
                ("parent_frame_id", 2, text()),
                ("child_frame_id", 3, text()),
                ("translation", 4, VECTOR),
                ("rotation", 5, QUATERNION),
            ],
        ),
        message("Vector3", [("x", 1, double()), ("y", 2, double()), ("z", 3, double())]),
        message("Quaternion", [("x", 1, double()), ("y", 2, double()), ("z", 3, double()), ("w", 4, double())]),
        add_enum(log, "Level", &levels),
    ];
    let time = vec![message("Timestamp", [("seconds", 1, Plain(Type::Int64)), ("nanos", 2, Plain(Type::Int32))])];
    let imports = vec![TIMESTAMP_FILE.to_owned()];
    let file = vec![
        file_descriptor(TIMESTAMP_FILE, "google.protobuf", vec![], time),
        file_descriptor("foxglove.proto", "foxglove", imports, foxglove),
    ];
    FileDescriptorSet { file }.encode_to_vec()
}

const TIMESTAMP_FILE: &str = "google/protobuf/timestamp.proto";

fn file_descriptor(
    name: &str,
    package: &str,
    dependency: Vec<String>,
    message_type: Vec<DescriptorProto>,
) -> FileDescriptorProto {
    FileDescriptorProto {
        name: Some(name.to_owned()),
        package: Some(package.to_owned()),
        dependency,
        message_type,
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    }
}

fn message<const N: usize>(name: &str, fields: [(&str, i32, FieldContent); N]) -> DescriptorProto {
    let field = |(name, number, holds): (&str, i32, FieldContent)| {
        let (kind, type_name) = match holds {
            FieldContent::Plain(kind) | FieldContent::Plains(kind) => (kind, None),
            FieldContent::Message(of) | FieldContent::Messages(of) => (Type::Message, Some(of.to_owned())),
            FieldContent::Enum(of) => (Type::Enum, Some(of.to_owned())),
        };
        let is_repeated = matches!(holds, FieldContent::Messages(_) | FieldContent::Plains(_));
        let label = if is_repeated { Label::Repeated } else { Label::Optional };
        FieldDescriptorProto {
            name: Some(name.to_owned()),
            number: Some(number),
            label: Some(label.into()),
            r#type: Some(kind.into()),
            type_name,
            ..FieldDescriptorProto::default()
        }
    };
    let field = fields.into_iter().map(field).collect();
    DescriptorProto { name: Some(name.to_owned()), field, ..DescriptorProto::default() }
}

fn add_enum(message: DescriptorProto, name: &str, values: &[(&str, i32)]) -> DescriptorProto {
    let value = |&(name, number): &(&str, i32)| EnumValueDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        ..EnumValueDescriptorProto::default()
    };
    let value = values.iter().map(value).collect();
    let named = EnumDescriptorProto { name: Some(name.to_owned()), value, ..EnumDescriptorProto::default() };
    DescriptorProto { enum_type: vec![named], ..message }
}
