//! The inputs of the table: requests of a person and reports of the cell. Each event is one line of the journal.

use super::Switch;
use serde::{Deserialize, Serialize};

/// Number of one effect. A report names the effect that it answers; numbers are never used again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Id(pub u64);

/// Every input that can cause a transition in the state table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// A person, or systemd for one, wants something.
    Asked(Request),
    /// The cell reports its condition.
    Told(Report),
}

/// The requests of a person. A request that does not fit the state is refused with a reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Stopped or Complete → Idle: self-test, everything off, no motion.
    Reset,
    /// Idle → a cycle on the dry panel that now lies in the fixture.
    Start {
        /// Abrasions of this cycle, at most.
        max_passes: u8,
        /// Moves of the corner loop, at most.
        max_moves: u8,
        /// After an abrasion the panel is dried, and a new dry picture is the reference of the next film.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        dries: bool,
    },
    /// Idle → the planned path over all grids in the air: no water, no tool, no contact.
    AirRun {
        /// Moves of the corner loop, at most.
        max_moves: u8,
    },
    /// Leave what is going on; ends in Held.
    Hold,
    /// Held → on, through Verify.
    Unhold {
        /// A person confirms that the panel is dry: it is located again.
        dried: bool,
    },
    /// Held for review → on: a person accepts the result as good.
    Accept,
    /// End the cycle; ends in Stopped. SIGTERM.
    Stop,
    /// End everything at once; ends in Aborted. A second SIGTERM.
    Abort,
    /// Aborted → Stopped: a person at the cell confirms that the cause is removed and the pad is off the panel.
    Clear,
}

impl Request {
    /// Whether a person decides it upon what the cell shows, so that it is good for that step alone.
    pub fn is_decision(self) -> bool {
        matches!(self, Request::Unhold { .. } | Request::Accept | Request::Clear)
    }
}

/// The reports of the cell. The answer to an act comes once; the other reports come when they happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Report {
    /// The program starts. Whatever was going on is over.
    Boot,
    /// An act is done, or could not be.
    Answered {
        /// The act.
        id: Id,
        /// Its result.
        answer: Answer,
    },
    /// Time is up.
    Deadline {
        /// The effect that armed it.
        id: Id,
        /// Which time.
        which: Deadline,
    },
    /// This number of waypoints of a move is executed.
    Progress {
        /// The move.
        id: Id,
        /// Waypoints executed.
        done: u32,
    },
    /// The robot's condition changed.
    Robot(Robot),
    /// Whether the controller's override is the one planned for contact; reported at each change, and again after a
    /// lost link.
    FullOverride(bool),
    /// Something went wrong that is not the answer to an act.
    Trouble(Trouble),
    /// The program starts on a store in which something is not what it wrote there.
    StoreChanged,
    /// The program starts on a store that was restored from a backup.
    StoreRestored,
    /// The link has ended the epoch by itself: a refusal, a wrong count, silence, a stop by the controller's program. The
    /// abort frame has been sent and is not yet answered.
    EpochOver {
        /// Why it ended; `None` if the robot's condition states it.
        trouble: Option<Trouble>,
    },
    /// What this switch had proven is not so any more, by the output or the feedback that proved it (R21).
    Contrary(Switch),
    /// The feedbacks prove that tool and water are off.
    OutputsOff,
}

/// The result of an act; [`crate::cycle::Act`] states the possible answers of each. Any may fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Answer {
    /// Done and proven by its feedback, if there is one.
    Done,
    /// The controller accepted this epoch.
    Epoch(u32),
    /// The robot is at standstill; this number of waypoints of the move was executed.
    Stands {
        /// Waypoints executed.
        done: u32,
    },
    /// A gate's word on a localization, a corner or a plan.
    Graded(Grade),
    /// The corner is seen, and another view is needed: of the next corner, or because this one was not at its
    /// expected place. The next corner pose is ready.
    #[serde(alias = "displaced")]
    LookOn,
    /// The film was watched to its end, or not.
    Filmed(Film),
    /// A path over what is still to be abraded.
    Planned {
        /// First eight bytes of the path's hash.
        plan: u64,
        /// Its waypoints; none when nothing is left to do.
        waypoints: u32,
    },
    /// A path that a person must look at before it is used.
    PlannedForReview {
        /// First eight bytes of the path's hash.
        plan: u64,
        /// Its waypoints.
        waypoints: u32,
    },
    /// It could not be done.
    Failed(Trouble),
}

/// A gate's word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// Good.
    Accept,
    /// A person must look.
    Review,
    /// Not to be used.
    Reject,
}

/// The result of the water film.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Film {
    /// No grid failed.
    Whole,
    /// At least one grid failed.
    Broken,
    /// The film gives no result.
    Invalid,
}

/// Which time. Arming one replaces an armed one of the same kind; the answer to an act disarms `Answer`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Deadline {
    /// The time limit of this act.
    Answer,
    /// A stop, `stop_deadline_s`.
    Stop,
    /// The rinse.
    Rinse,
    /// The spray that wets the panel.
    Spray,
    /// From water off to a drained cell.
    Drain,
    /// From light on to steady light.
    Settle,
    /// The localization's validity, `token_s`.
    Token,
}

/// The robot's condition as its link reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Robot {
    /// Nothing heard yet.
    Unknown,
    /// Connected, handshake good, automatic, drives on, no stop.
    Ready,
    /// No connection.
    LinkLost,
    /// Another boot id or program than before.
    Restarted,
    /// Emergency stop.
    EmergencyStop,
    /// Guard open.
    GuardOpen,
    /// Drives off, or motion not possible.
    DrivesOff,
    /// T1 or T2.
    NotAutomatic,
    /// Its programs are others than those with which the cell was accepted.
    OtherPrograms,
}

impl Robot {
    /// The word that users script against.
    pub fn word(self) -> &'static str {
        self.into()
    }
}

/// What can go wrong (rows of the fault model in parentheses).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Trouble {
    /// A camera gave no picture (C2–C4, C9).
    Camera,
    /// Its pictures are unusable (C6–C8, P10).
    Picture,
    /// A computation could not be made.
    Computing,
    /// A feedback is not what it should be: tool, extraction, water, lens, light (R21).
    Feedback,
    /// The compliant tool: its link, force, contact or stroke is not as it should be.
    Force,
    /// The robot ran out of waypoints (R6).
    Starved,
    /// The robot is far behind its plan (R5).
    Slow,
    /// The gate refused a path that was planned to pass it (P13–P15).
    Gate,
    /// The robot refused a command (R20).
    Refused,
    /// The robot stopped before the end of its path (R3).
    Short,
    /// Acknowledgements out of order (R12).
    Sequence,
    /// What came is not the protocol (R7–R11).
    Protocol,
    /// The override is not the one that contact is planned for.
    Override,
    /// The arm is not where it was sent (R18).
    Deviation,
    /// The store does not write (S1, S2).
    Store,
    /// The store's disk is full; what must be kept of a retract and a hold still finds its place (S1).
    DiskFull,
    /// No answer by the deadline.
    Late,
    /// An answer that does not fit its act.
    Unexpected,
}

impl Trouble {
    /// Returns whether the work may continue after a person has looked; all other troubles end in Aborted.
    pub fn holds(self) -> bool {
        use Trouble::{Camera, Computing, DiskFull, Feedback, Force, Override, Picture, Slow, Starved};
        matches!(self, Camera | Picture | Computing | DiskFull | Feedback | Force | Override | Starved | Slow)
    }
}
