//! The result of a measurement of a 3D camera's errors.

use super::parts::PictureParts;
use panelprep_base::geometry::DepthField;

/// The measured errors of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ScannerErrors {
    /// White noise of a pixel at the reference depth, standard deviation, mm.
    pub white_mm: f64,
    /// The smooth error of one scan, after the correction if there is one: standard deviation, mm.
    pub smooth_mm: f64,
    /// Side of the squares within which the smooth error is the same, mm.
    pub correlation_mm: f64,
    /// The 95 % interval of `correlation_mm`, mm.
    pub correlation_interval_mm: [f64; 2],
    /// The longest length that the boards can show, their diagonal, mm.
    pub board_mm: f64,
    /// The rms deviation from the plane in scans that were left out, without a correction, mm.
    pub left_out_uncorrected_mm: f64,
    /// The rms deviation in left-out scans with the correction from the other scans, mm; `None` if the correction is
    /// not better.
    pub left_out_corrected_mm: Option<f64>,
    /// The correction; `None` if no error is the same in each scan.
    pub field: Option<DepthField>,
    /// The correction's largest amount at the reference depth, at the positions of boards, mm.
    pub max_field_mm: f64,
    /// Bow of the board over half of its diagonal, mm.
    pub bow_mm: f64,
    /// The ratio of measured to printed distances, minus one, percent: the mean over scans.
    pub scale_percent: f64,
    /// Standard deviation of the scale from scan to scan beyond what the smooth error explains, percent.
    pub scale_deviation_percent: f64,
    /// The parts of the picture.
    pub parts: PictureParts,
    /// Share of the picture in which at least two scans show the board.
    pub covered_share: f64,
    /// Depths of the boards' middles, least and greatest, mm.
    pub depths_mm: [f64; 2],
    /// The largest difference of the board's rotations in its plane, degrees.
    pub turned_deg: f64,
    /// The rms residual of the board's plane after the correction, for each scan, mm.
    pub residuals_mm: Vec<f64>,
}
