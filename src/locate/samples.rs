//! What takes part in the registration: points of the taught panel, small planes and lines of the scan.
//!
//! The taught panel gives bare points of its surface, evenly over its pixels, and of its outline. The scan's piece gives
//! the planes that point-to-plane needs, each through the neighbours of a pixel, and the lines of its outline.
//! An outline is stepped pixel by pixel in the mask; both sides replace each of its points by the middle of its
//! neighbours along the outline, which averages the steps and rounds corners alike.

use super::LocateError;
use super::correspond::{CHUNK, Tree};
use super::piece::inner;
use crate::geometry::{
    Base, Frame, Mask, OrganizedCloud, Panel, Pixel, Point, Rigid, Vector, local_plane, local_plane_of,
};
use crate::imaging::outer_contours;
use crate::panel::TaughtPanel;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// About so many points of the taught surface take part, and twice as many planes of the scan.
const SURFACE_POINTS: usize = 12_000;
/// Half the width of the neighbourhood of a plane, mm: averages the white range noise and stays flat.
const PLANE_HALF_WIDTH_MM: f64 = 2.0;
/// With fewer pixels a plane is left without the points it needs.
const MIN_HALF_WIDTH_PX: usize = 2;
/// Half the length of the outline over which a point of it is averaged, mm.
pub(super) const LINE_HALF_LENGTH_MM: f64 = 3.0;
/// Fewer planes or lines hold no panel.
const MIN_SAMPLES: usize = 100;

/// The taught side.
pub(super) struct Taught {
    /// Points of the surface.
    pub surface: Vec<Point<Panel>>,
    /// Points of the outline.
    pub outline: Vec<Point<Panel>>,
    /// The middle of the surface.
    pub centre: Point<Panel>,
    /// The surface's mean normal, towards the camera.
    pub normal: Vector<Panel>,
}

impl Taught {
    /// Samples a taught panel.
    pub fn of(panel: &TaughtPanel, area_mm2: f64) -> Result<Self, LocateError> {
        let stride = stride_px(panel.mask.count(), SURFACE_POINTS);
        let width = panel.scan.width();
        let surface: Vec<Point<Panel>> = panel
            .points()
            .filter(|(index, _)| (index % width).is_multiple_of(stride) && (index / width).is_multiple_of(stride))
            .map(|(_, point)| point)
            .collect();
        let spacing_mm = (area_mm2 / panel.mask.count().max(1) as f64).sqrt();
        let outline: Vec<Point<Panel>> =
            lines(&panel.scan, &panel.outline_px, spacing_mm).into_iter().map(|line| line.point).collect();
        enough(&surface, &outline)?;
        let (centre, axis) = middle_and_thinnest(&surface);
        let towards_camera = panel.panel_from_camera.origin() - centre;
        let normal = if axis.dot(&towards_camera.mm) < 0.0 { -axis } else { axis };
        Ok(Taught { surface, outline, centre, normal: Vector::new(normal) })
    }

    /// How far two guesses put the same point of the outline apart, at most, mm.
    pub fn largest_distance_mm(&self, a: Rigid<Base, Panel>, b: Rigid<Base, Panel>) -> f64 {
        self.outline.iter().map(|point| a.distance_at_mm(b, *point)).fold(0.0, f64::max)
    }
}

/// A small plane of the scan.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    /// A point on it.
    pub point: Point<Base>,
    /// Its unit normal; `None` at the border of the piece, where a closest point says nothing about the surface.
    pub normal: Option<Vector<Base>>,
}

/// A short line of the scan's outline.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    /// The middle of the line.
    pub point: Point<Base>,
    /// The direction in the surface that leads across the outline, of length 1.
    pub across: Vector<Base>,
}

/// The scan's side.
pub(super) struct Scanned {
    pub surface: Vec<Patch>,
    pub surface_tree: Tree,
    pub outline: Vec<Edge>,
    pub outline_tree: Tree,
    /// Distance between neighbouring pixels on the surface, mm.
    pub spacing_mm: f64,
    /// Distance between neighbouring patches, mm.
    pub patch_spacing_mm: f64,
}

impl Scanned {
    /// Samples the panel's piece of a scan; `viewer` is where the camera stands.
    pub fn of(
        scan: &OrganizedCloud<Base>,
        piece: &Mask,
        area_mm2: f64,
        viewer: Point<Base>,
    ) -> Result<Self, LocateError> {
        let spacing_mm = (area_mm2 / piece.count().max(1) as f64).sqrt();
        let half_width_px = ((PLANE_HALF_WIDTH_MM / spacing_mm).round() as usize).max(MIN_HALF_WIDTH_PX);
        let stride = stride_px(piece.count(), 2 * SURFACE_POINTS);
        let places: Vec<(usize, usize)> = (0..scan.height())
            .step_by(stride)
            .flat_map(|row| (0..scan.width()).step_by(stride).map(move |column| (column, row)))
            .filter(|&(column, row)| piece.contains(column, row))
            .collect();
        let patch = |&(column, row): &(usize, usize)| {
            let plane = inner(piece, column, row, half_width_px)
                .then(|| local_plane_of(scan, (column, row), half_width_px, viewer, |i| piece.inside[i]))
                .flatten();
            let raw = || Some(Patch { point: scan.point(column, row)?, normal: None });
            plane.map(|plane| Patch { point: plane.point, normal: Some(plane.normal) }).or_else(raw)
        };
        let surface: Vec<Patch> =
            places.par_iter().with_min_len(CHUNK).map(patch).collect::<Vec<_>>().into_iter().flatten().collect();
        let contour = outer_contours(piece)?.into_iter().next().unwrap_or_default();
        let edge = |line: &Line<Base>| {
            // Less than half of the neighbourhood of an outline's pixel is surface.
            let plane = local_plane_of(scan, line.pixel, half_width_px + 1, viewer, |i| piece.inside[i])?;
            let across = line.along.cross(&plane.normal.mm).try_normalize(1e-6)?;
            Some(Edge { point: line.point, across: Vector::new(across) })
        };
        let outline = lines(scan, &contour, spacing_mm);
        let outline: Vec<Edge> =
            outline.par_iter().with_min_len(CHUNK).map(edge).collect::<Vec<_>>().into_iter().flatten().collect();
        enough(&surface, &outline)?;
        let free = LocateError::Degenerate { surface: surface.len(), outline: outline.len() };
        Ok(Scanned {
            surface_tree: Tree::over(surface.iter().map(|patch| patch.point)).ok_or_else(|| free.clone())?,
            outline_tree: Tree::over(outline.iter().map(|edge| edge.point)).ok_or(free)?,
            surface,
            outline,
            spacing_mm,
            patch_spacing_mm: spacing_mm * stride as f64,
        })
    }

    /// The middle of the piece.
    pub fn centre(&self) -> Point<Base> {
        let sum: Vector3<f64> = self.surface.iter().map(|patch| patch.point.mm.coords).sum();
        Point::new((sum / self.surface.len() as f64).into())
    }
}

fn enough<A, B>(surface: &[A], outline: &[B]) -> Result<(), LocateError> {
    if surface.len() < MIN_SAMPLES || outline.len() < MIN_SAMPLES {
        return Err(LocateError::Degenerate { surface: surface.len(), outline: outline.len() });
    }
    Ok(())
}

/// Every how many pixels, in both directions, leave about this many of them.
fn stride_px(pixels: usize, wanted: usize) -> usize {
    ((pixels as f64 / wanted as f64).sqrt().round() as usize).max(1)
}

struct Line<F: Frame> {
    pixel: (usize, usize),
    point: Point<F>,
    along: Vector3<f64>,
}

/// At each pixel of an outline the line through its neighbours along the outline.
fn lines<F: Frame>(cloud: &OrganizedCloud<F>, contour: &[Pixel], spacing_mm: f64) -> Vec<Line<F>> {
    let reach = ((LINE_HALF_LENGTH_MM / spacing_mm).round() as usize).max(2);
    let count = contour.len();
    if count < 4 * reach {
        return Vec::new();
    }
    let at = |i: usize| {
        let pixel = contour[i % count];
        (pixel.u as usize, pixel.v as usize)
    };
    let line = |i: usize| {
        let pixel = at(i);
        let middle = cloud.point(pixel.0, pixel.1)?;
        let (mut used, mut sum, mut squares) = (0usize, Vector3::zeros(), Matrix3::zeros());
        for j in i + count - reach..=i + count + reach {
            let (column, row) = at(j);
            let offset = (cloud.point(column, row)? - middle).mm;
            (used, sum, squares) = (used + 1, sum + offset, squares + offset * offset.transpose());
        }
        let mean = sum / used as f64;
        let eigen = (squares / used as f64 - mean * mean.transpose()).symmetric_eigen();
        let along = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        Some(Line { pixel, point: middle + Vector::new(mean), along })
    };
    (0..count).filter_map(line).collect()
}

/// Centroid, and the direction in which the points scatter least.
fn middle_and_thinnest<F: Frame>(points: &[Point<F>]) -> (Point<F>, Vector3<f64>) {
    let mean = points.iter().map(|point| point.mm.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let scatter: Matrix3<f64> =
        points.iter().map(|point| (point.mm.coords - mean) * (point.mm.coords - mean).transpose()).sum();
    let eigen = scatter.symmetric_eigen();
    (Point::new(mean.into()), eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned())
}
