//! From a scan to a smooth surface: a least-squares B-spline over the taught region (thesis 4.5, 4.6).
//!
//! Raw scan points as control points, as the thesis has it, keep the camera's noise and miss the surface; here the
//! control points are those whose surface deviates least from the scan, and the deviation is stated. The thesis's own way
//! can be chosen, to compare. What a disc did to the surface is told of poses alone (`dwell`). Does not know how paths are planned.

mod banded;
mod basis;
mod bspline;
mod derivatives;
pub mod dwell;
mod equations;
mod error;
mod fit;
mod map;
mod patch;
mod samples;
#[cfg(test)]
pub(crate) mod scene;
mod spans;
mod spread;
#[cfg(test)]
mod tests;
mod thesis;

pub use basis::{Basis, KnotError, KnotVector, Local, MAX_DEGREE, SpanFunctions};
pub use bspline::{BSplineSurface, SurfaceError};
pub use derivatives::{Derivatives, Parameter, Tangents};
pub use error::FitError;
pub use fit::{Deviation, Fit, Refusal, examine, fit};
pub use map::{DeviationMap, Holes, MapPixel};
pub use patch::Patch;
pub use spread::Spread;
