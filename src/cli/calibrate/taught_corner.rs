//! `panelprep calibrate verify --recipe`: a taught corner at its nominal position as the target of the flange camera.
//!
//! Compares the corner in the picture with its expected position, in mm perpendicular to the viewing direction. This
//! tests mount, lens and arm together, but no error along the viewing direction.

use super::super::fault::Fault;
use super::super::load::{self, CellFiles};
use super::super::outcome::Outcome;
use super::args::{CameraName, Verify};
use super::verification;
use panelprep_base::geometry::{Base, Flange, Rigid};
use panelprep_base::verdict::Judgement;
use panelprep_vision::calib::{CalibError, health};
use panelprep_vision::locate::corner::find_taught;
use serde_json::json;
use std::path::Path;

/// Measures the first taught corner in the picture and compares it with its expected position.
///
/// # Errors
/// If a file is invalid, no corner was taught, the picture shows none, or the store cannot be written.
pub fn run(args: &Verify, files: &CellFiles, recipe_file: &Path) -> Result<Outcome, Fault> {
    let wrong = |message: &str| Fault::stage(CalibError::Points(message.to_owned()));
    if args.camera != CameraName::FlangeCamera {
        return Err(wrong(
            "--recipe verifies the flange camera by a taught corner; verify the scanner with a board",
        ));
    }
    let Some(flange) = &args.flange else {
        return Err(wrong("--flange is missing: give the flange's pose at the picture"));
    };
    let recipe = load::recipe(recipe_file)?;
    let taught = load::taught(files, recipe_file, &recipe)?;
    let (camera, mount) = (files.flange_camera()?, files.flange_from_camera()?);
    let Some(image) = &args.image else { return Err(wrong("--image is missing: give the picture of the corner")) };
    let (image, flange) = (std::slice::from_ref(image), std::slice::from_ref(flange));
    let shots = load::corner_shots(files, image, flange, &camera.value)?;
    let (Some(shot), Some(corner)) = (shots.first(), taught.corners.first()) else {
        return Err(wrong("no corner of this panel was taught; teach a corner with --corner and --flange"));
    };
    let base_from_flange: Rigid<Base, Flange> = shot.base_from_flange.to_rigid();
    let panel_from_camera = taught.panel.nominal_pose.inverse() * base_from_flange * mount.value;
    let in_camera = panel_from_camera.inverse() * corner.point;
    let Some(expected) = camera.value.project(in_camera) else {
        return Err(wrong("the taught corner lies behind the camera; is this the flange's pose at the picture?"));
    };
    let found = find_taught(&shot.picture.to_gray(), (recipe.corner(), 0), &camera.value, in_camera);
    let found = found.map_err(Fault::stage)?.corner_px;
    if let Some(reason) = health::lens_extent_refusal(&camera.extent, [found]) {
        return Ok(Outcome::from_judgement(&Judgement::new(vec![reason], vec![])));
    }
    let (px_per_mm, _) = camera.value.px_per_mm_at(in_camera.mm.z);
    let error_px = found.distance_px(expected);
    let hash = files.hash_with_arm(&[&camera.text, &mount.text]);
    let verification = verification::verification(files, "flange_camera", error_px / px_per_mm, hash);
    let mut outcome = verification::store_and_judge(files, &verification, args.pictures.as_deref())?;
    outcome.add_value("error_px", json!(error_px));
    Ok(outcome)
}
