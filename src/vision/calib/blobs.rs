//! Filled ellipses in a picture: candidates for the circles of a board, darker or lighter than their surroundings.
//!
//! A pixel counts if it differs from the mean of its surroundings. Pixels that touch form a piece. A piece of area
//! A with the covariance C of its pixels is an ellipse if A = 4π √det C, which neither letters nor wood grain
//! fulfil. The work grows only with the number of pixels.

use nalgebra::Matrix2;
use panelprep_base::geometry::{GrayPicture, Mask, Pixel};
use panelprep_cell::imaging::{self, ImagingError};

/// A connected piece that looks like an ellipse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Blob {
    pub centre: Pixel,
    pub area_px: f64,
}

/// Minimum area of a piece with a recognizable shape, px.
const MIN_PX: f64 = 12.0;
/// Maximum area of a circle, as a share of the picture: a larger piece is not one circle among many.
const MAX_SHARE: f64 = 0.03;
/// Maximum difference of A / (4π √det C) from 1.
const MAX_ROUNDNESS_ERROR: f64 = 0.12;
/// Maximum ratio of the longest axis to the shortest: a circle seen at 70° has 2.9.
const MAX_AXIS_RATIO: f64 = 3.5;
/// Minimum difference of a pixel from its surroundings, grey levels.
const MIN_CONTRAST: f64 = 6.0;
/// From this grey level on a pixel may belong to a glare, which would raise the mean of the surroundings.
const GLARE: u8 = 225;
/// Pixels around a pixel of a glare may belong to the glare too: those within the picture's longer side divided by
/// this number.
const RIM_PARTS: usize = 40;
/// The amount that each pixel adds to a sum to count the pixels: more than the sum of all grey levels of a picture.
const COUNT: u64 = 1 << 36;

/// Finds the blobs that are darker, or lighter, than the mean of ± `reach_px` around them; `sums` are the
/// picture's.
///
/// # Errors
/// If OpenCV refuses the picture, for example an empty one.
pub(super) fn blobs(
    picture: &GrayPicture,
    sums: &Sums,
    reach_px: usize,
    lighter: bool,
) -> Result<Vec<Blob>, ImagingError> {
    let (width, height) = (picture.width, picture.height);
    let is_marked = |index: usize| {
        let away = f64::from(picture.gray[index]) - sums.mean(index % width, index / width, reach_px);
        if lighter { away > MIN_CONTRAST } else { away < -MIN_CONTRAST }
    };
    let mask = Mask { width, height, inside: (0..width * height).map(is_marked).collect() };
    let piece = |pixels: &Vec<usize>| {
        let mut piece = Piece::default();
        for (column, row) in pixels.iter().map(|index| (index % width, index / width)) {
            piece.add(column as f64, row as f64);
            piece.touches_rim |= column == 0 || row == 0 || column + 1 == width || row + 1 == height;
        }
        piece.blob((width * height) as f64)
    };
    Ok(imaging::connected_pieces(&mask, false)?.iter().filter_map(piece).collect())
}

/// An integral image: the sums over all pixels above and left of each pixel.
struct Integral {
    sums: Vec<u64>,
    width: usize,
    height: usize,
}

impl Integral {
    fn new(width: usize, height: usize, value: impl Fn(usize) -> u64) -> Self {
        let mut sums = vec![0u64; (width + 1) * (height + 1)];
        for row in 0..height {
            let mut line = 0u64;
            for column in 0..width {
                line += value(row * width + column);
                sums[(row + 1) * (width + 1) + column + 1] = sums[row * (width + 1) + column + 1] + line;
            }
        }
        Integral { sums, width, height }
    }

    /// Returns the sum over ± `reach` pixels, and the number of these pixels.
    fn window_sum(&self, column: usize, row: usize, reach: usize) -> (u64, u64) {
        let (left, right) = (column.saturating_sub(reach), (column + reach + 1).min(self.width));
        let (top, low) = (row.saturating_sub(reach), (row + reach + 1).min(self.height));
        let at = |row: usize, column: usize| self.sums[row * (self.width + 1) + column];
        let sum = at(low, right) + at(top, left) - at(top, right) - at(low, left);
        (sum, ((right - left) * (low - top)) as u64)
    }
}

/// Sums of the grey levels around each pixel, for a window of any size.
pub(super) struct Sums {
    /// Sums over the pixels that cannot belong to a glare: each pixel adds [`COUNT`], so that a sum also contains
    /// the number of pixels.
    without_glare: Integral,
    total: Integral,
}

impl Sums {
    pub fn from_picture(picture: &GrayPicture) -> Self {
        let (width, height) = (picture.width, picture.height);
        let gray = |index: usize| u64::from(picture.gray[index]);
        let glare = Integral::new(width, height, |index| u64::from(picture.gray[index] >= GLARE));
        let rim_px = width.max(height) / RIM_PARTS;
        let without = Integral::new(width, height, |index| {
            let (near, _) = glare.window_sum(index % width, index / width, rim_px);
            if near == 0 { gray(index) + COUNT } else { 0 }
        });
        Sums { without_glare: without, total: Integral::new(width, height, gray) }
    }

    fn mean(&self, column: usize, row: usize, reach: usize) -> f64 {
        let (without, area) = self.without_glare.window_sum(column, row, reach);
        let count = without / COUNT;
        // If most pixels around seem to be a glare, they may be white paper, which can be as bright: all pixels are
        // used.
        if 4 * count < area {
            return self.total.window_sum(column, row, reach).0 as f64 / area as f64;
        }
        (without % COUNT) as f64 / count as f64
    }
}

#[derive(Default)]
struct Piece {
    count: f64,
    sum: [f64; 2],
    square: [f64; 3],
    touches_rim: bool,
}

impl Piece {
    fn add(&mut self, u: f64, v: f64) {
        self.count += 1.0;
        self.sum = [self.sum[0] + u, self.sum[1] + v];
        self.square = [self.square[0] + u * u, self.square[1] + u * v, self.square[2] + v * v];
    }

    fn blob(&self, picture_px: f64) -> Option<Blob> {
        if self.touches_rim || self.count < MIN_PX || self.count > MAX_SHARE * picture_px {
            return None;
        }
        let [u, v] = self.sum.map(|sum| sum / self.count);
        let [uu, uv, vv] = self.square.map(|square| square / self.count);
        // Each pixel is a square, which adds a variance of 1/12 in each direction.
        let covariance = Matrix2::new(uu - u * u + 1.0 / 12.0, uv - u * v, uv - u * v, vv - v * v + 1.0 / 12.0);
        let axes = covariance.symmetric_eigenvalues();
        let (long, short) = (axes.max().sqrt(), axes.min().max(0.0).sqrt());
        let round = self.count / (4.0 * std::f64::consts::PI * long * short);
        let is_ellipse = (round - 1.0).abs() < MAX_ROUNDNESS_ERROR && long < MAX_AXIS_RATIO * short;
        is_ellipse.then_some(Blob { centre: Pixel::at(u, v), area_px: self.count })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc, a ring and a bar: only the disc is found.
    #[test]
    fn a_disc_is_found_and_a_bar_is_not() {
        let mut picture = GrayPicture::uniform(120, 80, 200);
        for (index, gray) in picture.gray.iter_mut().enumerate() {
            let (u, v) = ((index % 120) as f64, (index / 120) as f64);
            let ring = (u - 70.0).hypot(v - 30.0);
            let disc = (u - 30.25).hypot(v - 30.0) < 9.0;
            if disc || (6.0..9.0).contains(&ring) || (v - 60.0).abs() < 2.0 && (u - 60.0).abs() < 30.0 {
                *gray = 40;
            }
        }
        let found = blobs(&picture, &Sums::from_picture(&picture), 20, false).expect("a picture");
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].centre.distance_px(Pixel::at(30.25, 30.0)) < 0.15, "{found:?}");
        assert!(
            blobs(&picture, &Sums::from_picture(&picture), 20, true)
                .expect("a picture")
                .iter()
                .all(|blob| blob.centre.distance_px(Pixel::at(70.0, 30.0)) < 1.0)
        );
    }
}
