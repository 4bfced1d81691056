//! What is known of the 3D camera's own errors: measured by `panelprep calibrate scanner`, or assumed.

use crate::cell::MeasuredScanner;
use crate::geometry::{Camera, DepthField, OrganizedCloud, Point};
use crate::words::fixed;
use std::f64::consts::SQRT_2;

/// The smooth errors of scans, which many points share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeErrors {
    /// Over squares of this side they are alike, mm.
    pub correlation_mm: f64,
    /// Of a surface residual between two scans, one standard deviation of such a square's mean, mm.
    pub between_scans_mm: f64,
    /// Of the taught scan alone at a point of the outline: it lies so far off along the taught rays, which another
    /// view shows aside, mm.
    pub of_taught_mm: f64,
    /// The camera's distances are too long or too short by this share in each scan alike, one standard deviation.
    pub scale: f64,
    /// The same, from scan to scan.
    pub scale_between_scans: f64,
    /// Were they measured?
    pub is_measured: bool,
}

/// The error of a point is this many times that of a square's mean.
const POINT: f64 = 1.5;

impl Default for RangeErrors {
    /// Without a measurement: what a Zivid Two's scans of a smooth panel show, 0.06 mm of local planarity by its
    /// maker; who also states 0.2 % of dimension trueness, which is taken as two standard deviations that all scans
    /// share. No maker states over which length errors are alike: with 85 mm what is stated holds up to 120 mm
    /// (`make bench-locate`, `correlated`).
    fn default() -> Self {
        RangeErrors {
            correlation_mm: 85.0,
            between_scans_mm: 0.085,
            of_taught_mm: 0.09,
            scale: 0.001,
            scale_between_scans: 0.0,
            is_measured: false,
        }
    }
}

impl RangeErrors {
    /// For a person.
    pub fn words(&self) -> String {
        let smooth_mm = fixed(self.between_scans_mm / SQRT_2, 3);
        let over_mm = fixed(self.correlation_mm, 0);
        let scale = fixed(100.0 * self.scale, 3);
        match self.is_measured {
            true => {
                let between = fixed(100.0 * self.scale_between_scans, 3);
                format!(
                    "measured: {smooth_mm} mm a scan, alike over {over_mm} mm; distances off by {scale} %, {between} % from scan to scan"
                )
            }
            false => format!(
                "not measured, assumed as {smooth_mm} mm a scan, alike over {over_mm} mm; distances off by {scale} \
                 %"
            ),
        }
    }
}

/// All of them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScanErrors {
    /// What differs from scan to scan.
    pub range: RangeErrors,
    /// The part that is the same in each scan and is removed; `None` if it is not known.
    pub field: Option<DepthField>,
    /// Measured over true distances, less one, in all scans alike: removed too; 0 if it is not known.
    pub scale_off: f64,
}

/// The printed board that the scale was measured by is itself known to this share, one standard deviation: 0.1 mm
/// of 200 mm by a caliper is two of them.
const BOARD_SHARE: f64 = 0.000_25;

impl ScanErrors {
    /// The errors as measured, if there was a measurement.
    pub fn from_measured(measured: Option<&MeasuredScanner>) -> Self {
        let Some(measured) = measured else { return ScanErrors::default() };
        let range = RangeErrors {
            correlation_mm: measured.correlation_mm,
            between_scans_mm: SQRT_2 * measured.smooth_mm,
            of_taught_mm: POINT * measured.smooth_mm,
            // The scale that is taken off is that of the board's stated squares, which nothing here proves: it is
            // counted whole, beside the board's own length and the measurement.
            scale: (measured.scale_percent / 100.0)
                .hypot(BOARD_SHARE)
                .hypot(measured.scale_deviation_percent / 100.0 / (measured.places.max(1) as f64).sqrt()),
            scale_between_scans: measured.scale_deviation_percent / 100.0,
            is_measured: true,
        };
        ScanErrors { range, field: measured.field, scale_off: measured.scale_percent / 100.0 }
    }

    /// The scan without what is the same in each: the smooth field, and the scale.
    pub fn corrected(&self, scan: OrganizedCloud<Camera>) -> OrganizedCloud<Camera> {
        if self.field.is_none() && self.scale_off == 0.0 {
            return scan;
        }
        let scale = 1.0 / (1.0 + self.scale_off);
        scan.along_rays(|mm| scale * self.field.as_ref().map_or(1.0, |field| field.factor(mm)))
    }

    /// A point of a scan likewise.
    pub fn corrected_point(&self, point: Point<Camera>) -> Point<Camera> {
        let along = self.field.as_ref().map_or(point, |field| field.corrected_point(point));
        Point::new(along.mm / (1.0 + self.scale_off))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Provenance;

    /// By hand: a camera that measures 0.2 % too long has a point at 701.4 mm that is 700 mm away.
    #[test]
    fn a_measured_scale_is_taken_off() {
        let measured = MeasuredScanner {
            white_mm: 0.05,
            smooth_mm: 0.06,
            correlation_mm: 85.0,
            scale_percent: 0.2,
            scale_deviation_percent: 0.04,
            places: 16,
            field: None,
            date: None,
            provenance: Provenance::default(),
        };
        let errors = ScanErrors::from_measured(Some(&measured));
        let cloud = OrganizedCloud::new(2, 2, vec![[10.02, 0.0, 701.4]; 4], vec![[0; 3]; 4]).expect("four points");
        let point = errors.corrected(cloud).point_at(0).expect("there").mm;
        assert!((point.z - 700.0).abs() < 1e-3 && (point.x - 10.0).abs() < 1e-3, "{point}");
        assert!((errors.corrected_point(Point::at(0.0, 0.0, 701.4)).mm.z - 700.0).abs() < 1e-9);
        // 0.04 % over sixteen places is 0.01 %, beside the board's own 0.025 % and the 0.2 % that were taken off.
        assert!((errors.range.scale - 0.002_f64.hypot(0.000_25).hypot(0.000_1)).abs() < 1e-12);
        assert_eq!(ScanErrors::default().scale_off, 0.0);
    }
}
