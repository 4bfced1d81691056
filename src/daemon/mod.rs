//! The one loop: an event, the table's step, its effects; then the next event.
//!
//! ```text
//! requests ─┐                    ┌─ record: journal first, then everything else
//! deadlines ┼─ event ─ step ─────┼─ robot: switches, frames, paths      (`acts`, `moves`, `wiring`)
//! robot ────┘                    └─ cameras and computing               (`sight`, `abrasion`)
//! ```
//!
//! The table decides (see `cycle`), this performs. What an act works with — the scan's fit, the refined place, the
//! film, the plan — stays here and never enters the table: it hears ids, counts and grades. In the service acts that
//! see and compute have a thread of their own (`computing`), and the loop goes on answering; what was abandoned
//! meanwhile changes nothing. The robot's link has its own thread too, and its controller stops by itself where nobody
//! feeds it.
//!
//! Time is the robot's: in lock step its virtual clock, so that sprays, films and deadlines take no real time; it
//! stands while something is computed.
//!
//! The service around the loop: `request` (the one request of every front) · `socket` (the front on this computer) · `protocol`
//! (a line in, a line out) · `gateway` (a request in, a reply out) · `request_queue` (what waits, by its urgency) ·
//! `request_handler` (requests, signals and systemd, seen from the loop) · `lending` (its cameras, for others, between cycles) ·
//! `words` (states and refusals for people). `replay` writes down what passes between loop and ports, and runs a cycle again
//! on it.

mod abrasion;
mod acts;
mod asking;
mod caller;
mod cameras;
mod computing;
mod contacts;
mod corners;
mod corrected;
mod deadlines;
mod gateway;
mod hearing;
mod lending;
mod moves;
mod ports;
mod protocol;
mod recording;
mod replay;
mod request;
mod request_handler;
mod request_queue;
mod run;
mod sight;
mod single;
mod single_interlocks;
mod socket;
mod waiting;
mod wiring;
mod words;

#[cfg(test)]
mod tests;

pub use caller::whoever_runs_this;
pub use cameras::Cameras;
pub use gateway::{Gateway, Loader};
pub use lending::{AllCameras, BorrowedFlangeCamera, BorrowedScanner, LastState, SharedCameras, ShotRequest};
pub use ports::{
    Eyes, Figure, Finding, Journal, Keeper, Kept, LinkedRobot, Picture2d, Record, RecordError, Requests, Robot,
    SightError,
};
pub use protocol::{Exit, MOST_BYTES, ProtocolError, Reply, read_request, request_line};
pub use recording::{FLOOR_MB, StoreRecord, keeper};
pub use replay::{
    Difference, Played, Player, RECORDING_FLOOR_MB, Recorded, Recording, RecordingPlan, RecordingSwitch, Stands,
    Taped, free_mb, recording_file, recordings, too_full,
};
pub use request::{PartNames, PreparedCycle, RecordIn, Request, StartRequest, What};
pub use request_handler::{EndedCycle, RequestHandler, ServiceParts, WrittenPage};
pub use request_queue::{NotTaken, RequestQueue, RequestSender, request_queue};
pub use run::{CycleOutcome, Ports, Service, run_cycle, run_cycle_from, serve};
pub use single::{Line, Single, SingleError, speeds};
pub use socket::{Socket, SocketError};
pub use waiting::wait_for;
pub use wiring::Wiring;
pub use words::{refusal, request_word, why};

use crate::cell::{Arm, Cell, Limits};
use crate::geometry::{Base, Camera, Flange, FlangeCamera, Joints, PinholeCamera, Rigid, Tool};
use crate::inspect::Demands;
use crate::panel::{TaughtCorner, TaughtPanel};
use crate::path::approach::CornerTour;
use crate::recipe::Recipe;
use crate::supervision::ThreadFault;

/// Where cameras and tool are, as calibrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibrations {
    /// The 3D camera.
    pub scanner: PinholeCamera,
    /// Where it stands.
    pub base_from_camera: Rigid<Base, Camera>,
    /// The flange camera.
    pub flange_camera: PinholeCamera,
    /// How it is mounted.
    pub flange_from_camera: Rigid<Flange, FlangeCamera>,
    /// Where the sanding tool's contact is.
    pub flange_from_tool: Rigid<Flange, Tool>,
    /// Error of both camera mounts at the panel, mm, 95 %, where their files state it.
    pub hand_eye_mm: Option<f64>,
    /// Error of robot and tool, mm, 95 %, where the tool was touched against known points.
    pub robot_mm: Option<f64>,
}

/// What the cell is to every cycle, and between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Site {
    /// The cell's limits.
    pub limits: Limits,
    /// The arm.
    pub arm: Arm,
    /// Outputs and feedbacks.
    pub wiring: Wiring,
    /// Where the arm parks.
    pub park: Joints,
    /// `[poses.ready]`: on the way to and from the park pose, where the cell names one.
    pub ready: Option<Joints>,
}

impl Site {
    /// Takes what the cell's file states.
    ///
    /// # Errors
    /// Where the cell does not name what a cycle needs.
    pub fn new(cell: &Cell) -> Result<Self, DaemonError> {
        cell.limits().workspace().ok_or(DaemonError::NotStated { key: "limits.box_min_mm" })?;
        Ok(Site {
            limits: cell.limits().clone(),
            arm: cell.arm().clone(),
            wiring: Wiring::of(cell.io())?,
            park: cell.park().ok_or(DaemonError::NotStated { key: "poses.park" })?,
            ready: cell.pose("ready"),
        })
    }
}

/// What one cycle of the service works by; there is a corner.
#[derive(Debug, Clone)]
pub struct CycleSetup {
    recipe: Recipe,
    panel: TaughtPanel,
    corners: Vec<TaughtCorner>,
    calibrations: Calibrations,
}

impl CycleSetup {
    /// Joins recipe, taught panel and its corners, and calibrations.
    ///
    /// # Errors
    /// Where no corner was taught.
    pub fn new(
        recipe: Recipe,
        (panel, corners): (TaughtPanel, Vec<TaughtCorner>),
        calibrations: Calibrations,
    ) -> Result<Self, DaemonError> {
        if corners.is_empty() {
            return Err(DaemonError::NoCorner);
        }
        Ok(CycleSetup { recipe, panel, corners, calibrations })
    }

    /// The panel's name.
    pub fn panel_name(&self) -> &str {
        self.recipe.panel()
    }

    /// The same with its cell, as the phases see it.
    fn job<'a>(&'a self, site: &'a Site) -> Job<'a> {
        Job {
            recipe: &self.recipe,
            panel: &self.panel,
            corners: &self.corners,
            calibrations: self.calibrations,
            limits: &site.limits,
            arm: &site.arm,
            wiring: site.wiring,
            park: site.park,
            ready: site.ready,
        }
    }
}

/// What a cycle works by; nothing of it changes while it runs.
#[derive(Debug, Clone)]
pub struct Job<'a> {
    /// The recipe.
    pub recipe: &'a Recipe,
    /// What was taught.
    pub panel: &'a TaughtPanel,
    /// Its corners; the corner loop takes the first ones whose moves pass the gate.
    pub corners: &'a [TaughtCorner],
    /// The calibrations.
    pub calibrations: Calibrations,
    /// The cell's limits.
    pub limits: &'a Limits,
    /// The arm.
    pub arm: &'a Arm,
    /// Outputs and feedbacks.
    pub wiring: Wiring,
    /// Where the arm parks.
    pub park: Joints,
    /// `[poses.ready]`: on the way to and from the park pose, where the cell names one.
    pub ready: Option<Joints>,
}

impl<'a> Job<'a> {
    /// Joins what the files say.
    ///
    /// # Errors
    /// Where the cell does not name what a cycle needs, or no corner was taught.
    pub fn new(
        cell: &'a Cell,
        recipe: &'a Recipe,
        (panel, corners): (&'a TaughtPanel, &'a [TaughtCorner]),
        calibrations: Calibrations,
    ) -> Result<Self, DaemonError> {
        if corners.is_empty() {
            return Err(DaemonError::NoCorner);
        }
        let limits = cell.limits();
        limits.workspace().ok_or(DaemonError::NotStated { key: "limits.box_min_mm" })?;
        Ok(Job {
            recipe,
            panel,
            corners,
            calibrations,
            limits,
            arm: cell.arm(),
            wiring: Wiring::of(cell.io())?,
            park: cell.park().ok_or(DaemonError::NotStated { key: "poses.park" })?,
            ready: cell.pose("ready"),
        })
    }

    /// The cell alone.
    fn site(&self) -> Site {
        let (limits, arm) = (self.limits.clone(), self.arm.clone());
        Site { limits, arm, wiring: self.wiring, park: self.park, ready: self.ready }
    }

    /// The arm's way over the views of the taught corners.
    pub fn tour(&self) -> CornerTour<'_> {
        CornerTour {
            limits: self.limits,
            arm: self.arm,
            park: self.park,
            ready: self.ready,
            flange_from_camera: self.calibrations.flange_from_camera,
            flange_from_tool: self.calibrations.flange_from_tool,
            corners: self.corners,
        }
    }

    /// What is asked of a film.
    pub fn demands(&self) -> Demands {
        Demands::of(self.recipe, self.limits)
    }
}

/// Why a cycle cannot begin, or had to end where no verdict is possible.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// An input or output without a name.
    #[error("the cell's file has no \"{name}\" in [{table}]; a cycle needs it")]
    NotWired {
        /// The table.
        table: &'static str,
        /// The name.
        name: &'static str,
    },
    /// A key that a cycle needs.
    #[error("the cell's file does not state {key}; a cycle needs it")]
    NotStated {
        /// The key.
        key: &'static str,
    },
    /// No corner was taught.
    #[error("no corner of this panel was taught; teach it with --corner and --flange")]
    NoCorner,
    /// The system gives no thread to compute on.
    #[error("the thread that computes cannot start: {0}")]
    Thread(std::io::Error),
    /// A thread of the program failed; the robot was told to stop.
    #[error(transparent)]
    Broken(#[from] ThreadFault),
    /// The store does not write.
    #[error(transparent)]
    Record(#[from] RecordError),
}
