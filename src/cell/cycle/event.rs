//! The inputs and outputs of the cycle's state table.
//!
//! Inputs are events: requests of a person and reports of the cell, each one line of the journal. Outputs are the
//! effects of a step: the loop performs them in order, and performs nothing else. Some actions set a switch; the
//! cell's file assigns its outputs and feedbacks to the switches.

use panelprep_base::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// An output and its commanded state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Switch {
    ToolOn,
    ToolOff,
    Rinse,
    Spray,
    WaterOff,
    LightOn,
    LightOff,
    /// The lens shutters are open: cameras can see.
    LensClear,
    /// The lens guard is shut or purged: no drop reaches a lens.
    LensGuard,
    /// The extraction is on and proven by its flow.
    ExtractionOn,
    ExtractionOff,
}

/// Number of one effect. A report contains the number of the effect that it answers; numbers are never used again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Id(pub u64);

/// Every input that can cause a transition in the state table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// A request of a person, or of systemd on behalf of a person.
    Asked(Request),
    /// The cell reports its condition.
    #[serde(rename = "told")]
    Reported(Report),
}

/// The requests of a person. A request that does not fit the state is refused with a reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Stopped or Complete → Idle: self-test, everything is switched off, no motion.
    Reset,
    /// Idle → a cycle on the dry panel that now lies in the fixture.
    Start {
        /// Maximum number of abrasions in this cycle.
        max_passes: u8,
        /// Maximum number of moves of the corner loop.
        max_moves: u8,
        /// After an abrasion the panel is dried, and a new dry picture is the reference of the next film.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        dries: bool,
    },
    /// Idle → the planned path over all grids in the air: no water, no tool, no contact.
    AirRun {
        /// Maximum number of moves of the corner loop.
        max_moves: u8,
    },
    /// Leave the work in progress; ends in Held.
    Hold,
    /// Held → continue, through Verify.
    Unhold {
        /// A person confirms that the panel is dry; the panel is then located again.
        dried: bool,
    },
    /// Held for review → continue: a person accepts the result as good.
    Accept,
    /// End the cycle; ends in Stopped. SIGTERM.
    Stop,
    /// End everything at once; ends in Aborted. A second SIGTERM.
    Abort,
    /// Aborted → Stopped: a person at the cell confirms that the cause is removed and the pad is off the panel.
    Clear,
}

impl Request {
    /// Returns whether the request is a decision of a person that is based on the state shown. Such a decision is valid
    /// only for this step.
    pub fn is_operator_decision(self) -> bool {
        matches!(self, Request::Unhold { .. } | Request::Accept | Request::Clear)
    }
}

/// The reports of the cell. The answer to an action comes once; the other reports come when they happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Report {
    /// The program starts. All earlier activity is over.
    Boot,
    /// An action was performed, or could not be performed.
    Answered {
        /// Id of the action.
        id: Id,
        /// Result of the action.
        answer: Answer,
    },
    /// Time is up.
    Deadline {
        /// The id of the effect that armed the deadline.
        id: Id,
        /// The deadline that passed.
        which: Deadline,
    },
    /// This number of waypoints of a move is executed.
    Progress {
        /// Id of the motion.
        id: Id,
        /// Number of executed waypoints.
        done: u32,
    },
    /// The robot's condition changed.
    Robot(Robot),
    /// Whether the controller's override is the one planned for contact; reported at each change, and again after a
    /// lost link.
    FullOverride(bool),
    /// Something went wrong that is not the answer to an action.
    Trouble(Trouble),
    /// The program starts with a store whose content differs from what the program wrote.
    StoreChanged,
    /// The program starts with a store that was restored from a backup.
    StoreRestored,
    /// The link has ended the epoch without a command of the table: after a refusal, a wrong count, silence, or a
    /// stop by the controller's program. The abort frame has been sent and is not yet answered.
    EpochOver {
        /// The reason why it ended; `None` if the robot's condition states it.
        trouble: Option<Trouble>,
    },
    /// The state that this switch had reached is no longer proven: the output or feedback that proved it has
    /// changed (R21).
    Contrary(Switch),
    /// The feedbacks prove that tool and water are off.
    OutputsOff,
}

/// The result of an action; [`crate::cycle::Action`] states the possible answers of each. Any may fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Answer {
    /// Done and proven by its feedback, if there is one.
    Done,
    /// The controller accepted this epoch.
    Epoch(u32),
    /// The robot is at standstill; this number of waypoints of the move was executed.
    #[serde(rename = "stands")]
    Standstill {
        /// Number of executed waypoints.
        done: u32,
    },
    /// A gate's grade of a localization, a corner or a plan.
    Graded(Grade),
    /// The corner is seen, and another view is needed: of the next corner, or because this one was not at its expected
    /// position. The next corner pose is ready.
    #[serde(alias = "displaced")]
    LookOn,
    /// The result of the film; it may be invalid if the film was not watched to its end.
    Filmed(Film),
    /// A path over the grids that must still be abraded.
    Planned {
        /// First eight bytes of the path's hash.
        plan: u64,
        /// Number of the path's waypoints; 0 if nothing is left to do.
        waypoints: u32,
    },
    /// A planned path that a person must check before it is used.
    PlannedForReview {
        /// First eight bytes of the path's hash.
        plan: u64,
        /// Its waypoints.
        waypoints: u32,
    },
    /// The action could not be performed.
    Failed(Trouble),
}

/// Grade that a gate gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// The gate accepts.
    Accept,
    /// A person must check the result.
    Review,
    /// The result must not be used.
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

/// The kinds of deadlines. Arming a deadline replaces an armed one of the same kind; the answer to an action disarms
/// `Answer`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Deadline {
    /// The time limit of this action.
    Answer,
    /// A stop, `stop_deadline_s`.
    Stop,
    /// The rinse.
    Rinse,
    /// The time of the spray that wets the panel.
    Spray,
    /// The time from water off until the cell is drained.
    Drain,
    /// The time from light on until the light is steady.
    Settle,
    /// The localization's validity, `token_s`.
    Token,
}

/// The robot's condition as its link reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Robot {
    /// No state has been received yet.
    Unknown,
    /// Connected, handshake good, automatic, drives on, no stop.
    Ready,
    /// No connection.
    LinkLost,
    /// The controller has another boot id or program than before.
    Restarted,
    /// Emergency stop.
    EmergencyStop,
    /// Guard open.
    GuardOpen,
    /// Drives off, or motion not possible.
    DrivesOff,
    /// T1 or T2.
    NotAutomatic,
    /// The controller's programs differ from those with which the cell was accepted.
    OtherPrograms,
}

impl Robot {
    /// Returns the keyword that users' scripts rely on.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}

/// Faults during a cycle (rows of the fault model in parentheses).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Trouble {
    /// A camera gave no picture (C2–C4, C9).
    Camera,
    /// The camera's pictures are unusable (C6–C8, P10).
    Picture,
    /// A computation could not be made.
    Computing,
    /// A feedback does not have its expected value: tool, extraction, water, lens, light (R21).
    Feedback,
    /// The link, force, contact or stroke of the compliant tool is not as expected.
    Force,
    /// The robot ran out of waypoints (R6).
    Starved,
    /// The robot is far behind its plan (R5).
    Slow,
    /// The gate refused a path although the planner keeps the gate's limits (P13–P15).
    Gate,
    /// The robot refused a command (R20).
    Refused,
    /// The robot stopped before the end of its path (R3).
    Short,
    /// Acknowledgements out of order (R12).
    Sequence,
    /// The received data do not match the protocol (R7–R11).
    Protocol,
    /// The override differs from the one for which contact is planned.
    Override,
    /// The arm is not at its commanded position (R18).
    Deviation,
    /// The store cannot write (S1, S2).
    Store,
    /// The store's disk is full; records that are required for a retract and a hold still have room (S1).
    DiskFull,
    /// No answer by the deadline.
    Late,
    /// The type of the answer does not match the action.
    Unexpected,
}

impl Trouble {
    /// Returns whether the work may continue after a person has checked the cause; all other troubles end in Aborted.
    pub fn allows_continuation(self) -> bool {
        use Trouble::{Camera, Computing, DiskFull, Feedback, Force, Override, Picture, Slow, Starved};
        matches!(self, Camera | Picture | Computing | DiskFull | Feedback | Force | Override | Starved | Slow)
    }
}

/// One effect to perform. The event that caused it is written to the journal first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// Perform the action and report its answer under this id. An action that is no longer [`State::due`](super::State)
    /// is abandoned: a computation or a capture may be dropped; switching commands are already performed, and their
    /// order is kept.
    Do {
        /// The id that the answer must contain.
        id: Id,
        /// The action.
        act: Action,
    },
    /// Report [`Report::Deadline`](super::Report) with this id after the time that is configured for this deadline.
    Arm {
        /// The id that the report contains.
        id: Id,
        /// The deadline to arm.
        deadline: Deadline,
    },
    /// Commit this motion to the store; comes before the [`Effect::Do`] that it permits.
    OpenIntent(Motion),
    /// Commit how a motion ended: the robot is at standstill.
    CloseIntent {
        /// The motion.
        motion: Motion,
        /// Outcome of the motion.
        outcome: Outcome,
        /// Waypoints executed, as reported by the robot.
        done: u32,
    },
    /// Commit the cycle's result.
    Conclude {
        /// The verdict.
        verdict: Verdict,
    },
    /// Report to the requester that the request is refused, and why.
    Refuse {
        /// The request.
        request: Request,
        /// The reason of the refusal.
        refusal: Refusal,
    },
}

/// An operation that needs time and is answered. At most one is in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Ask the robot whether it is at standstill; nothing else. Answered by `Standstill`.
    #[serde(rename = "stand")]
    CheckStandstill,
    /// Test cameras, disk, handshake, checksums. Answered by `Done`.
    SelfTest,
    /// Open an epoch with a number above `above` and above the controller's number. No motion. Answered by `Epoch`.
    OpenEpoch {
        /// The last epoch that this table knows.
        above: u32,
    },
    /// The abort frame: switch tool and water off, brake, discard the queued commands, retract if in contact. Answered
    /// by `Standstill` when the robot is at standstill, and tool and water are proven off.
    EndEpoch {
        /// The epoch that ends.
        epoch: u32,
    },
    /// Set base and tool, echoed within 0.001 mm and degrees. Answered by `Done`.
    SetFrames(Frames),
    /// Switch an output and wait for its feedback. Answered by `Done`.
    Switch(Switch),
    /// Check the whole path by its gate, then stream it within the window. Answered by `Progress`, then by
    /// `Standstill`.
    Move(Motion),
    /// Take a 3D shot and locate the panel in it. Answered by `Graded`.
    Locate,
    /// Take the corner picture from this view and compute the correction. Answered by `Graded` or `LookOn`.
    Refine {
        /// The number of the corner pose, from 0.
        view: u8,
    },
    /// Take the corner picture from this view, wet or dry, and verify the panel's pose. Answered by `Graded` or
    /// `LookOn`; accept renews the localization.
    Verify {
        /// The number of the corner pose, from 0.
        view: u8,
    },
    /// Take the picture of the dry panel. Answered by `Done`.
    DryPicture,
    /// Watch the film and judge it. Answered by `Filmed`.
    Film,
    /// Grade the result of the last contact path, from the poses that the robot reported. Answered by `Graded`.
    Assess,
    /// Plan a path over the grids that this pass must still abrade. Answered by `Planned`, `PlannedForReview`, or
    /// `Graded` with reject.
    Plan {
        /// The number of the pass, from 1; 0 is an air-run, over all grids.
        pass: u8,
    },
}

/// A path and the epoch it belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Motion {
    /// The epoch; after its end, no command of the path is sent.
    pub epoch: u32,
    /// The path.
    pub path: Path,
    /// The plan of a contact path, or of this path in the air; 0 for other paths.
    pub plan: u64,
    /// Number of waypoints of the path; 1 for other paths: they have one target, and intermediate points are not
    /// counted.
    pub waypoints: u32,
}

impl Motion {
    /// Returns the plan's number in the form for people and records.
    pub fn plan_keyword(&self) -> String {
        format!("{:016x}", self.plan)
    }
}

/// The destination of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Path {
    /// To the park pose, as a motion of the axes.
    Park,
    /// To a corner pose of the flange camera, in air.
    Corner {
        /// Index of the corner view, from 0.
        view: u8,
    },
    /// To the air point before the first contact.
    Approach,
    /// Landing, abrasion and leaving, with the tool running; ends in air.
    Contact,
    /// The contact path lifted off the panel, with the tool off.
    Air,
    /// From the air point after the last contact to a pose clear of the panel.
    Retract,
}

/// Base and tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frames {
    /// The robot's base and the flange camera.
    Camera,
    /// The panel as located and the sanding pad.
    Pad,
}

/// Outcome of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "lowercase")]
pub enum Outcome {
    /// The motion reached its end.
    Done,
    /// A hold ended the motion.
    Held,
    /// A stop ended the motion.
    Stopped,
    /// An abort ended the motion.
    Aborted,
    /// The outcome was unknown until the robot was asked; then a person cleared it.
    Cleared,
}

impl Outcome {
    /// Returns the word for the page.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}

/// The reason why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// The request is not possible in this state.
    NotNow,
    /// The robot is not ready.
    Robot(Robot),
    /// Held for review: accept it, or confirm that the panel is dry and locate again.
    Review,
    /// Held until the panel is dried: confirm that it is dry.
    Undried,
    /// A reset failed with this trouble.
    Failed(Trouble),
}
