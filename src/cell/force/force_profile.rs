//! The force for each part of a path.
//!
//! Waypoints are those of the plan, the first one in air. The robot reports how many of the others it has reached, and
//! is then on the leg from that waypoint to the next. Through the air and over a hole the tool is held back. On the
//! way down and up, with one end of the leg on the panel, it presses with the landing force. It also does so on the
//! last leg before it leaves, so that the force is reduced when the disc lifts off. Between these legs, it presses
//! with the recipe's force.

use serde::{Deserialize, Serialize};

/// The tool's task on a part of the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ForcePhase {
    /// The tool is held back.
    HeldBack,
    /// The tool lands or leaves, with the landing force.
    Landing,
    /// The tool presses with the recipe's force.
    Pressing,
}

/// Returns the tool's task on the leg that begins at this waypoint; `contact` states for each waypoint whether it is
/// on the panel.
pub fn force_phase(contact: &[bool], reached: usize) -> ForcePhase {
    let on = |index: usize| contact.get(index).copied().unwrap_or(false);
    match (on(reached), on(reached + 1)) {
        (false, false) => ForcePhase::HeldBack,
        (true, true) if on(reached + 2) => ForcePhase::Pressing,
        _ => ForcePhase::Landing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Calculated by hand: air, low, four on the panel, low, air. The tool is held back to the low point, lands on
    /// the way down and presses on two legs. It has the landing force on the last leg on the panel and on the way
    /// up, and is held back again.
    #[test]
    fn forces_follow_the_path() {
        let contact = [false, false, true, true, true, true, false, false];
        use ForcePhase::{HeldBack as H, Landing as L, Pressing as P};
        let aims: Vec<ForcePhase> = (0..9).map(|reached| force_phase(&contact, reached)).collect();
        assert_eq!(aims, [H, L, P, P, L, L, H, H, H]);
        assert_eq!(force_phase(&[], 0), H, "nothing is known of the plan");
    }

    proptest! {
        /// Never the recipe's force if either end of the leg, or the next leg's end, is off the panel.
        #[test]
        fn nothing_presses_beside_the_panel(contact in prop::collection::vec(any::<bool>(), 0..20), at in 0_usize..25) {
            let on = |index: usize| contact.get(index) == Some(&true);
            let presses = force_phase(&contact, at) == ForcePhase::Pressing;
            prop_assert_eq!(presses, on(at) && on(at + 1) && on(at + 2));
            prop_assert_eq!(force_phase(&contact, at) == ForcePhase::HeldBack, !on(at) && !on(at + 1));
        }
    }
}
