//! The known errors of the 3D camera: measured with `panelprep calibrate scanner`, or assumed.

use panelprep_base::geometry::{Camera, DepthField, OrganizedCloud, Point};
use panelprep_base::number_text::fixed_decimals;
use panelprep_cell::cell::MeasuredScanner;
use std::f64::consts::SQRT_2;

/// The smooth errors of scans, which are common to many points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeErrors {
    /// Correlation length of the errors: side of the squares within which they are correlated, mm.
    pub correlation_mm: f64,
    /// Standard deviation of the mean of a surface residual between two scans, over a square with the side
    /// `correlation_mm`, mm.
    pub scan_to_scan_mm: f64,
    /// Standard deviation of the taught scan's error at a point of the outline, mm. The error is along the taught rays,
    /// so it appears sideways from another view.
    pub taught_scan_mm: f64,
    /// Standard deviation of the scale error that all scans have in common: the relative error of the camera's
    /// distances.
    pub scale: f64,
    /// Standard deviation of the relative scale error that differs from scan to scan.
    pub scan_to_scan_scale: f64,
    /// Whether the errors were measured.
    pub is_measured: bool,
}

/// Ratio of the error of a point to the error of the mean over a square.
const POINT_TO_MEAN_ERROR: f64 = 1.5;

impl Default for RangeErrors {
    /// Returns the errors that are assumed without a measurement. They apply to scans of a smooth panel by a Zivid Two:
    /// its maker states a local planarity of 0.06 mm. The maker also states a dimension trueness of 0.2 %, which is
    /// treated as two standard deviations of the common scale error. No maker states the correlation length of the
    /// errors: with 85 mm the stated uncertainty is correct for lengths up to 120 mm (`make bench-locate`,
    /// `correlated`).
    fn default() -> Self {
        RangeErrors {
            correlation_mm: 85.0,
            scan_to_scan_mm: 0.085,
            taught_scan_mm: 0.09,
            scale: 0.001,
            scan_to_scan_scale: 0.0,
            is_measured: false,
        }
    }
}

impl RangeErrors {
    /// Returns the standard deviation of the smooth error of one scan at a point, mm.
    pub fn point_mm(&self) -> f64 {
        POINT_TO_MEAN_ERROR * self.scan_to_scan_mm / SQRT_2
    }

    /// Returns a description of the errors, as text for a person.
    pub fn describe(&self) -> String {
        let smooth_mm = fixed_decimals(self.scan_to_scan_mm / SQRT_2, 3);
        let over_mm = fixed_decimals(self.correlation_mm, 0);
        let scale = fixed_decimals(100.0 * self.scale, 3);
        match self.is_measured {
            true => {
                let between = fixed_decimals(100.0 * self.scan_to_scan_scale, 3);
                format!(
                    "measured: smooth error of a scan {smooth_mm} mm, correlation length {over_mm} mm; scale error \
                     {scale} %, variation of the scale from scan to scan {between} %"
                )
            }
            false => format!(
                "not measured, assumed: smooth error of a scan {smooth_mm} mm, correlation length {over_mm} mm; \
                 scale error {scale} %"
            ),
        }
    }
}

/// All errors of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScanErrors {
    /// The errors that differ from scan to scan.
    pub range: RangeErrors,
    /// The smooth error that is the same in each scan and is corrected; `None` if it is not known.
    pub field: Option<DepthField>,
    /// Ratio of measured to true distances, minus one, the same in all scans; corrected as well. 0 if it is not known.
    pub scale_error: f64,
}

/// Relative standard uncertainty of the length of the printed board with which the scale was measured. Measured with a
/// caliper, 0.1 mm of 200 mm is two standard deviations.
const BOARD_LENGTH_UNCERTAINTY: f64 = 0.000_25;

impl ScanErrors {
    /// Returns the errors as measured, or the defaults if there was no measurement.
    pub fn from_measured(measured: Option<&MeasuredScanner>) -> Self {
        let Some(measured) = measured else { return ScanErrors::default() };
        let range = RangeErrors {
            correlation_mm: measured.correlation_mm,
            scan_to_scan_mm: SQRT_2 * measured.smooth_mm,
            taught_scan_mm: POINT_TO_MEAN_ERROR * measured.smooth_mm,
            // The corrected scale refers to the stated size of the board's squares, which is not verified here.
            // Therefore the whole correction is included, in addition to the errors of the board length and of the
            // measurement.
            scale: (measured.scale_percent / 100.0)
                .hypot(BOARD_LENGTH_UNCERTAINTY)
                .hypot(measured.scale_deviation_percent / 100.0 / (measured.board_positions.max(1) as f64).sqrt()),
            scan_to_scan_scale: measured.scale_deviation_percent / 100.0,
            is_measured: true,
        };
        ScanErrors { range, field: measured.field, scale_error: measured.scale_percent / 100.0 }
    }

    /// Corrects the errors that are the same in each scan: the smooth field, and the scale.
    pub fn correct_scan(&self, scan: OrganizedCloud<Camera>) -> OrganizedCloud<Camera> {
        if self.field.is_none() && self.scale_error == 0.0 {
            return scan;
        }
        let scale = 1.0 / (1.0 + self.scale_error);
        scan.scaled_along_rays(|mm| scale * self.field.as_ref().map_or(1.0, |field| field.correction_factor(mm)))
    }

    /// Corrects the same errors in a single point of a scan.
    pub fn corrected_point(&self, point: Point<Camera>) -> Point<Camera> {
        let along = self.field.as_ref().map_or(point, |field| field.corrected_point(point));
        Point::new(along.mm / (1.0 + self.scale_error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cell::Provenance;

    /// Expected value, calculated by hand: a camera whose distances are 0.2 % too long shows a point at 701.4 mm that
    /// is 700 mm away.
    #[test]
    fn a_measured_scale_error_is_removed() {
        let measured = MeasuredScanner {
            white_mm: 0.05,
            smooth_mm: 0.06,
            correlation_mm: 85.0,
            scale_percent: 0.2,
            scale_deviation_percent: 0.04,
            board_positions: 16,
            field: None,
            date: None,
            provenance: Provenance::default(),
        };
        let errors = ScanErrors::from_measured(Some(&measured));
        let cloud = OrganizedCloud::new(2, 2, vec![[10.02, 0.0, 701.4]; 4], vec![[0; 3]; 4]).expect("four points");
        let point = errors.correct_scan(cloud).point_at(0).expect("there").mm;
        assert!((point.z - 700.0).abs() < 1e-3 && (point.x - 10.0).abs() < 1e-3, "{point}");
        assert!((errors.corrected_point(Point::at(0.0, 0.0, 701.4)).mm.z - 700.0).abs() < 1e-9);
        // Expected value, calculated by hand: 0.04 % over sixteen positions is 0.01 %, in addition to the 0.025 % of
        // the board and the corrected 0.2 %.
        assert!((errors.range.scale - 0.002_f64.hypot(0.000_25).hypot(0.000_1)).abs() < 1e-12);
        assert_eq!(ScanErrors::default().scale_error, 0.0);
    }
}
