//! Checks whether an object in front of the panel may block the light of the 3D camera's projector.
//!
//! A camera with a projector has no points where its projector does not reach. The projector is mounted beside the
//! lens, along the picture's rows, at a distance of at most B. An object at the depth z′ can shade a place at the
//! depth z only if it is seen in the same row, at a distance of at most
//!     f B (1/z′ − 1/z) px.                                                                               (1)
//! The side of the object depends on the camera, so both sides are examined. A panel cannot shade itself: with slope s
//! over k px, (1) is k s B / z, which is less than k up to s = 6, 81°.

use super::grid::Grid;
use panelprep_base::geometry::Pixel;

/// Largest distance of a projector from its lens, mm: in a Zivid Two it is 112 mm.
const MAX_BASELINE_MM: f64 = 120.0;

/// Returns whether a nearer object may block the light at a place of this depth.
pub(super) fn may_occlude(grid: &Grid, pixel: Pixel, depth_mm: f64) -> bool {
    let [x, y] = grid.block_position(pixel).map(f64::round);
    if !(x >= 0.0 && y >= 0.0 && x < grid.columns as f64 && y < grid.rows as f64) {
        return false;
    }
    let (column, row) = (x as usize, y as usize);
    // Along the row, because lens and projector lie side by side.
    (0..grid.columns).any(|other| {
        let away_px = (column.abs_diff(other) * grid.factor) as f64;
        let reaches =
            |nearer_mm: f64| grid.camera.fx_px * MAX_BASELINE_MM * (1.0 / nearer_mm - 1.0 / depth_mm) > away_px;
        other != column && grid.depth_mm(row * grid.columns + other).is_some_and(reaches) // (1)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::PinholeCamera;

    const CAMERA: PinholeCamera = PinholeCamera {
        width_px: 486,
        height_px: 300,
        fx_px: 446.0,
        fy_px: 446.0,
        cx_px: 243.0,
        cy_px: 150.0,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };

    /// By hand: f = 446 px, an object at 680 mm in front of a panel at 780 mm: 446 · 120 · (1/680 − 1/780) = 10.1
    /// px beside it.
    #[test]
    fn the_shadow_of_a_thing_is_as_wide_as_by_hand() {
        let thing = |column: usize, row: usize| (200..=240).contains(&column) && (100..=140).contains(&row);
        let depth = |index: usize| Some(if thing(index % 486, index / 486) { 680.0 } else { 780.0 });
        let grid = Grid::from_depths((486, 300), &CAMERA, depth);
        let hidden = |u: f64, v: f64| may_occlude(&grid, Pixel::at(u, v), 780.0);
        assert!(hidden(190.0, 120.0) && hidden(250.0, 120.0));
        assert!(!hidden(188.0, 120.0) && !hidden(252.0, 120.0), "too far away");
        assert!(!hidden(195.0, 150.0) && !hidden(220.0, 95.0), "in another row");
        assert!(!may_occlude(&grid, Pixel::at(190.0, 120.0), 690.0), "10 mm behind it: 4 px");
    }

    /// A plane that slopes away at 70° has no object in front of it.
    #[test]
    fn a_steep_panel_is_no_thing_before_itself() {
        let slope = 70.0_f64.to_radians().tan();
        let depth = |index: usize| {
            let x = ((index % 486) as f64 - 243.0) / 446.0;
            Some((780.0 / (1.0 - slope * x)).clamp(300.0, 3_000.0) as f32)
        };
        let grid = Grid::from_depths((486, 300), &CAMERA, depth);
        assert!((200..280).all(|column| !may_occlude(
            &grid,
            Pixel::at(column as f64, 150.0),
            780.0 / (1.0 - slope * (column as f64 - 243.0) / 446.0)
        )));
    }
}
