//! The water: the thickness of the film, the slope of its surface, and where and when the film opens.
//!
//! - Draining from a plate: h = h₀/√(1 + t/T) (Jeffreys, Proc. Camb. Phil. Soc. 26, 1930), initially 100 to 300 µm,
//!   with T a few seconds on a plate that is inclined by degrees.
//! - Waves on the film fade as it becomes thinner (levelling by gravity and surface tension, Orchard, Appl. Sci. Res. A
//!   11, 1962) and run downhill at millimetres per second: Nusselt's surface velocity ρ g h² sin α/2μ is 4 mm/s for 100
//!   µm and 5°.
//! - A film below 2 κ⁻¹ sin(θ/2) opens at points with the contact angle θ, such as greasy spots. The hole grows at a
//!   constant speed (Redon, Brochard-Wyart, Rondelez, PRL 66, 1991) until it meets clean surface. Its rim is a wedge of
//!   water inclined by the contact angle, 20 to 60° on greasy epoxy, a few degrees at the advancing front on clean
//!   epoxy (de Gennes, Rev. Mod. Phys. 57, 1985). A camera that resolves single pixels of the rim sees a limited slope.

use super::random::Random;
use std::f64::consts::TAU;

pub const SPRAY_FROM_S: f64 = 1.0;
pub const WET_FROM_S: f64 = 4.0;
/// Maximum slope of a rim: a steeper rim mirrors the surroundings of the cell, which need no more detail.
const MAX_RIM_SLOPE: f64 = 0.5;

#[derive(Debug, Clone, Copy)]
struct Wave {
    per_mm: [f64; 2],
    per_s: f64,
    phase: f64,
    slope: f64,
}

/// A greasy spot on which the film opens.
#[derive(Debug, Clone)]
pub struct Grease {
    pub centre_mm: [f64; 2],
    pub radius_mm: f64,
    wobble: [(f64, f64); 3],
    pub opens_s: f64,
    pub speed_mm_s: f64,
    rim_slope: f64,
    rim_mm: f64,
}

impl Grease {
    fn new(centre_mm: [f64; 2], until_s: f64, random: &mut Random) -> Self {
        Grease {
            centre_mm,
            radius_mm: random.between(5.0, 22.0),
            wobble: std::array::from_fn(|_| (random.between(-0.1, 0.1), random.between(0.0, TAU))),
            opens_s: random.between(WET_FROM_S + 1.0, until_s),
            speed_mm_s: random.between(3.0, 25.0),
            rim_slope: random.between(20.0_f64, 60.0).to_radians().tan().min(MAX_RIM_SLOPE),
            rim_mm: random.between(0.8, 2.5),
        }
    }

    /// Returns a point's distance from the centre of the spot, mm, scaled as if the spot were a circle, and the
    /// direction.
    fn centred(&self, [x, y]: [f64; 2]) -> (f64, [f64; 2]) {
        let (dx, dy) = (x - self.centre_mm[0], y - self.centre_mm[1]);
        let (away, angle) = (dx.hypot(dy), dy.atan2(dx));
        let wobble: f64 = self
            .wobble
            .iter()
            .enumerate()
            .map(|(k, (size, phase))| size * ((k + 2) as f64 * angle + phase).cos())
            .sum();
        (away / (1.0 + wobble), [dx / away.max(1e-9), dy / away.max(1e-9)])
    }
}

/// The properties of the water at one point of the panel that do not change with time.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    at: [f64; 2],
    wets_s: f64,
    grease: Option<(usize, f64, [f64; 2])>,
}

/// The state of the water at a point at one time.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Fraction of the point that is under water, 0…1.
    pub wet: f64,
    /// Slope of the water's surface relative to the panel.
    pub slope: [f64; 2],
    /// Fraction of the panel's own roughness that is visible through the film.
    pub shows_weave: f64,
}

#[derive(Debug, Clone)]
pub struct Water {
    waves: Vec<Wave>,
    calms_s: f64,
    h0_um: f64,
    drains_s: f64,
    pub grease: Vec<Grease>,
    front: (f64, f64),
}

impl Water {
    pub fn new(half_mm: [f64; 2], spots: usize, until_s: f64, random: &mut Random) -> Self {
        let waves = (0..7).map(|_| {
            let (length, angle) = (random.between(18.0, 70.0), random.between(-0.7, 0.7));
            let k = TAU / length;
            Wave {
                per_mm: [k * angle.sin(), k * angle.cos()],
                per_s: k * random.between(1.5, 6.0),
                phase: random.between(0.0, TAU),
                slope: random.between(0.002, 0.009),
            }
        });
        let waves = waves.collect();
        let mut grease: Vec<Grease> = Vec::new();
        for _ in 0..50 * spots {
            let centre = [0, 1].map(|i| random.between(-0.8, 0.8) * half_mm[i]);
            let one = Grease::new(centre, until_s, random);
            let apart = |other: &Grease| {
                (other.centre_mm[0] - centre[0]).hypot(other.centre_mm[1] - centre[1])
                    > 1.4 * (other.radius_mm + one.radius_mm) + 10.0
            };
            if grease.len() < spots && grease.iter().all(apart) {
                grease.push(one);
            }
        }
        Water {
            waves,
            calms_s: random.between(2.0, 6.0),
            h0_um: random.between(100.0, 300.0),
            drains_s: random.between(2.0, 8.0),
            grease,
            front: (random.between(0.05, 0.2), random.between(0.0, TAU)),
        }
    }

    /// Computes the properties of the water at one point of the panel; `down` is 0 at the panel's upper edge and 1 at
    /// its lower edge.
    pub fn place(&self, at: [f64; 2], down: f64) -> Place {
        let wets_s = 1.2 + 2.2 * (down * 0.9 + self.front.0 * (at[0] / 60.0 + self.front.1).sin().abs()).min(1.0);
        let near = |(index, grease): (usize, &Grease)| {
            let (away, direction) = grease.centred(at);
            (away < grease.radius_mm + grease.rim_mm).then_some((index, away, direction))
        };
        Place { at, wets_s, grease: self.grease.iter().enumerate().find_map(near) }
    }

    /// Returns the time at which the film opens at this point, s; infinite if it does not open.
    pub fn opens_s(&self, place: &Place) -> f64 {
        place.grease.map_or(f64::INFINITY, |(index, away, _)| {
            let grease = &self.grease[index];
            if away < grease.radius_mm { grease.opens_s + away / grease.speed_mm_s } else { f64::INFINITY }
        })
    }

    /// Returns the index of the greasy spot that contains a point, and the point's position, mm.
    pub fn grease_at(&self, place: &Place) -> Option<(usize, [f64; 2])> {
        place
            .grease
            .filter(|(index, away, _)| *away < self.grease[*index].radius_mm)
            .map(|(index, ..)| (index, place.at))
    }

    /// The state of a point under a film at rest.
    pub const CALM: Surface = Surface { wet: 1.0, slope: [0.0; 2], shows_weave: 0.0 };

    pub fn at(&self, place: &Place, time_s: f64, pixel_mm: f64) -> Surface {
        if time_s < place.wets_s {
            return Surface { wet: 0.0, slope: [0.0; 2], shows_weave: 1.0 };
        }
        let since_s = (time_s - WET_FROM_S).max(0.0);
        let thickness_um = self.h0_um / (1.0 + since_s / self.drains_s).sqrt();
        let rough = 1.0 + 4.0 * if time_s < WET_FROM_S { 1.0 } else { (-since_s / self.calms_s).exp() };
        let size = rough * thickness_um / self.h0_um;
        let mut slope = [0.0; 2];
        for wave in &self.waves {
            let phase =
                wave.per_mm[0] * place.at[0] + wave.per_mm[1] * place.at[1] - wave.per_s * time_s + wave.phase;
            let s = wave.slope * size * phase.cos();
            let k = wave.per_mm[0].hypot(wave.per_mm[1]);
            slope = [slope[0] + s * wave.per_mm[0] / k, slope[1] + s * wave.per_mm[1] / k];
        }
        // The front of the water is a wedge of some millimetres.
        let behind_s = time_s - place.wets_s;
        if behind_s < 0.05 {
            slope[1] += 0.15 * (1.0 - behind_s / 0.05);
        }
        let mut wet = 1.0;
        if let Some((index, away, direction)) = place.grease {
            let grease = &self.grease[index];
            if time_s > grease.opens_s {
                let reached = ((time_s - grease.opens_s) * grease.speed_mm_s).min(grease.radius_mm);
                wet = ((away - reached) / pixel_mm + 0.5).clamp(0.0, 1.0);
                let ahead = ((away - reached) / grease.rim_mm).clamp(0.0, 1.0);
                let steep = -grease.rim_slope * (1.0 - ahead).powi(2);
                slope = [slope[0] + steep * direction[0], slope[1] + steep * direction[1]];
            }
        }
        Surface { wet, slope, shows_weave: 0.4 * (-thickness_um / 40.0).exp() }
    }
}
