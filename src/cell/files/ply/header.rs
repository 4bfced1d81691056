//! Parses the header of a PLY file. Only the parts that are used are checked.

use super::super::error::CloudFileError;

/// Maximum length of a header, bytes; real headers have 300 bytes.
const MAX_HEADER_BYTES: usize = 1 << 16;
/// Maximum size of all points, and of one point, bytes. A point may be larger than in a PCD file, because doubles need
/// eight bytes.
const MAX_DATA_BYTES: u64 = 1 << 28;
const MAX_POINT_BYTES: u64 = 128;
/// The vertex properties that are read, in the order of [`PropertyOffsets`].
pub(super) const NAMES: [&str; 6] = ["x", "y", "z", "red", "green", "blue"];

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum NumberType {
    Float,
    Double,
    Byte,
    /// Any other integer type.
    Other {
        bytes: usize,
        is_signed: bool,
    },
}

impl NumberType {
    pub(super) fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "float" | "float32" => NumberType::Float,
            "double" | "float64" => NumberType::Double,
            "uchar" | "uint8" => NumberType::Byte,
            "char" | "int8" => NumberType::Other { bytes: 1, is_signed: true },
            "short" | "int16" => NumberType::Other { bytes: 2, is_signed: true },
            "ushort" | "uint16" => NumberType::Other { bytes: 2, is_signed: false },
            "int" | "int32" => NumberType::Other { bytes: 4, is_signed: true },
            "uint" | "uint32" => NumberType::Other { bytes: 4, is_signed: false },
            _ => return None,
        })
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            NumberType::Byte => 1,
            NumberType::Float => 4,
            NumberType::Double => 8,
            NumberType::Other { bytes, .. } => bytes,
        }
    }

    /// Returns the value of a number in little-endian bytes.
    pub(super) fn value(self, bytes: &[u8]) -> f64 {
        let mut wide = [0; 8];
        wide.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
        let whole = u64::from_le_bytes(wide);
        match self {
            NumberType::Float => f64::from(f32::from_bits(whole as u32)),
            NumberType::Double => f64::from_bits(whole),
            NumberType::Other { bytes, is_signed: true } => {
                let unused_bits = 64 - 8 * bytes as u32;
                ((whole << unused_bits) as i64 >> unused_bits) as f64
            }
            NumberType::Byte | NumberType::Other { .. } => whole as f64,
        }
    }
}

/// The position of one of [`NAMES`] in a vertex: the index in a text line, and the byte offset in a binary file.
#[derive(Clone, Copy)]
pub(super) struct PropertyOffset {
    pub word: usize,
    pub byte: usize,
    pub number: NumberType,
}

pub(super) type PropertyOffsets = [PropertyOffset; 6];

/// An element after the vertices.
pub(super) struct LaterElement {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Vec<String>>,
}

/// The contents of a header. The code that uses the counts checks them.
#[derive(Default)]
pub(super) struct Header {
    pub is_text: bool,
    width: Option<u64>,
    height: Option<u64>,
    pub vertices: u64,
    pub properties: Vec<(String, NumberType)>,
    pub elements: usize,
    /// The elements after the vertices, each with the words of its property lines.
    pub later: Vec<LaterElement>,
    /// The texts of all comments.
    pub comments: Vec<String>,
    pub lines: usize,
    pub bytes: usize,
}

impl Header {
    pub fn parse(bytes: &[u8]) -> Result<Self, CloudFileError> {
        let searched = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
        let mut header = Header::default();
        for line in searched.split_inclusive(|&byte| byte == b'\n') {
            header.lines += 1;
            header.bytes += line.len();
            let line = String::from_utf8_lossy(line);
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            if words == ["end_header"] && line.ends_with('\n') {
                return Ok(header);
            }
            header.parse_line(&words).map_err(|problem| CloudFileError::Header {
                line: header.lines,
                found: line.trim_end().chars().take(80).collect(),
                problem: problem.to_owned(),
            })?;
        }
        Err(CloudFileError::NotACloud { end: "end_header", searched: searched.len() })
    }

    fn parse_line(&mut self, words: &[&str]) -> Result<(), &'static str> {
        let count = |word: &str| word.parse().map_err(|_| "valid: a whole number");
        match *words {
            ["ply"] if self.lines == 1 => {}
            _ if self.lines == 1 => return Err("a PLY file begins with the line ply"),
            ["format", "ascii", "1.0"] if self.lines == 2 => self.is_text = true,
            ["format", "binary_little_endian", "1.0"] if self.lines == 2 => {}
            _ if self.lines == 2 => return Err("valid: format ascii 1.0 or format binary_little_endian 1.0"),
            ["comment", "width", width] => self.width = Some(count(width)?),
            ["comment", "height", height] => self.height = Some(count(height)?),
            ["comment" | "obj_info", ref words @ ..] => self.comments.push(words.join(" ")),
            ["element", name, number] => {
                self.elements += 1;
                match (name, self.elements) {
                    ("vertex", 1) => self.vertices = count(number)?,
                    (_, 1) => return Err("the first element must be vertex"),
                    _ => {
                        let (name, count) = (name.to_owned(), count(number)?);
                        self.later.push(LaterElement { name, count, properties: Vec::new() });
                    }
                }
            }
            ["property", ref words @ ..] if self.elements > 1 => {
                let words = words.iter().map(|word| (*word).to_owned()).collect();
                self.later.last_mut().into_iter().for_each(|element| element.properties.push(Vec::clone(&words)));
            }
            ["property", "list", ..] => return Err("list properties of a vertex are not supported"),
            ["property", kind, name] if self.elements == 1 => {
                let number = NumberType::from_name(kind).ok_or("valid types: char … double and int8 … float64")?;
                if self.properties.iter().any(|(known, _)| known == name) {
                    return Err("this property is defined twice");
                }
                self.properties.push((name.to_owned(), number));
            }
            _ => return Err("valid: comment, element, property and end_header"),
        }
        Ok(())
    }

    pub fn size(&self) -> Result<Option<(u64, u64)>, CloudFileError> {
        let missing = |name| {
            let allowed = "both comment width W and comment height H, or neither of the two";
            Err(CloudFileError::Field { name, found: "none".to_owned(), allowed })
        };
        match (self.width, self.height) {
            (Some(width), Some(height)) => Ok(Some((width, height))),
            (None, None) => Ok(None),
            (None, Some(_)) => missing("comment width"),
            (Some(_), None) => missing("comment height"),
        }
    }

    pub fn point_bytes(&self) -> usize {
        self.properties.iter().map(|(_, number)| number.bytes()).sum()
    }

    pub fn checked_points(&self) -> Result<usize, CloudFileError> {
        let (points, point_bytes) = (self.vertices, self.point_bytes() as u64);
        match points.checked_mul(point_bytes) {
            Some(data_bytes) if data_bytes <= MAX_DATA_BYTES && point_bytes <= MAX_POINT_BYTES => {
                Ok(points as usize)
            }
            _ => Err(CloudFileError::TooLarge {
                points,
                point_bytes,
                limit_bytes: MAX_DATA_BYTES,
                limit_point_bytes: MAX_POINT_BYTES,
            }),
        }
    }

    pub fn property_offsets(&self) -> Result<PropertyOffsets, CloudFileError> {
        let mut places = [PropertyOffset { word: 0, byte: 0, number: NumberType::Byte }; 6];
        for (index, (place, name)) in places.iter_mut().zip(NAMES).enumerate() {
            let allowed =
                if index < 3 { "float or double, in mm" } else { "uchar; export the cloud with its colours" };
            *place = self.property_offset(name, allowed, |number| match number {
                NumberType::Float | NumberType::Double => index < 3,
                NumberType::Byte => index >= 3,
                NumberType::Other { .. } => false,
            })?;
        }
        Ok(places)
    }

    /// Returns the positions of x, y and z, for a file without colours.
    pub fn point_offsets(&self) -> Result<[PropertyOffset; 3], CloudFileError> {
        let is_right = |number| matches!(number, NumberType::Float | NumberType::Double);
        let place = |name| self.property_offset(name, "float or double", is_right);
        Ok([place("x")?, place("y")?, place("z")?])
    }

    fn property_offset(
        &self,
        name: &'static str,
        allowed: &'static str,
        is_right: impl Fn(NumberType) -> bool,
    ) -> Result<PropertyOffset, CloudFileError> {
        let refuse = |found: &str| CloudFileError::Field { name, found: found.to_owned(), allowed };
        let word = self.properties.iter().position(|(known, _)| known == name).ok_or_else(|| refuse("none"))?;
        let number = self.properties[word].1;
        if !is_right(number) {
            return Err(refuse("another type"));
        }
        let byte = self.properties[..word].iter().map(|(_, number)| number.bytes()).sum();
        Ok(PropertyOffset { word, byte, number })
    }
}
