//! The effect of a disc on the panel's appearance, and the state of a spot on which the film has opened.
//!
//! Sanding exposes or covers fibres (diffuse reflectance times 0.4 to 1.8), and removes the gloss and the visible
//! weave, to a different extent with each pass and at the disc's rim. A spot whose film has opened stays damp in its
//! pores: its brightness returns to 0.75 to 1 of the dry brightness, and droplets stay on it. Grease leaves stains. The
//! ranges are assumptions and are wider than those reported for real panels.

use super::random::Random;

/// A sanded rectangle of the panel.
#[derive(Debug, Clone)]
pub struct Zone {
    low: [f64; 2],
    high: [f64; 2],
    albedo: [f64; 3],
    gloss: f64,
    rim_mm: f64,
    rim: f64,
}

/// The appearance of a point relative to the new panel.
#[derive(Debug, Clone, Copy)]
pub struct Appearance {
    pub albedo: [f64; 3],
    pub gloss: f64,
    pub weave: f64,
}

impl Appearance {
    pub const AS_MADE: Appearance = Appearance { albedo: [1.0; 3], gloss: 1.0, weave: 1.0 };
}

impl Zone {
    pub fn new(low: [f64; 2], high: [f64; 2], albedo: f64, random: &mut Random) -> Self {
        Zone {
            low,
            high,
            albedo: [0; 3].map(|_| albedo * random.between(0.96, 1.04)),
            gloss: random.between(0.05, 0.6),
            rim_mm: random.between(1.5, 6.0),
            rim: random.between(0.85, 1.15),
        }
    }

    /// Returns the distance of a point inside of the sanded area from its border, mm; negative outside.
    pub fn depth(&self, at: [f64; 2]) -> f64 {
        (0..2).map(|i| (at[i] - self.low[i]).min(self.high[i] - at[i])).fold(f64::INFINITY, f64::min)
    }

    fn over(&self, look: Appearance, at: [f64; 2]) -> Appearance {
        let depth = self.depth(at);
        let share = (depth / 0.8 + 0.5).clamp(0.0, 1.0);
        let middle = ((depth - self.rim_mm) / 0.8).clamp(0.0, 1.0);
        let rim = self.rim + (1.0 - self.rim) * middle;
        let mix = |a: f64, b: f64| a + share * (b - a);
        Appearance {
            albedo: std::array::from_fn(|i| mix(look.albedo[i], self.albedo[i] * rim)),
            gloss: mix(look.gloss, self.gloss),
            weave: mix(look.weave, 0.1),
        }
    }
}

/// Returns the appearance of a point after all of these passes.
pub fn look(zones: &[Zone], at: [f64; 2]) -> Appearance {
    zones.iter().fold(Appearance::AS_MADE, |look, zone| zone.over(look, at))
}

/// The state of a greasy spot on which the film has opened, and the stain of the grease.
#[derive(Debug, Clone)]
pub struct Remains {
    /// The fraction of its dry brightness to which the spot returns.
    pub damp: f64,
    /// Brightness factor of the stain, dry and wet.
    pub stain: f64,
    /// Droplets: position, mm, size, mm, and the slope of the droplet's surface at its rim.
    droplets: Vec<([f64; 2], f64, f64)>,
}

impl Remains {
    pub fn new(centre: [f64; 2], radius_mm: f64, dense: f64, random: &mut Random) -> Self {
        let count = (dense * 0.03 * radius_mm * radius_mm) as usize;
        let droplets = (0..count).map(|_| {
            let (away, angle) =
                (0.8 * radius_mm * random.between(0.0, 1.0).sqrt(), random.between(0.0, std::f64::consts::TAU));
            let at = [centre[0] + away * angle.cos(), centre[1] + away * angle.sin()];
            (at, random.between(0.4, 1.2), random.between(0.15, 0.5))
        });
        Remains { droplets: droplets.collect(), damp: random.between(0.75, 1.0), stain: random.between(0.88, 1.12) }
    }

    /// Returns the fraction of the pixel that a droplet covers at this point, 0…1, and the slope of the droplet's
    /// surface.
    pub fn droplet(&self, at: [f64; 2], pixel_mm: f64) -> Option<(f64, [f64; 2])> {
        self.droplets.iter().find_map(|(centre, radius, slope)| {
            let (dx, dy) = (at[0] - centre[0], at[1] - centre[1]);
            let away = dx.hypot(dy);
            let share = ((radius - away) / pixel_mm + 0.5).clamp(0.0, 1.0);
            let steep = slope * away / radius;
            (share > 0.0).then(|| (share, [dx, dy].map(|d| steep * d / away.max(1e-6))))
        })
    }
}
