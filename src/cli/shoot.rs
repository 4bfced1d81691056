//! `panelprep shoot`: captures pictures, scans and films with the configured cameras, outside of a cycle and without a
//! calibration, and reports their quality.
//!
//! The pictures of a film are written while the next ones are captured, with a `clip.csv` that `inspect` and a recorded
//! camera read.

pub mod opening;

use self::opening::OpenedCamera;
use super::args::{Common, Shoot, Shot, Simulation};
use super::disk;
use super::fault::{ClipFault, DeviceFault, Fault};
use super::flange_pose::{FlangePoses, PoseKnowledge};
use super::output::Outcome;
use panelprep_base::geometry::ColorPicture;
use panelprep_base::phase::Phase;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::files::{self, Clip, ClipEntry};
use panelprep_devices::cameras::{CameraError, Conditions, Picture, PictureQuality, ScanQuality, Scanner};
use panelprep_service::setup::CellFiles;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

impl Shoot {
    fn requested_shot(&self) -> opening::RequestedShot {
        opening::RequestedShot { shot: self.what, simulation: self.simulation }
    }
}

/// Captures what was requested and writes it to new files; existing files are kept. If the service uses the cameras,
/// the service captures the pictures.
///
/// # Errors
/// If a cycle is in progress, a camera delivers no picture, or writing to the disk fails.
pub fn run(args: &Shoot, common: &Common, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let Simulation { tool_fault, line_parts, .. } = args.simulation;
    for (option, is_given) in [("--tool-fault", tool_fault.is_some()), ("--line-parts", line_parts > 0)] {
        if is_given {
            return Err(DeviceFault::CycleOnlyOption { option }.into());
        }
    }
    let files = CellFiles::read(&common.paths())?;
    if args.what == Shot::Scan {
        return take_scans(args, &files, progress);
    }
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    match args.what {
        Shot::Scan => {}
        Shot::Picture => pictures(args, &files, &mut outcome, progress)?,
        Shot::Film => capture_film(args, &files, &mut outcome, progress)?,
        Shot::Corner => corners(args, &files, &mut outcome, progress)?,
    }
    Ok(outcome)
}

/// Returns the file names of one capture, one for each file extension, with the first number that no file in the folder
/// has.
pub(super) fn find_free_names(folder: &Path, name: &str, extensions: &[&str]) -> Vec<PathBuf> {
    let of = |number: u32| {
        extensions.iter().map(move |extension| folder.join(format!("{name}_{number:04}.{extension}")))
    };
    let free = (1..=u32::MAX).find(|number| of(*number).all(|file| !file.exists()));
    of(free.unwrap_or(u32::MAX)).collect()
}

/// Captures scans. No calibration is needed; if the cell has the calibration of the camera, the scans are compared with
/// it.
fn take_scans(args: &Shoot, files: &CellFiles, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let mut opened = opening::scanner(files, &args.requested_shot(), progress)?;
    let lens = files.scanner().ok().map(|camera| camera.value);
    let (mut all, mut doubts) = (Vec::new(), Vec::new());
    let mut outcome_json = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    outcome_json.lines.clear();
    let outcome = &mut outcome_json;
    for _ in 0..args.count {
        let shot = opened.camera.capture_3d().map_err(Fault::stage)?;
        let names = find_free_names(&args.out, "scan", &["pcd", "ply", "png"]);
        let of_lens =
            lens.filter(|lens| (lens.width_px, lens.height_px) == (shot.cloud.width(), shot.cloud.height()));
        let checked = match &of_lens {
            Some(lens) => files::check_rays(&shot.cloud, lens),
            None => files::check_camera_frame(&shot.cloud),
        };
        if let Err(error) = checked {
            doubts.push(Reason::new("other_scan", format!("{}: {error}", names[0].display())));
        }
        let picture = shot.cloud.picture();
        let png = files::write_color_png(&picture).map_err(Fault::stage)?;
        let written = [files::write_pcd(&shot.cloud), files::write_ply(&shot.cloud), png];
        names.iter().zip(written).try_for_each(|(file, bytes)| disk::write(file, bytes))?;
        let (scan, of_picture) = (ScanQuality::compute(&shot.cloud), PictureQuality::compute(&picture));
        let size_px = [shot.cloud.width(), shot.cloud.height()];
        let depth = scan.depth_mm.map_or("no depth".to_owned(), |[near, middle, far]| {
            format!("90 % of the points are {near:.0} to {far:.0} mm from the camera along its axis, median {middle:.0} mm")
        });
        outcome.add_line(format!(
            "{}, .ply, .png: {}×{} px, {} points, {:.1} % of the pixels have no point; {depth}",
            names[0].display(),
            size_px[0],
            size_px[1],
            scan.points,
            100.0 * scan.missing_share
        ));
        outcome.add_line(format!("  {}", describe_quality(&of_picture)));
        let mut output = quality_json(&names, size_px, shot.time_s, &of_picture);
        conditions(outcome, &mut output, opened.camera.conditions());
        output["points"] = json!(scan.points);
        output["missing_share"] = json!(scan.missing_share);
        output["depth_mm"] = json!(scan.depth_mm);
        all.push(output);
    }
    list_files(outcome, all);
    let mut outcome = Outcome::from_judgement(&Judgement::new(doubts, vec![]));
    outcome.lines.append(&mut outcome_json.lines);
    outcome_json.json.retain(|key, _| key != "verdict" && key != "reasons");
    outcome.json.append(&mut outcome_json.json);
    Ok(outcome)
}

fn pictures(args: &Shoot, files: &CellFiles, outcome: &mut Outcome, progress: &dyn Fn(&str)) -> Result<(), Fault> {
    let mut opened = opening::scanner(files, &args.requested_shot(), progress)?;
    let mut all = Vec::new();
    for _ in 0..args.count {
        let shot = opened.camera.capture_2d().map_err(Fault::stage)?;
        let names = find_free_names(&args.out, "picture", &["png"]);
        let mut description = write_picture(outcome, &names, &shot.picture, shot.time_s)?;
        conditions(outcome, &mut description, opened.camera.conditions());
        all.push(description);
    }
    list_files(outcome, all);
    Ok(())
}

fn corners(args: &Shoot, files: &CellFiles, outcome: &mut Outcome, progress: &dyn Fn(&str)) -> Result<(), Fault> {
    let mut opened = opening::flange_camera(files, &args.requested_shot(), progress)?;
    let poses = FlangePoses::new(files);
    let mut all = Vec::new();
    for _ in 0..args.count {
        let before = poses.now();
        let shot = opened.camera.capture().map_err(Fault::stage)?;
        let names = find_free_names(&args.out, "corner", &["png", "json"]);
        let mut description = write_picture(outcome, &names[..1], &shot.picture, shot.time_s)?;
        conditions(outcome, &mut description, opened.camera.conditions());
        all.push(description);
        match poses.combine_reports(before, shot.base_from_flange) {
            PoseKnowledge::At(flange) => disk::write(&names[1], files::write_reported_flange(&flange))?,
            PoseKnowledge::Moved => {
                outcome.add_line("  the arm moved during the exposure: the flange's pose at this picture is not known; take the picture again")
            }
            PoseKnowledge::Nothing => outcome.add_line("  the flange's pose is not known: write down the pose that the pendant shows"),
        }
    }
    list_files(outcome, all);
    Ok(())
}

/// Lists all captures with their files; for scans also the largest fraction of missing points.
fn list_files(outcome: &mut Outcome, all: Vec<Value>) {
    let files: Vec<Value> = all.iter().filter_map(|shot| shot["files"].as_array()).flatten().cloned().collect();
    let missing = all.iter().filter_map(|shot| shot["missing_share"].as_f64()).reduce(f64::max);
    outcome.add_value("files", json!(files));
    if let Some(missing) = missing {
        outcome.add_value("missing_share", json!(missing));
    }
    outcome.add_value("shots", json!(all));
}

/// Writes a picture to a file, and reports its quality.
fn write_picture(
    outcome: &mut Outcome,
    names: &[PathBuf],
    picture: &ColorPicture,
    time_s: f64,
) -> Result<Value, Fault> {
    let quality = PictureQuality::compute(picture);
    disk::write(&names[0], files::write_color_png(picture).map_err(Fault::stage)?)?;
    outcome.add_line(format!("{}: {}×{} px", names[0].display(), picture.width, picture.height));
    outcome.add_line(format!("  {}", describe_quality(&quality)));
    Ok(quality_json(names, [picture.width, picture.height], time_s, &quality))
}

fn quality_json(names: &[PathBuf], size_px: [usize; 2], time_s: f64, quality: &PictureQuality) -> Value {
    json!({
        "files": names.iter().map(|name| name.display().to_string()).collect::<Vec<_>>(),
        "size_px": size_px,
        "time_s": time_s,
        "sharpness_gray_per_px": quality.sharpness_gray_per_px,
        "saturated_share": quality.saturated_share,
        "dark_share": quality.dark_share,
        "mean_gray": quality.mean_gray,
    })
}

/// Adds the conditions that the camera reports about a capture, as text and as JSON.
fn conditions(outcome: &mut Outcome, description: &mut Value, conditions: Conditions) {
    let Conditions { exposure_us, camera_c, throttled_ms } = conditions;
    (description["exposure_us"], description["camera_c"], description["throttled_ms"]) =
        (json!(exposure_us), json!(camera_c), json!(throttled_ms));
    let words = [
        exposure_us.map(|us| format!("exposed for {:.2} ms", us / 1_000.0)),
        camera_c.map(|celsius| format!("camera temperature {celsius:.1} °C")),
        throttled_ms.map(|ms| format!("the camera paused for {ms:.0} ms because it is hot")),
    ];
    let words: Vec<String> = words.into_iter().flatten().collect();
    if !words.is_empty() {
        outcome.add_line(format!("  {}", words.join(", ")));
    }
}

fn describe_quality(quality: &PictureQuality) -> String {
    format!(
        "sharpness {:.1} grey levels per pixel at the steepest edges, saturated {:.2} %, dark {:.1} %, mean grey level {:.0} of 255",
        quality.sharpness_gray_per_px,
        100.0 * quality.saturated_share,
        100.0 * quality.dark_share,
        quality.mean_gray
    )
}

/// Maximum number of pictures that wait to be written. If the disk is too slow for longer, the camera drops pictures,
/// which are counted.
const MAX_WAITING_PICTURES: usize = 64;
const WRITERS: usize = 2;
/// Step by which the time of a simulated cell advances while the program waits for the next picture, ms.
const STEP_MS: u64 = 12;

/// The captured film.
struct CapturedFilm {
    entries: Vec<ClipEntry>,
    quality: Option<PictureQuality>,
    dropped: u64,
}

/// Captures a film and writes it.
///
/// # Errors
/// If the folder already contains a clip, the camera delivers no picture, or writing to the disk fails.
fn capture_film(
    args: &Shoot,
    files: &CellFiles,
    outcome: &mut Outcome,
    progress: &dyn Fn(&str),
) -> Result<(), Fault> {
    let list = args.out.join("clip.csv");
    if list.exists() || args.out.join(file_name(1)).exists() {
        return Err(ClipFault::ClipExists { folder: args.out.clone() }.into());
    }
    check_phases(args.seconds, args.spray_from_s, args.wet_from_s)?;
    let mut opened = opening::scanner(files, &args.requested_shot(), progress)?;
    progress(&format!("taking pictures for {} s", args.seconds));
    let (pictures, to_write) = sync_channel::<(ClipEntry, Picture)>(MAX_WAITING_PICTURES);
    let to_write = Arc::new(Mutex::new(to_write));
    let taken = thread::scope(|scope| {
        let writer = |to_write: Arc<_>| scope.spawn(move || write(args, &to_write));
        let writers: Vec<_> = (0..WRITERS).map(|_| writer(to_write.clone())).collect();
        // Only the writers own the receiving end of the channel. If they end because writing fails, sending a picture
        // fails instead of waiting.
        drop(to_write);
        let taken = record(args, &mut opened, |entry, picture| pictures.send((entry, picture)).is_ok());
        drop(pictures);
        let written: Vec<Result<(), Fault>> = (writers.into_iter())
            .map(|writer| writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect();
        written.into_iter().collect::<Result<(), Fault>>().and(taken)
    })?;
    let clip = Clip::new(taken.entries.clone()).map_err(Fault::stage)?;
    disk::write(&list, clip.to_csv())?;
    report_result(args, &taken, outcome);
    let mut conditions_json = json!({});
    conditions(outcome, &mut conditions_json, opened.camera.conditions());
    conditions_json
        .as_object()
        .into_iter()
        .flatten()
        .for_each(|(key, value)| outcome.add_value(key, value.clone()));
    Ok(())
}

/// Checks the order of the phases of a film: dry, then sprayed, then wet. A film without spray may be wet from its
/// start.
fn check_phases(seconds: f64, spray_from_s: Option<f64>, wet_from_s: Option<f64>) -> Result<(), ClipFault> {
    let is_right = match (spray_from_s, wet_from_s) {
        (None, wet_from_s) => (0.0..=seconds).contains(&wet_from_s.unwrap_or(0.0)),
        (Some(spray_from_s), Some(wet_from_s)) => {
            0.0 <= spray_from_s && spray_from_s < wet_from_s && wet_from_s <= seconds
        }
        (Some(spray_from_s), None) => return Err(ClipFault::NoFirstWetPicture { spray_from_s }),
    };
    let wet_from_s = wet_from_s.unwrap_or(0.0);
    match (is_right, spray_from_s) {
        (true, _) => Ok(()),
        (false, None) => Err(ClipFault::NeverWet { wet_from_s, seconds }),
        (false, Some(spray_from_s)) => Err(ClipFault::SprayAfterWet { spray_from_s, wet_from_s, seconds }),
    }
}

/// Captures pictures until the time has passed; `keep` returns false if the writers have ended.
fn record(
    args: &Shoot,
    opened: &mut OpenedCamera<Box<dyn Scanner>>,
    mut keep: impl FnMut(ClipEntry, Picture) -> bool,
) -> Result<CapturedFilm, Fault> {
    let began_s = opened.camera.begin_clip(args.pictures_per_second).map_err(Fault::stage)?;
    let mut taken = CapturedFilm { entries: Vec::new(), quality: None, dropped: 0 };
    loop {
        let next = match opened.camera.next_clip_picture() {
            // All pictures of the recording were replayed.
            Err(CameraError::RecordingExhausted { .. }) if !taken.entries.is_empty() => break,
            next => next.map_err(Fault::stage)?,
        };
        match next {
            Some(picture) => {
                let time_s = picture.time_s - began_s;
                if time_s > args.seconds {
                    break;
                }
                if taken.quality.is_none() {
                    taken.quality = Some(PictureQuality::compute(&picture.picture));
                }
                let file = file_name(taken.entries.len() + 1);
                let entry = ClipEntry { file, time_s: time_s.max(0.0), phase: phase(args, time_s) };
                taken.entries.push(entry.clone());
                if !keep(entry, picture) {
                    break;
                }
            }
            // In a simulated cell, the time must be advanced by the program.
            None => match &opened.simulated {
                Some(simulated) => {
                    simulated.server.handle().with_controller(|controller| controller.advance_ms(STEP_MS))
                }
                None => thread::sleep(std::time::Duration::from_millis(1)),
            },
        }
    }
    taken.dropped = opened.camera.end_clip().map_err(Fault::stage)?;
    Ok(taken)
}

fn file_name(number: usize) -> String {
    format!("{number:05}.png")
}

fn phase(args: &Shoot, time_s: f64) -> Phase {
    match (time_s >= args.wet_from_s.unwrap_or(0.0), args.spray_from_s.is_some_and(|from_s| time_s >= from_s)) {
        (true, _) => Phase::Wet,
        (_, true) => Phase::Spray,
        _ => Phase::Dry,
    }
}

fn write(args: &Shoot, to_write: &Mutex<Receiver<(ClipEntry, Picture)>>) -> Result<(), Fault> {
    loop {
        let next = to_write.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok((entry, picture)) = next else { return Ok(()) };
        let png = files::write_color_png(&picture.picture).map_err(Fault::stage)?;
        disk::write(&args.out.join(&entry.file), png)?;
    }
}

fn report_result(args: &Shoot, taken: &CapturedFilm, outcome: &mut Outcome) {
    let times_s: Vec<f64> = taken.entries.iter().map(|entry| entry.time_s).collect();
    let span_s = times_s.last().zip(times_s.first()).map_or(0.0, |(last, first)| last - first);
    let sustained = if span_s > 0.0 { (times_s.len() - 1) as f64 / span_s } else { 0.0 };
    let longest_s = times_s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    outcome.add_line(format!(
        "{}: {} pictures, {sustained:.2} per second ({} requested), longest gap {longest_s:.2} s, {} dropped",
        args.out.join("clip.csv").display(),
        times_s.len(),
        args.pictures_per_second,
        taken.dropped
    ));
    if let Some(quality) = &taken.quality {
        outcome.add_line(format!("  the first picture: {}", describe_quality(quality)));
        outcome.add_value("sharpness_gray_per_px", json!(quality.sharpness_gray_per_px));
        outcome.add_value("saturated_share", json!(quality.saturated_share));
        outcome.add_value("dark_share", json!(quality.dark_share));
        outcome.add_value("mean_gray", json!(quality.mean_gray));
    }
    let names = taken.entries.iter().map(|entry| entry.file.as_str()).chain(["clip.csv"]);
    let files: Vec<String> = names.map(|name| args.out.join(name).display().to_string()).collect();
    outcome.add_value("files", json!(files));
    outcome.add_value("pictures", json!(times_s.len()));
    outcome.add_value("pictures_per_s", json!(sustained));
    outcome.add_value("longest_gap_s", json!(longest_s));
    outcome.add_value("dropped", json!(taken.dropped));
}
