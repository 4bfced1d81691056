//! A picture of the colour camera on the flange.

use super::appearance::dry_and_wet;
use super::cast::CastView;
use super::noise::{PixelNoise, Seed, to_bytes};
use panelprep_base::geometry::ColorPicture;
use rayon::prelude::*;

/// Takes a picture of the dry scene; `shot` is its own seed.
pub(super) fn capture(view: &CastView<'_>, pixels: &PixelNoise, shot: Seed) -> ColorPicture {
    let mut picture = ColorPicture::uniform(view.width(), view.height(), [0; 3]);
    picture.rgb.par_chunks_mut(view.width()).enumerate().for_each(|(row, colors)| {
        let noise = pixels.row(shot, row, colors.len());
        view.cast_row(row, |column, sight| {
            let (dry, _) = dry_and_wet(&sight);
            colors[column] = to_bytes(dry, noise, column);
        });
    });
    picture
}
