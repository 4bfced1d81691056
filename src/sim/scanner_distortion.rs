//! The error of a poorly calibrated 3D camera in each of its scans: a smooth error of 1/z over its picture, the same
//! each time.
//!
//! With the picture's half width and half height as units, the depth error at 700 mm is
//!     c = A (X² − 0.6 Y² + 0.5 sin(2.2 X + 1.3 Y + φ)),   1/z_measured = 1/z − c / (700 mm)²,
//! a bow with opposite signs along X and Y, and a wave added to it. Zivid states a dimension trueness of 0.2 %, and
//! 0.06 mm of local planarity, for the Two M70; public scans of a poorly calibrated camera bow by 1.5 to 3.4 mm. The
//! program does not use this formula.

use panelprep_base::geometry::{Camera, OrganizedCloud};

const REFERENCE_DEPTH_OF_DISTORTION_MM: f64 = 700.0;
const HALF: [f64; 2] = [0.54, 0.33];

/// The error of one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScannerDistortion {
    /// A, mm.
    pub depth_mm: f64,
    /// φ, rad.
    pub phase: f64,
}

impl ScannerDistortion {
    /// Creates a camera's error; each seed gives a different camera.
    pub fn new(seed: u64, depth_mm: f64) -> Self {
        ScannerDistortion { depth_mm, phase: (seed % 628) as f64 / 100.0 }
    }

    /// Computes c for a direction (X/Z, Y/Z), mm.
    pub fn distortion_at_mm(&self, [x, y]: [f64; 2]) -> f64 {
        let (x, y) = (x / HALF[0], y / HALF[1]);
        self.depth_mm * (x * x - 0.6 * y * y + 0.5 * (2.2 * x + 1.3 * y + self.phase).sin())
    }

    /// Returns the scan as this camera measures it.
    pub fn distort_scan(&self, scan: &OrganizedCloud<Camera>) -> OrganizedCloud<Camera> {
        scan.scaled_along_rays(|[x, y, z]| {
            1.0 / (1.0
                - z * self.distortion_at_mm([x / z, y / z])
                    / (REFERENCE_DEPTH_OF_DISTORTION_MM * REFERENCE_DEPTH_OF_DISTORTION_MM))
        })
    }
}
