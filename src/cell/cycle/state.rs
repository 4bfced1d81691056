//! The state of the cycle.

use super::{Action, Facts, Id, Motion, Robot, Trouble};
use panelprep_base::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// All data that the table stores between events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct State {
    /// The PackML state, with the phase inside Execute.
    pub at: At,
    /// The cycle that is running, or ran last.
    pub job: Job,
    /// Facts that the cell reported.
    pub facts: Facts,
    /// The one action in progress.
    pub due: Option<Due>,
    /// The motion that has begun and for which the robot has not yet reported standstill.
    pub intent: Option<Intent>,
    /// The last epoch that was opened.
    pub epoch: u32,
    /// The last id that was assigned.
    pub last_id: Id,
    /// Number of reports that did not match any expected report.
    pub dropped: u64,
    /// Number of changes of `at`. A person's decision is based on the state shown at one step.
    #[serde(default)]
    pub step: u64,
}

impl State {
    /// The state before the first event of a new store.
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

/// The PackML states.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "lowercase")]
pub enum At {
    /// At rest; a Reset leads out.
    Stopped,
    /// Everything off and tested, without motion.
    Resetting,
    /// Ready for the request Start.
    Idle,
    /// The arm parks.
    Starting,
    /// The cycle.
    Execute(Phase),
    /// On the way to Held: water off, epoch ended.
    Holding(Hold),
    /// At rest inside a cycle.
    Held(Hold),
    /// On the way back from Held: the panel's pose is verified.
    Unholding {
        /// The phase in which the cycle continues.
        resume: Phase,
        /// Whether the panel's pose must be verified first.
        verify: bool,
    },
    /// The arm parks and everything is switched off.
    Completing {
        /// The cycle's verdict.
        verdict: Verdict,
    },
    /// The cycle is over.
    Complete {
        /// Its verdict.
        verdict: Verdict,
    },
    /// On the way to Stopped: water off, epoch ended.
    Stopping {
        /// The deadline of the whole stop.
        until: Id,
    },
    /// On the way to Aborted, whatever the answer to the abort frame is. The frame is sent at once; it also shuts the
    /// water.
    Aborting {
        /// Cause of the abort.
        cause: Cause,
    },
    /// At rest after a fault; only Clear leads out.
    Aborted {
        /// Cause of the abort.
        cause: Cause,
    },
    /// A person cleared the cause: the robot is asked whether it is at standstill, tool and water are proven off.
    Clearing {
        /// Cause of the abort that is being cleared.
        cause: Cause,
    },
}

impl At {
    /// Returns the PackML name that users' scripts rely on.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns whether nothing is in progress, so that the process may end.
    pub fn is_at_rest(self) -> bool {
        matches!(self, At::Stopped | At::Idle | At::Held(_) | At::Complete { .. } | At::Aborted { .. })
    }
}

/// The phases inside Execute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "lowercase")]
pub enum Phase {
    /// A 3D shot of the dry panel, from which its pose is determined.
    Locate,
    /// The corner loop.
    Refine {
        /// Number of motions made.
        moves: u8,
    },
    /// The picture of the dry panel.
    Dry,
    /// The spray.
    Wet,
    /// The film is watched.
    Inspect,
    /// Planning of a path over the failed grids.
    Plan,
    /// A picture of the corner immediately before contact.
    Verify,
    /// Approach, tool on, contact, leaving.
    Abrade,
    /// Tool off in air, clear of the panel.
    Retract,
    /// The result of the contact path is graded. Nothing is done to the panel before.
    Assess {
        /// The path was cut short, so that the rest must still be planned.
        left: bool,
    },
    /// The dust is washed off.
    Rinse,
}

impl Phase {
    /// Returns the name that users' scripts rely on.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns the phase in which the cycle continues after a person has accepted the result of this phase.
    pub(super) fn phase_after_accept(self) -> Phase {
        match self {
            Phase::Assess { left: true } => Phase::Plan,
            Phase::Assess { left: false } => Phase::Rinse,
            other => other,
        }
    }
}

/// A hold and how it ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Hold {
    /// Reason of the hold.
    pub why: Why,
    /// The phase in which the cycle continues; a path that was left is planned again.
    pub resume: Phase,
}

impl Hold {
    /// Returns whether the result of a contact path waits for a person. No new measurement of the panel replaces this
    /// result.
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
    /// A result waits for a person.
    Review,
    /// Verify failed: dry the panel and confirm it, or try again.
    NotVerified,
    /// The localization became too old in contact.
    TokenOver,
    /// The dust is washed off: dry the panel and confirm it, so that a new dry picture is taken.
    Drying,
    /// Something went wrong that a person can correct.
    Trouble(Trouble),
}

/// The reason why a cycle was aborted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// A person requested it.
    Asked,
    /// The robot's condition.
    Robot(Robot),
    /// A fault during the cycle.
    Trouble(Trouble),
    /// A stop lasted too long.
    StopTimedOut,
    /// The program ended while a motion was open.
    Interrupted,
    /// The content of the store differs from what the program wrote there.
    StoreChanged,
    /// The store was restored from a backup: it does not contain the actions of the cell since the backup.
    StoreRestored,
    /// The program ended while tool or water was on.
    OutputsOn,
}

impl Cause {
    /// Returns the cause of an abort in progress after the robot has changed to this condition. An emergency stop
    /// outranks every cause except a changed or restored store. Another condition outranks a trouble, which may be
    /// its consequence: a command is refused because the drives are off.
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

/// One cycle's limits and counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Job {
    /// Whether the cycle has begun and is not concluded.
    pub running: bool,
    /// Whether the cycle is an air-run, which does not touch the panel.
    #[serde(default)]
    pub air: bool,
    /// Whether, after an abrasion, a person dries the panel, so that a new dry picture is the reference of the next
    /// film.
    #[serde(default)]
    pub dries: bool,
    /// Maximum number of abrasions.
    pub max_passes: u8,
    /// Maximum number of moves of the corner loop.
    pub max_moves: u8,
    /// Number of planned abrasions.
    pub pass: u8,
    /// The phase after the dry picture: Wet, or after a new localization the phase that was interrupted: Plan or
    /// Rinse.
    pub after_dry: Phase,
    /// The number of the last plan.
    pub plan: u64,
    /// Its waypoints.
    pub waypoints: u32,
    /// Number of corners that the Verify in progress has seen at their expected positions.
    #[serde(default)]
    pub verified: u8,
}

/// An action in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Due {
    /// The id that its answer must contain.
    pub id: Id,
    /// The action.
    pub act: Action,
}

/// An open motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Intent {
    /// The id of the motion's action.
    pub id: Id,
    /// The motion.
    pub motion: Motion,
    /// Waypoints executed, as far as reported.
    pub done: u32,
}
