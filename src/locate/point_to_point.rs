//! Point-to-point ICP, the thesis's method (3.8): kept to be compared with, and for nothing else.
//!
//! Minimises  E(ᵇT_w) = Σ ‖p − ᵇT_w q‖²  over the pairs (p, q) of K, q taught and p scanned.                     (3.21)
//! With the centroids p̄, q̄ and the singular value decomposition U S Vᵀ = Σ (p − p̄)(q − q̄)ᵀ,
//!     R = U diag(1, 1, det(U Vᵀ)) Vᵀ,   t = p̄ − R q̄,                                                        (1)
//! where the determinant keeps R a rotation where the pairs would rather have a reflection.
//! A smooth panel slides along itself under this cost: it ends millimetres off, and does not say so.
//! Source: thesis 3.8; (1) from Umeyama, IEEE PAMI 13(4), 1991, without scale.

use super::correspond::{Tree, distance_limit_mm, pairs};
use crate::geometry::{Base, Panel, Point, Rigid, Vector};
use nalgebra::{Matrix3, Vector3};

/// Pairs at this distance or less are kept however good the fit is, mm.
const FLOOR_MM: f64 = 5.0;
/// Smaller steps end the iteration, mm.
const SMALL_STEP_MM: f64 = 0.002;
const MAX_STEPS: usize = 100;

/// Moves taught points onto scanned ones from a start.
pub fn thesis_icp(
    taught: &[Point<Panel>],
    scanned: &[Point<Base>],
    start: Rigid<Base, Panel>,
) -> Rigid<Base, Panel> {
    let Some(tree) = Tree::over(scanned.iter().copied()) else { return start };
    let mut base_from_panel = start;
    for _ in 0..MAX_STEPS {
        let all = pairs(&tree, taught, base_from_panel);
        let limit_mm = distance_limit_mm(&all, FLOOR_MM);
        let near = all.iter().filter(|pair| pair.distance_mm <= limit_mm);
        let matched: Vec<_> = near.map(|pair| (scanned[pair.closest], pair.taught)).collect();
        let Some(next) = umeyama(&matched) else { break };
        let step_mm = taught.iter().map(|&point| base_from_panel.distance_at_mm(next, point)).fold(0.0, f64::max);
        base_from_panel = next;
        if step_mm < SMALL_STEP_MM {
            break;
        }
    }
    base_from_panel
}

/// The rigid transform that brings the second points nearest to the first ones (Eq. 3.21); `None` for fewer than three
/// pairs or points on a line.
fn umeyama(matched: &[(Point<Base>, Point<Panel>)]) -> Option<Rigid<Base, Panel>> {
    let count = matched.len() as f64;
    let p_mean = matched.iter().map(|(p, _)| p.mm.coords).sum::<Vector3<f64>>() / count;
    let q_mean = matched.iter().map(|(_, q)| q.mm.coords).sum::<Vector3<f64>>() / count;
    let mut scatter = Matrix3::zeros();
    for (p, q) in matched {
        scatter += (p.mm.coords - p_mean) * (q.mm.coords - q_mean).transpose();
    }
    let svd = scatter.try_svd(true, true, f64::EPSILON, 0)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    // Three pairs span a plane; with a second singular value of nothing the turn about a line is free.
    if matched.len() < 3 || svd.singular_values[1] <= 1e-9 * svd.singular_values[0] {
        return None;
    }
    let mirror = Vector3::new(1.0, 1.0, (u * v_t).determinant().signum());
    let rotation = u * Matrix3::from_diagonal(&mirror) * v_t; // (1)
    let axes = [0, 1, 2].map(|i| Vector::new(rotation.column(i).into_owned()));
    Some(Rigid::from_axes(axes, Point::new((p_mean - rotation * q_mean).into())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use proptest::prelude::*;

    /// By hand: a quarter turn about Z and a shift of (10, 0, 0) send (1, 0, 0) to (10, 1, 0).
    #[test]
    fn a_quarter_turn_is_found() {
        let matched = [
            (Point::at(10.0, 0.0, 0.0), Point::at(0.0, 0.0, 0.0)),
            (Point::at(10.0, 1.0, 0.0), Point::at(1.0, 0.0, 0.0)),
            (Point::at(9.0, 0.0, 0.0), Point::at(0.0, 1.0, 0.0)),
        ];
        let moved = umeyama(&matched).expect("three points") * Point::at(2.0, 0.0, 5.0);
        assert!(moved.distance_mm(Point::at(10.0, 2.0, 5.0)) < 1e-9, "{moved:?}");
    }

    #[test]
    fn points_on_a_line_give_nothing() {
        let on_line = |i: f64| (Point::at(i, 2.0 * i, 0.0), Point::at(i, 2.0 * i, 0.0));
        assert!(umeyama(&[1.0, 2.0, 3.0, 4.0].map(on_line)).is_none());
        assert!(umeyama(&[]).is_none());
    }

    proptest! {
        /// Plane points leave the third singular vectors' sign free: without the determinant every other turn of these
        /// would come out as a reflection.
        #[test]
        fn a_plane_panel_is_never_mirrored(turn in prop::array::uniform3(-2.0..2.0f64), shift in prop::array::uniform3(-99.0..99.0f64)) {
            let truth: Rigid<Base, Panel> = Rigid::claim(Isometry3::new(shift.into(), turn.into()));
            let matched: Vec<_> = [(0.0, 0.0), (300.0, 0.0), (280.0, 200.0), (-20.0, 190.0)]
                .iter()
                .map(|&(y, z)| (truth * Point::at(560.0, y, z), Point::at(560.0, y, z)))
                .collect();
            let found = umeyama(&matched).expect("a plane");
            prop_assert!(found.distance_at_mm(truth, Point::at(700.0, 50.0, 80.0)) < 1e-8);
        }
    }
}
