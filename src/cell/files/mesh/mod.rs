//! Meshes of drawings: STL (binary and text), PLY and OBJ, distinguished by their content.
//!
//! The readers are our own. `mesh-loader` (0.1.13) does not compare the count of a binary STL file with its length, so that
//! a truncated file is read as a smaller part. STEP is refused by name: `truck-stepio` (0.3.0), the only kept-up reader,
//! reads neither the unit, nor names and places of the parts in an assembly, nor offset surfaces.

mod obj;
mod stl;

pub use stl::write_stl;

pub use super::mesh_error::MeshFileError;
use super::ply::read_ply_mesh;
use panelprep_base::geometry::TriangleMesh;

/// Reads the mesh of a drawing. Its numbers are those of the file; its unit is what the file states, if it states one.
///
/// # Errors
/// If the bytes are not a mesh, are not complete, contain text instead of numbers, or have no triangle.
pub fn read_mesh(bytes: &[u8]) -> Result<TriangleMesh, MeshFileError> {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(512)]);
    let head = head.trim_start_matches('\u{feff}').trim_start();
    let surfaces = |kind| Err(MeshFileError::Surfaces { kind });
    let mesh = if stl::is_binary(bytes) {
        stl::read_binary(bytes)
    } else if head.starts_with("ISO-10303-21;") {
        return surfaces("a STEP file");
    } else if head.lines().next().is_some_and(|line| line.len() == 80 && line.as_bytes()[72] == b'S') {
        return surfaces("an IGES file");
    } else if head.starts_with("**ABCDEFGHIJKLMNOPQRSTUVWXYZ") {
        return surfaces("a Parasolid file");
    } else if head.starts_with("ply") {
        read_ply_mesh(bytes)
    } else if stl::is_text(bytes) {
        stl::read_text(bytes)
    } else if obj::is_text(bytes) {
        obj::read(bytes)
    } else {
        stl::check_size(bytes)?;
        return Err(MeshFileError::NoMesh);
    }?;
    if mesh.triangles.is_empty() { Err(MeshFileError::Empty) } else { Ok(mesh) }
}

#[cfg(test)]
mod tests;
