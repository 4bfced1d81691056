//! Reads the inputs of the commands: the cell and its calibrations, recipes, shots, poses, and the taught data.
//!
//! Each file that a command is given is compared with the calibration to which it belongs. The taught data of a panel
//! are derived again from the data in the store.

mod cell_files;

use super::disk;
use super::fault::{Fault, TeachingFault};
use cell_files::name;
pub use cell_files::{CellFiles, LoadedCalibration, NO_AXES, calibrated_serial, last_touch_check};
use panelprep_base::geometry::{Base, Camera, ColorPicture, KukaPose, OrganizedCloud, Panel, PinholeCamera, Rigid};
use panelprep_cell::cell::{FlangeCameraMount, Intrinsics, MountedPose, ScannerMount};
use panelprep_cell::files;
use panelprep_cell::panel::{TaughtCorner, TaughtPanel, TaughtSource, nominal_pose};
use panelprep_cell::recipe::Recipe;
use panelprep_service::requirements::recipe_fits::parse_plausible_recipe;
use panelprep_service::stages::learn;
use panelprep_store::store::{StoredTeaching as KeptTeaching, TeachingInputs};
use panelprep_vision::locate::ScanErrors;
use std::path::{Path, PathBuf};

/// Reads and checks a recipe.
///
/// # Errors
/// If it cannot be read or has problems.
pub fn recipe(file: &Path) -> Result<Recipe, Fault> {
    Ok(parse_plausible_recipe(&name(file), &disk::read_text(file)?)?)
}

/// Reads an organised scan and checks it against the camera's calibration.
///
/// # Errors
/// If the file is not an organised scan, or its size differs from the calibration.
pub fn scan(file: &Path, camera: &PinholeCamera) -> Result<OrganizedCloud<Camera>, Fault> {
    let bytes = disk::read(file)?;
    files::read_cloud(&bytes, camera).map_err(|error| Fault::file_fault(file, error))
}

/// Reads a picture of a clip and checks it against the camera's calibration.
///
/// # Errors
/// If the file is not a picture, or its size differs from the calibration.
pub fn picture(file: &Path, camera: &PinholeCamera) -> Result<ColorPicture, Fault> {
    files::read_color_of(&disk::read(file)?, camera).map_err(|error| Fault::file_fault(file, error))
}

/// Reads the pose of the recipe's panel; without a file, this is its nominal pose.
///
/// # Errors
/// If the file holds no pose, a rejected one, or one of another frame than that of the recipe's panel.
pub fn located(file: Option<&PathBuf>, recipe: &Recipe) -> Result<Rigid<Base, Panel>, Fault> {
    let Some(file) = file else { return Ok(nominal_pose(recipe)) };
    let pose = files::read_located(&disk::read(file)?, Some(TaughtSource::from_recipe(recipe)))
        .map_err(|error| Fault::file_fault(file, error))?;
    Ok(pose.to_rigid())
}

/// Returns the uncertainty of the pose in this file, 95 %, mm; `None` if the file does not state it.
///
/// # Errors
/// If the file holds no pose.
pub fn located_mm(file: &Path) -> Result<Option<f64>, Fault> {
    files::read_located_mm(&disk::read(file)?).map_err(|error| Fault::file_fault(file, error))
}

/// A corner picture with the flange's pose at that picture.
pub struct CornerShot {
    /// The picture's file.
    pub file: PathBuf,
    /// The picture's bytes, for the store.
    pub bytes: Vec<u8>,
    /// The picture.
    pub picture: ColorPicture,
    /// The true pose of the flange.
    pub base_from_flange: KukaPose,
}

/// Returns the true pose of the flange, from this file.
///
/// # Errors
/// If it holds no pose, or it holds no axes although the arm has a correction.
pub fn flange_file(cell_files: &CellFiles, file: &Path) -> Result<KukaPose, Fault> {
    let reported =
        files::read_reported_flange(&disk::read(file)?).map_err(|error| Fault::file_fault(file, error))?;
    cell_files.true_flange(file, &reported)
}

/// Reads corner pictures, each with its pose.
///
/// # Errors
/// If the counts differ, or a file is invalid.
pub fn corner_shots(
    cell_files: &CellFiles,
    pictures: &[PathBuf],
    flanges: &[PathBuf],
    camera: &PinholeCamera,
) -> Result<Vec<CornerShot>, Fault> {
    if pictures.len() != flanges.len() {
        return Err(TeachingFault::CornerWithoutFlange { found: pictures.len(), flanges: flanges.len() }.into());
    }
    let read = |(file, flange): (&PathBuf, &PathBuf)| {
        let bytes = disk::read(file)?;
        let picture = files::read_measured(&bytes, camera).map_err(|error| Fault::file_fault(file, error))?;
        let base_from_flange = flange_file(cell_files, flange)?;
        Ok(CornerShot { file: file.clone(), bytes, picture, base_from_flange })
    };
    pictures.iter().zip(flanges).map(read).collect()
}

/// The taught data of a panel, derived again from the data in the store.
pub struct LoadedPanel {
    /// The panel.
    pub panel: TaughtPanel,
    /// The panel's corners, in the order of teaching.
    pub corners: Vec<TaughtCorner>,
    /// The version of the teaching in the store.
    pub version: String,
}

/// Loads the taught data of the recipe's panel.
///
/// # Errors
/// If the panel was not taught, its files are damaged, or the recipe's `[region]` or `[nominal]` differs from the taught one.
pub fn taught(files: &CellFiles, recipe_file: &Path, recipe: &Recipe) -> Result<LoadedPanel, Fault> {
    let (kept, taught_recipe) = teaching_of(files, recipe_file, recipe)?;
    let now = files.scanner_lens()?;
    derive(&kept.teaching, (&taught_recipe, &now), kept.version, &|index| format!("taught corner {}", index + 1))
}

/// Reads the stored teaching of the recipe's panel, with the recipe of that time.
///
/// # Errors
/// If the panel was not taught, its files are damaged, or the recipe's `[region]` or `[nominal]` differs from the taught one.
pub fn teaching_of(
    files: &CellFiles,
    recipe_file: &Path,
    recipe: &Recipe,
) -> Result<(KeptTeaching, Recipe), Fault> {
    let kept = files.store()?.taught(recipe.panel(), None).map_err(Fault::stage)?;
    let taught_recipe = Recipe::check("the taught recipe", &kept.teaching.recipe_text)?;
    let is_other_region = taught_recipe.region() != recipe.region();
    // The drawing's pose at teaching is part of the taught panel; with another pose, the panel must be taught again.
    if is_other_region || taught_recipe.nominal() != recipe.nominal() {
        return Err(TeachingFault::TaughtOtherwise {
            recipe: recipe_file.to_owned(),
            table: if is_other_region { "region" } else { "nominal" },
            panel: recipe.panel().to_owned(),
            version: kept.version,
        }
        .into());
    }
    Ok((kept, taught_recipe))
}

/// Returns the errors of the camera at teaching. If they were not known then, these are the errors of the same
/// camera that are known now.
fn teaching_scan_errors(then: &Intrinsics, now: &Intrinsics) -> ScanErrors {
    let is_same = then.serial == now.serial && then.camera == now.camera;
    ScanErrors::from_measured(then.errors.as_ref().or_else(|| now.errors.as_ref().filter(|_| is_same)))
}

/// The name of a stored calibration in messages.
const TAUGHT_CALIBRATION: &str = "the taught calibration";

/// Reads the stored data of a teaching and derives the panel from its scan, without the corners.
///
/// # Errors
/// If the scan shows no panel under the region, or a stored calibration is invalid.
pub fn derive_panel(
    teaching: &TeachingInputs,
    (recipe, now): (&Recipe, &Intrinsics),
) -> Result<TaughtPanel, Fault> {
    let kept = TAUGHT_CALIBRATION;
    let lens = Intrinsics::check(kept, &teaching.scanner_calibration_text)?;
    let errors = teaching_scan_errors(&lens, now);
    let camera = lens.camera;
    let base_from_camera = MountedPose::<ScannerMount>::check(kept, &teaching.base_from_camera_text)?.rigid();
    let cloud = files::read_cloud(&teaching.scan, &camera).map_err(Fault::stage)?;
    // A drawing's rays have none of the camera's errors.
    let cloud = if recipe.nominal().is_some() { cloud } else { errors.correct_scan(cloud) };
    TaughtPanel::learn(&cloud, camera, base_from_camera, recipe).map_err(Fault::stage)
}

/// Reads the stored data of a teaching and derives panel and corners from them; `name` gives the name of a corner
/// picture in messages.
///
/// # Errors
/// If the scan shows no panel under the region, or pictures show no corner: all of these are named.
pub fn derive(
    teaching: &TeachingInputs,
    (recipe, now): (&Recipe, &Intrinsics),
    version: String,
    name: &dyn Fn(usize) -> String,
) -> Result<LoadedPanel, Fault> {
    let kept = TAUGHT_CALIBRATION;
    let panel = derive_panel(teaching, (recipe, now))?;
    let mut corners = Vec::with_capacity(teaching.corners.len());
    let mut problems = Vec::new();
    for (index, shot) in teaching.corners.iter().enumerate() {
        let camera = Intrinsics::check(kept, &teaching.flange_camera_text)?.camera;
        let mount = MountedPose::<FlangeCameraMount>::check(kept, &teaching.flange_from_camera_text)?.rigid();
        let picture = files::read_measured(&shot.picture, &camera);
        let picture =
            picture.map_err(|error| TeachingFault::TaughtCorner { number: index + 1, cause: error.to_string() })?;
        let view = (&picture, shot.base_from_flange.to_rigid());
        match learn::teach_corner(&panel, (recipe.corner(), index), view, (&camera, mount)) {
            Ok(corner) => corners.push(corner),
            Err(error) => problems.push(format!("{}: {error}", name(index))),
        }
    }
    if !problems.is_empty() {
        return Err(TeachingFault::Corners(problems).into());
    }
    Ok(LoadedPanel { panel, corners, version })
}
