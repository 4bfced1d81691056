//! The setup of a cell and of a cycle: read once, then never changed.

use super::error::DaemonError;
use super::proof_gate::ProofGate;
use super::wiring::Wiring;
use crate::requirements::recipe_fits::force_fits;
use crate::stages::removal::EarlierRemoval;
use panelprep_base::geometry::{Base, Camera, Flange, FlangeCamera, Joints, PinholeCamera, Rigid, Tool};
use panelprep_cell::cell::{Arm, Cell, CompliantTool, LOCAL_CONTROL, LensExtent, Limits, WARNING};
use panelprep_cell::panel::{TaughtCorner, TaughtPanel};
use panelprep_cell::recipe::Recipe;
use panelprep_toolpath::path::approach::CornerTour;
use panelprep_toolpath::path::routes::Sander;
use panelprep_toolpath::removal::model::Model;
use panelprep_vision::calib::health;
use panelprep_vision::inspect::Demands;
use panelprep_vision::locate::{LocateError, ScanErrors, TaughtModel};
use std::sync::{Arc, OnceLock};

/// Poses of the cameras and the tool, as calibrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibrations {
    /// The 3D camera.
    pub scanner: PinholeCamera,
    /// The errors of the 3D camera itself.
    pub scan_errors: ScanErrors,
    /// Its pose.
    pub base_from_camera: Rigid<Base, Camera>,
    /// The flange camera.
    pub flange_camera: PinholeCamera,
    /// The pose of the flange camera on the flange.
    pub flange_from_camera: Rigid<Flange, FlangeCamera>,
    /// The pose of the contact point of the sanding tool.
    pub flange_from_tool: Rigid<Flange, Tool>,
    /// Uncertainty of the hand-eye calibrations of both cameras at the panel, mm, 95 %, if the calibration files state
    /// it.
    pub hand_eye_mm: Option<f64>,
    /// Uncertainty of robot and tool, mm, 95 %, if the tool touched known points.
    pub robot_mm: Option<f64>,
    /// The removal model of the disc, if it is calibrated.
    pub removal: Option<Model>,
}

/// Values of the cell's file that apply to every cycle and between cycles.
#[derive(Debug, Clone, PartialEq)]
pub struct CellSetup {
    /// The cell's limits.
    pub limits: Limits,
    /// The arm.
    pub arm: Arm,
    /// Outputs and feedbacks.
    pub wiring: Wiring,
    /// The bit of `In` in the state message for the selector switch; it is on in the position local.
    pub control_bit: Option<u32>,
    /// The output that warns before the first motion, with its bit in `Out` of the state message.
    pub warning_output: Option<(u16, u32)>,
    /// The compliant tool, if the cell has one.
    pub tool: Option<CompliantTool>,
    /// The checksum of the controller's programs that were accepted, if the cell's file states it.
    pub programs_sum: Option<i32>,
    /// Whether the proofs of the controller permit a motion.
    pub proofs: ProofGate,
    /// The pose in which the arm parks.
    pub park_pose: Joints,
    /// `[poses.ready]`: the pose through which the arm moves to and from the park pose, if the cell has one.
    pub ready_pose: Option<Joints>,
}

impl CellSetup {
    /// Reads the values that the cell's file states.
    ///
    /// # Errors
    /// If the cell's file does not name everything that a cycle needs.
    pub fn new(cell: &Cell) -> Result<Self, DaemonError> {
        cell.limits().workspace().ok_or(DaemonError::NotStated { key: "limits.box_min_mm" })?;
        Ok(CellSetup {
            limits: cell.limits().clone(),
            arm: cell.arm().clone(),
            wiring: Wiring::from_io(cell.inputs_outputs())?,
            control_bit: cell.inputs_outputs().input_bit(LOCAL_CONTROL),
            warning_output: cell
                .inputs_outputs()
                .outputs()
                .get(WARNING)
                .and_then(|&number| Some((number, cell.inputs_outputs().output_bit(number)?))),
            programs_sum: cell.robot().programs_sum(),
            proofs: ProofGate::Controller(cell.robot().clone()),
            tool: cell.tool().compliant().cloned(),
            park_pose: cell.park_pose().ok_or(DaemonError::NotStated { key: "poses.park" })?,
            ready_pose: cell.pose("ready"),
        })
    }

    /// Returns the same cell for a replay, which moves nothing.
    #[must_use]
    pub fn replayed(self) -> Self {
        CellSetup { proofs: ProofGate::Replay, ..self }
    }
}

/// The data of one cycle. The loop and the computing thread share them; they do not change while the cycle runs.
#[derive(Debug, Clone)]
pub struct CycleSetup {
    /// The cell.
    pub cell: Arc<CellSetup>,
    /// The recipe.
    pub recipe: Recipe,
    /// The taught panel.
    pub panel: TaughtPanel,
    taught_model: Arc<OnceLock<Result<TaughtModel, LocateError>>>,
    /// The taught corners of the panel; the corner loop uses the first ones whose moves pass the gate.
    pub corners: Vec<TaughtCorner>,
    /// The calibrations.
    pub calibrations: Calibrations,
    /// The area of the picture in which the flange camera's lens is calibrated.
    pub lens: LensExtent,
    /// The depth that earlier cycles removed from this part.
    pub removed_before: EarlierRemoval,
    /// Whether foam lies in the cell in place of a panel: contact then needs a lower stage of the proofs.
    pub on_foam: bool,
}

impl CycleSetup {
    /// Combines the cell, the recipe, the taught panel with its corners, and the calibrations with the calibrated area
    /// of the flange camera's lens.
    ///
    /// # Errors
    /// If no corner was taught, or if one was taught in an area of the picture in which the lens is not calibrated: the
    /// camera would view the corner there again. If the recipe states a force and the cell has no compliant tool, or if
    /// it has one and the recipe states no force.
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
        let pixels = corners.iter().map(|corner| corner.teaching_data.reference_px);
        if let Some(reason) = health::lens_extent_refusal(&lens, pixels) {
            return Err(DaemonError::CornerOutsideOfLens(reason.message));
        }
        let removed_before = EarlierRemoval::default();
        let taught_model = Arc::default();
        let on_foam = false;
        Ok(CycleSetup { cell, recipe, panel, taught_model, corners, calibrations, lens, removed_before, on_foam })
    }

    /// Returns the same setup for a part from which earlier cycles removed this amount.
    #[must_use]
    pub fn with_earlier_removal(self, removed_before: EarlierRemoval) -> Self {
        CycleSetup { removed_before, ..self }
    }

    /// Returns the same setup for foam in place of the panel.
    #[must_use]
    pub fn with_foam(self, on_foam: bool) -> Self {
        CycleSetup { on_foam, ..self }
    }

    /// Returns the taught panel as the localization uses it, or the reason why it cannot be used; the first call
    /// computes it.
    pub fn taught_model(&self) -> &Result<TaughtModel, LocateError> {
        let range = self.calibrations.scan_errors.range;
        self.taught_model.get_or_init(|| TaughtModel::from_panel(&self.panel, range))
    }

    /// The panel's name.
    pub fn panel_name(&self) -> &str {
        self.recipe.panel()
    }

    /// The cell.
    pub fn cell(&self) -> Arc<CellSetup> {
        self.cell.clone()
    }

    /// Returns the arm's tour through the views of the taught corners.
    pub fn corner_tour(&self) -> CornerTour<'_> {
        CornerTour {
            limits: &self.cell.limits,
            arm: &self.cell.arm,
            park: self.cell.park_pose,
            ready: self.cell.ready_pose,
            flange_from_camera: self.calibrations.flange_from_camera,
            sander: self.sander(),
            corners: &self.corners,
        }
    }

    /// Returns the sander of the cell with the disc of the recipe.
    pub fn sander(&self) -> Sander {
        Sander::new(self.calibrations.flange_from_tool, self.recipe.path())
    }

    /// Returns the requirements for a film.
    pub fn film_demands(&self) -> Demands {
        Demands::from_recipe(&self.recipe, &self.cell.limits)
    }
}
