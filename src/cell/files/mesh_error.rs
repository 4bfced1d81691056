//! Reasons why bytes are not a mesh.

use super::cloud_error::CloudFileError;

/// Largest number of triangles, five times that of a finely meshed panel; the memory stays below one gigabyte.
pub const MAX_TRIANGLES: usize = 5_000_000;

/// Remedy for a file of a CAD system, the same for all its kinds.
const CONVERT: &str = "convert it to STL with the CAD system, or with FreeCAD (open it, select the panel's body, File → Export, \
                       STL mesh), with a deviation of 0.01 mm or less";

/// The reason why a drawing's file was refused: the position, what was found, what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MeshFileError {
    /// None of the forms that are read.
    #[error("the file is not an STL, PLY or OBJ file; {CONVERT}")]
    NoMesh,
    /// A file of a CAD system, whose surfaces are not triangles.
    #[error("the file is {kind}, whose surfaces are formulas, not triangles: {CONVERT}")]
    Surfaces {
        /// Kind of the surfaces.
        kind: &'static str,
    },
    /// A binary STL file whose size is not what its header states.
    #[error(
        "the header of this binary STL file states {triangles} triangles, which need {needed} bytes, but the file has \
         {found} bytes: the file is damaged or incomplete; export it again"
    )]
    StlSize {
        /// Number of triangles stated.
        triangles: u64,
        /// Bytes of a file with as many.
        needed: u64,
        /// Number of bytes in the file.
        found: u64,
    },
    /// A triangle, vertex or face of a binary file.
    #[error("{what} {number}: {problem}")]
    Record {
        /// Kind of the record.
        what: &'static str,
        /// Number of the record, from 1.
        number: usize,
        /// The problem.
        problem: String,
    },
    /// A line of a text.
    #[error("line {line}: {problem}")]
    Line {
        /// Line, from 1.
        line: usize,
        /// The problem.
        problem: String,
    },
    /// The text ends inside an object.
    #[error("the file ends at line {line} before '{expected}': it is truncated; export it again")]
    Ends {
        /// The last line, from 1.
        line: usize,
        /// The expected content.
        expected: &'static str,
    },
    /// Data after the last face.
    #[error("{found} bytes follow the last face: header and data disagree; export the file again")]
    Trailing {
        /// Number of surplus bytes.
        found: usize,
    },
    /// A face that is divided into triangles in several ways that differ.
    #[error(
        "line {line}: the face of {corners} corners is not planar and convex; export the mesh with triangles only"
    )]
    NotConvex {
        /// Line, or number of the face in a binary file, from 1.
        line: usize,
        /// Its corners.
        corners: usize,
    },
    /// Two statements of the unit that differ.
    #[error("the file states two units, {first} and {second}; correct its comments")]
    TwoUnits {
        /// The first unit.
        first: &'static str,
        /// The second unit.
        second: &'static str,
    },
    /// A statement of a unit that is not read.
    #[error(
        "the file states the unit {found} (valid: mm, in, m); export it in millimetres, or correct its comment"
    )]
    UnknownUnit {
        /// The words of the file.
        found: String,
    },
    /// A mesh without triangles.
    #[error("the file has no triangle: it contains only points or curves; export the panel's body as a mesh")]
    Empty,
    /// Too many triangles.
    #[error(
        "the file has {found} triangles (limit {MAX_TRIANGLES}); export the mesh with a larger deviation; 0.01 mm is \
         sufficient"
    )]
    TooMany {
        /// Triangles found.
        found: u64,
    },
    /// A PLY header.
    #[error(transparent)]
    Ply(#[from] CloudFileError),
}
