//! Each reader of bytes from outside as one function of bytes. It must return without a panic. If its result can be
//! written, reading the written bytes must give the same result.

use super::{seeds, session};
use panelprep::cell::{
    Cell, FlangeCameraMount, Intrinsics, Mount, MountedPose, RobotCorrection, ScannerMount, TargetMount, ToolMount,
    ZividSettings, ZividUse,
};
use panelprep::daemon::{read_request, request_line};
use panelprep::devices::zivid::{message, wire};
use panelprep::eki::{ChannelFile, Framer, MAX_DOCUMENT_BYTES, Time};
use panelprep::force::{ForceSetPoint, Session, SessionLimits};
use panelprep::geometry::{Camera, Drawing, LengthUnit, PinholeCamera, Rigid};
use panelprep::nominal::{Part, PartEdges, PartRays, PartView};
use panelprep::office::{CellState, Chunk, Message, PartAssembly};
use panelprep::recipe::Recipe;
use panelprep::sparkplug::{
    CellIds, CellView, EdgeNode, HostState, NodeAction, NodeEvent, NodeSetup, NodeTime, commands, values,
};
use panelprep::{backup, files, krl, labels, tape};
use std::io::Read;
use std::time::Duration;

/// A reader under test.
pub struct Target {
    /// The name of the target, which is also the name of its corpus in `fixtures/fuzz/`.
    pub name: &'static str,
    /// Reads these bytes.
    pub run: fn(&[u8]),
    /// Inputs that the reader accepts, or nearly accepts.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

/// All targets.
pub const TARGETS: [Target; 24] = [
    Target { name: "framer", run: framer, seeds: seeds::messages },
    Target { name: "wire", run: messages, seeds: seeds::messages },
    Target { name: "channel", run: channel, seeds: seeds::channels },
    Target { name: "session", run: session::run, seeds: seeds::sessions },
    Target { name: "request", run: request, seeds: seeds::requests },
    Target { name: "recipe", run: recipe, seeds: seeds::recipes },
    Target { name: "cell", run: cell, seeds: seeds::cells },
    Target { name: "lens", run: lens, seeds: seeds::lenses },
    Target { name: "mounts", run: mounts, seeds: seeds::mounts },
    Target { name: "pcd", run: pcd, seeds: seeds::pcd },
    Target { name: "ply", run: ply, seeds: seeds::ply },
    Target { name: "mesh", run: mesh, seeds: seeds::meshes },
    Target { name: "clip", run: clip, seeds: seeds::clips },
    Target { name: "picture", run: picture, seeds: seeds::pictures },
    Target { name: "pose", run: pose, seeds: seeds::poses },
    Target { name: "tape", run: recording, seeds: seeds::recordings },
    Target { name: "zivid_settings", run: zivid_settings, seeds: seeds::zivid_settings },
    Target { name: "krl", run: program, seeds: seeds::programs },
    Target { name: "backup", run: archive, seeds: seeds::archives },
    Target { name: "worker", run: worker, seeds: seeds::frames },
    Target { name: "labels", run: label, seeds: seeds::labels },
    Target { name: "tool", run: tool, seeds: seeds::tools },
    Target { name: "office", run: office, seeds: seeds::office_parts },
    Target { name: "sparkplug", run: node, seeds: seeds::node_commands },
];

/// The camera of the small pictures and clouds among the seeds.
pub const CAMERA: PinholeCamera = PinholeCamera {
    width_px: 40,
    height_px: 30,
    fx_px: 50.0,
    fy_px: 50.0,
    cx_px: 19.5,
    cy_px: 14.5,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

/// Reads a message part, and its possible contents: a message, a state and a list.
fn office(bytes: &[u8]) {
    if let Ok(chunk) = Chunk::read(bytes) {
        assert_eq!(Chunk::read(&chunk.bytes().expect("bytes")).as_ref(), Ok(&chunk));
        let mut assembly = PartAssembly::default();
        drop(assembly.add(chunk.clone(), ()));
        drop(assembly.add(chunk, ()));
    }
    if let Ok(message) = Message::read(bytes) {
        assert_eq!(Message::read(&message.bytes().expect("bytes")).as_ref(), Ok(&message));
    }
    if let Ok((_, state)) = CellState::read(bytes) {
        drop(state.bytes().expect("bytes"));
    }
}

/// Reads the messages of a compliant tool, beginning with its log-in, in one piece and cut in two; both must give the
/// same result.
fn tool(bytes: &[u8]) {
    let limits = SessionLimits {
        login: "ferba".to_owned(),
        id: 1040,
        period: Duration::from_millis(10),
        reply_within: Duration::from_millis(100),
        rest_set_point: ForceSetPoint::retracted(-20.0),
    };
    let heard = |pieces: [&[u8]; 2]| {
        let mut session = Session::new(limits.clone());
        session.connected(Time::from_ms(0));
        session.received(b"ferbak", Time::from_ms(1));
        session.tick(Time::from_ms(1));
        pieces.iter().for_each(|piece| session.received(piece, Time::from_ms(2)));
        (session.state().clone(), session.last_reading())
    };
    let (first, rest) = bytes.split_at(bytes.len() / 2);
    assert_eq!(heard([bytes, b""]), heard([first, rest]));
}

/// Returns the documents and the first error of a stream that arrives in these pieces.
pub fn documents(pieces: &[&[u8]]) -> (Vec<String>, Option<String>) {
    let (mut framer, mut found) = (Framer::default(), Vec::new());
    for piece in pieces {
        framer.push(piece);
        loop {
            match framer.next_document() {
                Ok(Some(document)) => found.push(document),
                Ok(None) => break,
                Err(error) => return (found, Some(error.to_string())),
            }
        }
    }
    (found, None)
}

/// Checks that the result does not depend on the positions at which the stream is cut.
fn framer(bytes: &[u8]) {
    let Some((&cut, stream)) = bytes.split_first() else { return };
    let cut = usize::from(cut).min(stream.len());
    let (whole, error) = documents(&[stream]);
    assert_eq!(documents(&[&stream[..cut], &stream[cut..]]), (whole.clone(), error));
    assert!(whole.iter().all(|document| document.len() <= MAX_DOCUMENT_BYTES));
}

/// Checks that no document is both an acknowledgement and a state.
fn messages(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let wire = session::wire();
    let read = (wire.decode_ack(text).map(drop), wire.decode_state(text).map(drop));
    assert!(read != (Ok(()), Ok(())), "both an acknowledgement and a state");
    for error in [read.0.err(), read.1.err()].into_iter().flatten() {
        assert!(!error.to_string().is_empty());
    }
}

fn channel(bytes: &[u8]) {
    if let Err(error) = ChannelFile::parse(&String::from_utf8_lossy(bytes)) {
        assert!(!error.to_string().is_empty());
    }
}

fn request(bytes: &[u8]) {
    match read_request(bytes) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(what) => {
            let line = request_line(&what).expect("a client may request it");
            let again = read_request(line.as_bytes()).expect("it reads back");
            assert_eq!(format!("{again:?}"), format!("{what:?}"));
        }
    }
}

fn recipe(bytes: &[u8]) {
    if let Err(problems) = Recipe::check("recipe.toml", &String::from_utf8_lossy(bytes)) {
        assert!(!problems.to_string().is_empty());
    }
}

fn cell(bytes: &[u8]) {
    if let Err(problems) = Cell::check("cell.toml", &String::from_utf8_lossy(bytes)) {
        assert!(!problems.to_string().is_empty());
    }
}

fn lens(bytes: &[u8]) {
    match Intrinsics::check("lens.toml", &String::from_utf8_lossy(bytes)) {
        Err(problems) => assert!(!problems.to_string().is_empty()),
        Ok(lens) => drop(Intrinsics::check("lens.toml", &lens.to_toml()).expect("it reads back")),
    }
}

fn mount<M: Mount>(text: &str) {
    match MountedPose::<M>::check("mount.toml", text) {
        Err(problems) => assert!(!problems.to_string().is_empty()),
        Ok(mount) => drop(MountedPose::<M>::check("mount.toml", &mount.to_toml()).expect("it reads back")),
    }
}

fn mounts(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    mount::<ScannerMount>(&text);
    mount::<FlangeCameraMount>(&text);
    mount::<ToolMount>(&text);
    mount::<TargetMount>(&text);
    if let Ok(correction) = RobotCorrection::check("robot.toml", &text) {
        RobotCorrection::check("robot.toml", &correction.to_toml()).expect("it reads back");
    }
}

fn pcd(bytes: &[u8]) {
    if let Ok(cloud) = files::read_pcd(bytes, &CAMERA) {
        files::read_pcd(&files::write_pcd(&cloud), &CAMERA).expect("it reads back");
    }
    drop(files::read_any_cloud(bytes, None));
}

fn mesh(bytes: &[u8]) {
    let Ok(mesh) = files::read_mesh(bytes) else { return };
    let is_single = mesh.vertices.iter().flatten().all(|number| number.abs() < f64::from(f32::MAX));
    if is_single {
        let back = files::read_mesh(&files::write_stl(&mesh)).expect("it reads back");
        assert_eq!(back.triangles.len(), mesh.triangles.len());
    }
    if let Ok(part) = Part::choose(mesh, Some(LengthUnit::Millimetre), None)
        && let Ok(edges) = PartEdges::find(&part)
    {
        let place =
            Rigid::<Camera, Drawing>::from_isometry_unchecked(nalgebra::Isometry3::translation(0.0, 0.0, 500.0));
        let rays = PartRays::new(part, &place);
        let is_whole = rays.check_crossings(&edges, &place).is_ok();
        if is_whole && let Ok(Some(seen)) = PartView::view_part(&rays, &CAMERA) {
            assert_eq!(seen.cloud().map(|cloud| cloud.width()), Some(CAMERA.width_px));
        }
    }
}

fn ply(bytes: &[u8]) {
    if let Ok(cloud) = files::read_ply(bytes, &CAMERA) {
        files::read_ply(&files::write_ply(&cloud), &CAMERA).expect("it reads back");
    }
    drop(files::read_any_cloud(bytes, Some((40, 30))));
}

fn clip(bytes: &[u8]) {
    match files::read_clip(bytes) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(clip) => assert_eq!(files::read_clip(clip.to_csv().as_bytes()), Ok(clip)),
    }
}

fn picture(bytes: &[u8]) {
    if let Ok(picture) = files::read_color(bytes) {
        assert_eq!(picture.rgb.len(), picture.width * picture.height);
    }
    // A picture that is read for a measurement must have the size of the camera's pictures.
    if let Ok(picture) = files::read_measured_gray(bytes, &CAMERA) {
        assert_eq!((picture.width, picture.height, picture.gray.len()), (40, 30, 1_200));
    }
}

/// Checks that every pose that is read is finite.
fn pose(bytes: &[u8]) {
    let reported = files::read_reported_flange(bytes).map(|flange| flange.base_from_flange);
    for pose in [files::read_located(bytes, None), files::read_flange(bytes), reported].into_iter().flatten() {
        assert!(pose.is_finite());
    }
    drop(files::read_located_mm(bytes));
}

fn recording(bytes: &[u8]) {
    match tape::check_recording(bytes) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(checked) => {
            let entries =
                tape::EntryReader::new(bytes, checked.start.unix_ns).take_while(Result::is_ok).count() as u64;
            assert!(entries <= checked.entries);
        }
    }
}

fn zivid_settings(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    for usage in [ZividUse::Scan, ZividUse::Film] {
        match ZividSettings::check("settings.yml", &text, usage) {
            Err(problems) => assert!(!problems.to_string().is_empty()),
            Ok(settings) => assert!(settings.exposures_us().iter().all(|exposure| exposure.is_finite())),
        }
    }
}

fn program(bytes: &[u8]) {
    let file = krl::parse("cell.src", &String::from_utf8_lossy(bytes));
    let analysis = krl::analyse(&[file], None);
    assert_eq!((analysis.problems.len(), analysis.warnings.len(), analysis.unexecuted.len()), (1, 1, 1));
}

/// Reads these bytes unchanged, and with a matching seal, so that the code after the check of the seal is reached.
fn archive(bytes: &[u8]) {
    let file = tempfile::NamedTempFile::new_in("/dev/shm").expect("memory");
    for bytes in [bytes.to_vec(), seeds::sealed(bytes)] {
        std::fs::write(file.path(), &bytes).expect("written");
        let Ok(archive) = backup::Archive::open(file.path()) else { continue };
        let read = archive.for_each_entry::<backup::BackupError>(|_, content| {
            // The reader reports content that cannot be unpacked.
            drop(std::io::copy(&mut content.take(1 << 20), &mut std::io::sink()));
            Ok(())
        });
        drop(read);
    }
}

/// Reads the bytes as frames, and as the header of a complete frame.
fn worker(mut bytes: &[u8]) {
    let head = bytes;
    drop(serde_json::from_slice::<message::Request>(head));
    if let Ok(reply) = serde_json::from_slice::<message::Reply>(head) {
        let again = serde_json::to_vec(&reply).expect("written");
        serde_json::from_slice::<message::Reply>(&again).expect("it reads back");
    }
    while let Ok(frame) = wire::open(&mut bytes, wire::FrameKind::Reply) {
        let mut plane = [0; 12];
        if frame.payload(&mut bytes, &mut [&mut plane]).is_err() {
            break;
        }
    }
}

fn label(bytes: &[u8]) {
    match labels::read(bytes) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(file) => assert_eq!(labels::read(labels::write(&file).as_bytes()).expect("it reads back"), file),
    }
}

/// Returns the time for this value of the node's monotonic clock.
fn at_ms(steady_ms: u64) -> NodeTime {
    NodeTime { unix_ms: 1_700_000_000_000, steady_ms }
}

const STATE: &str = "spBv1.0/STATE/host";

/// Returns a node after its birth message, with its primary host online.
fn node_after_birth() -> EdgeNode {
    let (group_id, edge_node_id) = ("G".to_owned(), "cell".to_owned());
    let ids = CellIds { group_id, edge_node_id, primary_host_id: Some("host".to_owned()) };
    let mut node = EdgeNode::new(NodeSetup { ids, commands_allowed: true, aliases: true });
    node.step(NodeEvent::Connecting, at_ms(0));
    node.step(NodeEvent::Subscribed, at_ms(0));
    node.step(NodeEvent::Seen(values(&CellView::default())), at_ms(0));
    let online =
        NodeEvent::Received { topic: STATE, payload: br#"{"online":true,"timestamp":1}"#, is_retained: true };
    node.step(online, at_ms(0));
    node
}

/// Passes the bytes to a node after its birth message, as a message of an MQTT broker on each topic, three times within
/// a second. They cause at most one request of each kind, and only a birth message is published. A refused message gets
/// an entry in the audit trail, as long as the limit of entries per minute allows this.
fn node(bytes: &[u8]) {
    let (mut node, ncmd) = (node_after_birth(), "spBv1.0/G/NCMD/cell");
    let mut acts = Vec::new();
    for steady_ms in 1..4 {
        let messages = [(ncmd, false), (ncmd, true), ("strange", false)];
        for (topic, is_retained) in messages {
            acts.extend(node.step(NodeEvent::Received { topic, payload: bytes, is_retained }, at_ms(steady_ms)));
        }
    }
    let asked: Vec<_> = acts.iter().filter(|act| matches!(act, NodeAction::Ask { .. })).collect();
    assert!(asked.iter().enumerate().all(|(place, act)| !asked[..place].contains(act)), "{asked:?}");
    assert!(acts.iter().filter(|act| matches!(act, NodeAction::Publish(_))).count() <= 1);
    let told = commands(bytes, true);
    assert!(!told.is_empty() && told.len() <= 32);
    for error in told.iter().filter_map(|one| one.as_ref().err()) {
        assert!((1..1_200).contains(&error.to_string().len()), "{error}");
    }
    let is_host = HostState::read(bytes).is_some();
    let told = NodeEvent::Received { topic: STATE, payload: bytes, is_retained: false };
    let acts = node_after_birth().step(told, at_ms(5));
    assert_eq!(acts.iter().any(|act| matches!(act, NodeAction::Note(_))), !is_host, "{acts:?}");
}
