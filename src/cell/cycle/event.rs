//! The inputs and outputs of the cycle's state table.
//!
//! Inputs are events: requests of a person and reports of the cell. Each event is one line of the journal. Outputs are
//! effects, which the control loop performs in order. Some actions set a switch, which the cell's file assigns to
//! outputs and feedbacks of the controller.

use panelprep_base::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// A switch of the cell and its commanded state.
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
    /// The lens shutters are open, so that the cameras can capture pictures.
    LensClear,
    /// The lenses are protected by a shutter or purge air: no drop can reach them.
    LensGuard,
    /// The extraction is on, confirmed by its flow.
    ExtractionOn,
    ExtractionOff,
}

/// The number of an effect. A report contains the number of the effect to which it belongs. Numbers are never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Id(pub u64);

/// An event: every input that can cause a transition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// A request of a person, or of systemd (SIGTERM).
    Asked(Request),
    /// A report of the cell about its condition.
    #[serde(rename = "told")]
    Reported(Report),
}

/// The requests of a person. A request that is not valid in the present state is refused with a reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Stopped or Complete → Idle: all outputs are switched off, and a self-test without motion is performed.
    Reset,
    /// Idle → a cycle on the dry panel in the fixture.
    Start {
        /// Maximum number of sanding passes in this cycle.
        max_passes: u8,
        /// Maximum number of motions to corner poses in the corner loop.
        max_moves: u8,
        /// Whether the panel is dried after each sanding pass, so that a new dry picture is the reference of the next
        /// film.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        dries: bool,
    },
    /// Idle → an air-run: the arm moves along a path over all grids in the air, without water, tool and contact.
    AirRun {
        /// Maximum number of motions to corner poses in the corner loop.
        max_moves: u8,
    },
    /// Interrupts the work; ends in Held.
    Hold,
    /// Held → resume the cycle, through Verify.
    Unhold {
        /// Whether a person confirms that the panel is dry; if so, the panel is located again.
        dried: bool,
    },
    /// Held for review → resume the cycle: a person accepts the result.
    Accept,
    /// Ends the cycle; ends in Stopped. Also caused by SIGTERM.
    Stop,
    /// Ends everything immediately; ends in Aborted. Also caused by a second SIGTERM.
    Abort,
    /// Aborted → Stopped: a person at the cell confirms that the cause is removed and that the pad does not touch the
    /// panel.
    Clear,
}

impl Request {
    /// Returns whether the request is a person's decision about the state that is displayed. Such a request is valid
    /// only for the step at which this state was displayed.
    pub fn is_operator_decision(self) -> bool {
        matches!(self, Request::Unhold { .. } | Request::Accept | Request::Clear)
    }
}

/// The reports of the cell. Each action is answered by exactly one report; all other reports may come at any time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Report {
    /// The program has started; all earlier work has ended.
    Boot,
    /// An action was performed, or has failed.
    Answered {
        /// The id of the action.
        id: Id,
        /// The result of the action.
        answer: Answer,
    },
    /// A deadline has ended.
    Deadline {
        /// The id of the effect that started the deadline.
        id: Id,
        /// The kind of deadline.
        which: Deadline,
    },
    /// The number of executed waypoints of a motion has changed.
    Progress {
        /// Id of the motion.
        id: Id,
        /// Number of executed waypoints.
        done: u32,
    },
    /// The robot's condition has changed.
    Robot(Robot),
    /// Whether the controller's override has the value for which contact is planned. Reported at each change, and again
    /// after the link was lost.
    FullOverride(bool),
    /// A fault that is not the answer to an action.
    Trouble(Trouble),
    /// The program has started, and the store does not contain what the program last wrote.
    StoreChanged,
    /// The program has started with a store that was restored from a backup.
    StoreRestored,
    /// The link has ended the epoch on its own: after a refused command, a wrong count, a timeout, or a stop by the
    /// controller's program. The abort frame was sent, but its reply has not been received yet.
    EpochOver {
        /// The reason; `None` if the robot's condition contains the reason.
        trouble: Option<Trouble>,
    },
    /// The state of this switch is no longer confirmed, because its output or its feedback has changed (R21).
    Contrary(Switch),
    /// The feedbacks confirm that tool and water are off.
    OutputsOff,
}

/// The result of an action. [`crate::cycle::Action`] states which results each action may have; every action may fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Answer {
    /// The action was performed; its feedback, if there is one, confirms this.
    Done,
    /// The controller has opened this epoch.
    Epoch(u32),
    /// The robot is at standstill.
    #[serde(rename = "stands")]
    Standstill {
        /// Number of executed waypoints of the motion.
        done: u32,
    },
    /// The grade of a localization, a corner picture or a plan, from its acceptance check.
    Graded(Grade),
    /// The corner is seen, and another view is needed: of the next corner, or because this one was not at its expected
    /// position. The next corner pose is ready.
    LookOn,
    /// The result of the film. It may be invalid, for example if the observation was interrupted.
    Filmed(Film),
    /// A path over the grids that must still be sanded.
    Planned {
        /// First eight bytes of the hash of the path.
        plan: u64,
        /// Number of waypoints of the path; 0 if no grid must be sanded.
        waypoints: u32,
    },
    /// A planned path that a person must check before it is used.
    PlannedForReview {
        /// First eight bytes of the hash of the path.
        plan: u64,
        /// Number of waypoints of the path.
        waypoints: u32,
    },
    /// The action has failed.
    Failed(Trouble),
}

/// The grade that an acceptance check gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// The result may be used.
    Accept,
    /// A person must check the result.
    Review,
    /// The result must not be used.
    Reject,
}

/// The result of the water-break test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Film {
    /// No grid failed.
    Whole,
    /// At least one grid failed.
    Broken,
    /// The test has no valid result.
    Invalid,
}

/// The kinds of deadlines. A new deadline replaces an active one of the same kind; the answer to an action cancels
/// `Answer`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Deadline {
    /// The time limit for the answer to an action.
    Answer,
    /// The time limit for a complete stop, `stop_deadline_s`.
    Stop,
    /// The duration of the rinse.
    Rinse,
    /// The duration of the spray that wets the panel.
    Spray,
    /// The time until the water has drained after it was switched off.
    Drain,
    /// The time until the light is stable after it was switched on.
    Settle,
    /// The maximum age of a localization, `token_s`.
    Token,
}

/// The robot's condition, as reported by the robot link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Robot {
    /// No state message has been received yet.
    Unknown,
    /// Connected, handshake accepted, automatic mode, drives on, no stop.
    Ready,
    /// The controller is not connected.
    LinkLost,
    /// The controller has a new boot id, or executes another program than before.
    Restarted,
    /// An emergency stop is active.
    EmergencyStop,
    /// A guard is open.
    GuardOpen,
    /// The drives are off, or motion is not possible.
    DrivesOff,
    /// The controller is in mode T1 or T2.
    NotAutomatic,
    /// The checksum of the controller's programs is not the one with which the cell was accepted.
    OtherPrograms,
}

impl Robot {
    /// Returns the keyword of the condition, on which users' scripts rely.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}

/// Faults during a cycle, with the rows of the fault model in parentheses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Trouble {
    /// A camera delivered no picture (C2–C4, C9).
    Camera,
    /// The pictures of a camera cannot be used (C6–C8, P10).
    Picture,
    /// A computation failed.
    Computing,
    /// A feedback does not have its expected state: tool, extraction, water, lens or light (R21).
    Feedback,
    /// The link, force, contact or stroke of the compliant tool is outside of its limits.
    Force,
    /// The robot's queue of waypoints became empty during the motion (R6).
    Starved,
    /// The robot is far behind its plan (R5).
    Slow,
    /// The checks of a motion refused a path, although the planner must observe the same limits (P13–P15).
    Gate,
    /// The controller refused a command (R20).
    Refused,
    /// The robot stopped before the end of its path (R3).
    Short,
    /// Acknowledgements out of order (R12).
    Sequence,
    /// The received data do not match the protocol (R7–R11).
    Protocol,
    /// The override is not the one for which contact is planned.
    Override,
    /// The arm is not at its commanded position (R18).
    Deviation,
    /// The store cannot be written (S1, S2).
    Store,
    /// The disk of the store is full. There is still reserved space for the records of a retract and a hold (S1).
    DiskFull,
    /// An action was not answered before its deadline.
    Late,
    /// The type of an answer does not match its action.
    Unexpected,
}

impl Trouble {
    /// Returns whether the cycle may be resumed after a person has checked the cause. All other faults end in Aborted.
    pub fn allows_continuation(self) -> bool {
        use Trouble::{Camera, Computing, DiskFull, Feedback, Force, Override, Picture, Slow, Starved};
        matches!(self, Camera | Picture | Computing | DiskFull | Feedback | Force | Override | Starved | Slow)
    }
}

/// An effect that the control loop must perform. The event that caused the effect is written to the journal first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// Perform the action and report its answer with this id. If the action is no longer [`State::due`](super::State),
    /// a computation or a capture may be cancelled; switching commands are always performed, in their order.
    Do {
        /// The id for the answer.
        id: Id,
        /// The action to perform.
        act: Action,
    },
    /// Start a deadline: report [`Report::Deadline`](super::Report) with this id after the configured time.
    Arm {
        /// The id for the report.
        id: Id,
        /// The kind of deadline.
        deadline: Deadline,
    },
    /// Commit this motion to the store before the [`Effect::Do`] that starts it.
    OpenIntent(Motion),
    /// Commit the outcome of a motion to the store, after the robot has reached standstill.
    CloseIntent {
        /// The motion that has ended.
        motion: Motion,
        /// The outcome of the motion.
        outcome: Outcome,
        /// Number of executed waypoints, as reported by the robot.
        done: u32,
    },
    /// Commit the cycle's result to the store.
    Conclude {
        /// The verdict of the cycle.
        verdict: Verdict,
    },
    /// Report to the client that its request is refused, with the reason.
    Refuse {
        /// The refused request.
        request: Request,
        /// The reason for the refusal.
        refusal: Refusal,
    },
}

/// An operation that takes time and has an answer. At most one action is in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Query whether the robot is at standstill, without any command. Answered by `Standstill`.
    #[serde(rename = "stand")]
    CheckStandstill,
    /// Test cameras, disk, handshake, checksums. Answered by `Done`.
    SelfTest,
    /// Open an epoch whose number is higher than `above` and than the controller's own number. No motion. Answered by
    /// `Epoch`.
    OpenEpoch {
        /// The last epoch that the state table knows.
        above: u32,
    },
    /// Send the abort frame: switch tool and water off, brake, discard the queued commands, and retract if the tool is
    /// in contact. Answered by `Standstill` when the robot is at standstill and tool and water are confirmed to be off.
    EndEpoch {
        /// The epoch to end.
        epoch: u32,
    },
    /// Set the base and tool frames. The controller must echo them within 0.001 mm and 0.001°. Answered by `Done`.
    SetFrames(Frames),
    /// Set a switch and wait for its feedback. Answered by `Done`.
    Switch(Switch),
    /// Check the whole path, then stream it within the limits of the window. Reported by `Progress`, answered by
    /// `Standstill`.
    Move(Motion),
    /// Capture a 3D shot and locate the panel in it. Answered by `Graded`.
    Locate,
    /// Capture a corner picture at this corner pose and compute the correction of the panel's pose. Answered by
    /// `Graded` or `LookOn`.
    Refine {
        /// The number of the corner pose, from 0.
        view: u8,
    },
    /// Capture a corner picture of the wet or dry panel at this corner pose and verify the panel's pose. Answered by
    /// `Graded` or `LookOn`; the grade accept renews the localization.
    Verify {
        /// The number of the corner pose, from 0.
        view: u8,
    },
    /// Capture the reference picture of the dry panel. Answered by `Done`.
    DryPicture,
    /// Observe the film and evaluate it. Answered by `Filmed`.
    Film,
    /// Grade the result of the last contact path, from the poses that the robot reported during the path. Answered by
    /// `Graded`.
    Assess,
    /// Plan a path over the grids that must still be sanded in this pass. Answered by `Planned`, `PlannedForReview`, or
    /// `Graded` with reject.
    Plan {
        /// The number of the sanding pass, from 1; 0 for an air-run over all grids.
        pass: u8,
    },
}

/// A path, and the epoch in which it is executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Motion {
    /// The epoch; after its end, no command of this path is sent.
    pub epoch: u32,
    /// The path.
    pub path: Path,
    /// The number of the plan, for a contact path and its air-run; 0 for other paths.
    pub plan: u64,
    /// Number of waypoints of the path; 1 for paths without a plan, which have one target and whose intermediate points
    /// are not counted.
    pub waypoints: u32,
}

impl Motion {
    /// Returns the number of the plan as text, for people and records.
    pub fn plan_keyword(&self) -> String {
        format!("{:016x}", self.plan)
    }
}

/// The kinds of paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Path {
    /// To the park pose, as a motion of the axes.
    Park,
    /// To a corner pose of the flange camera, in the air.
    Corner {
        /// The number of the corner pose, from 0.
        view: u8,
    },
    /// To the approach point in the air, before the first contact.
    Approach,
    /// Landing, sanding and lifting off, with the tool running; ends in the air.
    Contact,
    /// The contact path at a distance from the panel, with the tool off.
    Air,
    /// From the end of the contact path, in the air, to a pose away from the panel.
    Retract,
}

/// The base and tool frames of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frames {
    /// The robot's base frame, and the flange camera as the tool.
    Camera,
    /// The frame of the located panel, and the sanding pad as the tool.
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
    /// The outcome was unknown, for example after a restart; the robot's state was queried, and a person cleared the
    /// cell.
    Cleared,
}

impl Outcome {
    /// Returns the keyword of the outcome for the page.
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
    /// The cycle is held for review: a person must accept the result, or confirm that the panel is dry so that it is
    /// located again.
    Review,
    /// The cycle is held until the panel is dry: a person must confirm that it is dry.
    Undried,
    /// The last reset failed with this fault.
    Failed(Trouble),
}
