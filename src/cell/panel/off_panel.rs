//! Finds the parts of the region that are not on the panel, because the region extends over the panel's edge or over a
//! hole. Also finds the face of the search box that cuts the panel.
//!
//! Outside of the panel there is no surface to test or to sand; the camera sees objects far behind the panel there.
//! Such a part of the region is measured on the taught scan, in mm on the extrapolated surface of the panel, and
//! reported with its grids. A few missing points inside the panel are not a hole.
//!
//! If the search box cuts the panel, the panel's surface continues beyond a face of the box. The part outside of the
//! box is neither taught nor searched, and the border of the points at this face is not an edge of the panel.

use super::extent::{self, OutlineFrom, is_held_at};
use super::region::GridId;
use super::segment::max_step_mm;
use super::taught::TaughtPanel;
use crate::recipe;
use nalgebra::Point2;
use panelprep_base::geometry::{DIRECT_NEIGHBOURS, Mask, Panel, Pixel, Point, RasterSize, polygon};
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::Reason;

/// Maximum distance by which the region may extend beyond the panel's outline, px: the outline is accurate to a few
/// pixels.
const EDGE_TOLERANCE_PX: f64 = 2.0;
/// Maximum distance between a corner of the region and a part off the panel at which the message names the corner in
/// addition to the grid, px.
const MAX_CORNER_DISTANCE_PX: f64 = 12.0;
/// Maximum number of measured pixels off the panel; they are selected uniformly.
const MAX_MEASURED_PLACES: usize = 20_000;
/// Step between the outline's points that are used to measure a distance from the outline.
const OUTLINE_POINT_STEP: usize = 2;
/// Half-widths of the neighbourhood from which the surface is extrapolated, px, tried in this order until it contains
/// enough points.
const EXTRAPOLATION_HALF_WIDTHS_PX: [usize; 4] = [5, 10, 20, 40];

/// What the region extends over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GapKind {
    /// Over the edge of the panel.
    Edge,
    /// Over a hole in the panel.
    Hole,
}

/// A part of the region that is not on the panel.
#[derive(Debug, Clone, PartialEq)]
pub struct OffPanel {
    /// What this part extends over.
    pub gap_kind: GapKind,
    /// The overhang beyond the edge, or the side of the largest square inside the hole, mm. `None` if no surface is
    /// near enough to measure it.
    pub size_mm: Option<f64>,
    /// The pixel with the largest overhang, or the centre of the hole, in the taught picture.
    pub pixel: Pixel,
    /// The grid that contains this pixel.
    pub grid: GridId,
    /// Number of the region's corner near this pixel, from 1; `None` if no corner is near.
    pub corner: Option<usize>,
    /// All grids that contain pixels of this part.
    pub grids: Vec<GridId>,
}

impl OffPanel {
    /// Returns the reason as text, for a person who teaches or checks the panel.
    pub fn reason(&self) -> Reason {
        let OffPanel { size_mm, pixel: Pixel { u, v }, grid, .. } = self;
        let size = size_mm.map_or("an unknown number of".to_owned(), |mm| fixed_decimals(mm, 1).to_string());
        let place = match self.corner {
            Some(corner) => format!("near corner {corner} of the region, in grid {grid}, at ({u:.0}, {v:.0}) px"),
            None => format!("in grid {grid}, at ({u:.0}, {v:.0}) px"),
        };
        match self.gap_kind {
            GapKind::Edge => {
                let all: Vec<String> = self.grids.iter().map(ToString::to_string).collect();
                let message = format!(
                    "the region extends beyond the panel's edge by {size} mm {place}; affected grids: {}; draw the \
                     region inside the panel's outline",
                    all.join(", ")
                );
                Reason::new("region_off_panel", message)
            }
            GapKind::Hole => {
                let message = format!(
                    "the region has a hole of {size} mm {place}; draw the region beside the hole, or mask it with \
                     [inspect] masked_px; if the panel has no hole there, scan it again"
                );
                Reason::new("region_over_hole", message)
            }
        }
    }
}

impl TaughtPanel {
    /// Finds the parts of the region that are not on the panel: the largest overhang beyond the edge, and each hole
    /// that contains a square with a side of more than `hole_mm`. The quadrilaterals `masked_px` of the taught picture
    /// are excluded.
    pub fn region_off_panel(&self, hole_mm: f64, masked_px: &[[[f64; 2]; 4]]) -> Vec<OffPanel> {
        let masks: Vec<Vec<Pixel>> =
            masked_px.iter().map(|corners| corners.iter().map(|&[u, v]| Pixel::at(u, v)).collect()).collect();
        let whole = polygon::fill_polygon(&self.outline_px, self.mask.width, self.mask.height);
        let (mut off_edge, mut missing) = (Vec::new(), Mask::all_outside(self.mask.width, self.mask.height));
        for index in (0..whole.inside.len()).filter(|&index| !self.mask.inside[index]) {
            let pixel = Pixel::at((index % whole.width) as f64, (index / whole.width) as f64);
            let in_region = self.region.grid_at(pixel).is_some();
            if !in_region || masks.iter().any(|mask| polygon::contains(mask, pixel)) {
                continue;
            }
            if !whole.inside[index] {
                off_edge.push(pixel);
            } else if self.outline_from == OutlineFrom::Scan || self.scan.point_at(index).is_some() {
                // Inside a drawn outline, missing points are not a hole; points of the background are a hole.
                missing.inside[index] = true;
            }
        }
        let holes = self.holes(&missing).into_iter().filter(|hole| hole.size_mm.is_none_or(|mm| mm > hole_mm));
        self.region_beyond_edge(&off_edge).into_iter().chain(holes).collect()
    }

    fn region_beyond_edge(&self, off_edge: &[Pixel]) -> Option<OffPanel> {
        let outline: Vec<Pixel> = self.outline_px.iter().step_by(OUTLINE_POINT_STEP).copied().collect();
        let nearest = |pixel: &Pixel| {
            let distances = outline.iter().map(|on| (pixel.distance_px(*on), *on));
            distances.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let places = off_edge.iter().step_by(off_edge.len().div_ceil(MAX_MEASURED_PLACES).max(1));
        let beyond: Vec<(f64, Pixel, Pixel)> = places
            .filter_map(|pixel| nearest(pixel).map(|(far_px, edge)| (far_px, *pixel, edge)))
            .filter(|(far_px, ..)| *far_px > EDGE_TOLERANCE_PX)
            .collect();
        let (_, at, edge) = beyond.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let size_mm = self.extrapolated_distance_mm([at, edge], edge);
        self.measure_off_panel(GapKind::Edge, (at, size_mm), &mut beyond.iter().map(|(_, pixel, _)| *pixel))
    }

    /// Finds the holes among these pixels, and measures each hole by its largest inscribed square.
    fn holes(&self, missing: &Mask) -> Vec<OffPanel> {
        let raster = RasterSize { width: missing.width, height: missing.height };
        let squares = raster.largest_squares(|index| missing.inside[index]);
        let hole = |piece: Vec<usize>| {
            let last = piece.iter().copied().max_by_key(|index| squares[*index])?;
            // The pixel is the lower right corner of the square.
            let (side_px, column, row) =
                (squares[last] as f64, (last % raster.width) as f64, (last / raster.width) as f64);
            let half_px = (side_px - 1.0) / 2.0;
            let at = Pixel::at(column - half_px, row - half_px);
            let ends = [column - side_px + 0.5, column + 0.5].map(|u| Pixel::at(u, at.v));
            let pixels =
                piece.iter().map(|index| Pixel::at((index % raster.width) as f64, (index / raster.width) as f64));
            let size_mm =
                self.nearest_panel_pixel(at).and_then(|beside| self.extrapolated_distance_mm(ends, beside));
            self.measure_off_panel(GapKind::Hole, (at, size_mm), &mut pixels.into_iter())
        };
        missing.connected_components().into_iter().filter_map(hole).collect()
    }

    /// Finds the nearest pixel of the panel to the left of a pixel; if there is none, the nearest one to the right.
    fn nearest_panel_pixel(&self, at: Pixel) -> Option<Pixel> {
        let (column, row) = (at.u.round() as usize, at.v.round() as usize);
        let is_panel = |column: &usize| self.mask.contains(*column, row);
        let left = (0..column.min(self.mask.width)).rev().find(is_panel);
        left.or_else(|| (column..self.mask.width).find(is_panel))
            .map(|column| Pixel::at(column as f64, at.v.round()))
    }

    fn measure_off_panel(
        &self,
        beyond: GapKind,
        (at, size_mm): (Pixel, Option<f64>),
        pixels: &mut dyn Iterator<Item = Pixel>,
    ) -> Option<OffPanel> {
        let mut grids: Vec<GridId> = pixels.filter_map(|pixel| self.region.grid_at(pixel)).collect();
        grids.sort_unstable();
        grids.dedup();
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        let corner = corners
            .iter()
            .position(|(s, t)| self.region.pixel(Point2::new(*s, *t)).distance_px(at) <= MAX_CORNER_DISTANCE_PX);
        let grid = self.region.grid_at(at).or(grids.first().copied())?;
        Some(OffPanel { gap_kind: beyond, size_mm, pixel: at, grid, corner: corner.map(|index| index + 1), grids })
    }

    /// Returns the distance between two pixels, mm, measured on the surface that is extrapolated from the neighbourhood
    /// of the pixel `near`.
    fn extrapolated_distance_mm(&self, [one, other]: [Pixel; 2], near: Pixel) -> Option<f64> {
        let at = near.nearest_whole(self.scan.width(), self.scan.height())?;
        let plane = EXTRAPOLATION_HALF_WIDTHS_PX
            .into_iter()
            .find_map(|half_width_px| self.fit_plane_at(at, half_width_px))?;
        let on_plane = |pixel: Pixel| -> Option<Point<Panel>> {
            plane.intersect_ray(
                self.panel_from_camera.origin(),
                self.panel_from_camera * self.camera.unproject(pixel)?,
            )
        };
        Some(on_plane(one)?.distance_mm(on_plane(other)?))
    }
}

/// Minimum number of border pixels at which the panel continues beyond a face of the search box. Fewer pixels belong to
/// a holder or to flying points.
const MIN_BORDER_PX: usize = 12;

/// A face of the search box that cuts the panel.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxCut {
    /// The face's key in the recipe.
    pub key: &'static str,
    /// The axis of the face: 0 for X, 1 for Y, 2 for Z.
    pub axis: usize,
    /// The position of the face, mm.
    pub face_mm: f64,
    /// Number of pixels of the panel's border at which the surface continues beyond the face.
    pub border_px: usize,
    /// One of these pixels.
    pub at: Pixel,
}

impl BoxCut {
    /// Returns the reason as text, for a person who teaches the panel.
    pub fn reason(&self) -> Reason {
        let BoxCut { key, axis, face_mm, border_px, at: Pixel { u, v } } = self;
        let message = format!(
            "the search box cuts the panel: its surface continues beyond locate.{key}[{axis}] = {face_mm} mm, at \
             {border_px} px of its border, for example at ({u:.0}, {v:.0}) px; enlarge the box there"
        );
        Reason::new("box_cuts", message)
    }
}

impl TaughtPanel {
    /// Returns the face of the search box that cuts the longest part of the panel's border; `None` if no face cuts the
    /// panel. A holder of the panel may extend beyond the box.
    pub fn box_cut(&self, locate: &recipe::Locate) -> Option<BoxCut> {
        let raster = RasterSize { width: self.scan.width(), height: self.scan.height() };
        let max_step_mm = max_step_mm(&self.scan, &self.mask.inside);
        let mut cuts: [Vec<usize>; 6] = Default::default();
        for (index, point) in self.points() {
            let outside = |next: usize| {
                let beyond = self.scan.point_at(next).filter(|beyond| beyond.distance_mm(point) < max_step_mm)?;
                exceeded_face(locate, (self.nominal_pose * beyond).mm.coords.as_slice())
            };
            let is_free = |next: &usize| {
                !self.mask.inside[*next] && !is_held_at(&self.held_px, extent::pixel_at(*next, raster.width))
            };
            let mut neighbours = raster.neighbours(index, &DIRECT_NEIGHBOURS).filter(is_free);
            if let Some(face) = neighbours.find_map(outside) {
                cuts[face].push(index);
            }
        }
        let (face, pixels) = cuts.iter().enumerate().max_by_key(|(_, pixels)| pixels.len())?;
        let at = *pixels.get(pixels.len() / 2).filter(|_| pixels.len() >= MIN_BORDER_PX)?;
        let (key, corner_mm) = match face < 3 {
            true => ("box_min_mm", locate.box_min_mm()),
            false => ("box_max_mm", locate.box_max_mm()),
        };
        Some(BoxCut {
            key,
            axis: face % 3,
            face_mm: corner_mm[face % 3],
            border_px: pixels.len(),
            at: extent::pixel_at(at, raster.width),
        })
    }
}

/// Returns the face of the search box beyond which a point is: 0 to 2 for the lower faces, 3 to 5 for the upper faces.
/// `None` if the point is in the box.
fn exceeded_face(locate: &recipe::Locate, point_mm: &[f64]) -> Option<usize> {
    let (low, high) = (locate.box_min_mm(), locate.box_max_mm());
    (0..3)
        .find(|&axis| point_mm[axis] < low[axis])
        .or_else(|| (0..3).find(|&axis| point_mm[axis] > high[axis]).map(|axis| axis + 3))
}

#[cfg(test)]
mod tests {
    use super::super::flat::{FlatPanelOptions, taught};
    use super::*;
    use crate::recipe::Recipe;
    use panelprep_sim::{Cell, SEARCH_BOX_MM, Scene};

    /// Returns the face that cuts the panel of a cell, and the height of the taught panel, mm, if the search box ends
    /// at the height `top_mm`. With `has_holder`, everything above the region is held.
    fn cut(cell: &Cell, top_mm: f64, has_holder: bool) -> (Option<BoxCut>, f64) {
        let (region, [low, [x, y, _]]) = (cell.region(), SEARCH_BOX_MM);
        // The held quadrilateral begins 2 px above the region's upper corners, and is twice as wide as the region.
        let [left, right] = [region.corners_px[0], region.corners_px[1]];
        let (across, down) = ((right.u - left.u) / 2.0, (right.v - left.v) / 2.0);
        let [left, right] = [[left.u - across, left.v - down - 2.0], [right.u + across, right.v + down - 2.0]];
        let holder = [left, right, [right[0], 0.0], [left[0], 0.0]];
        let held = if has_holder { format!(", held_px = [{holder:?}]") } else { String::new() };
        let text = format!(
            "panel = {{ name = \"p\"{held} }}\n[region]\ncorners_px = {:?}\nrows = {}\ncolumns = {}\n\
             [locate]\nbox_min_mm = {low:?}\nbox_max_mm = {:?}\n",
            region.corners_px.map(|px| [px.u, px.v]),
            region.rows,
            region.columns,
            [x, y, top_mm]
        );
        let recipe = Recipe::check("simulated.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
        let panel =
            TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), cell.calibrated_base_from_camera(), &recipe);
        let panel = panel.unwrap_or_else(|error| panic!("{error}"));
        let highest_mm = panel.points().map(|(_, point)| point.mm.z).fold(f64::NEG_INFINITY, f64::max);
        (panel.box_cut(recipe.locate()), highest_mm)
    }

    /// The search box of the simulated cell contains the whole panel; the region ends 15 mm below the panel's upper
    /// edge. A box that ends 7 mm below this edge cuts the panel.
    #[test]
    fn a_box_that_cuts_the_panel_is_named() {
        let cell = Cell::new(4, Scene::Good, 4);
        let (whole, highest_mm) = cut(&cell, SEARCH_BOX_MM[1][2], false);
        assert_eq!(whole, None);
        let top_mm = (highest_mm - 7.0).round();
        let found = cut(&cell, top_mm, false).0.expect("a cut");
        assert_eq!((found.key, found.axis, found.face_mm), ("box_max_mm", 2, top_mm));
        assert!(found.reason().message.contains("locate.box_max_mm[2]"), "{found:?}");
        // If the recipe states that the panel is held there, the part beyond the box is the holder.
        assert_eq!(cut(&cell, top_mm, true).0, None);
    }

    fn found(flat: FlatPanelOptions) -> Vec<OffPanel> {
        taught(&flat).region_off_panel(12.0, &[])
    }

    /// A region inside the panel has no overhang, even with noise and some missing points.
    #[test]
    fn a_region_on_the_panel_has_no_overhang() {
        assert_eq!(found(FlatPanelOptions::default()), []);
        assert_eq!(found(FlatPanelOptions { dropouts: true, ..FlatPanelOptions::default() }), []);
        // A region that ends exactly at the panel's edge, here at column 250, has no overhang.
        assert_eq!(found(FlatPanelOptions { region_right_px: 250.0, ..FlatPanelOptions::default() }), []);
    }

    /// Expected values, calculated by hand: at 700 mm a pixel is 1 mm. The notch of 20 × 12 px enters the panel from
    /// above at the columns 140 to 159 and ends at row 52. The region begins at row 45, seven rows above. The largest
    /// overhang is at the centre of the notch, on the edge of the region.
    #[test]
    fn a_region_over_the_edge_is_measured_and_named() {
        let off = found(FlatPanelOptions { notch: Some(140), ..FlatPanelOptions::default() });
        let [OffPanel { gap_kind: GapKind::Edge, size_mm: Some(mm), pixel: at, grid, corner: None, grids }] =
            &off[..]
        else {
            panic!("{off:?}")
        };
        assert!((mm - 7.0).abs() < 1.0, "{mm} mm");
        assert!((140.0..160.0).contains(&at.u) && at.v == 45.0, "{at:?}");
        // The six columns of grids are 180 px wide; the notch is at 80 to 100 px, in the third and fourth column.
        assert_eq!(
            (grid.row, grids.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")),
            (1, "r1c3 r1c4".to_owned())
        );
        let reason = off[0].reason();
        assert_eq!(reason.code, "region_off_panel");
        assert!(
            reason.message.contains("extends beyond the panel's edge by ") && reason.message.contains("r1c3, r1c4"),
            "{}",
            reason.message
        );
    }

    /// Expected value, calculated by hand: the same notch at column 219 ends one pixel before corner 2 of the region.
    /// The corner itself is on the panel.
    #[test]
    fn the_corner_near_an_overhang_is_named() {
        let off = found(FlatPanelOptions { notch: Some(219), ..FlatPanelOptions::default() });
        let [OffPanel { gap_kind: GapKind::Edge, corner: Some(2), grid, .. }] = &off[..] else { panic!("{off:?}") };
        assert_eq!(grid.to_string(), "r1c6");
        assert!(
            off[0].reason().message.contains("near corner 2 of the region, in grid r1c6"),
            "{}",
            off[0].reason().message
        );
    }

    /// Expected values, calculated by hand: a hole of 17 × 17 px is 17 mm wide, and its centre is (188, 98), in the
    /// fifth column and second row of grids. The background behind it is 160 mm away. A hole of 9 mm is below the
    /// limit, and a masked hole is not reported.
    #[test]
    fn a_hole_is_measured_and_named() {
        let off = found(FlatPanelOptions { hole_px: 17, ..FlatPanelOptions::default() });
        let [OffPanel { gap_kind: GapKind::Hole, size_mm: Some(mm), pixel: at, grid, corner: None, .. }] = &off[..]
        else {
            panic!("{off:?}")
        };
        assert!((mm - 17.0).abs() < 0.5, "{mm} mm");
        assert!(
            (at.u - 188.0).abs() < 1.0 && (at.v - 98.0).abs() < 1.0 && grid.to_string() == "r2c5",
            "{at:?} {grid}"
        );
        let reason = off[0].reason();
        assert!(
            reason.code == "region_over_hole" && reason.message.contains("17.0 mm in grid r2c5"),
            "{}",
            reason.message
        );
        assert_eq!(found(FlatPanelOptions { hole_px: 9, ..FlatPanelOptions::default() }), []);
        let mask = [[175.0, 85.0], [201.0, 85.0], [201.0, 111.0], [175.0, 111.0]];
        assert_eq!(
            taught(&FlatPanelOptions { hole_px: 17, ..FlatPanelOptions::default() })
                .region_off_panel(12.0, &[mask]),
            []
        );
    }

    /// Inside a drawn outline, missing points are not a hole, but points of the background are a hole.
    #[test]
    fn missing_points_inside_a_drawn_outline_are_no_hole() {
        let drawn = |sees_through: bool| {
            found(FlatPanelOptions {
                hole_px: 17,
                is_drawn: true,
                is_hole_empty: !sees_through,
                ..FlatPanelOptions::default()
            })
        };
        assert_eq!(drawn(false), []);
        assert!(matches!(drawn(true)[..], [OffPanel { gap_kind: GapKind::Hole, .. }]), "{:?}", drawn(true));
    }
}
