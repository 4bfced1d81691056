//! The contents of a trial's scene besides the panel.

use super::marks::PrintedDiscs;
use crate::distractors::Slab;
use crate::noise::ValueNoise;

/// The areas of the panel without points.
#[derive(Debug, Clone)]
pub(super) struct MissingPatches {
    pub noise: ValueNoise,
    /// Points are missing where the noise is below this.
    pub threshold: f64,
}

impl MissingPatches {
    pub fn contains(&self, place: [f64; 2]) -> bool {
        self.noise.value_at(place) < self.threshold
    }
}

/// The objects of a scene besides the panel.
#[derive(Clone, Copy, Default)]
pub(super) struct SceneContents<'a> {
    pub slabs: &'a [Slab],
    pub glints: &'a [([f64; 2], f64)],
    pub wet: bool,
    pub smear_px: usize,
    pub patches: Option<&'a MissingPatches>,
    pub marks: Option<&'a PrintedDiscs>,
}
