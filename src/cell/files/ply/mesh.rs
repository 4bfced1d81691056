//! Reads the mesh of a PLY file: `vertex` with float or double `x y z`, and `face` with exactly one list, the vertex
//! indices. Other properties and elements are ignored. `ascii` or `binary_little_endian`.

use super::super::error::{MAX_TRIANGLES, MeshFileError};
use super::header::{Header, LaterElement, NumberType};
use nalgebra::{Point3, Vector3};
use panelprep_base::geometry::{LengthUnit, TriangleMesh};

/// Maximum number of corners of a face.
const MAX_CORNERS: usize = 64;
/// Minimum cosine of the angle between the normals of a face's triangles; below it, the face is not convex.
const MIN_NORMAL_COSINE: f64 = 0.9;
/// Maximum distance of a corner from the plane of its face, relative to the face's size. Two triangulations of a face
/// differ by at most twice this distance, 0.2 mm on a face of 200 mm.
const MAX_RELATIVE_PLANE_DISTANCE: f64 = 5e-4;

/// Divides a face into triangles from its first corner. `None` if the number of corners is invalid, or if the face is
/// not planar and convex, so that the triangulation would be ambiguous.
pub(in crate::files) fn triangulate(vertices: &[[f64; 3]], corners: &[u32]) -> Option<Vec<[u32; 3]>> {
    if !(3..=MAX_CORNERS).contains(&corners.len()) {
        return None;
    }
    let triangles: Vec<[u32; 3]> = corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]).collect();
    if corners.len() > 3 {
        let at = |corner: u32| Point3::from(vertices[corner as usize]);
        let normals: Vec<Vector3<f64>> = triangles
            .iter()
            .map(|&[a, b, c]| (at(b) - at(a)).cross(&(at(c) - at(a))))
            .filter(|normal| normal.norm() > 0.0)
            .collect();
        let sum: Vector3<f64> = normals.iter().sum();
        if normals.iter().any(|normal| normal.dot(&sum) < MIN_NORMAL_COSINE * normal.norm() * sum.norm()) {
            return None;
        }
        let size = corners.iter().map(|&corner| (at(corner) - at(corners[0])).norm()).fold(0.0, f64::max);
        let off_plane = |corner: &u32| (at(*corner) - at(corners[0])).dot(&sum).abs() / sum.norm();
        if sum.norm() > 0.0
            && corners.iter().map(off_plane).fold(0.0, f64::max) > MAX_RELATIVE_PLANE_DISTANCE * size
        {
            return None;
        }
    }
    Some(triangles)
}

/// A property of a face.
enum FaceProperty {
    /// The list of vertex indices: the number types of its length and of its items.
    Corners(NumberType, NumberType),
    /// A number that is ignored.
    Other(NumberType),
}

/// Reads the mesh of a PLY file.
pub(in crate::files) fn read_ply_mesh(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
    let header = Header::parse(bytes)?;
    let vertices = header.checked_points()?;
    let places = header.point_offsets()?;
    let line = header.lines;
    let mut mesh = TriangleMesh::default();
    for comment in &header.comments {
        let unit = LengthUnit::from_comment(comment).map_err(|found| MeshFileError::UnknownUnit { found })?;
        if let (Some(first), Some(second)) = (mesh.unit, unit)
            && first != second
        {
            return Err(MeshFileError::TwoUnits { first: first.abbreviation(), second: second.abbreviation() });
        }
        mesh.unit = mesh.unit.or(unit);
    }
    let Some(element) = header.later.first() else { return Err(MeshFileError::Empty) };
    if element.name != "face" {
        let problem = format!("the second element is {}, expected 'face'", element.name);
        return Err(MeshFileError::Line { line, problem });
    }
    if element.count > MAX_TRIANGLES as u64 {
        return Err(MeshFileError::TooMany { found: element.count });
    }
    let properties = face_properties(element).map_err(|problem| MeshFileError::Line { line, problem })?;
    let mut source = match header.is_text {
        true => Source::Text { rest: &bytes[header.bytes..], line },
        false => Source::Binary { rest: &bytes[header.bytes..] },
    };
    for index in 0..vertices {
        let mut values = source.record("vertex", index)?;
        let mut point = [f64::NAN; 3];
        for (property, (_, number)) in header.properties.iter().enumerate() {
            let value = values.next(*number)?;
            if let Some(axis) = places.iter().position(|place| place.word == property) {
                point[axis] = value;
            }
        }
        values.end()?;
        if !point.iter().all(|number| number.is_finite()) {
            return Err(values.value_error("a coordinate is infinite or not a number"));
        }
        mesh.vertices.push(point);
    }
    let mut corners = Vec::new();
    for index in 0..element.count as usize {
        let mut values = source.record("face", index)?;
        corners.clear();
        for property in &properties {
            match *property {
                FaceProperty::Other(number) => _ = values.next(number)?,
                FaceProperty::Corners(count, item) => {
                    let count = values.next(count)?;
                    if !(3.0..=MAX_CORNERS as f64).contains(&count) || count.fract() != 0.0 {
                        return Err(
                            values.value_error(&format!("a face of {count} corners; valid: 3 to {MAX_CORNERS}"))
                        );
                    }
                    for _ in 0..count as usize {
                        let corner = values.next(item)?;
                        if !(0.0..vertices as f64).contains(&corner) || corner.fract() != 0.0 {
                            return Err(values.value_error(&format!(
                                "vertex {corner} does not exist; the file has {vertices} vertices"
                            )));
                        }
                        corners.push(corner as u32);
                    }
                }
            }
        }
        values.end()?;
        let not_convex = MeshFileError::NotConvex { line: values.number, corners: corners.len() };
        mesh.triangles.extend(triangulate(&mesh.vertices, &corners).ok_or(not_convex)?);
        if mesh.triangles.len() > MAX_TRIANGLES {
            return Err(MeshFileError::TooMany { found: mesh.triangles.len() as u64 });
        }
    }
    if header.later.len() == 1 {
        source.end()?;
    }
    Ok(mesh)
}

fn face_properties(element: &LaterElement) -> Result<Vec<FaceProperty>, String> {
    let number =
        |word: &str| NumberType::from_name(word).ok_or_else(|| format!("'{word}' is not a number type of PLY"));
    let property = |words: &Vec<String>| match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["list", count, item, "vertex_indices" | "vertex_index"] => {
            Ok(FaceProperty::Corners(number(count)?, number(item)?))
        }
        ["list", _, _, name] => {
            Err(format!("the list property '{name}' of the faces is not supported; export the mesh without it"))
        }
        [kind, _] => Ok(FaceProperty::Other(number(kind)?)),
        _ => Err("a property line of the faces is not valid".to_owned()),
    };
    let properties = element.properties.iter().map(property).collect::<Result<Vec<_>, _>>()?;
    let lists = properties.iter().filter(|property| matches!(property, FaceProperty::Corners(..))).count();
    if lists == 1 {
        Ok(properties)
    } else {
        Err("the faces need exactly one list property, vertex_indices".to_owned())
    }
}

/// The data after the header, as text or binary.
enum Source<'a> {
    Text { rest: &'a [u8], line: usize },
    Binary { rest: &'a [u8] },
}

/// The remaining values of a record (a vertex or a face).
struct Values<'a, 'b> {
    words: Option<std::str::SplitAsciiWhitespace<'a>>,
    rest: Option<&'b mut &'a [u8]>,
    what: &'static str,
    /// Number of the line in a text file, or of the record in a binary file, from 1.
    number: usize,
}

impl<'a> Source<'a> {
    fn record(&mut self, what: &'static str, index: usize) -> Result<Values<'a, '_>, MeshFileError> {
        match self {
            Source::Binary { rest } => Ok(Values { words: None, rest: Some(rest), what, number: index + 1 }),
            Source::Text { rest, line } => {
                *line += 1;
                let Some(end) = rest.iter().position(|&byte| byte == b'\n') else {
                    return Err(MeshFileError::Ends { line: *line, expected: "the end of the last line" });
                };
                let (text, after) = rest.split_at(end + 1);
                *rest = after;
                let problem = "the line is not UTF-8 text".to_owned();
                let text = std::str::from_utf8(text).map_err(|_| MeshFileError::Line { line: *line, problem })?;
                Ok(Values { words: Some(text.split_ascii_whitespace()), rest: None, what, number: *line })
            }
        }
    }

    /// Checks that no data follow the last record.
    fn end(&self) -> Result<(), MeshFileError> {
        let (Source::Text { rest, .. } | Source::Binary { rest }) = self;
        match rest.iter().all(u8::is_ascii_whitespace) {
            true => Ok(()),
            false => Err(MeshFileError::Trailing { found: rest.len() }),
        }
    }
}

impl Values<'_, '_> {
    fn next(&mut self, number: NumberType) -> Result<f64, MeshFileError> {
        if let Some(words) = &mut self.words {
            let word = words.next().and_then(|word| word.parse::<f64>().ok());
            return word.ok_or_else(|| self.value_error("a number is missing or not readable"));
        }
        let bytes = self.rest.as_mut().and_then(|rest| {
            let (value, after) = rest.split_at_checked(number.bytes())?;
            **rest = after;
            Some(value)
        });
        bytes
            .map(|bytes| number.value(bytes))
            .ok_or_else(|| self.value_error("the file ends here: it is truncated"))
    }

    /// Checks that no further number follows in the line.
    fn end(&mut self) -> Result<(), MeshFileError> {
        match self.words.as_mut().and_then(Iterator::next) {
            None => Ok(()),
            Some(_) => Err(self.value_error("more numbers than the header states")),
        }
    }

    fn value_error(&self, problem: &str) -> MeshFileError {
        match self.words {
            Some(_) => MeshFileError::Line { line: self.number, problem: problem.to_owned() },
            None => {
                let (what, number) = (self.what, self.number);
                MeshFileError::Record { what, number, problem: problem.to_owned() }
            }
        }
    }
}
