//! Organised PLY files: all points of the picture row by row; a missing point is NaN or (0, 0, 0).
//!
//! `format ascii` or `binary_little_endian`. The first element is `vertex` with float or double `x y z` (mm, in the
//! camera's frame) and uchar `red green blue`; other properties and further elements are ignored. PLY has no width and
//! height: they are stated by `comment width W` and `comment height H`, or else by the camera's calibration.

mod header;
mod mesh;

pub(super) use mesh::{read_ply_mesh, triangulate};

use super::error::{CloudFileError, check_cloud_size};
use header::{Header, NAMES, NumberType, PropertyOffset, PropertyOffsets};
use panelprep_base::geometry::{Camera, CloudError, OrganizedCloud, PinholeCamera};

/// Reads an organised cloud; the size is that of `camera` if the file does not state its size.
///
/// # Errors
/// If the file is not a complete, organised PLY file with colours, or its size is not that of the camera.
pub fn read_ply(bytes: &[u8], camera: &PinholeCamera) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    read(bytes, Some((camera.width_px, camera.height_px)), Some(camera))
}

/// Reads an organised cloud of any size; the size is `size_px` if the file does not state its size.
///
/// # Errors
/// The errors of [`read_ply`], except that any size is accepted; or if the size is not stated at all.
pub(super) fn read_any_ply(
    bytes: &[u8],
    size_px: Option<(usize, usize)>,
) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    read(bytes, size_px, None)
}

fn read(
    bytes: &[u8],
    size_px: Option<(usize, usize)>,
    camera: Option<&PinholeCamera>,
) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    let header = Header::parse(bytes)?;
    let known = size_px.map(|(width, height)| (width as u64, height as u64));
    let (width, height) = header.size()?.or(known).ok_or(CloudFileError::NoSize)?;
    if width < 2 || height < 2 {
        return Err(CloudError::NotOrganized { width: width as usize, height: height as usize }.into());
    }
    if width.checked_mul(height) != Some(header.vertices) {
        return Err(CloudFileError::Count { points: header.vertices, width, height });
    }
    let places = header.property_offsets()?;
    let points = header.checked_points()?;
    if let Some(camera) = camera {
        check_cloud_size((width, height), camera)?;
    }
    let (points_mm, colors) = match header.is_text {
        true => read_text(bytes, &header, points, &places)?,
        false => read_binary(bytes, &header, points, &places)?,
    };
    Ok(OrganizedCloud::new(width as usize, height as usize, points_mm, colors)?)
}

/// Returns the cloud as a binary PLY file with its size in comments; missing points are NaN.
pub fn write_ply(cloud: &OrganizedCloud<Camera>) -> Vec<u8> {
    let (width, height) = (cloud.width(), cloud.height());
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment width {width}\ncomment height {height}\n\
         element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        width * height
    )
    .into_bytes();
    bytes.reserve_exact(width * height * 15);
    for (index, point_mm) in cloud.raw_points_mm().iter().enumerate() {
        for coordinate_mm in point_mm {
            bytes.extend_from_slice(&coordinate_mm.to_le_bytes());
        }
        bytes.extend_from_slice(&cloud.color_at(index));
    }
    bytes
}

type PointsAndColors = (Vec<[f32; 3]>, Vec<[u8; 3]>);

fn read_binary(
    bytes: &[u8],
    header: &Header,
    points: usize,
    places: &PropertyOffsets,
) -> Result<PointsAndColors, CloudFileError> {
    let (start, point_bytes) = (header.bytes, header.point_bytes());
    let (needed, found) = (points * point_bytes, bytes.len() - start);
    let Some(data) = bytes.get(start..start + needed) else {
        return Err(CloudFileError::Truncated { start, needed, found });
    };
    if header.elements == 1 && found > needed {
        return Err(CloudFileError::Trailing { start: start + needed, found: found - needed });
    }
    let [x, y, z, red, green, blue] = *places;
    let point = |record: &[u8]| [x, y, z].map(|place| float_at(record, place));
    let color = |record: &[u8]| [red, green, blue].map(|place| record[place.byte]);
    let records = || data.chunks_exact(point_bytes);
    Ok((records().map(point).collect(), records().map(color).collect()))
}

fn float_at(record: &[u8], place: PropertyOffset) -> f32 {
    let rest = &record[place.byte..];
    match (place.number, rest.first_chunk(), rest.first_chunk()) {
        (NumberType::Float, Some(bytes), _) => f32::from_le_bytes(*bytes),
        (NumberType::Double, _, Some(bytes)) => f64::from_le_bytes(*bytes) as f32,
        _ => f32::NAN,
    }
}

fn read_text(
    bytes: &[u8],
    header: &Header,
    points: usize,
    places: &PropertyOffsets,
) -> Result<PointsAndColors, CloudFileError> {
    let data = &bytes[header.bytes..];
    let (mut points_mm, mut colors) = (Vec::new(), Vec::new());
    let mut used = 0;
    for line in data.split_inclusive(|&byte| byte == b'\n').take(points) {
        // Without a line end, the last digits of the last line may be missing.
        if !line.ends_with(b"\n") {
            break;
        }
        used += line.len();
        let refuse = |problem| CloudFileError::Point { line: header.lines + points_mm.len() + 1, problem };
        let line = std::str::from_utf8(line).map_err(|_| refuse("the line is not UTF-8 text".to_owned()))?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        if words.len() != header.properties.len() {
            let (found, allowed) = (words.len(), header.properties.len());
            return Err(refuse(format!("found {found} numbers, expected {allowed}, one for each property")));
        }
        let (mut point, mut color) = ([f32::NAN; 3], [0; 3]);
        for (index, (place, name)) in places.iter().zip(NAMES).enumerate() {
            let word = words[place.word];
            match index {
                0..3 => {
                    let number = word.parse();
                    point[index] =
                        number.map_err(|_| refuse(format!("{name} is '{word}'; valid: a number or nan")))?;
                }
                _ => {
                    let number = word.parse();
                    color[index - 3] =
                        number.map_err(|_| refuse(format!("{name} is '{word}'; valid: 0 to 255")))?;
                }
            }
        }
        points_mm.push(point);
        colors.push(color);
    }
    if points_mm.len() != points {
        return Err(CloudFileError::TooFewLines { needed: points, found: points_mm.len() });
    }
    if header.elements == 1 && !data[used..].iter().all(u8::is_ascii_whitespace) {
        return Err(CloudFileError::Trailing { start: header.bytes + used, found: data.len() - used });
    }
    Ok((points_mm, colors))
}

#[cfg(test)]
mod tests {
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
        let points_mm =
            (0..6).map(|i| if i == 4 { [f32::NAN; 3] } else { [i as f32 + 0.25, -2.5, 700.0] }).collect();
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

    /// Expected size of a vertex, calculated by hand: double x y z, a float that is skipped, and the colour are 31
    /// bytes.
    #[test]
    fn binary_with_doubles_and_more_elements() {
        let mut file =
            "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty double x\nproperty double y\n\
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
            (
                good().replace("vertex 4", "vertex 3"),
                "states 3 points for a picture of 2×2; export an ordered cloud",
            ),
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
        fn damaged_files_cause_no_panic_and_keep_their_size(
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
}
