//! Finds places that were already wet in the dry picture; the test cannot judge them.
//!
//! Water that remained from rinsing darkens a place in the dry picture as a film does. Later the place is as bright
//! as it was in that picture, like a place on which no water stays. The two differ in the dry picture. A place that
//! was never wet was as bright as its surroundings. A wet place was darker: its ratio to the brightness of its
//! surroundings was closer to τ than to 1.

use super::footprint::Window;
use panelprep_base::geometry::ALL_NEIGHBOURS;

/// Fewer connected pixels are noise.
const MIN_PIECE_PX: usize = 4;
/// The surroundings of a place lie at this distance from it, pixels: beyond a drop's soft edge.
const SURROUNDING_DISTANCE_PX: std::ops::RangeInclusive<usize> = 4..=9;
/// Fraction of a place's pixels that must not have been wet in any picture.
const MIN_NEVER_WET: f64 = 0.5;

/// The data of the window's pixels.
pub struct DrynessInputs<'a> {
    /// Whether the pixel broke, or was not wet in any picture.
    pub is_suspect: &'a dyn Fn(usize) -> bool,
    /// Whether the pixel is evaluated and was not wet in any picture.
    pub never_wet: &'a dyn Fn(usize) -> bool,
    /// Whether the pixel is evaluated.
    pub sees: &'a dyn Fn(usize) -> bool,
    /// Dry brightness of a place.
    pub dry: &'a dyn Fn(usize) -> f64,
    /// The ratio of the brightness under a film to the dry brightness.
    pub film: f64,
}

/// Returns the pixels that were already wet when the panel should have been dry.
pub fn initially_wet_pixels(window: &Window, known: &DrynessInputs<'_>) -> Vec<usize> {
    let was_wet = |piece: &Vec<usize>| {
        let never_wet = piece.iter().filter(|i| (known.never_wet)(**i)).count() as f64;
        piece.len() >= MIN_PIECE_PX
            && never_wet >= MIN_NEVER_WET * piece.len() as f64
            && mean(&surrounding_pixels(window, piece, known), known.dry)
                .zip(mean(piece, known.dry))
                // Halfway between the look of the dry surroundings and of a film over them: nearer to a film than to
                // dry.
                .is_some_and(|(around, own)| own < around * (1.0 + known.film) / 2.0)
    };
    window
        .raster()
        .connected_pieces(&ALL_NEIGHBOURS, known.is_suspect)
        .into_iter()
        .filter(was_wet)
        .flatten()
        .collect()
}

fn mean(pixels: &[usize], of: impl Fn(usize) -> f64) -> Option<f64> {
    (!pixels.is_empty()).then(|| pixels.iter().map(|&i| of(i)).sum::<f64>() / pixels.len() as f64)
}

fn surrounding_pixels(window: &Window, piece: &[usize], known: &DrynessInputs<'_>) -> Vec<usize> {
    let mut reached: std::collections::BTreeSet<usize> = piece.iter().copied().collect();
    let (mut rim, mut found) = (piece.to_vec(), Vec::new());
    for away_px in 1..=*SURROUNDING_DISTANCE_PX.end() {
        let next: Vec<usize> = rim.iter().flat_map(|&i| window.raster().neighbours(i, &ALL_NEIGHBOURS)).collect();
        rim = next.into_iter().filter(|&i| reached.insert(i)).collect();
        if SURROUNDING_DISTANCE_PX.contains(&away_px) {
            // Another drop beside it would make the surroundings look wet as well, and this one unsuspicious.
            found.extend(rim.iter().copied().filter(|&i| (known.sees)(i) && !(known.is_suspect)(i)));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Window = Window { left: 0, top: 0, width: 40, height: 40 };

    /// By hand, τ = 0.6: a place of 6 × 6 px is darker than its surroundings by more or less than (1 + 0.6)/2 = 0.8.
    #[test]
    fn a_dark_place_was_wet_and_a_bright_one_never_was() {
        let place = |i: usize| (17..23).contains(&(i % 40)) && (17..23).contains(&(i / 40));
        let found = |own: f64, never_wet: &dyn Fn(usize) -> bool| {
            let dry = |i: usize| if place(i) { own } else { 100.0 };
            let known = DrynessInputs { is_suspect: &place, never_wet, sees: &|_| true, dry: &dry, film: 0.6 };
            initially_wet_pixels(&WINDOW, &known).len()
        };
        assert_eq!([79.0, 81.0, 100.0].map(|own| found(own, &place)), [36, 0, 0]);
        assert_eq!(
            found(60.0, &|i| place(i) && i % 40 < 19),
            0,
            "most of it was wet later: it is a film that broke"
        );
    }
}
