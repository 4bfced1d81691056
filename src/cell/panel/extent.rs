//! Finds the pixels of the taught scan that belong to the panel, and the panel's outline.
//!
//! Without an outline in the recipe, the panel is the connected component of the scan in the search box that contains
//! the region's centre. With an outline, the panel consists of all points inside this polygon that are on the panel's
//! surface, even if many points are missing. Places at which a holder or clamp touches the panel are used neither for
//! the surface nor for the outline.

use super::error::{LearnError, WrongCorner};
use super::nominal_pose::nominal_pose;
use super::region::Region;
use super::segment;
use crate::imaging::outer_contours;
use crate::recipe::Recipe;
use nalgebra::Point2;
use panelprep_base::geometry::{Mask, OrganizedCloud, Panel, Pixel, polygon};

/// Minimum number of points of a panel.
const MIN_PANEL_POINTS: usize = 2_000;
/// Minimum size of a connected component inside a drawn outline, relative to the largest one. Smaller ones consist of
/// flying points.
const MIN_RELATIVE_COMPONENT_SIZE: f64 = 0.002;
/// Distance between the points of a drawn outline, px: the same as in a contour of pixels.
const OUTLINE_STEP_PX: f64 = 1.0;

/// The source of the panel's outline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutlineFrom {
    /// The border of the points in the scan.
    Scan,
    /// The recipe, in which a person has drawn the outline.
    Recipe,
}

/// The panel's pixels and outline in the taught picture.
pub(super) struct PanelExtent {
    pub mask: Mask,
    pub outline_px: Vec<Pixel>,
    pub outline_from: OutlineFrom,
    pub held_px: Vec<[Pixel; 4]>,
}

/// The part of a scan in which the panel is searched.
struct SearchArea<'a> {
    scan: &'a OrganizedCloud<Panel>,
    region: &'a Region,
    /// Whether the point of each pixel is in the search box and the panel is not held there.
    is_usable: Vec<bool>,
    corners: [Pixel; 4],
}

impl PanelExtent {
    /// Finds the panel in a scan at its nominal place.
    ///
    /// # Errors
    /// If there is no panel at the region's centre, or a corner of the region is not on the panel.
    pub fn detect(
        scan: &OrganizedCloud<Panel>,
        region: &Region,
        recipe: &Recipe,
    ) -> Result<PanelExtent, LearnError> {
        let pixels = |corners: &[[f64; 2]]| corners.iter().map(|&[u, v]| Pixel::at(u, v)).collect::<Vec<_>>();
        let held_px: Vec<[Pixel; 4]> =
            recipe.outline().held_px().iter().map(|corners| corners.map(|[u, v]| Pixel::at(u, v))).collect();
        let (low, high) = (recipe.locate().box_min_mm(), recipe.locate().box_max_mm());
        let nominal_pose = nominal_pose(recipe);
        let in_box = |index: usize| {
            let point = scan.point_at(index).map(|point| nominal_pose * point);
            point.is_some_and(|p| (0..3).all(|a| (low[a]..=high[a]).contains(&p.mm[a])))
        };
        let is_held = |index: usize| is_held_at(&held_px, pixel_at(index, scan.width()));
        let free = (0..scan.width() * scan.height()).map(|index| in_box(index) && !is_held(index)).collect();
        let corners =
            [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(s, t)| region.pixel(Point2::new(s, t)));
        let looked = SearchArea { scan, region, is_usable: free, corners };
        let drawn = pixels(&recipe.outline().outline_px());
        let (mask, outline_px, outline_from) = if drawn.is_empty() {
            let mask = looked.find_piece()?;
            let outline_px = outer_contours(&mask)?.into_iter().next().unwrap_or_default();
            (mask, outline_px, OutlineFrom::Scan)
        } else {
            (looked.find_in_outline(&drawn)?, polygon_to_contour(&drawn), OutlineFrom::Recipe)
        };
        Ok(PanelExtent { mask, outline_px, outline_from, held_px })
    }
}

/// Returns whether a holder or clamp touches the panel at this pixel of the taught picture.
pub(super) fn is_held_at(held_px: &[[Pixel; 4]], pixel: Pixel) -> bool {
    held_px.iter().any(|held| polygon::contains(held, pixel))
}

/// Returns the pixel with this index.
pub(super) fn pixel_at(index: usize, width: usize) -> Pixel {
    Pixel::at((index % width) as f64, (index / width) as f64)
}

/// Converts a polygon to a contour with one point for each pixel.
fn polygon_to_contour(corners: &[Pixel]) -> Vec<Pixel> {
    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
    let along = |(a, b): (&Pixel, &Pixel)| {
        let (a, b) = (*a, *b);
        let steps = (a.distance_px(b) / OUTLINE_STEP_PX).ceil().max(1.0) as usize;
        (0..steps).map(move |step| {
            let share = step as f64 / steps as f64;
            Pixel::at(a.u + share * (b.u - a.u), a.v + share * (b.v - a.v))
        })
    };
    sides.flat_map(along).collect()
}

impl SearchArea<'_> {
    /// Returns the corners of the region that are outside of the picture, or for which `is_on` is false.
    fn invalid_corners(&self, is_on: &dyn Fn(Pixel) -> bool) -> Vec<WrongCorner> {
        let (width, height) = (self.scan.width(), self.scan.height());
        let wrong = |(index, &at): (usize, &Pixel)| {
            let outside_of = at.nearest_whole(width, height).is_none().then_some([width, height]);
            (outside_of.is_some() || !is_on(at)).then_some(WrongCorner { corner: index + 1, at, outside_of })
        };
        self.corners.iter().enumerate().filter_map(wrong).collect()
    }

    fn centre(&self) -> Pixel {
        self.region.pixel(Point2::new(0.5, 0.5))
    }

    /// Finds the connected component that contains the region's centre; all four corners of the region must be on it.
    fn find_piece(&self) -> Result<Mask, LearnError> {
        let outside = self.invalid_corners(&|_| true);
        let pieces = segment::find_pieces(self.scan, |index| self.is_usable[index]);
        let centre = self.centre();
        let (u, v) = (centre.u, centre.v);
        let is_there =
            |piece: &&Vec<usize>| piece.iter().any(|&i| pixel_at(i, self.scan.width()).distance_px(centre) < 3.0);
        let piece = match pieces.iter().find(is_there) {
            Some(piece) if piece.len() >= MIN_PANEL_POINTS => piece,
            // A corner outside of the picture shifts the region's centre, so it must be corrected first.
            _ if !outside.is_empty() => return Err(LearnError::WrongCorners { corners: outside }),
            Some(piece) => return Err(LearnError::NoPanel { u, v, found: piece.len(), needed: MIN_PANEL_POINTS }),
            None => {
                return Err(LearnError::NothingAtPanelPosition {
                    u,
                    v,
                    largest: pieces.first().map_or(0, Vec::len),
                });
            }
        };
        let mask = segment::component_to_mask(self.scan, piece);
        // Missing points inside the panel are not an edge, so they are filled.
        let filled = outer_contours(&mask)?.into_iter().next().unwrap_or_default();
        let corners =
            self.invalid_corners(&|pixel| is_near_mask_pixel(&mask, pixel) || polygon::contains(&filled, pixel));
        if corners.is_empty() { Ok(mask) } else { Err(LearnError::WrongCorners { corners }) }
    }

    /// Finds the points inside a drawn outline that are on one surface; all four corners of the region must be inside
    /// the outline.
    fn find_in_outline(&self, drawn: &[Pixel]) -> Result<Mask, LearnError> {
        let (width, height) = (self.scan.width(), self.scan.height());
        if let Some(&Pixel { u, v }) = drawn.iter().find(|pixel| pixel.nearest_whole(width, height).is_none()) {
            return Err(LearnError::OutlineOutside { u, v, width, height });
        }
        let corners = self.invalid_corners(&|pixel| polygon::contains(drawn, pixel));
        if !corners.is_empty() {
            return Err(LearnError::WrongCorners { corners });
        }
        let pieces = segment::find_pieces(self.scan, |index| {
            self.is_usable[index] && polygon::contains(drawn, pixel_at(index, width))
        });
        let Some(largest) = pieces.first().filter(|piece| piece.len() >= MIN_PANEL_POINTS) else {
            let Pixel { u, v } = self.centre();
            let found = pieces.first().map_or(0, Vec::len);
            return Err(LearnError::NoPanel { u, v, found, needed: MIN_PANEL_POINTS });
        };
        let least = (MIN_RELATIVE_COMPONENT_SIZE * largest.len() as f64) as usize;
        let parts = pieces.iter().filter(|piece| piece.len() >= least);
        let on_one_surface = super::segment::pixels_on_main_sheet(self.scan, largest, parts);
        Ok(segment::component_to_mask(self.scan, &on_one_surface))
    }
}

/// Returns whether a pixel or one of its eight neighbours is in the mask, so that a corner at a single missing point is
/// accepted.
fn is_near_mask_pixel(mask: &Mask, pixel: Pixel) -> bool {
    let Some((column, row)) = pixel.nearest_whole(mask.width, mask.height) else { return false };
    let columns = column.saturating_sub(1)..=(column + 1).min(mask.width - 1);
    (row.saturating_sub(1)..=(row + 1).min(mask.height - 1)).any(|v| columns.clone().any(|u| mask.contains(u, v)))
}
