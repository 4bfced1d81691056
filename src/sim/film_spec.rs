//! Disturbances of the view of a film: light, glints, drops, exposure.

use super::noise::{RandomPurpose, Seed};
use rand::RngExt;

/// The difficulty of reading a film. All random values come from the film's seed; the fields are their limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilmSpec {
    /// Brightness of the whole picture; if it is 1, the dry panel has about 72 grey levels.
    pub exposure: f64,
    /// The lamp drifts from its initial light by up to this share, up or down.
    pub drift: f64,
    /// The lamp flickers from picture to picture by up to this share.
    pub flicker: f64,
    /// A shadow with soft edges passes and removes this share of the light; 0 is none.
    pub shadow: f64,
    /// Time at which the shadow's middle is at the panel's centre, s.
    pub shadow_at_s: f64,
    /// Number of glints on the film at a time: bright, additive, travelling.
    pub glints: usize,
    /// Number of drops at a time that run down the panel.
    pub drops: usize,
    /// Number of beads that stay on each place with a broken film.
    pub beads: usize,
    /// Additional darkening by a new film compared with an older film, as a share.
    pub thinning: f64,
    /// A place with a broken film returns to at least this share of its dry brightness: 1 is wholly dry.
    pub damp: f64,
    /// Number of droplets per 100 mm² that stay on a place with a broken film.
    pub droplets: f64,
    /// Dust on the panel before the first water, which washes it off: it changes the brightness by up to this share.
    pub dust: f64,
    /// Grease makes its spot darker or lighter by up to this share, dry or wet, also after the grease was sanded
    /// off.
    pub stain: f64,
}

impl FilmSpec {
    /// Steady light, no glints: only the run-off.
    pub const CALM_FILM: FilmSpec = FilmSpec {
        exposure: 1.0,
        drift: 0.0,
        flicker: 0.0,
        shadow: 0.0,
        shadow_at_s: 0.0,
        glints: 0,
        drops: 0,
        beads: 0,
        thinning: 0.0,
        damp: 1.0,
        droplets: 0.0,
        dust: 0.0,
        stain: 0.0,
    };

    /// A typical film of a good cell.
    pub const TYPICAL_FILM: FilmSpec = FilmSpec {
        exposure: 1.0,
        drift: 0.05,
        flicker: 0.01,
        shadow: 0.0,
        shadow_at_s: 0.0,
        glints: 8,
        drops: 3,
        beads: 1,
        thinning: 0.08,
        damp: 0.9,
        droplets: 0.5,
        dust: 0.03,
        stain: 0.04,
    };

    /// Draws a film of the highest difficulty from its seed: exposures from dark to bright, ±15 % of drift, a
    /// shadow in every second film, places that stay damp, droplets, dust and stains.
    pub fn hardest(seed: u64) -> FilmSpec {
        let mut random = Seed(seed).stream(RandomPurpose::Light, 1);
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        let exposure = 0.45 * (2.5_f64 / 0.45).powf(between(0.0, 1.0));
        let shadow = between(-0.3, 0.3).max(0.0);
        FilmSpec {
            exposure,
            drift: between(0.02, 0.15),
            flicker: between(0.0, 0.03),
            shadow,
            shadow_at_s: between(6.0, 20.0),
            glints: between(8.0, 40.0) as usize,
            drops: between(2.0, 12.0) as usize,
            beads: between(0.0, 4.0) as usize,
            thinning: between(0.0, 0.15),
            damp: between(0.75, 1.0),
            droplets: between(0.0, 2.0),
            dust: between(0.0, 0.1),
            stain: between(0.0, 0.12),
        }
    }
}
