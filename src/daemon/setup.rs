//! What a cell and a cycle are set up with: read once, then never changed.

use super::error::DaemonError;
use super::wiring::Wiring;
use crate::calib::health;
use crate::cell::{Arm, Cell, CompliantTool, LOCAL_CONTROL, LensExtent, Limits, WARNING};
use crate::geometry::{Base, Camera, Flange, FlangeCamera, Joints, PinholeCamera, Rigid, Tool};
use crate::inspect::Demands;
use crate::locate::{LocateError, ScanErrors, TaughtModel};
use crate::panel::{TaughtCorner, TaughtPanel};
use crate::path::approach::CornerTour;
use crate::recipe::Recipe;
use crate::removal::model::Model;
use crate::requirements::recipe_fits::force_fits;
use crate::stages::removal::RemovedBefore;
use std::sync::{Arc, OnceLock};

/// Where cameras and tool are, as calibrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibrations {
    /// The 3D camera.
    pub scanner: PinholeCamera,
    /// Its own errors.
    pub scan_errors: ScanErrors,
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
    /// What the disc takes off, where that is calibrated.
    pub removal: Option<Model>,
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
    /// The bit of the state message's `In` that is the selector switch, on at local.
    pub control_bit: Option<u32>,
    /// The output that warns before the first motion, with its bit of the state message's `Out`.
    pub warning_output: Option<(u16, u32)>,
    /// The compliant tool, where the sanding tool is one.
    pub tool: Option<CompliantTool>,
    /// The sum of the controller's programs with which the cell was accepted, where one was kept.
    pub programs_sum: Option<i32>,
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
            control_bit: cell.io().input_bit(LOCAL_CONTROL),
            warning_output: cell
                .io()
                .outputs()
                .get(WARNING)
                .and_then(|&number| Some((number, cell.io().output_bit(number)?))),
            programs_sum: cell.robot().programs_sum(),
            tool: cell.tool().compliant().cloned(),
            park: cell.park().ok_or(DaemonError::NotStated { key: "poses.park" })?,
            ready: cell.pose("ready"),
        })
    }
}

/// What one cycle works with: the loop and the thread that computes share it, and nothing of it changes while the cycle runs.
#[derive(Debug, Clone)]
pub struct CycleSetup {
    /// The cell.
    pub cell: Arc<CellSetup>,
    /// The recipe.
    pub recipe: Recipe,
    /// What was taught.
    pub panel: TaughtPanel,
    taught_model: Arc<OnceLock<Result<TaughtModel, LocateError>>>,
    /// Its corners; the corner loop takes the first ones whose moves pass the gate.
    pub corners: Vec<TaughtCorner>,
    /// The calibrations.
    pub calibrations: Calibrations,
    /// Where in its picture the flange camera's lens is known.
    pub lens: LensExtent,
    /// What earlier cycles removed of this part.
    pub removed_before: RemovedBefore,
}

impl CycleSetup {
    /// Joins the cell, the recipe, the taught panel with its corners, and the calibrations with what is known of the flange
    /// camera's lens.
    ///
    /// # Errors
    /// Where no corner was taught, or one where the lens is not known: the camera looks at it there again. Where the recipe
    /// states a force and the tool has none, or the other way round.
    pub fn new(
        cell: Arc<CellSetup>,
        recipe: Recipe,
        (panel, corners): (TaughtPanel, Vec<TaughtCorner>),
        (calibrations, lens): (Calibrations, LensExtent),
    ) -> Result<Self, DaemonError> {
        force_fits(cell.tool.as_ref(), &recipe)?;
        if corners.is_empty() {
            return Err(DaemonError::NoCorner);
        }
        let pixels = corners.iter().map(|corner| corner.teaching.reference_px);
        if let Some(reason) = health::outside_of_lens(&lens, pixels) {
            return Err(DaemonError::CornerOutsideOfLens(reason.message));
        }
        let removed_before = RemovedBefore::default();
        let taught_model = Arc::default();
        Ok(CycleSetup { cell, recipe, panel, taught_model, corners, calibrations, lens, removed_before })
    }

    /// The same for a part of which earlier cycles removed so much.
    #[must_use]
    pub fn after(self, removed_before: RemovedBefore) -> Self {
        CycleSetup { removed_before, ..self }
    }

    /// The taught panel as the localization uses it, or why it is none; the first call makes it.
    pub fn taught_model(&self) -> &Result<TaughtModel, LocateError> {
        let range = self.calibrations.scan_errors.range;
        self.taught_model.get_or_init(|| TaughtModel::of(&self.panel, range))
    }

    /// The panel's name.
    pub fn panel_name(&self) -> &str {
        self.recipe.panel()
    }

    /// The cell.
    pub fn cell(&self) -> Arc<CellSetup> {
        self.cell.clone()
    }

    /// The arm's way over the views of the taught corners.
    pub fn tour(&self) -> CornerTour<'_> {
        CornerTour {
            limits: &self.cell.limits,
            arm: &self.cell.arm,
            park: self.cell.park,
            ready: self.cell.ready,
            flange_from_camera: self.calibrations.flange_from_camera,
            flange_from_tool: self.calibrations.flange_from_tool,
            corners: &self.corners,
        }
    }

    /// What is asked of a film.
    pub fn demands(&self) -> Demands {
        Demands::of(&self.recipe, &self.cell.limits)
    }
}
