//! The poses of all objects: both cameras, their calibrations, the panel's two places and the taught corner poses.

use super::noise::{NormalStream, RandomPurpose, Seed};
use super::shape::{CENTRE_MM, Shape};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{
    Base, Camera, Degrees, Flange, FlangeCamera, Frame, Panel, PinholeCamera, Point, Rigid, Vector,
};
use strum::{IntoStaticStr, VariantArray};

/// The objects in the cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Scene {
    /// The taught panel, displaced, with greasy spots.
    Good,
    /// The taught panel, displaced, without grease.
    Clean,
    /// The fixture alone.
    NoPanel,
    /// A panel other than the taught panel.
    WrongPanel,
}

impl Scene {
    /// Every scene.
    pub const ALL: &'static [Scene] = <Self as VariantArray>::VARIANTS;

    /// The scene's keyword, which users use in scripts.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}

/// The fixed 3D camera, a Zivid Two, with its picture made smaller by a whole factor.
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

/// The colour camera on the flange, with its picture made smaller by a whole factor.
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

/// The 3D camera's pose: beside and above the robot, with the panel's centre in the middle of its picture.
pub(super) fn base_from_camera() -> Rigid<Base, Camera> {
    let eye = Point3::new(-100.0, -250.0, 700.0);
    let forward = (Point3::from(CENTRE_MM) - eye).normalize();
    let right = (-Vector3::z()).cross(&forward).normalize();
    let axes = [right, forward.cross(&right), forward].map(Vector::new);
    Rigid::from_axes(axes, Point::new(eye))
}

/// The flange camera's mounting: beside the tool along the flange's X, slightly tilted, looking in the tool's
/// direction.
pub(super) fn flange_from_camera() -> Rigid<Flange, FlangeCamera> {
    let tilt = UnitQuaternion::from_scaled_axis(Vector3::new(0.8, -3.0, 0.6).map(f64::to_radians));
    Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::new(80.0, 4.0, 30.0), tilt))
}

/// The error of a calibrated mount: a shift of this length and a rotation by this angle, each in a random
/// direction.
const MOUNT_ERROR_MM: f64 = 0.1;
const MOUNT_ERROR_DEG: f64 = 0.01;

/// Returns the mount that a calibration would find, with its error. `index` distinguishes the mounts of a cell.
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

/// The panel's nominal pose: its frame is the base's (thesis 3.8).
pub(super) fn nominal() -> Rigid<Base, Panel> {
    Rigid::from_isometry_unchecked(Isometry3::identity())
}

const MAX_SHIFT_MM: f64 = 25.0;
const MAX_TURN_DEG: f64 = 8.0;
/// Factor of the shift along the panel's normal: it is smaller than sideways, so that the panel stays clear of the
/// fixture.
const NORMAL_SHIFT_FACTOR: f64 = 0.6;

/// The panel's displaced pose: shifted by up to 25 mm and turned by up to 8° about its centre; different for each
/// number.
pub(super) fn displaced_pose(seed: Seed, place: u32) -> Rigid<Base, Panel> {
    let mut normal = NormalStream::new(seed.stream(RandomPurpose::Placement, u64::from(place)));
    let mut shift = direction(&mut normal) * (MAX_SHIFT_MM * (0.3 + 0.7 * normal.share()));
    shift.x *= NORMAL_SHIFT_FACTOR;
    let turn = direction(&mut normal) * (Degrees(MAX_TURN_DEG).to_rad() * (0.3 + 0.7 * normal.share()));
    let centre = Vector3::from(CENTRE_MM);
    let turned = UnitQuaternion::from_scaled_axis(turn);
    Rigid::from_isometry_unchecked(Isometry3::from_parts(
        Translation3::from(centre + shift - turned * centre),
        turned,
    ))
}

/// The view of a panel's corner from which the corner is taught to the flange camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerView {
    /// The name of the corner in the picture: the direction from the panel's inside to the corner.
    pub name: &'static str,
    /// The corner: the intersection of its two extended straight edges, on the surface.
    pub corner: Point<Panel>,
    /// The flange's pose for the panel at its nominal pose.
    pub base_from_flange: Rigid<Base, Flange>,
}

/// Distance from which the flange camera looks at a corner, mm.
const CORNER_DISTANCE_MM: f64 = 235.0;

/// Returns two corners, far apart, in the order in which they are to be used.
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
    // The corner is not quite central: no result may depend on a corner in the middle.
    let eye = corner.mm - forward * CORNER_DISTANCE_MM + right * aside_mm[0] + down * aside_mm[1];
    let base_from_camera: Rigid<Base, FlangeCamera> =
        Rigid::from_axes([right, down, forward].map(Vector::new), Point::new(eye));
    CornerView { name, corner, base_from_flange: base_from_camera * flange_from_camera().inverse() }
}

/// Returns the flange pose, changed by up to 5 mm and 1°, as a robot reaches it after a rough localization.
pub(super) fn perturbed_flange_pose(
    seed: Seed,
    index: u64,
    base_from_flange: &Rigid<Base, Flange>,
) -> Rigid<Base, Flange> {
    let mut normal = NormalStream::new(seed.stream(RandomPurpose::FlangePose, index));
    let shift = direction(&mut normal) * (5.0 * (0.2 + 0.8 * normal.share()));
    let turn = direction(&mut normal) * (Degrees(1.0).to_rad() * (0.2 + 0.8 * normal.share()));
    *base_from_flange * Rigid::<Flange, Flange>::from_isometry_unchecked(Isometry3::new(shift, turn))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: the panel's centre is √(660² + 250² + 340²) = √613700 = 783.39 mm in front of the
    /// camera, in the middle of its picture.
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
    fn a_calibration_is_a_tenth_of_a_millimetre_off() {
        for seed in 0..20 {
            let found = calibrated_mount(Seed(seed), 0, &base_from_camera());
            let error = base_from_camera().inverse() * found;
            assert!((error.origin().mm.coords.norm() - 0.1).abs() < 1e-9);
            assert!((error.turn().0 - 0.01).abs() < 1e-9);
        }
    }

    #[test]
    fn the_panel_moves_within_its_limits_about_its_centre() {
        let centre = Point::<Panel>::at(560.0, 0.0, 360.0);
        for seed in 0..200 {
            let place = displaced_pose(Seed(seed), 0);
            let shift = (place * centre).mm - centre.mm;
            assert!(shift.norm() <= MAX_SHIFT_MM && shift.norm() > 2.0 && shift.x.abs() <= 15.0, "{shift}");
            assert!(place.turn().0 <= MAX_TURN_DEG && place.turn().0 > 2.0, "{}", place.turn());
        }
    }

    /// The fixture begins at X = 650 mm.
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
    fn corner_poses_put_the_corner_near_the_middle() {
        let camera = flange_camera(1);
        for view in corner_views(&Shape::taught(Seed(1))) {
            let base_from_camera = view.base_from_flange * flange_from_camera();
            let seen = base_from_camera.inverse() * (nominal() * view.corner);
            let pixel = camera.project(seen).expect("in front");
            assert!((seen.mm.z - 235.0).abs() < 1e-6, "{seen:?}");
            assert!((pixel.u - 1024.0).abs() < 150.0 && (pixel.v - 768.0).abs() < 150.0, "{pixel:?}");
        }
    }
}
