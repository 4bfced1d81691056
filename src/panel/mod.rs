//! The taught panel: what is known of a panel at its nominal place, derived from one scan and the recipe.
//!
//! The panel's frame is the robot's base at teaching (thesis 3.8). The scan stays as it was taken; crop, outline,
//! region, grids and corners are derived from it each time it is loaded, so that a better derivation needs no new
//! scan. Decides nothing about where the panel is now.

mod corner;
mod extent;
mod region;
pub mod segment;
mod sheet;

pub use corner::{CornerTeaching, TaughtCorner};
pub use extent::OutlineFrom;
pub use region::{GridId, GridIdError, Region};

use crate::geometry::{
    Base, Camera, Mask, OrganizedCloud, Panel, PinholeCamera, Pixel, Plane, Point, Rigid, local_plane_of, polygon,
};
use crate::imaging::ImagingError;
use crate::recipe::Recipe;
use extent::Extent;
use nalgebra::{Isometry3, Point2};

/// Half the width of the neighbourhood from which a point on the surface is taken, px.
const SURFACE_HALF_WIDTH_PX: usize = 5;
/// Where points are missing, the neighbourhood is doubled up to this, px: some 15 mm, over which a panel is nearly flat.
const WIDEST_HALF_WIDTH_PX: usize = 40;

/// Why a scan does not teach a panel.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LearnError {
    /// Corners of the region that are not on the panel: all of them.
    #[error(
        "{}; choose all four corners of the region inside the panel's outline; where points of the panel are missing, give \
             the outline yourself, `outline_px` in [panel]",
        list(corners)
    )]
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
    /// A corner of the recipe's outline is not in the picture.
    #[error(
        "outline_px in [panel]: the corner ({u:.0}, {v:.0}) px lies outside of the picture, {width}×{height} px; was it drawn \
         on another picture?"
    )]
    OutlineOutside {
        /// Column, px.
        u: f64,
        /// Row, px.
        v: f64,
        /// The picture's width, px.
        width: usize,
        /// Its height, px.
        height: usize,
    },
    /// A grid has a hole where its edge should be, and no surface around it.
    #[error(
        "grid {grid} has no scan points within {WIDEST_HALF_WIDTH_PX} px around its edge at ({u:.0}, {v:.0}) px; scan again, at a \
         steeper angle or with a longer exposure, or move the region"
    )]
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
        "the corner at ({u:.1}, {v:.1}) px of the flange picture is not near the panel's outline; is the flange pose right, \
         and where the recipe has outline_px, does that follow the panel's edge?"
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
    /// Who says where that runs.
    pub outline_from: OutlineFrom,
    /// Places in the taught picture where something holds the panel.
    pub held_px: Vec<[Pixel; 4]>,
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
        let Extent { mask, outline_px, outline_from, held_px } = Extent::of(&scan, &region, recipe)?;
        let mut panel = TaughtPanel {
            scan,
            camera,
            panel_from_camera,
            mask,
            outline_px,
            outline_from,
            held_px,
            outline: Vec::new(),
            region,
            grids: Vec::new(),
        };
        panel.outline = panel.outline_px.iter().filter_map(|pixel| panel.outline_at(*pixel)).collect();
        panel.grids = panel.region.ids().map(|id| panel.grid(id)).collect::<Result<_, _>>()?;
        Ok(panel)
    }

    fn grid(&self, id: GridId) -> Result<Grid, LearnError> {
        let at = |unit: Point2<f64>| {
            let pixel = self.region.pixel(unit);
            let missing = LearnError::GridWithoutPoints { grid: id, u: pixel.u, v: pixel.v };
            self.surface_around(pixel).ok_or(missing)
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

    /// The same where points are missing around the pixel, from a neighbourhood as wide as is needed.
    fn surface_around(&self, pixel: Pixel) -> Option<Point<Panel>> {
        let at = pixel.whole(self.scan.width(), self.scan.height())?;
        let ray = self.panel_from_camera * self.camera.unproject(pixel)?;
        let widths = std::iter::successors(Some(SURFACE_HALF_WIDTH_PX), |half_width_px| Some(2 * half_width_px));
        let planes = widths.take_while(|&half_width_px| half_width_px <= WIDEST_HALF_WIDTH_PX);
        let plane = planes.filter_map(|half_width_px| self.plane_at(at, half_width_px)).next()?;
        plane.meet(self.panel_from_camera.origin(), ray)
    }

    /// A point of the outline on the surface.
    fn outline_at(&self, pixel: Pixel) -> Option<Point<Panel>> {
        match self.outline_from {
            OutlineFrom::Scan => self.scan.point(pixel.u as usize, pixel.v as usize),
            OutlineFrom::Recipe => self.surface_around(pixel),
        }
    }

    /// The share of the panel inside of a drawn outline that gave points, 0…1; 1 where the points themselves are the outline.
    pub fn given(&self) -> f64 {
        if self.outline_from == OutlineFrom::Scan {
            return 1.0;
        }
        let held_px2: f64 = self.held_px.iter().map(|held| polygon::signed_area_px2(held).abs()).sum();
        let whole_px2 = polygon::signed_area_px2(&self.outline_px).abs();
        // A held place may reach beyond the outline: at most half of it is taken for panel.
        (self.mask.count() as f64 / (whole_px2 - held_px2 / 2.0).max(1.0)).min(1.0)
    }

    /// Does something hold the panel within so many pixels of this place of the taught picture?
    pub fn is_held_near(&self, pixel: Pixel, within_px: f64) -> bool {
        let near = |held: &[Pixel; 4]| polygon::distance_to_side_px(held, pixel) <= within_px;
        extent::is_held(&self.held_px, pixel) || self.held_px.iter().any(near)
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
