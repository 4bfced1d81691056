//! Compares the paths in contact, as the mock controller executed them, with the store's record of them.

use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Outcome as Ended, Path};
use panelprep_cell::record::MotionRecord;
use panelprep_devices::mock::ExecutedMotion;

/// Returns the contact paths of which at least one waypoint was executed.
pub(super) fn contact(motions: &[MotionRecord]) -> impl Iterator<Item = &MotionRecord> {
    motions.iter().filter(|record| record.motion.path == Path::Contact && record.done > 0)
}

/// The contact paths as the controller executed them, one for each in the store, in order.
///
/// A path is a run of commands with consecutive ids: a speed is set before each and an output is switched after it.
///
/// # Errors
/// If a command was executed twice, or a path has more or fewer waypoints than were sent and acknowledged.
pub(super) fn contact_runs<'a>(
    motions: &[MotionRecord],
    executed: &'a [ExecutedMotion],
) -> Result<Vec<&'a [ExecutedMotion]>, Reason> {
    let lost = |message: String| Reason::new("waypoints", message);
    let mut ids: Vec<(i32, i32)> = executed.iter().map(|command| (command.epoch, command.id)).collect();
    ids.sort_unstable();
    if let Some(pair) = ids.windows(2).find(|pair| pair[0] == pair[1]) {
        let (epoch, id) = pair[0];
        return Err(lost(format!("command {id} of epoch {epoch} was executed twice")));
    }
    let follows =
        |before: &ExecutedMotion, after: &ExecutedMotion| before.epoch == after.epoch && after.id == before.id + 1;
    let touches = |run: &&[ExecutedMotion]| run.iter().any(|command| command.contact);
    let runs: Vec<&[ExecutedMotion]> = executed.chunk_by(follows).filter(touches).collect();
    let contact: Vec<&MotionRecord> = contact(motions).collect();
    if runs.len() != contact.len() {
        let message = format!("{} paths in contact were executed, {} were sent", runs.len(), contact.len());
        return Err(lost(message));
    }
    for (run, motion) in runs.iter().zip(contact) {
        let (sent, done) = (motion.motion.waypoints, motion.done);
        let is_whole = motion.outcome == Some(Ended::Done);
        let max_done = if is_whole { done } else { done + ON_THEIR_WAY };
        if !(done as usize..=max_done as usize).contains(&run.len())
            || (is_whole && done != sent)
            || run.first().map(|one| one.epoch) != Some(motion.motion.epoch as i32)
        {
            let message = format!(
                "path of {sent} waypoints in epoch {}: the controller executed {} waypoints, {done} were acknowledged",
                motion.motion.epoch,
                run.len()
            );
            return Err(lost(message));
        }
    }
    Ok(runs)
}

/// Largest number of acknowledgements of a path that were in transit when its epoch ended early.
const ON_THEIR_WAY: u32 = 2;

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::{Base, Flange, Joints, Rigid};
    use panelprep_cell::cycle::Motion;

    fn command(id: i32, contact: bool) -> ExecutedMotion {
        let base_from_flange: Rigid<Base, Flange> = Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity());
        ExecutedMotion { epoch: 3, id, joints: Joints::default(), base_from_flange, time_ms: id as u64, contact }
    }

    fn motion(waypoints: u32, done: u32) -> MotionRecord {
        let motion = Motion { epoch: 3, path: Path::Contact, plan: 7, waypoints };
        let outcome = Some(if done == waypoints { Ended::Done } else { Ended::Held });
        MotionRecord { motion, outcome, done, contact: None }
    }

    /// Ids 5 to 8 are a contact path with a part in the air; 2 and 11 are motions in the air.
    #[test]
    fn each_waypoint_is_executed_and_acknowledged_once() {
        let log = [(2, false), (5, true), (6, false), (7, true), (8, false), (11, false)];
        let log = log.map(|(id, contact)| command(id, contact));
        let runs = contact_runs(&[motion(4, 4)], &log).expect("whole");
        assert_eq!(runs.len(), 1);
        assert_eq!(runs[0].iter().map(|one| one.id).collect::<Vec<_>>(), [5, 6, 7, 8]);
        let held = contact_runs(&[motion(9, 4)], &log).expect("the rest was never executed");
        assert_eq!(held[0].len(), 4);
        // The last acknowledgements were still in transmission when the path was ended.
        assert!(contact_runs(&[motion(9, 2)], &log).is_ok());
        let wrong = |motions: &[MotionRecord], log: &[ExecutedMotion]| {
            contact_runs(motions, log).expect_err("wrong").message
        };
        assert!(wrong(&[motion(5, 5)], &log).contains("executed 4 waypoints, 5 were acknowledged"));
        assert!(wrong(&[motion(3, 3)], &log).contains("executed 4 waypoints, 3"));
        assert!(wrong(&[motion(9, 1)], &log).contains("executed 4 waypoints, 1"));
        assert!(wrong(&[motion(9, 5)], &log).contains("executed 4 waypoints, 5"));
        assert!(wrong(&[], &log).contains("1 paths in contact were executed, 0 were sent"));
        assert!(wrong(&[motion(4, 4), motion(4, 4)], &log).contains("2 were sent"));
        let twice = [log[0], log[1], log[2], log[2], log[3], log[4]];
        assert!(wrong(&[motion(4, 4)], &twice).contains("command 6 of epoch 3 was executed twice"));
    }
}
