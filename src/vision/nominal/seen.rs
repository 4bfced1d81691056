//! The view that a camera has of a part: for each pixel the depth, the angle, and the share of the pixel that the part
//! covers.
//!
//! The share is counted over a lattice of rays in each pixel at the border, so that the part's edge lies in the
//! picture where it truly projects, to a fraction of a pixel. A pixel at the border has no depth, as in a scan.

use super::error::NominalError;
use super::part::bounds;
use super::rays::{PartHit, PartRays};
use nalgebra::Vector3;
use panelprep_base::geometry::{Camera, ColorPicture, Frame, OrganizedCloud, PinholeCamera, Pixel, Point};
use rayon::prelude::*;
use std::ops::Range;

/// Rays along each side of a pixel at the border.
const RAYS_PER_PIXEL_SIDE: usize = 8;
/// Brightness of the part where it is seen square to its surface, and how much darker it is seen along it, grey
/// levels: far less than the border of a mark (`locate/taught_marks`).
const SQUARE_GRAY: f64 = 95.0;
const SHADING_GRAY: f64 = 25.0;
/// Brightness beside the part.
const BACKGROUND_GRAY: u8 = 225;
/// Margin that is added to a window whose rim shows the part, px.
const GROW_PX: usize = 16;
/// A surface that is seen at a smaller cosine counts as facing away: no camera measures it.
const MIN_FACING: f64 = 0.1;
/// A triangle's middle this far behind the surface that its ray meets is hidden, as a share of its depth.
const HIDDEN_SHARE: f64 = 1e-4;

/// One pixel of a view.
#[derive(Debug, Clone, Copy, Default)]
struct PixelSeen {
    /// Depth, mm; 0 if the ray through the middle meets nothing.
    depth_mm: f64,
    cos_incidence: f32,
    /// The share of the pixel that the part covers, 0…1.
    covered: f32,
}

/// A part as a camera sees it.
pub struct PartView {
    size_px: [usize; 2],
    pixels: Vec<PixelSeen>,
    directions: Vec<[f64; 2]>,
    columns: Range<usize>,
    rows: Range<usize>,
}

/// The parts of a surface that a camera does not see, as shares of the surface that faces it, 0…1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnseenShares {
    /// Share outside of its picture.
    pub outside: f64,
    /// Share behind another part of the surface.
    pub hidden: f64,
}

impl PartView {
    /// Looks at a part with a camera at the origin of its frame; `None` if no ray meets it.
    ///
    /// # Errors
    /// If the lens has no ray for a pixel that may show the part.
    pub fn view_part<C: Frame>(
        rays: &PartRays<C>,
        camera: &PinholeCamera,
    ) -> Result<Option<PartView>, NominalError> {
        let mut window = window(rays, camera);
        loop {
            let seen = PartView::view_columns(rays, camera, window.clone())?;
            // A long straight edge is bent by the lens and may leave the box of its projected ends. The window grows
            // step by step, since a lens may have no ray far beside the part.
            match &seen {
                Some(part) if part.reaches_window() => window = with_margin(&window, camera),
                _ => return Ok(seen),
            }
        }
    }

    fn view_columns<C: Frame>(
        rays: &PartRays<C>,
        camera: &PinholeCamera,
        (columns, rows): (Range<usize>, Range<usize>),
    ) -> Result<Option<PartView>, NominalError> {
        let width = columns.len();
        if width == 0 || rows.is_empty() {
            return Ok(None);
        }
        let direction = |u: f64, v: f64| camera.unproject::<C>(Pixel::at(u, v)).map(|ray| ray.mm);
        let of_row = |row: usize| columns.clone().map(move |column| (column, row));
        let directions: Vec<Vector3<f64>> = rows
            .clone()
            .into_par_iter()
            .flat_map_iter(of_row)
            .map(|(u, v)| direction(u as f64, v as f64).ok_or(NominalError::NoRay { u, v }))
            .collect::<Result<_, _>>()?;
        let whole = |hit: PartHit| PixelSeen {
            depth_mm: hit.distance,
            cos_incidence: hit.cos_incidence as f32,
            covered: 1.0,
        };
        let middles: Vec<PixelSeen> = directions
            .par_iter()
            .with_min_len(1_024)
            .map(|direction| rays.nearest(direction).map_or_else(PixelSeen::default, whole))
            .collect();
        let is_at_border = |index: usize| {
            let (column, row) = (index % width, index / width);
            let around = (row.saturating_sub(1)..(row + 2).min(rows.len()))
                .flat_map(|row| (column.saturating_sub(1)..(column + 2).min(width)).map(move |u| row * width + u));
            around.map(|near| middles[near].depth_mm > 0.0).any(|is_met| is_met != (middles[index].depth_mm > 0.0))
        };
        let fine = |index: usize| {
            let (u, v) = ((columns.start + index % width) as f64, (rows.start + index / width) as f64);
            let at = |step: usize| (step as f64 + 0.5) / RAYS_PER_PIXEL_SIDE as f64 - 0.5;
            let lattice = (0..RAYS_PER_PIXEL_SIDE * RAYS_PER_PIXEL_SIDE)
                .map(|n| direction(u + at(n % RAYS_PER_PIXEL_SIDE), v + at(n / RAYS_PER_PIXEL_SIDE)));
            let hit: Vec<PartHit> = lattice.flatten().filter_map(|direction| rays.nearest(&direction)).collect();
            let cos = hit.iter().map(|hit| hit.cos_incidence).sum::<f64>() / hit.len().max(1) as f64;
            let covered = hit.len() as f32 / (RAYS_PER_PIXEL_SIDE * RAYS_PER_PIXEL_SIDE) as f32;
            PixelSeen { cos_incidence: cos as f32, covered, ..middles[index] }
        };
        let pixels: Vec<PixelSeen> = (0..middles.len())
            .into_par_iter()
            .with_min_len(1_024)
            .map(|index| if is_at_border(index) { fine(index) } else { middles[index] })
            .collect();
        let is_met = pixels.iter().any(|pixel| pixel.covered > 0.0);
        let size_px = [camera.width_px, camera.height_px];
        let directions = directions.iter().map(|ray| [ray.x / ray.z, ray.y / ray.z]).collect();
        Ok(is_met.then_some(PartView { size_px, pixels, directions, columns, rows }))
    }

    /// Returns whether the part covers a pixel in the first or last of these columns or rows of the window; `None` is
    /// not asked for.
    fn is_covered(&self, columns: [Option<usize>; 2], rows: [Option<usize>; 2]) -> bool {
        let width = self.columns.len();
        self.pixels.iter().enumerate().filter(|(_, pixel)| pixel.covered > 0.0).any(|(index, _)| {
            let (u, v) = (self.columns.start + index % width, self.rows.start + index / width);
            columns.contains(&Some(u)) || rows.contains(&Some(v))
        })
    }

    /// Returns whether the part reaches a rim of the window that is not a rim of the picture.
    fn reaches_window(&self) -> bool {
        let [width, height] = self.size_px;
        let rim = |range: &Range<usize>, size: usize| {
            [Some(range.start).filter(|start| *start > 0), Some(range.end - 1).filter(|last| last + 1 < size)]
        };
        self.is_covered(rim(&self.columns, width), rim(&self.rows, height))
    }

    /// Returns whether the part reaches the rim of the picture: what lies beyond is not seen.
    pub fn reaches_rim(&self) -> bool {
        let [width, height] = self.size_px;
        self.is_covered([Some(0), Some(width - 1)], [Some(0), Some(height - 1)])
    }

    /// Returns each pixel that may show the part, by its index in the picture.
    fn visible_pixels(&self) -> impl Iterator<Item = (usize, &PixelSeen, &[f64; 2])> + '_ {
        let (width, columns) = (self.size_px[0], self.columns.clone());
        let indices = self.rows.clone().flat_map(move |row| columns.clone().map(move |u| row * width + u));
        indices.zip(&self.pixels).zip(&self.directions).map(|((index, pixel), ray)| (index, pixel, ray))
    }

    /// Returns the view as a picture: the part in one grey level before a plain background.
    pub fn picture(&self, part_gray: u8, beside_gray: u8) -> ColorPicture {
        let [width, height] = self.size_px;
        let mut picture = ColorPicture::uniform(width, height, [beside_gray; 3]);
        for (index, pixel, _) in self.visible_pixels() {
            picture.rgb[index] = [mixed_gray(f64::from(part_gray), beside_gray, pixel.covered); 3];
        }
        picture
    }
}

impl PartView {
    /// Returns the view as a scan: points where the part covers the whole pixel, and the part's shaded picture.
    pub fn cloud(&self) -> Option<OrganizedCloud<Camera>> {
        let [width, height] = self.size_px;
        let mut points = vec![[f32::NAN; 3]; width * height];
        let mut colors = vec![[BACKGROUND_GRAY; 3]; width * height];
        for (index, pixel, [x, y]) in self.visible_pixels() {
            let gray = SQUARE_GRAY - SHADING_GRAY * (1.0 - f64::from(pixel.cos_incidence));
            colors[index] = [mixed_gray(gray, BACKGROUND_GRAY, pixel.covered); 3];
            if pixel.covered == 1.0 && pixel.depth_mm > 0.0 {
                points[index] = [x * pixel.depth_mm, y * pixel.depth_mm, pixel.depth_mm].map(|mm| mm as f32);
            }
        }
        OrganizedCloud::new(width, height, points, colors).ok()
    }
}

fn mixed_gray(part_gray: f64, beside_gray: u8, covered: f32) -> u8 {
    let beside = f64::from(beside_gray);
    (beside + f64::from(covered) * (part_gray - beside)).round().clamp(0.0, 255.0) as u8
}

/// Returns the window with a wider margin, within the picture.
fn with_margin(
    (columns, rows): &(Range<usize>, Range<usize>),
    camera: &PinholeCamera,
) -> (Range<usize>, Range<usize>) {
    let grow =
        |range: &Range<usize>, size: usize| range.start.saturating_sub(GROW_PX)..(range.end + GROW_PX).min(size);
    (grow(columns, camera.width_px), grow(rows, camera.height_px))
}

/// Returns all columns and rows of the picture.
fn full_window(camera: &PinholeCamera) -> (Range<usize>, Range<usize>) {
    (0..camera.width_px, 0..camera.height_px)
}

/// Returns the columns and rows that may show the part.
fn window<C: Frame>(rays: &PartRays<C>, camera: &PinholeCamera) -> (Range<usize>, Range<usize>) {
    let everything = full_window(camera);
    let (low, high) = bounds(rays.vertices().iter().map(|vertex| vertex.mm));
    // Behind the camera and far beside its picture a lens model does not hold: then every pixel is looked at.
    let reach = low.x.abs().max(low.y.abs()).max(high.x.abs()).max(high.y.abs());
    if low.z <= 0.0 || reach > 1.2 * low.z {
        return everything;
    }
    let (mut from, mut to) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for vertex in rays.vertices() {
        let Some(pixel) = camera.project(*vertex) else { return everything };
        for (axis, px) in [pixel.u, pixel.v].into_iter().enumerate() {
            (from[axis], to[axis]) = (from[axis].min(px), to[axis].max(px));
        }
    }
    let span = |axis: usize, size: usize| {
        let clip = |px: f64| px.clamp(0.0, size as f64) as usize;
        clip((from[axis] - 2.0).floor())..clip((to[axis] + 3.0).ceil())
    };
    (span(0, camera.width_px), span(1, camera.height_px))
}

impl UnseenShares {
    /// Finds what a camera does not see of the surface that faces it. Of a closed part the outside faces a camera,
    /// of a sheet both sides do.
    pub fn find<C: Frame>(rays: &PartRays<C>, camera: &PinholeCamera, is_closed: bool) -> UnseenShares {
        let corners = |triangle: &[u32; 3]| triangle.map(|corner| rays.vertices()[corner as usize].mm.coords);
        // Six times the volume; its sign is the direction in which the triangles run around.
        let volume = |triangle: &[u32; 3]| {
            let [a, b, c] = corners(triangle);
            a.dot(&b.cross(&c))
        };
        let outward = rays.triangles().iter().map(volume).sum::<f64>().signum();
        let of_triangle = |triangle: &[u32; 3]| {
            let [a, b, c] = corners(triangle).map(nalgebra::Point3::from);
            let (middle, area) = (nalgebra::center(&nalgebra::center(&a, &b), &c), (b - a).cross(&(c - a)) / 2.0);
            let towards = -area.dot(&middle.coords);
            let facing = if is_closed { towards * outward } else { towards.abs() };
            let area_mm2 = area.norm();
            // A number that is not finite shows nothing, so the condition asks for what is seen.
            let is_facing = facing > MIN_FACING * area_mm2 * middle.coords.norm() && middle.z > 0.0;
            if !is_facing {
                return [0.0; 3];
            }
            if camera.project_inside(Point::<C>::new(middle)).is_none() {
                return [area_mm2, area_mm2, 0.0];
            }
            let direction = middle.coords / middle.z;
            let is_hidden =
                rays.nearest(&direction).is_some_and(|hit| hit.distance < middle.z * (1.0 - HIDDEN_SHARE));
            [area_mm2, 0.0, if is_hidden { area_mm2 } else { 0.0 }]
        };
        let add = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        let [all, outside, hidden] =
            rays.triangles().par_iter().with_min_len(4_096).map(of_triangle).reduce(|| [0.0; 3], add);
        UnseenShares { outside: outside / all.max(f64::MIN_POSITIVE), hidden: hidden / all.max(f64::MIN_POSITIVE) }
    }
}
