//! The view of a part by a camera: for each pixel, rays from the camera to the part give the depth, the angle of
//! incidence, and the fraction that the part covers.
//!
//! The covered fraction is counted over a lattice of rays in each pixel at the border, so that the edge of the part has
//! its true position in the picture, to a fraction of a pixel. A pixel at the border has no depth, as in a scan.
//!
//! For each ray, the nearest triangle and the point at which the ray meets it are computed. The triangles are in the
//! camera frame. A hierarchy of boxes (`obvhs`) in single precision finds the triangles near a ray. The intersection
//! with each of them is computed in double precision (Möller, Trumbore 1997, "Fast, minimum storage ray–triangle
//! intersection"), so that the error of the search does not affect the depth.

use super::error::NominalError;
use super::part::{Part, PartEdges, bounds};
use glam::Vec3A;
use nalgebra::{Point3, Vector3};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::{Ray, RayHit};
use panelprep_base::geometry::{
    Camera, ColorPicture, Drawing, Frame, OrganizedCloud, PinholeCamera, Pixel, Point, Rigid,
};
use rayon::prelude::*;
use std::ops::Range;

/// Margin of the boxes around their triangles, mm: more than the rounding of single precision within 10 m.
const BOX_MARGIN_MM: f64 = 0.005;
/// Maximum distance between a triangle and a ray that still meets it, relative to the size of the triangle: no ray
/// passes between neighbouring triangles.
const RELATIVE_EDGE_TOLERANCE: f64 = 1e-9;
/// Minimum distance of both ends of an edge from the plane of a triangle that the edge passes through, mm; with a
/// smaller distance the edge only touches the triangle.
const MIN_CROSSING_MM: f64 = 0.02;

/// A part in front of a camera, prepared for the intersection with rays.
pub struct PartRays<C: Frame> {
    vertices: Vec<Point<C>>,
    triangles: Vec<[u32; 3]>,
    boxes: CwBvh,
}

/// The point at which a ray meets a part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartHit {
    /// Distance along the ray, as a multiple of the length of its direction vector: the depth, mm, for a direction (x,
    /// y, 1).
    pub distance: f64,
    /// Cosine of the angle between ray and normal, 0…1.
    pub cos_incidence: f64,
    /// Index of the triangle.
    pub triangle: u32,
}

fn to_vec3a(point: &Vector3<f64>) -> Vec3A {
    Vec3A::new(point.x as f32, point.y as f32, point.z as f32)
}

impl<C: Frame> PartRays<C> {
    /// Prepares a part at this pose in the camera frame.
    pub fn new(part: Part, camera_from_drawing: &Rigid<C, Drawing>) -> Self {
        let placed = |vertex| *camera_from_drawing * Point::<Drawing>::new(vertex);
        let vertices: Vec<Point<C>> = part.vertices.into_iter().map(placed).collect();
        let margin = Vec3A::splat(BOX_MARGIN_MM as f32);
        let boxes: Vec<Aabb> = part
            .triangles
            .iter()
            .map(|triangle| {
                let corners = triangle.map(|corner| to_vec3a(&vertices[corner as usize].mm.coords));
                let around = Aabb::from_points(&corners);
                Aabb::new(around.min - margin, around.max + margin)
            })
            .collect();
        let order = (0..boxes.len() as u32).collect();
        let pairs = PlocBuilder::with_capacity(boxes.len()).build(
            PlocSearchDistance::Low,
            &boxes,
            order,
            SortPrecision::U64,
            0,
        );
        PartRays { vertices, triangles: part.triangles, boxes: bvh2_to_cwbvh(&pairs, 3, true, false) }
    }

    /// Returns the vertices in the camera frame.
    pub fn vertices(&self) -> &[Point<C>] {
        &self.vertices
    }

    /// Returns the triangles, each as three vertex indices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    fn corners(&self, triangle: u32) -> [Point3<f64>; 3] {
        self.triangles[triangle as usize].map(|corner| self.vertices[corner as usize].mm)
    }

    /// Returns the nearest point at which the ray from the camera in this direction meets the part.
    pub fn nearest(&self, direction: &Vector3<f64>) -> Option<PartHit> {
        let mut nearest: Option<PartHit> = None;
        let ray = Ray::new_inf(Vec3A::ZERO, to_vec3a(direction));
        self.boxes.ray_traverse(ray, &mut RayHit::none(), |_, index| {
            let triangle = self.boxes.primitive_indices[index];
            let Some((distance, normal)) = hit_distance(&Point3::origin(), direction, self.corners(triangle))
            else {
                return f32::INFINITY;
            };
            if nearest.is_none_or(|nearest| distance < nearest.distance) {
                let cos_incidence = (normal.dot(direction) / (normal.norm() * direction.norm())).abs();
                nearest = Some(PartHit { distance, cos_incidence, triangle });
            }
            // The value is rounded up, so that the search does not exclude a triangle at the same distance.
            (distance as f32).next_up()
        });
        nearest
    }

    /// Checks that the surface does not pass through itself.
    ///
    /// # Errors
    /// If edges pass through a face; the error contains their number, and the position of the first in the drawing
    /// frame.
    pub fn check_crossings(
        &self,
        edges: &PartEdges,
        camera_from_drawing: &Rigid<C, Drawing>,
    ) -> Result<(), NominalError> {
        let crossings: Vec<Point3<f64>> =
            edges.all.par_iter().with_min_len(4_096).filter_map(|edge| self.edge_crossing(*edge)).collect();
        match crossings.first() {
            None => Ok(()),
            Some(&first) => {
                let at = camera_from_drawing.inverse() * Point::<C>::new(first);
                Err(NominalError::CrossesItself { count: crossings.len(), at_mm: at.mm.coords.into() })
            }
        }
    }

    /// Returns the point at which an edge passes through a triangle with which it has no common vertex.
    fn edge_crossing(&self, edge: [u32; 2]) -> Option<Point3<f64>> {
        let [from, to] = edge.map(|corner| self.vertices[corner as usize].mm);
        let along = to - from;
        let mut found = None;
        let ray = Ray::new(to_vec3a(&from.coords), to_vec3a(&along), 0.0, 1.0);
        self.boxes.ray_traverse_anyhit(ray, |_, index| {
            let triangle = self.boxes.primitive_indices[index];
            let own = self.triangles[triangle as usize];
            if found.is_some() || own.iter().any(|corner| edge.contains(corner)) {
                return;
            }
            let corners = self.corners(triangle);
            let Some((share, normal)) = hit_distance(&from, &along, corners) else { return };
            let height_mm = |point: &Point3<f64>| normal.dot(&(point - corners[0])).abs() / normal.norm();
            if share < 1.0 && height_mm(&from) > MIN_CROSSING_MM && height_mm(&to) > MIN_CROSSING_MM {
                found = Some(from + along * share);
            }
        });
        found
    }
}

/// Returns the distance at which a ray meets a triangle, as a multiple of the length of the ray's direction vector, and
/// the normal of the triangle.
fn hit_distance(
    from: &Point3<f64>,
    direction: &Vector3<f64>,
    [a, b, c]: [Point3<f64>; 3],
) -> Option<(f64, Vector3<f64>)> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(&ac);
    let scale = ab.dot(&across);
    let away = from - a;
    let to_b = away.dot(&across) / scale;
    let around = away.cross(&ab);
    let to_c = direction.dot(&around) / scale;
    let distance = ac.dot(&around) / scale;
    // For a ray in the plane of the triangle the scale is zero: the comparisons are then false.
    let is_inside = to_b >= -RELATIVE_EDGE_TOLERANCE
        && to_c >= -RELATIVE_EDGE_TOLERANCE
        && to_b + to_c <= 1.0 + RELATIVE_EDGE_TOLERANCE;
    (is_inside && distance > 0.0 && distance.is_finite()).then(|| (distance, ab.cross(&ac)))
}

/// Number of rays along each side of a pixel at the border.
const RAYS_PER_PIXEL_SIDE: usize = 8;
/// Brightness of the part where the camera sees its surface perpendicularly, grey levels. `SHADING_GRAY` is the
/// decrease where the camera sees the surface along its plane; it is far less than the contrast of a mark
/// (`locate/print_features`).
const PERPENDICULAR_GRAY: f64 = 95.0;
const SHADING_GRAY: f64 = 25.0;
/// Brightness beside the part, grey levels.
const BACKGROUND_GRAY: u8 = 225;
/// Margin that is added to a window if its rim shows the part, px.
const WINDOW_MARGIN_PX: usize = 16;
/// Minimum cosine of the angle between view and normal of a surface that faces the camera: at a smaller cosine no
/// camera measures it.
const MIN_FACING_COSINE: f64 = 0.1;
/// Minimum distance of the centre of a hidden triangle behind the surface that its ray meets, relative to its depth.
const MIN_RELATIVE_HIDDEN_DISTANCE: f64 = 1e-4;

/// One pixel of a view.
#[derive(Debug, Clone, Copy, Default)]
struct PixelCoverage {
    /// Depth, mm; 0 if the ray through the centre meets nothing.
    depth_mm: f64,
    cos_incidence: f32,
    /// Fraction of the pixel that the part covers, 0…1.
    covered: f32,
}

/// A part as a camera sees it.
pub struct PartView {
    size_px: [usize; 2],
    pixels: Vec<PixelCoverage>,
    directions: Vec<[f64; 2]>,
    columns: Range<usize>,
    rows: Range<usize>,
}

/// The parts of a surface that a camera does not see, as fractions of the surface that faces it, 0…1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnseenFractions {
    /// Fraction outside of the picture.
    pub outside: f64,
    /// Fraction behind another part of the surface.
    pub hidden: f64,
}

impl PartView {
    /// Computes the view of a part from a camera at the origin of its frame; `None` if no ray meets the part.
    ///
    /// # Errors
    /// If the lens model has no ray for a pixel that may show the part.
    pub fn view_part<C: Frame>(
        rays: &PartRays<C>,
        camera: &PinholeCamera,
    ) -> Result<Option<PartView>, NominalError> {
        let mut window = window(rays, camera);
        loop {
            let seen = PartView::view_columns(rays, camera, window.clone())?;
            // The lens bends a long straight edge, so the edge may leave the box of its projected ends. The window is
            // extended step by step, since a lens model may have no ray far beside the part.
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
        let whole = |hit: PartHit| PixelCoverage {
            depth_mm: hit.distance,
            cos_incidence: hit.cos_incidence as f32,
            covered: 1.0,
        };
        let middles: Vec<PixelCoverage> = directions
            .par_iter()
            .with_min_len(1_024)
            .map(|direction| rays.nearest(direction).map_or_else(PixelCoverage::default, whole))
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
            PixelCoverage { cos_incidence: cos as f32, covered, ..middles[index] }
        };
        let pixels: Vec<PixelCoverage> = (0..middles.len())
            .into_par_iter()
            .with_min_len(1_024)
            .map(|index| if is_at_border(index) { fine(index) } else { middles[index] })
            .collect();
        let is_met = pixels.iter().any(|pixel| pixel.covered > 0.0);
        let size_px = [camera.width_px, camera.height_px];
        let directions = directions.iter().map(|ray| [ray.x / ray.z, ray.y / ray.z]).collect();
        Ok(is_met.then_some(PartView { size_px, pixels, directions, columns, rows }))
    }

    /// Returns whether the part covers a pixel in the first or last of these columns or rows of the window; a column or
    /// row of `None` is not examined.
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

    /// Returns whether the part reaches the rim of the picture, so that a part of it may be outside.
    pub fn reaches_rim(&self) -> bool {
        let [width, height] = self.size_px;
        self.is_covered([Some(0), Some(width - 1)], [Some(0), Some(height - 1)])
    }

    /// Returns each pixel that may show the part, by its index in the picture.
    fn visible_pixels(&self) -> impl Iterator<Item = (usize, &PixelCoverage, &[f64; 2])> + '_ {
        let (width, columns) = (self.size_px[0], self.columns.clone());
        let indices = self.rows.clone().flat_map(move |row| columns.clone().map(move |u| row * width + u));
        indices.zip(&self.pixels).zip(&self.directions).map(|((index, pixel), ray)| (index, pixel, ray))
    }

    /// Returns the view as a picture: the part in one grey level on a uniform background.
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
    /// Returns the view as a scan: points where the part covers the whole pixel, and the shaded picture of the part.
    pub fn cloud(&self) -> Option<OrganizedCloud<Camera>> {
        let [width, height] = self.size_px;
        let mut points = vec![[f32::NAN; 3]; width * height];
        let mut colors = vec![[BACKGROUND_GRAY; 3]; width * height];
        for (index, pixel, [x, y]) in self.visible_pixels() {
            let gray = PERPENDICULAR_GRAY - SHADING_GRAY * (1.0 - f64::from(pixel.cos_incidence));
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
    let grow = |range: &Range<usize>, size: usize| {
        range.start.saturating_sub(WINDOW_MARGIN_PX)..(range.end + WINDOW_MARGIN_PX).min(size)
    };
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
    // Behind the camera and far beside its picture a lens model is not valid: then all pixels are examined.
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

impl UnseenFractions {
    /// Computes which fractions of the surface facing a camera the camera does not see. Of a closed part, the outside
    /// can face a camera; of a sheet, both sides can.
    pub fn find<C: Frame>(rays: &PartRays<C>, camera: &PinholeCamera, is_closed: bool) -> UnseenFractions {
        let corners = |triangle: &[u32; 3]| triangle.map(|corner| rays.vertices()[corner as usize].mm.coords);
        // Six times the volume; its sign states in which direction the triangles list their vertices.
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
            // A value that is not finite is treated as not facing, so the condition is the positive one.
            let is_facing = facing > MIN_FACING_COSINE * area_mm2 * middle.coords.norm() && middle.z > 0.0;
            if !is_facing {
                return [0.0; 3];
            }
            if camera.project_inside(Point::<C>::new(middle)).is_none() {
                return [area_mm2, area_mm2, 0.0];
            }
            let direction = middle.coords / middle.z;
            let is_hidden = rays
                .nearest(&direction)
                .is_some_and(|hit| hit.distance < middle.z * (1.0 - MIN_RELATIVE_HIDDEN_DISTANCE));
            [area_mm2, 0.0, if is_hidden { area_mm2 } else { 0.0 }]
        };
        let add = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        let [all, outside, hidden] =
            rays.triangles().par_iter().with_min_len(4_096).map(of_triangle).reduce(|| [0.0; 3], add);
        UnseenFractions {
            outside: outside / all.max(f64::MIN_POSITIVE),
            hidden: hidden / all.max(f64::MIN_POSITIVE),
        }
    }
}
