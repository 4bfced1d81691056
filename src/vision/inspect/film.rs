//! The film over time: a pixel is broken from the first of `persist_frames` pictures in a row that show it as
//! broken.
//!
//! A broken pixel stays broken: water that runs over the place later does not clean it. A flash that is shorter
//! than this row of pictures is not a break.

use std::collections::VecDeque;

/// Represents no time: the film did not break.
pub const NOT_BROKEN: f32 = f32::INFINITY;

/// The state of the film in one window while pictures arrive.
#[derive(Debug)]
pub struct Film {
    persist_frames: usize,
    /// Number of pictures in a row that showed the pixel broken.
    run: Vec<u8>,
    since_wet_s: Vec<f32>,
    /// Times of the last `persist_frames` pictures, oldest first.
    recent_s: VecDeque<f64>,
}

/// Pixels whose break has just lasted long enough.
#[derive(Debug, PartialEq)]
pub struct NewlyBroken {
    /// The time of the break: that of the first picture of the row, s.
    pub since_wet_s: f64,
    /// The indices of the pixels in the window.
    pub pixels: Vec<usize>,
}

impl Film {
    pub fn new(pixels: usize, persist_frames: usize) -> Self {
        Film {
            persist_frames,
            run: vec![0; pixels],
            since_wet_s: vec![NOT_BROKEN; pixels],
            recent_s: VecDeque::new(),
        }
    }

    /// Adds the broken pixels of the next picture.
    pub fn push(&mut self, broken: impl Iterator<Item = bool>, since_wet_s: f64) -> NewlyBroken {
        if self.recent_s.len() == self.persist_frames {
            self.recent_s.pop_front();
        }
        self.recent_s.push_back(since_wet_s);
        let began_s = self.recent_s.front().copied().unwrap_or(since_wet_s);
        let mut pixels = Vec::new();
        for (index, broken) in broken.enumerate() {
            self.run[index] = if broken { self.run[index].saturating_add(1) } else { 0 };
            if usize::from(self.run[index]) >= self.persist_frames && self.since_wet_s[index] == NOT_BROKEN {
                pixels.push(index);
            }
        }
        self.mark_broken(&pixels, began_s);
        NewlyBroken { since_wet_s: began_s, pixels }
    }

    /// Marks pixels as broken since this time.
    pub fn mark_broken(&mut self, pixels: &[usize], since_wet_s: f64) {
        for &index in pixels {
            self.since_wet_s[index] = since_wet_s as f32;
        }
    }

    /// The time at which each pixel broke, s; [`NOT_BROKEN`] if the film holds.
    pub fn times(&self) -> &[f32] {
        &self.since_wet_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand, three pictures in a row: pixel 0 breaks at 2 s for good, pixel 1 flashes for two pictures, pixel 2
    /// flashes first and breaks at 3 s.
    #[test]
    fn a_break_counts_from_the_first_of_three_in_a_row() {
        let mut film = Film::new(3, 3);
        let pictures = [
            [false, false, true],
            [false, true, false],
            [true, true, false],
            [true, false, true],
            [true, false, true],
            [true, false, true],
            [false, false, true],
        ];
        let found: Vec<NewlyBroken> = pictures
            .iter()
            .enumerate()
            .map(|(i, picture)| film.push(picture.iter().copied(), i as f64))
            .filter(|newly| !newly.pixels.is_empty())
            .collect();
        let expected =
            [NewlyBroken { since_wet_s: 2.0, pixels: vec![0] }, NewlyBroken { since_wet_s: 3.0, pixels: vec![2] }];
        assert_eq!(found, expected);
        assert_eq!(film.times(), [2.0, NOT_BROKEN, 3.0]);
    }
}
