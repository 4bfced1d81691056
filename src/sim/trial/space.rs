//! The space in which a trial's panel may be, and the points at which it is checked.

use crate::shape::Shape;
use nalgebra::Vector2;

/// The box that contains a trial's panel, mm in the base frame; the fixture lies behind it.
pub const TRIAL_BOX_MM: [[f64; 3]; 2] = [[250.0, -420.0, 10.0], [640.0, 420.0, 720.0]];

/// Returns points of the sheet on the panel, 8 mm apart.
pub(super) fn sheet_points(shape: &Shape) -> Vec<[f64; 2]> {
    let places = (-26..=26).flat_map(|j| (-26..=26).map(move |i| [f64::from(i) * 8.0, f64::from(j) * 8.0]));
    places.filter(|&at| shape.outline().distance(Vector2::from(at)).0 < 0.0).collect()
}
