//! Point-to-point ICP, the thesis's method (3.8), only for comparison.
//!
//! Minimises  E(ᵇT_w) = Σ ‖p − ᵇT_w q‖²  over the pairs (p, q) of K, q taught and p scanned (3.21). Each step is the
//! motion that fits its pairs best (`geometry::fit_rigid_motion`). A smooth panel slides along itself under this cost:
//! the result is millimetres off, and the method does not report it. Source: thesis 3.8.

use super::correspond::{NeighbourTree, closest_pairs, distance_limit_mm};
use panelprep_base::geometry::{Base, Panel, Point, Rigid, fit_rigid_motion};

/// Pairs at this distance or less are never dropped, however good the fit is, mm.
const MIN_DROP_DISTANCE_MM: f64 = 5.0;
/// Smaller steps end the iteration, mm.
const SMALL_STEP_MM: f64 = 0.002;
const MAX_STEPS: usize = 100;

/// Moves taught points onto scanned ones from a start.
pub fn thesis_icp(
    taught: &[Point<Panel>],
    scanned: &[Point<Base>],
    start: Rigid<Base, Panel>,
) -> Rigid<Base, Panel> {
    let Some(tree) = NeighbourTree::from_points(scanned.iter().copied()) else { return start };
    let mut base_from_panel = start;
    for _ in 0..MAX_STEPS {
        let all = closest_pairs(&tree, taught, base_from_panel);
        let limit_mm = distance_limit_mm(&all, MIN_DROP_DISTANCE_MM);
        let near = all.iter().filter(|pair| pair.distance_mm <= limit_mm);
        let matched: Vec<_> = near.map(|pair| (pair.taught, scanned[pair.closest])).collect();
        let Some(next) = fit_rigid_motion(&matched) else { break };
        let step_mm = taught.iter().map(|&point| base_from_panel.distance_at_mm(next, point)).fold(0.0, f64::max);
        base_from_panel = next;
        if step_mm < SMALL_STEP_MM {
            break;
        }
    }
    base_from_panel
}
