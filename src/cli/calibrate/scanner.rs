//! `panelprep calibrate scanner`: determines the errors of the 3D camera from scans of a flat board at many positions.

use super::super::disk;
use super::super::fault::Fault;
use super::super::output::Outcome;
use super::args::Scanner as Args;
use super::boards::{self, BoardImage};
use super::output::{self, provenance, write_calibration};
use panelprep_base::geometry::PinholeCamera;
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::{Intrinsics, MeasuredScanner};
use panelprep_service::report;
use panelprep_vision::calib::scanner_errors::{
    BoardScan, PlaneView, ScannerErrors, checks, direction_rectangle, measure,
};
use panelprep_vision::calib::{Board, CalibError};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The evaluation of a scan: its file name, its hash, and its blocks of points or the reason why there are none.
type ScanRead = (String, String, Result<PlaneView, CalibError>);

/// Measures the errors of the 3D camera, and writes the lens file with these errors.
///
/// # Errors
/// If a file is invalid, or writing to the disk fails.
pub fn run(args: &Args, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let board = boards::parse_board(&args.board)?;
    let lens = Intrinsics::check(&args.intrinsics.display().to_string(), &disk::read_text(&args.intrinsics)?)?;
    let done = AtomicUsize::new(0);
    let read = |file: &std::path::PathBuf| {
        let one = read(file, (&board, boards::window(&args.board)), &lens.camera);
        progress(&format!("scans: {} of {}", done.fetch_add(1, Ordering::Relaxed) + 1, args.scans.len()));
        one
    };
    let all: Vec<ScanRead> = args.scans.par_iter().map(read).collect::<Result<_, Fault>>()?;
    let views: Vec<PlaneView> = all.iter().filter_map(|(_, _, view)| view.as_ref().ok().cloned()).collect();
    progress("errors");
    let over = direction_rectangle(&lens.camera).ok_or_else(|| {
        Fault::stage(CalibError::Points("the lens model has no ray for a corner of the picture".to_owned()))
    })?;
    let found = match measure(&views, over) {
        Ok(found) => found,
        Err(error) => return Ok(refused(error.to_string(), &all, args)),
    };
    let checks = checks(&found);
    let judgement = Judgement::from_checks(&checks);
    let mut outcome = Outcome::from_judgement(&judgement);
    outcome.add_checks(&checks);
    report_result(&mut outcome, &found, &all);
    let used = all.iter().filter(|(_, _, view)| view.is_ok());
    let made = provenance(used.map(|(_, hash, _)| hash.clone()).collect(), found.residuals_mm.clone());
    let measured = MeasuredScanner {
        white_mm: found.white_mm,
        smooth_mm: found.smooth_mm,
        correlation_mm: found.correlation_mm,
        scale_percent: found.scale_percent,
        scale_deviation_percent: found.scale_deviation_percent,
        board_positions: views.len(),
        field: found.field,
        date: output::today_utc(),
        provenance: made,
    };
    let text = Intrinsics { errors: Some(measured), ..lens }.to_toml();
    Intrinsics::check(&args.out.display().to_string(), &text)?;
    if let Some(folder) = &args.pictures {
        let picture = report::depth_error_map(&lens.camera, &found).map_err(Fault::stage)?;
        let file = disk::save_picture(folder, "scanner_errors", &picture)?;
        outcome.add_line(format!("{}: map of the errors over the camera's picture", file.display()));
    }
    write_calibration(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}

fn read(file: &Path, (board, window): (&Board, Option<usize>), camera: &PinholeCamera) -> Result<ScanRead, Fault> {
    let board_image = BoardImage::read(file, camera)?;
    let Some(cloud) = board_image.cloud() else {
        let message = format!("{}: is a picture, which has no depth; name a scan, .pcd or .ply", file.display());
        return Err(Fault::stage(CalibError::Points(message)));
    };
    let view = board_image.detect(board, window).and_then(|detected| {
        let scan = BoardScan { cloud, camera, board, corners: &detected.corners };
        PlaneView::from_scan(&scan)
    });
    Ok((board_image.name.clone(), board_image.hash.clone(), view))
}

/// Returns the outcome for scans that do not determine the errors.
fn refused(message: String, all: &[ScanRead], args: &Args) -> Outcome {
    let judgement = Judgement::new(vec![Reason::new("scanner_places", message)], vec![]);
    let mut outcome = Outcome::from_judgement(&judgement);
    outcome.add_value("smooth_mm", Value::Null);
    report_excluded(&mut outcome, all);
    outcome.add_line(format!("{}: not written", args.out.display()));
    outcome
}

fn report_excluded(outcome: &mut Outcome, all: &[ScanRead]) {
    for (name, _, view) in all {
        if let Err(error) = view {
            let why = error.to_string();
            let named = if why.starts_with(name.as_str()) { why } else { format!("{name}: {why}") };
            outcome.add_line(format!("excluded: {named}"));
        }
    }
}

fn report_result(outcome: &mut Outcome, found: &ScannerErrors, all: &[ScanRead]) {
    let [low_mm, high_mm] = found.correlation_interval_mm.map(|mm| fixed_decimals(mm, 0));
    outcome.add_line(format!("white noise of a pixel {} mm at 700 mm", fixed_decimals(found.white_mm, 3)));
    outcome.add_line(format!(
        "smooth error of a scan {} mm, correlation length {} mm (95 %: {low_mm} to {high_mm} mm)",
        fixed_decimals(found.smooth_mm, 3),
        fixed_decimals(found.correlation_mm, 0)
    ));
    let plain = fixed_decimals(found.left_out_uncorrected_mm, 3);
    outcome.add_line(match found.left_out_corrected_mm {
        Some(corrected_mm) => format!(
            "systematic error of all scans: up to {} mm at 700 mm, which is subtracted from new scans; held-out scans \
             deviate from a plane by {plain} mm rms without this correction, by {} mm rms with this correction",
            fixed_decimals(found.max_field_mm, 2),
            fixed_decimals(corrected_mm, 3)
        ),
        None => format!(
            "no systematic error: the scans deviate from a plane by {plain} mm rms, and a correction would not \
             reduce this deviation"
        ),
    });
    outcome.add_line(format!(
        "distances are {} % too long, scatter from scan to scan {} %; bow of the board {} mm",
        fixed_decimals(found.scale_percent, 3),
        fixed_decimals(found.scale_deviation_percent, 3),
        fixed_decimals(found.bow_mm, 2)
    ));
    outcome.add_value("white_mm", json!(found.white_mm));
    outcome.add_value("smooth_mm", json!(found.smooth_mm));
    outcome.add_value("correlation_mm", json!(found.correlation_mm));
    outcome.add_value("correlation_between_mm", json!(found.correlation_interval_mm));
    let left_out = json!({"plain_mm": found.left_out_uncorrected_mm, "corrected_mm": found.left_out_corrected_mm});
    outcome.add_value("left_out", left_out);
    outcome.add_value("field_most_mm", json!(found.field.map(|_| found.max_field_mm)));
    outcome.add_value("scale_percent", json!(found.scale_percent));
    outcome.add_value("scale_deviation_percent", json!(found.scale_deviation_percent));
    outcome.add_value("board_bow_mm", json!(found.bow_mm));
    outcome.add_value("places", json!(found.residuals_mm.len()));
    outcome.add_line("scan                  rms from its plane, mm".to_owned());
    let used = all.iter().filter(|(_, _, view)| view.is_ok());
    for ((name, _, _), rms_mm) in used.zip(&found.residuals_mm) {
        outcome.add_line(format!("{name:20}  {}", fixed_decimals(*rms_mm, 3)));
    }
    report_excluded(outcome, all);
}
