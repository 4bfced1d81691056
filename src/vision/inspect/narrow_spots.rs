//! Finds areas that differ from their surroundings and are narrower than a disc.
//!
//! An opening by reconstruction (Vincent, IEEE T-IP 2, 1993) with a disc removes every area of any shape that is
//! brighter than its surroundings and too narrow for the disc. Everything else stays unchanged, including its corners.
//! A closing removes darker areas in the same way.

use super::footprint::Window;
use opencv::core::{self, Mat, MatTraitConstManual, Point, Scalar, Size};
use opencv::imgproc;

/// The film brightness of the pixels of a window, with the parameters of the search.
pub struct BrightnessLevels<'a> {
    pub window: &'a Window,
    /// Brightness, grey levels; 0 for a pixel of unknown brightness.
    pub levels: Vec<f32>,
    /// Radius of the disc, px.
    pub disc_px: usize,
    /// Minimum relative difference between an area and its surroundings; used if it is unknown whether breaks are
    /// brighter or darker than film.
    pub tolerance: f32,
}

/// A level above the brightness of every pixel.
const MAX_LEVELS: f32 = 1024.0;

impl BrightnessLevels<'_> {
    /// Finds pixels in areas that are too narrow for the disc and differ from their surroundings as a break differs
    /// from its film. The minimum difference is given by `break_to_film`, ratios in which 1 means no difference. If it
    /// is unknown whether breaks are brighter or darker, pixels that differ in either direction are returned.
    ///
    /// # Errors
    /// If OpenCV refuses the picture.
    pub fn narrow_pixels(&self, break_to_film: Option<[f32; 2]>) -> opencv::Result<Vec<bool>> {
        let Some([least, most]) = break_to_film else {
            let brighter = self.narrow_pixels(Some([1.0 + self.tolerance, f32::INFINITY]))?;
            let darker = self.narrow_pixels(Some([0.0, 1.0 - self.tolerance]))?;
            return Ok(brighter.into_iter().zip(darker).map(|(brighter, darker)| brighter || darker).collect());
        };
        if least > 1.0 {
            let bright = |look: f32, around: f32| look >= least * around;
            return self.opening_outliers(&self.levels, bright);
        }
        // Darker areas are found as brighter areas of the negative.
        let negative: Vec<f32> =
            self.levels.iter().map(|&look| if look > 0.0 { MAX_LEVELS - look } else { 0.0 }).collect();
        self.opening_outliers(&negative, |look, around| MAX_LEVELS - look <= most * (MAX_LEVELS - around))
    }

    /// Finds the pixels of known brightness that differ from the result of an opening by reconstruction.
    fn opening_outliers(&self, picture: &[f32], is_apart: impl Fn(f32, f32) -> bool) -> opencv::Result<Vec<bool>> {
        let (rows, columns) = (self.window.height as i32, self.window.width as i32);
        // Unknown pixels must not form an edge of an area: they have the highest brightness for the erosion, and are
        // dark for the reconstruction.
        let open: Vec<f32> = picture.iter().map(|&look| if look > 0.0 { look } else { MAX_LEVELS }).collect();
        let open = Mat::new_rows_cols_with_data(rows, columns, &open)?;
        let picture_mat = Mat::new_rows_cols_with_data(rows, columns, picture)?;
        let side = 2 * self.disc_px as i32 + 1;
        let disc =
            imgproc::get_structuring_element(imgproc::MORPH_ELLIPSE, Size::new(side, side), Point::new(-1, -1))?;
        let (border, outside) = (core::BORDER_CONSTANT, Scalar::all(f64::from(MAX_LEVELS)));
        let (mut eroded, mut opened) = (Mat::default(), Mat::default());
        imgproc::erode(&open, &mut eroded, &disc, Point::new(-1, -1), 1, border, outside)?;
        core::min(&eroded, &picture_mat, &mut opened)?;
        let square = imgproc::get_structuring_element(imgproc::MORPH_RECT, Size::new(3, 3), Point::new(-1, -1))?;
        // Each iteration reaches one pixel farther. The loop ends when nothing changes, at the latest after as many
        // iterations as the window has pixels.
        for _ in 0..picture.len() {
            let (mut wider, mut next) = (Mat::default(), Mat::default());
            imgproc::dilate(&opened, &mut wider, &square, Point::new(-1, -1), 1, border, Scalar::all(0.0))?;
            core::min(&wider, &picture_mat, &mut next)?;
            let changed = core::norm2(&next, &opened, core::NORM_INF, &core::no_array())?;
            opened = next;
            if changed == 0.0 {
                break;
            }
        }
        let around = opened.data_typed::<f32>()?;
        Ok(picture.iter().zip(around).map(|(&look, &around)| look > 0.0 && is_apart(look, around)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 60;
    const WINDOW: Window = Window { left: 0, top: 0, width: SIDE, height: SIDE };

    /// Returns the number of narrow pixels of a picture with these levels, for breaks with these ratios to their film.
    fn narrow_pixels(break_to_film: Option<[f32; 2]>, look: impl Fn(usize, usize) -> f32) -> usize {
        let levels = (0..SIDE * SIDE).map(|i| look(i % SIDE, i / SIDE)).collect();
        let looks = BrightnessLevels { window: &WINDOW, levels, disc_px: 6, tolerance: 0.1 };
        looks.narrow_pixels(break_to_film).expect("a picture").iter().filter(|narrow| **narrow).count()
    }

    /// Expected values, calculated by hand: the film has 30 levels and a square has 45 levels, 1.5 times as bright. A
    /// square of 8 px is too narrow for a disc of 13 px, so its 64 px are returned. A square of 20 px contains the
    /// disc, so none of its pixels is returned, not even at its corners. A square that is 1.2 times as bright is not a
    /// break.
    #[test]
    fn an_area_that_cannot_contain_the_disc_is_narrow() {
        let square = |side: usize, bright: f32| {
            move |column: usize, row: usize| {
                if (20..20 + side).contains(&column) && (20..20 + side).contains(&row) { bright } else { 30.0 }
            }
        };
        let darker_film = Some([1.29, 2.0]);
        assert_eq!(narrow_pixels(darker_film, square(8, 45.0)), 64);
        assert_eq!(narrow_pixels(darker_film, square(20, 45.0)), 0);
        assert_eq!(narrow_pixels(darker_film, square(8, 36.0)), 0);
        // If the film is brighter than the dry panel, 18 of 30 levels are a break, 45 levels are not.
        assert_eq!(narrow_pixels(Some([0.4, 0.7]), square(8, 18.0)), 64);
        assert_eq!(narrow_pixels(Some([0.4, 0.7]), square(8, 45.0)), 0);
        // If it is unknown how breaks differ, pixels that differ by more than 10 % in either direction are returned.
        assert_eq!(narrow_pixels(None, square(8, 34.0)), 64);
        assert_eq!(narrow_pixels(None, square(8, 26.0)), 64);
        assert_eq!(narrow_pixels(None, square(8, 32.0)), 0);
    }

    /// The transition at the edge of a brighter region is narrow but belongs to the region. Beside unknown pixels no
    /// pixel is narrow.
    #[test]
    fn an_edge_of_a_region_is_not_narrow() {
        let region = |column: usize, _: usize| match column {
            0..28 => 30.0,
            28..32 => 44.0,
            _ => 46.0,
        };
        assert_eq!(narrow_pixels(Some([1.29, 2.0]), region), 0);
        assert_eq!(narrow_pixels(Some([1.29, 2.0]), |column, _| if column < 56 { 0.0 } else { 45.0 }), 0);
    }
}
