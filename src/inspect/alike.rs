//! Places that broke and did not, where the film mirrors: film that happens to look as the dry panel does.
//!
//! A place that broke has the dry brightness all over, and the film beside it differs from that. A mirrored edge or a gradient that
//! passes through the dry brightness goes on beyond it: within what looks dry it runs from one bound to the other, and the film
//! beside it is hardly different from dry. Of the places found, those are the ones of which nothing can be said.

use super::film::NEVER;
use super::footprint::Window;
use super::model::Mirror;
use crate::geometry::AROUND;
use std::collections::BTreeSet;

/// A place that broke is this near to its dry brightness, levels rms, the mean of neighbours taken: noise is a third of it.
const MOST_OFF_LEVELS: f32 = 1.5;
/// Of the film around it this share must differ from the dry panel by so much, levels.
const MIN_TOLD_AROUND: f64 = 0.6;
const MIN_AROUND_LEVELS: f32 = 5.5;
/// Around it is this far from it, px: beyond the wedge of water at a rim.
const AWAY_PX: usize = 3;

/// The pixels of places that are no break for sure.
pub fn alike(window: &Window, broke_s: &[f32], mirror: &Mirror) -> Vec<usize> {
    let is_open = |index: usize| broke_s[index] < NEVER;
    let doubtful = |piece: &Vec<usize>| {
        let off = |&index: &usize| {
            let (mut sum, mut count) = (mirror.off_levels(index), 1.0);
            for next in window.raster().neighbours(index, &AROUND).filter(|&next| is_open(next)) {
                (sum, count) = (sum + mirror.off_levels(next), count + 1.0);
            }
            (sum / count).powi(2)
        };
        let off_levels = (piece.iter().map(off).sum::<f32>() / piece.len() as f32).sqrt();
        let around = around(window, piece, &|index| mirror.sees(index) && !is_open(index));
        let told = around.iter().filter(|&&index| mirror.contrast_levels(index) >= MIN_AROUND_LEVELS).count();
        off_levels > MOST_OFF_LEVELS || (told as f64) < MIN_TOLD_AROUND * around.len() as f64
    };
    window.raster().pieces(&AROUND, is_open).into_iter().filter(doubtful).flatten().collect()
}

fn around(window: &Window, piece: &[usize], counts: &dyn Fn(usize) -> bool) -> Vec<usize> {
    let mut reached: BTreeSet<usize> = piece.iter().copied().collect();
    let mut rim = piece.to_vec();
    for _ in 0..AWAY_PX {
        let next: Vec<usize> = rim.iter().flat_map(|&index| window.raster().neighbours(index, &AROUND)).collect();
        rim = next.into_iter().filter(|&index| reached.insert(index)).collect();
    }
    let inside: BTreeSet<usize> = piece.iter().copied().collect();
    reached.into_iter().filter(|&index| !inside.contains(&index) && counts(index)).collect()
}
