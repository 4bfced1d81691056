//! The taught pixels for the fit of a surface, each with its knot span; and the reasons why a scan does not determine a
//! surface, as text for the person who teaches the panel.
//!
//! A pixel's position in the region, (s, t) = H⁻¹ (pixel), is its parameter (u, v). Range noise moves a point along its
//! ray and therefore does not change its parameter. The knots extend slightly beyond the region, so that points beyond
//! its border, if there are any, support the surface's edge as well as its middle.
//!
//! In the thesis's method (4.5) points of the scan are the control points. The scan has too many points for this, so
//! each control point is the scan's point nearest to the control point's Greville abscissa. This surface contains the
//! scan's noise and flattens every bulge. The method is included only for comparison.

use super::bspline::{Parameter, SurfaceError};
use nalgebra::{Point2, Vector3};
use panelprep_base::geometry::basis::{DEGREE, KnotError, KnotVector, SpanFunctions};
use panelprep_base::geometry::{Pixel, Point};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, LimitSource, Severity};
use panelprep_cell::panel::{Region, TaughtPanel};
use rayon::prelude::*;
use std::ops::Range;

/// Minimum number of pixels that determine the surface in a pair of spans.
pub(super) const MIN_PIXELS: usize = (DEGREE + 1) * (DEGREE + 1);
/// Extent of the knots beyond the region, in spans.
const MARGIN_SPANS: f64 = 0.25;
/// Number of points on a line across the region from which the length of the line is calculated.
const LENGTH_STEPS: usize = 16;
/// Number of the picture's rows in one band. A band is processed as one unit for any number of threads.
const BAND_ROWS: usize = 16;

/// One point of the scan with its span.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Index of the pixel in the window.
    pub pixel: u32,
    /// Index of the pair of spans; v is the fastest index.
    pub cell: u32,
    /// Position in the two spans, 0…1 each.
    pub local: [f64; 2],
    pub mm: Vector3<f64>,
}

/// The part of the picture that contains the knots' domain.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Window {
    pub columns: Range<usize>,
    pub rows: Range<usize>,
}

impl Window {
    pub fn width(&self) -> usize {
        self.columns.len()
    }

    pub fn pixel(&self, index: usize) -> Pixel {
        let (column, row) = (index % self.width(), index / self.width());
        Pixel::at((self.columns.start + column) as f64, (self.rows.start + row) as f64)
    }
}

/// All samples, grouped by bands of the picture's rows.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    pub knots: [KnotVector; 2],
    /// The basis functions of each span, along u and along v.
    pub functions: [Vec<SpanFunctions>; 2],
    pub window: Window,
    pub bands: Vec<Vec<Sample>>,
    /// Whether each pixel of the window is inside the region.
    pub inside: Vec<bool>,
    /// Number of pixels inside the region for each pair of spans.
    pub pixels: Vec<usize>,
    /// Number of pixels inside the region with a point on the panel, for all pairs together.
    pub points: usize,
}

/// Returns the knots along u and v; no span is longer than the recipe's control spacing.
pub(super) fn knots(sides_mm: [f64; 2], spacing_mm: f64) -> Result<[KnotVector; 2], KnotError> {
    let along = |length_mm: f64| {
        let spans = (length_mm / spacing_mm + 2.0 * MARGIN_SPANS).ceil().max(1.0);
        // With the span length h: spans · h = 1 + 2 · MARGIN_SPANS · h.
        let margin = MARGIN_SPANS / (spans - 2.0 * MARGIN_SPANS);
        KnotVector::uniform(DEGREE, spans as usize, -margin..=1.0 + margin)
    };
    Ok([along(sides_mm[0])?, along(sides_mm[1])?])
}

/// Returns the lengths of the region along u and along v: in each direction the longest of three lines.
pub(super) fn sides_mm(panel: &TaughtPanel) -> Result<[f64; 2], FitError> {
    let side = |unit: fn(f64, f64) -> Point2<f64>| {
        let length_mm = |across: f64| -> f64 {
            let place = |step: usize| unit(step as f64 / LENGTH_STEPS as f64, across);
            let points: Vec<Point<_>> = (0..=LENGTH_STEPS)
                .filter_map(|step| panel.surface_point_at(panel.region.pixel(place(step))))
                .collect();
            points.windows(2).map(|pair| pair[0].distance_mm(pair[1])).sum()
        };
        let longest = [0.0, 0.5, 1.0].map(length_mm).into_iter().fold(0.0, f64::max);
        if longest > 0.0 { Ok(longest) } else { Err(FitError::NoPoints) }
    };
    Ok([side(Point2::new)?, side(|along, across| Point2::new(across, along))?])
}

struct Band {
    samples: Vec<Sample>,
    inside: Vec<bool>,
    pixels: Vec<usize>,
    points: usize,
}

impl Samples {
    pub fn collect(panel: &TaughtPanel, knots: &[KnotVector; 2]) -> Self {
        let functions = [0, 1].map(|axis| {
            let knots = &knots[axis];
            (0..knots.spans()).map(|span| knots.span_polynomials(span)).collect::<Vec<_>>()
        });
        let window = window(panel, knots);
        let starts: Vec<usize> = window.rows.clone().step_by(BAND_ROWS).collect();
        let band = |start: &usize| {
            let rows = *start..(start + BAND_ROWS).min(window.rows.end);
            Band::new(panel, (knots, &functions), (&window, rows))
        };
        let bands: Vec<Band> = starts.par_iter().map(band).collect();
        let mut pixels = vec![0; functions[0].len() * functions[1].len()];
        for band in &bands {
            pixels.iter_mut().zip(&band.pixels).for_each(|(sum, more)| *sum += more);
        }
        Samples {
            knots: knots.clone(),
            points: bands.iter().map(|band| band.points).sum(),
            inside: bands.iter().flat_map(|band| band.inside.iter().copied()).collect(),
            bands: bands.into_iter().map(|band| band.samples).collect(),
            functions,
            window,
            pixels,
        }
    }

    /// Returns the parameters of a sample on the surface.
    pub fn sample_parameter(&self, sample: &Sample) -> Parameter {
        let [span_u, span_v] = self.spans(sample.cell as usize);
        let along = |functions: &SpanFunctions, share: f64| functions.start + functions.length * share;
        Parameter {
            u: along(&self.functions[0][span_u], sample.local[0]),
            v: along(&self.functions[1][span_v], sample.local[1]),
        }
    }

    /// Returns the indices of the spans along u and v of a pair.
    pub fn spans(&self, cell: usize) -> [usize; 2] {
        let across = self.functions[1].len();
        [cell / across, cell % across]
    }

    /// Returns the centre of a pair of spans in the taught picture.
    pub fn span_centre(&self, cell: usize, region: &Region) -> Pixel {
        let [span_u, span_v] = self.spans(cell);
        let middle = |functions: &SpanFunctions| functions.start + functions.length / 2.0;
        region.pixel(Point2::new(middle(&self.functions[0][span_u]), middle(&self.functions[1][span_v])))
    }

    /// Returns whether this sample is inside of the region.
    pub fn is_inside(&self, sample: &Sample) -> bool {
        self.inside[sample.pixel as usize]
    }
}

impl Band {
    fn new(
        panel: &TaughtPanel,
        (knots, functions): (&[KnotVector; 2], &[Vec<SpanFunctions>; 2]),
        (window, rows): (&Window, Range<usize>),
    ) -> Self {
        let [knots_u, knots_v] = knots;
        let domain = [knots_u.domain(), knots_v.domain()];
        let first_pixel = (rows.start - window.rows.start) * window.width();
        let count = rows.len() * window.width();
        let mut band = Band {
            samples: Vec::with_capacity(count),
            inside: vec![false; count],
            pixels: vec![0; functions[0].len() * functions[1].len()],
            points: 0,
        };
        let places = rows.flat_map(|row| window.columns.clone().map(move |column| (column, row)));
        for (index, (column, row)) in places.enumerate() {
            let unit = panel.region.unit(Pixel::at(column as f64, row as f64));
            if !(domain[0].contains(&unit.x) && domain[1].contains(&unit.y)) {
                continue;
            }
            let (span_u, span_v) = (knots_u.span(unit.x), knots_v.span(unit.y));
            let cell = span_u * functions[1].len() + span_v;
            let inside = (0.0..=1.0).contains(&unit.x) && (0.0..=1.0).contains(&unit.y);
            band.inside[index] = inside;
            band.pixels[cell] += usize::from(inside);
            let point = panel.scan.point(column, row).filter(|_| panel.mask.contains(column, row));
            if let Some(point) = point {
                band.points += usize::from(inside);
                let local = |functions: &SpanFunctions, at: f64| (at - functions.start) / functions.length;
                band.samples.push(Sample {
                    pixel: (first_pixel + index) as u32,
                    cell: cell as u32,
                    local: [local(&functions[0][span_u], unit.x), local(&functions[1][span_v], unit.y)],
                    mm: point.mm.coords,
                });
            }
        }
        band
    }
}

fn window(panel: &TaughtPanel, [knots_u, knots_v]: &[KnotVector; 2]) -> Window {
    let (u, v) = (knots_u.domain(), knots_v.domain());
    let corners = [(u.start(), v.start()), (u.end(), v.start()), (u.end(), v.end()), (u.start(), v.end())]
        .map(|(u, v)| panel.region.pixel(Point2::new(*u, *v)));
    let range = |coordinate: fn(&Pixel) -> f64, size: usize| {
        let low = corners.iter().map(coordinate).fold(f64::INFINITY, f64::min);
        let high = corners.iter().map(coordinate).fold(f64::NEG_INFINITY, f64::max);
        let low = (low.floor().max(0.0) as usize).min(size);
        low..(high.ceil().max(0.0) as usize + 1).clamp(low, size)
    };
    Window {
        columns: range(|pixel| pixel.u, panel.scan.width()),
        rows: range(|pixel| pixel.v, panel.scan.height()),
    }
}

/// The reason why a scan does not determine a surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// The region contains no point of the panel.
    #[error("the region has no scan points; scan again or move the region")]
    NoPoints,
    /// The control points are closer together than the scan's points.
    #[error(
        "a span of the spline surface of {spacing_mm} mm has only {pixels} pixels at ({:.0}, {:.0}) px, at least \
         {MIN_PIXELS} are needed; raise [surface] control_spacing_mm", at.u, at.v
    )]
    TooFine {
        /// The recipe's control spacing, mm.
        spacing_mm: f64,
        /// Number of pixels in the span with the fewest pixels.
        pixels: usize,
        /// The centre of this span in the taught picture.
        at: Pixel,
    },
    /// The scan has a hole.
    #[error(
        "the scan has a hole of {} mm at ({:.0}, {:.0}) px (limit {} mm, [surface] max_hole_mm); scan again or \
         move the region",
        distinguishable_texts(*size_mm, *limit_mm, 1)[0], at.u, at.v, distinguishable_texts(*size_mm, *limit_mm, 1)[1]
    )]
    Hole {
        /// The centre of the largest square without a point, in the taught picture.
        at: Pixel,
        /// Side of this square, mm.
        size_mm: f64,
        /// Maximum side of such a square, mm.
        limit_mm: f64,
    },
    /// The thesis's method needs a point at a position where the scan has no point.
    #[error(
        "the scan has no point at ({:.0}, {:.0}) px for a control point; scan again, or set [surface] method = \
         \"least-squares\"", at.u, at.v
    )]
    NoControlPoint {
        /// The position in the taught picture.
        at: Pixel,
    },
    /// Too large a fraction of the region has no valid point.
    #[error(
        "{} % of the region has no point that fits the surface (limit {} %, [surface] max_missing_percent); scan \
         again",
        distinguishable_texts(*percent, *limit_percent, 1)[0], distinguishable_texts(*percent, *limit_percent, 1)[1]
    )]
    Missing {
        /// Fraction of missing points, percent.
        percent: f64,
        /// Maximum fraction of missing points, percent.
        limit_percent: f64,
    },
    /// The points of the scan do not determine a control point.
    #[error("the scan does not determine the surface near ({:.0}, {:.0}) px; scan again", at.u, at.v)]
    Undetermined {
        /// The control point's position in the taught picture.
        at: Pixel,
    },
    /// The surface folds: its normal points away from the camera.
    #[error("the surface folds at ({:.0}, {:.0}) px: its normal turns away from the camera; scan again", at.u, at.v)]
    Fold {
        /// The position of the fold in the taught picture.
        at: Pixel,
    },
    /// The scan's deviation from the surface is too large.
    #[error(
        "the scan deviates from the surface by {} mm rms (limit {} mm, [surface] max_rms_mm); its noise is {} mm; \
         if the panel has smaller features, reduce control_spacing_mm", distinguishable_texts(*rms_mm, *limit_mm, 3)[0], distinguishable_texts(*rms_mm, *limit_mm, 3)[1],
        fixed_decimals(*noise_mm, 3)
    )]
    PoorFit {
        /// Rms deviation of the scan, mm.
        rms_mm: f64,
        /// Maximum rms deviation, mm.
        limit_mm: f64,
        /// White noise of the scan, mm.
        noise_mm: f64,
    },
    /// The control points do not form a surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The region does not give valid knots.
    #[error(transparent)]
    Knots(#[from] KnotError),
}

impl FitError {
    /// Returns the violated check with its limit and the rejection. If the cause is not a limit, the check contains
    /// only the rejection.
    pub fn failed_check(&self) -> Check {
        let rejects =
            |check: Check| check.with_consequence_if(true, Severity::Reject, "no_surface", || self.to_string());
        let recipe = LimitSource::recipe;
        rejects(match self {
            FitError::TooFine { pixels, .. } => {
                Check::new("pixels in the poorest span of the surface", "", *pixels as f64)
                    .with_min(MIN_PIXELS as f64, LimitSource::Program)
            }
            FitError::Hole { size_mm, limit_mm, .. } => Check::new("largest hole in the region", "mm", *size_mm)
                .with_max(*limit_mm, recipe("surface.max_hole_mm")),
            FitError::Missing { percent, limit_percent } => {
                Check::new("region without points that fit", "%", *percent)
                    .with_max(*limit_percent, recipe("surface.max_missing_percent"))
            }
            FitError::PoorFit { rms_mm, limit_mm, .. } => Check::new("residual of the surface, rms", "mm", *rms_mm)
                .with_max(*limit_mm, recipe("surface.max_rms_mm")),
            FitError::NoPoints
            | FitError::NoControlPoint { .. }
            | FitError::Undetermined { .. }
            | FitError::Fold { .. }
            | FitError::Surface(_)
            | FitError::Knots(_) => Check::new("the surface of the region", "", None),
        })
    }
}

/// Returns knots over the region only, because there may be no points outside of the region.
pub(super) fn thesis_knots(sides_mm: [f64; 2], spacing_mm: f64) -> Result<[KnotVector; 2], KnotError> {
    let along = |length_mm: f64| {
        let spans = (length_mm / spacing_mm).ceil().max(1.0) as usize;
        KnotVector::uniform(DEGREE, spans, 0.0..=1.0)
    };
    Ok([along(sides_mm[0])?, along(sides_mm[1])?])
}

/// Returns the scan's points that are used as control points; v is the fastest index.
pub(super) fn thesis_controls(panel: &TaughtPanel, knots: &[KnotVector; 2]) -> Result<Vec<Vector3<f64>>, FitError> {
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
