//! Organised PLY: all points of the picture row by row, missing ones as NaN or (0, 0, 0).
//!
//! `format ascii` or `binary_little_endian`; the first element is `vertex` with float or double `x y z` (mm,
//! camera's frame) and uchar `red green blue`; other properties and later elements are not used. PLY has no width
//! and height: `comment width W` and `comment height H` state them, otherwise the camera's calibration does.

mod header;
mod mesh;

pub(super) use mesh::{read_ply_mesh, triangulate};

use super::cloud_error::{CloudFileError, check_cloud_size};
use header::{Header, NAMES, NumberType, PropertyOffset, PropertyOffsets};
use panelprep_base::geometry::{Camera, CloudError, OrganizedCloud, PinholeCamera};

/// Reads an organised cloud; `camera` states its size if the file does not.
///
/// # Errors
/// If the bytes are not an organised PLY file with colours, complete to its last point, or its size is not the
/// camera's.
pub fn read_ply(bytes: &[u8], camera: &PinholeCamera) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    read(bytes, Some((camera.width_px, camera.height_px)), Some(camera))
}

/// Reads an organised cloud of any camera; `size_px` is the picture's width and height if the file does not state
/// them.
///
/// # Errors
/// As [`read_ply`], for any size, and if the size is not stated at all.
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

/// Returns the cloud as a binary PLY file with its size in comments; NaN if a point is missing.
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
        // If the last line has no line end, its last digits may be missing.
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
mod tests;
