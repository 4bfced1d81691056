//! Adds a defect to a good scene.

use super::TrialScene;
use super::placement::MAX_HIDDEN;
use super::scene_defects::SceneDefect;
use super::space::sheet_points;
use crate::distractors::Slab;
use crate::shape::CENTRE_MM;
use crate::{scene, variety};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Camera, Panel, Rigid};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Number of poses that are tried for a second panel.
const MAX_DRAWS: usize = 2_000;

impl TrialScene {
    /// Adds this defect to a good scene. For defects that hide a part of the panel, the scene is already prepared.
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
            self.second_panel = self.second(random);
        }
        if wrong == SceneDefect::Nothing {
            // A flat object of the panel's size.
            let [length, width] = self.size_mm;
            let centre = (self.place * self.taught.point([0.0, 0.0])).mm;
            let normal = (self.place * self.taught.normal([0.0, 0.0])).mm;
            let spin = random.random_range(0.0..3.0);
            if sign > 0.0 {
                self.slabs.push(Slab::facing(centre, normal, spin, [length / 2.0, width / 2.0], [90.0; 3]));
            }
        }
    }

    /// Returns a pose beside the panel at which a second panel of the same kind is as visible as a good panel must be.
    fn second(&self, random: &mut Pcg64) -> Option<Rigid<Base, Panel>> {
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
            self.is_valid_place(place, &lattice, 0..3) && self.hidden_share_at(place, &lattice) < MAX_HIDDEN
        })
    }
}
