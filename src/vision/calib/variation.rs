//! Poses of the flange around a first pose from which a camera sees the board, for the first estimate of a mount.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Degrees, Flange, Rigid};

/// The poses around the first pose: rotations about X, Y and Z of the flange, degrees, and shifts, mm.
const POSE_VARIATIONS: [([f64; 3], [f64; 3]); 14] = [
    ([18.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ([-18.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ([0.0, 18.0, 0.0], [0.0, 0.0, 0.0]),
    ([0.0, -18.0, 0.0], [0.0, 0.0, 0.0]),
    ([0.0, 0.0, 30.0], [0.0, 0.0, 0.0]),
    ([0.0, 0.0, -30.0], [0.0, 0.0, 0.0]),
    ([12.0, 12.0, 20.0], [0.0, 0.0, 20.0]),
    ([-12.0, 12.0, -20.0], [0.0, 0.0, -20.0]),
    ([12.0, -12.0, 0.0], [25.0, 0.0, 0.0]),
    ([-12.0, -12.0, 0.0], [0.0, 25.0, 0.0]),
    ([8.0, 0.0, 15.0], [-25.0, 0.0, 0.0]),
    ([0.0, 8.0, -15.0], [0.0, -25.0, 0.0]),
    ([-8.0, 0.0, 45.0], [0.0, 0.0, 0.0]),
    ([0.0, -8.0, -45.0], [0.0, 0.0, 0.0]),
];

/// Returns poses around the first one: rotated about the board, at the distance `about_mm` in front of the flange, and
/// shifted.
pub fn poses_around(first: Rigid<Base, Flange>, about_mm: f64) -> impl Iterator<Item = Rigid<Base, Flange>> {
    POSE_VARIATIONS.iter().map(move |change| vary_pose(&first, about_mm, change))
}

/// Returns the flange's pose, rotated about a point at the distance `about_mm` in front of it, and shifted.
fn vary_pose(
    base_from_flange: &Rigid<Base, Flange>,
    about_mm: f64,
    (turn_deg, shift_mm): &([f64; 3], [f64; 3]),
) -> Rigid<Base, Flange> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn_deg.map(|deg| Degrees(deg).to_rad())));
    let about = Translation3::new(0.0, 0.0, about_mm);
    let moved: Isometry3<f64> = Translation3::from(Vector3::from(*shift_mm)) * about * turn * about.inverse();
    *base_from_flange * Rigid::<Flange, Flange>::from_isometry_unchecked(moved)
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::Point;

    /// A rotation by 90° about Z, with the point at 100 mm, leaves the flange at its position; a rotation by 90° about
    /// X moves it to the side of that point.
    #[test]
    fn the_flange_is_rotated_about_the_board() {
        let start: Rigid<Base, Flange> = Rigid::from_isometry_unchecked(Isometry3::translation(500.0, 0.0, 300.0));
        let at = |turn_deg, shift_mm| {
            let moved = vary_pose(&start, 100.0, &(turn_deg, shift_mm));
            (moved * Point::<Flange>::at(0.0, 0.0, 0.0)).mm
        };
        let near = |a: nalgebra::Point3<f64>, b: [f64; 3]| (a - nalgebra::Point3::from(b)).norm() < 1e-9;
        assert!(near(at([0.0, 0.0, 90.0], [0.0; 3]), [500.0, 0.0, 300.0]));
        assert!(near(at([90.0, 0.0, 0.0], [0.0; 3]), [500.0, 100.0, 400.0]));
        assert!(near(at([0.0; 3], [1.0, 2.0, 3.0]), [501.0, 2.0, 303.0]));
        let board =
            vary_pose(&start, 100.0, &([20.0, -30.0, 40.0], [0.0; 3])) * Point::<Flange>::at(0.0, 0.0, 100.0);
        assert!(near(board.mm, [500.0, 0.0, 400.0]), "the point itself stays: {board:?}");
    }
}
