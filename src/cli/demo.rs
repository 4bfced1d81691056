//! `panelprep demo`: a whole live cycle on the simulated cell, its page, and its deviation from the ground truth.
//!
//! The cell is rendered as files and taught from these files, and its cameras are verified on their boards. Then
//! the cycle runs in the same way as in `panelprep cycle`. The ground truth is read only for the score, when the
//! cycle is over.

use super::args::{Common, Demo, Simulation, Teach, ToolName, TreatName, real_arm};
use super::calibrate::args::CameraName;
use super::calibrate::verify;
use super::cycle_files::{Calibrated, TaughtRecipe};
use super::fault::Fault;
use super::live::CellDevices;
use super::load::CellFiles;
use super::outcome::Outcome;
use super::score::Score;
use super::{commissioned, cycle, demo_tool, disk, health, recording, render, teach, user};
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::accounts::Role;
use panelprep_sim::{self as sim, Scene};
use serde_json::json;
use std::net::SocketAddr;
use std::time::Instant;
use strum::VariantArray;

/// Addition to the rendered recipe if areas around breaks are abraded.
const BY_BREAK: &str = "\n[treat]\nby = \"break\"\n";

/// Renders, teaches, runs the cycle, writes pictures and page.
///
/// # Errors
/// If the folder cannot be written or a rendered file is rejected.
pub fn run(args: &Demo, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let begun = Instant::now();
    let progress = |line: &str| progress(&format!("{:5.1} s  {line}", begun.elapsed().as_secs_f64()));
    let scene = Scene::from(args.scene);
    // Checked before anything is rendered or moves.
    if let Some(file) = &args.record {
        recording::check_command_file(file, &args.out.join("cell/store"))?;
    }
    let rendered = {
        let arm = real_arm(args.seed, args.arm_error_mm);
        let cell = sim::Cell::new(args.seed, scene, args.reduction as usize).with_arm(arm);
        render::write_taught(&cell, &args.out.join("cell"), &progress)?
    };
    if args.arm_error_mm > 0.0 {
        commissioned::calibrate(args, &rendered, &progress)?;
    }
    let has_compliant_tool = args.tool == ToolName::Compliant;
    if has_compliant_tool {
        demo_tool::calibrate(args.seed, &rendered, &progress)?;
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
    let files = CellFiles::read(&common)?;
    let taught_recipe = TaughtRecipe::read(&files, &teaching.recipe)?;
    progress("verifying both cameras and the tool on their boards");
    let off_mm = |outcome: Outcome| outcome.json.get("error_mm").cloned();
    let force = if has_compliant_tool { Some(demo_tool::verify(&rendered, &common)?) } else { None };
    let camera = |name| verify::run(&rendered.verification(name), &common, &|_| {});
    let verified = json!({
        "scanner_mm": off_mm(camera(CameraName::Scanner)?),
        "flange_camera_mm": off_mm(camera(CameraName::FlangeCamera)?),
        "tool_mm": off_mm(verify::touch(&rendered.touch(), &common)?),
        "force_n": force.and_then(|outcome| outcome.json.get("error_n").cloned()),
    });
    let health = health::judge(&files)?;
    if health.verdict == Verdict::Reject {
        let mut outcome = cycle::unhealthy_outcome(&health);
        outcome.add_value("verified", verified);
        return Ok(outcome);
    }
    if let Some(address) = args.page {
        return serve(address, (&files, &common), simulation, &progress);
    }
    let calibrated = Calibrated::read(&files, &common)?;
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

/// The password of the demo's accounts; each role has an account, so that everything can be tried.
const DEMO_PASSWORD: &str = "panelprep demo";

/// Serves the simulated cell with its page to viewers on this computer.
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

/// Waypoints that were not executed as sent make the cycle a fault, whatever its film shows.
fn check_all_executed(judgement: Judgement, score: Option<&Score>) -> Judgement {
    match score.and_then(|score| score.lost.clone()) {
        Some(lost) => Judgement {
            verdict: Verdict::Aborted,
            reasons: std::iter::once(lost).chain(judgement.reasons).collect(),
        },
        None => judgement,
    }
}
