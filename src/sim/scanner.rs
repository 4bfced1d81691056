//! A shot of the 3D camera: points with their noise, and the colour picture on the same pixels; and the error of a poorly
//! calibrated 3D camera.
//!
//! A pixel has a point if the projector lights the surface that the pixel sees (`projector`). Noise along the ray:
//! white, σ = 0.055 mm · (z / 700 mm)² / cos(incidence); on the panel also correlated, value noise of 0.06 mm rms
//! at the nodes of a square lattice of 50–85 mm, drawn anew for each shot. At the panel's edge a tenth of the
//! pixels flies between panel and background if both are lit, and most others are missing; 0.2 % drop out anywhere.
//!
//! The error of a poor calibration is a smooth error of 1/z over the picture, the same in each scan. With the picture's half
//! width and half height as units, the depth error at 700 mm is
//!     c = A (X² − 0.6 Y² + 0.5 sin(2.2 X + 1.3 Y + φ)),   1/z_measured = 1/z − c / (700 mm)²,
//! a bow with opposite signs along X and Y, and a wave added to it. Zivid states a dimension trueness of 0.2 %, and
//! 0.06 mm of local planarity, for the Two M70; public scans of a poorly calibrated camera bow by 1.5 to 3.4 mm. The
//! program does not use this formula.

use super::appearance::dry_and_wet;
use super::cast::{CastView, PanelHit, PixelHit};
use super::noise::{NormalStream, PIXEL_NOISE_GRAY, PixelNoise, RandomPurpose, Seed, ValueNoise, to_bytes};
use super::projector;
use super::projector::Projector;
use panelprep_base::geometry::{Camera, OrganizedCloud};
use rand::RngExt;
use rayon::prelude::*;

const WHITE_MM: f64 = 0.055;
const WHITE_AT_MM: f64 = 700.0;
const CORRELATED_MM: f64 = 0.06;
const LATTICE_MM: std::ops::Range<f64> = 50.0..85.0;
/// Half the side of the square that the lattice covers: more than the largest panel.
pub(super) const LATTICE_HALF_WIDTH_MM: f64 = 260.0;
/// A pixel nearer than this to the panel's edge sees both sides, px.
const EDGE_PX: f64 = 1.0;
const FLYING_SHARE: f64 = 0.10;
const EDGE_MISSING_SHARE: f64 = 0.75;
const DROPOUT_SHARE: f64 = 0.002;

/// The simulator's noise, for reports.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct NoiseFigures {
    /// White range noise at 700 mm, square to the surface, mm.
    pub range_white_mm: f64,
    /// Correlated range noise at the nodes of its lattice, rms, mm.
    pub range_correlated_mm: f64,
    /// Smallest and largest spacing of that lattice, mm.
    pub range_lattice_mm: [f64; 2],
    /// Share of the edge's pixels with a flying point.
    pub edge_flying_share: f64,
    /// Share of the edge's pixels without a point.
    pub edge_missing_share: f64,
    /// Share of all other pixels without a point.
    pub drop_out_share: f64,
    /// Distance from the camera to its projector, mm: a surface that only one of the two sees has no points.
    pub projector_baseline_mm: f64,
    /// An object that is nearer to the projector than a point by this share of the point's depth throws a shadow on
    /// the point.
    pub projector_shadow_share: f64,
    /// Pixel noise of both cameras, grey levels.
    pub pixel_gray: f64,
}

/// The noise of every rendered shot.
pub fn scanner_noise() -> NoiseFigures {
    NoiseFigures {
        range_white_mm: WHITE_MM,
        range_correlated_mm: CORRELATED_MM,
        range_lattice_mm: [LATTICE_MM.start, LATTICE_MM.end],
        edge_flying_share: FLYING_SHARE,
        edge_missing_share: EDGE_MISSING_SHARE,
        drop_out_share: DROPOUT_SHARE,
        projector_baseline_mm: projector::baseline_mm(),
        projector_shadow_share: projector::SHADOW_SHARE,
        pixel_gray: PIXEL_NOISE_GRAY,
    }
}

/// Makes a shot; `shot` is its own seed.
pub(super) fn capture(
    view: &CastView<'_>,
    projector: &Projector<'_>,
    pixels: &PixelNoise,
    shot: Seed,
) -> OrganizedCloud<Camera> {
    let (width, height) = (view.width(), view.height());
    let mut points = vec![[f32::NAN; 3]; width * height];
    let mut colors = vec![[0_u8; 3]; width * height];
    let correlated = correlated_noise(shot, None);
    let rows = points.par_chunks_mut(width).zip(colors.par_chunks_mut(width)).enumerate();
    rows.for_each(|(row, (points, colors))| {
        let mut normal = NormalStream::new(shot.stream(RandomPurpose::ScanRow, row as u64));
        let noise = pixels.row(shot, row, width);
        view.cast_row(row, |column, sight| {
            let (dry, _) = dry_and_wet(&sight);
            colors[column] = to_bytes(dry, noise, column);
            if let Some(point) = measured(&sight, projector, &correlated, &mut normal) {
                points[column] = point;
            }
        });
    });
    match OrganizedCloud::new(width, height, points, colors) {
        Ok(cloud) => cloud,
        Err(error) => unreachable!("one point and one colour a pixel were made: {error}"),
    }
}

/// Draws the correlated noise of a shot, in units of its rms, on a lattice of this spacing, mm. `None` selects the
/// camera's usual spacing.
pub(super) fn correlated_noise(shot: Seed, spacing_mm: Option<f64>) -> ValueNoise {
    let usual_mm = || shot.stream(RandomPurpose::Scan, 0).random_range(LATTICE_MM);
    let lattice_mm = spacing_mm.unwrap_or_else(usual_mm);
    ValueNoise::new(shot.stream(RandomPurpose::Scan, 1), lattice_mm, LATTICE_HALF_WIDTH_MM)
}

/// Computes the range error of a pixel that looks square at a surface, mm, from its white and its correlated noise
/// in units of their rms.
pub(super) fn range_error_mm(white: f64, depth_mm: f64, correlated: f64) -> f64 {
    white * WHITE_MM * (depth_mm / WHITE_AT_MM).powi(2) + CORRELATED_MM * correlated
}

/// A lit surface on which a ray may end.
struct Surface {
    depth_mm: f64,
    cos_incidence: f64,
    correlated_mm: f64,
}

impl Surface {
    fn from_panel_hit(
        sight: &PixelHit,
        panel: &PanelHit,
        projector: &Projector<'_>,
        correlated: &ValueNoise,
    ) -> Option<Self> {
        projector.is_lit(&(sight.ray * panel.depth_mm), Some(panel)).then(|| Surface {
            depth_mm: panel.depth_mm,
            cos_incidence: panel.cos_incidence,
            correlated_mm: CORRELATED_MM * correlated.value_at(panel.place),
        })
    }

    fn from_background(sight: &PixelHit, projector: &Projector<'_>) -> Option<Self> {
        let depth_mm = sight.background.depth_mm?;
        projector.is_lit(&(sight.ray * depth_mm), None).then_some(Surface {
            depth_mm,
            cos_incidence: sight.background.cos_incidence,
            correlated_mm: 0.0,
        })
    }
}

/// Returns the point that a pixel measures.
pub(super) fn measured(
    sight: &PixelHit,
    projector: &Projector<'_>,
    correlated: &ValueNoise,
    normal: &mut NormalStream,
) -> Option<[f32; 3]> {
    // Drawn for every pixel, so that the surface seen by one pixel does not change the noise of the next.
    let (white, chance, between) = (normal.next(), normal.share(), normal.share());
    let near = sight.panel.filter(|panel| panel.edge_px < EDGE_PX);
    let at_edge = near.is_some_and(|panel| panel.edge_px > -EDGE_PX);
    let missing = if at_edge { FLYING_SHARE..FLYING_SHARE + EDGE_MISSING_SHARE } else { 0.0..DROPOUT_SHARE };
    if missing.contains(&chance) {
        return None;
    }
    let surface = match near {
        Some(panel) if at_edge && chance < FLYING_SHARE => {
            let own = Surface::from_panel_hit(sight, &panel, projector, correlated)?;
            let behind = Surface::from_background(sight, projector)?;
            Surface { depth_mm: own.depth_mm + between * (behind.depth_mm - own.depth_mm), ..own }
        }
        Some(panel) if panel.edge_px < 0.0 => Surface::from_panel_hit(sight, &panel, projector, correlated)?,
        _ => Surface::from_background(sight, projector)?,
    };
    let scale = surface.depth_mm / WHITE_AT_MM;
    let along_ray_mm = white * WHITE_MM * scale * scale / surface.cos_incidence + surface.correlated_mm;
    let point = sight.ray * (surface.depth_mm + along_ray_mm / sight.ray.norm());
    Some([point.x as f32, point.y as f32, point.z as f32])
}

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
