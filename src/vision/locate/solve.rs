//! One Gauss–Newton step for all constraints of the panel: its surface, its outline and its marks.
//!
//! A constraint is a small signed residual r of a point p of the panel along a gradient g: along the normal of the
//! surface, in mm, or across the outline in the picture, in px. A twist ξ = (ω, v) about the centre c moves p by ω × (p
//! − c) + v, so that
//!     J = [ ((p − c) × g)ᵀ  gᵀ ],   (Σ w JᵀJ) ξ = −Σ w Jᵀ r.                                              (1)
//! The weights are Tukey's (Beaton & Tukey, Technometrics 16, 1974), divided by the variance of a constraint and by the
//! number of neighbours with a common error. Sums are calculated over fixed chunks in their order, so that they are
//! bit-identical for any number of threads.

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};
use panelprep_base::geometry::statistics::{SIGMA_OF_MEDIAN, tukey_weight_within};
use panelprep_base::geometry::{Camera, Panel, Rigid, median};
use rayon::prelude::*;

/// Number of constraints that one task sums.
const CHUNK_SIZE: usize = 1_024;
/// Minimum conditioning of each component of the twist: the ratio of its information if the other components are
/// unknown to its information if they are known.
const MIN_CONDITION: f64 = 1e-9;

/// A residual with its gradient.
#[derive(Debug, Clone, Copy)]
pub(super) struct Constraint {
    /// The point in the camera frame, mm.
    pub point: Vector3<f64>,
    /// Gradient of the residual with respect to the position of the point, per mm.
    pub gradient: Vector3<f64>,
    /// The residual, mm or px.
    pub residual: f64,
    /// Index of the taught sample of the constraint.
    pub sample: usize,
}

impl Constraint {
    /// Returns the Jacobian J of (1).
    pub fn jacobian(&self, centre: &Vector3<f64>) -> Vector6<f64> {
        let arm = (self.point - centre).cross(&self.gradient);
        let g = self.gradient;
        Vector6::new(arm.x, arm.y, arm.z, g.x, g.y, g.z)
    }
}

/// The weighting of constraints of one kind.
#[derive(Debug, Clone, Copy)]
pub(super) struct ResidualWeighting {
    /// Standard deviation of a residual.
    pub sigma: f64,
    /// Number of neighbours whose errors are correlated.
    pub correlated_count: f64,
    /// Cutoff: larger residuals have no weight.
    pub cutoff: f64,
}

impl ResidualWeighting {
    /// Returns Tukey's weight of a residual, 0…1.
    pub fn tukey_weight(&self, residual: f64) -> f64 {
        tukey_weight_within(residual / self.cutoff)
    }

    pub fn weight(&self, residual: f64) -> f64 {
        self.tukey_weight(residual) / (self.sigma * self.sigma * self.correlated_count)
    }
}

/// The sums of (1).
#[derive(Debug, Clone, Copy)]
pub(super) struct ResidualSums {
    pub information: Matrix6<f64>,
    pub gradient: Vector6<f64>,
}

impl ResidualSums {
    pub const ZERO: ResidualSums =
        ResidualSums { information: Matrix6::from_array_storage(ZERO_6), gradient: ZERO_1 };

    /// Calculates the sums over constraints of one kind.
    pub fn from_constraints(
        constraints: &[Constraint],
        weighing: &ResidualWeighting,
        centre: &Vector3<f64>,
    ) -> ResidualSums {
        let chunk = |chunk: &[Constraint]| {
            let mut sums = ResidualSums::ZERO;
            for constraint in chunk {
                let weight = weighing.weight(constraint.residual);
                if weight > 0.0 {
                    let j = constraint.jacobian(centre);
                    let weighted = j * weight;
                    sums.information.ger(1.0, &weighted, &j, 1.0);
                    sums.gradient += weighted * constraint.residual;
                }
            }
            sums
        };
        if constraints.len() <= CHUNK_SIZE {
            return chunk(constraints);
        }
        // The partial sums are collected and then added in order: a sum of floating-point numbers must not depend on
        // which thread is first, or a replay would differ.
        constraints
            .par_chunks(CHUNK_SIZE)
            .map(chunk)
            .collect::<Vec<_>>()
            .into_iter()
            .fold(ResidualSums::ZERO, ResidualSums::add)
    }

    pub fn add(self, other: ResidualSums) -> ResidualSums {
        ResidualSums { information: self.information + other.information, gradient: self.gradient + other.gradient }
    }

    /// Returns the twist of (1); `None` if a direction is unconstrained.
    pub fn twist(&self) -> Option<Vector6<f64>> {
        let inverse = self.information.try_inverse()?;
        // By rounding alone a matrix can have an inverse; a direction without information must be reported as
        // unconstrained, and not give a huge step.
        let held = (0..6).all(|i| 1.0 / inverse[(i, i)] > MIN_CONDITION * self.information[(i, i)]);
        let cholesky = held.then(|| self.information.cholesky()).flatten()?;
        let twist = -cholesky.solve(&self.gradient);
        twist.iter().all(|part| part.is_finite()).then_some(twist)
    }
}

const ZERO_6: nalgebra::ArrayStorage<f64, 6, 6> = nalgebra::ArrayStorage([[0.0; 6]; 6]);
const ZERO_1: Vector6<f64> = Vector6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]]));

/// Returns the median absolute residual, scaled to the standard deviation of a normal distribution.
pub(super) fn spread(constraints: &[Constraint]) -> f64 {
    let mut sizes: Vec<f64> = constraints.iter().map(|constraint| constraint.residual.abs()).collect();
    SIGMA_OF_MEDIAN * median(&mut sizes).unwrap_or(0.0)
}

/// Applies a small rotation about a point and a small shift to the transform, both in the camera frame.
pub(super) fn apply_twist(
    camera_from_panel: &Rigid<Camera, Panel>,
    centre: &Vector3<f64>,
    twist: &Vector6<f64>,
) -> Rigid<Camera, Panel> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(twist[0], twist[1], twist[2]));
    let shift = Vector3::new(twist[3], twist[4], twist[5]);
    // The rotation is about the centre of the panel and not about the camera: otherwise a small rotation would also
    // shift the panel by metres times its angle, and the two could hardly be separated.
    let moved: Rigid<Camera, Camera> = Rigid::from_isometry_unchecked(Isometry3::from_parts(
        Translation3::from(centre + shift - turn * centre),
        turn,
    ));
    moved * *camera_from_panel
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEIGHING: ResidualWeighting = ResidualWeighting { sigma: 0.1, correlated_count: 1.0, cutoff: 1e9 };

    /// Expected value, calculated by hand: rotated by 0.001 rad about z at (560, 0, 700), a point with an offset of 100
    /// mm in y moves by −0.1 mm in x.
    #[test]
    fn a_twist_rotates_about_the_centre() {
        let twist = Vector6::new(0.0, 0.0, 0.001, 0.0, 0.0, 0.5);
        let start: Rigid<Camera, Panel> = Rigid::from_isometry_unchecked(Isometry3::identity());
        let moved = apply_twist(&start, &Vector3::new(560.0, 0.0, 700.0), &twist);
        let point = (moved * panelprep_base::geometry::Point::at(560.0, 100.0, 700.0)).mm.coords;
        assert!((point - Vector3::new(559.9, 100.0, 700.5)).norm() < 1e-4, "{point}");
    }

    /// A plane of 5 × 5 points, moved by a known twist. If the outline constrains the plane sideways, (1) inverts the
    /// twist in one step; without an outline, (1) reports a free direction.
    #[test]
    fn one_step_undoes_a_small_twist() {
        let centre = Vector3::new(20.0, -10.0, 700.0);
        let place =
            |i: usize| centre + Vector3::new((i % 5) as f64 * 40.0 - 80.0, (i / 5) as f64 * 30.0 - 60.0, 0.0);
        let twist = Vector6::new(2e-4, -1e-4, 3e-4, 0.3, -0.2, 0.1);
        let constraint = |i: usize, normal: Vector3<f64>| {
            let arm = place(i) - centre;
            let moved = twist.fixed_rows::<3>(0).cross(&arm) + twist.fixed_rows::<3>(3);
            Constraint { point: place(i), gradient: normal, residual: normal.dot(&moved), sample: i }
        };
        let surface: Vec<_> = (0..25).map(|i| constraint(i, -Vector3::z())).collect();
        let side = |i: usize| if i.is_multiple_of(5) || i % 5 == 4 { Vector3::x() } else { Vector3::y() };
        let outline: Vec<_> =
            (0..25).filter(|i| i % 5 == 0 || i % 5 == 4 || i / 5 == 0).map(|i| constraint(i, side(i))).collect();
        let of_surface = ResidualSums::from_constraints(&surface, &WEIGHING, &centre);
        let both = of_surface.add(ResidualSums::from_constraints(&outline, &WEIGHING, &centre));
        let back = both.twist().expect("held");
        assert!((back + twist).norm() < 1e-9, "{back}");
        assert_eq!(of_surface.twist(), None);
    }

    /// Expected values, calculated by hand: at half of its cutoff a residual has (1 − ¼)² = 0.5625 of its weight; at
    /// the cutoff it has no weight.
    #[test]
    fn far_residuals_have_no_weight() {
        let weighing = ResidualWeighting { sigma: 0.5, correlated_count: 4.0, cutoff: 2.0 };
        assert!((weighing.weight(1.0) - 0.5625).abs() < 1e-12);
        assert_eq!((weighing.weight(2.0), weighing.weight(f64::NAN)), (0.0, 0.0));
    }
}
