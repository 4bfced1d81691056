//! Reads the inputs of the commands: recipes, shots and poses. Each file that a command is given is compared with the
//! calibration to which it belongs.

use super::disk;
use super::fault::{Fault, TeachingFault};
use panelprep_base::geometry::{Base, Camera, ColorPicture, KukaPose, OrganizedCloud, Panel, PinholeCamera, Rigid};
use panelprep_cell::files;
use panelprep_cell::panel::{TaughtSource, nominal_pose};
use panelprep_cell::recipe::Recipe;
use panelprep_service::setup::CellFiles;
pub use panelprep_service::setup::read_recipe;
use std::path::{Path, PathBuf};

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
    Ok(cell_files.true_flange(file, &reported)?)
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
