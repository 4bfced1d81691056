//! `panelprep refine`: checks the located pose against the corner pictures.

use super::args::{Common, Refine};
use super::fault::{Fault, TeachingFault};
use super::load::{self, CellFiles, CornerShot};
use super::outcome::Outcome;
use super::pictures;
use panelprep_base::geometry::{Base, Flange, FlangeCamera, KukaPose, Panel, Rigid};
use panelprep_cell::panel::TaughtSource;
use panelprep_service::stages::corners::{CornerReference, Correction, Sighting};
use panelprep_vision::calib::budget;
use serde_json::json;
use std::path::Path;

/// Corrects the located pose and reports the result.
///
/// # Errors
/// If a file is invalid, no corner was taught, or a picture shows none.
pub fn run(args: &Refine, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let recipe = load::recipe(&args.recipe)?;
    let located = load::located(Some(&args.located), &recipe)?;
    let lens = files.flange_camera()?;
    let (camera, extent) = (lens.value, lens.extent);
    let flange_from_camera = files.flange_from_camera()?.value;
    let shots = load::corner_shots(&files, &args.corner, &args.flange, &camera)?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let claims_mm = claims_mm(args, &files)?;
    let held =
        CornerReference { corners: &taught.corners, camera: &camera, lens: &extent, limits: recipe.corner() };
    let sightings = find_corners(&held, located, &shots, flange_from_camera)?;
    let correction = held.refine(located, &sightings, (claims_mm, None)).map_err(Fault::stage)?;
    if let Some(folder) = &args.pictures {
        let places =
            [(located, "before", "by 3D alone"), (correction.refined.base_from_panel, "after", "corrected")];
        for (index, seen) in sightings.iter().zip(&shots).enumerate() {
            draw(&held, (index, seen.0, seen.1), &places, folder)?;
        }
    }
    let outcome = outcome(&correction, claims_mm.is_some(), taught.panel.reference);
    outcome.write(args.out.as_deref())?;
    Ok(outcome)
}

/// The uncertainties stated by the localization and by both cameras' mounts, 95 %, mm; `None` if one of them states
/// nothing.
fn claims_mm(args: &Refine, files: &CellFiles) -> Result<Option<[f64; 2]>, Fault> {
    let scanner = files.cell.calibration().base_from_camera.is_some().then(|| files.base_from_camera());
    let scanner_mm = scanner.transpose()?.and_then(|mount| mount.uncertainty_mm);
    let mounts_mm = [scanner_mm, files.flange_from_camera()?.uncertainty_mm];
    let hand_eye_mm = budget::parts(mounts_mm, None, None).hand_eye_mm;
    Ok(load::located_mm(&args.located)?.zip(hand_eye_mm).map(<[f64; 2]>::from))
}

/// Finds the taught corners in the pictures, in order.
fn find_corners(
    held: &CornerReference<'_>,
    located: Rigid<Base, Panel>,
    shots: &[CornerShot],
    flange_from_camera: Rigid<Flange, FlangeCamera>,
) -> Result<Vec<Sighting>, Fault> {
    if shots.len() > held.corners.len() {
        return Err(TeachingFault::CornersNotTaught { found: shots.len(), taught: held.corners.len() }.into());
    }
    let find = |(corner, shot): ((usize, &_), &CornerShot)| {
        let base_from_flange: Rigid<Base, Flange> = shot.base_from_flange.to_rigid();
        let found = held.find(corner, &shot.picture, (located, base_from_flange * flange_from_camera));
        found.map_err(|error| Fault::file_fault(&shot.file, error))
    };
    held.corners.iter().enumerate().zip(shots).map(find).collect()
}

/// Writes a corner's picture with the corner drawn at each of these poses of the panel.
fn draw(
    held: &CornerReference<'_>,
    (index, sighting, shot): (usize, &Sighting, &CornerShot),
    places: &[(Rigid<Base, Panel>, &str, &str)],
    folder: &Path,
) -> Result<(), Fault> {
    let drawn = places.iter().filter_map(|(place, when, title)| {
        held.draw_corner((sighting, &shot.picture), *place, (&format!("corner{}_{when}", index + 1), title))
    });
    pictures::write_drawings(folder, drawn)
}

fn outcome(correction: &Correction, is_held_against_claims: bool, reference: TaughtSource) -> Outcome {
    let mut outcome = Outcome::from_judgement(&correction.judgement);
    outcome.add_checks(&correction.checks);
    let pose = KukaPose::from_rigid(&correction.refined.base_from_panel);
    let [x_mm, y_mm] = correction.refined.shift_mm;
    outcome.add_line(format!("base from panel: {pose}"));
    outcome.add_line(format!(
        "the corner was {:.2} px from its expected position; pose corrected by {x_mm:.3} mm in the camera's x, {y_mm:.3} mm in y",
        correction.refined.error_px
    ));
    if !is_held_against_claims {
        outcome.add_line(
            "correction not checked against the uncertainty of the 3D scan: the check needs the output of `locate --json`, and \
             uncertainty_mm of both cameras' mounts",
        );
    }
    if correction.refined.corners.len() > 1 {
        let left_mm = correction.refined.corners.iter().map(|corner| corner.remaining_shift_mm).fold(0.0, f64::max);
        outcome.add_line(format!(
            "rotation corrected by {:.3}°; remaining deviation of the corners: at most {left_mm:.3} mm",
            correction.refined.rotation.0
        ));
    }
    outcome.add_value("base_from_panel", json!(pose));
    if reference == TaughtSource::Drawing {
        // As `locate` states it: the frame of a panel that was taught from its drawing is the drawing's.
        outcome.add_value("base_from_drawing", json!(pose));
    }
    outcome.add_value("shift_mm", json!(correction.refined.shift_mm));
    outcome.add_value("error_px", json!(correction.refined.error_px));
    outcome
}
