//! The random numbers of a scenario, from the bench's seed and the scenario's number.

use rand::RngExt;
use rand_pcg::Pcg64;

/// A generator of random numbers.
#[derive(Debug, Clone)]
pub struct Draw(Pcg64);

impl Draw {
    pub fn new(seed: u64, number: u64) -> Self {
        Draw(Pcg64::new(seed.into(), number.into()))
    }

    /// Draws a number from 0 to `end` − 1.
    pub fn below(&mut self, end: u64) -> u64 {
        self.0.random_range(0..end.max(1))
    }

    /// Draws a number from `first` to `last`, including both.
    pub fn between(&mut self, first: u64, last: u64) -> u64 {
        self.0.random_range(first..=last)
    }

    /// Returns true with a probability of 1 / `many`.
    pub fn one_in(&mut self, many: u64) -> bool {
        self.below(many) == 0
    }

    /// Draws one of these values.
    pub fn choose<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.0.random_range(0..all.len())]
    }
}
