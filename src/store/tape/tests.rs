//! Tests of recordings that are written and read back, truncated, changed or exchanged.

use super::error::METADATA;
use super::topic::{CameraCalibration, CompressedImage, Log, PointCloud};
use super::*;
use panelprep_base::geometry::{Camera, ColorPicture, OrganizedCloud, PinholeCamera};
use panelprep_cell::cycle::State;
use proptest::prelude::*;
use prost::Message;
use serde_json::{Value, json};
use std::sync::Arc;

const BEGAN_NS: u64 = 1_790_000_000_000_000_000;

fn start() -> RecordingStart {
    let (hand_eye_mm, robot_mm) = (Some(0.1), None);
    RecordingStart {
        program: "0.0.0".to_owned(),
        unix_ns: BEGAN_NS,
        state: State::INITIAL,
        lock_step: true,
        begin: LoopMemoryStart::Boot,
        hand_eye_mm,
        robot_mm,
    }
}

fn files() -> Vec<(String, Vec<u8>)> {
    vec![("cell.toml".to_owned(), b"[limits]\n".to_vec()), ("taught/scan.pcd".to_owned(), vec![0, 255, 7])]
}

fn entry(topic: Topic, at_ms: u64, said: Value, heard: Value) -> Entry {
    Entry { topic, at_ns: at_ms * 1_000_000, action: said, reply: heard, shot: None }
}

fn seen(shot: Shot, at_ms: u64) -> Entry {
    let heard = json!({ "Ok": { "size_px": shot.size_px() } });
    Entry { shot: Some(shot), ..entry(Topic::Camera, at_ms, json!("look"), heard) }
}

fn picture(width: usize, height: usize) -> Arc<ColorPicture> {
    let pixel = |index: usize| [index as u8, (index / 256) as u8, 200];
    Arc::new(ColorPicture { width, height, rgb: (0..width * height).map(pixel).collect() })
}

fn cloud(points_mm: Vec<[f32; 3]>) -> Arc<OrganizedCloud<Camera>> {
    let colors = (0..points_mm.len()).map(|index| [index as u8, 1, 2]).collect();
    Arc::new(OrganizedCloud::new(3, 2, points_mm, colors).expect("organised"))
}

/// Returns entries of all topics.
fn entries() -> Vec<Entry> {
    let point = [0.1_f32, -2.5e-7, 812.345_6];
    vec![
        entry(Topic::Clock, 0, Value::Null, json!({ "secs": 0, "nanos": 0 })),
        entry(Topic::Request, 0, Value::Null, json!({ "for": "reset" })),
        entry(Topic::Event, 0, json!({ "asked": "reset" }), json!({ "Ok": null })),
        seen(Shot::Points(cloud(vec![point, [f32::NAN; 3], point, point, [0.0; 3], point])), 20),
        entry(Topic::Report, 20, Value::Null, json!({ "progress": { "done": 7 } })),
        seen(Shot::Scanner(picture(7, 5)), 100),
        entry(Topic::Camera, 100, json!("look"), json!({ "Err": { "camera": "the scanner", "why": "dark" } })),
        seen(Shot::Flange(picture(5, 7)), 300),
        entry(Topic::Store, 300, json!({ "wear_disc_mm2": 0.1 + 0.2 }), json!({ "Ok": null })),
    ]
}

fn written(entries: &[Entry], ending: &RecordingEnd) -> Vec<u8> {
    let mut writer = Writer::begin_recording(Vec::new(), &start(), &files(), &[], &[]).expect("begun");
    entries.iter().for_each(|entry| writer.write(entry).expect("written"));
    writer.finish(ending).expect("finished")
}

fn whole() -> Vec<u8> {
    written(&entries(), &RecordingEnd::default())
}

/// Returns the complete content of an entry, for an exact comparison.
fn bits(entry: &Entry) -> (Topic, String, Vec<u32>, Vec<u8>) {
    let line = json!([entry.action, entry.reply]).to_string();
    let (points, colors) = match &entry.shot {
        None => (vec![], vec![]),
        Some(Shot::Points(cloud)) => (
            cloud.raw_points_mm().as_flattened().iter().map(|mm| mm.to_bits()).collect(),
            cloud.picture().rgb.as_flattened().to_vec(),
        ),
        Some(Shot::Scanner(picture) | Shot::Flange(picture)) => (vec![], picture.rgb.as_flattened().to_vec()),
    };
    (entry.topic, line, points, colors)
}

#[test]
fn a_recording_reads_back_bit_for_bit() {
    let bytes = whole();
    let checked = check_recording(&bytes[..]).expect("whole");
    assert_eq!(checked.start, start());
    assert_eq!(checked.files.into_iter().collect::<Vec<_>>(), files());
    assert_eq!((checked.entries, checked.length_s > 0.299 && checked.length_s < 0.301), (9, true));
    let back: Vec<Entry> = EntryReader::new(&bytes[..], BEGAN_NS).collect::<Result<_, _>>().expect("read");
    let (back, put): (Vec<_>, Vec<_>) = (back.iter().map(bits).collect(), entries().iter().map(bits).collect());
    assert_eq!(back, put);
}

/// Foxglove requires an alpha channel of the colours, and a lens in the same frame as the pictures. Expected pixel,
/// calculated by hand for a lens without distortion: the point (10, −20, 400) mm is at u = 100 · 10/400 + 3 = 5.5 and v
/// = 200 · (−20)/400 + 20 = 10, and the same point in metres as well.
#[test]
fn points_have_colours_and_pictures_a_lens_for_viewers() {
    let (k1, k2, p1, p2, k3) = (0.1, 0.2, 0.3, 0.4, 0.5);
    let lens = PinholeCamera {
        width_px: 7,
        height_px: 5,
        fx_px: 100.0,
        fy_px: 200.0,
        cx_px: 3.0,
        cy_px: 20.0,
        k1,
        k2,
        p1,
        p2,
        k3,
    };
    let lenses = [Topic::ScannerLens, Topic::FlangeLens].map(|topic| Lens { topic, camera: lens });
    let mut writer = Writer::begin_recording(Vec::new(), &start(), &files(), &[], &lenses).expect("begun");
    entries().iter().for_each(|entry| writer.write(entry).expect("written"));
    let bytes = writer.finish(&RecordingEnd::default()).expect("finished");
    assert_eq!(check_recording(&bytes[..]).expect("whole").entries, 9, "lenses are for people, not for a replay");

    let mut seen = std::collections::BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).expect("a container") {
        let message = message.expect("a message");
        let schema = message.channel.schema.as_ref().map(|schema| schema.name.clone()).unwrap_or_default();
        seen.entry(message.channel.topic.clone()).or_insert((schema, message.data.into_owned()));
    }
    let lens_of = |topic: &str| {
        let (schema, data) = &seen[topic];
        assert_eq!(schema, "foxglove.CameraCalibration");
        CameraCalibration::decode(&data[..]).expect("a lens")
    };
    let scanner = lens_of("/scanner/calibration");
    assert_eq!((scanner.width, scanner.height, scanner.frame_id.as_str()), (7, 5, "scanner"));
    assert_eq!((scanner.distortion_model.as_str(), scanner.d.as_slice()), ("plumb_bob", &[k1, k2, p1, p2, k3][..]));
    let seen_at = |point: [f64; 3]| {
        let row = |row: usize| (0..3).map(|column| scanner.p[4 * row + column] * point[column]).sum::<f64>();
        [row(0) / row(2), row(1) / row(2)]
    };
    assert_eq!(seen_at([10.0, -20.0, 400.0]), [5.5, 10.0]);
    let metres = seen_at([0.010, -0.020, 0.400]);
    assert!((metres[0] - 5.5).abs() < 1e-12 && (metres[1] - 10.0).abs() < 1e-12, "{metres:?}");
    assert_eq!(lens_of("/flange/calibration").frame_id, "flange_camera");
    let picture = CompressedImage::decode(&seen["/flange/picture"].1[..]).expect("a picture");
    assert_eq!(picture.frame_id, "flange_camera");

    let cloud = PointCloud::decode(&seen["/scanner/points"].1[..]).expect("points");
    let fields: Vec<(&str, u32)> = cloud.fields.iter().map(|field| (field.name.as_str(), field.offset)).collect();
    assert_eq!(fields[3..], [("red", 12), ("green", 13), ("blue", 14), ("alpha", 15)]);
    assert_eq!(
        (cloud.point_stride, &cloud.data[16 * 3 + 12..16 * 4]),
        (16, &[3, 1, 2, 255][..]),
        "the fourth point"
    );
    let log = Log::decode(&seen["/log"].1[..]).expect("words");
    assert!(log.message.contains("lengths in this recording are mm"), "{}", log.message);
}

/// A crash leaves a truncated file: it is refused as unfinished, and its entries can be read up to the last complete
/// chunk.
#[test]
fn a_cut_recording_is_unfinished_at_any_cut() {
    let mut writer = Writer::begin_recording(Vec::new(), &start(), &files(), &[], &[]).expect("begun");
    for entry in entries() {
        writer.write(&entry).expect("written");
        writer.end_chunk().expect("flushed");
    }
    let bytes = writer.finish(&RecordingEnd::default()).expect("finished");
    let mut most = 0;
    for length in 0..bytes.len() {
        match check_recording(&bytes[..length]) {
            Err(TapeError::Unfinished { entries, .. }) => {
                assert!(entries >= most, "at {length}: {entries} after {most}");
                most = entries;
            }
            Err(TapeError::NotMcap { .. }) => assert!(length < 64, "{length}"),
            other => panic!("cut at {length} of {}: {other:?}", bytes.len()),
        }
    }
    assert_eq!(most, 9, "all chunks are whole before the end is written");
}

#[test]
fn a_changed_byte_is_found() {
    let bytes = whole();
    for at in (0..bytes.len()).step_by(7) {
        let mut changed = bytes.clone();
        changed[at] ^= 0x10;
        assert!(check_recording(&changed[..]).is_err(), "byte {at} of {}", bytes.len());
    }
}

#[test]
fn a_gap_is_named_with_its_topic_and_time() {
    let mut writer = Writer::begin_recording(Vec::new(), &start(), &files(), &[], &[]).expect("begun");
    let clock = |at_ms| entry(Topic::Clock, at_ms, Value::Null, json!(at_ms));
    writer.write(&clock(100)).expect("written");
    writer.skip(Topic::Clock);
    writer.write(&clock(300)).expect("written");
    let bytes = writer.finish(&RecordingEnd::default()).expect("finished");
    let error = check_recording(&bytes[..]).expect_err("a gap");
    assert!(
        matches!(error, TapeError::Gap { topic: "/clock", expected: 1, found: 2, from_s } if from_s > 0.09 && from_s < 0.11),
        "{error}"
    );

    let lost = |topic, from_ms: u64| LostEntries { topic, from_ns: from_ms * 1_000_000, count: 3 };
    let lost = vec![lost(Topic::Report, 900), lost(Topic::Camera, 250)];
    let ending = RecordingEnd { lost, stopped: None };
    let error = check_recording(&written(&entries(), &ending)[..]).expect_err("it says so itself");
    assert!(matches!(error, TapeError::Lost { topic: "/camera", count: 3, .. }), "{error}");
    assert!(error.to_string().contains("3 entries of /camera, the first 0.250 s"), "{error}");
}

/// A recording that ended before its cycle states the reason. It contains all entries up to this time, but not a whole
/// cycle.
#[test]
fn a_recording_that_was_stopped_states_why() {
    let ending = RecordingEnd { stopped: Some("the disk has 1999 MB left".to_owned()), ..RecordingEnd::default() };
    let error = check_recording(&written(&entries(), &ending)[..]).expect_err("stopped");
    let words = "was stopped 0.300 s after its beginning, before its cycle ended: the disk has 1999 MB left";
    assert!(error.to_string().contains(words), "{error}");
}

/// Returns a file of another program, or of another version of this program.
fn foreign(names: &[(&str, &str)]) -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    let mut writer = mcap::Writer::new(&mut file).expect("begun");
    if !names.is_empty() {
        let metadata = names.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        writer.write_metadata(&mcap::records::Metadata { name: METADATA.to_owned(), metadata }).expect("written");
    }
    let channel = writer.add_channel(0, "/chatter", "json", &Default::default()).expect("added");
    let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 5, publish_time: 5 };
    writer.write_to_known_channel(&header, b"{}").expect("written");
    writer.finish().expect("finished");
    drop(writer);
    file.into_inner()
}

#[test]
fn other_files_are_refused_with_the_reason() {
    let refused = |bytes: &[u8]| check_recording(bytes).expect_err("refused").to_string();
    let version = refused(&foreign(&[("format", "99"), ("program", "9.1.0")]));
    assert!(
        version.contains("format 99 (written by panelprep 9.1.0)") && version.contains(&format!("format {FORMAT}")),
        "{version}"
    );
    let older = refused(&foreign(&[("format", "1"), ("program", "0.0.1")]));
    assert!(older.contains("format 1 (written by panelprep 0.0.1)"), "{older}");
    assert!(refused(&foreign(&[])).contains("not a recording of panelprep"));
    assert!(refused(&foreign(&[("format", &FORMAT.to_string())])).contains("/chatter"));
    for bytes in [&b""[..], b"P6\n2 2\n255\n", b"\x89MCAP0\r\nand then not"] {
        assert!(matches!(check_recording(bytes), Err(TapeError::NotMcap { .. })), "{bytes:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Points with any bits, numbers of any size, and texts with any characters are read back exactly.
    #[test]
    fn any_shot_and_any_number_reads_back(
        points in prop::collection::vec(any::<[u32; 3]>(), 6),
        number in any::<f64>().prop_filter("JSON has no others", |number| number.is_finite()),
        words in any::<String>(),
        whole in any::<u64>(),
    ) {
        let points = points.into_iter().map(|bits| bits.map(f32::from_bits)).collect();
        let said = json!({ "number": number, "words": words, "whole": whole });
        let put = [seen(Shot::Points(cloud(points)), 0), entry(Topic::Store, 1, said, Value::Null)];
        let bytes = written(&put, &RecordingEnd::default());
        prop_assert!(check_recording(&bytes[..]).is_ok());
        let back: Vec<Entry> = EntryReader::new(&bytes[..], BEGAN_NS).collect::<Result<_, _>>().expect("read");
        prop_assert_eq!(back.iter().map(bits).collect::<Vec<_>>(), put.iter().map(bits).collect::<Vec<_>>());
    }

    /// Random bytes after a valid beginning are read or refused without a panic.
    #[test]
    fn any_bytes_are_read_or_refused_with_a_text(tail in prop::collection::vec(any::<u8>(), 0..300), keep in 0_usize..1_000) {
        let mut bytes = whole();
        bytes.truncate(keep);
        bytes.extend(tail);
        prop_assert!(check_recording(&bytes[..]).is_err());
    }
}
