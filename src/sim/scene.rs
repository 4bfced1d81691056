//! The poses of all objects: both cameras, their calibrations, the panel's nominal and displaced pose and the taught
//! corner poses; and the objects around the panel, which do not move with it.
//!
//! The objects around the panel are the fixture behind it, which is a light back plate with two posts, and flat slabs
//! beside and in front of the panel at fixed poses in the cell. Every part of the fixture is a vertical rectangle that
//! faces the robot, at a constant X of the base frame.

use super::noise::{NormalStream, RandomPurpose, Seed};
use super::shape::{CENTRE_MM, Shape};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{
    Base, Camera, Degrees, Flange, FlangeCamera, Frame, Panel, PinholeCamera, Point, Rigid, Vector,
};
use strum::{IntoStaticStr, VariantArray};

/// The scenes: which panel is in the cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Scene {
    /// The taught panel at its displaced pose, with greasy spots.
    Good,
    /// The taught panel at its displaced pose, without grease.
    Clean,
    /// The fixture without a panel.
    NoPanel,
    /// A panel that differs from the taught panel.
    WrongPanel,
}

impl Scene {
    /// All scenes, in the order of the enumeration.
    pub const ALL: &'static [Scene] = <Self as VariantArray>::VARIANTS;

    /// Returns the scene's keyword. Users' scripts depend on it.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}

/// Returns the fixed 3D camera, a Zivid Two, with a picture that is smaller by a whole factor.
pub(super) fn scanner(reduction: usize) -> PinholeCamera {
    let camera = PinholeCamera {
        width_px: 1944,
        height_px: 1200,
        fx_px: 1785.2,
        fy_px: 1784.6,
        cx_px: 970.3,
        cy_px: 602.1,
        k1: -0.082,
        k2: 0.105,
        p1: 0.0006,
        p2: -0.0004,
        k3: -0.02,
    };
    reduce_camera(camera, reduction)
}

/// Returns the colour camera on the flange, with a picture that is smaller by a whole factor.
pub(super) fn flange_camera(reduction: usize) -> PinholeCamera {
    let camera = PinholeCamera {
        width_px: 2048,
        height_px: 1536,
        fx_px: 2401.5,
        fy_px: 2400.8,
        cx_px: 1027.6,
        cy_px: 763.9,
        k1: -0.11,
        k2: 0.09,
        p1: -0.0005,
        p2: 0.0003,
        k3: 0.0,
    };
    reduce_camera(camera, reduction)
}

fn reduce_camera(camera: PinholeCamera, reduction: usize) -> PinholeCamera {
    let factor = reduction as f64;
    PinholeCamera {
        width_px: camera.width_px / reduction,
        height_px: camera.height_px / reduction,
        fx_px: camera.fx_px / factor,
        fy_px: camera.fy_px / factor,
        cx_px: camera.cx_px / factor,
        cy_px: camera.cy_px / factor,
        ..camera
    }
}

/// Returns the 3D camera's pose: beside and above the robot, with the panel's centre in the middle of the picture.
pub(super) fn base_from_camera() -> Rigid<Base, Camera> {
    let eye = Point3::new(-100.0, -250.0, 700.0);
    let forward = (Point3::from(CENTRE_MM) - eye).normalize();
    let right = (-Vector3::z()).cross(&forward).normalize();
    let axes = [right, forward.cross(&right), forward].map(Vector::new);
    Rigid::from_axes(axes, Point::new(eye))
}

/// Returns the flange camera's mount: beside the tool along the flange's X axis, slightly tilted, looking in the tool's
/// direction.
pub(super) fn flange_from_camera() -> Rigid<Flange, FlangeCamera> {
    let tilt = UnitQuaternion::from_scaled_axis(Vector3::new(0.8, -3.0, 0.6).map(f64::to_radians));
    Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::new(80.0, 4.0, 30.0), tilt))
}

/// Error of a calibrated mount, mm: a shift of this length in a random direction.
const MOUNT_ERROR_MM: f64 = 0.1;
/// Error of a calibrated mount, degrees: a rotation by this angle about a random axis.
const MOUNT_ERROR_DEG: f64 = 0.01;

/// Returns the mount that a calibration would find, with its error. Each number `index` gives another error.
pub(super) fn calibrated_mount<To: Frame, C: Frame>(
    seed: Seed,
    index: u64,
    true_mount: &Rigid<To, C>,
) -> Rigid<To, C> {
    let mut normal = NormalStream::new(seed.stream(RandomPurpose::Calibration, index));
    let shift = direction(&mut normal) * MOUNT_ERROR_MM;
    let turn = direction(&mut normal) * Degrees(MOUNT_ERROR_DEG).to_rad();
    *true_mount * Rigid::<C, C>::from_isometry_unchecked(Isometry3::new(shift, turn))
}

fn direction(normal: &mut NormalStream) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal.next()).normalize()
}

/// Returns the panel's nominal pose: the panel's frame coincides with the base (thesis 3.8).
pub(super) fn nominal() -> Rigid<Base, Panel> {
    Rigid::from_isometry_unchecked(Isometry3::identity())
}

const MAX_SHIFT_MM: f64 = 25.0;
const MAX_ROTATION_DEG: f64 = 8.0;
/// Ratio of the maximum shift along the panel's normal to the maximum sideways shift: smaller than 1, so that the panel
/// stays clear of the fixture.
const NORMAL_SHIFT_FACTOR: f64 = 0.6;

/// Returns a displaced pose of the panel: shifted by up to 25 mm and rotated by up to 8° about its centre. Each number
/// `place` gives another pose.
pub(super) fn displaced_pose(seed: Seed, place: u32) -> Rigid<Base, Panel> {
    let mut normal = NormalStream::new(seed.stream(RandomPurpose::Placement, u64::from(place)));
    let mut shift = direction(&mut normal) * (MAX_SHIFT_MM * (0.3 + 0.7 * normal.next_uniform()));
    shift.x *= NORMAL_SHIFT_FACTOR;
    let turn = direction(&mut normal) * (Degrees(MAX_ROTATION_DEG).to_rad() * (0.3 + 0.7 * normal.next_uniform()));
    let centre = Vector3::from(CENTRE_MM);
    let turned = UnitQuaternion::from_scaled_axis(turn);
    Rigid::from_isometry_unchecked(Isometry3::from_parts(
        Translation3::from(centre + shift - turned * centre),
        turned,
    ))
}

/// The taught view of a panel's corner by the flange camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerView {
    /// The name of the corner: its direction in the picture as seen from the inside of the panel.
    pub name: &'static str,
    /// The corner: the intersection of its two straight edges, extended, on the surface.
    pub corner: Point<Panel>,
    /// The flange's pose for this view while the panel is at its nominal pose.
    pub base_from_flange: Rigid<Base, Flange>,
}

/// Distance between the flange camera and a corner, mm.
const CORNER_DISTANCE_MM: f64 = 235.0;

/// Returns two corners that are far apart, in the order in which they are used.
pub(super) fn corner_views(shape: &Shape) -> Vec<CornerView> {
    let corners = shape.outline().corners();
    let named = [("top-left", corners.len() - 1, [9.0, -6.0]), ("bottom-right", 1, [-7.0, 5.0])];
    named.map(|(name, index, aside_mm)| corner_view(shape, name, corners[index].into(), aside_mm)).to_vec()
}

fn corner_view(shape: &Shape, name: &'static str, place: [f64; 2], aside_mm: [f64; 2]) -> CornerView {
    let (corner, normal) = (shape.point(place), shape.normal(place));
    let forward = -normal.mm;
    let right = (-Vector3::z()).cross(&forward).normalize();
    let down = forward.cross(&right);
    // The corner is not exactly in the middle of the picture, so that no result depends on a central corner.
    let eye = corner.mm - forward * CORNER_DISTANCE_MM + right * aside_mm[0] + down * aside_mm[1];
    let base_from_camera: Rigid<Base, FlangeCamera> =
        Rigid::from_axes([right, down, forward].map(Vector::new), Point::new(eye));
    CornerView { name, corner, base_from_flange: base_from_camera * flange_from_camera().inverse() }
}

/// Returns the flange pose, changed at random by up to 5 mm and 1°, as a robot reaches it after a rough localization.
pub(super) fn perturbed_flange_pose(
    seed: Seed,
    index: u64,
    base_from_flange: &Rigid<Base, Flange>,
) -> Rigid<Base, Flange> {
    let mut normal = NormalStream::new(seed.stream(RandomPurpose::FlangePose, index));
    let shift = direction(&mut normal) * (5.0 * (0.2 + 0.8 * normal.next_uniform()));
    let turn = direction(&mut normal) * (Degrees(1.0).to_rad() * (0.2 + 0.8 * normal.next_uniform()));
    *base_from_flange * Rigid::<Flange, Flange>::from_isometry_unchecked(Isometry3::new(shift, turn))
}

/// A vertical rectangle of the fixture at one X of the base frame, mm; its grey level applies to perpendicular light.
#[derive(Debug, Clone, Copy)]
struct FixtureBoard {
    x_mm: f64,
    y_mm: [f64; 2],
    z_mm: [f64; 2],
    color: [f64; 3],
}

/// The rectangles of the fixture, from the nearest to the farthest.
const FIXTURE_BOARDS: [FixtureBoard; 3] = [
    FixtureBoard { x_mm: 650.0, y_mm: [78.0, 112.0], z_mm: [-40.0, 760.0], color: [158.0, 161.0, 166.0] },
    FixtureBoard { x_mm: 650.0, y_mm: [-118.0, -84.0], z_mm: [-40.0, 760.0], color: [158.0, 161.0, 166.0] },
    FixtureBoard { x_mm: 665.0, y_mm: [-520.0, 520.0], z_mm: [-20.0, 740.0], color: [186.0, 188.0, 184.0] },
];

/// Returns the fixture's parts as objects that block light.
pub(super) fn occluders() -> [Slab; 3] {
    FIXTURE_BOARDS.map(|board| {
        let middle = |[low, high]: [f64; 2]| (low + high) / 2.0;
        let centre = Point3::new(board.x_mm, middle(board.y_mm), middle(board.z_mm));
        let half_mm = [board.y_mm, board.z_mm].map(|[low, high]| (high - low) / 2.0);
        Slab::facing(centre, -Vector3::x(), 0.0, half_mm, board.color)
    })
}

/// Colour of the hall behind the fixture, which is out of focus and too far away for points.
const HALL_COLOR: [f64; 3] = [52.0, 55.0, 60.0];

/// The surface that a ray meets if it misses the panel: the fixture or the hall.
#[derive(Debug, Clone, Copy)]
pub(super) struct Background {
    /// Distance along the ray in units of its direction vector; `None` in the hall.
    pub depth_mm: Option<f64>,
    /// Cosine of the angle between ray and the surface's normal.
    pub cos_incidence: f64,
    /// Colour, grey levels; at an edge it is mixed according to the fraction of the pixel that each surface covers.
    pub color: [f64; 3],
}

/// Intersects a ray of the base frame with the fixture; a ray that misses the fixture ends in the hall. `pixel_rad` is
/// the angle of one pixel.
pub(super) fn intersect_fixture(origin: &Point3<f64>, ray: &Vector3<f64>, pixel_rad: f64) -> Background {
    let mut color = [0.0; 3];
    let mut open = 1.0;
    let mut depth_mm = None;
    for board in &FIXTURE_BOARDS {
        let depth = (board.x_mm - origin.x) / ray.x;
        if depth <= 0.0 || !depth.is_finite() {
            continue;
        }
        let (y, z) = (origin.y + depth * ray.y, origin.z + depth * ray.z);
        let inside_mm = (y - board.y_mm[0]).min(board.y_mm[1] - y).min(z - board.z_mm[0]).min(board.z_mm[1] - z);
        let share = (0.5 + inside_mm / (depth * pixel_rad)).clamp(0.0, 1.0) * open;
        if share > 0.0 {
            let light = fixture_light(y, z);
            color = std::array::from_fn(|channel| color[channel] + share * board.color[channel] * light);
            open -= share;
        }
        if depth_mm.is_none() && inside_mm > 0.0 {
            depth_mm = Some(depth);
        }
        if open <= 0.0 {
            break;
        }
    }
    color = std::array::from_fn(|channel| color[channel] + open * HALL_COLOR[channel]);
    Background { depth_mm, cos_incidence: ray.x.abs() / ray.norm(), color }
}

/// Returns the relative light of the lamp on the fixture, a few percent brighter in the middle.
fn fixture_light(y_mm: f64, z_mm: f64) -> f64 {
    let (across, up) = (y_mm / 500.0, (z_mm - 380.0) / 500.0);
    1.03 - 0.09 * (across * across + up * up)
}

/// A flat rectangle; the z axis of its frame is its normal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slab {
    pub base_from_slab: Isometry3<f64>,
    /// Half of the slab's width and height, mm.
    pub half_mm: [f64; 2],
    /// Colour of the slab, grey levels per channel.
    pub color: [f64; 3],
}

/// The intersection of a ray with a slab.
#[derive(Debug, Clone, Copy)]
pub(super) struct SlabHit {
    /// Distance along the ray in units of its direction vector.
    pub depth_mm: f64,
    pub cos_incidence: f64,
    /// The fraction of the pixel that the slab covers, 0…1.
    pub share: f64,
    pub color: [f64; 3],
}

impl Slab {
    /// Creates a slab that faces a direction.
    pub fn facing(
        centre: Point3<f64>,
        normal: Vector3<f64>,
        spin_rad: f64,
        half_mm: [f64; 2],
        color: [f64; 3],
    ) -> Slab {
        let upright = Isometry3::face_towards(&centre, &(centre + normal), &up_direction(&normal));
        let spin = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), spin_rad);
        Slab { base_from_slab: upright * spin, half_mm, color }
    }

    /// Intersects a ray of the base frame with the slab. `pixel_rad` is the angle of one pixel.
    pub fn intersect(&self, origin: &Point3<f64>, ray: &Vector3<f64>, pixel_rad: f64) -> Option<SlabHit> {
        let from = self.base_from_slab.inverse_transform_point(origin);
        let along = self.base_from_slab.inverse_transform_vector(ray);
        let depth_mm = -from.z / along.z;
        if !(depth_mm.is_finite() && depth_mm > 1.0) {
            return None;
        }
        let (x, y) = (from.x + depth_mm * along.x, from.y + depth_mm * along.y);
        let inside_mm = (self.half_mm[0] - x.abs()).min(self.half_mm[1] - y.abs());
        let share = (0.5 + inside_mm / (depth_mm * pixel_rad)).clamp(0.0, 1.0);
        let cos_incidence = (along.z / along.norm()).abs();
        (share > 0.0 && cos_incidence > 0.05).then_some(SlabHit {
            depth_mm,
            cos_incidence,
            share,
            color: self.color,
        })
    }
}

fn up_direction(normal: &Vector3<f64>) -> Vector3<f64> {
    if normal.z.abs() < 0.9 * normal.norm() { Vector3::z() } else { Vector3::y() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected value, calculated by hand: the panel's centre is √(660² + 250² + 340²) = √613700 = 783.39 mm in front
    /// of the camera, in the middle of its picture.
    #[test]
    fn the_scanner_looks_at_the_panels_centre() {
        let centre = base_from_camera().inverse() * Point::<Base>::at(560.0, 0.0, 360.0);
        assert!((centre.mm.z - 783.39).abs() < 0.01 && centre.mm.x.abs() < 1e-9 && centre.mm.y.abs() < 1e-9);
        let above = base_from_camera().inverse() * Point::<Base>::at(560.0, 0.0, 400.0);
        assert!(above.mm.y < -30.0 && above.mm.x.abs() < 1e-9, "up is up in the picture");
        let to_the_left = base_from_camera().inverse() * Point::<Base>::at(560.0, 40.0, 360.0);
        assert!(to_the_left.mm.x < -30.0, "the base's +Y is left in the picture");
    }

    #[test]
    fn a_calibration_has_an_error_of_a_tenth_of_a_millimetre() {
        for seed in 0..20 {
            let found = calibrated_mount(Seed(seed), 0, &base_from_camera());
            let error = base_from_camera().inverse() * found;
            assert!((error.origin().mm.coords.norm() - 0.1).abs() < 1e-9);
            assert!((error.rotation_angle().0 - 0.01).abs() < 1e-9);
        }
    }

    #[test]
    fn the_panels_displacement_stays_within_its_limits() {
        let centre = Point::<Panel>::at(560.0, 0.0, 360.0);
        for seed in 0..200 {
            let place = displaced_pose(Seed(seed), 0);
            let shift = (place * centre).mm - centre.mm;
            assert!(shift.norm() <= MAX_SHIFT_MM && shift.norm() > 2.0 && shift.x.abs() <= 15.0, "{shift}");
            assert!(
                place.rotation_angle().0 <= MAX_ROTATION_DEG && place.rotation_angle().0 > 2.0,
                "{}",
                place.rotation_angle()
            );
        }
    }

    /// The panel stays in front of the fixture, which begins at X = 650 mm.
    #[test]
    fn a_displaced_panel_stays_in_the_search_box() {
        let [low, high] = super::super::SEARCH_BOX_MM;
        for seed in 0..200 {
            for shape in [Shape::taught(Seed(seed)), Shape::random_other(Seed(seed))] {
                let place = displaced_pose(Seed(seed), 0);
                for p in shape.outline().polyline(10.0) {
                    let mm = (place * shape.point([p.x, p.y])).mm;
                    assert!(
                        (0..3).all(|axis| mm[axis] > low[axis] + 5.0 && mm[axis] < high[axis] - 5.0),
                        "{seed}: {mm}"
                    );
                }
            }
        }
    }

    #[test]
    fn from_a_corner_pose_the_corner_is_near_the_middle() {
        let camera = flange_camera(1);
        for view in corner_views(&Shape::taught(Seed(1))) {
            let base_from_camera = view.base_from_flange * flange_from_camera();
            let seen = base_from_camera.inverse() * (nominal() * view.corner);
            let pixel = camera.project(seen).expect("in front");
            assert!((seen.mm.z - 235.0).abs() < 1e-6, "{seen:?}");
            assert!((pixel.u - 1024.0).abs() < 150.0 && (pixel.v - 768.0).abs() < 150.0, "{pixel:?}");
        }
    }

    /// Expected values, calculated by hand: from (0, 0, 360) in the direction of X the plate is 665 mm away; at Y = 95
    /// a post, 650 mm away.
    #[test]
    fn rays_meet_the_plate_and_a_post() {
        let from = |y: f64| Point3::new(0.0, y, 360.0);
        let plate = intersect_fixture(&from(0.0), &Vector3::x(), 1e-3);
        assert!((plate.depth_mm.expect("a plate") - 665.0).abs() < 1e-9 && plate.color[0] > 170.0);
        let post = intersect_fixture(&from(95.0), &Vector3::x(), 1e-3);
        assert!((post.depth_mm.expect("a post") - 650.0).abs() < 1e-9 && post.color[0] < 170.0);
    }

    /// The x axis of a slab's frame is the base's Y axis, and its y axis points upwards: the corners of a fixture part
    /// are the corners of its slab.
    #[test]
    fn each_fixture_part_is_a_slab_of_its_size() {
        for (board, slab) in FIXTURE_BOARDS.iter().zip(occluders()) {
            let corner = Point3::new(board.x_mm, board.y_mm[1], board.z_mm[1]);
            let at = slab.base_from_slab.inverse_transform_point(&corner);
            assert!((at.x.abs() - slab.half_mm[0]).abs() < 1e-9 && (at.y - slab.half_mm[1]).abs() < 1e-9, "{at}");
            assert!(at.z.abs() < 1e-9, "{at}");
        }
    }

    #[test]
    fn a_ray_beside_the_plate_meets_the_hall() {
        let hall = intersect_fixture(&Point3::new(0.0, 0.0, 900.0), &Vector3::x(), 1e-3);
        assert_eq!((hall.depth_mm, hall.color), (None, HALL_COLOR));
        assert_eq!(intersect_fixture(&Point3::new(0.0, 0.0, 360.0), &-Vector3::x(), 1e-3).depth_mm, None);
    }

    /// Expected values, calculated by hand: a slab of 40 × 20 mm, perpendicular to X at 500 mm. Its edge is 20 mm from
    /// the middle; a pixel centred on the edge is covered by one half.
    #[test]
    fn a_ray_meets_a_slab_up_to_its_edge() {
        let slab = Slab::facing(Point3::new(500.0, 0.0, 0.0), -Vector3::x(), 0.0, [20.0, 10.0], [100.0; 3]);
        let look =
            |y: f64, z: f64| slab.intersect(&Point3::origin(), &Vector3::new(1.0, y / 500.0, z / 500.0), 1e-3);
        let middle = look(0.0, 0.0).expect("met");
        assert!((middle.depth_mm - 500.0).abs() < 1e-9 && (middle.cos_incidence - 1.0).abs() < 1e-9);
        assert!((look(20.0, 0.0).expect("met").share - 0.5).abs() < 1e-9);
        assert!(look(0.0, 11.0).is_none());
    }
}
