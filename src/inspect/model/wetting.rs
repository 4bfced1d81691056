//! What the pictures before the watch tell: each pixel's summed dry brightness, and what a film leaves of it.

/// What a film leaves of the dry brightness, until the clip tells.
pub const FILM_ASSUMED: f64 = 0.62;
/// Ratios of wet to dry brightness are counted in so many classes.
pub(super) const FILM_BINS: usize = 256;

/// What is learnt before the film is watched.
#[derive(Debug)]
pub(super) struct Wetting {
    pub dry_sum: Vec<u32>,
    pub dry_pictures: u32,
    /// τ.
    pub film: f64,
    pub film_known: bool,
    /// How many pixels had which ratio to their dry brightness when wet.
    pub film_bins: Vec<f64>,
}

impl Wetting {
    pub fn new(pixels: usize) -> Self {
        Wetting {
            dry_sum: vec![0; pixels],
            dry_pictures: 0,
            film: FILM_ASSUMED,
            film_known: false,
            film_bins: vec![0.0; FILM_BINS],
        }
    }
}
