//! The run-off: streaks of thicker film that travel down the panel and fade as the water thins out.
//!
//! Two copies of one streaky pattern, periodic in both directions, travel at their own speeds.

use super::noise::{NormalStream, RandomPurpose, Seed, smoothstep};
use super::timing::WET_FROM_S;

/// The pattern repeats after this number of columns, and after `STREAK_ROWS` rows; both are powers of two. A cell
/// is 1 mm wide and 1 mm high.
const STREAK_COLUMNS: usize = 512;
const STREAK_ROWS: usize = 1_024;
/// Additional thickness of the film in a streak at first; `STREAK_FINAL_THICKNESS` is the later value.
const STREAK_INITIAL_THICKNESS: f32 = 0.14;
const STREAK_FINAL_THICKNESS: f32 = 0.05;
const STREAK_FADES_S: f32 = 12.0;
/// Speeds of the two copies, mm/s.
const STREAK_SPEEDS: [f64; 2] = [17.0, 41.0];

/// The pattern.
#[derive(Debug, Clone)]
pub(super) struct RunoffPattern {
    pattern: Vec<f32>,
}

/// The pattern at one time.
pub(super) struct Drift<'a> {
    pattern: &'a [f32],
    shifts: [usize; 2],
    amplitude: f32,
}

impl RunoffPattern {
    /// Creates the pattern at random: its streaks are narrow across the panel and long from top to bottom.
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
            // Streaks are rare: only the peaks of the pattern.
            ((mix(low, high, down) - 0.6).max(0.0) / 1.2).min(1.0) as f32
        };
        RunoffPattern { pattern: (0..STREAK_COLUMNS * STREAK_ROWS).map(value).collect() }
    }

    /// Returns the column and row of the pattern for a point of the sheet; rows grow upwards.
    pub fn pattern_position([s, t]: [f64; 2]) -> [u16; 2] {
        [s, t].map(|mm| (mm + 256.0).round().clamp(0.0, 511.0) as u16)
    }

    /// Returns the pattern as it has moved by this time of the film, s.
    pub fn thickness_at(&self, time_s: f64) -> Drift<'_> {
        let since_wet_s = (time_s - WET_FROM_S).max(0.0) as f32;
        let amplitude = STREAK_FINAL_THICKNESS
            + (STREAK_INITIAL_THICKNESS - STREAK_FINAL_THICKNESS) * (-since_wet_s / STREAK_FADES_S).exp();
        let shifts = STREAK_SPEEDS.map(|speed| (speed * time_s.max(0.0)) as usize % STREAK_ROWS);
        Drift { pattern: &self.pattern, shifts, amplitude }
    }
}

impl Drift<'_> {
    /// Returns the factor by which the film darkens here, about 1.
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

    /// Calculated by hand: after one second the first copy has moved down by 17 mm: the value of row 100 is now at
    /// row 83.
    #[test]
    fn streaks_travel_down_and_thin_out() {
        let runoff = RunoffPattern::new(Seed(1));
        let one = |time_s: f64, row: u16| {
            let drift = Drift { amplitude: 1.0, ..runoff.thickness_at(time_s) };
            (0..100)
                .map(|column| {
                    drift.pattern[(usize::from(row) + drift.shifts[0]) % STREAK_ROWS * STREAK_COLUMNS + column]
                })
                .sum::<f32>()
        };
        assert_eq!(one(0.0, 100).to_bits(), one(1.0, 83).to_bits());
        assert!((runoff.thickness_at(WET_FROM_S).amplitude - STREAK_INITIAL_THICKNESS).abs() < 1e-6);
        assert!((runoff.thickness_at(300.0).amplitude - STREAK_FINAL_THICKNESS).abs() < 1e-6);
        assert!((0..100).all(|column| (1.0..1.3).contains(&runoff.thickness_at(5.0).thickness([column, 9]))));
    }
}
