//! Reasons why bytes are not an organised cloud.

use panelprep_base::geometry::{CloudError, PinholeCamera};

/// The reason why a PCD or PLY file was refused: the position, what was found, what is allowed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CloudFileError {
    /// The file has neither a PCD nor a PLY header.
    #[error(
        "the file is neither a PCD nor a PLY file: it has no header that ends in a line '{end}' (searched {searched} \
         bytes)"
    )]
    NotACloud {
        /// The text with which the header's last line begins.
        end: &'static str,
        /// Bytes searched.
        searched: usize,
    },
    /// A file of another kind, as its first bytes show.
    #[error("the file is {kind}: {remedy}")]
    OtherKind {
        /// Kind of the file.
        kind: &'static str,
        /// Remedy.
        remedy: &'static str,
    },
    /// A header line that cannot be read.
    #[error("header line {line}, '{found}': {problem}")]
    Header {
        /// Line, from 1.
        line: usize,
        /// The line found.
        found: String,
        /// The problem in the line.
        problem: String,
    },
    /// A required field is missing or has another type.
    #[error("field {name}: found {found}; valid: {allowed}")]
    Field {
        /// The field's name in the file's format.
        name: &'static str,
        /// The type in the file.
        found: String,
        /// Fields and types that are read.
        allowed: &'static str,
    },
    /// The file contains an unorganised list of points instead of one point for each pixel.
    #[error(transparent)]
    Organized(#[from] CloudError),
    /// The number of points does not agree with the size of the picture.
    #[error(
        "the header states {points} points for a picture of {width}×{height}; export an ordered cloud, one point for \
         each pixel"
    )]
    Count {
        /// Number of points counted.
        points: u64,
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
    },
    /// More data than any camera delivers.
    #[error(
        "the header states {points} points of {point_bytes} bytes (limits {limit_point_bytes} bytes per point, \
         {limit_bytes} bytes in total); export the cloud with positions and colours only"
    )]
    TooLarge {
        /// Number of points counted.
        points: u64,
        /// Bytes of one point; for a text file, of its numbers.
        point_bytes: u64,
        /// Largest data section.
        limit_bytes: u64,
        /// Largest point.
        limit_point_bytes: u64,
    },
    /// The file ends before the last point.
    #[error("the file is truncated: {needed} bytes of points from byte {start} on were expected, found {found}")]
    Truncated {
        /// The byte where the data begin.
        start: usize,
        /// Bytes that the header requires.
        needed: usize,
        /// Number of bytes in the file.
        found: usize,
    },
    /// The text ends before the last point.
    #[error("the file is truncated: {needed} points were expected, found {found}")]
    TooFewLines {
        /// Points that the header requires.
        needed: usize,
        /// Number of points in the file.
        found: usize,
    },
    /// Additional data follow the last point.
    #[error("{found} bytes follow the last point, from byte {start} on: header and data disagree")]
    Trailing {
        /// First byte after the points.
        start: usize,
        /// Number of surplus bytes.
        found: usize,
    },
    /// A point that cannot be read.
    #[error("line {line}: {problem}")]
    Point {
        /// Line, from 1.
        line: usize,
        /// The problem in the point.
        problem: String,
    },
    /// Compressed data that cannot be unpacked.
    #[error("the compressed data from byte {start} on cannot be unpacked: {problem}")]
    Compressed {
        /// The byte where the compressed data begin.
        start: usize,
        /// The problem in the data.
        problem: String,
    },
    /// A list of points that does not state the width of its picture.
    #[error(
        "neither the file nor a calibration states the width and height of the cloud's picture: write the lines \
         'comment width W' and 'comment height H' into the file's header, or name a cell whose [calibration] has this \
         scanner"
    )]
    NoSize,
    /// The cloud is not from the calibrated camera.
    #[error("the cloud is {width}×{height} px, but the camera's calibration is for {width_px}×{height_px} px")]
    Size {
        /// Columns found.
        width: usize,
        /// Rows found.
        height: usize,
        /// Columns of the calibrated camera.
        width_px: usize,
        /// Rows of the calibrated camera.
        height_px: usize,
    },
    /// Numbers in metres.
    #[error("the depths of the points are from {from} to {to}: these values are metres; export the cloud in mm")]
    Metres {
        /// Nearest depth.
        from: String,
        /// Farthest depth.
        to: String,
    },
    /// The coordinates are in another unit.
    #[error(
        "the depths of the points are from {from} to {to}, but a 3D camera measures from 150 to 5000 mm: the unit is \
         probably cm, inch or µm; export the cloud in mm"
    )]
    OtherUnit {
        /// Nearest depth.
        from: String,
        /// Farthest depth.
        to: String,
    },
    /// Points behind the camera.
    #[error(
        "most points are behind the camera (z from {from} to {to} mm): the cloud has OpenGL's axes (y up, z \
         backwards), or is in another frame; export it in the camera's own frame, with z pointing forwards"
    )]
    Behind {
        /// Smallest z.
        from: String,
        /// Largest z.
        to: String,
    },
    /// The points are in another order than the pixels.
    #[error(
        "the points are in another order than this camera's pixels, {order}: export the cloud as the camera took \
         it, row by row from the top left"
    )]
    OtherOrder {
        /// The exchanged order.
        order: &'static str,
    },
    /// The points are those of another lens.
    #[error(
        "half of the points are {off_px} px or more from the pixels that the calibration predicts: they are on the \
         rays of another lens ({own}; the calibration states {stated}). Name the calibration of the camera that took \
         this scan, or compute it from the scan: panelprep calibrate intrinsics --from-scan"
    )]
    OtherLens {
        /// Deviation of the points from the rays of their pixels, px.
        off_px: String,
        /// The parameters of the lens on whose rays the points lie.
        own: String,
        /// The parameters of the calibrated lens.
        stated: String,
    },
    /// The points are not in a camera's frame.
    #[error(
        "half of the points are {off_px} px or more from the rays of their pixels, and no lens explains the deviation: \
         the cloud is in another frame (such as the robot's base), or was smoothed or moved. Export the unmodified \
         cloud in the camera's own frame"
    )]
    OtherFrame {
        /// Deviation of the points from the rays of their pixels, px.
        off_px: String,
    },
    /// Points that do not lie on the rays of their pixels, although the others do.
    #[error(
        "{points} points are not on the rays of their pixels, but all others are; the first of these points has the \
         pixel ({column}, {row}): the file was changed after the scan. Export or copy the file again"
    )]
    OffRays {
        /// Number of points.
        points: usize,
        /// Column of the first such point.
        column: usize,
        /// Row of the first such point.
        row: usize,
    },
}

/// Refuses a cloud that is not from the calibrated camera, by the size in its header.
pub(super) fn check_cloud_size((width, height): (u64, u64), camera: &PinholeCamera) -> Result<(), CloudFileError> {
    let (width, height) = (width as usize, height as usize);
    match (width, height) == (camera.width_px, camera.height_px) {
        true => Ok(()),
        false => {
            Err(CloudFileError::Size { width, height, width_px: camera.width_px, height_px: camera.height_px })
        }
    }
}
