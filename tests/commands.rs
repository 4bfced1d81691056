//! Tests the commands as a user runs them: the program itself, on files, with exit codes and JSON.
//!
//! `plans`, `clips`, `cycles` and `identify` test in more detail what these commands do. `refused` tests what they do
//! not accept. `taught` contains the command lines after which a rendered cell may run.

mod clips;
mod cycles;
mod identify;
mod plans;
mod refused;
pub mod taught;

pub use taught::{TEACH, VERIFY};

use panelprep::geometry::{Base, Flange, FlangeCamera, KukaPose, Panel, Point, Rigid};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// Runs the program in a folder.
pub fn panelprep(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the program starts")
}

/// Starts the program with `--json` in a folder; the test controls its standard input, output and error.
pub fn start_program(folder: &Path, command: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(command.split_whitespace())
        .arg("--json")
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts")
}

/// Runs a command with `--json`; returns its exit code and its JSON object.
pub fn json(folder: &Path, arguments: &str) -> (i32, Value) {
    let output = panelprep(folder, &format!("{arguments} --json"));
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let object = serde_json::from_str(&text)
        .unwrap_or_else(|error| panic!("{arguments}: {error}: {text}{}", String::from_utf8_lossy(&output.stderr)));
    (output.status.code().expect("an exit code"), object)
}

/// Renders a cell with pictures of a quarter of the size, in a separate folder.
pub fn rendered(scene: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let (exit, files) = json(folder.path(), &format!("render --seed 3 --scene {scene} --reduction 4 --out cell"));
    assert_eq!(exit, 0, "{files}");
    folder
}

const LOCATE: &str = "locate --cell cell/cell.toml --recipe cell/recipe.toml --scan cell/scan.pcd";

const REFINE: &str = "refine --cell cell/cell.toml --recipe cell/recipe.toml --located located.json \
                      --corner cell/corner.png --flange cell/flange.json";

const INSPECT: &str = "inspect --cell cell/cell.toml --recipe cell/recipe.toml --clip cell/clip --located refined.json \
                       --truth cell/truth --pictures pictures";

const PLAN: &str = "plan --cell cell/cell.toml --recipe cell/recipe.toml --located refined.json --out plan.json \
                    --krl sand.src --pictures pictures";

/// Teaches the panel and verifies both cameras.
pub fn taught_and_verified(folder: &Path) {
    for arguments in [TEACH, VERIFY[0], VERIFY[1]] {
        let (exit, told) = json(folder, arguments);
        assert_eq!(exit, 0, "{arguments}: {told}");
    }
}

fn keep(folder: &Path, name: &str, object: &Value) {
    std::fs::write(folder.join(name), object.to_string()).expect("written");
}

fn pose(object: &Value) -> Rigid<Base, Panel> {
    let pose: KukaPose = serde_json::from_value(object["base_from_panel"].clone()).expect("a pose");
    pose.to_rigid()
}

#[test]
fn from_files_to_waypoints_command_by_command() {
    let folder = rendered("good");
    let folder = folder.path();
    let (exit, taught) = json(folder, TEACH);
    assert_eq!((exit, taught["verdict"].as_str()), (0, Some("accept")), "{taught}");
    assert_eq!(taught["grids"].as_array().map(Vec::len), Some(24));

    let (exit, located) = json(folder, LOCATE);
    assert_eq!((exit, located["verdict"].as_str()), (0, Some("accept")), "{located}");
    assert!(located["overlap"].as_f64().is_some_and(|share| (0.9..=1.0).contains(&share)), "{located}");
    keep(folder, "located.json", &located);

    let (exit, refined) = json(folder, REFINE);
    assert_eq!((exit, refined["verdict"].as_str()), (0, Some("accept")), "{refined}");
    keep(folder, "refined.json", &refined);
    let truth: Value =
        serde_json::from_slice(&std::fs::read(folder.join("cell/truth/truth.json")).expect("truth")).expect("JSON");
    let corner_mm: [f64; 3] = serde_json::from_value(truth["corners"][0]["corner_mm"].clone()).expect("a corner");
    let corner = Point::<Panel>::at(corner_mm[0], corner_mm[1], corner_mm[2]);
    let off = (pose(&refined) * corner - pose(&truth) * corner).mm;
    let pose_of = |object: &Value| serde_json::from_value::<KukaPose>(object.clone()).expect("a pose");
    let flange = std::fs::read(folder.join("cell/flange.json")).expect("the flange's pose");
    let base_from_flange: Rigid<Base, Flange> = pose_of(&serde_json::from_slice(&flange).expect("JSON")).to_rigid();
    let flange_from_camera: Rigid<Flange, FlangeCamera> = pose_of(&truth["flange_from_camera"]).to_rigid();
    let in_camera = (base_from_flange * flange_from_camera).rotation().inverse() * off;
    let off_mm = in_camera.x.hypot(in_camera.y);
    assert!(off_mm < 0.5, "the corner is {off_mm:.3} mm off in the camera's plane");

    let (exit, inspected) = json(folder, INSPECT);
    assert_eq!((exit, inspected["verdict"].as_str()), (1, Some("fail")), "{inspected}");
    assert_eq!(inspected["frames"], 301, "60 s at 5 pictures a second, both ends");
    assert_eq!(inspected["score"]["grids"]["false_pass"], 0, "{inspected}");
    assert_eq!(inspected["score"]["grids"]["false_fail"], 0, "{inspected}");
    let failed: Vec<String> = inspected["grids"]
        .as_array()
        .expect("grids")
        .iter()
        .filter(|grid| grid["failed"] == true)
        .map(|grid| grid["id"].as_str().expect("an id").to_owned())
        .collect();
    assert!(!failed.is_empty() && folder.join("pictures/mask.png").exists());
    let page = std::fs::read_to_string(folder.join("pictures/inspection.html")).expect("the page to sign");
    assert!(page.contains("<td>signature</td>") && page.contains("failed; ") && page.matches("<img").count() == 4);

    let (exit, plan) = json(folder, &format!("{PLAN} --grids {}", failed.join(",")));
    assert_eq!((exit, plan["verdict"].as_str()), (0, Some("accept")), "{plan}");
    assert!(plan["coverage"].as_f64().is_some_and(|share| share >= 0.95), "{plan}");
    // Adjacent grids form one path, and every grid is in a path.
    let paths = plan["paths"].as_array().expect("paths").iter();
    let mut planned: Vec<&str> =
        paths.flat_map(|path| path["grids"].as_array().expect("grids")).filter_map(Value::as_str).collect();
    planned.sort_unstable();
    assert_eq!(planned, failed);
    let kept: Value =
        serde_json::from_slice(&std::fs::read(folder.join("plan.json")).expect("the plan")).expect("JSON");
    assert_eq!(kept, plan);
    let krl = std::fs::read_to_string(folder.join("sand.src")).expect("the program");
    assert!(krl.contains("DEF sand()") && krl.matches("LIN {").count() > 10, "{krl}");
    assert_eq!(plan["krl"], "sand.src");
    // Tool and base are set, and the first motion is to axis angles.
    let code: Vec<&str> = krl.lines().filter(|line| !line.starts_with([';', '&'])).collect();
    let place = |start: &str| code.iter().position(|line| line.starts_with(start)).expect(start);
    let (tool, base) = (place("$TOOL = {X 0.000, Y 0.000, Z 120.000,"), place("$BASE = {X "));
    assert!(tool < place("PTP {A1 ") && base < place("PTP {A1 ") && place("PTP {A1 ") < place("LIN {"), "{krl}");
    let ratio = plan["dwell_ratio"].as_f64().expect("a ratio");
    assert!(ratio > 1.0 && ratio <= 2.0 && plan["max_dwell_ratio"] == 2.0, "{ratio}");
    let dwell = plan["dwell"].as_array().expect("one for each grid");
    assert!(dwell.iter().all(|grid| grid["p5_s"].as_f64() < grid["p95_s"].as_f64()), "{dwell:?}");
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/pcl").join(name)
}

/// Scans that PCL's tools wrote, with a calibration and a recipe as a user would write them. The ground truth is in
/// `fixtures/README.md`: moved by (5, −3, 6) mm and rotated by 3° about the camera's x and z axes at (0, 0, 400).
#[test]
fn scans_written_by_pcl_are_taught_located_and_planned() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write(
        "cell.toml",
        "store = \"store\"\n[scanner]\nkind = \"simulated\"\n[flange_camera]\nkind = \"simulated\"\n[robot]\nkind = \"mock\"\n\
        [calibration]\nscanner = \"scanner.toml\"\nbase_from_camera = \"mount.toml\"\n",
    );
    write(
        "scanner.toml",
        "[camera]\nwidth_px = 320\nheight_px = 240\nfx_px = 294.68334\nfy_px = 304.63776\ncx_px = 160.0\n\
        cy_px = 119.0\nk1 = 0.0\nk2 = 0.0\np1 = 0.0\np2 = 0.0\nk3 = 0.0\n",
    );
    write(
        "mount.toml",
        "[base_from_camera]\nx_mm = 0.0\ny_mm = 0.0\nz_mm = 0.0\na_deg = 0.0\nb_deg = 0.0\nc_deg = 0.0\n",
    );
    write(
        "recipe.toml",
        "panel = \"small\"\n[locate]\nbox_min_mm = [-120, -100, 300]\nbox_max_mm = [120, 100, 500]\n\
        [region]\ncorners_px = [[128, 95], [192, 94], [196, 146], [130, 142]]\nrows = 2\ncolumns = 2\n\
        [inspect]\nmin_break_mm2 = 30\n[path]\ndisc_diameter_mm = 16\nstep_over_mm = 8\nedge_overhang_mm = 4\n",
    );
    let run = |arguments: &str| json(folder.path(), &format!("{arguments} --cell cell.toml --recipe recipe.toml"));
    let (exit, taught) = run(&format!("teach --scan {}", fixture("panel.pcd").display()));
    assert_eq!(exit, 0, "{taught}");
    let (exit, located) = run(&format!("locate --scan {}", fixture("panel_moved.pcd").display()));
    // In a coarse scan, the pose of a small panel is known only to 0.3 mm: a person must decide.
    assert_eq!((exit, located["verdict"].as_str()), (1, Some("review")), "{located}");
    assert_eq!(located["reasons"][0]["code"].as_str(), Some("uncertain"), "{located}");
    let turn = |axis: nalgebra::Unit<nalgebra::Vector3<f64>>| {
        nalgebra::UnitQuaternion::from_axis_angle(&axis, 3.0_f64.to_radians())
    };
    let turned = turn(nalgebra::Vector3::z_axis()) * turn(nalgebra::Vector3::x_axis());
    let middle = nalgebra::Vector3::new(0.0, 0.0, 400.0);
    let truth = nalgebra::Vector3::new(5.0, -3.0, 6.0) + middle;
    for place in [[-50.0, -35.0, 408.0], [45.0, 40.0, 408.0], [0.0, 0.0, 400.0]].map(nalgebra::Vector3::from) {
        let expected = turned * (place - middle) + truth;
        let found = pose(&located) * Point::<Panel>::new(place.into());
        let off_mm = (found.mm.coords - expected).norm();
        assert!(off_mm < 0.5, "{off_mm:.3} mm off at {place:?}: {located}");
    }
    let (exit, plan) = run("plan");
    assert_eq!((exit, plan["paths"][0]["grids"].as_array().map(Vec::len)), (0, Some(4)), "{plan}");
}
