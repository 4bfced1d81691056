//! `panelprep calibrate intrinsics`: the lens from a folder of pictures.

use super::super::disk;
use super::super::fault::Fault;
use super::super::outcome::Outcome;
use super::super::pictures;
use super::args::Intrinsics as Args;
use super::{date, keep, provenance};
use crate::calib::detect::{self, Detected};
use crate::calib::intrinsics::{Calibrated, MIN_VIEWS, View, calibrate};
use crate::calib::{CalibError, gate};
use crate::cell::Intrinsics;
use crate::files;
use crate::geometry::GrayPicture;
use crate::report;
use crate::verdict::Judgement;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Picture {
    name: String,
    hash: String,
    gray: GrayPicture,
}

/// Calibrates and writes the file.
///
/// # Errors
/// Where a picture cannot be read, sizes differ, or too few pictures show the board.
pub fn run(args: &Args, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let board = super::board(&args.board)?;
    let window = super::window(&args.board);
    let read = |file: &std::path::PathBuf| {
        let bytes = disk::read(file)?;
        let gray = files::read_gray(&bytes).map_err(|error| Fault::file(file, error))?;
        Ok(Picture { name: file.display().to_string(), hash: files::content_hash(&bytes), gray })
    };
    let all: Vec<Picture> = args.images.par_iter().map(read).collect::<Result<_, Fault>>()?;
    let size = one_size(&all)?;
    let done = AtomicUsize::new(0);
    let look = |picture: &Picture| {
        let found = detect::detect(&picture.name, &picture.gray, &board, window);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress(&format!("corners: {done} of {}", all.len()));
        found
    };
    let detected: Vec<Result<Detected, CalibError>> = all.par_iter().map(look).collect();
    let views = views(&all, &detected)?;
    progress("camera");
    let found = calibrate(size, &views, args.keep_all).map_err(Fault::stage)?;
    let judgement = gate::intrinsics(&found);
    let mut outcome = told(&judgement, &found, &all, &detected);
    if let Some(folder) = &args.pictures {
        let picture = report::residual_field(size, &found).map_err(Fault::stage)?;
        let file = pictures::save(folder, "residuals", &picture)?;
        outcome.say(format!("{}: residuals, drawn larger", file.display()));
    }
    let used = found.views.iter().filter(|view| view.set_aside.is_none());
    let hash = |name: &str| all.iter().find(|picture| picture.name == name).map(|picture| picture.hash.clone());
    let (hashes, residuals) = used.filter_map(|view| Some((hash(&view.name)?, view.rms_px))).unzip();
    let intrinsics = Intrinsics {
        camera: found.camera,
        covariance: Some(found.covariance),
        serial: args.serial.clone(),
        date: date::today(),
        rms_px: Some(found.rms_px),
        provenance: provenance(hashes, residuals),
    };
    let text = intrinsics.to_toml();
    // A lens that the file's own check refuses is never written.
    Intrinsics::check(&args.out.display().to_string(), &text)?;
    keep(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}

fn one_size(all: &[Picture]) -> Result<(usize, usize), Fault> {
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

fn views(all: &[Picture], detected: &[Result<Detected, CalibError>]) -> Result<Vec<View>, Fault> {
    let view = |(picture, found): (&Picture, &Result<Detected, CalibError>)| {
        let corners = found.as_ref().ok()?.corners.clone();
        Some(View { name: picture.name.clone(), corners })
    };
    let views: Vec<View> = all.iter().zip(detected).filter_map(view).collect();
    if views.len() < MIN_VIEWS {
        let first_reason = detected.iter().find_map(|found| found.as_ref().err()).map(ToString::to_string);
        let (found, given) = (views.len(), all.len());
        return Err(Fault::stage(CalibError::TooFewPictures { found, given, needed: MIN_VIEWS, first_reason }));
    }
    Ok(views)
}

fn told(
    judgement: &Judgement,
    found: &Calibrated,
    all: &[Picture],
    detected: &[Result<Detected, CalibError>],
) -> Outcome {
    let mut outcome = Outcome::of(judgement);
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
    outcome.put("rms_px", json!(found.rms_px));
    outcome.put("width_px", json!(c.width_px));
    outcome.put("height_px", json!(c.height_px));
    let mut deviations = serde_json::Map::new();
    for ((key, value), deviation) in numbers.iter().zip(found.deviations) {
        outcome.put(key, json!(value));
        outcome.say(format!("{key:6} {value:12.5} ± {deviation:.5}"));
        deviations.insert((*key).to_owned(), json!(deviation));
    }
    outcome.put("standard_deviations", Value::Object(deviations));
    let windows: Vec<usize> = detected.iter().flatten().map(|detected| detected.half_window_px).collect();
    let (least, most) = (windows.iter().min().copied(), windows.iter().max().copied());
    let (modelled, corners) = detected
        .iter()
        .flatten()
        .fold((0, 0), |(modelled, all), found| (modelled + found.modelled, all + found.corners.len()));
    let placed = match modelled {
        0 => "corners by cornerSubPix".to_owned(),
        modelled => format!("{modelled} of {corners} corners by a model of their grey levels"),
    };
    outcome.put("half_window_px", json!([least, most]));
    outcome.put("corners", json!({"found": corners, "modelled": modelled}));
    outcome.put("coverage", json!(found.coverage));
    outcome.put("tilt_deg", json!(found.tilt_deg));
    outcome.say(format!(
        "{:.3} px rms; windows of ±{} to ±{} px, {placed}; corners cover {:.0} % of the picture; tilts of {:.0}° to {:.0}°",
        found.rms_px,
        least.unwrap_or(0),
        most.unwrap_or(0),
        found.coverage * 100.0,
        found.tilt_deg[0],
        found.tilt_deg[1],
    ));
    let image = |(picture, detected): (&Picture, &Result<Detected, CalibError>)| {
        let view = found.views.iter().find(|view| view.name == picture.name);
        let reason = match (detected, view) {
            (Err(error), _) => Some(error.to_string()),
            (Ok(_), view) => view.and_then(|view| view.set_aside.clone()),
        };
        let rms_px = view.map(|view| view.rms_px);
        json!({"file": picture.name, "used": reason.is_none(), "rms_px": rms_px, "reason": reason})
    };
    let images: Vec<Value> = all.iter().zip(detected).map(image).collect();
    for image in &images {
        let text = |key: &str| image[key].as_str().unwrap_or("").to_owned();
        match image["rms_px"].as_f64().filter(|_| image["used"] == true) {
            Some(rms_px) => outcome.say(format!("  {}: {rms_px:.3} px", text("file"))),
            None => outcome.say(format!("set aside: {}: {}", text("file"), text("reason"))),
        }
    }
    outcome.put("images", Value::Array(images));
    outcome
}
