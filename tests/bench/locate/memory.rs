//! Measures the memory of a localization at full size in a separate process that does nothing else.

use panelprep::geometry::{Camera, OrganizedCloud, PinholeCamera};
use panelprep::locate::{self, ScanView};
use panelprep::panel::TaughtPanel;
use panelprep::sim::TrialScene;
use std::path::Path;
use std::process::Command;

/// The argument with which this program runs as the separate process.
pub const SEPARATE_PROCESS_ARGUMENT: &str = "memory-alone";
const SEED: u64 = 1;
const ALLOWED_MB: f64 = 600.0;

/// Starts the process on a rendered scan and prints the result.
pub fn measure_memory() -> usize {
    let trial = TrialScene::good_scene(SEED, super::reduction());
    let folder = std::env::temp_dir().join(format!("panelprep-memory-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for passing files");
    for (name, scan) in [("taught", trial.taught_scan()), ("scan", trial.scan())] {
        std::fs::write(folder.join(name), bytes(&scan)).expect("written");
    }
    let program = std::env::current_exe().expect("this program");
    let output = Command::new(program).arg(SEPARATE_PROCESS_ARGUMENT).arg(&folder).output().expect("started");
    // The result is ignored: a leftover folder is inside of the system's folder for temporary files.
    let _ = std::fs::remove_dir_all(&folder);
    let most_mb = String::from_utf8_lossy(&output.stdout).trim().parse().unwrap_or(f64::NAN);
    super::row(most_mb < ALLOWED_MB, &format!("teaching and localization take {most_mb:.0} MB at most"))
}

/// The separate process: teaches, locates, and prints its peak resident memory, MB.
pub fn run_separate_process(folder: &Path) {
    let trial = TrialScene::good_scene(SEED, super::reduction());
    let read = |name: &str| cloud(&std::fs::read(folder.join(name)).expect("a scan"), trial.camera());
    let recipe = super::recipe(&trial, "");
    let (camera, base_from_camera) = (trial.camera(), trial.base_from_camera());
    let panel = TaughtPanel::learn(&read("taught"), *camera, base_from_camera, &recipe).expect("a panel");
    let scan = read("scan");
    locate::locate(
        &panel,
        &ScanView { scan: &scan, camera, base_from_camera, range: locate::RangeErrors::default() },
        recipe.locate(),
    )
    .expect("located");
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux tells");
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("the most resident");
    let kb: f64 = line.trim().trim_end_matches("kB").trim().parse().expect("a number");
    println!("{}", kb / 1_000.0);
}

fn bytes(scan: &OrganizedCloud<Camera>) -> Vec<u8> {
    let points = scan.raw_points_mm().iter().flatten().flat_map(|mm| mm.to_le_bytes());
    let colors = (0..scan.width() * scan.height()).flat_map(|index| scan.color_at(index));
    points.chain(colors).collect()
}

fn cloud(bytes: &[u8], camera: &PinholeCamera) -> OrganizedCloud<Camera> {
    let (width, height) = (camera.width_px, camera.height_px);
    let (points, colors) = bytes.split_at(width * height * 12);
    let mm = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let point = |bytes: &[u8]| [mm(&bytes[..4]), mm(&bytes[4..8]), mm(&bytes[8..])];
    let points = points.chunks_exact(12).map(point).collect();
    let colors = colors.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    OrganizedCloud::new(width, height, points, colors).expect("one point and one colour a pixel")
}
