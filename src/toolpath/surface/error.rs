//! The reason why a scan does not determine a surface, as text for the person who teaches.

use super::bspline::SurfaceError;
use panelprep_base::geometry::Pixel;
use panelprep_base::geometry::basis::{DEGREE, KnotError};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, LimitSource, Severity};

/// Smallest number of pixels that determine a pair of spans.
pub(super) const MIN_PIXELS: usize = (DEGREE + 1) * (DEGREE + 1);

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
        /// The recipe's spacing, mm.
        spacing_mm: f64,
        /// Number of pixels in the span with the fewest.
        pixels: usize,
        /// The span's middle in the taught picture.
        at: Pixel,
    },
    /// The scan has a hole.
    #[error(
        "the scan has a hole of {} mm at ({:.0}, {:.0}) px (limit {} mm, [surface] max_hole_mm); scan again or \
         move the region",
        distinguishable_texts(*size_mm, *limit_mm, 1)[0], at.u, at.v, distinguishable_texts(*size_mm, *limit_mm, 1)[1]
    )]
    Hole {
        /// The middle of the largest square without a point, in the taught picture.
        at: Pixel,
        /// Its side, mm.
        size_mm: f64,
        /// Side allowed, mm.
        limit_mm: f64,
    },
    /// The thesis's method needs a point at a position at which the scan has none.
    #[error(
        "the scan has no point at ({:.0}, {:.0}) px for a control point; scan again, or set [surface] method = \
         \"least-squares\"", at.u, at.v
    )]
    NoControlPoint {
        /// The place, in the taught picture.
        at: Pixel,
    },
    /// Too large a part of the region has no valid point.
    #[error(
        "{} % of the region has no point that fits the surface (limit {} %, [surface] max_missing_percent); scan \
         again",
        distinguishable_texts(*percent, *limit_percent, 1)[0], distinguishable_texts(*percent, *limit_percent, 1)[1]
    )]
    Missing {
        /// Share of missing points, percent.
        percent: f64,
        /// Largest valid share, percent.
        limit_percent: f64,
    },
    /// The points do not determine a control point.
    #[error("the scan does not determine the surface near ({:.0}, {:.0}) px; scan again", at.u, at.v)]
    Undetermined {
        /// The control point's position in the taught picture.
        at: Pixel,
    },
    /// The surface turns its back to the camera.
    #[error("the surface folds at ({:.0}, {:.0}) px: its normal turns away from the camera", at.u, at.v)]
    Fold {
        /// The place, in the taught picture.
        at: Pixel,
    },
    /// The deviation is too large.
    #[error(
        "the scan is {} mm rms off the surface (limit {} mm, [surface] max_rms_mm); its noise is {} mm; a smaller \
         control_spacing_mm follows a rougher panel", distinguishable_texts(*rms_mm, *limit_mm, 3)[0], distinguishable_texts(*rms_mm, *limit_mm, 3)[1],
        fixed_decimals(*noise_mm, 3)
    )]
    PoorFit {
        /// Deviation, mm.
        rms_mm: f64,
        /// Deviation allowed, mm.
        limit_mm: f64,
        /// White noise of the scan, mm.
        noise_mm: f64,
    },
    /// The control points do not form a surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The region gives no valid knots.
    #[error(transparent)]
    Knots(#[from] KnotError),
}

impl FitError {
    /// Returns the check that the scan does not meet, with its limit and the rejection that follows; if no limit is
    /// the cause, the check contains only the rejection.
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
