//! The taught panel: what is known of a panel at its nominal place, derived from one scan and the recipe.
//!
//! The panel's frame is the robot's base at teaching (thesis 3.8). The scan stays as it was taken; crop, outline,
//! region, grids and corners are derived from it each time it is loaded, so that a better derivation needs no new
//! scan. Decides nothing about where the panel is now.

mod corner;
mod region;
pub mod segment;

pub use corner::{CornerTeaching, TaughtCorner};
pub use region::{GridId, GridIdError, Region};

use crate::geometry::{
    Base, Camera, Mask, OrganizedCloud, Panel, PinholeCamera, Pixel, Plane, Point, Rigid, local_plane_of,
};
use crate::imaging::{ImagingError, outer_contours};
use crate::recipe::Recipe;
use nalgebra::{Isometry3, Point2};

/// Half the width of the neighbourhood from which a point on the surface is taken, px.
const SURFACE_HALF_WIDTH_PX: usize = 5;

/// Why a scan does not teach a panel.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LearnError {
    /// Corners of the region that are not on the panel: all of them.
    #[error("{}; choose all four corners of the region inside the panel's outline", list(corners))]
    WrongCorners {
        /// The wrong ones.
        corners: Vec<WrongCorner>,
    },
    /// Nothing of the scan under the region's centre lies in the search box.
    #[error(
        "no panel under the region's centre, ({u:.0}, {v:.0}) px: no point of the scan there lies in the search box, {}; are \
         the region's corners on the panel, is the box right?", elsewhere(*largest)
    )]
    NothingThere {
        /// The region's centre, column, px.
        u: f64,
        /// The region's centre, row, px.
        v: f64,
        /// Points of the largest piece of scan elsewhere in the box.
        largest: usize,
    },
    /// What lies under the region and in the search box is too small for a panel.
    #[error(
        "no panel under the region's centre, ({u:.0}, {v:.0}) px: the piece of scan there that lies in the search box \
         has {found} points, needed are {needed}; is the box right, is the panel in place?"
    )]
    NoPanel {
        /// The region's centre, column, px.
        u: f64,
        /// The region's centre, row, px.
        v: f64,
        /// Points found.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// A grid has a hole where its edge should be.
    #[error("grid {grid} has no scan points at its edge, ({u:.0}, {v:.0}) px; scan again or move the region")]
    GridWithoutPoints {
        /// The grid.
        grid: GridId,
        /// Column, px.
        u: f64,
        /// Row, px.
        v: f64,
    },
    /// The region's corners enclose nothing.
    #[error("the region's four corners enclose no area")]
    EmptyRegion,
    /// No panel lies where a corner picture looks.
    #[error(
        "the corner at ({u:.1}, {v:.1}) px of the flange picture is not near the panel; is the flange pose right?"
    )]
    CornerOffPanel {
        /// Column, px.
        u: f64,
        /// Row, px.
        v: f64,
    },
    /// OpenCV refused the mask.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}

/// A corner of the region that is not on the panel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrongCorner {
    /// Which one, from 1.
    pub corner: usize,
    /// Where the recipe has it.
    pub at: Pixel,
    /// The size of the picture, px, where it lies outside of that.
    pub outside_of: Option<[usize; 2]>,
}

impl std::fmt::Display for WrongCorner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let WrongCorner { corner, at: Pixel { u, v }, outside_of } = self;
        write!(f, "corner {corner} of the region, ({u:.0}, {v:.0}) px, ")?;
        match outside_of {
            Some([width, height]) => write!(f, "lies outside of the picture, {width}×{height} px"),
            None => f.write_str("is not on the panel"),
        }
    }
}

fn list(corners: &[WrongCorner]) -> String {
    corners.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// One grid of the region on the panel's surface.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Its name.
    pub id: GridId,
    /// Its edge, closed, as points on the surface: curves on a curved panel.
    pub edge: Vec<Point<Panel>>,
    /// Its four corners, from the one nearest the region's first corner, in the region's order.
    pub corners: [Point<Panel>; 4],
}

/// What is known of a panel at its nominal place.
#[derive(Debug, Clone)]
pub struct TaughtPanel {
    /// The scan in the panel's frame, on the taught picture's pixel grid.
    pub scan: OrganizedCloud<Panel>,
    /// The 3D camera that took it.
    pub camera: PinholeCamera,
    /// Where that camera stood.
    pub panel_from_camera: Rigid<Panel, Camera>,
    /// The panel's pixels in the scan.
    pub mask: Mask,
    /// The panel's outline in the taught picture, px, closed.
    pub outline_px: Vec<Pixel>,
    /// The outline's points on the surface.
    pub outline: Vec<Point<Panel>>,
    /// The region in the taught picture.
    pub region: Region,
    /// Its grids, row by row.
    pub grids: Vec<Grid>,
}

/// At teaching the panel's frame is the base (thesis 3.8): the one claim that says so.
pub fn panel_from_base_at_teaching() -> Rigid<Panel, Base> {
    Rigid::claim(Isometry3::identity())
}

/// Fewer points are no panel.
const MIN_PANEL_POINTS: usize = 2_000;
/// Points on each side of a grid's edge.
const EDGE_STEPS: usize = 8;

impl TaughtPanel {
    /// Derives the panel from its scan at the nominal place.
    ///
    /// # Errors
    /// Where no panel lies under the recipe's region, or the region leaves it.
    pub fn learn(
        scan: &OrganizedCloud<Camera>,
        camera: PinholeCamera,
        base_from_camera: Rigid<Base, Camera>,
        recipe: &Recipe,
    ) -> Result<Self, LearnError> {
        let panel_from_camera = panel_from_base_at_teaching() * base_from_camera;
        let scan = scan.moved(&panel_from_camera);
        let region = Region::new(recipe.region()).ok_or(LearnError::EmptyRegion)?;
        let mask = panel_mask(&scan, &region, recipe)?;
        let outline_px = outer_contours(&mask)?.into_iter().next().unwrap_or_default();
        let outline =
            outline_px.iter().filter_map(|pixel| scan.point(pixel.u as usize, pixel.v as usize)).collect();
        let mut panel =
            TaughtPanel { scan, camera, panel_from_camera, mask, outline_px, outline, region, grids: Vec::new() };
        panel.grids = panel.region.ids().map(|id| panel.grid(id)).collect::<Result<_, _>>()?;
        Ok(panel)
    }

    fn grid(&self, id: GridId) -> Result<Grid, LearnError> {
        let at = |unit: Point2<f64>| {
            let pixel = self.region.pixel(unit);
            let missing = LearnError::GridWithoutPoints { grid: id, u: pixel.u, v: pixel.v };
            self.surface_at(pixel).ok_or(missing)
        };
        let edge = self.region.edge(id, EDGE_STEPS).into_iter().map(at).collect::<Result<Vec<_>, _>>()?;
        let corners = [edge[0], edge[EDGE_STEPS], edge[2 * EDGE_STEPS], edge[3 * EDGE_STEPS]];
        Ok(Grid { id, edge, corners })
    }

    /// The point of the surface that a pixel of the taught picture sees, from the plane through its neighbourhood;
    /// `None` off the panel.
    pub fn surface_at(&self, pixel: Pixel) -> Option<Point<Panel>> {
        let at = pixel.whole(self.scan.width(), self.scan.height())?;
        let viewer = self.panel_from_camera.origin();
        let plane = self.plane_at(at, SURFACE_HALF_WIDTH_PX)?;
        plane.meet(viewer, self.panel_from_camera * self.camera.unproject(pixel)?)
    }

    /// The plane through the panel's points around a pixel, seen from the camera; what is not panel has no part in it.
    fn plane_at(&self, at: (usize, usize), half_width_px: usize) -> Option<Plane<Panel>> {
        local_plane_of(&self.scan, at, half_width_px, self.panel_from_camera.origin(), |i| self.mask.inside[i])
    }

    /// The panel's points with their pixel index, row by row.
    pub fn points(&self) -> impl Iterator<Item = (usize, Point<Panel>)> + '_ {
        self.scan.valid().filter(|(index, _)| self.mask.inside[*index])
    }

    /// The middle of the panel's points: where shift and turn are judged.
    pub fn centre(&self) -> Point<Panel> {
        let mut sum = nalgebra::Vector3::zeros();
        let mut count = 0usize;
        for (_, point) in self.points() {
            sum += point.mm.coords;
            count += 1;
        }
        Point::new((sum / count.max(1) as f64).into())
    }
}

/// What the search box holds away from where the panel was looked for.
fn elsewhere(largest: usize) -> String {
    match largest {
        0 => "nor does any other".to_owned(),
        points => format!("though elsewhere a piece of {points} points does"),
    }
}

/// The piece of scan in the search box under the region's centre; all four corners must lie on it.
fn panel_mask(scan: &OrganizedCloud<Panel>, region: &Region, recipe: &Recipe) -> Result<Mask, LearnError> {
    let (width, height) = (scan.width(), scan.height());
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(s, t)| region.pixel(Point2::new(s, t)));
    let wrong = |which: &dyn Fn(&Pixel) -> bool, outside_of: Option<[usize; 2]>| -> Vec<WrongCorner> {
        let numbered = corners.iter().enumerate().filter(|(_, pixel)| which(pixel));
        numbered.map(|(index, &at)| WrongCorner { corner: index + 1, at, outside_of }).collect()
    };
    let is_outside = |pixel: &Pixel| pixel.whole(width, height).is_none();
    let mut wrong_corners = wrong(&is_outside, Some([width, height]));
    let (low, high) = (recipe.locate().box_min_mm(), recipe.locate().box_max_mm());
    let in_box =
        |index: usize| scan.point_at(index).is_some_and(|p| (0..3).all(|a| (low[a]..=high[a]).contains(&p.mm[a])));
    let pieces = segment::pieces(scan, in_box);
    let centre = region.pixel(Point2::new(0.5, 0.5));
    let (u, v) = (centre.u, centre.v);
    let is_there = |piece: &&Vec<usize>| {
        piece.iter().any(|&i| Pixel::at((i % width) as f64, (i / width) as f64).distance_px(centre) < 3.0)
    };
    let piece = match pieces.iter().find(is_there) {
        Some(piece) if piece.len() >= MIN_PANEL_POINTS => piece,
        // Corners outside of the picture move the centre: they are what has to be mended first.
        _ if !wrong_corners.is_empty() => return Err(LearnError::WrongCorners { corners: wrong_corners }),
        Some(piece) => return Err(LearnError::NoPanel { u, v, found: piece.len(), needed: MIN_PANEL_POINTS }),
        None => return Err(LearnError::NothingThere { u, v, largest: pieces.first().map_or(0, Vec::len) }),
    };
    let mask = segment::mask_of(scan, piece);
    wrong_corners.extend(wrong(&|pixel| !is_outside(pixel) && !near_mask(&mask, *pixel), None));
    if !wrong_corners.is_empty() {
        wrong_corners.sort_by_key(|wrong| wrong.corner);
        return Err(LearnError::WrongCorners { corners: wrong_corners });
    }
    Ok(mask)
}

/// Is a pixel, or one beside it, in the mask? A single missing point must not push a corner off the panel.
fn near_mask(mask: &Mask, pixel: Pixel) -> bool {
    let Some((column, row)) = pixel.whole(mask.width, mask.height) else { return false };
    let columns = column.saturating_sub(1)..=(column + 1).min(mask.width - 1);
    (row.saturating_sub(1)..=(row + 1).min(mask.height - 1)).any(|v| columns.clone().any(|u| mask.contains(u, v)))
}
