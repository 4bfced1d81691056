//! Reads meshes of drawings: STL (binary and text), PLY and OBJ. The format is recognised by the content.
//!
//! The parsers are our own. `mesh-loader` (0.1.13) does not compare the number of triangles in a binary STL file with
//! the file's size, so that it reads a truncated file as a smaller part. A STEP file is recognised and refused:
//! `truck-stepio` (0.3.0), the only maintained reader, reads neither the unit, nor the names and poses of the parts in
//! an assembly, nor offset surfaces.
//!
//! STL (3D Systems, "StereoLithography Interface Specification", 1989): normals are ignored, because they follow from
//! the vertices. The format has no unit, but a comment may state one.
//!
//! OBJ (Wavefront): vertices and planar faces. Textures, normals, materials and groups are ignored; an object (`o`) is
//! a part. Free-form curves and surfaces are refused, because a part of the panel would be missing without them.

pub use super::error::MeshFileError;

use super::error::MAX_TRIANGLES;
use super::ply::{read_ply_mesh, triangulate};
use panelprep_base::geometry::{LengthUnit, TriangleMesh};
use std::collections::HashMap;

/// Reads the mesh of a drawing. Its coordinates are those of the file; its unit is stated by the file, if at all.
///
/// # Errors
/// If the file is not a mesh, is truncated, contains invalid numbers, or has no triangle.
pub fn read_mesh(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(512)]);
    let head = head.trim_start_matches('\u{feff}').trim_start();
    let surfaces = |kind| Err(MeshFileError::Surfaces { kind });
    let mesh = if is_binary_stl(bytes) {
        read_binary_stl(bytes)
    } else if head.starts_with("ISO-10303-21;") {
        return surfaces("a STEP file");
    } else if head.lines().next().is_some_and(|line| line.len() == 80 && line.as_bytes()[72] == b'S') {
        return surfaces("an IGES file");
    } else if head.starts_with("**ABCDEFGHIJKLMNOPQRSTUVWXYZ") {
        return surfaces("a Parasolid file");
    } else if head.starts_with("ply") {
        read_ply_mesh(bytes)
    } else if is_stl_text(bytes) {
        read_text_stl(bytes)
    } else if is_obj_text(bytes) {
        read_obj(bytes)
    } else {
        check_stl_size(bytes)?;
        return Err(MeshFileError::NoMesh);
    }?;
    if mesh.triangles.is_empty() { Err(MeshFileError::Empty) } else { Ok(mesh) }
}

const HEADER_BYTES: usize = 80;
const START_BYTES: usize = HEADER_BYTES + 4;
const TRIANGLE_BYTES: usize = 50;

/// Builds a mesh from triangles that state the coordinates of their corners: equal coordinates within an object are one
/// vertex.
#[derive(Default)]
struct CornerTriangles {
    mesh: TriangleMesh,
    known: HashMap<[u64; 3], u32>,
}

impl CornerTriangles {
    fn begin_object(&mut self, name: &str) {
        self.mesh.begin_object(name);
        // Equal coordinates in another object are a different vertex, so that objects in contact stay separate.
        self.known.clear();
    }

    fn vertex(&mut self, corner: [f64; 3]) -> u32 {
        // Adding 0.0 makes −0.0 and 0.0 equal.
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

/// Returns the number of triangles in the header of a binary STL file.
fn stated_triangle_count(bytes: &[u8]) -> Option<u64> {
    let count: [u8; 4] = bytes.get(HEADER_BYTES..START_BYTES)?.try_into().ok()?;
    Some(u64::from(u32::from_le_bytes(count)))
}

/// Returns whether the size is exactly that of a binary STL file. The first word does not decide, because it may be
/// "solid" in a binary file, too.
fn is_binary_stl(bytes: &[u8]) -> bool {
    stated_triangle_count(bytes)
        .is_some_and(|count| bytes.len() as u64 == START_BYTES as u64 + TRIANGLE_BYTES as u64 * count)
}

/// Refuses a binary STL file with a wrong size: all other supported formats are text, or begin with text.
fn check_stl_size(bytes: &[u8]) -> Result<(), MeshFileError> {
    let Some(triangles) = stated_triangle_count(bytes).filter(|&count| count <= MAX_TRIANGLES as u64) else {
        return Ok(());
    };
    let needed = START_BYTES as u64 + TRIANGLE_BYTES as u64 * triangles;
    let is_text = std::str::from_utf8(&bytes[..HEADER_BYTES]).is_ok() && !bytes[..START_BYTES].contains(&0);
    if is_text { Ok(()) } else { Err(MeshFileError::StlSize { triangles, needed, found: bytes.len() as u64 }) }
}

/// Reads a binary STL file, whose size [`is_binary_stl`] has checked.
fn read_binary_stl(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
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

/// Returns whether the file begins like an STL text file.
fn is_stl_text(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(1_024)];
    let first = head.trim_ascii_start();
    first.len() >= 5 && first[..5].eq_ignore_ascii_case(b"solid") && !head.contains(&0)
}

/// Reads an STL text file.
fn read_text_stl(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
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

/// Parses three finite numbers.
fn point<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<[f64; 3]> {
    let mut number = || words.next()?.parse::<f64>().ok().filter(|number| number.is_finite());
    Some([number()?, number()?, number()?])
}

/// Merges the units of two comments; different units are an error.
fn merge_units(
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

/// Returns the mesh as a binary STL file with the unit in its header. The normals are zero; readers compute them.
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

/// OBJ statements that do not change the shape of a mesh.
const IGNORED_STATEMENTS: [&str; 12] =
    ["vt", "vn", "vp", "s", "g", "mg", "usemtl", "mtllib", "usemap", "maplib", "l", "p"];

/// Returns whether the file begins like an OBJ file: comments, and then an OBJ statement.
fn is_obj_text(bytes: &[u8]) -> bool {
    let mut lines = bytes[..bytes.len().min(65_536)].split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with(b"#"));
    let word = first.and_then(|line| line.split(u8::is_ascii_whitespace).next());
    word.and_then(|word| std::str::from_utf8(word).ok())
        .is_some_and(|word| ["v", "o", "f"].contains(&word) || IGNORED_STATEMENTS.contains(&word))
}

/// Reads an OBJ file.
fn read_obj(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
    let mut mesh = TriangleMesh::default();
    let mut corners = Vec::new();
    for (index, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let refuse = |problem: String| MeshFileError::Line { line: index + 1, problem };
        let text = String::from_utf8_lossy(line);
        let text = text.trim();
        if let Some(comment) = text.strip_prefix('#') {
            mesh.unit = merge_units(
                mesh.unit,
                LengthUnit::from_comment(comment).map_err(|found| MeshFileError::UnknownUnit { found })?,
            )?;
            continue;
        }
        if text.ends_with('\\') {
            return Err(refuse("the statement continues on the next line; export it on one line".to_owned()));
        }
        let mut words = text.split_ascii_whitespace();
        match words.next() {
            None => {}
            Some("v") => mesh.vertices.push(
                point(words)
                    .ok_or_else(|| refuse(format!("'{text}': three finite numbers are needed after 'v'")))?,
            ),
            Some("f") => {
                corners.clear();
                for word in words {
                    corners.push(vertex(word, mesh.vertices.len()).map_err(refuse)?);
                }
                let triangles = triangulate(&mesh.vertices, &corners);
                let failed = MeshFileError::NotConvex { line: index + 1, corners: corners.len() };
                mesh.triangles.extend(triangles.ok_or(failed)?);
            }
            Some("o") => mesh.begin_object(&words.collect::<Vec<_>>().join(" ")),
            Some(word) if IGNORED_STATEMENTS.contains(&word) => {}
            Some(word) => {
                return Err(refuse(format!(
                    "'{}' is not a statement of a mesh; export the panel as a mesh of triangles",
                    word.chars().take(20).collect::<String>()
                )));
            }
        }
        if mesh.triangles.len() > MAX_TRIANGLES {
            return Err(MeshFileError::TooMany { found: mesh.triangles.len() as u64 });
        }
    }
    Ok(mesh)
}

/// Parses the vertex index of a face corner, such as `7`, `7/1`, `7//3` or `-1`. A negative index counts backwards from
/// the last vertex.
fn vertex(word: &str, count: usize) -> Result<u32, String> {
    let number = word.split('/').next().and_then(|number| number.parse::<i64>().ok());
    let index = number.and_then(|number| match number {
        1.. => usize::try_from(number - 1).ok(),
        0 => None,
        _ => count.checked_sub(usize::try_from(number.unsigned_abs()).ok()?),
    });
    let allowed = || format!("'{word}' is not the number of a vertex; valid: 1 to {count}, or -1 to -{count}");
    index.filter(|&index| index < count).map(|index| index as u32).ok_or_else(allowed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::LengthUnit;

    /// A rectangle of 2 × 1 as two triangles.
    const TEXT: &str = "solid skin made by hand, unit: mm\n\
        facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 2 0 0\n  vertex 2 1 0\n endloop\nendfacet\n\
        facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 2 1 0\n  vertex 0 1 -0\n endloop\nendfacet\nendsolid skin\n";
    const OBJ: &str = "# units: inches\no skin\nv 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvn 0 0 1\nf 1/1/1 2//1 3 -1\n";
    const PLY: &str = "ply\nformat ascii 1.0\ncomment unit m\nelement vertex 4\nproperty float x\nproperty float y\n\
        property double z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 9\n2 0 0 9\n2 1 0 9\n0 1 0 9\n4 0 1 2 3\n";

    fn area(mesh: &TriangleMesh) -> f64 {
        let at = |corner: u32| nalgebra::Point3::from(mesh.vertices[corner as usize]);
        mesh.triangles.iter().map(|&[a, b, c]| (at(b) - at(a)).cross(&(at(c) - at(a))).norm() / 2.0).sum()
    }

    /// All formats give the same mesh of this rectangle: four vertices, two triangles, an area of 2, and the unit of
    /// the comment.
    #[test]
    fn every_form_gives_the_same_mesh() {
        let text = read_mesh(TEXT.as_bytes()).expect("text STL");
        let binary = read_mesh(&write_stl(&text)).expect("binary STL");
        let obj = read_mesh(OBJ.as_bytes()).expect("OBJ");
        let ply = read_mesh(PLY.as_bytes()).expect("PLY");
        for mesh in [&text, &binary, &obj, &ply] {
            assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (4, 2));
            assert!((area(mesh) - 2.0).abs() < 1e-12);
        }
        let units = [LengthUnit::Millimetre, LengthUnit::Millimetre, LengthUnit::Inch, LengthUnit::Metre];
        assert_eq!([text.unit, binary.unit, obj.unit, ply.unit], units.map(Some));
        assert_eq!(text.objects[0].name, "skin");
        let binary_ply = binary_ply();
        assert_eq!(read_mesh(&binary_ply).expect("binary PLY").triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    fn binary_ply() -> Vec<u8> {
        let header = PLY.split("0 0 0 9").next().expect("a header").replace("ascii", "binary_little_endian");
        let mut bytes = header.into_bytes();
        for [x, y] in [[0.0_f32, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]] {
            bytes.extend([x.to_le_bytes(), y.to_le_bytes()].concat());
            bytes.extend(0.0_f64.to_le_bytes());
            bytes.push(9);
        }
        bytes.push(4);
        (0..4_i32).for_each(|corner| bytes.extend(corner.to_le_bytes()));
        bytes
    }

    /// Two solids with two common points stay two objects, each with its own vertices.
    #[test]
    fn solids_stay_apart() {
        let mesh =
            read_mesh(TEXT.replacen("endfacet\n", "endfacet\nendsolid\nsolid rib\n", 1).as_bytes()).expect("two");
        let objects: Vec<_> = mesh.objects().map(|(name, triangles)| (name, triangles.len())).collect();
        assert_eq!((objects, mesh.vertices.len()), (vec![("skin", 1), ("rib", 1)], 6));
    }

    #[test]
    fn each_refusal_names_the_place_and_what_to_do() {
        let binary = write_stl(&read_mesh(TEXT.as_bytes()).expect("good"));
        let changed = |from: &str, to: &str| TEXT.replacen(from, to, 1).into_bytes();
        let infinite = [&binary[..100], &f32::INFINITY.to_le_bytes(), &binary[104..]].concat();
        let ply = |from: &str, to: &str| PLY.replacen(from, to, 1).into_bytes();
        let cut_ply = binary_ply();
        let cases: Vec<(Vec<u8>, &str)> = vec![
            (
                binary[..binary.len() - 50].to_vec(),
                "states 2 triangles, which need 184 bytes, but the file has 134",
            ),
            (infinite, "triangle 1: a coordinate is infinite"),
            (changed("vertex 2 0 0", "vertex 2 0"), "line 5: 'vertex 2 0': three finite numbers"),
            (changed("vertex 2 0 0", "vertex 2 0 nan"), "line 5: 'vertex 2 0 nan': three finite numbers"),
            (changed("  vertex 2 0 0\n", ""), "line 6: the facet has 2 vertices"),
            (changed("endsolid skin", ""), "before 'endsolid': it is truncated"),
            (TEXT.split_inclusive('\n').take(9).collect::<String>().into_bytes(), "truncated"),
            (changed(" outer loop\n", ""), "line 3: 'vertex 0 0 0' is not expected here"),
            (b"solid nothing\nendsolid\n".to_vec(), "no triangle"),
            (
                b"ISO-10303-21;\nHEADER;\n".to_vec(),
                "a STEP file, whose surfaces are not triangulated: convert it to STL",
            ),
            (b"a text\nof no kind\n".to_vec(), "not an STL, PLY or OBJ file"),
            (b"".to_vec(), "not an STL, PLY or OBJ file"),
            (OBJ.replace("-1", "5").into_bytes(), "line 8: '5' is not the number of a vertex; valid: 1 to 4"),
            (OBJ.replace("-1", "0").into_bytes(), "line 8: '0' is not the number of a vertex"),
            (OBJ.replace("v 2 1 0", "v 2 1 x").into_bytes(), "line 5: 'v 2 1 x': three finite"),
            (
                OBJ.replace("v 2 0 0", "v 0.2 0.2 0").into_bytes(),
                "line 8: the face of 4 corners is not planar and convex",
            ),
            (
                OBJ.replace("v 2 1 0", "v 2 1 3").into_bytes(),
                "line 8: the face of 4 corners is not planar and convex",
            ),
            (
                OBJ.replace("v 2 1 0", "v 2 1 0.6").into_bytes(),
                "line 8: the face of 4 corners is not planar and convex",
            ),
            (OBJ.replace("vn 0 0 1", "# units: cm").into_bytes(), "the file states the unit cm (valid: mm, in, m)"),
            (OBJ.replace("vn 0 0 1", "curv 0 1 1 2").into_bytes(), "line 7: 'curv' is not a statement of a mesh"),
            (OBJ.replace("vn 0 0 1", "# unit mm").into_bytes(), "states two units, in and mm"),
            (OBJ.replace("f 1/1/1 2//1 3 -1\n", "").into_bytes(), "no triangle"),
            (ply("4 0 1 2 3", "4 0 1 2 4"), "line 16: vertex 4 does not exist; the file has 4 vertices"),
            (ply("4 0 1 2 3", "4 0 1 2"), "line 16: a number is missing"),
            (ply("4 0 1 2 3", "4 0 1 2 3 3"), "line 16: more numbers than the header states"),
            (ply("2 1 0 9", "2 inf 0 9"), "line 14: a coordinate is infinite"),
            (ply("face 1", "edge 1"), "the second element is edge, expected 'face'"),
            (ply("vertex_indices", "texcoord"), "the list property 'texcoord' of the faces is not supported"),
            (PLY.to_owned().into_bytes().into_iter().chain(*b"7 7\n").collect(), "4 bytes follow the last face"),
            (cut_ply[..cut_ply.len() - 1].to_vec(), "face 1: the file ends here"),
            (ply("float x", "float u"), "field x: found none"),
        ];
        for (bytes, expected) in cases {
            let found = read_mesh(&bytes).expect_err(expected).to_string();
            assert!(found.contains(expected), "{found}\nshould say: {expected}");
        }
    }
}
