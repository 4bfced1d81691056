//! Writes entries as bytes. Bytes are only appended, chunk by chunk, so that after a crash the recording can be read up
//! to its last complete chunk.

use super::entry::{
    Entry, FLANGE_FRAME, FramePose, Lens, LostEntries, RecordingEnd, RecordingStart, SCANNER_FRAME, Shot,
    ShownText, UNITS_NOTE, entry_texts,
};
use super::error::{END, FORMAT, METADATA, START, TapeError};
use super::topic::{
    CameraCalibration, CompressedImage, FrameTransform, Log, LogLevel, NumericType, PackedElementField, PointCloud,
    Pose, Quaternion, Topic, Vector3, to_timestamp,
};
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, McapError, WriteOptions};
use panelprep_base::geometry::{
    Base, Camera, ColorPicture, Flange, KukaPose, OrganizedCloud, PinholeCamera, Rigid,
};
use panelprep_cell::files::write_color_png;
use prost::Message;
use serde_json::json;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Write;

/// Size of a point, bytes: three coordinates, three colours, and an alpha value, without which Foxglove shows no
/// colours.
pub(super) const POINT_BYTES: usize = 16;
const OPAQUE_ALPHA: u8 = 255;

/// The state of a topic in the file.
#[derive(Debug, Clone, Copy)]
struct Channel {
    id: u16,
    written: u64,
}

/// A writer of one recording.
pub struct Writer<W: Write> {
    mcap: mcap::Writer<NoSeek<W>>,
    channels: BTreeMap<Topic, Channel>,
    began_ns: u64,
    last_ns: u64,
}

impl<W: Write> Writer<W> {
    /// Starts a recording with the initial state of the control loop, the files that it uses, the mounts of cameras and
    /// tool, and the lenses of the cameras.
    ///
    /// # Errors
    /// If the recording cannot be written; the same applies to all other methods.
    pub fn begin_recording(
        out: W,
        start: &RecordingStart,
        files: &[(String, Vec<u8>)],
        mounted: &[FramePose],
        lenses: &[Lens],
    ) -> Result<Self, TapeError> {
        let options = WriteOptions::new()
            .library(format!("panelprep {}", start.program))
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .disable_seeking(true);
        let mut mcap = options.create(NoSeek::new(out)).map_err(write_error)?;
        let version = [("format", FORMAT.to_string()), ("program", start.program.clone())];
        mcap.write_metadata(&metadata(METADATA, version)).map_err(write_error)?;
        let start_json = serde_json::to_vec_pretty(start).unwrap_or_default();
        let start_file = (START.to_owned(), start_json);
        for (name, bytes) in std::iter::once(&start_file).chain(files) {
            mcap.attach(&Attachment {
                log_time: start.unix_ns,
                create_time: start.unix_ns,
                name: name.clone(),
                media_type: media_type(name).to_owned(),
                data: Cow::Borrowed(bytes),
            })
            .map_err(write_error)?;
        }
        let mut channels = BTreeMap::new();
        for &topic in Topic::ALL {
            let schema = topic.schema();
            let encoding = schema.message_encoding();
            let id = mcap.add_schema(schema.name, schema.encoding, &schema.text).map_err(write_error)?;
            let lengths = BTreeMap::from([("lengths".to_owned(), "mm".to_owned())]);
            let id = mcap.add_channel(id, topic.name(), encoding, &lengths).map_err(write_error)?;
            channels.insert(topic, Channel { id, written: 0 });
        }
        let mut writer = Writer { mcap, channels, began_ns: start.unix_ns, last_ns: start.unix_ns };
        writer.show(0, &ShownText::Note { level: LogLevel::Info, message: UNITS_NOTE.to_owned() })?;
        mounted.iter().try_for_each(|mounted| writer.show(0, &ShownText::Status(*mounted)))?;
        for lens in lenses {
            let calibration = calibration(lens, start.unix_ns);
            writer.message(lens.topic, 0, &calibration.encode_to_vec())?;
        }
        Ok(writer)
    }

    /// Writes an entry, and the data about it for people.
    ///
    /// # Errors
    /// The errors of [`Writer::begin_recording`].
    pub fn write(&mut self, entry: &Entry) -> Result<(), TapeError> {
        let body = json!({ "said": entry.action, "heard": entry.reply });
        self.message(entry.topic, entry.at_ns, body.to_string().as_bytes())?;
        if let Some(shot) = &entry.shot {
            let bytes = self.pack_shot(shot, entry.at_ns)?;
            self.message(shot.topic(), entry.at_ns, &bytes)?;
        }
        entry_texts(entry).iter().try_for_each(|shown| self.show(entry.at_ns, shown))
    }

    /// Ends the current chunk, so that all entries written so far can be read even after a crash.
    ///
    /// # Errors
    /// The errors of [`Writer::begin_recording`].
    pub fn end_chunk(&mut self) -> Result<(), TapeError> {
        self.mcap.flush().map_err(write_error)
    }

    /// Ends the recording, and writes the number of messages.
    ///
    /// # Errors
    /// The errors of [`Writer::begin_recording`].
    pub fn finish(mut self, ending: &RecordingEnd) -> Result<W, TapeError> {
        let counts: BTreeMap<&str, u64> =
            self.channels.iter().map(|(topic, channel)| (topic.name(), channel.written)).collect();
        let lost = |lost: &LostEntries| json!([lost.topic.name(), lost.from_ns, lost.count]);
        let lost: Vec<_> = ending.lost.iter().map(lost).collect();
        let ended = [("entries", json!(counts).to_string()), ("lost", json!(lost).to_string())];
        let stopped = ending.stopped.iter().map(|why| ("stopped", why.clone()));
        self.mcap.write_metadata(&metadata(END, ended.into_iter().chain(stopped))).map_err(write_error)?;
        self.mcap.finish().map_err(write_error)?;
        Ok(self.mcap.into_inner().into_inner())
    }

    /// Skips a message, as another program might do.
    #[cfg(test)]
    pub(super) fn skip(&mut self, topic: Topic) {
        self.channels.entry(topic).and_modify(|channel| channel.written += 1);
    }

    fn message(&mut self, topic: Topic, at_ns: u64, data: &[u8]) -> Result<(), TapeError> {
        let log_time = (self.began_ns + at_ns).max(self.last_ns + 1);
        self.last_ns = log_time;
        let Some(channel) = self.channels.get_mut(&topic) else { return Ok(()) };
        let header = MessageHeader {
            channel_id: channel.id,
            // After 2³² messages, the sequence number continues with 0; readers expect this.
            sequence: channel.written as u32,
            log_time,
            publish_time: self.began_ns + at_ns,
        };
        channel.written += 1;
        self.mcap.write_to_known_channel(&header, data).map_err(write_error)
    }

    fn show(&mut self, at_ns: u64, shown: &ShownText) -> Result<(), TapeError> {
        let when = Some(to_timestamp(self.began_ns + at_ns));
        match shown {
            ShownText::Status(FramePose { parent, child, pose }) => {
                let Pose { position, orientation } = to_pose(pose);
                let stands = FrameTransform {
                    timestamp: when,
                    parent_frame_id: (*parent).to_owned(),
                    child_frame_id: (*child).to_owned(),
                    translation: position,
                    rotation: orientation,
                };
                self.message(Topic::Transform, at_ns, &stands.encode_to_vec())
            }
            ShownText::Note { level, message } => {
                let says = Log {
                    timestamp: when,
                    level: (*level).into(),
                    message: message.clone(),
                    name: "panelprep".to_owned(),
                };
                self.message(Topic::Log, at_ns, &says.encode_to_vec())
            }
        }
    }

    fn pack_shot(&self, shot: &Shot, at_ns: u64) -> Result<Vec<u8>, TapeError> {
        let unix_ns = self.began_ns + at_ns;
        match shot {
            Shot::Points(cloud) => Ok(points(cloud, unix_ns).encode_to_vec()),
            Shot::Scanner(picture) => image(picture, SCANNER_FRAME, unix_ns),
            Shot::Flange(picture) => image(picture, FLANGE_FRAME, unix_ns),
        }
    }
}

fn write_error(source: McapError) -> TapeError {
    TapeError::Disk { doing: "written", source }
}

fn metadata<'k>(name: &str, pairs: impl IntoIterator<Item = (&'k str, String)>) -> Metadata {
    let metadata = pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    Metadata { name: name.to_owned(), metadata }
}

fn media_type(name: &str) -> &'static str {
    match name.rsplit('.').next() {
        Some("json") => "application/json",
        Some("toml") => "application/toml",
        Some("png") => "image/png",
        _ => "application/octet-stream",
    }
}

fn image(picture: &ColorPicture, frame: &str, unix_ns: u64) -> Result<Vec<u8>, TapeError> {
    let image = CompressedImage {
        timestamp: Some(to_timestamp(unix_ns)),
        data: write_color_png(picture)?,
        format: "png".to_owned(),
        frame_id: frame.to_owned(),
    };
    Ok(image.encode_to_vec())
}

fn points(cloud: &OrganizedCloud<Camera>, unix_ns: u64) -> PointCloud {
    let mut data = Vec::with_capacity(POINT_BYTES * cloud.raw_points_mm().len());
    for (index, point) in cloud.raw_points_mm().iter().enumerate() {
        point.iter().for_each(|mm| data.extend(mm.to_le_bytes()));
        data.extend(cloud.color_at(index));
        data.push(OPAQUE_ALPHA);
    }
    let field = |(name, offset, kind): (&str, u32, NumericType)| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    let coordinates =
        [("x", 0, NumericType::Float32), ("y", 4, NumericType::Float32), ("z", 8, NumericType::Float32)];
    let colors = [("red", 12), ("green", 13), ("blue", 14), ("alpha", 15)];
    let colors = colors.map(|(name, offset)| (name, offset, NumericType::Uint8));
    PointCloud {
        timestamp: Some(to_timestamp(unix_ns)),
        frame_id: SCANNER_FRAME.to_owned(),
        pose: Some(to_pose(&KukaPose::default())),
        point_stride: POINT_BYTES as u32,
        fields: coordinates.into_iter().chain(colors).map(field).collect(),
        data,
    }
}

/// Converts a lens to OpenCV's model, which is also the model of this program and Foxglove's "plumb bob". Pixel
/// coordinates begin at the centre of the first pixel.
fn calibration(lens: &Lens, unix_ns: u64) -> CameraCalibration {
    let PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 } = lens.camera;
    CameraCalibration {
        timestamp: Some(to_timestamp(unix_ns)),
        width: width_px as u32,
        height: height_px as u32,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![k1, k2, p1, p2, k3],
        k: vec![fx_px, 0.0, cx_px, 0.0, fy_px, cy_px, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx_px, 0.0, cx_px, 0.0, 0.0, fy_px, cy_px, 0.0, 0.0, 0.0, 1.0, 0.0],
        frame_id: lens.frame().to_owned(),
    }
}

fn to_pose(pose: &KukaPose) -> Pose {
    let rigid: Rigid<Base, Flange> = pose.to_rigid();
    let (at, turn) = (rigid.isometry().translation.vector, rigid.isometry().rotation);
    Pose {
        position: Some(Vector3 { x: at.x, y: at.y, z: at.z }),
        orientation: Some(Quaternion { x: turn.i, y: turn.j, z: turn.k, w: turn.w }),
    }
}
