//! `panelprep shoot`: takes pictures and scans with the configured cameras, outside of a cycle and without any
//! calibration.

mod film;
pub mod opening;
mod shot_report;

use super::args::{Common, Shoot, Shot, Simulation};
use super::disk;
use super::fault::{DeviceFault, Fault};
use super::flange_pose::{FlangePoses, PoseKnowledge};
use super::load::CellFiles;
use super::outcome::Outcome;
use panelprep_base::geometry::ColorPicture;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::files;
use panelprep_devices::cameras::{PictureQuality, ScanQuality};
use serde_json::{Value, json};
use shot_report::{conditions, describe_quality};
use std::path::{Path, PathBuf};

impl Shoot {
    fn requested_shot(&self) -> opening::RequestedShot {
        opening::RequestedShot { shot: self.what, simulation: self.simulation }
    }
}

/// Takes and writes what was requested; existing files stay. If the service uses the cameras, it takes the pictures.
///
/// # Errors
/// If a cycle is in progress, a camera does not deliver, or writing to the disk fails.
pub fn run(args: &Shoot, common: &Common, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let Simulation { tool_fault, line_parts, .. } = args.simulation;
    for (option, is_given) in [("--tool-fault", tool_fault.is_some()), ("--line-parts", line_parts > 0)] {
        if is_given {
            return Err(DeviceFault::CycleOnlyOption { option }.into());
        }
    }
    let files = CellFiles::read(common)?;
    if args.what == Shot::Scan {
        return take_scans(args, &files, progress);
    }
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    match args.what {
        Shot::Scan => {}
        Shot::Picture => pictures(args, &files, &mut outcome, progress)?,
        Shot::Film => film::capture(args, &files, &mut outcome, progress)?,
        Shot::Corner => corners(args, &files, &mut outcome, progress)?,
    }
    Ok(outcome)
}

/// Returns the file names of one shot, one for each ending, with the first number that no file of the folder has.
pub(super) fn free_names(folder: &Path, name: &str, endings: &[&str]) -> Vec<PathBuf> {
    let of = |number: u32| endings.iter().map(move |ending| folder.join(format!("{name}_{number:04}.{ending}")));
    let free = (1..=u32::MAX).find(|number| of(*number).all(|file| !file.exists()));
    of(free.unwrap_or(u32::MAX)).collect()
}

/// Scans need no calibration; if the cell has the camera's calibration, they are checked against it.
fn take_scans(args: &Shoot, files: &CellFiles, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let mut opened = opening::scanner(files, &args.requested_shot(), progress)?;
    let lens = files.scanner().ok().map(|camera| camera.value);
    let (mut all, mut doubts) = (Vec::new(), Vec::new());
    let mut outcome_json = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    outcome_json.lines.clear();
    let outcome = &mut outcome_json;
    for _ in 0..args.count {
        let shot = opened.camera.capture_3d().map_err(Fault::stage)?;
        let names = free_names(&args.out, "scan", &["pcd", "ply", "png"]);
        let of_lens =
            lens.filter(|lens| (lens.width_px, lens.height_px) == (shot.cloud.width(), shot.cloud.height()));
        let checked = match &of_lens {
            Some(lens) => files::check_rays(&shot.cloud, lens),
            None => files::check_frame(&shot.cloud),
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
        let names = free_names(&args.out, "picture", &["png"]);
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
        let names = free_names(&args.out, "corner", &["png", "json"]);
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

/// Lists every shot with all its files; for scans, also the largest share of missing points.
fn list_files(outcome: &mut Outcome, all: Vec<Value>) {
    let files: Vec<Value> = all.iter().filter_map(|shot| shot["files"].as_array()).flatten().cloned().collect();
    let missing = all.iter().filter_map(|shot| shot["missing_share"].as_f64()).reduce(f64::max);
    outcome.add_value("files", json!(files));
    if let Some(missing) = missing {
        outcome.add_value("missing_share", json!(missing));
    }
    outcome.add_value("shots", json!(all));
}

/// Writes a picture and reports it.
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
