//! A cycle on tape: recorded while it runs, and run again on what was recorded.
//!
//! `taped` stands around the loop's ports and writes down what passes (`tape` says what that is), while `taping` says that
//! a cycle is recorded; `queue` takes it to a thread of its own, so that neither loop nor link ever waits for a disk. `player` is the same ports without a cell: it
//! answers each call with what came then, and notes where the loop now does something else (`difference`).

mod difference;
mod form;
mod player;
mod queue;
mod taped;
mod taping;

#[cfg(test)]
mod tests;

pub use difference::Difference;
pub use player::{Played, Player};
pub use queue::{RECORDING_FLOOR_MB, Recorded, Recording, Stands, too_full};
pub use taped::Taped;
pub use taping::{RecordingPlan, RecordingSwitch, free_mb, recording_file, recordings};

use super::ports::{Kept, SightError};
use crate::cycle::{Motion, Outcome};
use crate::phase::Phase;
use crate::record::name;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// What a camera answers, as it is written down: of a picture its size, and when it was taken.
#[derive(Debug, Serialize, Deserialize)]
struct Seen {
    size_px: [usize; 2],
    /// By the camera's own clock; none of a shot that is not timed.
    time_s: Option<f64>,
}

/// A camera's trouble, as it is written down.
#[derive(Debug, Serialize, Deserialize)]
struct Blind {
    camera: String,
    why: String,
}

impl Blind {
    fn of(error: &SightError) -> Self {
        Blind { camera: error.camera.to_owned(), why: error.why.clone() }
    }

    fn error(self) -> SightError {
        let known = ["the scanner", "the flange camera"];
        let camera = known.into_iter().find(|name| *name == self.camera).unwrap_or("a camera");
        SightError { camera, why: self.why }
    }
}

/// A value as it is written down; null where it cannot be.
fn told(value: &impl Serialize) -> Value {
    serde_json::to_value(value).unwrap_or(Value::Null)
}

/// A finding as it is written down, without what a stop-watch said: that is the machine's doing.
fn timeless(mut finding: Value) -> Value {
    let numbers = finding.get_mut("numbers").and_then(Value::as_array_mut);
    for number in numbers.into_iter().flatten() {
        let stopped = number["name"].as_str().is_some_and(|name| STOPPED.contains(&name));
        if stopped {
            number["value"] = Value::Null;
        }
    }
    finding
}

/// Numbers by the wall clock, which no decision uses.
const STOPPED: [&str; 2] = [name::SCAN_TO_VERDICT, name::PER_PICTURE];

// What is kept, in the one form for both sides. A picture that was kept beside the loop is told as one that is kept now.

fn said_picture(name: &str) -> Value {
    json!({ "picture": name })
}

fn said_frame(time_s: f64, phase: Phase) -> Value {
    json!({ "frame": { "time_s": time_s, "phase": phase.word() } })
}

fn said_figure(name: &str, caption: &str) -> Value {
    json!({ "figure": { "name": name, "caption": caption } })
}

fn said_kept(kept: &Kept) -> Value {
    match kept {
        Kept::Shot(shot) => said_picture(&shot.name),
        Kept::Frame(frame) => said_frame(frame.time_s, frame.phase),
        Kept::Figure(figure) => said_figure(&figure.name, &figure.caption),
    }
}

/// The question what of the panel was abraded in earlier cycles.
const ABRADED_BEFORE: &str = "abraded_before";

fn said_closed(motion: &Motion, outcome: Outcome, done: u32) -> Value {
    json!({ "close_intent": { "motion": motion, "outcome": outcome, "done": done } })
}
