//! Maps of the surface: the deviation of a fit for each pixel, with the positions of missing points; and fields for
//! drawing, with a value such as a depth at each sample point of some grids.

use super::bspline::Parameter;
use super::samples::Window;
use nalgebra::Point2;
use panelprep_base::geometry::{Pixel, RasterSize};
use panelprep_cell::panel::{GridId, Region};

/// The state of one pixel of the taught picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MapPixel {
    /// The pixel lies outside the region.
    Outside,
    /// The pixel shows no point of the panel.
    Missing,
    /// The pixel has a point that is not used in the fit.
    Rejected {
        /// Distance of the point in front of the surface, mm.
        mm: f32,
    },
    /// The pixel has a point that is used in the fit.
    Fits {
        /// Distance of the point in front of the surface, mm.
        mm: f32,
    },
}

/// The deviation of a fit for each pixel of the part of the taught picture that contains the region.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviationMap {
    pub(super) window: Window,
    pub(super) pixels: Vec<MapPixel>,
    pub(super) mm_per_px: f64,
}

/// The parts of a region without panel material.
#[derive(Debug, Clone)]
pub struct HoleMap {
    region: Region,
    window: Window,
    is_over: Vec<bool>,
}

impl HoleMap {
    /// Creates a region without holes.
    pub fn empty(region: &Region) -> Self {
        HoleMap { region: region.clone(), window: Window { columns: 0..0, rows: 0..0 }, is_over: Vec::new() }
    }

    /// Returns whether the panel has a hole at this position.
    pub fn is_hole(&self, at: Parameter) -> bool {
        let pixel = self.region.pixel(Point2::new(at.u, at.v));
        let (column, row) = (pixel.u.round(), pixel.v.round());
        let inside = column >= self.window.columns.start as f64
            && row >= self.window.rows.start as f64
            && column < self.window.columns.end as f64
            && row < self.window.rows.end as f64;
        inside && {
            let (column, row) =
                (column as usize - self.window.columns.start, row as usize - self.window.rows.start);
            self.is_over[row * self.window.width() + column]
        }
    }
}

impl DeviationMap {
    /// Returns the number of pixels in a row.
    pub fn width(&self) -> usize {
        self.window.width()
    }

    /// Returns the state of each pixel, row by row.
    pub fn pixels(&self) -> &[MapPixel] {
        &self.pixels
    }

    /// Returns a map of the same region in which `says` determines the state of each pixel of the region.
    pub(super) fn fill_region(&self, says: impl Fn(Pixel) -> MapPixel) -> Self {
        let one = |(index, pixel): (usize, &MapPixel)| match pixel {
            MapPixel::Outside => MapPixel::Outside,
            _ => says(self.window.pixel(index)),
        };
        DeviationMap { pixels: self.pixels.iter().enumerate().map(one).collect(), ..self.clone() }
    }

    /// Returns the size of a pixel on the panel in the middle of the region, mm.
    pub fn mm_per_px(&self) -> f64 {
        self.mm_per_px
    }

    /// Returns the side, px, and the centre of the largest square of the region without a point in the fit; the side is
    /// 0 if there is no such pixel.
    pub(super) fn largest_hole(&self) -> (usize, Pixel) {
        let squares = self.squares();
        let largest = squares.iter().enumerate().fold(
            (0, 0),
            |best, (index, side)| {
                if *side > best.0 { (*side, index) } else { best }
            },
        );
        let corner = self.window.pixel(largest.1);
        let half = (f64::from(largest.0) - 1.0).max(0.0) / 2.0;
        (largest.0 as usize, Pixel::at(corner.u - half, corner.v - half))
    }

    /// Returns the holes that contain a square of this side, mm.
    pub fn holes(&self, region: &Region, side_mm: f64) -> HoleMap {
        let least = (side_mm / self.mm_per_px).ceil().max(1.0) as u32;
        let width = self.width();
        let mut reach: Vec<u32> =
            self.squares().into_iter().map(|side| if side >= least { side } else { 0 }).collect();
        // A square of side s that ends at a pixel contains the s − 1 pixels before it along the row, along the column,
        // and diagonally.
        for index in (0..reach.len()).rev() {
            let (last_column, last_row) = ((index + 1) % width == 0, index + width >= reach.len());
            let right = if last_column { 0 } else { reach[index + 1] };
            let below = if last_row { 0 } else { reach[index + width] };
            let both = if last_column || last_row { 0 } else { reach[index + width + 1] };
            reach[index] = reach[index].max(right.max(below).max(both).saturating_sub(1));
        }
        let is_over = reach.into_iter().map(|side| side > 0).collect();
        HoleMap { region: region.clone(), window: self.window.clone(), is_over }
    }

    /// Returns for each pixel the side of the largest square without a point that ends at this pixel, px.
    fn squares(&self) -> Vec<u32> {
        let raster = RasterSize { width: self.width(), height: self.pixels.len() / self.width().max(1) };
        raster.largest_squares(|index| matches!(self.pixels[index], MapPixel::Missing | MapPixel::Rejected { .. }))
    }
}

/// The values on one grid, for each sample point, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct GridField {
    /// The grid to which the values belong.
    pub id: GridId,
    /// Number of sample points along u.
    pub columns: usize,
    /// The value at each sample point; `None` if there is no panel material.
    pub values: Vec<Option<f32>>,
}

/// The values on some grids of a region.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// The values on each grid.
    pub grids: Vec<GridField>,
    /// Lengths of the region along u and along v, through its middle, mm.
    pub sides_mm: [f64; 2],
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, determined by hand: 6 × 5 pixels have a hole of 3 × 2 pixels that contains a rejected pixel.
    /// The largest square is 2 × 2, and there is a second one at (4, 2).
    #[test]
    fn the_largest_hole_is_a_square_of_missing_and_rejected_pixels() {
        let (fits, missing) = (MapPixel::Fits { mm: 0.1 }, MapPixel::Missing);
        let mut pixels = vec![fits; 30];
        for (column, row) in [(1, 1), (2, 1), (3, 1), (1, 2), (2, 2), (3, 2)] {
            pixels[row * 6 + column] = missing;
        }
        pixels[2 * 6 + 2] = MapPixel::Rejected { mm: -2.0 };
        let mut map = DeviationMap { window: Window { columns: 100..106, rows: 50..55 }, pixels, mm_per_px: 2.0 };
        assert_eq!(map.largest_hole(), (2, Pixel::at(101.5, 51.5)));
        // With squares of 4 mm, both squares and thus all six pixels of the hole are found; no larger square is found.
        let text = "panel = \"p\"\nregion = { corners_px = [[100, 50], [106, 50], [106, 55], [100, 55]], rows = 1, \
                    columns = 1 }\nlocate.box_min_mm = [0, 0, 0]\nlocate.box_max_mm = [1, 1, 1]\n";
        let recipe = panelprep_cell::recipe::Recipe::check("f", text).unwrap_or_else(|e| panic!("{e}"));
        let region = Region::new(recipe.region()).expect("convex");
        let over = |holes: &HoleMap, column: f64, row: f64| {
            let unit = region.unit(Pixel::at(column, row));
            holes.is_hole(Parameter { u: unit.x, v: unit.y })
        };
        let holes = map.holes(&region, 4.0);
        assert_eq!(holes.is_over.iter().filter(|over| **over).count(), 6);
        assert!(over(&holes, 101.0, 51.0) && over(&holes, 103.0, 52.0) && !over(&holes, 104.0, 52.0));
        assert!(!map.holes(&region, 4.1).is_over.contains(&true) && !over(&holes, 90.0, 51.0));
        map.pixels[6 + 1] = fits;
        assert_eq!(map.largest_hole(), (2, Pixel::at(102.5, 51.5)));
        map.pixels[6 + 2] = fits;
        assert_eq!(map.largest_hole().0, 1);
    }
}
