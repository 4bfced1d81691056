//! The region of interest: a quadrilateral in the taught picture, divided into grids (thesis 4.4, Fig. 4.18).
//!
//! A homography H maps the corners (0,0), (1,0), (1,1), (0,1) of the unit square to the corners 1 to 4 of the region,
//! so that all grids of a planar panel have the same size despite the perspective. The coordinate s runs along the
//! columns, t along the rows.

use crate::recipe;
use nalgebra::{Matrix3, Point2, Vector3};
use panelprep_base::geometry::Pixel;

/// A grid, by its row and column, counted from 1 at the region's first corner. Written as `r1c1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct GridId {
    /// Row of the grid, from 1.
    pub row: usize,
    /// Column of the grid, from 1.
    pub column: usize,
}

impl std::fmt::Display for GridId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "r{}c{}", self.row, self.column)
    }
}

impl std::str::FromStr for GridId {
    type Err = GridIdError;

    fn from_str(text: &str) -> Result<Self, GridIdError> {
        let parts = text.strip_prefix('r').and_then(|rest| rest.split_once('c'));
        let number = |digits: &str| digits.parse::<usize>().ok().filter(|&n| n > 0);
        parts
            .and_then(|(row, column)| Some(GridId { row: number(row)?, column: number(column)? }))
            .ok_or_else(|| GridIdError { found: text.to_owned() })
    }
}

/// The error if a text is not the name of a grid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{found}\" is not a grid; write row and column, as in r1c1")]
pub struct GridIdError {
    /// The text that is not a grid name.
    pub found: String,
}

/// The region as a map between the unit square and the taught picture.
#[derive(Debug, Clone)]
pub struct Region {
    /// Number of rows of grids.
    pub rows: usize,
    /// Number of columns of grids.
    pub columns: usize,
    px_from_unit: Matrix3<f64>,
    unit_from_px: Matrix3<f64>,
}

impl Region {
    /// Creates the region of a recipe; `None` only for corners that the recipe's check refuses.
    pub fn new(recipe: &recipe::Region) -> Option<Self> {
        let px_from_unit = unit_square_to_quad(recipe.corners_px());
        let unit_from_px = px_from_unit.try_inverse()?;
        Some(Region { rows: recipe.rows(), columns: recipe.columns(), px_from_unit, unit_from_px })
    }

    /// Returns the pixel at (s, t).
    pub fn pixel(&self, unit: Point2<f64>) -> Pixel {
        let p = self.px_from_unit * Vector3::new(unit.x, unit.y, 1.0);
        Pixel::at(p.x / p.z, p.y / p.z)
    }

    /// Returns the coordinates (s, t) of a pixel; coordinates outside of 0…1 are outside of the region.
    pub fn unit(&self, pixel: Pixel) -> Point2<f64> {
        let p = self.unit_from_px * Vector3::new(pixel.u, pixel.v, 1.0);
        Point2::new(p.x / p.z, p.y / p.z)
    }

    /// Returns the grid that contains a pixel; `None` outside of the region.
    pub fn grid_at(&self, pixel: Pixel) -> Option<GridId> {
        let unit = self.unit(pixel);
        let inside = (0.0..1.0).contains(&unit.x) && (0.0..1.0).contains(&unit.y);
        inside.then(|| GridId {
            row: 1 + (unit.y * self.rows as f64) as usize,
            column: 1 + (unit.x * self.columns as f64) as usize,
        })
    }

    /// Returns all grids, row by row.
    pub fn ids(&self) -> impl Iterator<Item = GridId> + use<> {
        let columns = self.columns;
        (1..=self.rows).flat_map(move |row| (1..=columns).map(move |column| GridId { row, column }))
    }

    /// Returns the lowest and the highest (s, t) of a grid.
    pub fn grid_bounds(&self, id: GridId) -> [Point2<f64>; 2] {
        let corner = |row: usize, column: usize| {
            Point2::new(column as f64 / self.columns as f64, row as f64 / self.rows as f64)
        };
        [corner(id.row - 1, id.column - 1), corner(id.row, id.column)]
    }

    /// Returns a grid's edge as a closed sequence of points in the unit square, with `steps` points on each of the four
    /// sides.
    pub fn edge(&self, id: GridId, steps: usize) -> Vec<Point2<f64>> {
        let [low, high] = self.grid_bounds(id);
        let corners = [low, Point2::new(high.x, low.y), high, Point2::new(low.x, high.y)];
        let side = |i: usize| {
            let (from, to) = (corners[i], corners[(i + 1) % 4]);
            (0..steps).map(move |step| from + (to - from) * (step as f64 / steps as f64))
        };
        (0..4).flat_map(side).collect()
    }
}

// Returns the homography from the unit square to a quadrilateral: Heckbert 1989, "Fundamentals of texture mapping and
// image warping", section 2.2.3.
fn unit_square_to_quad(corners_px: [[f64; 2]; 4]) -> Matrix3<f64> {
    let [[x0, y0], [x1, y1], [x2, y2], [x3, y3]] = corners_px;
    let (dx1, dx2, sx) = (x1 - x2, x3 - x2, x0 - x1 + x2 - x3);
    let (dy1, dy2, sy) = (y1 - y2, y3 - y2, y0 - y1 + y2 - y3);
    let scale = dx1 * dy2 - dx2 * dy1;
    let g = (sx * dy2 - dx2 * sy) / scale;
    let h = (dx1 * sy - sx * dy1) / scale;
    Matrix3::new(x1 - x0 + g * x1, x3 - x0 + h * x3, x0, y1 - y0 + g * y1, y3 - y0 + h * y3, y0, g, h, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(corners: &str) -> Region {
        let text = format!(
            "panel = \"p\"\n[region]\ncorners_px = {corners}\nrows = 2\ncolumns = 4\n\
             [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n"
        );
        let recipe = crate::recipe::Recipe::check("test.toml", &text).unwrap_or_else(|e| panic!("{e}"));
        Region::new(recipe.region()).expect("a convex region")
    }

    /// Expected value, calculated by hand: with 400 × 100 px in 4 columns and 2 rows, pixel (250, 60) is in the third
    /// column and second row.
    #[test]
    fn a_rectangle_divides_evenly() {
        let region = region("[[0, 0], [400, 0], [400, 100], [0, 100]]");
        assert_eq!(region.grid_at(Pixel::at(250.0, 60.0)).map(|id| id.to_string()), Some("r2c3".to_owned()));
        assert_eq!(region.grid_at(Pixel::at(250.0, 100.5)), None);
        assert_eq!(region.ids().count(), 8);
    }

    #[test]
    fn corners_go_to_corners_and_back_under_perspective() {
        let region = region("[[100, 50], [500, 80], [460, 400], [120, 300]]");
        let corners =
            [(0.0, 0.0, 100.0, 50.0), (1.0, 0.0, 500.0, 80.0), (1.0, 1.0, 460.0, 400.0), (0.0, 1.0, 120.0, 300.0)];
        for (s, t, u, v) in corners {
            assert!(region.pixel(Point2::new(s, t)).distance_px(Pixel::at(u, v)) < 1e-9);
            assert!((region.unit(Pixel::at(u, v)) - Point2::new(s, t)).norm() < 1e-9);
        }
    }

    #[test]
    fn grids_have_names() {
        assert_eq!("r2c13".parse::<GridId>(), Ok(GridId { row: 2, column: 13 }));
        for wrong in ["c2r1", "r0c1", "r1", "r1c1 ", "r+1c1x"] {
            assert!(wrong.parse::<GridId>().is_err(), "{wrong}");
        }
    }
}
