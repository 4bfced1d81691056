use super::*;
use panelprep_base::geometry::Point;
use proptest::prelude::*;

macro_rules! fixture {
    ($name:literal) => {
        include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/pcl/", $name))
    };
}
const BY_PCL: [&[u8]; 3] =
    [fixture!("shot_ascii.pcd"), fixture!("shot_binary.pcd"), fixture!("shot_binary_compressed.pcd")];

/// Returns a PCD text file of 2 × 2 points, with this header and these points.
fn text(fields: &str, size: &str, kind: &str, points: &[&str]) -> String {
    let lines: String = points.iter().map(|point| format!("{point}\n")).collect();
    format!(
        "VERSION 0.7\nFIELDS {fields}\nSIZE {size}\nTYPE {kind}\nWIDTH 2\nHEIGHT 2\nPOINTS 4\nDATA ascii\n{lines}"
    )
}

fn good() -> String {
    text("x y z rgb", "4 4 4 4", "F F F U", &["1 2 3 66051"; 4])
}

/// Reads a cloud with a camera of the size in its header, if the header states a size.
fn read_pcd(bytes: &[u8]) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(400)]).into_owned();
    let stated = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)?.trim().parse().ok()).unwrap_or(2);
    super::read_pcd(bytes, &camera(stated("WIDTH"), stated("HEIGHT")))
}

fn camera(width_px: usize, height_px: usize) -> PinholeCamera {
    let (fx_px, fy_px, cx_px, cy_px) = (2.0, 2.0, 1.0, 1.0);
    let (k1, k2, p1, p2, k3) = (0.0, 0.0, 0.0, 0.0, 0.0);
    PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 }
}

fn refusal(bytes: &[u8]) -> String {
    read_pcd(bytes).expect_err("refused").to_string()
}

fn small_cloud() -> OrganizedCloud<Camera> {
    let points_mm = (0..6).map(|i| [i as f32 + 0.25, -2.5, 700.0 + i as f32]).collect();
    OrganizedCloud::new(3, 2, points_mm, (0..6).map(|i| [i, 200, 255 - i]).collect()).expect("counts agree")
}

/// Expected values, from fixtures/README.md: depth 700 + u + 2v mm, colour (6u, 8v, 200), two missing points.
#[test]
fn files_of_pcl_are_read_exactly_in_all_three_encodings() {
    for bytes in BY_PCL {
        let cloud = read_pcd(bytes).expect("a PCL file");
        assert_eq!((cloud.width(), cloud.height(), cloud.valid_points().count()), (40, 30, 36 * 30 - 4 * 3));
        for (index, point) in cloud.valid_points() {
            let (u, v) = (index % 40, index / 40);
            assert!((point.mm.z - (700 + u + 2 * v) as f64).abs() < 1e-3, "{u},{v}: {point:?}");
        }
        for index in 0..1200 {
            assert_eq!(cloud.color_at(index), [(index % 40 * 6) as u8, (index / 40 * 8) as u8, 200]);
        }
        assert_eq!((cloud.point(3, 7), cloud.point(21, 11)), (None, None));
    }
}

/// A text file has eight digits, so x and y may differ in the last digit. The two binary files are exactly equal.
#[test]
fn the_three_encodings_hold_the_same_cloud() {
    let [ascii, binary, compressed] = BY_PCL.map(|bytes| read_pcd(bytes).expect("a PCL file"));
    let valid = |cloud: &OrganizedCloud<Camera>| cloud.valid_points().collect::<Vec<(usize, Point<Camera>)>>();
    assert_eq!(valid(&binary), valid(&compressed));
    for ((index, a), (other, b)) in valid(&ascii).into_iter().zip(valid(&binary)) {
        assert!(index == other && a.distance_mm(b) < 1e-4, "{a:?} {b:?}");
    }
}

/// Expected values, calculated by hand: 66051 = 0x010203 is red 1, green 2, blue 3; as a float, the same bits are
/// 9.2557e-41.
#[test]
fn colours_come_as_numbers_or_as_packed_floats() {
    let packed = format!("1 2 3 {:e}", f32::from_bits(66_051));
    let as_float = text("x y z rgb", "4 4 4 4", "F F F F", &[packed.as_str(); 4]);
    let as_rgba = good().replace(" rgb", " rgba").replace("66051", "4278256131");
    for file in [good(), as_float, as_rgba] {
        assert_eq!(read_pcd(file.as_bytes()).expect("good").color_at(3), [1, 2, 3], "{file}");
    }
}

#[test]
fn other_fields_and_padding_are_skipped() {
    let points = ["9 1 2 0 0 3 66051 0.5"; 4];
    let file = text("snr x y _ z rgba curvature", "8 4 4 1 4 4 4", "F F F U F U F", &points)
        .replace("WIDTH", "COUNT 1 1 1 2 1 1 1\nWIDTH");
    let cloud = read_pcd(file.as_bytes()).expect("good");
    assert_eq!(cloud.point(1, 1), Some(Point::at(1.0, 2.0, 3.0)));
    assert_eq!(cloud.color_at(0), [1, 2, 3]);
}

#[test]
fn what_is_written_reads_back() {
    let cloud = small_cloud();
    let back = read_pcd(&write_pcd(&cloud)).expect("our own");
    assert_eq!(back.raw_points_mm(), cloud.raw_points_mm());
    assert_eq!(back.picture(), cloud.picture());
}

#[test]
fn each_refusal_names_the_place_what_was_found_and_what_is_allowed() {
    let cases = [
        (
            good().replace("WIDTH 2\nHEIGHT 2", "WIDTH 4\nHEIGHT 1"),
            "not organised (4×1); export it as an ordered cloud",
        ),
        (good().replace("HEIGHT 2", "HEIGHT 3"), "states 4 points for a picture of 2×3"),
        (good().replace("WIDTH 2", "WIDTH two"), "header line 5, 'WIDTH two': invalid digit"),
        (good().replace("F U", "F X"), "header line 4, 'TYPE F F F X': Invalid type character \"X\""),
        (good().replace("F F F", "D F F"), "Invalid type character \"D\""),
        (good().replace("SIZE 4", "SIZE 3"), "size 3 is not supported"),
        (good().replace("SIZE 4", "SIZE 8"), "field x: found x TYPE F, SIZE 8, COUNT 1; valid: TYPE F, SIZE 4"),
        (good().replace("x y z", "x y w"), "field z: found none"),
        (good().replace("z rgb", "z intensity"), "field rgb: found none; valid: one of rgb and rgba"),
        (good().replace("F F F U", "F F F I"), "field rgb: found rgb TYPE I, SIZE 4, COUNT 1"),
        (good().replacen("1 2 3", "1 2,5 3", 1), "line 9: y is '2,5'; valid: a number or nan"),
        (good().replacen("1 2 3 66051\n", "1 2 3\n", 1), "line 9: found 3 numbers, expected 4"),
        (good().replacen("66051", "-1", 1), "line 9: rgb is '-1'; valid: a whole number"),
        (good().replace("F U", "F F"), "line 9: rgb is '66051', which is not a packed float"),
        (good().replace("F U", "F F").replace("66051", "nan"), "line 9: rgb is 'nan', which is not a packed float"),
        (good().replacen("1 2 3 66051\n", "", 1), "4 points were expected, found 3"),
        (good().trim_end().to_owned(), "4 points were expected, found 3"),
        (good() + "1 2 3 4\n", "8 bytes follow the last point"),
        (good().replace("DATA", "DATE"), "neither a PCD nor a PLY"),
        ("\u{fffd}PNG".to_owned(), "neither a PCD nor a PLY"),
    ];
    for (file, expected) in cases {
        let found = refusal(file.as_bytes());
        assert!(found.contains(expected), "{found}\nshould say: {expected}\n{file}");
    }
}

/// A cloud of 3 × 2 points has 96 bytes after its header.
#[test]
fn a_truncated_file_states_how_much_is_missing() {
    let whole = write_pcd(&small_cloud());
    let start = whole.len() - 96;
    let expected = format!("truncated: 96 bytes of points from byte {start} on were expected, found 95");
    assert!(refusal(&whole[..whole.len() - 1]).contains(&expected));
    assert!(refusal(&[&whole[..], &[0, 7]].concat()).contains("2 bytes follow the last point"));
    assert!(read_pcd(&[&whole[..], &[0; 50]].concat()).is_ok(), "PCL fills its files with zeros");
    assert!(refusal(&BY_PCL[2][..10_000]).contains("truncated: 14043 bytes"));
}

/// A header may state any size, so memory is allocated only after the size of the data was checked.
#[test]
fn absurd_sizes_are_refused_at_once() {
    let big = |size: u64| {
        good()
            .replace("WIDTH 2\nHEIGHT 2\nPOINTS 4", &format!("WIDTH {size}\nHEIGHT {size}\nPOINTS {}", size * size))
    };
    assert!(refusal(big(1 << 20).as_bytes()).contains("(limits 64 bytes per point, 268435456 bytes"));
    assert!(refusal(big(u64::from(u32::MAX)).as_bytes()).contains("(limits 64 bytes"));
    assert!(refusal(big(4_000).as_bytes()).contains("16000000 points were expected, found 4"));
    let wide = good().replace("WIDTH", "COUNT 1 1 1 18446744073709551615\nWIDTH");
    assert!(refusal(wide.as_bytes()).contains("points of 18446744073709551615 bytes"));
    let packed = big(4_000).replace("DATA ascii", "DATA binary_compressed");
    let data =
        [&packed.as_bytes()[..packed.find("binary_compressed\n").expect("there") + 18], &[16, 0, 0, 0]].concat();
    let data = [&data[..], &256_000_000_u32.to_le_bytes(), &[0; 16]].concat();
    assert!(refusal(&data).contains("16 packed bytes cannot contain 256000000 unpacked bytes"));
}

#[test]
fn damaged_compressed_data_are_refused() {
    let mut bytes = BY_PCL[2].to_vec();
    bytes[198] = 0xff; // the first packed byte: a reference to before the beginning
    assert!(refusal(&bytes).contains("from byte 190 on cannot be decompressed"), "{}", refusal(&bytes));
    bytes[194] ^= 1;
    assert!(refusal(&bytes).contains("the data state 19201 unpacked bytes, but the points need 19200"));
}

proptest! {
    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..400), head in 0_usize..200) {
        prop_assert!(read_pcd(&bytes).is_err());
        let file = [&good().as_bytes()[..head.min(good().len())], &bytes].concat();
        if let Ok(cloud) = read_pcd(&file) {
            prop_assert_eq!(cloud.raw_points_mm().len(), cloud.width() * cloud.height());
        }
    }

    /// Truncated and corrupted files cause no panic. If such a file can still be read, the cloud has the size in the
    /// header.
    #[test]
    fn damaged_files_cause_no_panic_and_keep_their_size(
        which in 0_usize..4, cut in 0.0..1.2_f64, spoilt in prop::collection::vec((any::<u32>(), any::<u8>(), any::<bool>()), 0..4),
    ) {
        let own = write_pcd(&small_cloud());
        let mut bytes = if which < 3 { BY_PCL[which].to_vec() } else { own };
        let data_start = header(&bytes).expect("good").len();
        bytes.truncate((cut * bytes.len() as f64) as usize);
        for (place, byte, in_header) in spoilt {
            let within = if in_header { data_start.min(bytes.len()) } else { bytes.len() };
            if within > 0 {
                bytes[place as usize % within] = byte;
            }
        }
        if let Ok(cloud) = read_pcd(&bytes) {
            let says = |key: &str| String::from_utf8_lossy(header(&bytes).expect("read")).lines()
                .rev().find_map(|line| line.split('#').next()?.trim().strip_prefix(key)?.trim().parse::<usize>().ok());
            prop_assert_eq!(Some(cloud.width()), says("WIDTH"));
            prop_assert_eq!(Some(cloud.height()), says("HEIGHT"));
        }
    }
}

/// The data state a thousandfold compression. The size in the header is checked before memory is allocated: the data
/// are not compressed at all, so decompression would cause a different error.
#[test]
fn sizes_are_judged_before_points_are_unpacked() {
    let file = |fields: usize, width: usize, height: usize| {
        let names: String = (4..fields).map(|number| format!(" more{number}")).collect();
        let four = |word: &str| vec![word; fields].join(" ");
        let (points, packed) = (width * height, 12_000_000_usize);
        let header = format!(
            "VERSION 0.7\nFIELDS x y z rgb{names}\nSIZE {}\nTYPE {}\nWIDTH {width}\nHEIGHT {height}\nPOINTS {points}\n\
             DATA binary_compressed\n",
            four("4"),
            four("F")
        );
        let lengths = [packed as u32, (points * fields * 4) as u32].map(u32::to_le_bytes).concat();
        [header.into_bytes(), lengths, vec![0xff; packed]].concat()
    };
    let words = |bytes: &[u8]| super::read_pcd(bytes, &camera(1_944, 1_200)).expect_err("refused").to_string();
    let larger = words(&file(4, 4_000, 4_000));
    assert_eq!(larger, "the cloud is 4000×4000 px, but the camera's calibration is for 1944×1200 px");
    let wider = words(&file(100, 1_944, 1_200));
    assert!(wider.contains("2332800 points of 400 bytes (limits 64 bytes per point"), "{wider}");
    assert!(words(&file(4, 1_944, 1_200)).contains("cannot be decompressed"));
}

/// The comment has one line and does not change the cloud that is read back.
#[test]
fn a_comment_states_the_origin() {
    let file = write_pcd_from(&small_cloud(), "the drawing\nof a door");
    assert!(
        file.starts_with(b"# .PCD v0.7 - Point Cloud Data file format\n# the drawing of a door\nVERSION 0.7\n")
    );
    let back = super::read_any_pcd(&file).expect("it reads back");
    assert_eq!(write_pcd(&back), write_pcd(&small_cloud()));
}
