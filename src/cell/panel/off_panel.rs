//! Finds where the region is not on the panel: it extends over the panel's edge, or over a hole.
//!
//! Outside of the panel there is no surface to test or to sand, and the surfaces that the camera sees there lie far
//! behind. Such a part is measured on the taught scan, in mm on the extrapolated surface of the panel, and named by
//! its grid. A few missing points inside the panel are not a hole.

use super::extent::OutlineFrom;
use super::region::GridId;
use super::taught::TaughtPanel;
use nalgebra::Point2;
use panelprep_base::geometry::{Mask, Panel, Pixel, Point, RasterSize, polygon};
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::Reason;

/// The outline is known to a few pixels: a region that extends beyond it by at most this distance follows the edge,
/// px.
const EDGE_TOLERANCE_PX: f64 = 2.0;
/// A corner of the region within this distance is named together with the grid, px.
const MAX_CORNER_DISTANCE_PX: f64 = 12.0;
/// Largest number of places off the panel that are measured; they are selected evenly.
const MAX_MEASURED_PLACES: usize = 20_000;
/// Only every second point of the outline is used to measure the distance to it.
const OUTLINE_STEP: usize = 2;
/// Half the width of the neighbourhood from which the surface is extrapolated, px: doubled if points are missing.
const EXTRAPOLATION_HALF_WIDTHS_PX: [usize; 4] = [5, 10, 20, 40];

/// The kind of gap over which the region extends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GapKind {
    /// The panel's edge.
    Edge,
    /// A hole.
    Hole,
}

/// A part of the region that does not lie on the panel.
#[derive(Debug, Clone, PartialEq)]
pub struct OffPanel {
    /// The kind of gap over which this part extends.
    pub gap_kind: GapKind,
    /// The overhang, or the size of the hole, which is the side of its largest inscribed square, mm. `None` if no
    /// surface is near enough for the measurement.
    pub size_mm: Option<f64>,
    /// The place that extends farthest, or the middle of the hole, in the taught picture.
    pub pixel: Pixel,
    /// The grid there.
    pub grid: GridId,
    /// The region's corner near this place, from 1, if there is one.
    pub corner: Option<usize>,
    /// All grids that contain places of this part.
    pub grids: Vec<GridId>,
}

impl OffPanel {
    /// Returns the reason for a person who teaches or checks.
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
    /// Finds the parts of the region that are not on the panel: the place that extends farthest over the edge, and
    /// each hole that contains a square of more than `hole_mm`. The areas in `masked_px`, quadrilaterals of the
    /// taught picture, are left out.
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
                // Inside a person's outline, points may be missing; a place at which the background is seen is a
                // hole.
                missing.inside[index] = true;
            }
        }
        let holes = self.holes(&missing).into_iter().filter(|hole| hole.size_mm.is_none_or(|mm| mm > hole_mm));
        self.region_beyond_edge(&off_edge).into_iter().chain(holes).collect()
    }

    fn region_beyond_edge(&self, off_edge: &[Pixel]) -> Option<OffPanel> {
        let outline: Vec<Pixel> = self.outline_px.iter().step_by(OUTLINE_STEP).copied().collect();
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

    /// Finds the holes among these pixels; each hole is measured by the largest square in it.
    fn holes(&self, missing: &Mask) -> Vec<OffPanel> {
        let raster = RasterSize { width: missing.width, height: missing.height };
        let squares = raster.largest_squares(|index| missing.inside[index]);
        let hole = |piece: Vec<usize>| {
            let last = piece.iter().copied().max_by_key(|index| squares[*index])?;
            // This pixel is the lower right corner of the square.
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
        missing.connected_pieces().into_iter().filter_map(hole).collect()
    }

    /// Finds the nearest pixel of the panel to the left of a place, or to the right if there is none on the left.
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

    /// Returns the distance of two pixels on the panel's surface, extrapolated from its neighbourhood at a third
    /// pixel, mm.
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

#[cfg(test)]
mod tests;
