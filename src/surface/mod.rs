//! From a scan to a smooth surface: a least-squares B-spline over the taught region (thesis 4.5, 4.6).
//!
//! Raw scan points as control points, as the thesis has it, keep the camera's noise and miss the surface; here the
//! control points are those whose surface deviates least from the scan, and the deviation is stated. Does not know
//! tools or paths.

mod banded;
mod basis;
mod bspline;
mod fit;
mod patch;
mod samples;
#[cfg(test)]
pub(crate) mod scene;
#[cfg(test)]
mod tests;

pub use basis::{Basis, KnotError, KnotVector, Local, MAX_DEGREE};
pub use bspline::{BSplineSurface, Derivatives, Parameter, SurfaceError, Tangents};
pub use fit::{Deviation, Fit, FitError, fit};
pub use patch::Patch;
