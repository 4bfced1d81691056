//! Water on the panel: the phases of a film and the times at which they begin; when a pixel becomes wet, and when its
//! film breaks and closes again; and the run-off.
//!
//! Let r be the fraction of the pixel that water has reached, q the fraction that is greasy, and b the fraction that a
//! bead or droplet covers. Let o and c be the degrees to which the film has opened and closed. Each is 0…1 and linear
//! in time. The film covers the fraction  r (1 − q (1 − b) o (1 − c))  of the pixel. The rest of the pixel is the bare
//! surface: dusty until water has reached it, then washed, and as damp as its spot.
//!
//! The run-off consists of streaks of thicker film that move down the panel and fade as the water becomes thinner: two
//! copies of one streaky pattern, periodic in both directions, move at their own speeds.

use super::appearance::FixedColor;
use super::film_defects::{GreasySpot, SpotKind};
use super::film_spec::FilmSpec;
use super::noise::{NormalStream, RandomPurpose, Seed, ValueNoise, smoothstep};
use rand::RngExt;

/// The phase of the film at one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum Phase {
    /// Before the spray.
    Dry,
    /// The spray is on, and water runs down over the panel.
    Spray,
    /// Water has reached the whole panel; the film is observed.
    Wet,
}

impl Phase {
    /// Returns the phase's keyword in `clip.csv`.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}

/// Time from which the panel is fully wet and its film is observed, s from the start of the film.
pub const WET_FROM_S: f64 = 4.0;
/// Time at which the spray begins, s from the start of the film.
pub const SPRAY_FROM_S: f64 = 1.0;

/// Time that the water's front needs from the panel's top to its bottom, s.
const FRONT_TIME_S: f64 = 2.3;
/// Random delay of the front at a point, rms at the nodes of the value noise, s.
const FRONT_DELAY_NOISE_S: f64 = 0.12;
/// Time in which a point becomes wet after the front has reached it, s.
const WETTING_TIME_S: f64 = 0.2;
/// Time in which the film opens at a point, s.
const OPENING_TIME_S: f64 = 0.15;
/// Time in which the film closes again at a point, s.
const CLOSING_TIME_S: f64 = 0.4;
/// Maximum number of droplets on a spot: more droplets on a large spot would only need computing time.
const MAX_DROPLETS: usize = 60;

/// A pixel of the panel.
#[derive(Debug, Clone, Copy)]
pub(super) struct WetPixel {
    pub wet: FixedColor,
    /// Colour after the dust was washed off, without a film. If the pixel is greasy, the colour of the damp spot.
    pub bare: FixedColor,
    wet_from_s: f32,
    /// Time at which the film breaks, s; infinite if there is no grease.
    pub breaks_at_s: f32,
    pub closes_at_s: f32,
    /// The fraction of this pixel that lies in the spot.
    greasy: f32,
    /// The fraction of this pixel that a bead keeps wet after the film around it has broken.
    bead: f32,
    /// Column and row of this pixel in the run-off pattern.
    pub streak: [u16; 2],
}

impl WetPixel {
    /// Creates a pixel beside the panel, which has a constant colour and no water.
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

    /// Returns the fraction of this pixel that water has reached at this time, 0…1.
    pub fn wetted_fraction(&self, time_s: f32) -> f32 {
        ((time_s - self.wet_from_s) / WETTING_TIME_S as f32).clamp(0.0, 1.0)
    }

    /// Returns the fraction of this pixel that the film covers at this time, 0…1.
    pub fn film(&self, time_s: f32) -> f32 {
        let reached = self.wetted_fraction(time_s);
        let open = ((time_s - self.breaks_at_s) / OPENING_TIME_S as f32 + 0.5).clamp(0.0, 1.0);
        let closed = ((time_s - self.closes_at_s) / CLOSING_TIME_S as f32).clamp(0.0, 1.0);
        reached * (1.0 - self.greasy * (1.0 - self.bead) * open * (1.0 - closed))
    }
}

/// A bead or droplet: a small area of a broken film that stays wet.
struct WaterBead {
    centre_mm: [f64; 2],
    radius_mm: f64,
}

/// The water on one panel: its front, and the greasy spots with their beads.
pub(super) struct Water<'a> {
    front: ValueNoise,
    spots: Vec<GreasyWater<'a>>,
}

/// A spot with the beads that remain on it after its film has broken.
struct GreasyWater<'a> {
    spot: &'a GreasySpot,
    beads: Vec<WaterBead>,
    /// Brightness of the spot without a film, as a fraction of its dry brightness.
    damp: f64,
}

/// A pixel's colours: `wet` under an unbroken film, and `washed` without a film.
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

    /// Computes the wetting of a pixel at this point of the sheet, mm; `pixel_mm` is the pixel's width on the panel.
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
                    // A spot that never becomes wet has no bead.
                    bead: if spot.kind == SpotKind::NeverWets { 0.0 } else { bead as f32 },
                    ..wetted
                };
            }
        }
        wetted
    }

    /// Returns the time at which the water's front reaches a point, s from the start of the film.
    fn reached_s(&self, place: [f64; 2]) -> f64 {
        const TOP_MM: f64 = 130.0;
        const HEIGHT_MM: f64 = 260.0;
        let down = ((TOP_MM - place[1]) / HEIGHT_MM).clamp(0.0, 1.0);
        let uneven = (FRONT_DELAY_NOISE_S * self.front.value_at(place)).clamp(-0.3, 0.3);
        SPRAY_FROM_S + 0.35 + FRONT_TIME_S * down + uneven - WETTING_TIME_S / 2.0
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

/// Number of columns after which the pattern repeats, a power of two. A cell of the pattern is 1 mm wide and 1 mm high.
const STREAK_COLUMNS: usize = 512;
/// Number of rows after which the pattern repeats, a power of two.
const STREAK_ROWS: usize = 1_024;
/// Additional relative thickness of the film in a streak at the start.
const STREAK_INITIAL_THICKNESS: f32 = 0.14;
/// Additional relative thickness of the film in a streak at the end.
const STREAK_FINAL_THICKNESS: f32 = 0.05;
/// Time constant with which the thickness of the streaks decreases, s.
const STREAK_DECAY_TIME_S: f32 = 12.0;
/// Speeds of the two copies of the pattern, mm/s.
const STREAK_SPEEDS_MM_S: [f64; 2] = [17.0, 41.0];

/// The run-off pattern: the relative thickness of each cell, row by row.
#[derive(Debug, Clone)]
pub(super) struct RunoffPattern {
    pattern: Vec<f32>,
}

/// The run-off pattern at one time.
pub(super) struct ShiftedPattern<'a> {
    pattern: &'a [f32],
    shifts: [usize; 2],
    amplitude: f32,
}

impl RunoffPattern {
    /// Creates the pattern from a seed: its streaks are narrow across the panel and long from top to bottom.
    pub fn new(seed: Seed) -> Self {
        const PATTERN_COLUMNS: usize = 4;
        const PATTERN_ROWS: usize = 64;
        let columns = STREAK_COLUMNS / PATTERN_COLUMNS;
        let rows = STREAK_ROWS / PATTERN_ROWS;
        let mut normal = NormalStream::new(seed.stream(RandomPurpose::Runoff, 0));
        let nodes: Vec<f64> = (0..columns * rows).map(|_| normal.next()).collect();
        let node = |column: usize, row: usize| nodes[row % rows * columns + column % columns];
        let value = |index: usize| {
            let (column, row) = (index % STREAK_COLUMNS, index / STREAK_COLUMNS);
            let (i, j) = (column / PATTERN_COLUMNS, row / PATTERN_ROWS);
            let across = smoothstep((column % PATTERN_COLUMNS) as f64 / PATTERN_COLUMNS as f64);
            let down = smoothstep((row % PATTERN_ROWS) as f64 / PATTERN_ROWS as f64);
            let mix = |a: f64, b: f64, share: f64| a + share * (b - a);
            let low = mix(node(i, j), node(i + 1, j), across);
            let high = mix(node(i, j + 1), node(i + 1, j + 1), across);
            // Only the peaks of the pattern become streaks, so that streaks are rare.
            ((mix(low, high, down) - 0.6).max(0.0) / 1.2).min(1.0) as f32
        };
        RunoffPattern { pattern: (0..STREAK_COLUMNS * STREAK_ROWS).map(value).collect() }
    }

    /// Returns the column and row of the pattern for a point of the sheet; the row increases upwards.
    pub fn pattern_position([s, t]: [f64; 2]) -> [u16; 2] {
        [s, t].map(|mm| (mm + 256.0).round().clamp(0.0, 511.0) as u16)
    }

    /// Returns the pattern, moved to its position at this time, s from the start of the film.
    pub fn thickness_at(&self, time_s: f64) -> ShiftedPattern<'_> {
        let since_wet_s = (time_s - WET_FROM_S).max(0.0) as f32;
        let amplitude = STREAK_FINAL_THICKNESS
            + (STREAK_INITIAL_THICKNESS - STREAK_FINAL_THICKNESS) * (-since_wet_s / STREAK_DECAY_TIME_S).exp();
        let shifts = STREAK_SPEEDS_MM_S.map(|speed| (speed * time_s.max(0.0)) as usize % STREAK_ROWS);
        ShiftedPattern { pattern: &self.pattern, shifts, amplitude }
    }
}

impl ShiftedPattern<'_> {
    /// Returns the relative thickness of the film at a cell of the pattern, about 1; it multiplies the film's
    /// darkening.
    pub fn thickness(&self, [column, row]: [u16; 2]) -> f32 {
        let (column, row) = (usize::from(column), usize::from(row));
        let cell = |column: usize, shift: usize| {
            self.pattern[(row + shift) % STREAK_ROWS * STREAK_COLUMNS + column % STREAK_COLUMNS]
        };
        let streaks = cell(column, self.shifts[0]) + cell(column + 211, self.shifts[1]);
        1.0 + self.amplitude * streaks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected value, calculated by hand: after one second the first copy has moved down by 17 mm, so the value of row
    /// 100 is at row 83.
    #[test]
    fn streaks_travel_down_and_thin_out() {
        let runoff = RunoffPattern::new(Seed(1));
        let one = |time_s: f64, row: u16| {
            let shifted = ShiftedPattern { amplitude: 1.0, ..runoff.thickness_at(time_s) };
            (0..100)
                .map(|column| {
                    shifted.pattern[(usize::from(row) + shifted.shifts[0]) % STREAK_ROWS * STREAK_COLUMNS + column]
                })
                .sum::<f32>()
        };
        assert_eq!(one(0.0, 100).to_bits(), one(1.0, 83).to_bits());
        assert!((runoff.thickness_at(WET_FROM_S).amplitude - STREAK_INITIAL_THICKNESS).abs() < 1e-6);
        assert!((runoff.thickness_at(300.0).amplitude - STREAK_FINAL_THICKNESS).abs() < 1e-6);
        assert!((0..100).all(|column| (1.0..1.3).contains(&runoff.thickness_at(5.0).thickness([column, 9]))));
    }
}
