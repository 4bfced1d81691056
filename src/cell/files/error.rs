//! The reasons why a file is not an organised cloud or not a mesh. A file of another kind that was given as a scan is
//! recognised by its first bytes; the error states the kind and what to do.

use panelprep_base::geometry::{CloudError, PinholeCamera};

/// The reason why a PCD or PLY file was refused: the position, the value found, and the valid values.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CloudFileError {
    /// The file has neither a PCD nor a PLY header.
    #[error(
        "the file is neither a PCD nor a PLY file: it has no header that ends in a line '{end}' (searched {searched} \
         bytes)"
    )]
    NotACloud {
        /// The beginning of the header's last line.
        end: &'static str,
        /// Number of bytes in which the header was searched.
        searched: usize,
    },
    /// A file of another kind, recognised by its first bytes.
    #[error("the file is {kind}: {remedy}")]
    OtherKind {
        /// Kind of the file.
        kind: &'static str,
        /// What to do with a file of this kind.
        remedy: &'static str,
    },
    /// An invalid header line.
    #[error("header line {line}, '{found}': {problem}")]
    Header {
        /// Line, from 1.
        line: usize,
        /// The text of the line.
        found: String,
        /// The problem in the line.
        problem: String,
    },
    /// A required field is missing or has another type.
    #[error("field {name}: found {found}; valid: {allowed}")]
    Field {
        /// Name of the field in the file's header.
        name: &'static str,
        /// The field found in the header, with its type.
        found: String,
        /// The supported fields and types.
        allowed: &'static str,
    },
    /// The file contains a list of points without the pixel of each point.
    #[error(transparent)]
    Organized(#[from] CloudError),
    /// The number of points differs from width times height.
    #[error(
        "the header states {points} points for a picture of {width}×{height}; export an ordered cloud, one point for \
         each pixel"
    )]
    Count {
        /// The number of points that the header states.
        points: u64,
        /// Width of the picture, px.
        width: u64,
        /// Height of the picture, px.
        height: u64,
    },
    /// More data than any camera can deliver.
    #[error(
        "the header states {points} points of {point_bytes} bytes (limits {limit_point_bytes} bytes per point, \
         {limit_bytes} bytes in total); export the cloud with positions and colours only"
    )]
    TooLarge {
        /// The number of points that the header states.
        points: u64,
        /// Size of a point, bytes; in a text file, the size of its numbers.
        point_bytes: u64,
        /// Maximum size of all points, bytes.
        limit_bytes: u64,
        /// Maximum size of a point, bytes.
        limit_point_bytes: u64,
    },
    /// The file ends before the last point.
    #[error("the file is truncated: {needed} bytes of points from byte {start} on were expected, found {found}")]
    Truncated {
        /// Offset of the first point, bytes.
        start: usize,
        /// Size of all points according to the header, bytes.
        needed: usize,
        /// Size of the points in the file, bytes.
        found: usize,
    },
    /// The text ends before the last point.
    #[error("the file is truncated: {needed} points were expected, found {found}")]
    TooFewLines {
        /// Number of points according to the header.
        needed: usize,
        /// Number of points in the file.
        found: usize,
    },
    /// The file contains data after the last point.
    #[error(
        "{found} bytes follow the last point, from byte {start} on: header and data disagree; export the cloud again"
    )]
    Trailing {
        /// Offset of the first byte after the points.
        start: usize,
        /// Number of bytes after the points.
        found: usize,
    },
    /// An invalid point in a text file.
    #[error("line {line}: {problem}")]
    Point {
        /// Line, from 1.
        line: usize,
        /// The problem in the point.
        problem: String,
    },
    /// The compressed data cannot be decompressed.
    #[error("the compressed data from byte {start} on cannot be decompressed: {problem}; export the cloud again")]
    Compressed {
        /// Offset of the compressed data, bytes.
        start: usize,
        /// The problem in the data.
        problem: String,
    },
    /// A list of points without the width of the picture.
    #[error(
        "neither the file nor a calibration states the width and height of the cloud's picture: write the lines \
         'comment width W' and 'comment height H' into the file's header, or name a cell whose [calibration] has this \
         scanner"
    )]
    NoSize,
    /// The size of the cloud is not that of the calibrated camera.
    #[error("the cloud is {width}×{height} px, but the camera's calibration is for {width_px}×{height_px} px")]
    Size {
        /// Width of the cloud, px.
        width: usize,
        /// Height of the cloud, px.
        height: usize,
        /// Width of the calibrated camera's pictures, px.
        width_px: usize,
        /// Height of the calibrated camera's pictures, px.
        height_px: usize,
    },
    /// The unit of the coordinates is m.
    #[error("the depths of the points are from {from} to {to}: these values are metres; export the cloud in mm")]
    Metres {
        /// Smallest depth of a point, as text.
        from: String,
        /// Largest depth of a point, as text.
        to: String,
    },
    /// The unit of the coordinates is neither mm nor m.
    #[error(
        "the depths of the points are from {from} to {to}, but a 3D camera measures from 150 to 5000 mm: the unit is \
         probably cm, inch or µm; export the cloud in mm"
    )]
    OtherUnit {
        /// Smallest depth of a point, as text.
        from: String,
        /// Largest depth of a point, as text.
        to: String,
    },
    /// Most points are behind the camera.
    #[error(
        "most points are behind the camera (z from {from} to {to} mm): the cloud has OpenGL's axes (y up, z \
         backwards), or is in another frame; export it in the camera's own frame, with z pointing forwards"
    )]
    Behind {
        /// Smallest z of a point.
        from: String,
        /// Largest z of a point.
        to: String,
    },
    /// The order of the points differs from that of the pixels.
    #[error(
        "the points are in another order than this camera's pixels, {order}: export the cloud as the camera took \
         it, row by row from the top left"
    )]
    OtherOrder {
        /// How the order differs, such as "the rows are upside down".
        order: &'static str,
    },
    /// The points belong to another lens.
    #[error(
        "half of the points are {off_px} px or more from the pixels that the calibration predicts: they are on the \
         rays of another lens ({own}; the calibration states {stated}). Name the calibration of the camera that took \
         this scan, or compute it from the scan: panelprep calibrate intrinsics --from-scan"
    )]
    OtherLens {
        /// Median distance between the pixels and the projections of their points, px.
        off_px: String,
        /// The parameters of the lens to which the points belong.
        own: String,
        /// The parameters of the calibrated lens.
        stated: String,
    },
    /// The points are not in the camera's frame.
    #[error(
        "half of the points are {off_px} px or more from the rays of their pixels, and no lens explains the deviation: \
         the cloud is in another frame (such as the robot's base), or was smoothed or moved. Export the unmodified \
         cloud in the camera's own frame"
    )]
    OtherFrame {
        /// Median distance between the pixels and the projections of their points, px.
        off_px: String,
    },
    /// Some points do not lie on the rays of their pixels, although most points do.
    #[error(
        "{points} points are not on the rays of their pixels, but all others are; the first of these points has the \
         pixel ({column}, {row}): the file was changed after the scan. Export or copy the file again"
    )]
    OffRays {
        /// Number of these points.
        points: usize,
        /// Column of the first of these points.
        column: usize,
        /// Row of the first of these points.
        row: usize,
    },
}

/// Checks that the size in the header is that of the calibrated camera.
pub(super) fn check_cloud_size((width, height): (u64, u64), camera: &PinholeCamera) -> Result<(), CloudFileError> {
    let (width, height) = (width as usize, height as usize);
    match (width, height) == (camera.width_px, camera.height_px) {
        true => Ok(()),
        false => {
            Err(CloudFileError::Size { width, height, width_px: camera.width_px, height_px: camera.height_px })
        }
    }
}

/// Maximum number of triangles of a mesh: five times that of a finely meshed panel; the memory stays below one
/// gigabyte.
pub const MAX_TRIANGLES: usize = 5_000_000;

/// What to do with a file of any CAD system.
const CONVERT_TO_STL: &str = "convert it to STL with the CAD system, or with FreeCAD (open it, select the panel's body, File → Export, \
                       STL mesh), with a deviation of 0.01 mm or less";

/// The reason why the mesh of a drawing was refused: the position, the value found, and what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MeshFileError {
    /// The file has none of the supported formats.
    #[error("the file is not an STL, PLY or OBJ file; {CONVERT_TO_STL}")]
    NoMesh,
    /// A file of a CAD system, whose surfaces are not triangulated.
    #[error("the file is {kind}, whose surfaces are not triangulated: {CONVERT_TO_STL}")]
    Surfaces {
        /// The kind of the file.
        kind: &'static str,
    },
    /// The size of a binary STL file differs from its header.
    #[error(
        "the header of this binary STL file states {triangles} triangles, which need {needed} bytes, but the file has \
         {found} bytes: the file is damaged or incomplete; export it again"
    )]
    StlSize {
        /// Number of triangles according to the header.
        triangles: u64,
        /// Size of the file according to the header, bytes.
        needed: u64,
        /// Size of the file, bytes.
        found: u64,
    },
    /// An invalid triangle, vertex or face in a binary file.
    #[error("{what} {number}: {problem}")]
    Record {
        /// Kind of the record: triangle, vertex or face.
        what: &'static str,
        /// Number of the record, from 1.
        number: usize,
        /// The problem of the record.
        problem: String,
    },
    /// An invalid line in a text file.
    #[error("line {line}: {problem}")]
    Line {
        /// Line, from 1.
        line: usize,
        /// The problem of the line.
        problem: String,
    },
    /// The text ends within an object.
    #[error("the file ends at line {line} before '{expected}': it is truncated; export it again")]
    Ends {
        /// Number of the last line, from 1.
        line: usize,
        /// What should follow.
        expected: &'static str,
    },
    /// The file contains data after the last face.
    #[error("{found} bytes follow the last face: header and data disagree; export the file again")]
    Trailing {
        /// Number of bytes after the last face.
        found: usize,
    },
    /// A face whose division into triangles is ambiguous.
    #[error(
        "line {line}: the face of {corners} corners is not planar and convex; export the mesh with triangles only"
    )]
    NotConvex {
        /// Number of the line, or of the face in a binary file, from 1.
        line: usize,
        /// Number of corners of the face.
        corners: usize,
    },
    /// The file states two different units.
    #[error("the file states two units, {first} and {second}; correct the comments of the file")]
    TwoUnits {
        /// The unit that is stated first.
        first: &'static str,
        /// The unit that is stated later.
        second: &'static str,
    },
    /// The file states a unit that is not supported.
    #[error(
        "the file states the unit {found} (valid: mm, in, m); export it in millimetres, or correct its comment"
    )]
    UnknownUnit {
        /// The statement of the unit in the file.
        found: String,
    },
    /// A mesh without triangles.
    #[error("the file has no triangle: it contains only points or curves; export the panel's body as a mesh")]
    Empty,
    /// The mesh has too many triangles.
    #[error(
        "the file has {found} triangles (limit {MAX_TRIANGLES}); export the mesh with a larger deviation; 0.01 mm is \
         sufficient"
    )]
    TooMany {
        /// Number of triangles in the file.
        found: u64,
    },
    /// The header of the PLY file is not valid.
    #[error(transparent)]
    Ply(#[from] CloudFileError),
}

const EXPORT_ORDERED_CLOUD: &str =
    "export it as PCD, ordered (organised): one point for each pixel, in mm, in the camera's frame";

/// Returns whether the text consists of rows of at least three numbers: a list of points without pixels.
fn is_number_table(head: &str) -> bool {
    let mut lines = head.lines().map(str::trim).filter(|line| !line.is_empty());
    // The first line may contain column names.
    let is_row = |line: &str| {
        let numbers: Vec<&str> = line.split([',', ';', ' ', '\t']).filter(|word| !word.is_empty()).collect();
        numbers.len() >= 3 && numbers.iter().all(|word| word.parse::<f64>().is_ok())
    };
    lines.next().is_some() && lines.next().is_some_and(is_row) && lines.next().is_some_and(is_row)
}

/// Refuses a file of a known other kind, with the kind and what to do.
pub(super) fn check_kind(bytes: &[u8]) -> Result<(), CloudFileError> {
    let other = |kind, remedy| Err(CloudFileError::OtherKind { kind, remedy });
    let head = &bytes[..bytes.len().min(1_024)];
    if head.starts_with(b"\x89HDF") {
        let remedy = "open it in Zivid Studio, or with its SDK, and export it as PCD, ordered (organised): one point for each pixel, \
                      in mm, in the camera's frame";
        return other("an HDF5 file, as Zivid's .zdf files are", remedy);
    }
    // A binary STL file has a header of 80 bytes, the number of triangles, and 50 bytes for each triangle.
    let triangles = bytes.get(80..84).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    if triangles.is_some_and(|count| count > 0 && bytes.len() as u64 == 84 + 50 * u64::from(count)) {
        return other(
            "an STL file: a surface without the camera's pixels",
            "take a scan of the part instead; a scan has one point for each pixel",
        );
    }
    let Ok(text) =
        std::str::from_utf8(&head[..head.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1)])
    else {
        return Ok(());
    };
    if text.trim_start().starts_with("solid ") {
        return other(
            "an STL file: a surface without the camera's pixels",
            "take a scan of the part instead; a scan has one point for each pixel",
        );
    }
    if is_number_table(text) {
        return other("a list of points (.xyz, .csv) without the pixel of each point", EXPORT_ORDERED_CLOUD);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_kinds_of_files_are_named_with_a_remedy() {
        let words = |bytes: &[u8]| check_kind(bytes).expect_err("refused").to_string();
        assert!(words(b"\x89HDF\r\n\x1a\n    ").contains("Zivid"));
        let mut stl = vec![0; 80];
        stl.extend(1_u32.to_le_bytes());
        stl.extend([0; 50]);
        assert!(words(&stl).contains("STL"));
        assert!(words(b"solid part\n facet normal 0 0 1\n").contains("STL"));
        for text in ["1 2 3\n4 5 6\n7 8 9\n", "x,y,z,r\n1,2,3,4\n1.5,2,3,4\n"] {
            assert!(words(text.as_bytes()).contains("ordered"), "{text}");
        }
        for right in
            [&b"ply\nformat ascii 1.0\nelement vertex 3\n"[..], b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\n", b""]
        {
            assert_eq!(check_kind(right), Ok(()));
        }
    }
}
