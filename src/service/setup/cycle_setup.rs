//! The constant data of a cell and of a cycle, which are read once.

use super::fault::SetupFault;
use super::proof_gate::ProofGate;
use super::wiring::Wiring;
use crate::requirements::recipe_fits::check_force;
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

/// The calibrated poses of the cameras and the tool, and their errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibrations {
    /// The 3D camera.
    pub scanner: PinholeCamera,
    /// The measurement errors of the 3D camera.
    pub scan_errors: ScanErrors,
    /// Its pose.
    pub base_from_camera: Rigid<Base, Camera>,
    /// The flange camera.
    pub flange_camera: PinholeCamera,
    /// The pose of the flange camera in the flange frame.
    pub flange_from_camera: Rigid<Flange, FlangeCamera>,
    /// The pose of the sanding tool's contact point in the flange frame.
    pub flange_from_tool: Rigid<Flange, Tool>,
    /// Uncertainty of the hand-eye calibrations of both cameras at the panel, mm, 95 %, if the calibration files
    /// contain it.
    pub hand_eye_mm: Option<f64>,
    /// Uncertainty of robot and tool, mm, 95 %, if it was measured by touching known points.
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
    /// Bit number of the selector switch in `In` of the state message; the bit is on in the position local.
    pub control_bit: Option<u32>,
    /// The output that warns before the first motion, and its bit number in `Out` of the state message.
    pub warning_output: Option<(u16, u32)>,
    /// The compliant tool, if the cell has one.
    pub tool: Option<CompliantTool>,
    /// The checksum of the controller's accepted programs, if the cell's file contains it.
    pub programs_sum: Option<i32>,
    /// Whether the acceptance tests of the controller permit a motion.
    pub proofs: ProofGate,
    /// The pose in which the arm parks.
    pub park_pose: Joints,
    /// `[poses.ready]`: the pose through which the arm moves to and from the park pose, if the cell has one.
    pub ready_pose: Option<Joints>,
}

impl CellSetup {
    /// Reads the values from the cell's file.
    ///
    /// # Errors
    /// If the cell's file does not name everything that a cycle needs.
    pub fn new(cell: &Cell) -> Result<Self, SetupFault> {
        cell.limits().workspace().ok_or(SetupFault::NotStated { key: "limits.box_min_mm" })?;
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
            park_pose: cell.park_pose().ok_or(SetupFault::NotStated { key: "poses.park" })?,
            ready_pose: cell.pose("ready"),
        })
    }

    /// Returns these values for a replay, which moves no robot.
    #[must_use]
    pub fn for_replay(self) -> Self {
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
    /// The taught corners of the panel; the corner loop uses the first ones whose moves pass the path checks.
    pub corners: Vec<TaughtCorner>,
    /// The calibrations.
    pub calibrations: Calibrations,
    /// The area of the picture in which the flange camera's lens is calibrated.
    pub lens: LensExtent,
    /// The depth that earlier cycles removed from this part.
    pub removed_before: EarlierRemoval,
    /// Whether foam is in the cell instead of a panel: contact then requires a lower stage of the acceptance tests.
    pub on_foam: bool,
}

impl CycleSetup {
    /// Combines the cell, the recipe, the taught panel with its corners, and the calibrations with the calibrated area
    /// of the flange camera's lens.
    ///
    /// # Errors
    /// If no corner was taught, or a corner was taught in an area of the picture in which the lens is not calibrated,
    /// because the camera would view the corner there again. If the recipe contains a force and the cell has no
    /// compliant tool, or if the cell has a compliant tool and the recipe contains no force.
    pub fn new(
        cell: Arc<CellSetup>,
        recipe: Recipe,
        (panel, corners): (TaughtPanel, Vec<TaughtCorner>),
        (calibrations, lens): (Calibrations, LensExtent),
    ) -> Result<Self, SetupFault> {
        check_force(cell.tool.as_ref(), &recipe)?;
        if corners.is_empty() {
            return Err(SetupFault::NoCorner);
        }
        let pixels = corners.iter().map(|corner| corner.teaching_data.reference_px);
        if let Some(reason) = health::lens_extent_refusal(&lens, pixels) {
            return Err(SetupFault::CornerOutsideOfLens(reason.message));
        }
        let removed_before = EarlierRemoval::default();
        let taught_model = Arc::default();
        let on_foam = false;
        Ok(CycleSetup { cell, recipe, panel, taught_model, corners, calibrations, lens, removed_before, on_foam })
    }

    /// Returns this setup for a part from which earlier cycles removed this depth.
    #[must_use]
    pub fn with_earlier_removal(self, removed_before: EarlierRemoval) -> Self {
        CycleSetup { removed_before, ..self }
    }

    /// Returns this setup for foam instead of the panel.
    #[must_use]
    pub fn with_foam(self, on_foam: bool) -> Self {
        CycleSetup { on_foam, ..self }
    }

    /// Returns the taught panel in the form that the localization uses, or the reason why it cannot be used. The first
    /// call computes it.
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

    /// Returns the route of the arm through the views of the taught corners.
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
