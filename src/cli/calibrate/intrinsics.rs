//! `panelprep calibrate intrinsics`: determines the lens from a folder of pictures. With `--from-scan` it determines
//! the lens of a 3D camera from one of its scans, because each point of a scan is on the ray of its pixel.

use super::super::disk;
use super::super::fault::Fault;
use super::super::output::Outcome;
use super::args::{Intrinsics as Args, ModelName};
use super::boards;
use super::output::{self, provenance, write_calibration};
use panelprep_base::geometry::statistics::{QuantileRank, quantile};
use panelprep_base::geometry::{GrayPicture, fit_lens, sample_points};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::Intrinsics;
use panelprep_cell::files;
use panelprep_service::report;
use panelprep_vision::calib::detect::{self, DetectedCorners};
use panelprep_vision::calib::intrinsics::{Calibrated, LensModel, MIN_VIEWS, Options, View, ViewResult, calibrate};
use panelprep_vision::calib::{Board, CalibError, gate};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

struct Picture {
    name: String,
    hash: String,
    gray: GrayPicture,
}

/// Calibrates a lens and writes the file. If the pictures do not determine the lens, this is a verdict and not an
/// error.
///
/// # Errors
/// If a picture cannot be read, or the pictures have different sizes.
pub fn run(args: &Args, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let named = boards::board_from_option(&args.board)?;
    let (board, window) = (boards::parse_board(&named)?, boards::window(&named));
    let read = |file: &std::path::PathBuf| {
        let bytes = disk::read(file)?;
        let gray = files::read_gray(&bytes).map_err(|error| Fault::file_fault(file, error))?;
        Ok(Picture { name: file.display().to_string(), hash: files::content_hash(&bytes), gray })
    };
    let all: Vec<Picture> = args.images.par_iter().map(read).collect::<Result<_, Fault>>()?;
    let size = require_equal_sizes(&all)?;
    let done = AtomicUsize::new(0);
    let look = |picture: &Picture| {
        let found = detect::detect(&picture.name, &picture.gray, &board, window);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress(&format!("corners: {done} of {}", all.len()));
        found
    };
    let detected: Vec<Result<DetectedCorners, CalibError>> = all.par_iter().map(look).collect();
    progress("camera");
    let options = Options { keep_all_pictures: args.keep_all, model: model(args) };
    let found = match views(&all, &detected).and_then(|views| calibrate(size, &views, options)) {
        Ok(found) => found,
        Err(error) => return Ok(undetermined_lens_outcome(&error, &all, &detected, args)),
    };
    let used = found.views.iter().filter(|view| view.exclusion_reason.is_none());
    let hash = |name: &str| all.iter().find(|picture| picture.name == name).map(|picture| picture.hash.clone());
    let (hashes, residuals) = used.filter_map(|view| Some((hash(&view.name)?, view.rms_px))).unzip();
    let intrinsics = Intrinsics {
        camera: found.camera,
        covariance: Some(found.covariance),
        serial: args.serial.clone(),
        date: output::today_utc(),
        rms_px: Some(found.rms_px),
        extent: found.lens_extent(),
        provenance: provenance(hashes, residuals),
        errors: None,
    };
    let text = intrinsics.to_toml();
    let mut judgement = gate::intrinsics(&found);
    // A lens that does not pass the check of the file format is not written.
    if let Err(problems) = Intrinsics::check(&args.out.display().to_string(), &text) {
        let mut reasons = vec![Reason::new(
            "not_a_lens",
            format!("these values are not a valid lens calibration: {problems}; calibrate the lens again"),
        )];
        reasons.append(&mut judgement.reasons);
        judgement = Judgement::new(reasons, vec![]);
    }
    let mut outcome = build_outcome(&judgement, &found, &all, &detected);
    report_model(&mut outcome, &found, &board);
    if let Some(folder) = &args.pictures {
        let picture = report::residual_field(size, &found).map_err(Fault::stage)?;
        let file = disk::save_picture(folder, "residuals", &picture)?;
        outcome.add_line(format!("{}: residuals, drawn larger", file.display()));
    }
    write_calibration(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}

fn model(args: &Args) -> Option<LensModel> {
    let like_opencv = args.keep_all && args.board.subpix.is_some();
    let default = if like_opencv { ModelName::K1k2p1p2k3 } else { ModelName::Auto };
    match args.model.unwrap_or(default) {
        ModelName::Auto => None,
        ModelName::Pinhole => Some(LensModel::Pinhole),
        ModelName::K1 => Some(LensModel::Radial1),
        ModelName::K1k2 => Some(LensModel::Radial2),
        ModelName::K1k2p1p2 => Some(LensModel::Tangential),
        ModelName::K1k2p1p2k3 => Some(LensModel::Full),
    }
}

fn report_model(outcome: &mut Outcome, found: &Calibrated, board: &Board) {
    outcome.add_value("model", json!(found.model.name()));
    let trials = found
        .trials
        .iter()
        .map(|trial| json!({"model": trial.model.name(), "left_out_rms_px": trial.left_out_rms_px}));
    outcome.add_value("trials", trials.collect());
    let left_out = found.exclusion_reasons();
    outcome.add_value("left_out", json!(left_out));
    outcome.add_value(
        "left_out_pictures",
        json!({"rms_px": found.left_out_rms_px, "within_95_px": found.left_out_95_px}),
    );
    let support = &found.support;
    let outline = support.outline_px.as_ref().map(|all| all.iter().map(|p| [p.u, p.v]).collect::<Vec<_>>());
    outcome
        .add_value("support", json!({"share": support.share, "error_px": support.error_px, "outline_px": outline}));
    outcome.add_line(format!(
        "model {}; error of corners in held-out pictures {:.3} px rms, 95 % within {:.3} px",
        found.model.name(),
        found.left_out_rms_px,
        found.left_out_95_px
    ));
    left_out.iter().for_each(|reason| outcome.add_line(format!("excluded from the lens model: {reason}")));
    outcome.add_line(format!(
        "the lens is determined to {:.2} px in {:.0} % of the picture",
        support.error_px,
        support.share * 100.0
    ));
    let next = found.next_picture(board);
    outcome.add_value("next_picture", json!(next.as_ref().map(|next| &next.description)));
    match next {
        Some(next) => outcome.add_line(format!(
            "most useful next picture: {}; with it, the error of the lens falls to {:.0} % of its present value",
            next.description,
            next.error_share * 100.0
        )),
        None => outcome
            .add_line("no further picture would reduce the lens's error by 2 % or more: the pictures are enough"),
    }
}

/// Returns the outcome for pictures that do not determine a lens, with what to do.
fn undetermined_lens_outcome(
    error: &CalibError,
    all: &[Picture],
    detected: &[Result<DetectedCorners, CalibError>],
    args: &Args,
) -> Outcome {
    let code = if matches!(error, CalibError::TooFewPictures { .. }) { "too_few_pictures" } else { "no_lens" };
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![Reason::new(code, error.to_string())], vec![]));
    let keys = ["rms_px", "fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3", "model"];
    keys.iter().for_each(|key| outcome.add_value(key, Value::Null));
    if let Some(first) = all.first() {
        outcome.add_value("width_px", json!(first.gray.width));
        outcome.add_value("height_px", json!(first.gray.height));
    }
    report_images(&mut outcome, all, detected, &[]);
    let next = "the board sharp and whole, over most of the picture, facing the camera; then four more, each tilted by \
                30° to another side";
    outcome.add_value("next_picture", json!(next));
    outcome.add_line(format!("next: {next}"));
    outcome.add_line(format!("{}: not written", args.out.display()));
    outcome
}

fn require_equal_sizes(all: &[Picture]) -> Result<(usize, usize), Fault> {
    let Some(first) = all.first() else {
        let error = CalibError::TooFewPictures { found: 0, given: 0, needed: MIN_VIEWS, first_reason: None };
        return Err(Fault::stage(error));
    };
    let size = |picture: &Picture| (picture.gray.width, picture.gray.height);
    let text = |picture: &Picture| format!("{} × {}", picture.gray.width, picture.gray.height);
    match all.iter().find(|picture| size(picture) != size(first)) {
        None => Ok(size(first)),
        Some(other) => Err(Fault::stage(CalibError::MixedSizes {
            picture: other.name.clone(),
            found: text(other),
            first: first.name.clone(),
            expected: text(first),
        })),
    }
}

fn views(all: &[Picture], detected: &[Result<DetectedCorners, CalibError>]) -> Result<Vec<View>, CalibError> {
    let view = |(picture, found): (&Picture, &Result<DetectedCorners, CalibError>)| {
        let corners = found.as_ref().ok()?.corners.clone();
        Some(View { name: picture.name.clone(), corners })
    };
    let views: Vec<View> = all.iter().zip(detected).filter_map(view).collect();
    if views.len() < MIN_VIEWS {
        let first_reason = detected.iter().find_map(|found| found.as_ref().err()).map(ToString::to_string);
        let (found, given) = (views.len(), all.len());
        return Err(CalibError::TooFewPictures { found, given, needed: MIN_VIEWS, first_reason });
    }
    Ok(views)
}

fn build_outcome(
    judgement: &Judgement,
    found: &Calibrated,
    all: &[Picture],
    detected: &[Result<DetectedCorners, CalibError>],
) -> Outcome {
    let mut outcome = Outcome::from_judgement(judgement);
    let c = &found.camera;
    let numbers = [
        ("fx_px", c.fx_px),
        ("fy_px", c.fy_px),
        ("cx_px", c.cx_px),
        ("cy_px", c.cy_px),
        ("k1", c.k1),
        ("k2", c.k2),
        ("p1", c.p1),
        ("p2", c.p2),
        ("k3", c.k3),
    ];
    outcome.add_value("rms_px", json!(found.rms_px));
    outcome.add_value("width_px", json!(c.width_px));
    outcome.add_value("height_px", json!(c.height_px));
    let mut deviations = serde_json::Map::new();
    for ((key, value), deviation) in numbers.iter().zip(found.deviations) {
        outcome.add_value(key, json!(value));
        outcome.add_line(format!("{key:6} {value:12.5} ± {deviation:.5}"));
        deviations.insert((*key).to_owned(), json!(deviation));
    }
    outcome.add_value("standard_deviations", Value::Object(deviations));
    let windows: Vec<usize> = detected.iter().flatten().map(|detected| detected.half_window_px).collect();
    let (smallest, largest) = (windows.iter().min().copied(), windows.iter().max().copied());
    let (modelled, corners) = detected
        .iter()
        .flatten()
        .fold((0, 0), |(modelled, all), found| (modelled + found.modelled_count, all + found.corners.len()));
    let placed = match modelled {
        0 => "corners located by OpenCV's cornerSubPix".to_owned(),
        modelled => format!("{modelled} of {corners} corners located by a model of their grey levels"),
    };
    outcome.add_value("half_window_px", json!([smallest, largest]));
    outcome.add_value("corners", json!({"found": corners, "modelled": modelled}));
    outcome.add_value("coverage", json!(found.coverage));
    outcome.add_value("tilt_deg", json!(found.tilt_deg));
    outcome.add_line(format!(
        "residuals {:.3} px rms; windows of ±{} to ±{} px, {placed}; corners cover {:.0} % of the picture; tilts of the board {:.0}° to {:.0}°",
        found.rms_px,
        smallest.unwrap_or(0),
        largest.unwrap_or(0),
        found.coverage * 100.0,
        found.tilt_deg[0],
        found.tilt_deg[1],
    ));
    report_images(&mut outcome, all, detected, &found.views);
    outcome
}

/// Adds a line for each picture: whether it was used, and if not, why.
fn report_images(
    outcome: &mut Outcome,
    all: &[Picture],
    detected: &[Result<DetectedCorners, CalibError>],
    views: &[ViewResult],
) {
    let image = |(picture, detected): (&Picture, &Result<DetectedCorners, CalibError>)| {
        let view = views.iter().find(|view| view.name == picture.name);
        let reason = match (detected, view) {
            (Err(error), _) => Some(error.to_string()),
            (Ok(_), None) => Some("no lens was determined, so this picture was not checked".to_owned()),
            (Ok(_), Some(view)) => view.exclusion_reason.clone(),
        };
        let rms_px = view.map(|view| view.rms_px);
        json!({"file": picture.name, "used": reason.is_none(), "rms_px": rms_px, "reason": reason})
    };
    let images: Vec<Value> = all.iter().zip(detected).map(image).collect();
    for image in &images {
        let text = |key: &str| image[key].as_str().unwrap_or("").to_owned();
        match image["rms_px"].as_f64().filter(|_| image["used"] == true) {
            Some(rms_px) => outcome.add_line(format!("  {}: {rms_px:.3} px", text("file"))),
            None => outcome.add_line(format!("excluded: {}: {}", text("file"), text("reason"))),
        }
    }
    outcome.add_value("images", Value::Array(images));
}

/// Limits of the median distance between the points and the rays of the computed lens, px. Above the first limit the
/// result is for review; above the second one the cloud is not from a camera.
const MEDIAN_LIMITS_PX: (f64, f64) = (0.1, 1.0);

/// Minimum range of the depths as a fraction of the distance: the points of a flat scan fit the rays of some lens even
/// if they are in a wrong frame.
const MIN_RELATIVE_DEPTH_RANGE: f64 = 0.05;

/// Computes the lens from a scan and writes the file.
///
/// # Errors
/// If the file is not an organised cloud in a camera's frame.
pub fn run_from_scan(args: &Args, scan: &Path) -> Result<Outcome, Fault> {
    let bytes = disk::read(scan)?;
    let cloud = files::read_any_cloud(&bytes, None).map_err(|error| Fault::file_fault(scan, error))?;
    files::check_camera_frame(&cloud).map_err(|error| Fault::file_fault(scan, error))?;
    let found = fit_lens(&sample_points(&cloud), (cloud.width(), cloud.height()));
    let Some(found) = found else {
        let message = format!(
            "{} has too few points, or points on one line, to determine a lens; scan the whole cell",
            scan.display()
        );
        return Ok(Outcome::from_judgement(&Judgement::new(vec![Reason::new("not_a_lens", message)], vec![])));
    };
    let (mut reject, mut review) = (Vec::new(), Vec::new());
    let beyond = |limit_px: f64| found.median_px.is_nan() || found.median_px > limit_px;
    if beyond(MEDIAN_LIMITS_PX.0) {
        let beyond = beyond(MEDIAN_LIMITS_PX.1);
        let [off, allowed] =
            distinguishable_texts(found.median_px, if beyond { MEDIAN_LIMITS_PX.1 } else { MEDIAN_LIMITS_PX.0 }, 3);
        let message = format!(
            "half of the points are {off} px or more from the rays of the best-fitting lens (limit {allowed} px): \
             name a scan that was neither smoothed nor moved after it was taken"
        );
        let reason = Reason::new("off_rays", message);
        if beyond { reject.push(reason) } else { review.push(reason) }
    }
    let mut depths_mm: Vec<f64> = sample_points(&cloud).iter().map(|(_, point)| point.mm.z).collect();
    let mut depth = |share: f64| quantile(&mut depths_mm, share, QuantileRank::Lower).unwrap_or(f64::NAN);
    let relief = (depth(0.95) - depth(0.05)) / depth(0.5);
    if relief.is_nan() || relief < MIN_RELATIVE_DEPTH_RANGE {
        let [found, wanted] = distinguishable_texts(100.0 * relief, 100.0 * MIN_RELATIVE_DEPTH_RANGE, 1);
        review.push(Reason::new(
            "flat",
            format!(
                "the depths of the scan differ by {found} % of the distance, at least {wanted} % are needed: a flat \
                 scan in another frame would give a wrong lens; scan a cell with objects at several distances"
            ),
        ));
    }
    let intrinsics = Intrinsics {
        serial: args.serial.clone(),
        date: output::today_utc(),
        // The result is a median and ignores half of the points, so it must not be stored as a root mean square.
        rms_px: None,
        provenance: provenance(vec![files::content_hash(&bytes)], vec![]),
        ..Intrinsics::from_camera(found.camera)
    };
    let text = intrinsics.to_toml();
    if let Err(problems) = Intrinsics::check(&args.out.display().to_string(), &text) {
        reject.push(Reason::new(
            "not_a_lens",
            format!("these values are not a valid lens calibration: {problems}; calibrate the lens again"),
        ));
    }
    let judgement = Judgement::new(reject, review);
    let mut outcome = Outcome::from_judgement(&judgement);
    let lens = &found.camera;
    let numbers = [
        ("fx_px", lens.fx_px),
        ("fy_px", lens.fy_px),
        ("cx_px", lens.cx_px),
        ("cy_px", lens.cy_px),
        ("k1", lens.k1),
        ("k2", lens.k2),
        ("p1", lens.p1),
        ("p2", lens.p2),
        ("k3", lens.k3),
        ("median_px", found.median_px),
    ];
    for (key, number) in numbers {
        outcome.add_value(key, json!(number));
    }
    outcome.add_value("width_px", json!(lens.width_px));
    outcome.add_value("height_px", json!(lens.height_px));
    outcome.add_line(format!(
        "fx {:.2}, fy {:.2}, cx {:.2}, cy {:.2} px: half of the points are within {:.4} px of the rays of this lens",
        lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, found.median_px
    ));
    write_calibration(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}
