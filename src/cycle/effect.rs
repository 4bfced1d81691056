//! The effects of a step. The loop performs them in their order, and does nothing else.

use super::{Deadline, Id, Request, Robot, Switch, Trouble};
use crate::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// One thing to do. The event that led to it is in the journal before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// Perform the act and report its answer under this id. An act that is no longer [`State::due`](super::State)
    /// is abandoned: a computation or a capture may be dropped; switches have happened and stay in order.
    Do {
        /// The id that the answer names.
        id: Id,
        /// The act.
        act: Act,
    },
    /// Report [`Report::Deadline`](super::Report) with this id after the time that is set for it.
    Arm {
        /// The id that the report names.
        id: Id,
        /// Which time.
        deadline: Deadline,
    },
    /// Commit this motion to the store; comes before the [`Effect::Do`] that it permits.
    OpenIntent(Motion),
    /// Commit how a motion ended: the robot is at standstill.
    CloseIntent {
        /// The motion.
        motion: Motion,
        /// How it ended.
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
        /// Why not.
        refusal: Refusal,
    },
}

/// An operation that needs time and is answered. At most one is in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Act {
    /// Ask the robot whether it is at standstill; nothing else. Answered by `Stands`.
    Stand,
    /// Cameras, disk, handshake, checksums. `Done`.
    SelfTest,
    /// Open an epoch with a number above this and above the controller's. No motion. `Epoch`.
    OpenEpoch {
        /// The last epoch that this table knows.
        above: u32,
    },
    /// The abort frame: tool and water off, brake, discard, retract if in contact. `Stands` when the robot is at
    /// standstill, and tool and water are proven off.
    EndEpoch {
        /// The epoch that ends.
        epoch: u32,
    },
    /// Set base and tool, echoed within 0.001 mm and degrees. `Done`.
    SetFrames(Frames),
    /// Switch an output and wait for its feedback. `Done`.
    Switch(Switch),
    /// Check the whole path by its gate, then stream it within the window. `Progress`, then `Stands`.
    Move(Motion),
    /// A 3D shot and the localization from it. `Graded`.
    Locate,
    /// The corner picture from this view and the correction from it. `Graded` or `LookOn`.
    Refine {
        /// Which corner pose, from 0.
        view: u8,
    },
    /// The corner picture from this view, wet or dry. `Graded` or `LookOn`; accept renews the localization.
    Verify {
        /// Which corner pose, from 0.
        view: u8,
    },
    /// The picture of the dry panel. `Done`.
    DryPicture,
    /// Watch the film and judge it. `Filmed`.
    Film,
    /// The grade of what the last contact path did, by the poses that the robot reported. `Graded`.
    Assess,
    /// Plan a path over what this pass must still abrade. `Planned`, `PlannedForReview`, or `Graded` with reject.
    Plan {
        /// Which pass, from 1; 0 is an air-run, over all grids.
        pass: u8,
    },
}

/// A path and the epoch it belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Motion {
    /// The epoch; when it has ended, nothing of the path is sent.
    pub epoch: u32,
    /// Which path.
    pub path: Path,
    /// The plan of a contact path, or of the same in air; 0 for others.
    pub plan: u64,
    /// Waypoints of that path; 1 for others: one target, points on the way are not counted.
    pub waypoints: u32,
}

impl Motion {
    /// The plan's number as people and records name it.
    pub fn plan_word(&self) -> String {
        format!("{:016x}", self.plan)
    }
}

/// The destination of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Path {
    /// To the park pose, by axes.
    Park,
    /// To a corner pose of the flange camera, in air.
    Corner {
        /// Which, from 0.
        view: u8,
    },
    /// To the air point before the first contact.
    Approach,
    /// Landing, abrasion and leaving, with the tool running; ends in air.
    Contact,
    /// The same path lifted off the panel, with the tool off.
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

/// How a motion ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "lowercase")]
pub enum Outcome {
    /// At its end.
    Done,
    /// By a hold.
    Held,
    /// By a stop.
    Stopped,
    /// By an abort.
    Aborted,
    /// Unknown until the robot was asked; a person cleared it.
    Cleared,
}

impl Outcome {
    /// The word on the page.
    pub fn word(self) -> &'static str {
        self.into()
    }
}

/// Why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// Not in this state.
    NotNow,
    /// The robot is not ready.
    Robot(Robot),
    /// Held for review: accept it, or confirm that the panel is dry and locate again.
    Review,
    /// Held until the panel is dried: confirm that it is.
    Undried,
    /// A reset came to this.
    Failed(Trouble),
}
