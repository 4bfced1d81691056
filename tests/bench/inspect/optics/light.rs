//! The light that the panel and the water reflect: from a diffuser above the cell with dark gaps and a hole for the
//! camera, from the robot and from the room; and the laws of reflection.
//!
//! All sources lie in one plane above the panel, which a mirrored ray intersects. Radiance is relative to the
//! diffuser's middle.
//!
//! - Refractive index of water 1.333 at 20 °C and 589 nm (IAPWS R9-97, 1997), of a cured epoxy surface 1.55 (range
//!   1.50–1.57, Hull and Clyne, An Introduction to Composite Materials, 1996).
//! - Fresnel's equations for unpolarised light (Born and Wolf, Principles of Optics, 1.5.2).
//! - At the water's surface, 0.474 of diffuse light from below is reflected back into the water, and 0.066 of diffuse
//!   light from above (Egan and Hilgeman, Appl. Opt. 12, 1973; Lekner and Dorf, Appl. Opt. 27, 1988). A wet surface of
//!   diffuse reflectance ρ has the reflectance  ρ (1 − 0.066)(1 − F)/(n² (1 − 0.474 ρ)).
//! - A rough surface mirrors a scene blurred by twice the angle of its slopes (Beckmann and Spizzichino 1963; Cook and
//!   Torrance 1982); a tool leaves slopes of 0.06 rad rms on a prepreg, a peel ply up to 0.45.

use super::random::Random;

pub const WATER: f64 = 1.333;
pub const RESIN: f64 = 1.55;
const DIFFUSE_IN: f64 = 0.066;
const DIFFUSE_BACK: f64 = 0.474;

/// Returns Fresnel's reflectance for unpolarised light from air onto a material with this refractive index.
pub fn fresnel(cos_in: f64, index: f64) -> f64 {
    let c = cos_in.clamp(0.0, 1.0);
    let t = (1.0 - (1.0 - c * c) / (index * index)).sqrt();
    let s = ((c - index * t) / (c + index * t)).powi(2);
    let p = ((index * c - t) / (index * c + t)).powi(2);
    (s + p) / 2.0
}

/// Returns the diffuse reflectance of a surface under a film of water. `rho` is the diffuse reflectance of the dry
/// surface, `f` the reflectance of the water's surface in the camera's direction.
pub fn wet_diffuse(rho: f64, f: f64) -> f64 {
    rho * (1.0 - DIFFUSE_IN) * (1.0 - f) / (WATER * WATER * (1.0 - DIFFUSE_BACK * rho))
}

/// Returns the reflectance of resin under water at nearly normal incidence.
pub fn under_water() -> f64 {
    ((RESIN - WATER) / (RESIN + WATER)).powi(2)
}

/// A rectangle with uniform radiance in the plane above the panel.
#[derive(Debug, Clone, Copy)]
struct Patch {
    centre: [f64; 2],
    half: [f64; 2],
    rgb: [f64; 3],
}

/// The light sources and dark objects above the panel.
#[derive(Debug, Clone)]
pub struct Surroundings {
    /// Height of the plane above the camera, mm; its z in the camera's frame is the negative of this value.
    pub above_mm: f64,
    diffuser: Patch,
    /// Dark bars across the diffuser: the distance between two bars, and half of their width, mm.
    bars: Option<(f64, f64)>,
    /// Dark patches that hide parts of the diffuser, as seen from the panel.
    dark: Vec<Patch>,
    room: [f64; 3],
    /// A projector's lens: position, radius and radiance.
    pub projector: Option<([f64; 2], f64, f64)>,
}

/// Blur of the mirrored objects in the plane, mm: they are out of the camera's focus.
const SOFT_MM: f64 = 9.0;

fn step(x: f64, soft: f64) -> f64 {
    let t = (x / soft + 0.5).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Returns the cumulative distribution function of the normal distribution, accurate to 1e-3 (Bowling et al. 2009).
fn cumulative(x: f64) -> f64 {
    1.0 / (1.0 + (-1.5976 * x - 0.070_56 * x * x * x).exp())
}

impl Patch {
    fn cover(&self, at: [f64; 2]) -> f64 {
        (0..2).map(|i| step(self.half[i] - (at[i] - self.centre[i]).abs(), SOFT_MM)).product()
    }

    fn blurred(&self, at: [f64; 2], sigma_mm: f64) -> f64 {
        let share = |i: usize| {
            let (low, high) = (self.centre[i] - self.half[i] - at[i], self.centre[i] + self.half[i] - at[i]);
            cumulative(high / sigma_mm) - cumulative(low / sigma_mm)
        };
        share(0) * share(1)
    }
}

/// The position of the diffuser in the mirror image that the camera sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// The diffuser is to the side: the film mirrors the dark room.
    Dark,
    /// The diffuser covers everything above the panel: the whole film mirrors it.
    Bright,
    /// The film mirrors the diffuser's edge and gaps, and the robot.
    Mixed,
}

impl Surroundings {
    pub fn new(field: Field, has_projector: bool, random: &mut Random) -> Self {
        let above_mm = random.between(250.0, 450.0);
        let (centre, half) = match field {
            Field::Dark => {
                let side = if random.chance(0.5) { 1.0 } else { -1.0 };
                let half = [random.between(300.0, 450.0), random.between(500.0, 700.0)];
                ([side * (half[0] + random.between(680.0, 900.0)), random.between(-100.0, 100.0)], half)
            }
            Field::Bright => ([0.0, 0.0], [random.between(1100.0, 1400.0), random.between(900.0, 1200.0)]),
            Field::Mixed => {
                let half = [random.between(350.0, 600.0), random.between(300.0, 600.0)];
                ([random.between(-400.0, 400.0), random.between(-300.0, 300.0)], half)
            }
        };
        let tint = random.between(-0.04, 0.04);
        let room = random.between(0.01, 0.1);
        let mut dark = vec![];
        if field != Field::Dark {
            // The camera, 60 mm wide, in front of the diffuser.
            dark.push(Patch { centre: [0.0, 0.0], half: [30.0, 30.0], rgb: [0.01; 3] });
        }
        if field == Field::Mixed {
            let centre = [random.between(-500.0, 500.0), random.between(-400.0, 400.0)];
            let half = [random.between(60.0, 160.0), random.between(150.0, 400.0)];
            dark.push(Patch { centre, half, rgb: [0.09, 0.04, 0.01] });
        }
        let bars = (field == Field::Mixed).then(|| (random.between(250.0, 450.0), random.between(8.0, 25.0)));
        let at = [random.between(-250.0, 250.0), random.between(-150.0, 150.0)];
        Surroundings {
            above_mm,
            diffuser: Patch { centre, half, rgb: [1.0 + tint, 1.0, 1.0 - tint] },
            bars,
            dark,
            room: [room * random.between(0.9, 1.2), room, room * random.between(0.9, 1.3)],
            projector: has_projector.then_some((at, random.between(9.0, 16.0), 400.0)),
        }
    }

    /// Returns the radiance of each channel at a point of the plane.
    pub fn radiance(&self, at: [f64; 2]) -> [f64; 3] {
        let mut cover = self.diffuser.cover(at);
        let away = (0..2).map(|i| ((at[i] - self.diffuser.centre[i]) / self.diffuser.half[i]).powi(2)).sum::<f64>();
        // A light box is darker by a fifth at its border.
        let even = 1.0 - 0.2 * (away / 2.0).min(1.0);
        if let Some((every, half)) = self.bars {
            let x = (at[0] - self.diffuser.centre[0]).rem_euclid(every);
            cover *= 1.0 - 0.92 * step(half - (x - every / 2.0).abs(), SOFT_MM);
        }
        let mut rgb: [f64; 3] =
            std::array::from_fn(|i| self.room[i] + (self.diffuser.rgb[i] * even - self.room[i]) * cover);
        for patch in &self.dark {
            let cover = patch.cover(at);
            rgb = std::array::from_fn(|i| rgb[i] + (patch.rgb[i] - rgb[i]) * cover);
        }
        if let Some((place, radius, bright)) = self.projector {
            let away = (at[0] - place[0]).hypot(at[1] - place[1]);
            let cover = step(radius - away, SOFT_MM);
            rgb = rgb.map(|level| level + bright * cover);
        }
        rgb
    }

    /// Returns the radiance of the scene, blurred by a reflection lobe of this width.
    pub fn blurred(&self, at: [f64; 2], sigma_mm: f64) -> [f64; 3] {
        let cover = self.diffuser.blurred(at, sigma_mm);
        let mut rgb: [f64; 3] =
            std::array::from_fn(|i| self.room[i] + (0.93 * self.diffuser.rgb[i] - self.room[i]) * cover);
        for patch in &self.dark {
            let cover = patch.blurred(at, sigma_mm);
            rgb = std::array::from_fn(|i| rgb[i] + (patch.rgb[i] - rgb[i]) * cover);
        }
        if let Some((place, radius, bright)) = self.projector {
            let away = (at[0] - place[0]).hypot(at[1] - place[1]) / sigma_mm;
            let cover = (radius / sigma_mm).powi(2) / 2.0 * (-away * away / 2.0).exp();
            rgb = rgb.map(|level| level + bright * cover);
        }
        rgb
    }

    /// Returns the irradiance divided by π at a point of the panel in the camera's frame; the normal is along the
    /// camera's axis.
    pub fn irradiance(&self, place: [f64; 3]) -> [f64; 3] {
        const N: usize = 6;
        let height = place[2] + self.above_mm;
        let area = 4.0 * self.diffuser.half[0] * self.diffuser.half[1] / (N * N) as f64;
        let mut share = 0.0;
        for index in 0..N * N {
            let at = |i: usize, k: usize| {
                self.diffuser.centre[i] + self.diffuser.half[i] * ((2 * k + 1) as f64 / N as f64 - 1.0)
            };
            let (dx, dy) = (at(0, index % N) - place[0], at(1, index / N) - place[1]);
            let r2 = dx * dx + dy * dy + height * height;
            share += area * height * height / (std::f64::consts::PI * r2 * r2);
        }
        let share = share.min(1.0);
        std::array::from_fn(|i| 0.88 * self.diffuser.rgb[i] * share + self.room[i] * (1.0 - share))
    }
}
