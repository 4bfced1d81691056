//! STL, binary and text (3D Systems, "StereoLithography Interface Specification", 1989). Its normals are not used:
//! they follow from the vertices. It has no unit of its own; a comment may state one.

use super::super::mesh_error::{MAX_TRIANGLES, MeshFileError};
use panelprep_base::geometry::{LengthUnit, TriangleMesh};
use std::collections::HashMap;

const HEADER_BYTES: usize = 80;
const START_BYTES: usize = HEADER_BYTES + 4;
const TRIANGLE_BYTES: usize = 50;

/// Triangles of which each states its three corners: the same numbers are the same vertex of an object.
#[derive(Default)]
struct CornerTriangles {
    mesh: TriangleMesh,
    known: HashMap<[u64; 3], u32>,
}

impl CornerTriangles {
    fn begin_object(&mut self, name: &str) {
        self.mesh.begin_object(name);
        // The same place in another object is another vertex: objects that touch stay apart.
        self.known.clear();
    }

    fn vertex(&mut self, corner: [f64; 3]) -> u32 {
        // Zero has two signs.
        let key = corner.map(|number| (number + 0.0).to_bits());
        let vertices = &mut self.mesh.vertices;
        *self.known.entry(key).or_insert_with(|| {
            vertices.push(corner);
            (vertices.len() - 1) as u32
        })
    }

    fn push(&mut self, corners: [[f64; 3]; 3]) {
        let triangle = corners.map(|corner| self.vertex(corner));
        self.mesh.triangles.push(triangle);
    }
}

/// Returns the count of triangles that a binary file's header states.
fn stated_triangle_count(bytes: &[u8]) -> Option<u64> {
    let count: [u8; 4] = bytes.get(HEADER_BYTES..START_BYTES)?.try_into().ok()?;
    Some(u64::from(u32::from_le_bytes(count)))
}

/// Returns whether the size is exactly that of a binary STL file; its first word may be "solid", too.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    stated_triangle_count(bytes)
        .is_some_and(|count| bytes.len() as u64 == START_BYTES as u64 + TRIANGLE_BYTES as u64 * count)
}

/// Refuses bytes that are not text of any kind as a binary STL file of the wrong length, if they can be one.
pub(super) fn check_size(bytes: &[u8]) -> Result<(), MeshFileError> {
    let Some(triangles) = stated_triangle_count(bytes).filter(|&count| count <= MAX_TRIANGLES as u64) else {
        return Ok(());
    };
    let needed = START_BYTES as u64 + TRIANGLE_BYTES as u64 * triangles;
    let is_text = std::str::from_utf8(&bytes[..HEADER_BYTES]).is_ok() && !bytes[..START_BYTES].contains(&0);
    if is_text { Ok(()) } else { Err(MeshFileError::StlSize { triangles, needed, found: bytes.len() as u64 }) }
}

/// Reads a file for which [`is_binary`] holds.
pub(super) fn read_binary(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
    let records = bytes[START_BYTES..].chunks_exact(TRIANGLE_BYTES);
    if records.len() > MAX_TRIANGLES {
        return Err(MeshFileError::TooMany { found: records.len() as u64 });
    }
    let mut corners = CornerTriangles::default();
    corners.mesh.triangles.reserve_exact(records.len());
    corners.mesh.unit = LengthUnit::from_comment(&String::from_utf8_lossy(&bytes[..HEADER_BYTES]))
        .map_err(|found| MeshFileError::UnknownUnit { found })?;
    for (index, record) in records.enumerate() {
        let number = |at: usize| {
            let bytes = record[at..].first_chunk().copied().unwrap_or_default();
            f64::from(f32::from_le_bytes(bytes))
        };
        let triangle = [12, 24, 36].map(|at| [number(at), number(at + 4), number(at + 8)]);
        if !triangle.iter().flatten().all(|number| number.is_finite()) {
            let problem = "a coordinate is infinite or not a number; export the file again".to_owned();
            return Err(MeshFileError::Record { what: "triangle", number: index + 1, problem });
        }
        corners.push(triangle);
    }
    Ok(corners.mesh)
}

/// Returns whether the bytes begin as a text STL file.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(1_024)];
    let first = head.trim_ascii_start();
    first.len() >= 5 && first[..5].eq_ignore_ascii_case(b"solid") && !head.contains(&0)
}

/// Reads a text file.
pub(super) fn read_text(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
    let mut corners = CornerTriangles::default();
    let mut facet: Vec<[f64; 3]> = Vec::with_capacity(3);
    let (mut is_in_solid, mut is_in_loop, mut count) = (false, false, 0);
    for (index, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        count = index + 1;
        let refuse = |problem: String| MeshFileError::Line { line: index + 1, problem };
        let text = String::from_utf8_lossy(line);
        let mut words = text.split_ascii_whitespace();
        let Some(word) = words.next() else { continue };
        let unexpected =
            || refuse(format!("'{}' is not expected here", text.trim().chars().take(60).collect::<String>()));
        match word.to_ascii_lowercase().as_str() {
            "solid" if !is_in_solid => {
                is_in_solid = true;
                let rest = words.clone().collect::<Vec<_>>().join(" ");
                corners.begin_object(words.next().unwrap_or_default());
                let unit = LengthUnit::from_comment(&rest).map_err(|found| MeshFileError::UnknownUnit { found })?;
                corners.mesh.unit = merge_units(corners.mesh.unit, unit)?;
            }
            "facet" | "endfacet" if is_in_solid && !is_in_loop => {}
            "outer" if is_in_solid && !is_in_loop => is_in_loop = true,
            "vertex" if is_in_loop => facet.push(point(words).ok_or_else(|| {
                refuse(format!("'{}': three finite numbers are needed after 'vertex'", text.trim()))
            })?),
            "endloop" if is_in_loop => {
                let found = facet.len();
                let triangle = <[[f64; 3]; 3]>::try_from(std::mem::take(&mut facet));
                corners.push(triangle.map_err(|_| refuse(format!("the facet has {found} vertices, expected 3")))?);
                is_in_loop = false;
            }
            "endsolid" if is_in_solid && !is_in_loop => is_in_solid = false,
            _ => return Err(unexpected()),
        }
        if corners.mesh.triangles.len() > MAX_TRIANGLES {
            return Err(MeshFileError::TooMany { found: corners.mesh.triangles.len() as u64 });
        }
    }
    if is_in_solid { Err(MeshFileError::Ends { line: count, expected: "endsolid" }) } else { Ok(corners.mesh) }
}

/// Reads the three numbers that follow.
pub(super) fn point<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<[f64; 3]> {
    let mut number = || words.next()?.parse::<f64>().ok().filter(|number| number.is_finite());
    Some([number()?, number()?, number()?])
}

/// Joins the units that two comments state.
pub(super) fn merge_units(
    known: Option<LengthUnit>,
    further: Option<LengthUnit>,
) -> Result<Option<LengthUnit>, MeshFileError> {
    match (known, further) {
        (Some(first), Some(second)) if first != second => {
            Err(MeshFileError::TwoUnits { first: first.abbreviation(), second: second.abbreviation() })
        }
        _ => Ok(known.or(further)),
    }
}

/// Returns triangles as a binary STL file whose header states the unit; without normals, which readers compute.
pub fn write_stl(mesh: &TriangleMesh) -> Vec<u8> {
    let mut bytes = match mesh.unit {
        Some(unit) => format!("unit: {}", unit.abbreviation()).into_bytes(),
        None => Vec::new(),
    };
    bytes.resize(HEADER_BYTES, b' ');
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    bytes.reserve_exact(mesh.triangles.len() * TRIANGLE_BYTES);
    for triangle in &mesh.triangles {
        bytes.extend([0; 12]);
        for number in triangle.iter().flat_map(|&corner| mesh.vertices[corner as usize]) {
            bytes.extend((number as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}
