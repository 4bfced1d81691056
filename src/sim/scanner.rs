//! The 3D camera: its projector, a scan with noise and the colour picture on the same pixels, and the error of a poorly
//! calibrated camera.
//!
//! A pixel has a point if the projector lights the surface that the pixel sees. The noise along the ray is white with σ
//! = 0.055 mm · (z / 700 mm)² / cos(incidence). On the panel, correlated noise is added: value noise of 0.06 mm rms at
//! the nodes of a square lattice of 50–85 mm, drawn anew for each scan. At the panel's edge a tenth of the pixels have
//! a flying point between panel and background if both are lit, and most others are missing. Of all other points, 0.2 %
//! are missing.
//!
//! A Zivid measures a point only if both its camera and its projector see the point. The projector of a Two M70 is b =
//! 111 mm to the right of the lens and is rotated by 0.113 rad towards the camera's axis. A pixel has no point if its
//! surface
//! - lies outside of the projector's picture,
//! - faces away from the projector, or
//! - is in shadow: another object is on the line to the projector, nearer to it by over 0.5 % of the depth.
//!
//! An object whose edge is at the distance d in front of a wall at the depth z leaves a strip of the wall without
//! points, with the width
//!     w ≈ b d / (z − d),                                                                                  (1)
//! on the side that faces away from the projector. The colours come from the room's light and have no such shadows.
//!
//! Lines of sight are intersected with the surfaces themselves, not with a depth map. Therefore edges are not jagged,
//! and no slanted surface is in its own shadow. Not simulated: penumbras, light reflected between surfaces, and the
//! panel's shadow on itself, because the panel is too shallow for it. Source of the geometry and the shadow rule: the
//! vendor's own simulation, github.com/zivid/zivid-isaac-sim (camera_calibration.py, zivid_camera.py); for the M70 the
//! vendor's simulation computes the projector's picture with a four times coarser resolution.
//!
//! The error of a poor calibration is a smooth error of 1/z over the picture, the same in each scan. With the picture's
//! half width and half height as units, the depth error at 700 mm is
//!     c = A (X² − 0.6 Y² + 0.5 sin(2.2 X + 1.3 Y + φ)),   1/z_measured = 1/z − c / (700 mm)²,
//! a bow with opposite signs along X and Y, plus a wave. Zivid specifies a dimension trueness of 0.2 %, and 0.06 mm of
//! local planarity, for the Two M70; public scans of a poorly calibrated camera show bows of 1.5 to 3.4 mm. The program
//! under test does not use this formula.

use super::appearance::dry_and_wet;
use super::cast::{CastView, PanelHit, PanelView, PixelHit};
use super::noise::{NormalStream, PIXEL_NOISE_GRAY, PixelNoise, RandomPurpose, Seed, ValueNoise, to_bytes};
use super::scene;
use super::scene::Slab;
use super::shape::Shape;
use nalgebra::{Isometry3, Point3, Vector3};
use panelprep_base::geometry::{Base, Camera, OrganizedCloud, Panel, PinholeCamera, Pixel, Point, Rigid};
use rand::RngExt;
use rayon::prelude::*;

const WHITE_NOISE_MM: f64 = 0.055;
const WHITE_NOISE_DEPTH_MM: f64 = 700.0;
const CORRELATED_NOISE_MM: f64 = 0.06;
const LATTICE_SPACING_MM: std::ops::Range<f64> = 50.0..85.0;
/// Half the side of the square that the lattice covers, mm: larger than half of the largest panel.
pub(super) const LATTICE_HALF_WIDTH_MM: f64 = 260.0;
/// Width of the zone on both sides of the panel's edge in which a pixel sees both surfaces, px.
const EDGE_ZONE_PX: f64 = 1.0;
/// Fraction of the pixels at the panel's edge that have a flying point.
const FLYING_POINT_FRACTION: f64 = 0.10;
/// Fraction of the pixels at the panel's edge that have no point.
const MISSING_EDGE_POINT_FRACTION: f64 = 0.75;
/// Fraction of all other pixels that have no point.
const DROPOUT_FRACTION: f64 = 0.002;

/// The parameters of the simulated noise, for reports.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct NoiseFigures {
    /// White range noise at 700 mm at perpendicular incidence, mm.
    pub range_white_mm: f64,
    /// Correlated range noise at the nodes of its lattice, rms, mm.
    pub range_correlated_mm: f64,
    /// Minimum and maximum spacing of the lattice of the correlated noise, mm.
    pub range_lattice_mm: [f64; 2],
    /// Fraction of the pixels at the panel's edge that have a flying point.
    pub edge_flying_share: f64,
    /// Fraction of the pixels at the panel's edge that have no point.
    pub edge_missing_share: f64,
    /// Fraction of all other pixels that have no point.
    pub drop_out_share: f64,
    /// Distance from the camera to its projector, mm. A surface that only one of the two sees has no points.
    pub projector_baseline_mm: f64,
    /// Minimum distance between an object and a point behind it, as a fraction of the point's depth from the projector,
    /// at which the object casts a shadow on the point.
    pub projector_shadow_share: f64,
    /// Pixel noise of both cameras, grey levels.
    pub pixel_gray: f64,
}

/// Returns the parameters of the noise of every rendered scan.
pub fn scanner_noise() -> NoiseFigures {
    NoiseFigures {
        range_white_mm: WHITE_NOISE_MM,
        range_correlated_mm: CORRELATED_NOISE_MM,
        range_lattice_mm: [LATTICE_SPACING_MM.start, LATTICE_SPACING_MM.end],
        edge_flying_share: FLYING_POINT_FRACTION,
        edge_missing_share: MISSING_EDGE_POINT_FRACTION,
        drop_out_share: DROPOUT_FRACTION,
        projector_baseline_mm: baseline_mm(),
        projector_shadow_share: MIN_SHADOW_DISTANCE_FRACTION,
        pixel_gray: PIXEL_NOISE_GRAY,
    }
}

/// Renders a scan; `shot` is the seed of its noise.
pub(super) fn capture(
    view: &CastView<'_>,
    projector: &Projector<'_>,
    pixels: &PixelNoise,
    shot: Seed,
) -> OrganizedCloud<Camera> {
    let (width, height) = (view.width(), view.height());
    let mut points = vec![[f32::NAN; 3]; width * height];
    let mut colors = vec![[0_u8; 3]; width * height];
    let correlated = draw_correlated_noise(shot, None);
    let rows = points.par_chunks_mut(width).zip(colors.par_chunks_mut(width)).enumerate();
    rows.for_each(|(row, (points, colors))| {
        let mut normal = NormalStream::new(shot.stream(RandomPurpose::ScanRow, row as u64));
        let noise = pixels.row(shot, row, width);
        view.cast_row(row, |column, sight| {
            let (dry, _) = dry_and_wet(&sight);
            colors[column] = to_bytes(dry, noise, column);
            if let Some(point) = measure_point(&sight, projector, &correlated, &mut normal) {
                points[column] = point;
            }
        });
    });
    match OrganizedCloud::new(width, height, points, colors) {
        Ok(cloud) => cloud,
        Err(error) => unreachable!("the cloud must have one point and one colour per pixel: {error}"),
    }
}

/// Draws the correlated noise of a scan, in units of its rms, on a lattice of this spacing, mm. `None` selects the
/// camera's usual spacing.
pub(super) fn draw_correlated_noise(shot: Seed, spacing_mm: Option<f64>) -> ValueNoise {
    let usual_mm = || shot.stream(RandomPurpose::Scan, 0).random_range(LATTICE_SPACING_MM);
    let lattice_mm = spacing_mm.unwrap_or_else(usual_mm);
    ValueNoise::new(shot.stream(RandomPurpose::Scan, 1), lattice_mm, LATTICE_HALF_WIDTH_MM)
}

/// Computes the range error of a pixel at perpendicular incidence, mm, from its white and its correlated noise in units
/// of their rms.
pub(super) fn range_error_mm(white: f64, depth_mm: f64, correlated: f64) -> f64 {
    white * WHITE_NOISE_MM * (depth_mm / WHITE_NOISE_DEPTH_MM).powi(2) + CORRELATED_NOISE_MM * correlated
}

/// A lit surface at which a pixel's ray may end.
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
            correlated_mm: CORRELATED_NOISE_MM * correlated.value_at(panel.place),
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

/// Returns the point that a pixel measures; `None` if the point is missing.
pub(super) fn measure_point(
    sight: &PixelHit,
    projector: &Projector<'_>,
    correlated: &ValueNoise,
    normal: &mut NormalStream,
) -> Option<[f32; 3]> {
    // These random numbers are drawn for every pixel, so that the surface seen by one pixel does not change the noise
    // of the next.
    let (white, chance, between) = (normal.next(), normal.next_uniform(), normal.next_uniform());
    let near = sight.panel.filter(|panel| panel.edge_px < EDGE_ZONE_PX);
    let at_edge = near.is_some_and(|panel| panel.edge_px > -EDGE_ZONE_PX);
    let missing = if at_edge {
        FLYING_POINT_FRACTION..FLYING_POINT_FRACTION + MISSING_EDGE_POINT_FRACTION
    } else {
        0.0..DROPOUT_FRACTION
    };
    if missing.contains(&chance) {
        return None;
    }
    let surface = match near {
        Some(panel) if at_edge && chance < FLYING_POINT_FRACTION => {
            let own = Surface::from_panel_hit(sight, &panel, projector, correlated)?;
            let behind = Surface::from_background(sight, projector)?;
            Surface { depth_mm: own.depth_mm + between * (behind.depth_mm - own.depth_mm), ..own }
        }
        Some(panel) if panel.edge_px < 0.0 => Surface::from_panel_hit(sight, &panel, projector, correlated)?,
        _ => Surface::from_background(sight, projector)?,
    };
    let scale = surface.depth_mm / WHITE_NOISE_DEPTH_MM;
    let along_ray_mm = white * WHITE_NOISE_MM * scale * scale / surface.cos_incidence + surface.correlated_mm;
    let point = sight.ray * (surface.depth_mm + along_ray_mm / sight.ray.norm());
    Some([point.x as f32, point.y as f32, point.z as f32])
}

/// The projector's lens, without distortion as in the vendor's simulation.
const PROJECTOR_LENS: PinholeCamera = PinholeCamera {
    width_px: 1280,
    height_px: 720,
    fx_px: 1170.0,
    fy_px: 1170.0,
    cx_px: 640.0,
    cy_px: 360.0,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

/// The projector's position in the camera's frame, mm.
const PROJECTOR_POSITION_MM: [f64; 3] = [111.2, 0.0, 9.7];
/// The projector's rotation about the camera's y axis, rad.
const PROJECTOR_ROTATION_RAD: f64 = -0.113;

/// Minimum distance between an object and a point behind it, as a fraction of the point's depth from the projector, at
/// which the object casts a shadow on the point.
const MIN_SHADOW_DISTANCE_FRACTION: f64 = 0.005;

/// Returns the distance from the camera's lens to the projector's lens, mm.
fn baseline_mm() -> f64 {
    Vector3::from(PROJECTOR_POSITION_MM).norm()
}

fn camera_from_projector() -> Isometry3<f64> {
    Isometry3::new(PROJECTOR_POSITION_MM.into(), Vector3::y() * PROJECTOR_ROTATION_RAD)
}

/// The projector and the objects that can block its light.
pub(super) struct Projector<'a> {
    projector_from_camera: Isometry3<f64>,
    panel: Option<PanelView<'a>>,
    screens: Vec<OccludingScreen>,
}

impl<'a> Projector<'a> {
    /// Creates the projector of a camera at this pose. Its light can be blocked by the fixture, a panel and these
    /// objects.
    pub fn new(
        base_from_camera: &Rigid<Base, Camera>,
        panel: Option<(&'a Shape, &Rigid<Base, Panel>)>,
        things: &[Slab],
    ) -> Self {
        let projector_from_base = (base_from_camera.isometry() * camera_from_projector()).inverse();
        let panel = panel.map(|(shape, base_from_panel)| {
            let projector_from_sheet = projector_from_base * base_from_panel.isometry() * shape.panel_from_sheet();
            PanelView::new(&PROJECTOR_LENS, shape, &projector_from_sheet)
        });
        let eye = projector_from_base * base_from_camera.origin().mm;
        let slabs = scene::occluders().into_iter().chain(things.iter().copied());
        let screens = slabs.map(|slab| OccludingScreen::new(&projector_from_base, &slab, &eye)).collect();
        Projector { panel, screens, ..Projector::without_occluders() }
    }

    /// Creates the projector without objects that block its light.
    pub fn without_occluders() -> Self {
        Projector { projector_from_camera: camera_from_projector().inverse(), panel: None, screens: Vec::new() }
    }

    /// Returns whether the projector's light reaches this point of the camera's frame. If the point is on the panel,
    /// `on_panel` is the panel's surface at the point.
    pub fn is_lit(&self, point: &Vector3<f64>, on_panel: Option<&PanelHit>) -> bool {
        let point = self.projector_from_camera * Point3::from(*point);
        let Some((column, row)) = projector_pixel(&point) else { return false };
        let nearest = (1.0 - MIN_SHADOW_DISTANCE_FRACTION) * point.z;
        let clear_of_panel = match (&self.panel, on_panel) {
            (Some(panel), Some(sight)) => panel.to_sheet_direction(&point.coords).dot(&sight.normal) < 0.0,
            (Some(panel), None) => {
                let met = panel
                    .is_candidate_pixel(column, row)
                    .then(|| panel.intersect_ray(point.coords / point.z, None))
                    .flatten();
                !met.is_some_and(|met| met.edge_px < 0.0 && met.depth_mm < nearest)
            }
            (None, _) => true,
        };
        clear_of_panel && !self.screens.iter().any(|screen| screen.is_blocking(&point.coords))
    }
}

/// Returns the pixel of the projector's picture that contains a point of the projector's frame.
fn projector_pixel(point: &Point3<f64>) -> Option<(usize, usize)> {
    let Pixel { u, v } = PROJECTOR_LENS.project(Point::<Camera>::new(*point))?;
    let within = u >= 0.0 && v >= 0.0 && u < PROJECTOR_LENS.width_px as f64 && v < PROJECTOR_LENS.height_px as f64;
    within.then_some((u as usize, v as usize))
}

/// A flat rectangle that blocks the projector's light, in the projector's frame.
struct OccludingScreen {
    centre: Vector3<f64>,
    axes: [Vector3<f64>; 3],
    half_mm: [f64; 2],
    /// The rectangle blocks the light to a point if the line from the projector to the point intersects the rectangle
    /// before this fraction of the line's length.
    reach: f64,
}

impl OccludingScreen {
    fn new(projector_from_base: &Isometry3<f64>, slab: &Slab, eye: &Point3<f64>) -> Self {
        let projector_from_slab = projector_from_base * slab.base_from_slab;
        let centre = projector_from_slab.translation.vector;
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| projector_from_slab * axis);
        let same_side = axes[2].dot(&(eye.coords - centre)) * axes[2].dot(&-centre) > 0.0;
        // If the camera sees the side that faces away from the projector, this whole side is in shadow.
        let reach = if same_side { 1.0 - MIN_SHADOW_DISTANCE_FRACTION } else { 1.0 + 1e-6 };
        OccludingScreen { centre, axes, half_mm: slab.half_mm, reach }
    }

    /// Returns whether the rectangle is between the projector and this point.
    fn is_blocking(&self, point: &Vector3<f64>) -> bool {
        let share = self.axes[2].dot(&self.centre) / self.axes[2].dot(point);
        if !(share > 0.0 && share < self.reach) {
            return false;
        }
        let met = point * share - self.centre;
        self.axes[0].dot(&met).abs() < self.half_mm[0] && self.axes[1].dot(&met).abs() < self.half_mm[1]
    }
}

const REFERENCE_DEPTH_OF_DISTORTION_MM: f64 = 700.0;
const HALF_PICTURE_SIZE: [f64; 2] = [0.54, 0.33];

/// The constant depth error of one poorly calibrated camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScannerDistortion {
    /// The amplitude A of the depth error, mm.
    pub depth_mm: f64,
    /// The phase φ of the wave, rad.
    pub phase: f64,
}

impl ScannerDistortion {
    /// Creates the depth error of a camera. Each seed gives another camera; `depth_mm` is the amplitude A.
    pub fn new(seed: u64, depth_mm: f64) -> Self {
        ScannerDistortion { depth_mm, phase: (seed % 628) as f64 / 100.0 }
    }

    /// Computes the depth error c for a direction (X/Z, Y/Z), mm.
    pub fn distortion_at_mm(&self, [x, y]: [f64; 2]) -> f64 {
        let (x, y) = (x / HALF_PICTURE_SIZE[0], y / HALF_PICTURE_SIZE[1]);
        self.depth_mm * (x * x - 0.6 * y * y + 0.5 * (2.2 * x + 1.3 * y + self.phase).sin())
    }

    /// Returns the scan as this camera would measure it.
    pub fn distort_scan(&self, scan: &OrganizedCloud<Camera>) -> OrganizedCloud<Camera> {
        scan.scaled_along_rays(|[x, y, z]| {
            1.0 / (1.0
                - z * self.distortion_at_mm([x / z, y / z])
                    / (REFERENCE_DEPTH_OF_DISTORTION_MM * REFERENCE_DEPTH_OF_DISTORTION_MM))
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::noise::Seed;
    use crate::scene;

    /// Expected values, calculated by hand with sin 0.113 = 0.11276 and cos 0.113 = 0.99362. The point (0, 210, 700)
    /// has y = 210 and z = 698.4 in the projector's frame: v = 360 + 1170 · 210 / 698.4 = 711.8 of 720. At y = 220 mm,
    /// v is 728.5. The point (−370, 0, 700) has x = −400.3 and z = 740.2 in the projector's frame: u = 7.2. At x = −380
    /// mm, u is −7.5.
    #[test]
    fn the_projector_frustum_agrees_with_hand_calculation() {
        let lit = |x: f64, y: f64| Projector::without_occluders().is_lit(&Vector3::new(x, y, 700.0), None);
        assert!(lit(0.0, 210.0) && lit(0.0, -210.0) && lit(-370.0, 0.0));
        assert!(!lit(0.0, 220.0) && !lit(0.0, -220.0) && !lit(-380.0, 0.0));
        assert!(!Projector::without_occluders().is_lit(&Vector3::new(0.0, 0.0, -700.0), None), "behind");
    }

    /// Returns a camera pose at (−35, 0, 360), 700 mm from the plate and perpendicular to it; the camera's x axis is
    /// the base's −Y axis.
    pub fn camera_pose_before_plate() -> Rigid<Base, Camera> {
        let axes = [-Vector3::y(), -Vector3::z(), Vector3::x()].map(panelprep_base::geometry::Vector::new);
        Rigid::from_axes(axes, Point::at(-35.0, 0.0, 360.0))
    }

    /// Expected values, calculated by hand for an object of ±40 mm, 100 mm in front of the plate. The line from the
    /// projector past the object's left edge meets the plate at x = 111.2 − 151.2 · 690.3 / 590.3 = −65.61 mm, the line
    /// from the camera at −46.67. On the right the projector's line meets the plate at 27.94, behind the object.
    #[test]
    fn a_shadow_agrees_with_hand_calculation() {
        let thing = Slab::facing(Point3::new(565.0, 0.0, 360.0), -Vector3::x(), 0.0, [40.0, 40.0], [100.0; 3]);
        let projector = Projector::new(&camera_pose_before_plate(), None, &[thing]);
        let lit = |x: f64| projector.is_lit(&Vector3::new(x, 0.0, 700.0), None);
        assert!(lit(-65.7) && !lit(-65.5) && !lit(-46.0) && !lit(27.8) && lit(28.1));
        assert!(projector.is_lit(&Vector3::new(-39.0, 0.0, 600.0), None), "not in its own shadow");
        // 3 mm of 700 mm are less than the 0.5 % at which an object casts a shadow.
        let thin = Slab::facing(Point3::new(662.0, 0.0, 360.0), -Vector3::x(), 0.0, [40.0, 40.0], [100.0; 3]);
        assert!(
            Projector::new(&camera_pose_before_plate(), None, &[thin]).is_lit(&Vector3::new(0.0, 0.0, 700.0), None)
        );
    }

    /// The object is between lens and projector with its edge towards the camera: the lens sees the object's unlit
    /// side.
    #[test]
    fn the_unlit_side_of_an_object_has_no_points() {
        let seen_from = |y_mm: f64| {
            let thing = Slab::facing(Point3::new(465.0, y_mm, 360.0), Vector3::y(), 0.0, [40.0, 40.0], [100.0; 3]);
            Projector::new(&camera_pose_before_plate(), None, &[thing])
                .is_lit(&Vector3::new(-y_mm, 0.0, 505.0), None)
        };
        assert!(!seen_from(-50.0), "at x = 50 mm lens and projector, at 111 mm, are on both sides");
        assert!(seen_from(50.0) && seen_from(-150.0));
    }

    /// A point of the plate beside the panel is in shadow if the line to the projector passes through the panel. The
    /// panel has no object in front of it and is lit everywhere, at every pose.
    #[test]
    fn a_panel_is_lit_and_casts_its_shadow_to_the_left() {
        let base_from_camera = scene::base_from_camera();
        for seed in 0..20 {
            let shape = Shape::taught(Seed(seed));
            for place in [scene::nominal(), scene::displaced_pose(Seed(seed), 0)] {
                let projector = Projector::new(&base_from_camera, Some((&shape, &place)), &[]);
                let seen = |at: [f64; 2]| (base_from_camera.inverse() * (place * shape.point(at))).mm.coords;
                for at in shape.outline().polyline(10.0) {
                    assert!(projector.is_lit(&seen(at.into()), None), "seed {seed}: {at}");
                }
                // The points of the plate that the lens sees just beside the middle of the panel's left and right side.
                let eye = base_from_camera.origin().mm;
                let behind = |s: f64| {
                    let ray = (place * shape.point([s, 0.0])).mm - eye;
                    let on_plate = eye + ray * ((665.0 - eye.x) / ray.x);
                    projector.is_lit(&(base_from_camera.inverse() * Point::<Base>::new(on_plate)).mm.coords, None)
                };
                assert!(!behind(-164.0) && behind(174.0), "seed {seed}");
            }
        }
    }
}
