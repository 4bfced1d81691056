//! What is known of the 3D camera's own errors: measured by `panelprep calibrate scanner`, or assumed.

use crate::cell::MeasuredScanner;
use crate::geometry::{Camera, DepthField, OrganizedCloud};
use crate::words::fixed;
use std::f64::consts::SQRT_2;

/// The smooth errors of scans, which many points share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeErrors {
    /// Over squares of this side they are alike, mm.
    pub correlation_mm: f64,
    /// Of a surface residual between two scans, one standard deviation of such a square's mean, mm.
    pub between_scans_mm: f64,
    /// Of the taught scan alone at a point of the outline: it lies so far off along the taught rays, which another view shows
    /// aside, mm.
    pub of_taught_mm: f64,
    /// The camera's distances are too long or too short by this share in each scan alike, one standard deviation.
    pub scale: f64,
    /// The same, from scan to scan.
    pub scale_between_scans: f64,
    /// Were they measured?
    pub is_measured: bool,
}

/// A point is off by so many times what a square's mean is.
const POINT: f64 = 1.5;

impl Default for RangeErrors {
    /// Without a measurement: what a Zivid Two's scans of a smooth panel show, 0.06 mm of local planarity by its maker; who
    /// also states 0.2 % of dimension trueness, which is taken as two standard deviations that all scans share. No maker states over
    /// which length errors are alike: with 85 mm what is stated holds up to 120 mm (`make bench-locate`, `correlated`).
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
                "not measured, taken as {smooth_mm} mm a scan, alike over {over_mm} mm; distances off by {scale} %"
            ),
        }
    }
}

/// All of them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScanErrors {
    /// What differs from scan to scan.
    pub range: RangeErrors,
    /// What is the same in each scan and is taken off; none where it is not known.
    pub field: Option<DepthField>,
}

impl ScanErrors {
    /// As measured, where that was done.
    pub fn of(measured: Option<&MeasuredScanner>) -> Self {
        let Some(measured) = measured else { return ScanErrors::default() };
        let range = RangeErrors {
            correlation_mm: measured.correlation_mm,
            between_scans_mm: SQRT_2 * measured.smooth_mm,
            of_taught_mm: POINT * measured.smooth_mm,
            scale: measured.scale_percent.abs() / 100.0,
            scale_between_scans: measured.scale_deviation_percent / 100.0,
            is_measured: true,
        };
        ScanErrors { range, field: measured.field }
    }

    /// The scan without what is the same in each.
    pub fn corrected(&self, scan: OrganizedCloud<Camera>) -> OrganizedCloud<Camera> {
        match &self.field {
            Some(field) => field.corrected(&scan),
            None => scan,
        }
    }
}
