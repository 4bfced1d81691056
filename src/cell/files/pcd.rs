//! Organised PCD files, the main format of a 3D shot.
//!
//! WIDTH × HEIGHT points in the camera's frame, mm, row by row: `x y z` of TYPE F SIZE 4 and either `rgb` or `rgba`, a
//! packed 0xAARRGGBB of SIZE 4 and TYPE U or F (a float with the same bits). Other fields and VIEWPOINT are ignored.
//! `ascii`, `binary` and `binary_compressed` files are read; `binary` files are written.
//!
//! The crate `pcd-rs` parses the header, text and LZF. It does not check the header: it allocates the stated size, and
//! uses POINTS even if POINTS differs from WIDTH × HEIGHT. Therefore all sizes are checked here first. Zeros after the
//! last point are accepted, because PCL fills its files up to a memory page. The writer of `pcd-rs` panics if it is
//! dropped too early, so the twelve lines of a binary header are written here.

use super::error::{CloudFileError, check_cloud_size};
use panelprep_base::geometry::{Camera, CloudError, OrganizedCloud, PinholeCamera};
use pcd_rs::{DataKind, FieldDef, PcdDeserialize, PcdMeta, Reader, Schema, ValueKind};
use std::io::{BufRead, Error as IoError, ErrorKind};

/// Maximum length of a header, bytes; real headers have 200 bytes.
const MAX_HEADER_BYTES: usize = 1 << 16;
/// Maximum size of the points, bytes: seven times that of this project's camera, three times that of a camera with five
/// million pixels.
const MAX_DATA_BYTES: u64 = 1 << 28;
/// Maximum size of a point, bytes: x, y, z and colour need 16 bytes; with a normal, curvature and padding 48.
const MAX_POINT_BYTES: u64 = 64;
/// Maximum compression ratio of LZF, which expands 3 bytes to at most 264 bytes.
const MAX_LZF_RATIO: usize = 88;

/// Reads an organised cloud from the camera with this calibration.
///
/// # Errors
/// If the file is not a complete, organised PCD file with colours, or its size is not that of the camera.
pub fn read_pcd(bytes: &[u8], camera: &PinholeCamera) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    read(bytes, Some(camera))
}

/// Reads an organised cloud of any size; the header states the size.
///
/// # Errors
/// The errors of [`read_pcd`], except that any size is accepted.
pub(super) fn read_any_pcd(bytes: &[u8]) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    read(bytes, None)
}

fn read(bytes: &[u8], camera: Option<&PinholeCamera>) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    let header = header(bytes)?;
    let meta = PcdMeta::from_reader(header).map_err(|error| header_error(header, &error))?;
    let (points, point_bytes) = checked_size(&meta)?;
    if let Some(camera) = camera {
        check_cloud_size((meta.width, meta.height), camera)?;
    }
    check_fields(&meta.field_defs)?;
    let data_start = header.len();
    match meta.data {
        DataKind::Ascii => {}
        DataKind::Binary => check_length(bytes, data_start, points * point_bytes)?,
        DataKind::BinaryCompressed => check_compressed(bytes, data_start, points * point_bytes)?,
    }

    let reader = Reader::<ColoredPoint, _>::from_reader(bytes)
        .map_err(|error| CloudFileError::Compressed { start: data_start, problem: error.to_string() })?;
    // In a text file, each number needs at least two bytes, so the allocation is proportional to the size of the file.
    let mut points_mm = Vec::with_capacity(points.min(bytes.len()));
    let mut colors = Vec::with_capacity(points.min(bytes.len()));
    let first_line = 1 + header.iter().filter(|&&byte| byte == b'\n').count();
    for point in reader {
        let point = point.map_err(|error| point_error(&error, first_line, points_mm.len(), points))?;
        points_mm.push(point.mm);
        colors.push(point.rgb);
    }
    if meta.data == DataKind::Ascii {
        check_text_end(&bytes[data_start..], data_start, points)?;
    }
    Ok(OrganizedCloud::new(meta.width as usize, meta.height as usize, points_mm, colors)?)
}

/// Returns the cloud as a binary PCD file like those of PCL; missing points are NaN.
pub fn write_pcd(cloud: &OrganizedCloud<Camera>) -> Vec<u8> {
    write_pcd_from(cloud, "")
}

/// Returns the cloud as in [`write_pcd`], with one comment line that states the origin of the cloud.
pub fn write_pcd_from(cloud: &OrganizedCloud<Camera>, origin: &str) -> Vec<u8> {
    let (width, height) = (cloud.width(), cloud.height());
    let one_line: String = origin.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let comment = if origin.is_empty() { String::new() } else { format!("# {one_line}\n") };
    let mut bytes = format!(
        "# .PCD v0.7 - Point Cloud Data file format\n{comment}VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\n\
         COUNT 1 1 1 1\nWIDTH {width}\nHEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA binary\n",
        width * height
    )
    .into_bytes();
    bytes.reserve_exact(width * height * 16);
    for (index, point_mm) in cloud.raw_points_mm().iter().enumerate() {
        for coordinate_mm in point_mm {
            bytes.extend_from_slice(&coordinate_mm.to_le_bytes());
        }
        let [red, green, blue] = cloud.color_at(index);
        bytes.extend_from_slice(&[blue, green, red, 0]);
    }
    bytes
}

/// Returns the header, up to and including the line `DATA …`.
fn header(bytes: &[u8]) -> Result<&[u8], CloudFileError> {
    let searched = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let mut end = 0;
    for line in searched.split_inclusive(|&byte| byte == b'\n') {
        end += line.len();
        let first_word = line.split(u8::is_ascii_whitespace).find(|word| !word.is_empty());
        if line.ends_with(b"\n") && first_word.is_some_and(|word| word.eq_ignore_ascii_case(b"DATA")) {
            return Ok(&bytes[..end]);
        }
    }
    Err(CloudFileError::NotACloud { end: "DATA …", searched: searched.len() })
}

/// Converts an error of `pcd-rs`, which names at most a key, into an error with the line of the header.
fn header_error(header: &[u8], error: &pcd_rs::Error) -> CloudFileError {
    let problem = match error {
        pcd_rs::Error::ParseError { desc, .. } => desc.clone(),
        other => other.to_string(),
    };
    let text = String::from_utf8_lossy(header);
    let lines: Vec<&str> = text.lines().collect();
    let named = |word: &str| {
        let word = word.to_ascii_uppercase();
        lines.iter().position(|line| word.len() >= 4 && line.starts_with(&word))
    };
    let is_not_a_number = |line: &str| {
        let mut words = line.split_ascii_whitespace();
        let allowed: fn(&str) -> bool = match words.next() {
            Some("SIZE" | "COUNT" | "WIDTH" | "HEIGHT" | "POINTS") => |word| word.parse::<u64>().is_ok(),
            Some("VIEWPOINT") => |word| word.parse::<f64>().is_ok(),
            _ => |_| true,
        };
        !words.all(allowed)
    };
    let place = problem.split(' ').find_map(named);
    let place = place.or_else(|| lines.iter().position(|line| is_not_a_number(line)));
    let index = place.unwrap_or(lines.len().saturating_sub(1));
    let found = lines.get(index).map_or(String::new(), |line| line.chars().take(80).collect());
    CloudFileError::Header { line: index + 1, found, problem }
}

/// Checks that the header is consistent, and returns the number of points and the size of a point in bytes.
fn checked_size(meta: &PcdMeta) -> Result<(usize, usize), CloudFileError> {
    let (width, height, points) = (meta.width, meta.height, meta.num_points);
    if width < 2 || height < 2 {
        return Err(CloudError::NotOrganized { width: width as usize, height: height as usize }.into());
    }
    if width.checked_mul(height) != Some(points) {
        return Err(CloudFileError::Count { points, width, height });
    }
    let field_bytes = |field: &FieldDef| (field.kind.byte_size() as u64).saturating_mul(field.count);
    let point_bytes = meta.field_defs.iter().map(field_bytes).fold(0, u64::saturating_add);
    match points.checked_mul(point_bytes) {
        Some(data_bytes) if data_bytes <= MAX_DATA_BYTES && point_bytes <= MAX_POINT_BYTES => {
            Ok((points as usize, point_bytes as usize))
        }
        _ => Err(CloudFileError::TooLarge {
            points,
            point_bytes,
            limit_bytes: MAX_DATA_BYTES,
            limit_point_bytes: MAX_POINT_BYTES,
        }),
    }
}

/// Returns the letter of TYPE in a header.
fn type_letter(kind: ValueKind) -> char {
    match kind {
        ValueKind::F32 | ValueKind::F64 => 'F',
        ValueKind::U8 | ValueKind::U16 | ValueKind::U32 | ValueKind::U64 => 'U',
        ValueKind::I8 | ValueKind::I16 | ValueKind::I32 | ValueKind::I64 => 'I',
    }
}

fn check_fields(fields: &Schema) -> Result<(), CloudFileError> {
    let described = |field: &FieldDef| {
        let (kind, bytes) = (type_letter(field.kind), field.kind.byte_size());
        format!("{} TYPE {kind}, SIZE {bytes}, COUNT {}", field.name, field.count)
    };
    for name in ["x", "y", "z"] {
        let field = fields.iter().find(|field| field.name == name);
        if !field.is_some_and(|field| field.kind == ValueKind::F32 && field.count == 1) {
            let found = field.map_or("none".to_owned(), described);
            return Err(CloudFileError::Field { name, found, allowed: "TYPE F, SIZE 4, COUNT 1, in mm" });
        }
    }
    let colors: Vec<&FieldDef> = fields.iter().filter(|field| is_color(&field.name)).collect();
    match colors[..] {
        [FieldDef { kind: ValueKind::F32 | ValueKind::U32, count: 1, .. }] => Ok(()),
        _ => Err(CloudFileError::Field {
            name: "rgb",
            found: if colors.is_empty() {
                "none".to_owned()
            } else {
                colors.into_iter().map(described).collect::<Vec<_>>().join(" and ")
            },
            allowed: "one of rgb and rgba, TYPE U or F, SIZE 4, COUNT 1; export the cloud with its colours",
        }),
    }
}

fn is_color(name: &str) -> bool {
    name == "rgb" || name == "rgba"
}

fn check_length(bytes: &[u8], start: usize, needed: usize) -> Result<(), CloudFileError> {
    let data = &bytes[start..];
    let Some(rest) = data.get(needed..) else {
        return Err(CloudFileError::Truncated { start, needed, found: data.len() });
    };
    match rest.iter().all(|&byte| byte == 0) {
        true => Ok(()),
        false => Err(CloudFileError::Trailing { start: start + needed, found: rest.len() }),
    }
}

/// Checks the two sizes at the beginning of compressed data: compressed and decompressed.
fn check_compressed(bytes: &[u8], start: usize, unpacked_needed: usize) -> Result<(), CloudFileError> {
    let data = &bytes[start..];
    let Some((&[p0, p1, p2, p3, u0, u1, u2, u3], _)) = data.split_first_chunk() else {
        return Err(CloudFileError::Truncated { start, needed: 8, found: data.len() });
    };
    let packed = u32::from_le_bytes([p0, p1, p2, p3]) as usize;
    let unpacked = u32::from_le_bytes([u0, u1, u2, u3]) as usize;
    check_length(bytes, start + 8, packed)?;
    let problem = if unpacked != unpacked_needed {
        format!("the data state {unpacked} unpacked bytes, but the points need {unpacked_needed}")
    } else if unpacked > packed.saturating_mul(MAX_LZF_RATIO) {
        format!("{packed} packed bytes cannot contain {unpacked} unpacked bytes")
    } else {
        return Ok(());
    };
    Err(CloudFileError::Compressed { start, problem })
}

fn check_text_end(data: &[u8], data_start: usize, points: usize) -> Result<(), CloudFileError> {
    let used: usize = data.split_inclusive(|&byte| byte == b'\n').take(points).map(<[u8]>::len).sum();
    if !data[..used].ends_with(b"\n") {
        // The last digits of the last number may be missing.
        return Err(CloudFileError::TooFewLines { needed: points, found: points - 1 });
    }
    match data[used..].iter().all(|byte| byte.is_ascii_whitespace() || *byte == 0) {
        true => Ok(()),
        false => Err(CloudFileError::Trailing { start: data_start + used, found: data.len() - used }),
    }
}

fn point_error(error: &pcd_rs::Error, first_line: usize, index: usize, points: usize) -> CloudFileError {
    let problem = match error {
        pcd_rs::Error::IoError(io) if io.kind() == ErrorKind::UnexpectedEof => {
            return CloudFileError::TooFewLines { needed: points, found: index };
        }
        pcd_rs::Error::TextTokenMismatchError { expect, found } => {
            format!("found {found} numbers, expected {expect}, one for each of FIELDS")
        }
        pcd_rs::Error::InvalidArgumentError { desc } => desc.clone(),
        other => other.to_string(),
    };
    CloudFileError::Point { line: first_line + index, problem }
}

/// A point of a file whose fields were checked.
struct ColoredPoint {
    mm: [f32; 3],
    rgb: [u8; 3],
}

impl ColoredPoint {
    /// Parses position and colour from a record; `bits` returns the four bytes of a field.
    fn parse_fields(
        fields: &Schema,
        place_after: impl Fn(usize, &FieldDef) -> usize,
        bits: impl Fn(usize, ValueKind, &str) -> pcd_rs::Result<u32>,
    ) -> pcd_rs::Result<Self> {
        let mut point = ColoredPoint { mm: [f32::NAN; 3], rgb: [0; 3] };
        let mut place = 0;
        for field in fields {
            let read = || bits(place, field.kind, &field.name);
            match field.name.as_str() {
                "x" => point.mm[0] = f32::from_bits(read()?),
                "y" => point.mm[1] = f32::from_bits(read()?),
                "z" => point.mm[2] = f32::from_bits(read()?),
                name if is_color(name) => {
                    let [blue, green, red, _] = read()?.to_le_bytes();
                    point.rgb = [red, green, blue];
                }
                _ => {}
            }
            place = place_after(place, field);
        }
        Ok(point)
    }
}

impl PcdDeserialize for ColoredPoint {
    // No check by `pcd-rs` is needed: the fields were checked by name.
    fn is_dynamic() -> bool {
        true
    }

    fn read_spec() -> Vec<(Option<String>, ValueKind, Option<usize>)> {
        Vec::new()
    }

    fn read_chunk<R: BufRead>(reader: &mut R, fields: &Schema) -> pcd_rs::Result<Self> {
        let after = |place: usize, field: &FieldDef| place + field.kind.byte_size() * field.count as usize;
        let record_bytes = fields.iter().fold(0, after);
        // The data are in memory, so the buffer contains all remaining bytes.
        let record = reader.fill_buf()?.get(..record_bytes).ok_or(IoError::from(ErrorKind::UnexpectedEof))?;
        let point = Self::parse_fields(fields, after, |place, _, _| {
            let bytes = record[place..].first_chunk().ok_or(IoError::from(ErrorKind::UnexpectedEof))?;
            Ok(u32::from_le_bytes(*bytes))
        })?;
        reader.consume(record_bytes);
        Ok(point)
    }

    fn read_line<R: BufRead>(reader: &mut R, fields: &Schema) -> pcd_rs::Result<Self> {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 {
            return Err(IoError::from(ErrorKind::UnexpectedEof).into());
        }
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let after = |place: usize, field: &FieldDef| place + field.count as usize;
        let expect = fields.iter().fold(0, after);
        if words.len() != expect {
            return Err(pcd_rs::Error::TextTokenMismatchError { expect, found: words.len() });
        }
        Self::parse_fields(fields, after, |place, kind, name| number_bits(words[place], kind, name))
    }
}

/// Parses a number of a text file and returns its four bytes.
fn number_bits(word: &str, kind: ValueKind, name: &str) -> pcd_rs::Result<u32> {
    let number = match kind {
        ValueKind::U32 => word.parse::<u32>().ok(),
        // A colour with alpha 255 that is packed as a float is written as nan in a text file. A whole number other than
        // 0 is never a packed float.
        _ if is_color(name) && word != "0" && word.bytes().all(|byte| byte.is_ascii_digit()) => None,
        _ => word.parse::<f32>().ok().filter(|number| !(is_color(name) && number.is_nan())).map(f32::to_bits),
    };
    number.ok_or_else(|| pcd_rs::Error::InvalidArgumentError {
        desc: match (kind, is_color(name)) {
            (ValueKind::U32, _) => format!("{name} is '{word}'; valid: a whole number from 0 to 4294967295"),
            (_, true) => format!("{name} is '{word}', which is not a packed float; write {name} with TYPE U"),
            (_, false) => format!("{name} is '{word}'; valid: a number or nan"),
        },
    })
}

#[cfg(test)]
mod tests;
