//! The projector of the 3D camera, and the surfaces that its light does not reach.
//!
//! A Zivid measures a point only if both its camera and its projector see it. The projector of a Two M70 is b = 111 mm
//! to the right of the lens and is turned by 0.113 rad towards its axis. A pixel has no point if its surface
//! - lies outside of the projector's picture,
//! - looks away from the projector, or
//! - is in shadow: another object is on the line to the projector, nearer to it by over 0.5 % of the depth.
//!
//! The edge of an object at the distance d in front of a wall at the depth z leaves a strip of the wall without
//! points,
//!     w ≈ b d / (z − d),                                                                                  (1)
//! on the side that faces away from the projector. Colours have the room's light and no such shadows.
//!
//! Lines of sight end at the surfaces themselves, not at a depth map. Therefore rims are not ragged, and no slanted
//! surface is in its own shadow. Not simulated: half-shadows, light from surface to surface, and the panel's shadow on
//! itself, because the panel is too shallow for it. Source: geometry and rule of the vendor's own simulation,
//! github.com/zivid/zivid-isaac-sim (camera_calibration.py, zivid_camera.py); for the M70 the vendor's simulation
//! computes the projector's picture four times coarser.

use super::cast::{PanelHit, PanelView};
use super::fixture;
use super::fixture::Slab;
use super::shape::Shape;
use nalgebra::{Isometry3, Point3, Vector3};
use panelprep_base::geometry::{Base, Camera, Panel, PinholeCamera, Pixel, Point, Rigid};

/// The projector's lens; it has no distortion in the vendor's simulation.
const LENS: PinholeCamera = PinholeCamera {
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

/// The projector's position in the camera's frame, mm, and its turn about the camera's y, rad.
const PROJECTOR_POSITION_MM: [f64; 3] = [111.2, 0.0, 9.7];
const PROJECTOR_TURN_RAD: f64 = -0.113;

/// An object that is nearer to the projector than a point by this share of the point's depth throws a shadow on the
/// point.
pub(super) const SHADOW_SHARE: f64 = 0.005;

/// Distance from the camera's lens to the projector's lens, mm.
pub(super) fn baseline_mm() -> f64 {
    Vector3::from(PROJECTOR_POSITION_MM).norm()
}

fn camera_from_projector() -> Isometry3<f64> {
    Isometry3::new(PROJECTOR_POSITION_MM.into(), Vector3::y() * PROJECTOR_TURN_RAD)
}

/// The projector in front of the objects in the cell.
pub(super) struct Projector<'a> {
    projector_from_camera: Isometry3<f64>,
    panel: Option<PanelView<'a>>,
    screens: Vec<OccludingScreen>,
}

impl<'a> Projector<'a> {
    /// The projector of a camera at this pose, in front of the fixture, a panel and these objects.
    pub fn new(
        base_from_camera: &Rigid<Base, Camera>,
        panel: Option<(&'a Shape, &Rigid<Base, Panel>)>,
        things: &[Slab],
    ) -> Self {
        let projector_from_base = (base_from_camera.isometry() * camera_from_projector()).inverse();
        let panel = panel.map(|(shape, base_from_panel)| {
            let projector_from_sheet = projector_from_base * base_from_panel.isometry() * shape.panel_from_sheet();
            PanelView::new(&LENS, shape, &projector_from_sheet)
        });
        let eye = projector_from_base * base_from_camera.origin().mm;
        let slabs = fixture::occluders().into_iter().chain(things.iter().copied());
        let screens = slabs.map(|slab| OccludingScreen::new(&projector_from_base, &slab, &eye)).collect();
        Projector { panel, screens, ..Projector::without_occluders() }
    }

    /// Creates the projector with no object in front of it.
    pub fn without_occluders() -> Self {
        Projector { projector_from_camera: camera_from_projector().inverse(), panel: None, screens: Vec::new() }
    }

    /// Returns whether the projector's light reaches this point of the camera's frame. If the point is on the
    /// panel, `on_panel` is the panel as the camera sees it there.
    pub fn is_lit(&self, point: &Vector3<f64>, on_panel: Option<&PanelHit>) -> bool {
        let point = self.projector_from_camera * Point3::from(*point);
        let Some((column, row)) = inside(&point) else { return false };
        let nearest = (1.0 - SHADOW_SHARE) * point.z;
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
fn inside(point: &Point3<f64>) -> Option<(usize, usize)> {
    let Pixel { u, v } = LENS.project(Point::<Camera>::new(*point))?;
    let within = u >= 0.0 && v >= 0.0 && u < LENS.width_px as f64 && v < LENS.height_px as f64;
    within.then_some((u as usize, v as usize))
}

/// A flat rectangle that blocks the projector's light, in the projector's frame.
struct OccludingScreen {
    centre: Vector3<f64>,
    axes: [Vector3<f64>; 3],
    half_mm: [f64; 2],
    /// The rectangle blocks the light to a point if the line from the projector to the point meets the rectangle
    /// before this fraction of its length.
    reach: f64,
}

impl OccludingScreen {
    fn new(projector_from_base: &Isometry3<f64>, slab: &Slab, eye: &Point3<f64>) -> Self {
        let projector_from_slab = projector_from_base * slab.base_from_slab;
        let centre = projector_from_slab.translation.vector;
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| projector_from_slab * axis);
        let same_side = axes[2].dot(&(eye.coords - centre)) * axes[2].dot(&-centre) > 0.0;
        // If the camera sees the side that the projector does not see, all of that side is dark.
        let reach = if same_side { 1.0 - SHADOW_SHARE } else { 1.0 + 1e-6 };
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

#[cfg(test)]
pub(super) mod tests {
    use super::super::noise::Seed;
    use super::super::scene;
    use super::*;

    /// Calculated by hand, with sin 0.113 = 0.11276 and cos 0.113 = 0.99362: the point (0, 210, 700) is (210,
    /// 698.4) down and along in the projector's frame. Its v is 360 + 1170 · 210 / 698.4 = 711.8 of 720; 220 mm
    /// down, v is 728.5. The point (−370, 0, 700) is (−400.3, 740.2) across and along, u = 7.2; at −380, u is −7.5.
    #[test]
    fn the_frustum_by_hand() {
        let lit = |x: f64, y: f64| Projector::without_occluders().is_lit(&Vector3::new(x, y, 700.0), None);
        assert!(lit(0.0, 210.0) && lit(0.0, -210.0) && lit(-370.0, 0.0));
        assert!(!lit(0.0, 220.0) && !lit(0.0, -220.0) && !lit(-380.0, 0.0));
        assert!(!Projector::without_occluders().is_lit(&Vector3::new(0.0, 0.0, -700.0), None), "behind");
    }

    /// A camera pose at (−35, 0, 360) that looks straight at the plate, 700 mm away; the camera's x is the base's
    /// −Y.
    pub fn before_the_plate() -> Rigid<Base, Camera> {
        let axes = [-Vector3::y(), -Vector3::z(), Vector3::x()].map(panelprep_base::geometry::Vector::new);
        Rigid::from_axes(axes, Point::at(-35.0, 0.0, 360.0))
    }

    /// Calculated by hand: an object of ±40 mm, 100 mm in front of the plate. The line from the projector past its
    /// left edge meets the plate at x = 111.2 − 151.2 · 690.3 / 590.3 = −65.61 mm, the line from the camera at
    /// −46.67. On the right the projector's line meets the plate at 27.94, behind the object.
    #[test]
    fn a_shadow_by_hand() {
        let thing = Slab::facing(Point3::new(565.0, 0.0, 360.0), -Vector3::x(), 0.0, [40.0, 40.0], [100.0; 3]);
        let projector = Projector::new(&before_the_plate(), None, &[thing]);
        let lit = |x: f64| projector.is_lit(&Vector3::new(x, 0.0, 700.0), None);
        assert!(lit(-65.7) && !lit(-65.5) && !lit(-46.0) && !lit(27.8) && lit(28.1));
        assert!(projector.is_lit(&Vector3::new(-39.0, 0.0, 600.0), None), "not in its own shadow");
        // 3 mm of 700 mm are less than 0.5 %.
        let thin = Slab::facing(Point3::new(662.0, 0.0, 360.0), -Vector3::x(), 0.0, [40.0, 40.0], [100.0; 3]);
        assert!(Projector::new(&before_the_plate(), None, &[thin]).is_lit(&Vector3::new(0.0, 0.0, 700.0), None));
    }

    /// An object between lens and projector, with its edge towards the camera, shows the lens its dark side.
    #[test]
    fn the_dark_side_of_a_thing_has_no_points() {
        let seen_from = |y_mm: f64| {
            let thing = Slab::facing(Point3::new(465.0, y_mm, 360.0), Vector3::y(), 0.0, [40.0, 40.0], [100.0; 3]);
            Projector::new(&before_the_plate(), None, &[thing]).is_lit(&Vector3::new(-y_mm, 0.0, 505.0), None)
        };
        assert!(!seen_from(-50.0), "at x = 50 mm lens and projector, at 111 mm, are on both sides");
        assert!(seen_from(50.0) && seen_from(-150.0));
    }

    /// For a shadow on the plate beside the panel, the line to the projector passes through the panel's inside. The
    /// panel has no object in front of it and is lit everywhere, at every pose.
    #[test]
    fn a_panel_is_lit_and_throws_its_shadow_to_the_left() {
        let base_from_camera = scene::base_from_camera();
        for seed in 0..20 {
            let shape = Shape::taught(Seed(seed));
            for place in [scene::nominal(), scene::displaced_pose(Seed(seed), 0)] {
                let projector = Projector::new(&base_from_camera, Some((&shape, &place)), &[]);
                let seen = |at: [f64; 2]| (base_from_camera.inverse() * (place * shape.point(at))).mm.coords;
                for at in shape.outline().polyline(10.0) {
                    assert!(projector.is_lit(&seen(at.into()), None), "seed {seed}: {at}");
                }
                // The points of the plate that the lens sees just beside the middles of the left and the right
                // side.
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
