//! What a measurement of a 3D camera's errors finds.

use super::parts::PictureParts;
use crate::geometry::DepthField;

/// What was found of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ScannerErrors {
    /// White noise of a pixel at the reference depth, standard deviation, mm.
    pub white_mm: f64,
    /// The smooth error of one scan, after the correction if there is one: standard deviation, mm.
    pub smooth_mm: f64,
    /// Over squares of this side it is alike, mm.
    pub correlation_mm: f64,
    /// The same, 95 %.
    pub correlation_between_mm: [f64; 2],
    /// The longest length that the boards can show, their diagonal, mm.
    pub board_mm: f64,
    /// What scans that were left out are off the plane, rms, mm, without a correction.
    pub left_out_plain_mm: f64,
    /// The same with the correction by the other scans, if that is better.
    pub left_out_corrected_mm: Option<f64>,
    /// The correction; `None` if no error is the same in each scan.
    pub field: Option<DepthField>,
    /// Its largest amount at the reference depth at the places of boards, mm.
    pub field_most_mm: f64,
    /// Bow of the board over half of its diagonal, mm.
    pub bow_mm: f64,
    /// Measured over printed distances, less one, percent: the mean over scans.
    pub scale_percent: f64,
    /// Its standard deviation from scan to scan beyond what the smooth error explains, percent.
    pub scale_deviation_percent: f64,
    /// The parts of the picture.
    pub parts: PictureParts,
    /// Share of the picture in which at least two scans have the board.
    pub covered: f64,
    /// Depths of the boards' middles, least and greatest, mm.
    pub depths_mm: [f64; 2],
    /// Between which angles the board was turned in its plane, degrees.
    pub turned_deg: f64,
    /// The boards' planes, rms of what is left after the correction, each scan, mm.
    pub residuals_mm: Vec<f64>,
}
