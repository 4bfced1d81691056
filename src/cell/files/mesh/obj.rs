//! OBJ (Wavefront): vertices and plane faces. Textures, normals, materials and groups are not used; an object (`o`)
//! is a part. Free-form curves and surfaces are refused, because a part of the panel would be missing without them.

use super::super::mesh_error::{MAX_TRIANGLES, MeshFileError};
use super::super::ply::triangulate;
use super::stl::{merge_units, point};
use panelprep_base::geometry::{LengthUnit, TriangleMesh};

/// Statements without effect on the shape of a mesh.
const IGNORED_STATEMENTS: [&str; 12] =
    ["vt", "vn", "vp", "s", "g", "mg", "usemtl", "mtllib", "usemap", "maplib", "l", "p"];

/// Returns whether the bytes begin as an OBJ file: comments, and then one of its statements.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    let mut lines = bytes[..bytes.len().min(65_536)].split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with(b"#"));
    let word = first.and_then(|line| line.split(u8::is_ascii_whitespace).next());
    word.and_then(|word| std::str::from_utf8(word).ok())
        .is_some_and(|word| ["v", "o", "f"].contains(&word) || IGNORED_STATEMENTS.contains(&word))
}

/// Reads a file.
pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
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

/// Reads the vertex of a corner such as `7`, `7/1`, `7//3` or `-1`, which counts backwards.
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
