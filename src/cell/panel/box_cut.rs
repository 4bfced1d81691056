//! Finds the face at which the search box cuts the panel: the panel's surface continues beyond this face.
//!
//! The part outside the box is neither taught nor searched. At that face the panel's border is the border of the box
//! and not an edge of the panel.

use super::extent::{self, is_held_at};
use super::segment::max_step_mm;
use super::taught::TaughtPanel;
use crate::recipe;
use panelprep_base::geometry::{DIRECT_NEIGHBOURS, Pixel, RasterSize};
use panelprep_base::verdict::Reason;

/// Smallest number of border pixels of the panel with a continuation beyond one face; fewer pixels are a holder or
/// flying points.
const MIN_BORDER_PX: usize = 12;

/// A face of the search box that cuts the panel.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxCut {
    /// The recipe's key of the face.
    pub key: &'static str,
    /// X, Y or Z: 0, 1 or 2.
    pub axis: usize,
    /// The position of the face, mm.
    pub face_mm: f64,
    /// Number of pixels of the panel's border that continue beyond this face.
    pub border_px: usize,
    /// One place of the cut.
    pub at: Pixel,
}

impl BoxCut {
    /// Returns the reason for a person who teaches.
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
    /// Returns the face of the search box that cuts most of the panel's border; `None` if none does. A holder of
    /// the panel may extend beyond the box.
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

/// Returns the face beyond which a point lies: 0 to 2 for the lower faces, 3 to 5 for the upper faces. `None` if
/// the point lies in the box.
fn exceeded_face(locate: &recipe::Locate, point_mm: &[f64]) -> Option<usize> {
    let (low, high) = (locate.box_min_mm(), locate.box_max_mm());
    (0..3)
        .find(|&axis| point_mm[axis] < low[axis])
        .or_else(|| (0..3).find(|&axis| point_mm[axis] > high[axis]).map(|axis| axis + 3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::Recipe;
    use panelprep_sim::{Cell, SEARCH_BOX_MM, Scene};

    /// Returns the face that cuts the panel of a cell, and the height of the taught panel. The search box ends at
    /// this height, mm. A holder may cover everything above the region.
    fn cut(cell: &Cell, top_mm: f64, has_holder: bool) -> (Option<BoxCut>, f64) {
        let (region, [low, [x, y, _]]) = (cell.region(), SEARCH_BOX_MM);
        // The line through the region's upper corners, extended by half its length on each side, and 2 px above the
        // corners.
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

    /// The simulated cell's box contains its panel; the region ends 15 mm below the panel's upper edge. A box that
    /// ends 7 mm below the edge cuts the panel.
    #[test]
    fn a_box_that_cuts_the_panel_is_named() {
        let cell = Cell::new(4, Scene::Good, 4);
        let (whole, highest_mm) = cut(&cell, SEARCH_BOX_MM[1][2], false);
        assert_eq!(whole, None);
        let top_mm = (highest_mm - 7.0).round();
        let found = cut(&cell, top_mm, false).0.expect("a cut");
        assert_eq!((found.key, found.axis, found.face_mm), ("box_max_mm", 2, top_mm));
        assert!(found.reason().message.contains("locate.box_max_mm[2]"), "{found:?}");
        // The same place is now stated as held, so the part that continues beyond the box is the holder.
        assert_eq!(cut(&cell, top_mm, true).0, None);
    }
}
