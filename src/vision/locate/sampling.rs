//! Selects the points to be looked at from a large number.

/// Returns evenly spread indices of a list: multiples of the golden section, which omit no rows.
pub(super) fn spread_indices(count: usize, wanted: usize) -> Vec<usize> {
    if wanted >= count {
        return (0..count).collect();
    }
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let mut places: Vec<usize> =
        (0..wanted).map(|k| ((k as f64 * GOLDEN).fract() * count as f64) as usize).collect();
    places.sort_unstable();
    places.dedup();
    places
}
