//! A flat panel for tests, 700 mm in front of a camera. At this distance a pixel is 1 mm. The background is 160 mm
//! behind the panel.

use super::TaughtPanel;
use crate::recipe::Recipe;
use nalgebra::Isometry3;
use panelprep_base::geometry::{OrganizedCloud, PinholeCamera, Rigid};

const CAMERA: PinholeCamera = PinholeCamera {
    width_px: 300,
    height_px: 200,
    fx_px: 700.0,
    fy_px: 700.0,
    cx_px: 149.5,
    cy_px: 99.5,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};
/// First and last column and row of the panel, px; after it, the centre of the hole, px.
const PANEL_PX: [[usize; 2]; 2] = [[50, 250], [40, 160]];
const HOLE_PX: [usize; 2] = [188, 98];

/// Options of the test panel.
pub struct FlatPanelOptions {
    /// First column of a notch of twenty columns, from the panel's upper edge to row 51.
    pub notch: Option<usize>,
    /// The side of a square hole, px.
    pub hole_px: usize,
    /// Whether points are missing in the hole; otherwise the scan shows the background there.
    pub is_hole_empty: bool,
    /// Whether single points of the scan are missing.
    pub dropouts: bool,
    /// Whether the recipe contains the outline.
    pub is_drawn: bool,
    /// The right edge of the region, px.
    pub region_right_px: f64,
}

impl Default for FlatPanelOptions {
    fn default() -> Self {
        FlatPanelOptions {
            notch: None,
            hole_px: 0,
            is_hole_empty: false,
            dropouts: false,
            is_drawn: false,
            region_right_px: 240.0,
        }
    }
}

/// Returns the panel, taught with a region of 4 rows and 6 columns of grids from (60, 44.5) to (240, 155) px, which are
/// the rows 45 to 154 of the picture.
pub fn taught(flat: &FlatPanelOptions) -> TaughtPanel {
    let [columns, rows] = PANEL_PX;
    let is_panel = |column: usize, row: usize| {
        let is_notch = flat.notch.is_some_and(|from| (from..from + 20).contains(&column)) && row <= 51;
        (columns[0]..=columns[1]).contains(&column) && (rows[0]..=rows[1]).contains(&row) && !is_notch
    };
    let half = flat.hole_px / 2;
    let is_hole = |column: usize, row: usize| {
        flat.hole_px > 0 && column.abs_diff(HOLE_PX[0]) <= half && row.abs_diff(HOLE_PX[1]) <= half
    };
    let point = |index: usize| {
        let (column, row) = (index % CAMERA.width_px, index / CAMERA.width_px);
        let depth_mm = match (is_panel(column, row), is_hole(column, row)) {
            (true, true) if flat.is_hole_empty => return [f32::NAN; 3],
            (true, false) if flat.dropouts && (column * 7 + row * 13) % 29 < 2 => return [f32::NAN; 3],
            (true, false) => 700.0,
            _ => 860.0,
        };
        let x = (column as f64 - CAMERA.cx_px) / CAMERA.fx_px * depth_mm;
        let y = (row as f64 - CAMERA.cy_px) / CAMERA.fy_px * depth_mm;
        [x as f32, y as f32, depth_mm as f32]
    };
    let count = CAMERA.width_px * CAMERA.height_px;
    let points = (0..count).map(point).collect();
    let cloud =
        OrganizedCloud::new(CAMERA.width_px, CAMERA.height_px, points, vec![[80; 3]; count]).expect("counts");
    let right = flat.region_right_px;
    let outline = match flat.is_drawn {
        true => "panel.outline_px = [[50, 40], [250, 40], [250, 160], [50, 160]]\n",
        false => "",
    };
    let text = format!(
        "panel.name = \"p\"\n{outline}[region]\ncorners_px = [[60, 44.5], [{right:?}, 44.5], [{right:?}, 155], [60, 155]]\nrows = 4\n\
         columns = 6\n[locate]\nbox_min_mm = [-400, -400, 600]\nbox_max_mm = [400, 400, 800]\n"
    );
    let recipe = Recipe::check("test.toml", &text).unwrap_or_else(|e| panic!("{e}"));
    TaughtPanel::learn(&cloud, CAMERA, Rigid::from_isometry_unchecked(Isometry3::identity()), &recipe)
        .unwrap_or_else(|e| panic!("{e}"))
}
