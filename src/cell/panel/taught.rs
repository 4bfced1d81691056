//! The taught panel, derived from one scan at the nominal pose and from the recipe; and a taught corner: the pose of
//! the flange camera, the pixel at which it saw the corner, and the corner's position on the panel.
//!
//! Nominal camera pose and reference pixel are taught together (thesis 3.9). The corner's position on the panel is the
//! intersection of the reference pixel's ray with the plane of the surface beside it. From this position the expected
//! pixel follows for every camera pose, not only for the nominal one.

use super::error::LearnError;
use super::extent;
use super::extent::{OutlineFrom, PanelExtent};
use super::nominal_pose::nominal_pose;
use super::region::{GridId, Region};
use super::segment::QuadraticSheet;
use crate::recipe::Recipe;
use nalgebra::Point2;
use panelprep_base::geometry::{
    Base, Camera, FlangeCamera, Mask, OrganizedCloud, Panel, PinholeCamera, Pixel, Plane, Point, Rigid, Vector,
    local_plane_where, polygon,
};

/// Half the width of the neighbourhood that determines a point on the surface, px.
const SURFACE_HALF_WIDTH_PX: usize = 5;

/// Half the widths of the neighbourhood over a hole, px, tried in this order.
const HOLE_HALF_WIDTHS_PX: [usize; 3] = [80, 160, 320];
/// If points are missing, the neighbourhood for fitting a plane is doubled up to this size, px: some 15 mm, over which
/// a panel is nearly flat.
const MAX_HALF_WIDTH_PX: usize = 40;
/// Largest residual of the points about the second-order surface over a hole, rms, mm; with more, the panel has
/// another shape.
const MAX_SURFACE_RESIDUAL_MM: f64 = 0.5;

/// The source of a panel's taught data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TaughtSource {
    /// A scan of a panel at its nominal place.
    Scan,
    /// The panel's drawing, whose frame is the panel's frame.
    Drawing,
}

impl TaughtSource {
    /// Returns the source of the recipe's panel: its drawing if the recipe has `[nominal]`.
    pub fn from_recipe(recipe: &Recipe) -> Self {
        recipe.nominal().map_or(TaughtSource::Scan, |_| TaughtSource::Drawing)
    }

    /// Returns what today's panel is compared with, as part of a sentence.
    pub fn describe(self) -> &'static str {
        match self {
            TaughtSource::Scan => "the taught surface",
            TaughtSource::Drawing => "the drawing",
        }
    }
}

/// One grid of the region on the panel's surface.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Its name.
    pub id: GridId,
    /// The grid's edge, closed, as points on the surface: curves on a curved panel.
    pub edge: Vec<Point<Panel>>,
    /// The grid's four corners in the region's order, beginning with the corner nearest the region's first corner.
    pub corners: [Point<Panel>; 4],
}

/// The known data of a panel at its nominal pose.
#[derive(Debug, Clone)]
pub struct TaughtPanel {
    /// The scan in the panel's frame, on the taught picture's pixel grid.
    pub scan: OrganizedCloud<Panel>,
    /// Whether the scan was taken, or computed from the drawing.
    pub reference: TaughtSource,
    /// The panel's frame at teaching.
    pub nominal_pose: Rigid<Base, Panel>,
    /// The 3D camera that took the scan.
    pub camera: PinholeCamera,
    /// The pose of that camera.
    pub panel_from_camera: Rigid<Panel, Camera>,
    /// The panel's pixels in the scan.
    pub mask: Mask,
    /// The panel's outline in the taught picture, px, closed.
    pub outline_px: Vec<Pixel>,
    /// The source of that outline.
    pub outline_from: OutlineFrom,
    /// Held places of the panel in the taught picture.
    pub held_px: Vec<[Pixel; 4]>,
    /// The outline's points on the surface.
    pub outline: Vec<Point<Panel>>,
    /// The region in the taught picture.
    pub region: Region,
    /// The region's grids, row by row.
    pub grids: Vec<Grid>,
}

/// Number of points on each side of a grid's edge.
const EDGE_STEPS: usize = 8;

impl TaughtPanel {
    /// Derives the panel from its scan at the nominal place.
    ///
    /// # Errors
    /// If no panel lies under the recipe's region, or the region extends beyond it.
    pub fn learn(
        scan: &OrganizedCloud<Camera>,
        camera: PinholeCamera,
        base_from_camera: Rigid<Base, Camera>,
        recipe: &Recipe,
    ) -> Result<Self, LearnError> {
        let nominal_pose = nominal_pose(recipe);
        let panel_from_camera = nominal_pose.inverse() * base_from_camera;
        let scan = scan.transformed(&panel_from_camera);
        let reference = TaughtSource::from_recipe(recipe);
        let region = Region::new(recipe.region()).ok_or(LearnError::EmptyRegion)?;
        let PanelExtent { mask, outline_px, outline_from, held_px } = PanelExtent::detect(&scan, &region, recipe)?;
        let mut panel = TaughtPanel {
            scan,
            reference,
            nominal_pose,
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
        panel.outline = panel.outline_px.iter().filter_map(|pixel| panel.outline_point_at(*pixel)).collect();
        panel.grids = panel.region.ids().map(|id| panel.grid(id)).collect::<Result<_, _>>()?;
        Ok(panel)
    }

    fn grid(&self, id: GridId) -> Result<Grid, LearnError> {
        let at = |unit: Point2<f64>| {
            let pixel = self.region.pixel(unit);
            let missing = LearnError::GridWithoutPoints { grid: id, u: pixel.u, v: pixel.v };
            self.surface_point_around(pixel).or_else(|| self.surface_point_over_hole(pixel)).ok_or(missing)
        };
        let edge = self.region.edge(id, EDGE_STEPS).into_iter().map(at).collect::<Result<Vec<_>, _>>()?;
        let corners = [edge[0], edge[EDGE_STEPS], edge[2 * EDGE_STEPS], edge[3 * EDGE_STEPS]];
        Ok(Grid { id, edge, corners })
    }

    /// Returns the surface point at a pixel of the taught picture, from the plane through its neighbourhood; `None` off
    /// the panel.
    pub fn surface_point_at(&self, pixel: Pixel) -> Option<Point<Panel>> {
        let at = pixel.nearest_whole(self.scan.width(), self.scan.height())?;
        let viewer = self.panel_from_camera.origin();
        let plane = self.fit_plane_at(at, SURFACE_HALF_WIDTH_PX)?;
        plane.intersect_ray(viewer, self.panel_from_camera * self.camera.unproject(pixel)?)
    }

    /// Returns the surface point at a pixel around which points are missing, from a neighbourhood that is as wide as
    /// necessary.
    fn surface_point_around(&self, pixel: Pixel) -> Option<Point<Panel>> {
        let at = pixel.nearest_whole(self.scan.width(), self.scan.height())?;
        let ray = self.panel_from_camera * self.camera.unproject(pixel)?;
        let widths = std::iter::successors(Some(SURFACE_HALF_WIDTH_PX), |half_width_px| Some(2 * half_width_px));
        let mut widths = widths.take_while(|&half_width_px| half_width_px <= MAX_HALF_WIDTH_PX);
        let plane = widths.find_map(|half_width_px| self.fit_plane_at(at, half_width_px))?;
        plane.intersect_ray(self.panel_from_camera.origin(), ray)
    }

    /// Lists the panel's pixels with points within this half width of a pixel.
    fn panel_pixels_around(
        &self,
        (column, row): (usize, usize),
        half_width_px: usize,
    ) -> impl Iterator<Item = usize> + use<'_> {
        let within =
            move |at: usize, size: usize| at.saturating_sub(half_width_px)..(at + half_width_px + 1).min(size);
        let columns = within(column, self.scan.width());
        within(row, self.scan.height())
            .flat_map(move |row| columns.clone().map(move |column| row * self.scan.width() + column))
            .filter(|&index| self.mask.inside[index] && self.scan.point_at(index).is_some())
    }

    /// Returns the surface point over an even wider hole: on the second-order surface through the points around the
    /// hole, no farther from these points than their own rim.
    fn surface_point_over_hole(&self, pixel: Pixel) -> Option<Point<Panel>> {
        let at = pixel.nearest_whole(self.scan.width(), self.scan.height())?;
        let ray = self.panel_from_camera * self.camera.unproject(pixel)?;
        HOLE_HALF_WIDTHS_PX.into_iter().find_map(|half_width_px| {
            let around: Vec<usize> = self.panel_pixels_around(at, half_width_px).collect();
            let sheet =
                QuadraticSheet::fit(&self.scan, &around).filter(|sheet| sheet.rms_mm <= MAX_SURFACE_RESIDUAL_MM)?;
            sheet.intersect_ray(self.panel_from_camera.origin(), ray)
        })
    }

    /// Returns a point of the outline on the surface.
    fn outline_point_at(&self, pixel: Pixel) -> Option<Point<Panel>> {
        match self.outline_from {
            OutlineFrom::Scan => self.scan.point(pixel.u as usize, pixel.v as usize),
            OutlineFrom::Recipe => self.surface_point_around(pixel),
        }
    }

    /// Returns the fraction of the panel inside a drawn outline that has points, 0…1; 1 if no outline was drawn.
    pub fn measured_share(&self) -> f64 {
        if self.outline_from == OutlineFrom::Scan {
            return 1.0;
        }
        let held_px2: f64 = self.held_px.iter().map(|held| polygon::signed_area_px2(held).abs()).sum();
        let whole_px2 = polygon::signed_area_px2(&self.outline_px).abs();
        // A held place may extend beyond the outline: at most half of its area counts as panel.
        (self.mask.count() as f64 / (whole_px2 - held_px2 / 2.0).max(1.0)).min(1.0)
    }

    /// Returns whether the panel is held within this distance of a pixel of the taught picture.
    pub fn is_held_near(&self, pixel: Pixel, within_px: f64) -> bool {
        let near = |held: &[Pixel; 4]| polygon::distance_to_side_px(held, pixel) <= within_px;
        extent::is_held_at(&self.held_px, pixel) || self.held_px.iter().any(near)
    }

    /// Fits the plane through the panel's points around a pixel, oriented towards the camera; points off the panel
    /// are not used.
    pub(super) fn fit_plane_at(&self, at: (usize, usize), half_width_px: usize) -> Option<Plane<Panel>> {
        local_plane_where(&self.scan, at, half_width_px, self.panel_from_camera.origin(), |i| self.mask.inside[i])
    }

    /// Returns the panel's points with their pixel index, row by row.
    pub fn points(&self) -> impl Iterator<Item = (usize, Point<Panel>)> + '_ {
        self.scan.valid_points().filter(|(index, _)| self.mask.inside[*index])
    }

    /// Returns the centroid of the panel's points, at which shift and rotation are judged.
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

/// Half the width of the neighbourhood that determines the surface beside a corner, px.
const NEIGHBOURHOOD_HALF_WIDTH_PX: usize = 12;
/// Largest distance between the ray and the outline, mm; the apex of a rounded corner lies a few mm outside the
/// outline.
const MAX_DISTANCE_MM: f64 = 15.0;

/// The data that a corner picture teaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerTeaching {
    /// The corner's pixel in the taught picture.
    pub reference_px: Pixel,
    /// The camera's pose, `wT_nominalCP` of the thesis.
    pub panel_from_camera: Rigid<Panel, FlangeCamera>,
}

/// A corner with its position on the panel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaughtCorner {
    /// The corner's pixel and the camera's pose in the taught picture.
    pub teaching_data: CornerTeaching,
    /// The corner: the intersection of its two edges, on the surface.
    pub point: Point<Panel>,
    /// The surface's normal beside the corner, a direction.
    pub normal: Vector<Panel>,
}

impl TaughtCorner {
    /// Returns the fraction, 0…1, of a motion along the panel's normal that the taught view shows as a sideways
    /// motion: the sine of the angle between the normal and the view.
    pub fn visible_normal_share(&self) -> f64 {
        let towards = (self.point - self.teaching_data.panel_from_camera.origin()).mm.normalize();
        towards.cross(&self.normal.mm).norm()
    }
}

impl TaughtPanel {
    /// Finds the position of a taught corner on the panel.
    ///
    /// # Errors
    /// If the distance between the reference pixel's ray and the panel's outline is larger than the rounding of a
    /// corner explains.
    pub fn corner(&self, teaching: CornerTeaching, camera: &PinholeCamera) -> Result<TaughtCorner, LearnError> {
        let Pixel { u, v } = teaching.reference_px;
        let off = LearnError::CornerOffPanel { u, v };
        let origin = teaching.panel_from_camera.origin();
        let ray =
            camera.unproject(teaching.reference_px).and_then(|ray| (teaching.panel_from_camera * ray).direction());
        let ray: Vector<Panel> = ray.ok_or_else(|| off.clone())?;
        let distance_mm = |point: &Point<Panel>| {
            let offset = (*point - origin).mm;
            (offset - ray.mm * offset.dot(&ray.mm)).norm()
        };
        let nearest = self
            .outline_px
            .iter()
            .filter_map(|pixel| Some((*pixel, self.outline_point_at(*pixel)?)))
            .min_by(|a, b| distance_mm(&a.1).total_cmp(&distance_mm(&b.1)))
            .filter(|(_, point)| distance_mm(point) <= MAX_DISTANCE_MM);
        let (pixel, _) = nearest.ok_or_else(|| off.clone())?;
        let at = (pixel.u as usize, pixel.v as usize);
        let plane = self.fit_plane_at(at, NEIGHBOURHOOD_HALF_WIDTH_PX).ok_or_else(|| off.clone())?;
        let point = plane.intersect_ray(origin, ray).ok_or(off)?;
        Ok(TaughtCorner { teaching_data: teaching, point, normal: plane.normal })
    }
}
