//! The taught data of a panel, derived again from the data in the store.

use super::cell_files::CellFiles;
use super::fault::SetupFault;
use crate::stages::learn;
use panelprep_cell::cell::{FlangeCameraMount, Intrinsics, MountedPose, ScannerMount};
use panelprep_cell::files;
use panelprep_cell::panel::{TaughtCorner, TaughtPanel};
use panelprep_cell::recipe::Recipe;
use panelprep_store::store::{StoredTeaching, TeachingInputs};
use panelprep_vision::locate::ScanErrors;
use std::path::Path;

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
pub fn taught(files: &CellFiles, recipe_file: &Path, recipe: &Recipe) -> Result<LoadedPanel, SetupFault> {
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
) -> Result<(StoredTeaching, Recipe), SetupFault> {
    let kept = files.store()?.taught(recipe.panel(), None).map_err(SetupFault::stage)?;
    let taught_recipe = Recipe::check("the taught recipe", &kept.teaching.recipe_text)?;
    let is_other_region = taught_recipe.region() != recipe.region();
    // The drawing's pose at teaching is part of the taught panel; with another pose, the panel must be taught again.
    if is_other_region || taught_recipe.nominal() != recipe.nominal() {
        return Err(SetupFault::TaughtOtherwise {
            recipe: recipe_file.to_owned(),
            table: if is_other_region { "region" } else { "nominal" },
            panel: recipe.panel().to_owned(),
            version: kept.version,
        });
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

/// Reads the stored data of a teaching and derives the panel from its scan, without the corners. `now` is the present
/// calibration of the 3D camera.
///
/// # Errors
/// If the scan shows no panel under the region, or a stored calibration is invalid.
pub(super) fn derive_panel(
    teaching: &TeachingInputs,
    recipe: &Recipe,
    now: &Intrinsics,
) -> Result<TaughtPanel, SetupFault> {
    let lens = Intrinsics::check(TAUGHT_CALIBRATION, &teaching.scanner_calibration_text)?;
    let errors = teaching_scan_errors(&lens, now);
    let camera = lens.camera;
    let mount = MountedPose::<ScannerMount>::check(TAUGHT_CALIBRATION, &teaching.base_from_camera_text)?;
    let cloud = files::read_cloud(&teaching.scan, &camera).map_err(SetupFault::stage)?;
    // A drawing's rays have none of the camera's errors.
    let cloud = if recipe.nominal().is_some() { cloud } else { errors.correct_scan(cloud) };
    TaughtPanel::learn(&cloud, camera, mount.rigid(), recipe).map_err(SetupFault::stage)
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
) -> Result<LoadedPanel, SetupFault> {
    let panel = derive_panel(teaching, recipe, now)?;
    let mut corners = Vec::with_capacity(teaching.corners.len());
    let mut problems = Vec::new();
    for (index, shot) in teaching.corners.iter().enumerate() {
        let camera = Intrinsics::check(TAUGHT_CALIBRATION, &teaching.flange_camera_text)?.camera;
        let mount =
            MountedPose::<FlangeCameraMount>::check(TAUGHT_CALIBRATION, &teaching.flange_from_camera_text)?.rigid();
        let picture = files::read_measured(&shot.picture, &camera);
        let picture =
            picture.map_err(|error| SetupFault::TaughtCorner { number: index + 1, cause: error.to_string() })?;
        let view = (&picture, shot.base_from_flange.to_rigid());
        match learn::teach_corner(&panel, (recipe.corner(), index), view, (&camera, mount)) {
            Ok(corner) => corners.push(corner),
            Err(error) => problems.push(format!("{}: {error}", name(index))),
        }
    }
    if !problems.is_empty() {
        return Err(SetupFault::Corners(problems));
    }
    Ok(LoadedPanel { panel, corners, version })
}
