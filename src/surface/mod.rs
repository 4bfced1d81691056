//! From a scan to a smooth surface: a least-squares B-spline over the taught region (thesis 4.5, 4.6).
//!
//! The thesis uses raw scan points as control points; such a surface contains the camera's noise and does not pass
//! through the scan. Here the control points minimise the surface's deviation from the scan, and the deviation is
//! reported. The thesis's method can be chosen for comparison. `today` corrects the surface by the scan in which
//! the panel was located. `dwell` computes from executed or planned poses how long the disc was on each point of
//! the surface. This module does not know how paths are planned.

mod banded;
mod bspline;
mod derivatives;
pub mod dwell;
mod equations;
mod error;
mod field;
mod fit;
mod map;
mod net;
mod patch;
mod samples;
#[cfg(test)]
pub(crate) mod scene;
mod spans;
mod spread;
#[cfg(test)]
mod tests;
mod thesis;
mod today;

pub use crate::geometry::basis::{Basis, KnotError, KnotVector, Local, MAX_DEGREE, SpanFunctions};
pub use bspline::{BSplineSurface, SurfaceError};
pub use derivatives::{Derivatives, Parameter, Tangents};
pub use error::FitError;
pub use field::{Field, GridField};
pub use fit::{Deviation, Fit, Refusal, examine, fit};
pub use map::{DeviationMap, Holes, MapPixel};
pub use net::SampleGrid;
pub(crate) use net::sides_mm;
pub use patch::Patch;
pub use spread::{ByArea, Spread};
pub use today::{TodayError, Todays, TodaysPoint, todays, todays_points};
