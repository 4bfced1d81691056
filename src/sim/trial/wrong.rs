//! What can be wrong with a trial's scene.

use super::Trial;
use crate::geometry::{Camera, Rigid};
use crate::sim::clutter::Slab;
use crate::sim::{scene, variety};
use nalgebra::{Isometry3, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

/// What is wrong with a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrong {
    /// No panel: things alone.
    Nothing,
    /// Another panel.
    Another,
    /// Its mirror image.
    Mirror,
    /// Its back.
    Back,
    /// One that is 2 to 5 % larger or smaller.
    Size,
    /// One that is bent by 2 to 5 mm.
    Bent,
    /// One that has a strip of its length cut off.
    Trimmed,
    /// More than 40 % is hidden.
    Hidden,
    /// More than 35 % is outside of the picture.
    OutOfView,
    /// One that looks the same turned by half a turn.
    Symmetric,
    /// The camera has moved since teaching, by 1 to 10 mm.
    CameraMoved,
    /// Water on the panel: most points are missing, many are wrong.
    Wet,
    /// The panel moved during the scan: the picture is smeared.
    Smeared,
}

impl Wrong {
    /// Every kind.
    pub const ALL: [Wrong; 13] = [
        Wrong::Nothing,
        Wrong::Another,
        Wrong::Mirror,
        Wrong::Back,
        Wrong::Size,
        Wrong::Bent,
        Wrong::Trimmed,
        Wrong::Hidden,
        Wrong::OutOfView,
        Wrong::Symmetric,
        Wrong::CameraMoved,
        Wrong::Wet,
        Wrong::Smeared,
    ];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Wrong::Nothing => "no panel",
            Wrong::Another => "another panel",
            Wrong::Mirror => "mirror image",
            Wrong::Back => "its back",
            Wrong::Size => "2 to 5 % off in size",
            Wrong::Bent => "bent by 2 to 5 mm",
            Wrong::Trimmed => "a strip cut off",
            Wrong::Hidden => "over 40 % hidden",
            Wrong::OutOfView => "over 35 % out of view",
            Wrong::Symmetric => "symmetric",
            Wrong::CameraMoved => "camera moved",
            Wrong::Wet => "wet",
            Wrong::Smeared => "moved while scanned",
        }
    }
}

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
