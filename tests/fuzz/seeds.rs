//! Small inputs that each reader accepts: files of the repository, and output of the program.

use super::targets::CAMERA;
use panelprep::devices::zivid::wire;
use panelprep::geometry::ColorPicture;
use panelprep::sparkplug::{Metric, NodeCommand, Payload, WireType};
use panelprep::{files, tape};
use prost::Message as _;
use serde_json::json;
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;
use strum::VariantArray;

fn shipped(name: &str) -> Vec<u8> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    std::fs::read(root.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn texts(texts: &[&str]) -> Vec<Vec<u8>> {
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

/// Returns one message of each kind, and a stream with both kinds.
pub fn messages() -> Vec<Vec<u8>> {
    let state = "<St T=\"1200\" Seq=\"7\" Re=\"3\" Ep=\"2\" Boot=\"77\" Sum=\"-12345\" Mode=\"4\" Flags=\"119\" In=\"5\" Out=\"2\" \
        Done=\"17\" Under=\"0\" Ov=\"100\"><J A1=\"4.9\" A2=\"-90.0\" A3=\"90.0\" A4=\"0.0\" A5=\"45.5\" A6=\"-185.25\"></J><Tcp X=\"100.25\" \
        Y=\"-20.5\" Z=\"300.1\" A=\"90.0\" B=\"0.0\" C=\"-179.9\"></Tcp><Base X=\"400.0\" Y=\"0.0\" Z=\"12.5\" A=\"0.5\" B=\"0.0\" \
        C=\"0.0\"></Base><Tool X=\"0.0\" Y=\"0.0\" Z=\"120.0\" A=\"0.0\" B=\"0.0\" C=\"0.0\"></Tool></St>";
    let ack = "<Ack Rx=\"20\" Done=\"17\" Free=\"97\" Err=\"0\" ErrId=\"0\" Ep=\"2\"></Ack>";
    texts(&[state, ack, &format!("\u{7}{ack}\r\n{state}{ack}"), "<!-- a --><a b='&lt;'/>"])
}

/// Returns the EthernetKRL files of both channels.
pub fn channels() -> Vec<Vec<u8>> {
    ["config/kuka/CELLCMD.xml", "config/kuka/CELLSTAT.xml"].map(shipped).to_vec()
}

/// Returns sessions from the first connection to a path, its end, and a stop, at each speed of the controller.
pub fn sessions() -> Vec<Vec<u8>> {
    // Connect and receive a state. Open an epoch and receive its confirmation; send base, tool, speed and a path;
    // receive states and acknowledgements. Let time pass; stop and receive the state after the stop.
    let state = [3, 200, 0, 0, 0, 0, 0, 0, 0, 0];
    let ack = [6, 0, 0, 0, 0];
    let mut run = vec![0];
    run.extend(state);
    run.extend([8, 0]);
    run.extend(state);
    for command in [[9, 0], [9, 1], [9, 2]] {
        run.extend(command);
    }
    run.extend([9, 6, 20]);
    for _ in 0..8 {
        run.extend(ack);
        run.extend(state);
        run.extend([1, 90, 11]);
    }
    run.extend([9, 69, 1, 14, 6, 14, 0, 13]);
    run.extend(state);
    run.extend([10, 1, 200]);
    run.extend(state);
    run.extend([8, 9]);
    run.extend(state);
    run.extend([1, 255, 1, 255, 15, 0]);
    let lock_step = [&[1][..], &run].concat();
    vec![run, lock_step]
}

/// Returns every kind of line on the socket.
pub fn requests() -> Vec<Vec<u8>> {
    let start = json!({"ask": "start", "recipe": "a.toml", "text": "panel = \"a\"", "record": {"file": "/tmp/a.mcap"},
        "part": {"serial": "SN-7"}, "operator": "Anna"});
    let lines = [
        json!({"ask": "state"}),
        start,
        json!({"ask": "shoot", "shot": {"scan": {}}}),
        json!({"ask": "unhold", "dried": true, "step": 17}),
        json!({"ask": "new_disc"}),
        json!({"ask": "abort"}),
    ];
    lines.iter().map(|line| format!("{line}\n").into_bytes()).collect()
}

/// The sample recipe.
pub fn recipes() -> Vec<Vec<u8>> {
    vec![shipped("config/panels/example.toml")]
}

/// The sample cells.
pub fn cells() -> Vec<Vec<u8>> {
    ["config/cell.toml", "config/cell-example.toml"].map(shipped).to_vec()
}

/// Returns a lens file as its calibration writes it.
pub fn lenses() -> Vec<Vec<u8>> {
    vec![panelprep::cell::Intrinsics::from_camera(CAMERA).to_toml().into_bytes()]
}

/// Returns a mount file, and corrections of each kind.
pub fn mounts() -> Vec<Vec<u8>> {
    let mount = panelprep::cell::MountedPose::<panelprep::cell::ToolMount>::from_pose(Default::default()).to_toml();
    let smooth = "kind = \"smooth\"\nnumbers = [0.0, 0.0, 0.0]\nmiddle_mm = [1.0, 2.0, 3.0]\nhalf_mm = [4.0, 5.0, 6.0]\n\
        left_out_before_mm = 1.0\nleft_out_after_mm = 0.1\n";
    texts(&[&mount, smooth, &smooth.replace("smooth", "geometry")])
}

/// Returns clouds in the three encodings of the Point Cloud Library.
pub fn pcd() -> Vec<Vec<u8>> {
    ["ascii", "binary", "binary_compressed"].map(|kind| shipped(&format!("fixtures/pcl/shot_{kind}.pcd"))).to_vec()
}

/// Returns a square in each mesh format.
pub fn meshes() -> Vec<Vec<u8>> {
    let obj = "# unit mm\no skin\nv 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvn 0 0 1\nf 1/1/1 2//1 3 -1\n";
    let text = "solid skin unit: mm\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 2 0 0\nvertex 2 1 0\nendloop\nendfacet\n\
                endsolid skin\n";
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n2 1 0\n3 0 1 2\n";
    let binary = files::read_mesh(obj.as_bytes()).map(|mesh| files::write_stl(&mesh));
    [obj, text, ply].map(|text| text.as_bytes().to_vec()).into_iter().chain(binary).collect()
}

/// Returns a cloud as Zivid's programs write it, and a cloud as text.
pub fn ply() -> Vec<Vec<u8>> {
    let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 700 9 9 9\nnan nan nan 0 0 0\n";
    let binary =
        files::read_pcd(&shipped("fixtures/pcl/shot_binary.pcd"), &CAMERA).map(|cloud| files::write_ply(&cloud));
    binary.into_iter().chain([text.as_bytes().to_vec()]).collect()
}

/// Returns the list of pictures of a clip.
pub fn clips() -> Vec<Vec<u8>> {
    texts(&["file,time_s,phase\n000.png,0.0,dry\n001.png,0.2,spray\n002.png,0.4,film\n"])
}

fn small_picture() -> ColorPicture {
    let rgb = (0..1_200_u32).map(|index| [index as u8, (index / 40) as u8, 200]).collect();
    ColorPicture { width: 40, height: 30, rgb }
}

/// Returns a picture in each format, in colour and in grey.
pub fn pictures() -> Vec<Vec<u8>> {
    let picture = small_picture();
    let mut tiff = Cursor::new(Vec::new());
    let pixels = picture.rgb.as_flattened();
    let written = image::write_buffer_with_format(
        &mut tiff,
        pixels,
        40,
        30,
        image::ExtendedColorType::Rgb8,
        image::ImageFormat::Tiff,
    );
    written.expect("a picture");
    let color = files::write_color_png(&picture).expect("a picture");
    let gray = files::write_gray_png(&picture.to_gray()).expect("a picture");
    let jpeg = files::write_color_jpeg(&picture).expect("a picture");
    vec![color, gray, jpeg, tiff.into_inner()]
}

/// Returns poses without a name, with a name, and as `locate` prints them.
pub fn poses() -> Vec<Vec<u8>> {
    let pose = json!({"x_mm": 1.0, "y_mm": -2.5, "z_mm": 3e2, "a_deg": 180.0, "b_deg": 0.0, "c_deg": -0.5});
    let located = json!({"verdict": "accept", "base_from_panel": pose, "uncertainty_mm": 0.1});
    let flange = json!({"base_from_flange": pose, "axes_deg": [0.0, -90.0, 90.0, 0.0, 45.0, 0.0]});
    [pose, located, flange].iter().map(|value| value.to_string().into_bytes()).collect()
}

/// Returns recordings without checksums and chunks, because with a checksum every change would be refused.
pub fn recordings() -> Vec<Vec<u8>> {
    let whole = shipped("fixtures/rejected.mcap");
    let checked = tape::check_recording(&whole[..]).expect("a recording of ours");
    let options = mcap::WriteOptions::new()
        .use_chunks(false)
        .calculate_chunk_crcs(false)
        .calculate_data_section_crc(false)
        .calculate_summary_section_crc(false)
        .calculate_attachment_crcs(false)
        .disable_seeking(true);
    let mut out = options.create(mcap::write::NoSeek::new(Vec::new())).expect("memory");
    let metadata = |name: &str, values: &[(&str, String)]| mcap::records::Metadata {
        name: name.to_owned(),
        metadata: values.iter().map(|(key, value)| ((*key).to_owned(), value.clone())).collect(),
    };
    out.write_metadata(&metadata("panelprep", &[("format", tape::FORMAT.to_string())])).expect("memory");
    let start = serde_json::to_vec(&checked.start).expect("JSON");
    out.attach(&mcap::Attachment {
        log_time: 0,
        create_time: 0,
        name: "start.json".to_owned(),
        media_type: "application/json".to_owned(),
        data: Cow::Borrowed(&start),
    })
    .expect("memory");
    let entries = tape::EntryReader::new(&whole[..], checked.start.unix_ns).map_while(Result::ok);
    let entries: Vec<tape::Entry> = entries.filter(|entry| entry.shot.is_none()).take(12).collect();
    let mut channels = BTreeMap::new();
    for (index, entry) in entries.iter().enumerate() {
        let (channel, count) = channels.entry(entry.topic.name()).or_insert_with(|| {
            (out.add_channel(0, entry.topic.name(), "json", &BTreeMap::new()).expect("memory"), 0_u32)
        });
        let body = json!({"said": entry.action, "heard": entry.reply}).to_string();
        let time_ns = checked.start.unix_ns + 1 + index as u64;
        let header = mcap::records::MessageHeader {
            channel_id: *channel,
            sequence: *count,
            log_time: time_ns,
            publish_time: time_ns,
        };
        out.write_to_known_channel(&header, body.as_bytes()).expect("memory");
        *count += 1;
    }
    let counts: BTreeMap<&str, u32> = channels.iter().map(|(name, (_, count))| (*name, *count)).collect();
    let end = [("entries", json!(counts).to_string()), ("lost", "[]".to_owned())];
    out.write_metadata(&metadata("panelprep.end", &end)).expect("memory");
    out.finish().expect("memory");
    let small = out.into_inner().into_inner();
    tape::check_recording(&small[..]).expect("the small one is whole");
    vec![small]
}

/// The shipped settings.
pub fn zivid_settings() -> Vec<Vec<u8>> {
    ["config/zivid/scan.yml", "config/zivid/film.yml"].map(shipped).to_vec()
}

/// Returns the controller's programs, one program for each kind of statement, programs of integrators (`fixtures/krl`),
/// and programs that are too deep or too large for a reader without limits.
pub fn programs() -> Vec<Vec<u8>> {
    let small = "DEF a()\nDECL INT i[3]\nDECL FRAME f\nFOR i[1]=1 TO 3 STEP 1\nIF i[1]==2 THEN\nLIN f C_DIS\nENDIF\nENDFOR\n\
        f={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}\nWAIT FOR $IN[1]\nEND\nDEFFCT REAL g(x:IN)\nREAL x\nRETURN x*2.0+SIN(x)\nENDFCT\n";
    let files = ["cell_config.dat", "cell_judge.src", "cell_link.src", "cell_user.src"];
    let shipped = files.into_iter().map(|name| shipped(&format!("config/kuka/{name}")));
    shipped.chain(texts(&[small])).chain(integrators()).chain(hostile_programs()).collect()
}

fn integrators() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/krl");
    let mut files: Vec<_> =
        std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("it").path()).collect();
    files.sort();
    files.iter().filter(|file| file.is_file()).map(|file| std::fs::read(file).expect("a file")).collect()
}

/// Returns programs that are nested a thousand times deeper than usual, and short enough that a change leaves most of
/// each program intact.
pub fn hostile_programs() -> Vec<Vec<u8>> {
    let body = |lines: &str| format!("DEF a()\nINT i\nBOOL b\ni=0\n{lines}END\n");
    let nested = |open: &str, inside: &str, close: &str, depth: usize| {
        format!("{}{inside}{}", open.repeat(depth), close.repeat(depth))
    };
    let cycle: String = (0..500).map(|n| format!("STRUC s{n} s{} x\n", (n + 1) % 500)).collect();
    let tower: String = (1..40).map(|n| format!("STRUC t{n} t{} x[100]\n", n - 1)).collect();
    let list = |lines: &str| format!("DEFDAT a PUBLIC\n{lines}ENDDAT\n");
    texts(&[
        &body(&nested("IF b THEN\n", "i=1\n", "ENDIF\n", 4_000)),
        &body(&nested("LOOP\n", "", "", 9_000)),
        &body(&nested("SWITCH i\nCASE 1\n", "i=1\n", "ENDSWITCH\n", 2_000)),
        &body(&format!("i={}\n", nested("(", "1", ")", 20_000))),
        &body(&format!("b={}\n", nested("NOT ", "b", "", 10_000))),
        &body(&format!("i={}\n", nested("-", "i", "", 20_000))),
        &body(&format!("i={}\n", nested("{X ", "1", "}", 10_000))),
        &body(&format!("i={}\n", nested("f(", "1", ")", 10_000))),
        &body(&format!("i={}\n", nested("i[", "1", "]", 10_000))),
        &body(&format!("i={}1\n", "1+".repeat(20_000))),
        &body(&"i=i+1\n".repeat(9_000)),
        &list("DECL REAL a[2147483647]\nDECL INT b[60000,60000,60000]\nDECL CHAR c[9000000]\n"),
        &list(&cycle),
        &list(&format!("STRUC t0 INT x\n{tower}DECL t39 big\nDECL t2 all[99]\n")),
        &list(&format!("STRUC wide INT {}\nDECL wide w\n{}", "x,".repeat(5_000) + "y", "w={y 1}\n".repeat(2_000))),
        &list(&format!("ENUM e {}\nDECL e v=#x\n", "x,".repeat(9_000) + "y")),
        &body(&format!("STRUC wide INT {}\nDECL wide w\n{}", "x,".repeat(5_000) + "y", "w={y 1}\n".repeat(2_000))),
        &format!("DEF a()\n{}END\nDEF b({}y)\nINT x,y\nEND\n", "b()\n".repeat(4_000), "x,".repeat(9_000)),
    ])
}

/// Returns an archive with a cell's file and without a seal; the target adds a valid seal to any bytes.
pub fn archives() -> Vec<Vec<u8>> {
    let content = b"panel = 1\n";
    let hash = hexadecimal(content);
    let manifest = json!({"format": 1, "program": "0.1.0", "made_unix_s": 0, "links": null,
        "entries": [{"name": "configuration/cell.toml", "bytes": content.len(), "sha256": hash}]});
    let mut tar = tar::Builder::new(Vec::new());
    for (name, bytes) in [("manifest.json", manifest.to_string().as_bytes()), ("configuration/cell.toml", content)]
    {
        let mut header = tar::Header::new_ustar();
        header.set_size(bytes.len() as u64);
        header.set_mode(0o600);
        header.set_cksum();
        tar.append_data(&mut header, name, bytes).expect("memory");
    }
    let tar = tar.into_inner().expect("memory");
    // The first seed is compressed at level 1. The second is a frame with one raw block, so that the fuzzer's changes
    // reach the tar archive itself.
    let packed = zstd::encode_all(&tar[..], 1).expect("memory");
    vec![packed, raw_frame(&tar)]
}

/// Returns a zstd frame with one raw block: a window of 1 MiB, no checksum.
fn raw_frame(content: &[u8]) -> Vec<u8> {
    let head = ((content.len() as u32) << 3 | 1).to_le_bytes();
    [&0xFD2F_B528_u32.to_le_bytes()[..], &[0, 0x50], &head[..3], content].concat()
}

fn hexadecimal(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns these bytes with the end of an archive: their SHA-256 in a frame that zstd skips.
pub fn sealed(bytes: &[u8]) -> Vec<u8> {
    let hash: [u8; 32] = Sha256::digest(bytes).into();
    [bytes, &0x184D_2A50_u32.to_le_bytes(), &48_u32.to_le_bytes(), b"panelprep seal 1", &hash].concat()
}

/// Returns a frame of the 3D camera's worker process, and headers of other frames.
pub fn frames() -> Vec<Vec<u8>> {
    let mut frame = Vec::new();
    wire::write(&mut frame, (wire::FrameKind::Reply, 7), b"\"clip_begun\"", &[&[1; 12]]).expect("memory");
    let heads = ["{\"begin_clip\":{\"settings\":\"a\",\"pictures_per_second\":5.0}}", "\"clip_begun\""];
    texts(&heads).into_iter().chain([frame]).collect()
}

/// Returns the labels of a clip.
pub fn labels() -> Vec<Vec<u8>> {
    let said = json!({"version": 1, "author": "Anna", "saved_at": "2026-01-01T00:00:00Z", "clip_sha256": "00",
        "size_px": [40, 30], "clean": false,
        "breaks": [{"closes_s": null, "shapes": [{"from_s": 1.5, "corners_px": [[1.0, 2.0], [3.0, 4.0], [5.0, 0.5]]}]}]});
    vec![said.to_string().into_bytes()]
}

/// Returns messages to the office server: two message parts, a record and a state.
pub fn office_parts() -> Vec<Vec<u8>> {
    let hash = "ab".repeat(32);
    let epoch = "0123456789abcdef".repeat(2);
    let end = "{\"cycle\":1,\"ended_unix_s\":2,\"panel\":\"wing\",\"part\":null,\"program_version\":\"0\",\"reasons\":[],\
               \"recipe_hash\":\"ab\",\"started_unix_s\":1,\"taught_version\":\"00\",\"verdict\":\"pass\"}";
    let end_hash = panelprep::files::content_hash(end.as_bytes());
    texts(&[
        &format!("{{\"form\":\"panelprep-part-1\",\"cell\":\"c\",\"file\":\"{hash}\",\"part\":1,\"parts\":1}}\nx"),
        &format!(
            "{{\"form\":\"panelprep-part-1\",\"cell\":\"c\",\"position\":{{\"epoch\":\"{epoch}\",\"number\":1}},\"part\":1,\"parts\":2}}\nx"
        ),
        &format!(
            "{{\"form\":\"panelprep-office-1\",\"cell\":\"c\",\"epoch\":\"{epoch}\",\"number\":1,\"kind\":\"cycle\",\"unix_ms\":1,\
             \"hash\":\"{end_hash}\"}}\n{end}"
        ),
        "{\"form\":\"panelprep-state-1\",\"cell\":\"c\",\"unix_ms\":1,\"version\":\"0\",\"state\":\"idle\",\"phase\":null,\"panel\":null,\
         \"cycle\":null,\"waypoint\":null,\"reasons\":[],\"standing\":[],\"last\":[]}",
    ])
}

pub fn tools() -> Vec<Vec<u8>> {
    texts(&[
        "1040 19.7 17.25 1 0k",
        "1040 -3 0.0 0 9k",
        "1041 1 2 1 0k",
        "1040 1e2 2 1 0k1040 1 2 1 0k",
        "1040 nan 1 1 0k",
    ])
}

/// Returns commands to an edge node of MQTT Sparkplug, and messages of a host about its own state.
pub fn node_commands() -> Vec<Vec<u8>> {
    let metric = |name: Option<&str>, alias, value| Metric {
        name: name.map(str::to_owned),
        alias,
        value,
        ..Metric::default()
    };
    let yes = Some(WireType::Boolean(true));
    let payload = |metrics| Payload { timestamp: Some(1_700_000_000_000), metrics, seq: None }.encode_to_vec();
    let all: Vec<_> =
        NodeCommand::VARIANTS.iter().map(|one| metric(Some(one.name()), one.alias(), yes.clone())).collect();
    vec![
        payload(all),
        payload(vec![metric(None, Some(1_002), yes.clone()), metric(Some("Start"), None, yes)]),
        payload(vec![metric(Some("Node Control/Stop"), None, Some(WireType::Text("now".to_owned())))]),
        b"{\"online\":true,\"timestamp\":1700000000000}".to_vec(),
    ]
}
