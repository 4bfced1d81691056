//! Compares the base and tool frames that were sent with the frames that the controller reports.
//!
//! If a `set_base` is lost, the robot collides although every pose is plausible. So no linear motion is sent before the
//! controller's state shows, in this epoch, the frame that was set. The comparison uses rotations instead of the angles
//! A, B and C, because A and C are not unique near B = ±90°. The controller stores single-precision numbers: below 8 m
//! their rounding error is at most half of the tolerance, and for angles it is far smaller.

use crate::eki::ids::CommandId;
use crate::eki::report::EchoMismatch;
use panelprep_base::geometry::{Base, KukaPose, Tool};
use std::collections::VecDeque;

/// Maximum difference between the frame that was set and the active frame, mm and degrees.
const ECHO_TOLERANCE: f64 = 0.001;

/// The comparison of one frame, base or tool, with its value on the controller.
#[derive(Debug)]
pub(super) struct FrameEcho {
    frame: &'static str,
    /// The frame that is or should be active, followed by the frames that are queued after it.
    set: VecDeque<(CommandId, KukaPose)>,
    confirmed: CommandId,
}

impl FrameEcho {
    pub(super) fn new(frame: &'static str) -> Self {
        FrameEcho { frame, set: VecDeque::new(), confirmed: CommandId(0) }
    }

    pub(super) fn queued(&mut self, id: CommandId, pose: KukaPose) {
        self.set.push_back((id, pose));
    }

    /// Returns the last queued command that sets the frame. Linear motions that are queued after this command are not
    /// sent before the controller reports its frame.
    pub(super) fn last_queued(&self) -> Option<CommandId> {
        self.set.back().map(|&(id, _)| id)
    }

    /// Returns true if the controller's state has shown the frame of this command or of a subsequent one.
    pub(super) fn is_confirmed(&self, id: CommandId) -> bool {
        self.confirmed >= id
    }

    /// Compares the frame with a state of the controller in which all commands up to `done` are executed; `sent` is the
    /// last command that was sent.
    pub(super) fn compare_with_state(
        &mut self,
        done: CommandId,
        sent: CommandId,
        is_set: bool,
        found: KukaPose,
    ) -> Result<(), Box<EchoMismatch>> {
        // Only the last executed frame is active; it had replaced the earlier frames before the state was generated.
        while self.set.get(1).is_some_and(|&(next, _)| next <= done) {
            self.set.pop_front();
        }
        // While the controller changes to the next frame, the state may show the old frame or the new one.
        let changing = self.set.iter().any(|&(id, _)| id > done && id <= sent);
        let Some(&(id, sent)) = self.set.front().filter(|&&(id, _)| id <= done && !changing) else { return Ok(()) };
        let frame = self.frame;
        if !is_set {
            return Err(Box::new(EchoMismatch::NotSet { frame, id }));
        }
        let (distance_mm, turn_deg) = pose_difference(sent, found);
        if distance_mm <= ECHO_TOLERANCE && turn_deg <= ECHO_TOLERANCE {
            self.confirmed = id;
            Ok(())
        } else {
            Err(Box::new(EchoMismatch::Differs { frame, id, sent, found, distance_mm, turn_deg }))
        }
    }
}

/// Calculates the largest difference along an axis, mm, and the angle between the rotations, degrees.
fn pose_difference(one: KukaPose, other: KukaPose) -> (f64, f64) {
    let [one, other] = [one, other].map(|pose| pose.to_rigid::<Base, Tool>());
    let distance_mm = (one.origin() - other.origin()).mm.amax();
    (distance_mm, one.isometry().rotation.angle_to(&other.isometry().rotation).to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn echo(sent: KukaPose, found: KukaPose) -> bool {
        let mut echo = FrameEcho::new("base");
        echo.queued(CommandId(1), sent);
        echo.compare_with_state(CommandId(1), CommandId(1), true, found).is_ok() && echo.is_confirmed(CommandId(1))
    }

    /// At B = 90° a rotation depends only on C − A: (40, 90, 10) and (0, 90, −30) are the same rotation, and (0, 90,
    /// −30.01) is another.
    #[test]
    fn rotations_are_compared_and_not_angles() {
        let turned = |a_deg, b_deg, c_deg| KukaPose { a_deg, b_deg, c_deg, ..KukaPose::default() };
        assert!(echo(turned(40.0, 90.0, 10.0), turned(0.0, 90.0, -30.0)));
        assert!(echo(turned(180.0, 0.0, 0.0), turned(-180.0, 0.0, 0.0)));
        assert!(!echo(turned(40.0, 90.0, 10.0), turned(0.0, 90.0, -30.01)));
        assert!(!echo(turned(0.0, 0.0, 0.002), turned(0.0, 0.0, 0.0)));
    }

    /// In single precision 5678.123456 mm is 5678.12353515625 mm, which is accepted. A difference of 1.5 micrometres is
    /// another position.
    #[test]
    fn rounding_to_single_precision_is_no_difference() {
        let at = |x_mm| KukaPose { x_mm, ..KukaPose::default() };
        assert!(echo(at(5_678.123_456), at(5_678.123_535)));
        assert!(!echo(at(5_678.123_456), at(5_678.125)));
    }

    /// Base 1 is active and base 2 was sent: the state may show either of them, and neither is accepted as the echo of
    /// base 2.
    #[test]
    fn while_a_frame_changes_it_is_not_judged() {
        let at = |x_mm| KukaPose { x_mm, ..KukaPose::default() };
        let mut echo = FrameEcho::new("base");
        echo.queued(CommandId(1), at(1.0));
        echo.queued(CommandId(2), at(2.0));
        let (one, two) = (CommandId(1), CommandId(2));
        assert_eq!(echo.compare_with_state(one, two, true, at(1.0)), Ok(()));
        assert_eq!(echo.compare_with_state(one, two, true, at(2.0)), Ok(()));
        assert!(!echo.is_confirmed(one) && !echo.is_confirmed(two));
        assert!(echo.compare_with_state(two, two, true, at(1.0)).is_err());
        assert_eq!(echo.compare_with_state(two, two, true, at(2.0)), Ok(()));
        assert!(echo.is_confirmed(two));
    }
}
