//! The one loop: an event, the table's step, its effects; then the next event.
//!
//! ```text
//! requests ─┐                    ┌─ record: journal first, then everything else
//! deadlines ┼─ event ─ step ─────┼─ robot: switches, frames, paths      (`acts`, `moves`, `wiring`)
//! robot ────┘                    └─ cameras and computing               (`computing`, `sight`, `abrasion`)
//! ```
//!
//! The table decides (see `cycle`); the loop performs. What an act works with (the scan's fit, the refined place, the film,
//! the plan) stays in the loop and never enters the table, which hears ids, counts and grades. Acts that see and compute go
//! through one queue (`computing`): a thread empties it while the loop goes on answering, or the loop itself does in a replay and
//! in the simulated cell of one command. What was abandoned meanwhile changes nothing. The robot's link has a thread of its own,
//! and its controller stops by itself where nobody feeds it.
//!
//! Time is the robot's. In lock step it is the mock controller's virtual clock, so that sprays, films and deadlines take no real
//! time, and it stands while something is computed.
//!
//! A service, a single cycle and a replay are this same loop on other `ports`. Around the loop of the service stand `request`
//! (the one request of every front) · `socket` (the front on this computer) · `protocol` (a line in, a line out) · `gateway` (a
//! request in, a reply out) · `request_queue` (what waits, by its urgency) · `request_handler` (requests, signals and systemd, as
//! the loop sees them) · `lending` (the cameras, for others, between cycles) · `words` (states and refusals for people). `replay`
//! records what passes through the ports, and runs a cycle again on a recording.

mod abrasion;
mod acts;
mod caller;
mod cameras;
mod computing;
mod contacts;
mod corners;
mod corrected;
mod deadlines;
mod gateway;
mod lending;
mod moves;
mod ports;
mod protocol;
mod recording;
mod replay;
mod request;
mod request_handler;
mod request_log;
mod request_queue;
mod robot_reports;
mod run;
mod sight;
mod single;
mod single_interlocks;
mod socket;
mod wiring;
mod without_store;
mod words;

#[cfg(test)]
mod tests;

pub use caller::whoever_runs_this;
pub use cameras::Cameras;
pub use computing::{Computing, Memory, Readable, Seen};
pub use gateway::{Gateway, Loader};
pub use lending::{AllCameras, BorrowedFlangeCamera, BorrowedScanner, LastState, SharedCameras, ShotRequest};
pub use ports::{
    CameraAnswer, CameraCommand, CameraFault, CameraPort, Command, Figure, Finding, Keeper, Kept, LinkedRobot,
    News, NoCameras, Note, Picture2d, Port, Record, RecordAnswer, RecordCommand, RecordError, RecordPort,
    RequestAnswer, RequestCommand, RequestPort, Requester, RobotAnswer, RobotCommand, RobotPort,
};
pub use protocol::{Exit, MOST_BYTES, ProtocolError, Reply, read_request, request_line};
pub use recording::{FLOOR_MB, StoreRecord, keeper};
pub use replay::{
    Difference, Played, Player, RECORDING_FLOOR_MB, Recorded, RecordedPort, Recording, RecordingPlan,
    RecordingSwitch, Stands, free_mb, recording_file, recordings, too_full,
};
pub use request::{PartNames, PreparedCycle, RecordIn, Request, StartRequest, What};
pub use request_handler::{EndedCycle, RequestHandler, ServiceParts, WrittenPage};
pub use request_queue::{NotTaken, RequestQueue, RequestSender, request_queue};
pub use run::{LoopOutcome, LoopStart, Ports, run};
pub use single::{Line, Single, SingleError, speeds};
pub use socket::{Socket, SocketError};
pub use wiring::Wiring;
pub use without_store::wait_for;
pub use words::{refusal, request_word, why};

use crate::cell::{Arm, Cell, Limits};
use crate::geometry::{Base, Camera, Flange, FlangeCamera, Joints, PinholeCamera, Rigid, Tool};
use crate::inspect::Demands;
use crate::panel::{TaughtCorner, TaughtPanel};
use crate::path::approach::CornerTour;
use crate::recipe::Recipe;
use crate::supervision::ThreadFault;
use std::sync::Arc;

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

/// What the cell's file states of the cell, for every cycle and between cycles.
#[derive(Debug, Clone, PartialEq)]
pub struct CellSetup {
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

impl CellSetup {
    /// Takes what the cell's file states.
    ///
    /// # Errors
    /// Where the cell does not name what a cycle needs.
    pub fn new(cell: &Cell) -> Result<Self, DaemonError> {
        cell.limits().workspace().ok_or(DaemonError::NotStated { key: "limits.box_min_mm" })?;
        Ok(CellSetup {
            limits: cell.limits().clone(),
            arm: cell.arm().clone(),
            wiring: Wiring::of(cell.io())?,
            park: cell.park().ok_or(DaemonError::NotStated { key: "poses.park" })?,
            ready: cell.pose("ready"),
        })
    }
}

/// What one cycle works with: the loop and the thread that computes share it, and nothing of it changes while the cycle runs.
#[derive(Debug, Clone)]
pub struct CycleSetup {
    cell: Arc<CellSetup>,
    recipe: Recipe,
    panel: TaughtPanel,
    corners: Vec<TaughtCorner>,
    calibrations: Calibrations,
}

impl CycleSetup {
    /// Joins the cell, the recipe, the taught panel with its corners, and the calibrations.
    ///
    /// # Errors
    /// Where no corner was taught.
    pub fn new(
        cell: Arc<CellSetup>,
        recipe: Recipe,
        (panel, corners): (TaughtPanel, Vec<TaughtCorner>),
        calibrations: Calibrations,
    ) -> Result<Self, DaemonError> {
        if corners.is_empty() {
            return Err(DaemonError::NoCorner);
        }
        Ok(CycleSetup { cell, recipe, panel, corners, calibrations })
    }

    /// The panel's name.
    pub fn panel_name(&self) -> &str {
        self.recipe.panel()
    }

    /// The cell.
    pub fn cell(&self) -> Arc<CellSetup> {
        self.cell.clone()
    }

    /// The same as the phases take it.
    pub fn job(&self) -> Job<'_> {
        Job {
            recipe: &self.recipe,
            panel: &self.panel,
            corners: &self.corners,
            calibrations: self.calibrations,
            limits: &self.cell.limits,
            arm: &self.cell.arm,
            park: self.cell.park,
            ready: self.cell.ready,
        }
    }
}

/// What the phases of a cycle take, all of it borrowed.
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
    /// Where the arm parks.
    pub park: Joints,
    /// `[poses.ready]`: on the way to and from the park pose, where the cell names one.
    pub ready: Option<Joints>,
}

impl Job<'_> {
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
