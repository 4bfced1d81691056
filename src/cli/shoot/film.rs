//! Takes a film: pictures one after the other, written while the next ones arrive, with a `clip.csv` that `inspect`
//! and a recorded camera read.

use super::super::args::Shoot;
use super::super::disk;
use super::super::fault::{ClipFault, Fault};
use super::super::load::CellFiles;
use super::super::outcome::Outcome;
use super::opening::{self, OpenedCamera};
use panelprep_base::phase::Phase;
use panelprep_cell::files::{self, Clip, ClipEntry};
use panelprep_devices::cameras::{CameraError, Picture, PictureQuality, Scanner};
use serde_json::json;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

/// Maximum number of pictures that wait to be written. If the disk is too slow for a longer time, the camera drops
/// pictures, which are counted.
const WAITING: usize = 64;
const WRITERS: usize = 2;
/// Step by which a simulated cell's time advances while the next picture is awaited, ms.
const STEP_MS: u64 = 12;

/// The captured film.
struct CapturedFilm {
    entries: Vec<ClipEntry>,
    quality: Option<PictureQuality>,
    dropped: u64,
}

/// Takes a film and writes it.
///
/// # Errors
/// If the folder already holds a clip, the camera does not deliver, or writing to the disk fails.
pub fn capture(
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
    let (pictures, to_write) = sync_channel::<(ClipEntry, Picture)>(WAITING);
    let to_write = Arc::new(Mutex::new(to_write));
    let taken = thread::scope(|scope| {
        let writer = |to_write: Arc<_>| scope.spawn(move || write(args, &to_write));
        let writers: Vec<_> = (0..WRITERS).map(|_| writer(to_write.clone())).collect();
        // Only the writers own the receiving end of the channel: if they end because writing to the disk fails,
        // sending a picture fails and does not wait.
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
    super::conditions(outcome, &mut conditions_json, opened.camera.conditions());
    conditions_json
        .as_object()
        .into_iter()
        .flatten()
        .for_each(|(key, value)| outcome.add_value(key, value.clone()));
    Ok(())
}

/// Checks the phases of a film: dry, then sprayed, then wet. Without spray it may be wet from its beginning.
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

/// Takes pictures until the time is over; `keep` returns false if the writers have ended.
fn record(
    args: &Shoot,
    opened: &mut OpenedCamera<Box<dyn Scanner>>,
    mut keep: impl FnMut(ClipEntry, Picture) -> bool,
) -> Result<CapturedFilm, Fault> {
    let began_s = opened.camera.begin_clip(args.pictures_per_second).map_err(Fault::stage)?;
    let mut taken = CapturedFilm { entries: Vec::new(), quality: None, dropped: 0 };
    loop {
        let next = match opened.camera.next_clip_picture() {
            // The end of a recording is reached.
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
            // In a simulated cell, time passes only when the controller's time advances.
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
        outcome.add_line(format!("  the first picture: {}", super::describe_quality(quality)));
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
