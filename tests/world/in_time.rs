//! Checks that the state machine performs its actions in time, from the true state of robot, controller and disk. The
//! cell must not work with a robot that is not ready, and must not wait endlessly for an answer. No cycle may continue
//! after a restart of the controller or with a full disk.

use super::disk;
use super::inside::Inside;
use panelprep::cycle::{Action, At, Id, Robot, State};

/// Maximum time for an answer that only needs a state of the controller, ms; `MAX_COMPUTED_ANSWER_MS` is the maximum
/// time for a computed answer.
const MAX_ANSWER_MS: u64 = 5_000 + 500;
const MAX_COMPUTED_ANSWER_MS: u64 = 60_000 + 500;
/// Maximum time until the loop must have detected that the robot cannot move, ms, and below it the number of checks of
/// the loop within this time.
const MAX_UNABLE_MS: u64 = 1_000;
const UNABLE_CHECKS: u32 = 20;
/// Maximum time until the cell is held because the disk is full, ms.
const MAX_HOLD_DELAY_MS: u64 = 1_500;

/// The observations of one process.
#[derive(Debug, Default)]
pub struct InTime {
    /// The expected answer, the time since which it is expected, and the total time of writes at that time, ms.
    due: Option<(Id, u64, u64)>,
    /// Time since which the controller cannot move the arm while a cycle is running, ms, and the number of checks since
    /// then.
    unable: Option<(u64, u32)>,
    /// The number of restarts of the controller when the cell was held, and whether the robot was disconnected since.
    held: Option<(u32, bool)>,
    /// Time since which the disk is full while a cycle is running, and the total time of writes at that time, ms.
    full: Option<(u64, u64)>,
    was_full: bool,
}

/// Returns whether the state moves the arm or leads to a motion.
fn is_working(at: At) -> bool {
    use At as A;
    matches!(at, A::Resetting | A::Starting | A::Execute(_) | A::Unholding { .. } | A::Completing { .. })
}

impl InTime {
    /// Checks the time limits at each state that the loop reports.
    pub fn look(&mut self, world: &mut Inside, state: &State) {
        self.answers(world, state);
        self.readiness(world, state);
        self.check_restarts(world, state);
        self.full_disk(world, state);
    }

    fn answers(&mut self, world: &mut Inside, state: &State) {
        let now_ms = world.now_ms();
        let Some(due) = state.due else { return self.due = None };
        if self.due.is_none_or(|(id, ..)| id != due.id) {
            self.due = Some((due.id, now_ms, world.written_ms));
        }
        let Some((_, since_ms, written_ms)) = self.due else { return };
        let most_ms = match due.act {
            Action::Move(_) | Action::Film => return,
            Action::CheckStandstill
            | Action::OpenEpoch { .. }
            | Action::EndEpoch { .. }
            | Action::SetFrames(_)
            | Action::Switch(_) => MAX_ANSWER_MS,
            _ => MAX_COMPUTED_ANSWER_MS,
        };
        world.counts.judged("answers in time");
        let waited_ms = now_ms - since_ms - (world.written_ms - written_ms).min(now_ms - since_ms);
        if waited_ms > most_ms {
            world.wrong("answers in time", format!("{:?} has no answer after {waited_ms} ms", due.act));
        }
    }

    fn readiness(&mut self, world: &mut Inside, state: &State) {
        let robot = state.facts.robot;
        world.counts.judged("a robot that is not ready");
        if is_working(state.at) && !matches!(robot, Robot::Ready | Robot::Unknown) {
            world.wrong("a robot that is not ready", format!("{:?} with the robot {robot:?}", state.at));
        }
        let now_ms = world.now_ms();
        // While the client is stalled, the cell does not receive the report that the controller cannot move the arm.
        let hears = now_ms > world.cell.client_stalls_until_ms;
        if world.cell.controller.can_move() || !is_working(state.at) || world.is_strange() || !hears {
            self.unable = None;
            return;
        }
        let (since_ms, looks) = self.unable.get_or_insert((now_ms, 0));
        *looks += 1;
        if now_ms > *since_ms + MAX_UNABLE_MS && *looks > UNABLE_CHECKS {
            let what = format!("{:?}, and since {since_ms} ms the controller cannot move the arm", state.at);
            world.wrong("a robot that is not ready", what);
        }
    }

    /// Checks that a held cycle does not continue after a restart of the controller, because the controller then knows
    /// nothing about the held cell.
    fn check_restarts(&mut self, world: &mut Inside, state: &State) {
        if !matches!(state.at, At::Held(_)) {
            self.held = None;
            return;
        }
        let reboots = world.truth.reboots;
        let (before, was_gone) = self.held.get_or_insert((reboots, false));
        let is_ready = state.facts.robot == Robot::Ready;
        *was_gone |= *before < reboots && !is_ready;
        // The controller may have reported a wrong number of restarts.
        if *was_gone && is_ready && world.oracles.strange_epoch == 0 {
            world.wrong("a controller's start", format!("{:?} outlives a start of the controller", state.at));
        }
        world.counts.judged("a controller's start");
    }

    /// Records the first time at which a process detects that its disk is full.
    fn full_disk(&mut self, world: &mut Inside, state: &State) {
        let works = matches!(state.at, At::Execute(_) | At::Unholding { .. });
        let is_new = disk::was_full() && !std::mem::replace(&mut self.was_full, disk::was_full());
        if is_new && works {
            self.full = Some((world.now_ms(), world.written_ms));
        }
        let Some((since_ms, written_ms)) = self.full.filter(|_| works) else { return self.full = None };
        world.counts.judged("a full disk");
        if world.now_ms() > since_ms + MAX_HOLD_DELAY_MS + (world.written_ms - written_ms) {
            let what =
                format!("the disk was found full at {since_ms} ms, and the cell continues in {:?}", state.at);
            world.wrong("a full disk", what);
        }
    }
}
