//! The taught panel, computed from one scan at the nominal pose and from the recipe. Also a taught corner: the pose of
//! the flange camera, the pixel of the corner in its picture, and the position of the corner on the panel.
//!
//! The nominal camera pose and the reference pixel are taught together (thesis 3.9). The position of the corner on the
//! panel is the intersection of the reference pixel's ray with the plane of the surface beside the corner. From this
//! position, the expected pixel follows for every camera pose, not only for the nominal one.

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

/// Half-width of the neighbourhood from which a surface point is determined, px.
const SURFACE_HALF_WIDTH_PX: usize = 5;

/// Half-widths of the neighbourhood at missing points, px, tried in this order.
const HOLE_HALF_WIDTHS_PX: [usize; 3] = [80, 160, 320];
/// Maximum half-width of the neighbourhood to which a plane is fitted, px: about 15 mm, over which a panel is nearly
/// flat. The half-width is doubled up to this value if points are missing.
const MAX_HALF_WIDTH_PX: usize = 40;
/// Maximum residual of the points around a hole from the surface of second order, rms, mm. With a larger residual, the
/// panel has another shape.
const MAX_SURFACE_RESIDUAL_MM: f64 = 0.5;

/// How a panel is taught.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TaughtSource {
    /// By a scan at its nominal place.
    Scan,
    /// From its drawing, whose frame is the panel's frame.
    Drawing,
}

impl TaughtSource {
    /// Returns how the recipe's panel is taught: from its drawing if the recipe has `[nominal]`.
    pub fn from_recipe(recipe: &Recipe) -> Self {
        recipe.nominal().map_or(TaughtSource::Scan, |_| TaughtSource::Drawing)
    }

    /// Returns what the present panel is compared with, as part of a sentence.
    pub fn describe(self) -> &'static str {
        match self {
            TaughtSource::Scan => "the taught surface",
            TaughtSource::Drawing => "the drawing",
        }
    }
}

/// A grid of the region on the panel's surface.
#[derive(Debug, Clone)]
pub struct Grid {
    /// The row and column of the grid.
    pub id: GridId,
    /// The closed edge of the grid as points on the surface; on a curved panel the sides are curves.
    pub edge: Vec<Point<Panel>>,
    /// The grid's four corners in the order of the region's corners.
    pub corners: [Point<Panel>; 4],
}

/// The data of a panel at its nominal pose.
#[derive(Debug, Clone)]
pub struct TaughtPanel {
    /// The scan in the panel's frame, with the pixels of the taught picture.
    pub scan: OrganizedCloud<Panel>,
    /// Whether the scan was captured, or computed from the drawing.
    pub reference: TaughtSource,
    /// The pose of the panel's frame at teaching.
    pub nominal_pose: Rigid<Base, Panel>,
    /// The calibration of the 3D camera that captured the scan.
    pub camera: PinholeCamera,
    /// The pose of the 3D camera in the panel's frame.
    pub panel_from_camera: Rigid<Panel, Camera>,
    /// The panel's pixels in the scan.
    pub mask: Mask,
    /// The closed outline of the panel in the taught picture, px.
    pub outline_px: Vec<Pixel>,
    /// The source of the outline.
    pub outline_from: OutlineFrom,
    /// The quadrilaterals in the taught picture at which the panel is held.
    pub held_px: Vec<[Pixel; 4]>,
    /// The outline as points on the surface.
    pub outline: Vec<Point<Panel>>,
    /// The region in the taught picture.
    pub region: Region,
    /// The region's grids, row by row.
    pub grids: Vec<Grid>,
}

/// Number of points on each side of a grid.
const POINTS_PER_GRID_SIDE: usize = 8;

impl TaughtPanel {
    /// Computes the taught data from a scan at the nominal place.
    ///
    /// # Errors
    /// If there is no panel at the recipe's region, or the region extends beyond the panel.
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
        let edge = self.region.edge(id, POINTS_PER_GRID_SIDE).into_iter().map(at).collect::<Result<Vec<_>, _>>()?;
        let corners =
            [edge[0], edge[POINTS_PER_GRID_SIDE], edge[2 * POINTS_PER_GRID_SIDE], edge[3 * POINTS_PER_GRID_SIDE]];
        Ok(Grid { id, edge, corners })
    }

    /// Returns the surface point at a pixel of the taught picture, from a plane that is fitted to its neighbourhood;
    /// `None` if the pixel is not on the panel.
    pub fn surface_point_at(&self, pixel: Pixel) -> Option<Point<Panel>> {
        let at = pixel.nearest_whole(self.scan.width(), self.scan.height())?;
        let viewer = self.panel_from_camera.origin();
        let plane = self.fit_plane_at(at, SURFACE_HALF_WIDTH_PX)?;
        plane.intersect_ray(viewer, self.panel_from_camera * self.camera.unproject(pixel)?)
    }

    /// Returns the surface point at a pixel with missing points around it, from a neighbourhood that is as wide as
    /// necessary.
    fn surface_point_around(&self, pixel: Pixel) -> Option<Point<Panel>> {
        let at = pixel.nearest_whole(self.scan.width(), self.scan.height())?;
        let ray = self.panel_from_camera * self.camera.unproject(pixel)?;
        let widths = std::iter::successors(Some(SURFACE_HALF_WIDTH_PX), |half_width_px| Some(2 * half_width_px));
        let mut widths = widths.take_while(|&half_width_px| half_width_px <= MAX_HALF_WIDTH_PX);
        let plane = widths.find_map(|half_width_px| self.fit_plane_at(at, half_width_px))?;
        plane.intersect_ray(self.panel_from_camera.origin(), ray)
    }

    /// Returns the panel's pixels with points in a square around a pixel, with this half-width.
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

    /// Returns the surface point within a wide hole, from a surface of second order through the points around the hole;
    /// `None` if it is farther away than the border of these points.
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

    /// Returns the surface point at a pixel of the outline.
    fn outline_point_at(&self, pixel: Pixel) -> Option<Point<Panel>> {
        match self.outline_from {
            OutlineFrom::Scan => self.scan.point(pixel.u as usize, pixel.v as usize),
            OutlineFrom::Recipe => self.surface_point_around(pixel),
        }
    }

    /// Returns the fraction of the area inside a drawn outline that has points, 0…1; 1 without a drawn outline.
    pub fn measured_fraction(&self) -> f64 {
        if self.outline_from == OutlineFrom::Scan {
            return 1.0;
        }
        let held_px2: f64 = self.held_px.iter().map(|held| polygon::signed_area_px2(held).abs()).sum();
        let whole_px2 = polygon::signed_area_px2(&self.outline_px).abs();
        // A held place may extend beyond the outline, so only half of its area is subtracted.
        (self.mask.count() as f64 / (whole_px2 - held_px2 / 2.0).max(1.0)).min(1.0)
    }

    /// Returns whether the panel is held within this distance from a pixel of the taught picture.
    pub fn is_held_near(&self, pixel: Pixel, within_px: f64) -> bool {
        let near = |held: &[Pixel; 4]| polygon::distance_to_side_px(held, pixel) <= within_px;
        extent::is_held_at(&self.held_px, pixel) || self.held_px.iter().any(near)
    }

    /// Fits a plane to the panel's points around a pixel; its normal points to the camera. Points off the panel are
    /// excluded.
    pub(super) fn fit_plane_at(&self, at: (usize, usize), half_width_px: usize) -> Option<Plane<Panel>> {
        local_plane_where(&self.scan, at, half_width_px, self.panel_from_camera.origin(), |i| self.mask.inside[i])
    }

    /// Returns the panel's points with their pixel indices, row by row.
    pub fn points(&self) -> impl Iterator<Item = (usize, Point<Panel>)> + '_ {
        self.scan.valid_points().filter(|(index, _)| self.mask.inside[*index])
    }

    /// Returns the centroid of the panel's points, the reference for its shift and rotation.
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

/// Half-width of the neighbourhood from which the surface beside a corner is determined, px.
const NEIGHBOURHOOD_HALF_WIDTH_PX: usize = 12;
/// Maximum distance between the ray and the outline, mm: the apex of a rounded corner is a few mm outside of the
/// outline.
const MAX_DISTANCE_MM: f64 = 15.0;

/// The data of a taught corner picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerTeaching {
    /// The corner's pixel in the taught picture.
    pub reference_px: Pixel,
    /// The pose of the camera in the panel's frame, `wT_nominalCP` of the thesis.
    pub panel_from_camera: Rigid<Panel, FlangeCamera>,
}

/// A taught corner, with its position on the panel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaughtCorner {
    /// The pixel of the corner and the pose of the camera in the taught picture.
    pub teaching_data: CornerTeaching,
    /// The corner on the surface: the intersection of the two edges.
    pub point: Point<Panel>,
    /// The normal of the surface beside the corner, with length 1.
    pub normal: Vector<Panel>,
}

impl TaughtCorner {
    /// Returns the fraction (0…1) of a motion along the panel's normal that is visible as a sideways motion in the
    /// taught picture: the sine of the angle between the normal and the viewing direction.
    pub fn visible_normal_fraction(&self) -> f64 {
        let towards = (self.point - self.teaching_data.panel_from_camera.origin()).mm.normalize();
        towards.cross(&self.normal.mm).norm()
    }
}

impl TaughtPanel {
    /// Computes the position of a taught corner on the panel.
    ///
    /// # Errors
    /// If the distance between the reference pixel's ray and the panel's outline is larger than a rounded corner can
    /// cause.
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
