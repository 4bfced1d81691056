//! Runs public pictures of real boards and robots through the program's own commands: `make bench-real`. No pictures
//! are stored in this repository. A missing set is reported as "not run", and then the bench does not pass.
//!
//! - `target/opencv-doc`: pictures `left*.jpg` and `right*.jpg` of Debian's opencv-doc
//! - `REAL=FOLDER`: a copy of ros-industrial/industrial_calibration (Apache-2.0), of which `examples/data` is read

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use panelprep::geometry::{Base, Flange, KukaPose, Rigid};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

/// Time limit for a set, s.
const MAX_SET_S: f64 = 60.0;

fn main() -> ExitCode {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let opencv = here.join("target/opencv-doc/usr/share/doc/opencv-doc/examples/data");
    let robots = std::env::var_os("REAL").map(PathBuf::from).map(|folder| folder.join("examples/data"));
    let Ok(out) = tempfile::tempdir() else { return ExitCode::FAILURE };
    let mut bad = 0;
    for side in ["left", "right"] {
        bad += lens(side, &pictures(&opencv, side, "jpg"), "--board 9x6 --square-mm 25", out.path());
    }
    for (set, board, mount) in [
        ("test_set_charuco", "--board charuco:5x7:18.256:6X6_250:legacy --square-mm 36.195", "eye-to-hand"),
        ("test_set_10x10", "--board circles:10x10:20", "eye-in-hand"),
    ] {
        let folder = robots.as_ref().map(|folder| folder.join(set)).unwrap_or_default();
        bad += lens(set, &pictures(&folder.join("images"), "", "png"), board, out.path());
        bad += mounted(set, &folder, board, mount, out.path());
    }
    println!("{bad} sets missed their target or were not run");
    if bad == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Returns the pictures of a folder whose names have this prefix and suffix.
fn pictures(folder: &Path, begin: &str, end: &str) -> Vec<PathBuf> {
    let is_one = |file: &PathBuf| {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let number = name.trim_start_matches(begin).trim_end_matches(end).trim_end_matches('.');
        name.starts_with(begin) && name.ends_with(end) && number.parse::<u32>().is_ok()
    };
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut all: Vec<PathBuf> = files.filter(is_one).collect();
    all.sort();
    all
}

/// Runs a command; returns its JSON object, or its error message.
fn run(arguments: &str, files: &[PathBuf]) -> Result<(Value, f64), String> {
    let started = Instant::now();
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(arguments.split_whitespace())
        .arg("--json")
        .args(files)
        .output()
        .map_err(|error| error.to_string())?;
    let object: Value = serde_json::from_slice(&output.stdout).map_err(|error| error.to_string())?;
    match object["verdict"].is_string() {
        true => Ok((object, started.elapsed().as_secs_f64())),
        false => Err(object["reasons"].to_string()),
    }
}

fn codes(object: &Value) -> String {
    let reasons = object["reasons"].as_array().map(Vec::as_slice).unwrap_or_default();
    reasons.iter().filter_map(|reason| reason["code"].as_str()).collect::<Vec<_>>().join(", ")
}

fn lens(set: &str, files: &[PathBuf], board: &str, out: &Path) -> usize {
    if files.is_empty() {
        println!("not run {set}: its pictures are missing");
        return 1;
    }
    let file = out.join(format!("{set}.toml"));
    let found = run(&format!("calibrate intrinsics {board} --out {}", file.display()), files);
    let Ok((found, seconds)) = found.inspect_err(|error| println!("MISSED  {set}: no verdict: {error}")) else {
        return 1;
    };
    let images = found["images"].as_array().map(Vec::as_slice).unwrap_or_default();
    let used = images.iter().filter(|image| image["used"] == true).count();
    let good = seconds <= MAX_SET_S;
    println!(
        "{:7} {set}, lens: {} ({}) in {seconds:.1} s (60); {used} of {} pictures; {}, {} px rms, left out {} px; known in {} of the \
         picture; next: {}",
        if good { "ok" } else { "MISSED" },
        found["verdict"],
        codes(&found),
        files.len(),
        found["model"],
        found["rms_px"],
        found["left_out_pictures"]["rms_px"],
        found["support"]["share"],
        found["next_picture"],
    );
    usize::from(!good)
}

/// Calibrates the camera's mount, and the arm as far as the poses determine it.
fn mounted(set: &str, folder: &Path, board: &str, mount: &str, out: &Path) -> usize {
    let lens = out.join(format!("{set}.toml"));
    let Some(poses) = poses(folder).filter(|_| lens.is_file()) else {
        println!("not run {set}, mount: its poses or its lens are missing");
        return 1;
    };
    let (file, images, lens) = (out.join(format!("{set}_poses.toml")), folder.join("images"), lens.display());
    if std::fs::write(&file, poses).is_err() {
        return 1;
    }
    let arguments = format!(
        "calibrate hand-eye --mount {mount} {board} --intrinsics {lens} --images {} --poses {} --out {}",
        images.display(),
        file.display(),
        out.join("mount.toml").display(),
    );
    match run(&arguments, &[]) {
        Ok((found, seconds)) => {
            println!(
                "ok      {set}, mount: {} ({}) in {seconds:.1} s; {} mm rms, ± {} mm",
                found["verdict"],
                codes(&found),
                found["rms_mm"],
                found["uncertainty_mm"]
            );
            0
        }
        Err(error) => {
            println!("MISSED  {set}, mount: no verdict: {error}");
            1
        }
    }
}

/// Returns the set's poses as a poses file; the set has each pose in metres and as a quaternion.
fn poses(folder: &Path) -> Option<String> {
    let count = pictures(&folder.join("images"), "", "png").len();
    let mut text = String::new();
    for index in 0..count {
        let pose = std::fs::read_to_string(folder.join(format!("poses/{index}.yaml"))).ok()?;
        let number = |key: &str| {
            let line = pose.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))?;
            line.trim().parse::<f64>().ok()
        };
        let quaternion = Quaternion::new(number("qw")?, number("qx")?, number("qy")?, number("qz")?);
        let place = Translation3::new(number("x")?, number("y")?, number("z")?).vector * 1e3;
        let pose: Rigid<Base, Flange> = Rigid::from_isometry_unchecked(Isometry3::from_parts(
            place.into(),
            UnitQuaternion::from_quaternion(quaternion),
        ));
        let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&pose);
        text += &format!(
            "[[poses]]\nimage = \"{index}.png\"\nbase_from_flange = {{ x_mm = {x_mm}, y_mm = {y_mm}, z_mm = {z_mm}, a_deg = {a_deg}, \
             b_deg = {b_deg}, c_deg = {c_deg} }}\n"
        );
    }
    (count > 0).then_some(text)
}
