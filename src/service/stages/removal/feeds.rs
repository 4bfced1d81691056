//! The feeds that recipe and controller allow on each move of a path, and the share of a scheduled path at these
//! limits.

use panelprep_cell::recipe;
use panelprep_toolpath::path::Waypoint;
use panelprep_toolpath::removal::schedule::Move;

/// Returns the moves in contact, with the feeds that recipe and controller allow on each.
pub fn contact_moves(all: &[Waypoint], asked: &recipe::Removal, settings: &recipe::Path) -> Vec<Move> {
    let planning_s = settings.planning_time_ms() / 1_000.0;
    let pairs = all.windows(2).enumerate().filter(|(_, pair)| pair[0].contact && pair[1].contact);
    pairs
        .map(|(index, pair)| {
            let length_mm = pair[0].panel_from_tool.origin().distance_mm(pair[1].panel_from_tool.origin());
            let high = settings.feed_mm_s().min(length_mm / planning_s);
            Move { pose: index + 1, length_mm, feeds_mm_s: [asked.min_feed_mm_s().min(high), high] }
        })
        .collect()
}

/// Shares of the path in contact on which the feed could not be scheduled as wanted, 0…1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct BoundShares {
    /// Value at `min_feed_mm_s`.
    pub(super) lowest: f64,
    /// Value at `feed_mm_s`.
    pub(super) highest: f64,
}

impl BoundShares {
    /// Computes the shares from a plan's waypoints. A move that is too short for the controller is not counted: its
    /// highest feed is not set by the recipe.
    pub(super) fn compute(all: &[Waypoint], asked: &recipe::Removal, settings: &recipe::Path) -> Self {
        let moves = contact_moves(all, asked, settings);
        let way_mm: f64 = moves.iter().map(|own| own.length_mm).sum();
        let share = |is_at: &dyn Fn(f64) -> bool| {
            let at = moves.iter().filter(|own| is_at(all[own.pose].feed_mm_s));
            at.map(|own| own.length_mm).sum::<f64>() / way_mm.max(f64::MIN_POSITIVE)
        };
        BoundShares {
            lowest: share(&|feed_mm_s| feed_mm_s <= asked.min_feed_mm_s() * (1.0 + FEED_TOLERANCE)),
            highest: share(&|feed_mm_s| feed_mm_s >= settings.feed_mm_s() * (1.0 - FEED_TOLERANCE)),
        }
    }
}

/// Feeds that differ by less than this share are the same.
const FEED_TOLERANCE: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::KukaPose;
    use panelprep_toolpath::surface::scene::{Shape, recipe};

    fn waypoint(x_mm: f64) -> Waypoint {
        let pose = KukaPose { x_mm, y_mm: 0.0, z_mm: 0.0, a_deg: 0.0, b_deg: 0.0, c_deg: 0.0 };
        Waypoint { panel_from_tool: pose.to_rigid(), contact: true, feed_mm_s: 60.0, blend_mm: 2.0 }
    }

    /// Calculated by hand: of four moves of 10 mm the first is at 5 mm/s, the lowest feed; the last two are at 60,
    /// the highest.
    #[test]
    fn the_shares_of_the_way_at_its_bounds() {
        let recipe = recipe(
            Shape::Sphere,
            "[path]\nfeed_mm_s = 60\n[removal]\ntarget_um = 30\nmax_um = 50\nforce_n = 20\nmin_feed_mm_s = 5\n",
        );
        let asked = recipe.removal().expect("stated");
        let feeds = [30.0, 5.0, 30.0, 60.0, 60.0];
        let at = |index: usize| Waypoint { feed_mm_s: feeds[index], ..waypoint(10.0 * index as f64) };
        let all: Vec<Waypoint> = (0..5).map(at).collect();
        let found = BoundShares::compute(&all, asked, recipe.path());
        assert_eq!(found, BoundShares { lowest: 0.25, highest: 0.5 });
        assert_eq!(BoundShares::compute(&[], asked, recipe.path()), BoundShares::default());
    }
}
