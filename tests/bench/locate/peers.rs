//! Locates the panel in the same scans with this program, the thesis's method and third-party libraries; creates a
//! table, and a plot of error against time.

use super::plot::{self, Run};
use super::{MAX_CORRECT_ERROR_MM, quantile, reduction, taught, tried};
use panelprep::geometry::{Base, Camera, OrganizedCloud, Panel, Point, Rigid};
use panelprep::locate::thesis_icp;
use panelprep::panel::TaughtPanel;
use panelprep::sim::{TRIAL_BOX_MM, TrialScene};
use std::ops::RangeInclusive;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// Locates the panel in the scans of these seeds with all methods, and writes the table and the plot.
pub fn compared(seeds: RangeInclusive<u64>) {
    let mut runs: Vec<Run> = Vec::new();
    let folder = std::env::temp_dir().join(format!("panelprep-locate-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for passing files");
    for seed in seeds.clone() {
        let trial = TrialScene::good_scene(seed, reduction());
        let tried = tried(&trial);
        if let Some(error) = tried.error {
            runs.push(Run { method: "panelprep".to_owned(), seed, ms: tried.elapsed_ms, error_mm: error.mean_mm });
        }
        let (panel, _) = taught(&trial);
        let (source, target) = clouds(&trial, &panel);
        let begun = Instant::now();
        let points = |points: &[[f64; 3]], every: usize| points.iter().step_by(every).copied().collect::<Vec<_>>();
        let on_panel = points(&source, 20).into_iter().map(|[x, y, z]| Point::<Panel>::at(x, y, z));
        let scanned = points(&target, 8).into_iter().map(|[x, y, z]| Point::<Base>::at(x, y, z));
        let start = near(&trial);
        let found = thesis_icp(&on_panel.collect::<Vec<_>>(), &scanned.collect::<Vec<_>>(), start);
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        let error_mm = trial.error_mm(&found).mean_mm;
        runs.push(Run { method: "thesis ICP, ours".to_owned(), seed, ms, error_mm });
        let text = serde_json::json!({"source": source, "target": target, "start": numbers(&start)});
        std::fs::write(folder.join(format!("{seed}.json")), text.to_string()).expect("written");
    }
    match std::env::var("PANELPREP_PEERS") {
        Ok(python) => runs.extend(of_peers(&python, &folder, seeds)),
        Err(_) => println!("peers: not run; `make bench-locate` sets them up"),
    }
    // The result is ignored: a leftover folder is inside of the system's folder for temporary files.
    let _ = std::fs::remove_dir_all(&folder);
    println!("method                          scans  error mm: median  largest   right  ms: median");
    for method in plot::methods(&runs) {
        let of: Vec<&Run> = runs.iter().filter(|run| run.method == method).collect();
        let mut errors: Vec<f64> = of.iter().map(|run| run.error_mm).collect();
        let mut ms: Vec<f64> = of.iter().map(|run| run.ms).collect();
        let right = errors.iter().filter(|&&mm| mm <= MAX_CORRECT_ERROR_MM).count();
        println!(
            "{method:30}  {:5}  {:16.3}  {:7.2}  {right:6}  {:10.0}",
            of.len(),
            quantile(&mut errors, 0.5),
            quantile(&mut errors, 1.0),
            quantile(&mut ms, 0.5)
        );
    }
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/target/bench-locate.svg");
    std::fs::write(file, plot::svg(&runs)).expect("written");
    println!("error against time: target/bench-locate.svg");
}

/// Returns the taught panel's points in the panel's frame and the scan's points in the search box in the base
/// frame, mm.
fn clouds(trial: &TrialScene, panel: &TaughtPanel) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let source = panel.points().map(|(_, point)| point.mm.coords.into()).collect();
    let scan: OrganizedCloud<Camera> = trial.scan();
    let base_from_camera = trial.base_from_camera();
    let [low, high] = TRIAL_BOX_MM;
    let in_box = |p: &[f64; 3]| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&p[axis]));
    let target = scan
        .valid_points()
        .map(|(_, point)| <[f64; 3]>::from((base_from_camera * point).mm.coords))
        .filter(in_box)
        .collect();
    (source, target)
}

/// Returns a start pose for methods that need one: 10 mm and 3° from the true pose.
fn near(trial: &TrialScene) -> Rigid<Base, Panel> {
    let turn = nalgebra::Vector3::new(0.04, 0.025, -0.02);
    let centre = trial.base_from_panel().isometry() * nalgebra::Point3::new(560.0, 0.0, 360.0);
    let rotation = nalgebra::UnitQuaternion::from_scaled_axis(turn);
    let shift = centre.coords + nalgebra::Vector3::new(2.0, 8.0, -5.0) - rotation * centre.coords;
    let off: Rigid<Base, Base> =
        Rigid::from_isometry_unchecked(nalgebra::Isometry3::from_parts(shift.into(), rotation));
    off * trial.base_from_panel()
}

fn numbers(rigid: &Rigid<Base, Panel>) -> Vec<f64> {
    rigid.isometry().to_homogeneous().transpose().as_slice().to_vec()
}

fn of_peers(python: &str, folder: &Path, seeds: RangeInclusive<u64>) -> Vec<Run> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bench/locate/peers.py");
    let mut runs = Vec::new();
    for seed in seeds {
        let trial = TrialScene::good_scene(seed, reduction());
        let output = Command::new(python).arg(script).arg(folder.join(format!("{seed}.json"))).output();
        let Ok(output) = output else {
            println!("peers did not start");
            return runs;
        };
        let text = String::from_utf8_lossy(&output.stdout);
        let Some(found) = text.lines().last().and_then(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        else {
            println!("peers failed on seed {seed}: {}", String::from_utf8_lossy(&output.stderr));
            continue;
        };
        for (method, result) in found.as_object().into_iter().flatten() {
            let row: Vec<f64> = serde_json::from_value(result["pose"].clone()).unwrap_or_default();
            if row.len() != 16 {
                println!("{method} failed on seed {seed}: {}", result["error"]);
                continue;
            }
            let matrix = nalgebra::Matrix4::from_row_slice(&row);
            let rotation = nalgebra::Rotation3::from_matrix(&matrix.fixed_view::<3, 3>(0, 0).into_owned());
            let shift = nalgebra::Translation3::from(matrix.fixed_view::<3, 1>(0, 3).into_owned());
            let pose = Rigid::from_isometry_unchecked(nalgebra::Isometry3::from_parts(shift, rotation.into()));
            let error_mm = trial.error_mm(&pose).mean_mm;
            runs.push(Run {
                method: method.clone(),
                seed,
                ms: result["ms"].as_f64().unwrap_or(f64::NAN),
                error_mm,
            });
        }
    }
    runs
}
