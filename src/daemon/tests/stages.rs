//! The loop says what a stage says that is called on the same picture: a command on files calls it so.

use super::*;
use crate::geometry::KukaPose;
use crate::panel::GridId;
use crate::path::Kinematics;
use crate::path::approach::Approach;
use crate::stages::survey::ToolState;
use crate::stages::{locate, plan};

#[test]
fn a_scan_gives_the_loop_and_a_command_the_same_checks() {
    let fake = Fake::new(Scene::Good);
    let (_, recipe, (panel, _), calibrations) = fake.files();
    let scan = fake.scan();
    let (camera, base_from_camera) = (&calibrations.scanner, calibrations.base_from_camera);
    let view = crate::locate::View { scan: &scan, camera, base_from_camera };
    let by_command = locate::locate(&panel, view, recipe.locate());
    let story = fake.run(Asks::one_cycle());
    let by_loop = story.findings.iter().find(|finding| finding.kind == Kind::Locate).expect("located");
    // The loop adds how long it took.
    let (elapsed, checks) = by_loop.checks.split_last().expect("numbers");
    assert_eq!(elapsed.name, name::SCAN_TO_VERDICT);
    assert!(checks.len() > 20 && by_command.obstacles().is_some());
    assert_eq!(checks, by_command.checks);
    assert_eq!(by_loop.judgement, by_command.judgement);
    let pose = by_command.fit.map(|fit| KukaPose::from_rigid(&fit.base_from_panel));
    assert_eq!(by_loop.details["base_from_panel"], serde_json::json!(pose));
}

#[test]
fn grids_give_the_loop_and_a_command_the_same_plan() {
    let fake = Fake::new(Scene::Good);
    let setup = fake.setup();
    let story = fake.run(Asks::one_cycle());
    let by_loop = story.findings.iter().find(|finding| finding.kind == Kind::Plan).expect("planned");
    let grids: Vec<GridId> =
        by_loop.names("grids").iter().map(|name| name.parse().expect("a grid's name")).collect();
    let job = &setup;
    let (panel, recipe) = (&job.panel, &job.recipe);
    let (kinematics, base_from_panel) =
        (Kinematics::new(&job.cell.arm), story.outcome.base_from_panel.expect("found"));
    let panel_stands = Approach { base_from_panel, corners: &[0, 1], obstacles: None };
    let stand = job.tour().stand(&kinematics, &panel_stands).expect("in reach");
    let fit = crate::surface::fit(panel, recipe.surface()).expect("a surface");
    let laid = plan::lay((panel, &fit), &grids, recipe).expect("a path");
    let tool = ToolState { error_mm: job.cell.limits.tool_error_mm(), worn_mm2: 0.0 };
    let by_command = plan::judge(laid, (panel, &fit), plan::Reach::From(stand), recipe, tool);
    assert!(!grids.is_empty() && by_command.checks.len() > 10);
    assert_eq!(by_loop.checks, by_command.checks);
    assert_eq!(by_loop.judgement, by_command.judgement);
}
