//! Finds how soon the sander was off and the disc lifted after a fault of the simulated tool, from the mock
//! controller's log.

use panelprep_devices::acf::PlannedToolFault;
use panelprep_devices::mock::{ContactSample, ExecutedMotion};
use serde_json::{Value, json};

/// The reaction to the fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AfterToolFault {
    /// Time from the fault until the tool's output was off, ms; `None` if it ran for as long as the disc was on the
    /// panel.
    pub off_ms: Option<u64>,
    /// Time from the fault until the retract began, or until the path left the panel, ms.
    pub lifted_ms: u64,
}

impl AfterToolFault {
    /// Computes the reaction from the executed waypoints and the tool's state at each tick of a contact. `None` if the
    /// path did not reach the waypoint of the fault, or nothing was in contact afterwards.
    pub fn compute(
        planned: PlannedToolFault,
        executed: &[ExecutedMotion],
        trace: &[ContactSample],
    ) -> Option<Self> {
        let mut touching = executed.iter().filter(|command| command.contact);
        let begun_ms = touching.nth(planned.from.checked_sub(1)? as usize)?.time_ms;
        let mut after = trace.iter().filter(|sample| sample.time_ms > begun_ms).peekable();
        // A later path of the same cycle begins after a gap in the samples.
        let mut before_ms = after.peek()?.time_ms;
        let path: Vec<&ContactSample> = after
            .take_while(|sample| sample.time_ms - std::mem::replace(&mut before_ms, sample.time_ms) < GAP_MS)
            .collect();
        let off = path.iter().find(|sample| !sample.tool_on);
        Some(AfterToolFault {
            off_ms: off.map(|sample| sample.time_ms - begun_ms),
            lifted_ms: path.last()?.time_ms - begun_ms,
        })
    }

    /// Returns a sentence for a person.
    pub fn describe_reaction(self) -> String {
        let off = self
            .off_ms
            .map_or("the sander was not switched off".to_owned(), |ms| format!("sander off after {ms} ms"));
        format!("{off}, disc lifted after {} ms", self.lifted_ms)
    }

    /// Returns the value for scripts.
    pub fn json(self) -> Value {
        json!({"off_ms": self.off_ms, "lifted_ms": self.lifted_ms})
    }
}

/// Samples with a longer gap between them belong to two contacts, ms.
const GAP_MS: u64 = 1_000;

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::{Joints, Rigid};
    use panelprep_devices::acf::ToolFault;

    fn executed(time_ms: u64, contact: bool) -> ExecutedMotion {
        let base_from_flange = Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity());
        ExecutedMotion { epoch: 3, id: 1, joints: Joints::default(), base_from_flange, time_ms, contact }
    }

    fn sample(time_ms: u64, tool_on: bool) -> ContactSample {
        let base_from_flange = Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity());
        let base_from_tool = Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity());
        ContactSample { time_ms, base_from_flange, base_from_tool, sanding: true, tool_on }
    }

    /// Calculated by hand: the second waypoint in contact ends at 200 ms; the sander is off at 310 ms and the last
    /// sample of this contact is at 420 ms.
    #[test]
    fn times_count_from_the_waypoint_at_which_the_fault_begins() {
        let planned = PlannedToolFault { fault: ToolFault::Silent, from: 2 };
        let log = [executed(50, false), executed(100, true), executed(200, true), executed(300, true)];
        let trace = [190, 205, 300, 310, 420, 5_000].map(|ms| sample(ms, ms < 310));
        let found = AfterToolFault::compute(planned, &log, &trace);
        assert_eq!(found, Some(AfterToolFault { off_ms: Some(110), lifted_ms: 220 }));
        let ran_on = trace.map(|one| ContactSample { tool_on: true, ..one });
        assert_eq!(
            AfterToolFault::compute(planned, &log, &ran_on),
            Some(AfterToolFault { off_ms: None, lifted_ms: 220 })
        );
        assert_eq!(AfterToolFault::compute(PlannedToolFault { from: 9, ..planned }, &log, &trace), None);
    }
}
