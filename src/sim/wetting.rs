//! One pixel of the panel under water: when it becomes wet, and when its film breaks and closes again.
//!
//! Let r be the share of the pixel that water has reached, q the share that is greasy, and b the share that a bead or
//! droplet covers. Let o and c be the degrees to which the film has opened and closed. Each is 0…1 and linear in time.
//! The film of the pixel is  r (1 − q (1 − b) o (1 − c)). The part without film is the bare surface: under dust until
//! water has reached it, then washed, and as damp as its spot is.

use super::appearance::FixedColor;
use super::film_defects::{GreasySpot, SpotKind};
use super::film_spec::FilmSpec;
use super::noise::{RandomPurpose, Seed, ValueNoise};
use super::runoff::RunoffPattern;
use super::timing::SPRAY_FROM_S;
use rand::RngExt;

/// Time that the front needs from the panel's top to its bottom, s, and the unevenness of its arrival.
const FRONT_TIME_S: f64 = 2.3;
const FRONT_UNEVEN_S: f64 = 0.12;
/// Times in which a place becomes wet, its film opens, and its film closes again, s.
const WETTING_S: f64 = 0.2;
const OPENING_S: f64 = 0.15;
const CLOSING_S: f64 = 0.4;
/// On a place that covers much of the panel, more droplets than these would only cost time.
const MAX_DROPLETS: usize = 60;

/// A pixel of the panel.
#[derive(Debug, Clone, Copy)]
pub(super) struct WetPixel {
    pub wet: FixedColor,
    /// Colour after the dust was washed off, without a film; that of a damp place if the pixel is greasy.
    pub bare: FixedColor,
    wet_from_s: f32,
    /// Infinite if there is no grease.
    pub breaks_at_s: f32,
    pub closes_at_s: f32,
    /// The share of this pixel that lies in the spot.
    greasy: f32,
    /// The share of this pixel that a bead keeps wet after the film around it has broken.
    bead: f32,
    /// Column and row of the run-off pattern.
    pub streak: [u16; 2],
}

impl WetPixel {
    /// A pixel beside the panel, which has one colour and no water.
    pub fn background(color: FixedColor) -> Self {
        WetPixel {
            wet: color,
            bare: color,
            wet_from_s: f32::INFINITY,
            breaks_at_s: f32::INFINITY,
            closes_at_s: f32::INFINITY,
            greasy: 0.0,
            bead: 0.0,
            streak: [0; 2],
        }
    }

    /// Returns whether most of the pixel lies in a spot.
    pub fn is_mostly_greasy(&self) -> bool {
        self.greasy >= 0.5
    }

    /// Returns the share of this pixel that water has reached at this time, 0…1.
    pub fn wetted_share(&self, time_s: f32) -> f32 {
        ((time_s - self.wet_from_s) / WETTING_S as f32).clamp(0.0, 1.0)
    }

    /// Returns the share of this pixel that has its film at this time, 0…1.
    pub fn film(&self, time_s: f32) -> f32 {
        let reached = self.wetted_share(time_s);
        let open = ((time_s - self.breaks_at_s) / OPENING_S as f32 + 0.5).clamp(0.0, 1.0);
        let closed = ((time_s - self.closes_at_s) / CLOSING_S as f32).clamp(0.0, 1.0);
        reached * (1.0 - self.greasy * (1.0 - self.bead) * open * (1.0 - closed))
    }
}

/// A small area that stays wet in a break.
struct WaterBead {
    centre_mm: [f64; 2],
    radius_mm: f64,
}

/// The water on one panel: its front, and the greasy spots.
pub(super) struct Water<'a> {
    front: ValueNoise,
    spots: Vec<GreasyWater<'a>>,
}

/// A spot with the water that remains on it when its film has broken.
struct GreasyWater<'a> {
    spot: &'a GreasySpot,
    beads: Vec<WaterBead>,
    /// Brightness of the bare spot as a share of its dry brightness.
    damp: f64,
}

/// A pixel's colours: wet, under a whole film, and washed, without film.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelColors {
    pub wet: FixedColor,
    pub washed: FixedColor,
}

impl<'a> Water<'a> {
    pub fn new(spots: &'a [GreasySpot], spec: &FilmSpec, seed: Seed) -> Self {
        let front = ValueNoise::new(seed.stream(RandomPurpose::Film, 0), 25.0, 260.0);
        let greasy = |(index, spot): (usize, &'a GreasySpot)| {
            let mut random = seed.stream(RandomPurpose::Condition, index as u64);
            let damp = spec.damp + (1.0 - spec.damp) * random.random_range(0.0..1.0);
            GreasyWater { spot, beads: draw_beads(spot, index, spec, seed), damp }
        };
        Water { front, spots: spots.iter().enumerate().map(greasy).collect() }
    }

    /// Computes the wetting of the pixel that shows this point of the panel, mm, and is `pixel_mm` wide there.
    pub fn wetting_at(&self, place: [f64; 2], pixel_mm: f64, PixelColors { wet, washed }: PixelColors) -> WetPixel {
        let wet_from_s = self.reached_s(place);
        let wetted = WetPixel {
            wet,
            bare: washed,
            wet_from_s: wet_from_s as f32,
            streak: RunoffPattern::pattern_position(place),
            ..WetPixel::background(wet)
        };
        let away_mm = |[s, t]: [f64; 2]| (place[0] - s).hypot(place[1] - t);
        for GreasyWater { spot, beads, damp } in &self.spots {
            if away_mm(spot.centre_mm()) > spot.radius_mm() + 2.0 * pixel_mm {
                continue;
            }
            let (reached, left_mm) = spot.reach(place);
            let greasy = (0.5 + left_mm / pixel_mm).clamp(0.0, 1.0);
            if greasy > 0.0 {
                let share = |bead: &WaterBead| {
                    (0.5 + (bead.radius_mm - away_mm(bead.centre_mm)) / pixel_mm).clamp(0.0, 1.0)
                };
                let bead = beads.iter().map(share).fold(0.0, f64::max);
                let bare = washed.map(|level| (f64::from(level) * (1.0 - greasy * (1.0 - damp))).round() as u16);
                return WetPixel {
                    bare,
                    breaks_at_s: spot.break_time_at_s(reached, f64::from(wetted.wet_from_s)) as f32,
                    closes_at_s: spot.closes_at_s as f32,
                    greasy: greasy as f32,
                    // A place where water never stays has no bead.
                    bead: if spot.kind == SpotKind::NeverWets { 0.0 } else { bead as f32 },
                    ..wetted
                };
            }
        }
        wetted
    }

    /// Returns the time at which the spray's front reaches a point, s.
    fn reached_s(&self, place: [f64; 2]) -> f64 {
        const TOP_MM: f64 = 130.0;
        const HEIGHT_MM: f64 = 260.0;
        let down = ((TOP_MM - place[1]) / HEIGHT_MM).clamp(0.0, 1.0);
        let uneven = (FRONT_UNEVEN_S * self.front.value_at(place)).clamp(-0.3, 0.3);
        SPRAY_FROM_S + 0.35 + FRONT_TIME_S * down + uneven - WETTING_S / 2.0
    }
}

fn draw_beads(spot: &GreasySpot, index: usize, spec: &FilmSpec, seed: Seed) -> Vec<WaterBead> {
    let mut random = seed.stream(RandomPurpose::Drops, 1_000_000 + index as u64);
    let [s, t] = spot.centre_mm();
    let reach_mm = 0.7 * spot.min_radius_mm();
    let bead = |_| {
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        let (away_mm, angle_rad) = (reach_mm * between(0.0, 1.0).sqrt(), between(0.0, std::f64::consts::TAU));
        WaterBead {
            centre_mm: [s + away_mm * angle_rad.cos(), t + away_mm * angle_rad.sin()],
            radius_mm: between(0.4, 1.2).min(0.25 * reach_mm),
        }
    };
    let droplets = (spec.droplets / 100.0 * std::f64::consts::PI * reach_mm * reach_mm) as usize;
    (0..spec.beads + droplets.min(MAX_DROPLETS)).map(bead).collect()
}
