//! The files of a recorded cycle: a recording begins with the files that its cycle uses, and a replay reads them back.

use super::cell_files::CellFiles;
use super::cycle_files::{Calibrated, EARLIER_REMOVAL_TEXT, TaughtRecipe};
use super::cycle_setup::Calibrations;
use super::fault::SetupFault;
use super::recording::RecordingPlan;
use super::teaching::{LoadedPanel, derive};
use crate::stages::removal::EarlierRemoval;
use panelprep_base::geometry::Rigid;
use panelprep_cell::cell::{
    Cell, FlangeCameraMount, Intrinsics, LensExtent, Mount, MountedPose, RemovalCalibration, RobotCorrection,
    ScannerMount, ToolMount,
};
use panelprep_cell::files::{read_flange, write_pose};
use panelprep_cell::recipe::Recipe;
use panelprep_store::store::{TaughtCorner, TeachingInputs};
use panelprep_store::tape::CheckedRecording;
use panelprep_toolpath::removal::model::Model;
use panelprep_vision::locate::ScanErrors;
use std::path::{Path, PathBuf};

/// Returns the first content of a recording of this cycle.
///
/// # Errors
/// If the teaching cannot be read.
pub fn plan_recording(
    file: Option<PathBuf>,
    files: &CellFiles,
    (taught_recipe, calibrated): (&TaughtRecipe, &Calibrated),
) -> Result<RecordingPlan, SetupFault> {
    let teaching = files.store()?.taught(taught_recipe.recipe.panel(), Some(&taught_recipe.taught.version));
    let mut parts = texts(taught_recipe, calibrated)?;
    parts.extend(taught_parts(&teaching.map_err(SetupFault::stage)?.teaching));
    Ok(RecordingPlan { file, files: parts, calibrations: calibrated.values })
}

const RECIPE: &str = "recipe.toml";
const CORRECTION: &str = "robot_correction.toml";
const REMOVAL: &str = "removal.toml";
const VERSION: &str = "taught/version.txt";
const SCAN: &str = "taught/scan.pcd";
const TAUGHT: [&str; 5] = [
    "taught/recipe.toml",
    "taught/scanner.toml",
    "taught/base_from_camera.toml",
    "taught/flange_camera.toml",
    "taught/flange_from_camera.toml",
];

fn corner(index: usize) -> [String; 2] {
    ["png", "json"].map(|kind| format!("taught/corner{}.{kind}", index + 1))
}

fn texts(taught_recipe: &TaughtRecipe, calibrated: &Calibrated) -> Result<Vec<(String, Vec<u8>)>, SetupFault> {
    let start = taught_recipe.start(calibrated)?;
    let files = start.file_texts.into_iter().map(|(name, text)| (format!("{name}.toml"), text.into_bytes()));
    let more = [(RECIPE, start.recipe_text), (VERSION, start.taught_version)];
    Ok(files.chain(more.map(|(name, text)| (name.to_owned(), text.into_bytes()))).collect())
}

fn taught_parts(teaching: &TeachingInputs) -> Vec<(String, Vec<u8>)> {
    let TeachingInputs { recipe_text, scanner_calibration_text, base_from_camera_text, .. } = teaching;
    let TeachingInputs { flange_camera_text, flange_from_camera_text, .. } = teaching;
    let texts =
        [recipe_text, scanner_calibration_text, base_from_camera_text, flange_camera_text, flange_from_camera_text];
    let texts = TAUGHT.into_iter().zip(texts).map(|(name, text)| (name.to_owned(), text.clone().into_bytes()));
    let corners = teaching.corners.iter().enumerate().flat_map(|(index, taught)| {
        let [picture, pose] = corner(index);
        [(picture, taught.picture.clone()), (pose, write_pose(&taught.base_from_flange).into_bytes())]
    });
    texts.chain([(SCAN.to_owned(), teaching.scan.clone())]).chain(corners).collect()
}

/// The files and data that a recorded cycle used.
pub struct RecordedCycle {
    /// The cell.
    pub cell: Cell,
    /// The recipe.
    pub recipe: Recipe,
    /// The taught panel.
    pub taught: LoadedPanel,
    /// The calibrations.
    pub calibrations: Calibrations,
    /// The area of the picture in which the flange camera's lens is calibrated.
    pub lens: LensExtent,
    /// The removal from the part by earlier cycles.
    pub removed_before: EarlierRemoval,
}

impl RecordedCycle {
    /// Reads and checks the files in a recording.
    ///
    /// # Errors
    /// If one is missing or invalid.
    pub fn read(file: &Path, checked: &CheckedRecording) -> Result<Self, SetupFault> {
        let parts = Parts { file, checked };
        let recipe = Recipe::check(RECIPE, parts.text(RECIPE)?)?;
        let flange_camera = parts.intrinsics("flange_camera.toml")?;
        let scanner = parts.intrinsics("scanner.toml")?;
        let calibrations = Calibrations {
            scanner: scanner.camera,
            scan_errors: ScanErrors::from_measured(scanner.errors.as_ref()),
            base_from_camera: parts.mount::<ScannerMount>("base_from_camera.toml")?,
            flange_camera: flange_camera.camera,
            flange_from_camera: parts.mount::<FlangeCameraMount>("flange_from_camera.toml")?,
            flange_from_tool: parts.mount::<ToolMount>("flange_from_tool.toml")?,
            hand_eye_mm: checked.start.hand_eye_mm,
            robot_mm: checked.start.robot_mm,
            removal: parts.removal()?,
        };
        let cell = Cell::check("cell.toml", parts.text("cell.toml")?)?;
        let cell = match checked.files.contains_key(CORRECTION) {
            true => cell.with_arm_correction(RobotCorrection::check(CORRECTION, parts.text(CORRECTION)?)?.numbers),
            false => cell,
        };
        let (taught, removed_before) = (parts.taught(&recipe, &scanner)?, parts.removed_before()?);
        Ok(RecordedCycle { cell, taught, recipe, calibrations, lens: flange_camera.extent, removed_before })
    }
}

/// The parts of a recording.
struct Parts<'a> {
    file: &'a Path,
    checked: &'a CheckedRecording,
}

impl Parts<'_> {
    fn bytes(&self, name: &str) -> Result<&[u8], SetupFault> {
        let missing = || SetupFault::file_fault(self.file, format!("the recording has no attachment \"{name}\""));
        self.checked.files.get(name).map(Vec::as_slice).ok_or_else(missing)
    }

    fn text(&self, name: &str) -> Result<&str, SetupFault> {
        let named = |error| SetupFault::file_fault(self.file, format!("attachment \"{name}\": {error}"));
        std::str::from_utf8(self.bytes(name)?).map_err(named)
    }

    /// Returns the removal from the part by earlier cycles.
    fn removed_before(&self) -> Result<EarlierRemoval, SetupFault> {
        let name = format!("{EARLIER_REMOVAL_TEXT}.toml");
        if !self.checked.files.contains_key(&name) {
            return Ok(EarlierRemoval::default());
        }
        toml::from_str(self.text(&name)?).map_err(|error| SetupFault::file_fault(self.file, error))
    }

    /// Returns the removal model of the disc, if the cell had one.
    fn removal(&self) -> Result<Option<Model>, SetupFault> {
        if !self.checked.files.contains_key(REMOVAL) {
            return Ok(None);
        }
        Ok(Some(Model::from(&RemovalCalibration::check(REMOVAL, self.text(REMOVAL)?)?.numbers)))
    }

    fn intrinsics(&self, name: &str) -> Result<Intrinsics, SetupFault> {
        Ok(Intrinsics::check(name, self.text(name)?)?)
    }

    fn mount<M: Mount>(&self, name: &str) -> Result<Rigid<M::To, M::From>, SetupFault> {
        Ok(MountedPose::<M>::check(name, self.text(name)?)?.rigid())
    }

    fn taught(&self, recipe: &Recipe, now: &Intrinsics) -> Result<LoadedPanel, SetupFault> {
        let named = |name: &str, error: &dyn std::error::Error| {
            SetupFault::file_fault(self.file, format!("attachment \"{name}\": {error}"))
        };
        let mut corners = Vec::new();
        for [picture, pose] in (0..).map(corner).take_while(|[picture, _]| self.checked.files.contains_key(picture))
        {
            let base_from_flange = read_flange(self.bytes(&pose)?).map_err(|error| named(&pose, &error))?;
            corners.push(TaughtCorner { picture: self.bytes(&picture)?.to_vec(), base_from_flange });
        }
        let text = |index: usize| self.text(TAUGHT[index]).map(str::to_owned);
        let teaching = TeachingInputs {
            name: recipe.panel().to_owned(),
            scan: self.bytes(SCAN)?.to_vec(),
            recipe_text: text(0)?,
            scanner_calibration_text: text(1)?,
            base_from_camera_text: text(2)?,
            corners,
            flange_camera_text: text(3)?,
            flange_from_camera_text: text(4)?,
        };
        let taught_recipe = Recipe::check(TAUGHT[0], &teaching.recipe_text)?;
        let name = |index: usize| format!("recorded corner {}", index + 1);
        derive(&teaching, (&taught_recipe, now), self.text(VERSION)?.to_owned(), &name)
    }
}
