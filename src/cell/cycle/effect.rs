//! The effects of a step. The loop performs them in order, and performs nothing else.

use super::{Deadline, Id, Request, Robot, Switch, Trouble};
use panelprep_base::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// One effect to perform. The event that caused it is written to the journal first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// Perform the action and report its answer under this id. An action that is no longer [`State::due`](super::State)
    /// is abandoned: a computation or a capture may be dropped; switches have happened and stay in order.
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
    /// The abort frame: tool and water off, brake, discard, retract if in contact. Answered by `Standstill` when the
    /// robot is at standstill, and tool and water are proven off.
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
    /// From the air point after the last contact, clear of the panel.
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
