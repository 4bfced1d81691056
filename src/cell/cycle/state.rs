//! The state of the cycle.

use super::{Action, Facts, Id, Motion, Robot, Trouble};
use panelprep_base::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// All data that the state table keeps between events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct State {
    /// The PackML state, with the phase inside Execute.
    pub at: At,
    /// The cycle in progress, or the last cycle.
    pub job: Job,
    /// The facts that the cell has reported.
    pub facts: Facts,
    /// The action in progress, if there is one.
    pub due: Option<Due>,
    /// The motion that was started and for which the robot has not reported standstill yet.
    pub intent: Option<Intent>,
    /// The number of the last epoch that was opened.
    pub epoch: u32,
    /// The last id that was assigned.
    pub last_id: Id,
    /// Number of dropped reports, which belonged to no effect in progress.
    pub dropped: u64,
    /// Number of changes of `at`. A person's decision is based on the state shown at one step.
    pub step: u64,
}

impl State {
    /// The state of a new store, before its first event.
    pub const INITIAL: State = State {
        at: At::Stopped,
        job: Job {
            running: false,
            air: false,
            dries: false,
            max_passes: 0,
            max_moves: 0,
            pass: 0,
            after_dry: Phase::Wet,
            plan: 0,
            waypoints: 0,
            verified: 0,
        },
        facts: Facts::UNKNOWN,
        due: None,
        intent: None,
        epoch: 0,
        last_id: Id(0),
        dropped: 0,
        step: 0,
    };
}

/// The PackML states, with their data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "lowercase")]
pub enum At {
    /// At rest; Reset leads to Idle.
    Stopped,
    /// All outputs are switched off, and a self-test is performed, without motion.
    Resetting,
    /// Ready for the request Start.
    Idle,
    /// The arm moves to its park pose before the first phase.
    Starting,
    /// A phase of the cycle is executed.
    Execute(Phase),
    /// On the way to Held: the water is switched off and the epoch is ended.
    Holding(Hold),
    /// At rest inside a cycle.
    Held(Hold),
    /// On the way from Held back to Execute.
    Unholding {
        /// The phase in which the cycle continues.
        resume: Phase,
        /// Whether the panel's pose must be verified first.
        verify: bool,
    },
    /// The arm moves to its park pose, and all outputs are switched off.
    Completing {
        /// The cycle's verdict.
        verdict: Verdict,
    },
    /// The cycle has ended.
    Complete {
        /// The verdict of the cycle.
        verdict: Verdict,
    },
    /// On the way to Stopped: the water is switched off and the epoch is ended.
    Stopping {
        /// The deadline for the complete stop.
        until: Id,
    },
    /// On the way to Aborted, no matter how the abort frame is answered. The frame is sent immediately; it also
    /// switches the water off.
    Aborting {
        /// The cause of the abort.
        cause: Cause,
    },
    /// At rest after an abort; only Clear leads to Stopped.
    Aborted {
        /// The cause of the abort.
        cause: Cause,
    },
    /// A person has removed the cause: the robot's standstill is queried, and tool and water are confirmed to be off.
    Clearing {
        /// The cause of the abort.
        cause: Cause,
    },
}

impl At {
    /// Returns the PackML name of the state, on which users' scripts rely.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns whether no work is in progress, so that the process may end.
    pub fn is_at_rest(self) -> bool {
        matches!(self, At::Stopped | At::Idle | At::Held(_) | At::Complete { .. } | At::Aborted { .. })
    }
}

/// The phases inside Execute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "lowercase")]
pub enum Phase {
    /// A 3D shot of the dry panel is captured, and the panel's pose is determined.
    Locate,
    /// The corner loop: corner pictures are captured to refine the panel's pose.
    Refine {
        /// Number of motions to corner poses so far.
        moves: u8,
    },
    /// The reference picture of the dry panel is captured.
    Dry,
    /// The panel is sprayed.
    Wet,
    /// The film is observed and evaluated.
    Inspect,
    /// A path over the failed grids is planned.
    Plan,
    /// A corner picture is captured immediately before contact, to verify the panel's pose.
    Verify,
    /// Approach, tool on, contact path.
    Abrade,
    /// Tool off in the air, then a motion away from the panel.
    Retract,
    /// The result of the contact path is graded, before anything else is done to the panel.
    Assess {
        /// Whether the path was interrupted, so that the rest must still be planned.
        left: bool,
    },
    /// The dust is rinsed off.
    Rinse,
}

impl Phase {
    /// Returns the name of the phase, on which users' scripts rely.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns the phase that follows when a person accepts the result of this phase.
    pub(super) fn phase_after_accept(self) -> Phase {
        match self {
            Phase::Assess { left: true } => Phase::Plan,
            Phase::Assess { left: false } => Phase::Rinse,
            other => other,
        }
    }
}

/// The reason of a hold, and where the cycle is resumed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Hold {
    /// Reason of the hold.
    pub why: Why,
    /// The phase in which the cycle is resumed; an interrupted path is planned again.
    pub resume: Phase,
}

impl Hold {
    /// Returns whether a person must review the result of a contact path. A new localization does not replace this
    /// review.
    pub fn is_for_contact(self) -> bool {
        matches!(self, Hold { why: Why::Review, resume: Phase::Assess { .. } })
    }
}

/// The reason why a cycle is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Why {
    /// A person requested it.
    Asked,
    /// A person must review a result.
    Review,
    /// Verify failed: a person must dry the panel and confirm that it is dry, or try again.
    NotVerified,
    /// The localization became too old during contact.
    TokenOver,
    /// After the rinse: a person must dry the panel and confirm that it is dry, so that a new dry picture can be
    /// captured.
    Drying,
    /// A fault that a person can correct.
    Trouble(Trouble),
}

/// The reason why a cycle was aborted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// A person requested it.
    Asked,
    /// The robot's condition does not permit a cycle.
    Robot(Robot),
    /// A fault during the cycle.
    Trouble(Trouble),
    /// A stop exceeded its time limit.
    StopTimedOut,
    /// The program ended during a motion.
    Interrupted,
    /// The store does not contain what the program last wrote.
    StoreChanged,
    /// The store was restored from a backup: the cell's actions after the backup are missing.
    StoreRestored,
    /// The program ended while the tool or the water was on.
    OutputsOn,
}

impl Cause {
    /// Returns the cause of the abort after the robot has changed to this condition. An emergency stop replaces every
    /// cause except a changed or restored store. Any other condition replaces a fault, which may be its consequence:
    /// for example, a command is refused because the drives are off.
    pub(super) fn merged_with_robot(self, robot: Robot) -> Cause {
        let by_robot = Cause::Robot(robot);
        match (self, robot) {
            (_, Robot::Ready | Robot::Unknown) | (Cause::StoreChanged | Cause::StoreRestored, _) => self,
            (_, Robot::EmergencyStop) => by_robot,
            (Cause::Trouble(_) | Cause::StopTimedOut, _) => by_robot,
            _ => self,
        }
    }
}

/// The limits and counters of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Job {
    /// Whether the cycle has begun and has no verdict yet.
    pub running: bool,
    /// Whether the cycle is an air-run, which does not touch the panel.
    pub air: bool,
    /// Whether a person dries the panel after each sanding pass, so that a new dry picture is the reference of the next
    /// film.
    pub dries: bool,
    /// Maximum number of sanding passes.
    pub max_passes: u8,
    /// Maximum number of motions to corner poses in the corner loop.
    pub max_moves: u8,
    /// Number of sanding passes so far, including the planned one.
    pub pass: u8,
    /// The phase after the dry picture: Wet or, after a new localization, the phase that was interrupted.
    pub after_dry: Phase,
    /// The number of the last plan.
    pub plan: u64,
    /// Number of waypoints of the last plan.
    pub waypoints: u32,
    /// Number of corners that the Verify in progress has seen at their expected positions.
    pub verified: u8,
}

/// An action in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Due {
    /// The id for the answer.
    pub id: Id,
    /// The action in progress.
    pub act: Action,
}

/// A motion for which the robot has not reported standstill yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Intent {
    /// The id of the action that started the motion.
    pub id: Id,
    /// The motion that was committed.
    pub motion: Motion,
    /// Number of executed waypoints that the robot has reported.
    pub done: u32,
}
