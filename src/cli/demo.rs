//! `panelprep demo`: a complete cycle on a simulated cell, its page, and its deviations from the ground truth.
//!
//! The cell is rendered as files, the panel is taught from these files, and the cameras are verified on their boards.
//! Then the cycle runs as in `panelprep cycle`. The ground truth is read only after the cycle, for the score.
//!
//! An arm that differs from its nominal geometry is calibrated as an engineer would calibrate it: first the arm, with
//! pictures of boards and with touches, then both cameras and the tool with the corrected poses. A compliant tool is
//! commissioned in the same way: payload and force zero are measured and verified, the removal of its disc is fitted to
//! coupons, and the recipe states a required removal.

use super::args::{Common, Demo, Simulation, Teach, ToolName, TreatName, real_arm};
use super::calibrate::args::CameraName;
use super::calibrate::{self, args as asked, tool, verify};
use super::fault::Fault;
use super::live::CellDevices;
use super::output::Outcome;
use super::render_boards::{self, RenderedFiles};
use super::score::Score;
use super::{cycle, disk, render, teach, user};
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::accounts::Role;
use panelprep_service::setup::{self, Calibrated, CellFiles, TaughtRecipe};
use panelprep_sim as sim;
use panelprep_sim::Scene;
use panelprep_vision::calib::CalibError;
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Instant;
use strum::VariantArray;

/// Lines that are added to the rendered recipe if only areas around breaks are sanded.
const BY_BREAK: &str = "\n[treat]\nby = \"break\"\n";

/// Renders the cell, teaches the panel, runs the cycle, and writes the pictures and the page.
///
/// # Errors
/// If the folder cannot be written, or a rendered file is rejected.
pub fn run(args: &Demo, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let begun = Instant::now();
    let progress = |line: &str| progress(&format!("{:5.1} s  {line}", begun.elapsed().as_secs_f64()));
    let scene = Scene::from(args.scene);
    // The file is checked before anything is rendered or moves.
    if let Some(file) = &args.record {
        setup::check_command_file(file, &args.out.join("cell/store"))?;
    }
    let rendered = {
        let arm = real_arm(args.seed, args.arm_error_mm);
        let cell = sim::Cell::new(args.seed, scene, args.reduction as usize).with_arm(arm);
        render::write_taught(&cell, &args.out.join("cell"), &progress)?
    };
    if args.arm_error_mm > 0.0 {
        calibrate_arm(args, &rendered, &progress)?;
    }
    let has_compliant_tool = args.tool == ToolName::Compliant;
    if has_compliant_tool {
        calibrate_tool(args.seed, &rendered, &progress)?;
    }
    if args.treat == TreatName::Break {
        let recipe = rendered.file_path("recipe.toml");
        let text = disk::read(&recipe)?;
        disk::write(&recipe, [text.as_slice(), BY_BREAK.as_bytes()].concat())?;
    }
    let common = rendered.common_arguments();
    progress("teaching the panel at its nominal pose");
    let simulation = Simulation {
        seed: args.seed,
        scene: args.scene,
        place: 0,
        arm_error_mm: args.arm_error_mm,
        tool_fault: args.tool_fault,
        line_parts: 0,
    };
    let teaching = Teach {
        recipe: rendered.file_path("recipe.toml"),
        scan: Some(rendered.file_path("taught_scan.pcd")),
        nominal: None,
        unit: None,
        part: None,
        live: None,
        draw: false,
        no_draw: false,
        listen: ([127, 0, 0, 1], 0).into(),
        simulation,
        corner: ["taught_corner.png", "taught_corner2.png"].map(|name| rendered.file_path(name)).to_vec(),
        flange: ["taught_flange.json", "taught_flange2.json"].map(|name| rendered.file_path(name)).to_vec(),
        pictures: None,
    };
    teach::run(&teaching, &common)?;
    let files = CellFiles::read(&common.paths())?;
    let taught_recipe = TaughtRecipe::read(&files, &teaching.recipe)?;
    progress("verifying both cameras and the tool on their boards");
    let off_mm = |outcome: Outcome| outcome.json.get("error_mm").cloned();
    let force = if has_compliant_tool { Some(verify_force(&rendered, &common)?) } else { None };
    let camera = |name| verify::run(&rendered.verification(name), &common, &|_| {});
    let verified = json!({
        "scanner_mm": off_mm(camera(CameraName::Scanner)?),
        "flange_camera_mm": off_mm(camera(CameraName::FlangeCamera)?),
        "tool_mm": off_mm(verify::touch(&rendered.touch(), &common)?),
        "force_n": force.and_then(|outcome| outcome.json.get("error_n").cloned()),
    });
    let health = setup::judge_health(&files)?;
    if health.verdict == Verdict::Reject {
        let mut outcome = cycle::unhealthy_outcome(&health);
        outcome.add_value("verified", verified);
        return Ok(outcome);
    }
    if let Some(address) = args.page {
        return serve(address, (&files, &common), simulation, &progress);
    }
    let calibrated = Calibrated::read(&files)?;
    let how = cycle::Run {
        interrupts: Default::default(),
        start: CellDevices::start_demo,
        simulation,
        request: TaughtRecipe::request,
        record: args.record.as_deref(),
    };
    let ran = cycle::run_one(&files, (&taught_recipe, &calibrated), how, &progress)?;

    progress("writing the page");
    let panel = (&taught_recipe.taught.panel, taught_recipe.recipe.path().disc_diameter_mm());
    let score = ran
        .simulated
        .as_ref()
        .map(|it| Score::compute(&ran.stored.record, &ran.outcome.inspections, panel, (it, args.tool_fault)));
    let judgement = check_all_executed(ran.judgement(), score.as_ref());
    let page = args.out.join("index.html");
    let pictures = args.out.join("pictures");
    ran.stored.write_pictures(&pictures)?;
    let simulation = format!("Simulated cell, seed {}, scene {}", args.seed, scene.keyword());
    let score_section = score.iter().map(|score| score.section(&simulation));
    ran.stored.write_with(&page, ran.recorded.as_ref(), score_section.collect())?;

    let mut outcome = ran.outcome(judgement);
    let wall_s = begun.elapsed().as_secs_f64();
    outcome.add_value("seed", json!(args.seed));
    outcome.add_value("scene", json!(scene.keyword()));
    outcome.add_value("report", json!(page));
    outcome.add_value("verified", verified);
    outcome.add_value("wall_s", json!(wall_s));
    if let Some(score) = &score {
        score.add_to_outcome(&mut outcome);
        outcome.lines.extend(score.describe_score());
    }
    if let Some(link) = &ran.flange_link {
        outcome.add_value("flange_camera", link.json());
        outcome.add_line(link.describe_link());
    }
    outcome.add_line(format!("{wall_s:.1} s of wall time; page: {}", page.display()));
    Ok(outcome)
}

/// The password of the demo's accounts; there is an account for each role.
const DEMO_PASSWORD: &str = "panelprep demo";

/// Serves the simulated cell with the operator's page to browsers on this computer.
fn serve(
    address: SocketAddr,
    (files, common): (&CellFiles, &Common),
    simulation: Simulation,
    progress: &dyn Fn(&str),
) -> Result<Outcome, Fault> {
    if !address.ip().is_loopback() {
        return Err(Fault::DemoPage { address });
    }
    for role in Role::VARIANTS {
        user::add(files.store_folder(), (role.keyword(), *role), DEMO_PASSWORD)?;
    }
    let text = disk::read(&common.cell)?;
    let page = format!("\n[page]\nlisten = \"{address}\"\nrecipes = \".\"\n");
    disk::write(&common.cell, [text.as_slice(), page.as_bytes()].concat())?;
    let names: Vec<&str> = Role::VARIANTS.iter().map(|role| role.keyword()).collect();
    progress(&format!(
        "open http://{address}/ and log in with one of the names {} and the password \"{DEMO_PASSWORD}\"",
        names.join(", ")
    ));
    progress("press Ctrl+C to stop the demo");
    super::run::run(&super::args::Run { simulation }, common)
}

/// Changes the verdict to aborted if waypoints were not executed as they were sent, even if the film is unbroken.
fn check_all_executed(judgement: Judgement, score: Option<&Score>) -> Judgement {
    match score.and_then(|score| score.lost.clone()) {
        Some(lost) => Judgement {
            verdict: Verdict::Aborted,
            reasons: std::iter::once(lost).chain(judgement.reasons).collect(),
        },
        None => judgement,
    }
}

const CORRECTION: &str = "robot_correction.toml";
const NAMED_FILE: &str = "flange_from_tool = \"flange_from_tool.toml\"\n";

/// Renders boards, calibrates the arm, and adds the correction to the cell file unless `--uncorrected` is given.
///
/// # Errors
/// If a calibration is rejected.
fn calibrate_arm(args: &Demo, rendered: &RenderedFiles, progress: &dyn Fn(&str)) -> Result<(), Fault> {
    progress("rendering boards for the calibration of the arm");
    let arm = real_arm(args.seed, args.arm_error_mm);
    render_boards::write(args.seed, args.reduction as usize, (arm.as_ref(), rendered))?;
    let common = rendered.common_arguments();
    let robot = (!args.uncorrected).then(|| rendered.file_path(CORRECTION));
    if let Some(out) = &robot {
        progress("calibrating the arm");
        run_calibration(asked::CalibrationTask::Robot(arm_arguments(rendered, out.clone())), &common, out)?;
    }
    // If the arm needs no correction, there is no correction file.
    let robot = robot.filter(|file| file.exists());
    progress("calibrating cameras and tool");
    let [scanner, flange_camera] =
        ["base_from_camera.toml", "flange_from_camera.toml"].map(|name| rendered.file_path(name));
    for (mount, folder, lens, out) in [
        (asked::MountName::EyeToHand, "fixed", "scanner.toml", scanner),
        (asked::MountName::EyeInHand, "flange", "flange_camera.toml", flange_camera),
    ] {
        let what = asked::CalibrationTask::HandEye(asked::HandEye {
            mount,
            board: board(),
            intrinsics: rendered.file_path(lens),
            image: None,
            points: None,
            poses: Some(rendered.file_path(&format!("boards/{folder}/poses.toml"))),
            robot: robot.clone(),
            images: Some(rendered.file_path(&format!("boards/{folder}"))),
            at_mm: None,
            serial: None,
            out: out.clone(),
            pictures: None,
            r#move: false,
            live: asked::LiveArgs::without_live(),
        });
        run_calibration(what, &common, &out)?;
    }
    let (poses, out) = (rendered.file_path("boards/tip.toml"), rendered.file_path("flange_from_tool.toml"));
    run_calibration(
        asked::CalibrationTask::Tcp(asked::Tcp {
            poses: Some(poses),
            live: None,
            robot: robot.clone(),
            out: Some(out.clone()),
        }),
        &common,
        &out,
    )?;
    if robot.is_some() {
        let cell = disk::read_text(&common.cell)?;
        let named = cell.replace(NAMED_FILE, &format!("{NAMED_FILE}robot_correction = \"{CORRECTION}\"\n"));
        disk::write(&common.cell, named)?;
    }
    // The poses of the boards are measured with this cell's own cameras and arm, because in a real cell the robot's
    // base is not measured by other means either.
    for camera in [asked::CameraName::Scanner, asked::CameraName::FlangeCamera] {
        let look = asked::Verify { learn: true, ..rendered.verification(camera) };
        let target = look.target.clone().unwrap_or_default();
        run_calibration(asked::CalibrationTask::Verify(look), &common, &target)?;
    }
    Ok(())
}

fn board() -> asked::BoardArgs {
    asked::BoardArgs { board: "9x6".to_owned(), square_mm: Some(25.0), subpix: None }
}

fn arm_arguments(rendered: &RenderedFiles, out: PathBuf) -> asked::Robot {
    asked::Robot {
        board: board(),
        eye_to_hand: Some(rendered.file_path("boards/fixed/poses.toml")),
        scanner_lens: Some(rendered.file_path("scanner.toml")),
        eye_in_hand: Some(rendered.file_path("boards/flange/poses.toml")),
        flange_camera_lens: Some(rendered.file_path("flange_camera.toml")),
        touches: Some(rendered.file_path("boards/touches.toml")),
        out,
    }
}

/// Runs a calibration; if it is rejected, the demo ends.
fn run_calibration(what: asked::CalibrationTask, common: &Common, out: &Path) -> Result<(), Fault> {
    let outcome = calibrate::run(&asked::Calibrate { what }, common, &|_| {})?;
    if outcome.json.get("verdict") == Some(&json!(Verdict::Reject)) {
        let message = format!("{} is refused: {}", out.display(), outcome.lines.join("; "));
        return Err(Fault::stage(CalibError::Points(message)));
    }
    Ok(())
}

const CALIBRATION: &str = "removal.toml";
/// The assumed error of the simulated cell at the tool, mm, as a line of the cell file; the stroke of the tool must
/// have room for this error.
const TOOL_ERROR_LINE: &str = "tool_error_mm = 1.0\n";
/// Settings that are added to the recipe. With a step-over below the default and a high feed, the feeds have enough
/// range to make the removal uniform.
const RECIPE_SETTINGS: &str = "
[path]
force_n = 12.0
feed_mm_s = 120.0
step_over_mm = 9.0

[removal]
method = \"scheduled\"
target_um = 25.0
max_um = 60.0
";

/// Renders measurements and coupons, calibrates the tool, and writes the tool to the cell file and the required removal
/// to the recipe.
///
/// # Errors
/// If a file cannot be written, or a calibration is rejected.
fn calibrate_tool(seed: u64, rendered: &RenderedFiles, progress: &dyn Fn(&str)) -> Result<(), Fault> {
    progress("calibrating the compliant tool: payload, force zero, and removal by its disc");
    render_boards::write_force(rendered)?;
    render_boards::write_coupons(seed, rendered)?;
    let common = rendered.common_arguments();
    tool::run_removal(&asked::Removal {
        coupons: rendered.file_path("boards/coupons.csv"),
        disc_diameter_mm: render_boards::DISC_DIAMETER_MM,
        pad_n_mm3: render_boards::COUPON_TOOL.pad.stiffness_n_mm3,
        orbit_mm: render_boards::COUPON_TOOL.orbit.diameter_mm,
        orbit_rev_min: render_boards::COUPON_TOOL.orbit.speed_rev_min,
        out: rendered.file_path(CALIBRATION),
    })?;
    let measured = tool::run_force(&readings(rendered, false), &common)?;
    let [payload_kg, zero_n] = ["payload_kg", "zero_n"].map(|key| measured.json.get(key).and_then(Value::as_f64));
    let (payload_kg, zero_n) = (payload_kg.unwrap_or(f64::NAN), zero_n.unwrap_or(f64::NAN));
    let cell =
        disk::read_text(&common.cell)?.replace(NAMED_FILE, &format!("{NAMED_FILE}removal = \"{CALIBRATION}\"\n"));
    let cell = cell.replace("verify_limit_mm", &format!("{TOOL_ERROR_LINE}verify_limit_mm"));
    let tool = format!("\n[tool]\nkind = \"simulated\"\npayload_kg = {payload_kg:.3}\nzero_n = {zero_n:.3}\n");
    disk::write(&common.cell, format!("{cell}{tool}"))?;
    let recipe = rendered.file_path("recipe.toml");
    let text = disk::read_text(&recipe)?;
    Ok(disk::write(&recipe, format!("{text}{RECIPE_SETTINGS}"))?)
}

/// Verifies payload and force zero with the same measurements, as a person does at the start of each day.
///
/// # Errors
/// The errors of `panelprep calibrate force --verify`.
fn verify_force(rendered: &RenderedFiles, common: &Common) -> Result<Outcome, Fault> {
    tool::run_force(&readings(rendered, true), common)
}

fn readings(rendered: &RenderedFiles, verify: bool) -> asked::Force {
    asked::Force { readings: rendered.file_path("boards/force.toml"), verify }
}
