use super::*;
use panelprep_base::geometry::Point;
use proptest::prelude::*;

const CAMERA: PinholeCamera = PinholeCamera {
    width_px: 2,
    height_px: 2,
    fx_px: 2.0,
    fy_px: 2.0,
    cx_px: 1.0,
    cy_px: 1.0,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

fn good() -> String {
    "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\n\
     property double z\nproperty uchar red\nproperty uint8 green\nproperty uchar blue\nproperty int label\n\
     end_header\n1 2 3 4 5 6 -7\n1 2 3 4 5 6 7\nnan nan nan 4 5 6 7\n0 0 0 4 5 6 7\n"
        .to_owned()
}

fn small_cloud() -> OrganizedCloud<Camera> {
    let points_mm = (0..6).map(|i| if i == 4 { [f32::NAN; 3] } else { [i as f32 + 0.25, -2.5, 700.0] }).collect();
    OrganizedCloud::new(3, 2, points_mm, (0..6).map(|i| [i, 200, 255 - i]).collect()).expect("counts agree")
}

#[test]
fn text_with_the_size_from_the_camera() {
    let cloud = read_ply(good().as_bytes(), &CAMERA).expect("good");
    assert_eq!((cloud.width(), cloud.height(), cloud.valid_points().count()), (2, 2, 2));
    assert_eq!(cloud.point(1, 0), Some(Point::at(1.0, 2.0, 3.0)));
    assert_eq!(cloud.color_at(3), [4, 5, 6]);
}

#[test]
fn what_is_written_reads_back_with_its_own_size() {
    let cloud = small_cloud();
    let back = read_ply(&write_ply(&cloud), &PinholeCamera { width_px: 3, ..CAMERA }).expect("our own");
    assert_eq!((back.width(), back.height()), (3, 2));
    assert!(back.valid_points().eq(cloud.valid_points()) && back.picture() == cloud.picture());
}

/// By hand: one vertex is double x y z, then a float that is skipped, then the colour: 31 bytes.
#[test]
fn binary_with_doubles_and_more_elements() {
    let mut file = "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty double x\nproperty double y\n\
         property double z\nproperty float snr\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face 0\nproperty list uchar int vertex_indices\nend_header\n"
        .as_bytes()
        .to_vec();
    for index in 0..4_u8 {
        for coordinate in [f64::from(index), 2.0, 700.5] {
            file.extend(coordinate.to_le_bytes());
        }
        file.extend(9.0_f32.to_le_bytes());
        file.extend([index, 20, 30]);
    }
    let cloud = read_ply(&file, &CAMERA).expect("good");
    assert_eq!(cloud.point(1, 1), Some(Point::at(3.0, 2.0, 700.5)));
    assert_eq!(cloud.color_at(2), [2, 20, 30]);
    let error = read_ply(&file[..file.len() - 1], &CAMERA).expect_err("cut").to_string();
    assert!(error.contains("124 bytes of points") && error.contains("found 123"), "{error}");
}

#[test]
fn each_refusal_names_the_place_what_was_found_and_what_is_allowed() {
    let cases = [
        (good().replace("vertex 4", "vertex 3"), "states 3 points for a picture of 2×2; export an ordered cloud"),
        (good().replace("made by hand", "width 4\ncomment height 1"), "not organised (4×1)"),
        (good().replace("made by hand", "width 2"), "field comment height: found none"),
        (good().replace("made by hand", "width 2x"), "line 3, 'comment width 2x': valid: a whole number"),
        (good().replace("ascii", "binary_big_endian"), "line 2, 'format binary_big_endian 1.0': valid:"),
        (good().replace("vertex 4", "vertex -4"), "line 4, 'element vertex -4': valid: a whole number"),
        (good().replace("vertex 4", "face 4"), "the first element must be vertex"),
        (good().replace("float y", "float x"), "line 6, 'property float x': this property is defined twice"),
        (good().replace("float y", "real y"), "line 6, 'property real y': valid types"),
        (good().replace("float y", "list uchar int y"), "list properties of a vertex are not supported"),
        (good().replace("float y", "int y"), "field y: found another type; valid: float or double"),
        (good().replace("uchar blue", "float blue"), "field blue: found another type; valid: uchar"),
        (good().replace("uchar red", "uchar alpha"), "field red: found none; valid: uchar; export"),
        (good().replacen("1 2 3 4 5 6 7", "1 2 3 4 5 6", 1), "line 14: found 6 numbers, expected 7"),
        (good().replacen("1 2 3", "1 2 z", 1), "line 13: z is 'z'; valid: a number or nan"),
        (good().replacen("4 5 6 7", "4 256 6 7", 1), "line 14: green is '256'; valid: 0 to 255"),
        (good().trim_end().to_owned(), "4 points were expected, found 3"),
        (good() + "1\n", "2 bytes follow the last point"),
        (good().replace("end_header", ""), "valid: comment, element"),
        ("ply\nformat ascii 1.0\n".to_owned(), "it has no header that ends in a line 'end_header'"),
        (
            good().replace("vertex 4", "vertex 6").replace("made by hand", "width 3\ncomment height 2"),
            "the cloud is 3×2 px, but the camera's calibration is for 2×2 px",
        ),
        (
            good()
                .replace("vertex 4", "vertex 64000000")
                .replace("made by hand", "width 8000\ncomment height 8000"),
            "64000000 points of 23 bytes (limits 128 bytes per point, 268435456",
        ),
    ];
    for (file, expected) in cases {
        let found = read_ply(file.as_bytes(), &CAMERA).expect_err("refused").to_string();
        assert!(found.contains(expected), "{found}\nshould say: {expected}");
    }
}

proptest! {
    #[test]
    fn spoilt_files_never_panic_and_never_change_their_size(
        text in any::<bool>(), cut in 0.0..1.2_f64, spoilt in prop::collection::vec((any::<u16>(), any::<u8>()), 0..4),
    ) {
        let mut bytes = if text { good().into_bytes() } else { write_ply(&small_cloud()) };
        bytes.truncate((cut * bytes.len() as f64) as usize);
        for (place, byte) in spoilt {
            if !bytes.is_empty() {
                let place = usize::from(place) % bytes.len();
                bytes[place] = byte;
            }
        }
        let camera = PinholeCamera { width_px: if text { 2 } else { 3 }, ..CAMERA };
        if let Ok(cloud) = read_ply(&bytes, &camera) {
            let header = Header::parse(&bytes).expect("it was read");
            prop_assert_eq!((cloud.width() * cloud.height()) as u64, header.vertices);
        }
    }

    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), head in 0_usize..300) {
        let file = [&good().as_bytes()[..head.min(good().len())], &bytes].concat();
        let _ = read_ply(&file, &CAMERA);
        prop_assert!(read_ply(&bytes, &CAMERA).is_err());
    }
}
