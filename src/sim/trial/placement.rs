//! Draws the panel's pose of a trial: in the box, in front of the fixture, among other objects, and with the required
//! visible fraction. Also adds a defect to a good scene.

use super::TrialScene;
use super::contents::{SceneDefect, TRIAL_BOX_MM, sheet_points};
use crate::scanner::Projector;
use crate::scene::Slab;
use crate::shape::CENTRE_MM;
use crate::{scene, variety};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Camera, Panel, Rigid};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::ops::Range;

/// Maximum X of the panel's points, mm, so that the panel is in front of the fixture.
const MAX_X_MM: f64 = 628.0;
const MAX_HIDDEN: f64 = 0.195;

impl TrialScene {
    /// Draws poses until one is valid: in front of the fixture, in the box, and with the required visible fraction.
    pub(super) fn draw_valid_pose(&mut self, random: &mut Pcg64, wrong: Option<SceneDefect>) {
        let share = match wrong {
            Some(SceneDefect::Hidden) => 0.42..0.65,
            Some(SceneDefect::OutOfView) => 0.36..0.6,
            // The cut-off strip must be in the camera's view, so that the camera can detect that it is missing.
            Some(SceneDefect::Trimmed) => 0.0..1e-9,
            _ => 0.0..MAX_HIDDEN,
        };
        let lattice = sheet_points(&self.taught);
        loop {
            let tilt_deg = random.random_range(0.0..30.0);
            let turn_deg = random.random_range(-180.0..180.0);
            let aside = if wrong == Some(SceneDefect::OutOfView) { 400.0 } else { 160.0 };
            let centre = Vector3::new(
                random.random_range(450.0..590.0),
                random.random_range(-aside..aside),
                360.0 + random.random_range(-aside / 1.6..aside / 1.6),
            );
            self.place = make_pose(centre, turn_deg, tilt_deg, random.random_range(0.0..std::f64::consts::TAU));
            // A panel that is partly out of view may also be partly outside of the box.
            let axes = if wrong == Some(SceneDefect::OutOfView) { 0..1 } else { 0..3 };
            if !self.is_valid_pose(&self.place, &lattice, axes) {
                continue;
            }
            self.slabs = add_distractors(random, &self.place);
            let covers = match wrong {
                Some(SceneDefect::Hidden) => 2,
                Some(SceneDefect::OutOfView) => 0,
                _ => random.random_range(0..3),
            };
            for _ in 0..covers {
                self.slabs.push(self.occluding_slab(random, &lattice, wrong == Some(SceneDefect::Hidden)));
            }
            self.hidden_fraction = self.hidden_fraction_at(&self.place, &lattice);
            if share.contains(&self.hidden_fraction) {
                break;
            }
        }
        for _ in 0..random.random_range(0..3) {
            let place = lattice[random.random_range(0..lattice.len())];
            self.glints.push((place, random.random_range(3.0..9.0)));
        }
    }

    /// Returns whether every point of the panel faces the camera.
    fn faces_camera(&self, place: &Rigid<Base, Panel>, lattice: &[[f64; 2]]) -> bool {
        let eye = scene::base_from_camera().origin();
        lattice.iter().all(|&at| {
            let (point, normal) = (*place * self.taught.point(at), *place * self.taught.normal(at));
            let towards = (eye - point).mm;
            normal.mm.dot(&towards) > 0.3 * towards.norm()
        })
    }

    /// Returns a slab at a random position between the camera and a point of the panel.
    fn occluding_slab(&self, random: &mut Pcg64, lattice: &[[f64; 2]], large: bool) -> Slab {
        let eye = scene::base_from_camera().origin().mm;
        let at = lattice[random.random_range(0..lattice.len())];
        let point = (self.place * self.taught.point(at)).mm;
        let towards = (eye - point).normalize();
        let centre = point + towards * random.random_range(60.0..180.0);
        let size = if large { 40.0..130.0 } else { 6.0..55.0 };
        let half = [random.random_range(size.clone()), random.random_range(size)];
        let gray = random.random_range(40.0..190.0);
        Slab::facing(centre, towards, random.random_range(0.0..3.0), half, [gray, gray, gray * 0.95])
    }

    /// Returns whether a panel at this pose is inside of the box along these axes, in front of the fixture, and facing
    /// the camera.
    fn is_valid_pose(&self, place: &Rigid<Base, Panel>, lattice: &[[f64; 2]], axes: Range<usize>) -> bool {
        let [low, high] = TRIAL_BOX_MM;
        let is_inside = |&at: &[f64; 2]| {
            let p = (*place * self.taught.point(at)).mm;
            p.x < MAX_X_MM && axes.clone().all(|axis| p[axis] > low[axis] + 4.0 && p[axis] < high[axis] - 4.0)
        };
        lattice.iter().all(is_inside) && self.faces_camera(place, lattice)
    }

    /// Returns the fraction of these points of a panel at this pose that the camera or the projector does not see.
    fn hidden_fraction_at(&self, place: &Rigid<Base, Panel>, lattice: &[[f64; 2]]) -> f64 {
        let base_from_camera = scene::base_from_camera();
        let camera_from_base = base_from_camera.inverse();
        let eye = base_from_camera.origin().mm;
        let projector = Projector::new(&base_from_camera, Some((&self.taught, place)), &self.slabs);
        let hidden = |&&at: &&[f64; 2]| {
            let point = *place * self.taught.point(at);
            let seen = camera_from_base * point;
            self.camera.project_inside(seen).is_none()
                || self.slabs.iter().any(|slab| is_occluded_by(slab, &eye, &(point.mm - eye)))
                || !projector.is_lit(&seen.mm.coords, None)
        };
        lattice.iter().filter(hidden).count() as f64 / lattice.len() as f64
    }
}

/// Returns whether a slab is between the camera and the end of a ray.
fn is_occluded_by(slab: &Slab, eye: &Point3<f64>, ray: &Vector3<f64>) -> bool {
    let length_mm = ray.norm();
    let met = slab.intersect(eye, &(ray / length_mm), 1e-6);
    met.is_some_and(|met| met.share > 0.5 && met.depth_mm < length_mm - 1.0)
}

/// Creates a pose from the panel's centre, its rotation about the normal, and its tilt about a direction in the plane.
fn make_pose(centre: Vector3<f64>, turn_deg: f64, tilt_deg: f64, about_rad: f64) -> Rigid<Base, Panel> {
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), turn_deg.to_radians());
    let axis = Unit::new_normalize(Vector3::new(0.0, about_rad.cos(), about_rad.sin()));
    let rotation =
        UnitQuaternion::from_rotation_matrix(&(Rotation3::from_axis_angle(&axis, tilt_deg.to_radians()) * turn));
    Rigid::from_isometry_unchecked(Isometry3::from_parts(
        Translation3::from(centre - rotation * Vector3::from(CENTRE_MM)),
        rotation,
    ))
}

/// Draws objects in the box beside and behind the panel; few of them hide a part of the panel.
fn add_distractors(random: &mut Pcg64, place: &Rigid<Base, Panel>) -> Vec<Slab> {
    let middle = place.isometry() * Point3::from(CENTRE_MM);
    let count = random.random_range(2..6);
    (0..count)
        .map(|_| {
            let angle = random.random_range(0.0..std::f64::consts::TAU);
            let away = random.random_range(150.0..330.0);
            let centre = Point3::new(
                random.random_range(540.0..632.0),
                middle.y + away * angle.cos(),
                middle.z + away * angle.sin(),
            );
            let normal = Vector3::new(-1.0, random.random_range(-0.7..0.7), random.random_range(-0.7..0.7));
            let half = [random.random_range(8.0..60.0), random.random_range(8.0..60.0)];
            let gray = random.random_range(30.0..200.0);
            Slab::facing(centre, normal.normalize(), random.random_range(0.0..3.0), half, [gray, gray, 0.9 * gray])
        })
        .collect()
}

/// Maximum number of poses that are tried for a second panel.
const MAX_DRAWS: usize = 2_000;

impl TrialScene {
    /// Adds this defect to a good scene. If the defect hides a part of the panel, the scene already has the objects
    /// that hide it.
    pub(super) fn add_defect(&mut self, panel: &variety::Panel, wrong: SceneDefect, random: &mut Pcg64) {
        let sign = if random.random::<bool>() { 1.0 } else { -1.0 };
        self.present = match wrong {
            SceneDefect::Nothing => None,
            SceneDefect::Another => Some(variety::Panel::random(random).shape()),
            SceneDefect::Mirror => Some(panel.mirror_image().shape()),
            SceneDefect::Back => Some(panel.turned_over().shape()),
            SceneDefect::Size => Some(panel.scaled_copy(1.0 + sign * random.random_range(0.02..0.05)).shape()),
            SceneDefect::Bent => Some(panel.bent_copy(sign * random.random_range(2.0..5.0)).shape()),
            SceneDefect::Warped => Some(panel.bent_copy(sign * random.random_range(1.0..2.0)).shape()),
            SceneDefect::Trimmed => Some(panel.trimmed_copy(random.random_range(12.0..60.0)).shape()),
            _ => self.present.take(),
        };
        if wrong == SceneDefect::CameraMoved {
            let axis = |random: &mut Pcg64| Vector3::from_fn(|_, _| random.random_range(-1.0..1.0f64)).normalize();
            let shift = axis(random) * random.random_range(1.0..10.0);
            let turn = axis(random) * random.random_range(0.0..0.01);
            let moved: Rigid<Camera, Camera> = Rigid::from_isometry_unchecked(Isometry3::new(shift, turn));
            self.camera_now = scene::base_from_camera() * moved;
        }
        if wrong == SceneDefect::HolderMoved {
            (self.is_held, self.is_holder_moved) = (true, true);
        }
        if wrong == SceneDefect::TwoPanels {
            self.second_panel = self.second_panel_pose(random);
        }
        if wrong == SceneDefect::Nothing {
            // A flat object of the panel's size replaces the panel.
            let [length, width] = self.size_mm;
            let centre = (self.place * self.taught.point([0.0, 0.0])).mm;
            let normal = (self.place * self.taught.normal([0.0, 0.0])).mm;
            let spin = random.random_range(0.0..3.0);
            if sign > 0.0 {
                self.slabs.push(Slab::facing(centre, normal, spin, [length / 2.0, width / 2.0], [90.0; 3]));
            }
        }
    }

    /// Returns a pose beside the panel at which a second panel of the same kind has the visible fraction of a good
    /// panel.
    fn second_panel_pose(&self, random: &mut Pcg64) -> Option<Rigid<Base, Panel>> {
        let lattice = sheet_points(&self.taught);
        let middle = self.place.isometry() * Point3::from(CENTRE_MM);
        let [length, width] = self.size_mm;
        let draw = |_| {
            let away_mm = length.hypot(width) + random.random_range(5.0..60.0);
            let angle = random.random_range(0.0..std::f64::consts::TAU);
            let aside = Vector3::new(0.0, angle.cos(), angle.sin()) * away_mm;
            let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), random.random_range(-3.0..3.0));
            let about = Translation3::from(middle.coords + aside) * turn * Translation3::from(-middle.coords);
            Rigid::from_isometry_unchecked(about * self.place.isometry())
        };
        (0..MAX_DRAWS).map(draw).find(|place| {
            self.is_valid_pose(place, &lattice, 0..3) && self.hidden_fraction_at(place, &lattice) < MAX_HIDDEN
        })
    }
}
