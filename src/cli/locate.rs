//! `panelprep locate`: finds the present pose of the panel with the 3D camera.

use super::args::{Common, Locate};
use super::fault::Fault;
use super::load::{self, CellFiles};
use super::outcome::Outcome;
use super::pictures;
use panelprep_base::geometry::KukaPose;
use panelprep_service::stages::locate::{LocateOutcome, locate};
use panelprep_vision::locate::{Fit, ScanView, TaughtModel};
use serde_json::json;
use std::time::Instant;

/// Locates the panel and reports the result.
///
/// # Errors
/// If a file is invalid, or the panel was not taught.
pub fn run(args: &Locate, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let recipe = load::recipe(&args.recipe)?;
    let scanner = files.scanner()?;
    let (camera, errors) = (scanner.value, scanner.scan_errors);
    let base_from_camera = files.base_from_camera()?.value;
    let scan = load::scan(&args.scan, &camera)?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    // Data that depends on the taught panel alone is ready before a scan is taken; in a cycle it is made while the
    // camera exposes.
    let model = TaughtModel::from_panel(&taught.panel, errors.range);
    let begin = Instant::now();
    let scan = errors.correct_scan(scan);
    let view = ScanView { scan: &scan, camera: &camera, base_from_camera, range: errors.range };
    let located = locate((&taught.panel, &model), view, &recipe);
    let elapsed_ms = begin.elapsed().as_secs_f64() * 1e3;
    if let Some(folder) = &args.pictures {
        let picture = scan.picture();
        let drawings = located.draw_placement(&picture).into_iter().chain(located.draw_reasons(&picture));
        pictures::write_drawings(folder, drawings)?;
    }
    let outcome = outcome(&located, elapsed_ms);
    outcome.write(args.out.as_deref())?;
    Ok(outcome)
}

/// The outcome of a localization; its verdict came `elapsed_ms` after the scan was in memory.
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
            "residuals {:.3} mm rms beside a bend of {}; outline {:.2} px rms; overlap {:.3}; pose uncertainty {:.2} mm (95 %), largest {}, {:.2} mm",
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
