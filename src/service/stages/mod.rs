//! The phases of a cycle, each implemented once: a function from inputs to a result of checks, drawings and data.
//!
//! A command that reads its inputs from files calls the same function as the live loop with a newly captured picture. A
//! stage has no access to camera, robot, store or clock: the caller captures the picture, calls the stage, measures its
//! duration, records the result, and answers the cycle's state machine.
//!
//! - `locate`: the panel's pose, from the 3D scan · `corners`: the correction by corner pictures, and the verification
//!   before contact · `film`: the water-break test on the pictures of a film
//! - `survey`: the surface with its profile and flatness, and the part of the surface that the arm reaches · `treat`:
//!   the places to sand after a film · `plan`: the path over them · `abrade`: the executed path · `removal`: the
//!   removal by the path
//! - `learn`: panel and corners, learnt from the pictures and scans of a teaching · `arm_poses`: the poses for the
//!   calibration of the arm

pub mod abrade;
pub mod arm_poses;
pub mod corners;
pub mod film;
pub mod learn;
pub mod locate;
pub mod plan;
pub mod removal;
pub mod survey;
pub mod treat;

use crate::report::ReasonPicture;
use panelprep_base::geometry::ColorPicture;
use panelprep_base::verdict::{Check, Judgement, Reason};
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::GridId;
use panelprep_cell::record::{Finding, Kind};

/// A picture that explains a result to a person, or the error that prevented the picture. No decision depends on the
/// picture.
#[derive(Debug)]
pub struct ResultDrawing {
    /// The picture's short name, for example `corner_before`.
    pub name: String,
    /// Caption of the drawing.
    pub caption: String,
    /// The picture.
    pub picture: Result<ColorPicture, ImagingError>,
}

impl ResultDrawing {
    fn new(name: &str, caption: impl Into<String>, picture: Result<ColorPicture, ImagingError>) -> Self {
        ResultDrawing { name: name.to_owned(), caption: caption.into(), picture }
    }
}

impl From<ReasonPicture> for ResultDrawing {
    fn from(drawn: ReasonPicture) -> Self {
        ResultDrawing::new(&format!("reason_{}", drawn.code), drawn.caption, drawn.picture)
    }
}

/// Returns the finding of a phase that was rejected for this reason before it measured anything.
pub fn rejected(kind: Kind, pass: u8, reason: Reason) -> Finding {
    Finding::new(kind, pass, Judgement::new(vec![reason], vec![]))
}

/// Returns the finding of a phase that could not be executed for this reason. This is a fault of the cell, which a
/// person examines; it is no result about the panel.
pub fn not_executed_finding(kind: Kind, pass: u8, reason: Reason) -> Finding {
    Finding::new(kind, pass, Judgement::new(vec![], vec![reason]))
}

/// Returns the finding of a phase that was rejected by this check.
pub fn rejected_finding(kind: Kind, pass: u8, check: Check) -> Finding {
    Finding::new(kind, pass, Judgement::from_checks([&check])).with_checks([check])
}

fn reason(code: &'static str, error: &dyn std::error::Error) -> Reason {
    Reason::new(code, error.to_string())
}

fn names(grids: &[GridId]) -> Vec<String> {
    grids.iter().map(ToString::to_string).collect()
}
