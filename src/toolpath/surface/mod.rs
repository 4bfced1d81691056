//! From a scan to a smooth surface: a least-squares B-spline over the taught region (thesis 4.5, 4.6).
//!
//! The thesis uses raw scan points as control points; such a surface contains the camera's noise and does not pass
//! through the scan. Here the control points minimise the surface's deviation from the scan, and the deviation is
//! reported. The thesis's method can be chosen for comparison. `today` corrects the surface by the scan in which
//! the panel was located, and `form` states its profile and flatness. `dwell` computes from executed or planned
//! poses how long the disc was on each point of the surface. This module does not know how paths are planned.

mod bspline;
pub mod dwell;
mod equations;
mod fit;
mod form;
mod map;
mod patch;
mod samples;
#[cfg(any(test, feature = "testing"))]
#[cfg_attr(feature = "testing", allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
pub mod scene;
#[cfg(test)]
mod tests;
mod today;

pub use bspline::{BSplineSurface, Derivatives, Parameter, PointTangents, SurfaceError};
pub use dwell::{AreaWeighted, DwellSpread};
pub use fit::{Deviation, Fit, Refusal, examine_fit, fit};
pub use form::{Flatness, Form, FormErrors, FormPlace, Measured, TodaysScan};
pub use map::{DeviationMap, Field, GridField, HoleMap, MapPixel};
pub use panelprep_base::geometry::basis::{Basis, KnotError, KnotVector, MAX_DEGREE, SpanFunctions, SpanValues};
pub use patch::{ParameterPatch, SampleGrid, Treated, sides_mm};
pub use samples::FitError;
pub use today::{TodayError, TodaysPoint, TodaysSurfaceFit, correct_taught_surface, todays_points};
