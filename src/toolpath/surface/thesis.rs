//! The thesis's method (4.5): points of the scan are the control points.
//!
//! The scan is too dense to use every point as a control point. Each control point is therefore the scan's point
//! nearest to its Greville abscissa. The surface then follows the scan, contains its noise, and flattens every
//! bulge. The method is included only for comparison.

use super::error::FitError;
use nalgebra::{Point2, Vector3};
use panelprep_base::geometry::basis::{DEGREE, KnotError, KnotVector};
use panelprep_cell::panel::TaughtPanel;

/// Returns knots over the region only: beyond it there may be no points.
pub(super) fn knots(sides_mm: [f64; 2], spacing_mm: f64) -> Result<[KnotVector; 2], KnotError> {
    let along = |length_mm: f64| {
        let spans = (length_mm / spacing_mm).ceil().max(1.0) as usize;
        KnotVector::uniform(DEGREE, spans, 0.0..=1.0)
    };
    Ok([along(sides_mm[0])?, along(sides_mm[1])?])
}

/// Returns the scan's points that are used as control points, v running fastest.
pub(super) fn controls(panel: &TaughtPanel, knots: &[KnotVector; 2]) -> Result<Vec<Vector3<f64>>, FitError> {
    let (on_u, on_v) = (knots[0].greville_abscissa(), knots[1].greville_abscissa());
    let control = |(u, v): (f64, f64)| {
        let at = panel.region.pixel(Point2::new(u, v));
        let place = at.nearest_whole(panel.scan.width(), panel.scan.height());
        let on_panel = place.filter(|(column, row)| panel.mask.contains(*column, *row));
        let point = on_panel.and_then(|(column, row)| panel.scan.point(column, row));
        point.map(|point| point.mm.coords).ok_or(FitError::NoControlPoint { at })
    };
    on_u.iter().flat_map(|u| on_v.iter().map(move |v| (*u, *v))).map(control).collect()
}
