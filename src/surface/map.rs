//! The deviation of a fit as a picture: where the scan lies before and behind the surface, and where it has holes.

use super::samples::Window;
use crate::geometry::{ColorPicture, Pixel};

/// What one pixel of the taught picture says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MapPixel {
    /// Outside of the region.
    Outside,
    /// No point of the panel.
    Missing,
    /// A point that has no say.
    Rejected {
        /// How far in front of the surface, mm.
        mm: f32,
    },
    /// A point in the fit.
    Fits {
        /// How far in front of the surface, mm.
        mm: f32,
    },
}

/// A fit's deviation, pixel by pixel of the part of the taught picture that holds the region.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviationMap {
    pub(super) window: Window,
    pub(super) pixels: Vec<MapPixel>,
}

const BACKGROUND: [u8; 3] = [245, 245, 245];
const MISSING: [u8; 3] = [20, 20, 20];
const REJECTED: [u8; 3] = [230, 190, 0];

impl DeviationMap {
    /// Pixels across.
    pub fn width(&self) -> usize {
        self.window.width()
    }

    /// What each pixel says, row by row.
    pub fn pixels(&self) -> &[MapPixel] {
        &self.pixels
    }

    /// A picture: white on the surface, red in front of it, blue behind it, full colour from `full_mm` on; black where
    /// the scan has no point, yellow where a point was left out.
    pub fn picture(&self, full_mm: f64) -> ColorPicture {
        let width = self.width();
        let mut picture = ColorPicture::filled(width, self.pixels.len() / width.max(1), BACKGROUND);
        for (color, pixel) in picture.rgb.iter_mut().zip(&self.pixels) {
            *color = match pixel {
                MapPixel::Outside => BACKGROUND,
                MapPixel::Missing => MISSING,
                MapPixel::Rejected { .. } => REJECTED,
                MapPixel::Fits { mm } => shade(f64::from(*mm) / full_mm),
            };
        }
        picture
    }

    /// Side, px, and middle of the largest square of the region in which no pixel has a point in the fit; 0 where there
    /// is none.
    pub(super) fn largest_hole(&self) -> (usize, Pixel) {
        let width = self.width();
        let (mut best, mut at) = (0, 0);
        // The largest square that ends at each pixel of the row above and of this one.
        let (mut above, mut here) = (vec![0_u32; width + 1], vec![0_u32; width + 1]);
        for (index, pixel) in self.pixels.iter().enumerate() {
            let column = index % width + 1;
            let hole = matches!(pixel, MapPixel::Missing | MapPixel::Rejected { .. });
            here[column] =
                if hole { 1 + above[column].min(above[column - 1]).min(here[column - 1]) } else { 0 };
            if here[column] > best {
                (best, at) = (here[column], index);
            }
            if column == width {
                std::mem::swap(&mut above, &mut here);
            }
        }
        let corner = self.window.pixel(at);
        let half = (f64::from(best) - 1.0).max(0.0) / 2.0;
        (best as usize, Pixel::at(corner.u - half, corner.v - half))
    }
}

/// White at 0, red at 1, blue at −1.
fn shade(share: f64) -> [u8; 3] {
    let fade = (255.0 * (1.0 - share.abs().min(1.0))) as u8;
    if share >= 0.0 { [255, fade, fade] } else { [fade, fade, 255] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: in 6 × 5 pixels a hole of 3 × 2 whose other pixel is rejected; the largest square is 2 × 2 and the
    /// corner at (4, 2) makes a second one.
    #[test]
    fn the_largest_hole_is_a_square_of_missing_and_rejected_pixels() {
        let (fits, missing) = (MapPixel::Fits { mm: 0.1 }, MapPixel::Missing);
        let mut pixels = vec![fits; 30];
        for (column, row) in [(1, 1), (2, 1), (3, 1), (1, 2), (2, 2), (3, 2)] {
            pixels[row * 6 + column] = missing;
        }
        pixels[2 * 6 + 2] = MapPixel::Rejected { mm: -2.0 };
        let mut map = DeviationMap { window: Window { columns: 100..106, rows: 50..55 }, pixels };
        assert_eq!(map.largest_hole(), (2, Pixel::at(101.5, 51.5)));
        map.pixels[6 + 1] = fits;
        assert_eq!(map.largest_hole(), (2, Pixel::at(102.5, 51.5)));
        map.pixels[6 + 2] = fits;
        assert_eq!(map.largest_hole().0, 1);
        let picture = map.picture(0.2);
        assert_eq!((picture.rgb[0], picture.rgb[6 + 3]), ([255, 127, 127], MISSING));
    }
}
