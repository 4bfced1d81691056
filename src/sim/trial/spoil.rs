//! Makes a good scene wrong.

use super::Trial;
use super::wrong::Wrong;
use crate::geometry::{Camera, Rigid};
use crate::sim::clutter::Slab;
use crate::sim::{scene, variety};
use nalgebra::{Isometry3, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

impl Trial {
    /// Makes a good scene wrong in this way; what must be hidden already is.
    pub(super) fn spoil(&mut self, panel: &variety::Panel, wrong: Wrong, random: &mut Pcg64) {
        let sign = if random.random::<bool>() { 1.0 } else { -1.0 };
        self.present = match wrong {
            Wrong::Nothing => None,
            Wrong::Another => Some(variety::Panel::any(random).shape()),
            Wrong::Mirror => Some(panel.mirrored().shape()),
            Wrong::Back => Some(panel.back().shape()),
            Wrong::Size => Some(panel.scaled(1.0 + sign * random.random_range(0.02..0.05)).shape()),
            Wrong::Bent => Some(panel.bent(sign * random.random_range(2.0..5.0)).shape()),
            Wrong::Trimmed => Some(panel.trimmed(random.random_range(12.0..60.0)).shape()),
            _ => self.present.take(),
        };
        if wrong == Wrong::CameraMoved {
            let axis = |random: &mut Pcg64| Vector3::from_fn(|_, _| random.random_range(-1.0..1.0f64)).normalize();
            let shift = axis(random) * random.random_range(1.0..10.0);
            let turn = axis(random) * random.random_range(0.0..0.01);
            let moved: Rigid<Camera, Camera> = Rigid::claim(Isometry3::new(shift, turn));
            self.camera_now = scene::base_from_camera() * moved;
        }
        if wrong == Wrong::Nothing {
            // Something of the panel's size, and flat.
            let [length, width] = self.size_mm;
            let centre = (self.place * self.taught.point([0.0, 0.0])).mm;
            let normal = (self.place * self.taught.normal([0.0, 0.0])).mm;
            let spin = random.random_range(0.0..3.0);
            if sign > 0.0 {
                self.slabs.push(Slab::facing(centre, normal, spin, [length / 2.0, width / 2.0], [90.0; 3]));
            }
        }
    }
}
