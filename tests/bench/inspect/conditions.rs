//! The conditions of both renderers' clips: the frame rate, and the grids that were sanded before.

use panelprep::panel::GridId;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Frame rates, pictures per second; clips with the last rates have irregular intervals.
const RATES: [f64; 9] = [1.0, 2.0, 3.0, 5.0, 5.0, 8.0, 12.0, 20.0, 30.0];

/// The conditions of one clip.
#[derive(Debug, Clone)]
pub struct Conditions {
    /// Mean number of pictures per second.
    pub frames_per_second: f64,
    /// Maximum relative deviation of an interval between two pictures from the mean interval.
    pub uneven: f64,
    /// The grids that were sanded before the film, pass by pass.
    pub sanded: Vec<Vec<GridId>>,
    /// Distance by which the disc moved beyond a grid's edge, mm.
    pub beyond_mm: f64,
    seed: u64,
}

impl Conditions {
    /// Draws conditions from a seed: one third of the clips have no sanded grid, and one sixth have all grids sanded.
    pub fn new(seed: u64, grids: &[GridId]) -> Self {
        let mut random = Pcg64::seed_from_u64(seed ^ 0x5eed_c11f);
        let rate = RATES[random.random_range(0..RATES.len())];
        let uneven = if random.random_range(0..4) == 0 { random.random_range(0.1..0.6) } else { 0.0 };
        let share = match seed % 6 {
            0 | 1 => 0.0,
            2 => 1.0,
            _ => random.random_range(0.04..0.9),
        };
        let count = (share * grids.len() as f64).ceil() as usize;
        let mut left = grids.to_vec();
        let mut first: Vec<GridId> = Vec::new();
        while first.len() < count {
            first.push(left.swap_remove(random.random_range(0..left.len())));
        }
        let again = first.iter().copied().filter(|_| random.random_range(0..4) == 0).collect();
        let sanded = [first, again].into_iter().filter(|pass: &Vec<GridId>| !pass.is_empty()).collect();
        let beyond_mm = random.random_range(4.0..25.0);
        Conditions { frames_per_second: rate, uneven, sanded, beyond_mm, seed }
    }

    /// Returns the conditions of a camera with this constant frame rate, without sanded grids.
    pub fn plain(frames_per_second: f64) -> Self {
        Conditions { frames_per_second, uneven: 0.0, sanded: Vec::new(), beyond_mm: 0.0, seed: 0 }
    }

    /// Returns the times of a clip's pictures from 0 to the end, s, in whole milliseconds; the first picture shows the
    /// dry panel.
    pub fn times_s(&self, end_s: f64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(self.seed ^ 0x71_e5);
        let mut times_s = vec![0.0];
        let mut time_s: f64 = 0.0;
        while time_s < end_s {
            let uneven = 1.0 + if self.uneven > 0.0 { random.random_range(-self.uneven..self.uneven) } else { 0.0 };
            time_s += uneven / self.frames_per_second;
            times_s.push((1e3 * time_s).round() / 1e3);
        }
        times_s
    }

    /// Returns the number of passes in which this grid was sanded.
    pub fn passes_of(&self, id: GridId) -> usize {
        self.sanded.iter().filter(|pass| pass.contains(&id)).count()
    }
}
