//! The taught pixels that a surface is fitted to, sorted by the knot span that they fall in.
//!
//! A pixel's place in the region, (s, t) = H⁻¹ (pixel), is its parameter (u, v). Range noise moves a point along
//! its ray, hence not its parameter. The knots begin a little outside of the region, so that points beyond its
//! border, where there are any, hold the surface's edge as well as its middle.

use super::basis::KnotVector;
use super::bspline::Parameter;
use super::fit::{DEGREE, FitError};
use crate::geometry::{Pixel, Point};
use crate::panel::TaughtPanel;
use nalgebra::{Point2, Vector3};

/// What the knots reach beyond the region, in spans.
const MARGIN_SPANS: f64 = 0.25;
/// Places on a line across the region at which its length is measured.
const LENGTH_STEPS: usize = 16;

/// One point of the scan with its parameter.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub at: Parameter,
    pub mm: Vector3<f64>,
}

impl Sample {
    pub(super) fn in_region(&self) -> bool {
        (0.0..=1.0).contains(&self.at.u) && (0.0..=1.0).contains(&self.at.v)
    }
}

/// What falls in one span of u and v.
#[derive(Debug, Clone, Default)]
pub(super) struct Cell {
    /// Points, row by row of the picture.
    pub samples: Vec<Sample>,
    /// Pixels inside the region.
    pub pixels: usize,
    /// Those of them that have a point on the panel.
    pub points: usize,
}

/// Knots along u and v, no span longer than the recipe's spacing.
pub(super) fn knots(panel: &TaughtPanel, spacing_mm: f64) -> Result<[KnotVector; 2], FitError> {
    let along = |length_mm: f64| {
        let spans = (length_mm / spacing_mm + 2.0 * MARGIN_SPANS).ceil().max(1.0);
        // spans · h = 1 + 2 margins of MARGIN_SPANS · h each
        let margin = MARGIN_SPANS / (spans - 2.0 * MARGIN_SPANS);
        KnotVector::uniform(DEGREE, spans as usize, -margin..=1.0 + margin)
    };
    let u_mm = side_mm(panel, Point2::new)?;
    let v_mm = side_mm(panel, |along, across| Point2::new(across, along))?;
    Ok([along(u_mm)?, along(v_mm)?])
}

// The longest of three lines across the region.
fn side_mm(panel: &TaughtPanel, unit: impl Fn(f64, f64) -> Point2<f64>) -> Result<f64, FitError> {
    let length_mm = |across: f64| -> f64 {
        let place = |step: usize| unit(step as f64 / LENGTH_STEPS as f64, across);
        let points: Vec<Point<_>> =
            (0..=LENGTH_STEPS).filter_map(|step| panel.surface_at(panel.region.pixel(place(step)))).collect();
        points.windows(2).map(|pair| pair[0].distance_mm(pair[1])).sum()
    };
    let longest = [0.0, 0.5, 1.0].map(length_mm).into_iter().fold(0.0, f64::max);
    if longest > 0.0 { Ok(longest) } else { Err(FitError::NoPoints) }
}

/// All samples by span, u slowest.
pub(super) fn gather(panel: &TaughtPanel, knots: &[KnotVector; 2]) -> Vec<Cell> {
    let [knots_u, knots_v] = knots;
    let domain = [knots_u.domain(), knots_v.domain()];
    let mut cells = vec![Cell::default(); knots_u.spans() * knots_v.spans()];
    let (columns, rows) = pixel_box(panel, knots);
    for row in rows {
        for column in columns.clone() {
            let unit = panel.region.unit(Pixel::at(column as f64, row as f64));
            if !(domain[0].contains(&unit.x) && domain[1].contains(&unit.y)) {
                continue;
            }
            let cell = &mut cells[knots_u.span(unit.x) * knots_v.spans() + knots_v.span(unit.y)];
            let inside = (0.0..=1.0).contains(&unit.x) && (0.0..=1.0).contains(&unit.y);
            cell.pixels += usize::from(inside);
            let point = panel.scan.point(column, row).filter(|_| panel.mask.contains(column, row));
            if let Some(point) = point {
                cell.points += usize::from(inside);
                cell.samples.push(Sample { at: Parameter { u: unit.x, v: unit.y }, mm: point.mm.coords });
            }
        }
    }
    cells
}

// The columns and rows of the picture between which the knots' domain lies.
fn pixel_box(panel: &TaughtPanel, [knots_u, knots_v]: &[KnotVector; 2]) -> (PixelRange, PixelRange) {
    let (u, v) = (knots_u.domain(), knots_v.domain());
    let corners = [(u.start(), v.start()), (u.end(), v.start()), (u.end(), v.end()), (u.start(), v.end())]
        .map(|(u, v)| panel.region.pixel(Point2::new(*u, *v)));
    let range = |coordinate: fn(&Pixel) -> f64, size: usize| {
        let low = corners.iter().map(coordinate).fold(f64::INFINITY, f64::min);
        let high = corners.iter().map(coordinate).fold(f64::NEG_INFINITY, f64::max);
        (low.floor().max(0.0) as usize)..((high.ceil().max(0.0) as usize + 1).min(size))
    };
    (range(|pixel| pixel.u, panel.scan.width()), range(|pixel| pixel.v, panel.scan.height()))
}

type PixelRange = std::ops::Range<usize>;
