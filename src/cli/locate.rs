//! The commands on a scan and on the corner pictures. `panelprep look` shows a scan as a picture with a pixel ruler, in
//! which a person reads the region for a recipe. `panelprep identify` compares a scan with all taught panels.
//! `panelprep locate` finds the present pose of the panel with the 3D
//! camera, and `panelprep refine` checks the located pose against the corner pictures.

use super::args::{Common, Identify, Locate, Look, Refine, Shot};
use super::disk;
use super::fault::{Fault, TeachingFault};
use super::identify;
use super::load::{self, CornerShot};
use super::output::{Outcome, write_progress};
use super::shoot::opening::{self, RequestedShot};
use panelprep_base::geometry::{Base, Flange, FlangeCamera, KukaPose, Panel, Rigid};
use panelprep_base::verdict::Judgement;
use panelprep_cell::files;
use panelprep_cell::panel::TaughtSource;
use panelprep_service::report::{missing_fraction, scan_picture};
use panelprep_service::setup::{self, CellFiles, ProposalLimits};
use panelprep_service::stages::corners::{CornerReference, Correction, Sighting};
use panelprep_service::stages::locate::{LocateOutcome, locate};
use panelprep_vision::calib::budget;
use panelprep_vision::locate::{Fit, ScanView, TaughtModel};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Locates the panel and reports the result.
///
/// # Errors
/// If a file is invalid, or the panel was not taught.
pub fn run(args: &Locate, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let recipe = load::read_recipe(&args.recipe)?;
    let scanner = files.scanner()?;
    let (camera, errors) = (scanner.value, scanner.scan_errors);
    let base_from_camera = files.base_from_camera()?.value;
    let scan = load::scan(&args.scan, &camera)?;
    let taught = setup::taught(&files, &args.recipe, &recipe)?;
    // Data that depends only on the taught panel is computed before the scan is taken; in a cycle it is computed during
    // the camera's exposure.
    let model = TaughtModel::from_panel(&taught.panel, errors.range);
    let begin = Instant::now();
    let scan = errors.correct_scan(scan);
    let view = ScanView { scan: &scan, camera: &camera, base_from_camera, range: errors.range };
    let located = locate((&taught.panel, &model), view, &recipe);
    let elapsed_ms = begin.elapsed().as_secs_f64() * 1e3;
    if let Some(folder) = &args.pictures {
        let picture = scan.picture();
        let drawings = located.draw_placement(&picture).into_iter().chain(located.draw_reasons(&picture));
        disk::write_drawings(folder, drawings)?;
    }
    let outcome = outcome(&located, elapsed_ms);
    outcome.write(args.out.as_deref())?;
    Ok(outcome)
}

/// Returns the outcome of a localization; `elapsed_ms` is the computing time after the scan was in memory.
fn outcome(located: &LocateOutcome<'_>, elapsed_ms: f64) -> Outcome {
    let mut outcome = Outcome::from_judgement(&located.judgement);
    outcome.add_checks(&located.checks);
    let fit = located.fit.as_ref();
    let pose = fit.map(|fit| KukaPose::from_rigid(&fit.base_from_panel));
    outcome.add_value("base_from_panel", json!(pose));
    let of_drawing = located.base_from_drawing();
    if let Some(pose) = &of_drawing {
        outcome.add_value("base_from_drawing", json!(pose));
    }
    outcome.add_value("rms_mm", json!(fit.map(|fit| fit.rms_mm)));
    outcome.add_value("deviation_mm", json!(fit.map(|fit| fit.deviation_mm)));
    outcome.add_value("overlap", json!(fit.map(Fit::overlap)));
    outcome.add_value("outline_rms_px", json!(fit.map(|fit| fit.outline_rms_px)));
    outcome.add_value("uncertainty_mm", json!(fit.map(|fit| fit.uncertainty_mm)));
    outcome.add_value("weakest_mm", json!(fit.map(|fit| fit.weakest_mm)));
    outcome.add_value("scanner_errors", json!(located.range().describe()));
    outcome.add_value("elapsed_ms", json!(elapsed_ms));
    if let (Some(fit), Some(pose)) = (fit, pose) {
        outcome.add_line(format!("base from panel: {pose}"));
        if let Some(pose) = of_drawing {
            outcome.add_line(format!("base from drawing: {pose}"));
        }
        outcome.add_line(format!(
            "residuals {:.3} mm rms after removal of a bend of {}; outline {:.2} px rms; overlap {:.3}; pose uncertainty {:.2} mm (95 %), largest {}, {:.2} mm",
            fit.rms_mm,
            fit.deviation_mm.map_or_else(|| "unknown size".to_owned(), |mm| format!("{mm:.2} mm at most")),
            fit.outline_rms_px,
            fit.overlap(),
            fit.uncertainty_mm,
            fit.weakest_direction.describe(),
            fit.weakest_mm
        ));
        outcome.add_line(format!(
            "fits from independent start poses differ by {:.3} mm; {}; {}",
            fit.agreement_mm,
            fit.rival.map_or_else(
                || "no competing pose explains the scan".to_owned(),
                |rival| format!(
                    "the best competing pose is rotated by {:.0}° and {:.0} times less likely",
                    rival.rotation.0,
                    rival.evidence_ratio()
                )
            ),
            fit.camera.map_or_else(
                || "the scan shows too little of the fixture to detect a motion of the camera".to_owned(),
                |camera| format!(
                    "motion of the camera, measured at the fixture: {:.2} ± {:.2} mm at the panel",
                    camera.moved_mm, camera.uncertainty_mm
                )
            )
        ));
        outcome.add_line(format!(
            "from the nominal pose: shift {:.1} mm, rotation {:.2}°, tilt {:.2}° at the panel's centre; computed in {:.0} ms",
            fit.shift_mm, fit.turn.0, fit.tilt.0, elapsed_ms
        ));
    }
    outcome
}

/// Compares a scan with the taught panels and reports the panel that it shows.
///
/// # Errors
/// If a file is invalid, no store exists, or the camera does not deliver.
pub fn run_identify(args: &Identify, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let scan = match &args.scan {
        Some(file) => load::scan(file, &files.scanner()?.value)?,
        None => {
            let wanted = RequestedShot { shot: Shot::Scan, simulation: args.simulation };
            let mut opened = opening::scanner(&files, &wanted, &write_progress)?;
            opened.camera.capture_3d().map_err(Fault::stage)?.cloud
        }
    };
    let limits = ProposalLimits {
        panels: args.panels.as_deref(),
        expected: args.expect.as_deref(),
        serial: args.part.as_deref(),
    };
    Ok(identify::report(&setup::propose(&files, scan, &limits)?))
}

/// Corrects the located pose and reports the result.
///
/// # Errors
/// If a file is invalid, no corner was taught, or a picture shows no corner.
pub fn run_refine(args: &Refine, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let recipe = load::read_recipe(&args.recipe)?;
    let located = load::located(Some(&args.located), &recipe)?;
    let lens = files.flange_camera()?;
    let (camera, extent) = (lens.value, lens.extent);
    let flange_from_camera = files.flange_from_camera()?.value;
    let shots = load::corner_shots(&files, &args.corner, &args.flange, &camera)?;
    let taught = setup::taught(&files, &args.recipe, &recipe)?;
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
    let outcome = refine_outcome(&correction, claims_mm.is_some(), taught.panel.reference);
    outcome.write(args.out.as_deref())?;
    Ok(outcome)
}

/// Returns the stated uncertainties (95 %) of the localization and of both camera mounts, mm; `None` if one of them
/// states none.
fn claims_mm(args: &Refine, files: &CellFiles) -> Result<Option<[f64; 2]>, Fault> {
    let scanner = files.cell.calibration().base_from_camera.is_some().then(|| files.base_from_camera());
    let scanner_mm = scanner.transpose()?.and_then(|mount| mount.uncertainty_mm);
    let mounts_mm = [scanner_mm, files.flange_from_camera()?.uncertainty_mm];
    let hand_eye_mm = budget::parts(mounts_mm, None, None).hand_eye_mm;
    Ok(load::located_mm(&args.located)?.zip(hand_eye_mm).map(<[f64; 2]>::from))
}

/// Finds the taught corners in the pictures, in the order of teaching.
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

/// Writes a corner picture, with the corner drawn for each of these poses of the panel.
fn draw(
    held: &CornerReference<'_>,
    (index, sighting, shot): (usize, &Sighting, &CornerShot),
    places: &[(Rigid<Base, Panel>, &str, &str)],
    folder: &Path,
) -> Result<(), Fault> {
    let drawn = places.iter().filter_map(|(place, when, title)| {
        held.draw_corner((sighting, &shot.picture), *place, (&format!("corner{}_{when}", index + 1), title))
    });
    disk::write_drawings(folder, drawn)
}

fn refine_outcome(correction: &Correction, is_held_against_claims: bool, reference: TaughtSource) -> Outcome {
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
        // As in `locate`, the frame of a panel that was taught from its drawing is that of the drawing.
        outcome.add_value("base_from_drawing", json!(pose));
    }
    outcome.add_value("shift_mm", json!(correction.refined.shift_mm));
    outcome.add_value("error_px", json!(correction.refined.error_px));
    outcome
}

/// Draws the scan and reports how many of its pixels have no point. Neither a cell nor a calibration is needed, except
/// for a PLY file that does not state its width. If the cell has the calibration of this camera, the scan is compared
/// with it.
///
/// # Errors
/// If the file is not an organised scan, is in another frame or unit, or is not from the calibrated camera, or writing
/// to the disk fails.
pub fn run_look(args: &Look, common: &Common) -> Result<Outcome, Fault> {
    let calibrated = CellFiles::read(&common.paths()).and_then(|files| files.scanner()).ok();
    let size_px = calibrated.as_ref().map(|camera| (camera.value.width_px, camera.value.height_px));
    let read = files::read_any_cloud(&disk::read(&args.scan)?, size_px);
    let scan = read.map_err(|error| Fault::file_fault(&args.scan, error))?;
    // A scan of another camera is accepted; it is recognised by its size.
    let lens = calibrated.as_ref().map(|camera| &camera.value);
    let own = lens.filter(|lens| (lens.width_px, lens.height_px) == (scan.width(), scan.height()));
    let checked = own.map_or_else(|| files::check_camera_frame(&scan), |lens| files::check_rays(&scan, lens));
    checked.map_err(|error| Fault::file_fault(&args.scan, error))?;
    let picture = scan_picture(&scan).map_err(Fault::stage)?;
    let file = disk::save_picture(&args.pictures, "scan", &picture)?;
    let share = missing_fraction(&scan);
    let depths_mm = scan.valid_points().map(|(_, point)| point.mm.z);
    let (near_mm, far_mm) =
        depths_mm.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    outcome.add_line(format!(
        "{}×{} px; {:.1} % of the pixels have no 3D point",
        scan.width(),
        scan.height(),
        100.0 * share
    ));
    if near_mm <= far_mm {
        outcome.add_line(format!("points {near_mm:.0} to {far_mm:.0} mm from the camera along its axis"));
    }
    outcome.add_line(format!("{}: read [region] corners_px from the pixel ruler in this picture", file.display()));
    outcome.add_value("missing_share", json!(share));
    outcome.add_value("width_px", json!(scan.width()));
    outcome.add_value("height_px", json!(scan.height()));
    outcome.add_value("picture", json!(file));
    Ok(outcome)
}
