//! Tests that the loop reports the same findings as a stage that is called directly with the same picture, as a command
//! that evaluates files does.

use super::*;
use crate::stages::corners::CornerReference;
use crate::stages::removal::EarlierRemoval;
use crate::stages::survey::ToolState;
use crate::stages::{film, locate, plan, survey};
use panelprep_base::geometry::KukaPose;
use panelprep_base::phase::Phase;
use panelprep_cell::panel::GridId;
use panelprep_cell::record::Check;
use panelprep_toolpath::path::Kinematics;
use panelprep_toolpath::path::approach::Approach;
use panelprep_toolpath::surface::{self, TodaysScan, Treated};

#[test]
fn a_scan_gives_the_loop_and_a_command_the_same_checks() {
    let fake = Fake::new(Scene::Good);
    let (_, recipe, (panel, _), calibrations) = fake.files();
    let scan = fake.scan();
    let (camera, base_from_camera) = (&calibrations.scanner, calibrations.base_from_camera);
    let view = panelprep_vision::locate::ScanView {
        scan: &scan,
        camera,
        base_from_camera,
        range: panelprep_vision::locate::RangeErrors::default(),
    };
    let model = panelprep_vision::locate::TaughtModel::from_panel(&panel, view.range);
    let by_command = locate::locate((&panel, &model), view, &recipe);
    let story = fake.run(Asks::one_cycle());
    let by_loop = story.findings.iter().find(|finding| finding.kind == Kind::Locate).expect("located");
    // In addition to the values of the stage, the loop reports its elapsed time.
    let (elapsed, checks) = by_loop.checks.split_last().expect("numbers");
    assert_eq!(elapsed.name, name::SCAN_TO_VERDICT);
    assert!(checks.len() > 20 && by_command.obstacles().is_some());
    assert_eq!(checks, by_command.checks);
    assert_eq!(by_loop.judgement, by_command.judgement);
    let pose = by_command.fit.map(|fit| KukaPose::from_rigid(&fit.base_from_panel));
    assert_eq!(by_loop.details["base_from_panel"], serde_json::json!(pose));
}

/// Returns the points of the region in the scan of this cell in which a command locates the panel.
fn todays_scan(fake: &Fake) -> TodaysScan {
    let (_, recipe, (panel, _), calibrations) = fake.files();
    let scan = fake.scan();
    let (camera, base_from_camera) = (&calibrations.scanner, calibrations.base_from_camera);
    let view = panelprep_vision::locate::ScanView {
        scan: &scan,
        camera,
        base_from_camera,
        range: panelprep_vision::locate::RangeErrors::default(),
    };
    let model = panelprep_vision::locate::TaughtModel::from_panel(&panel, view.range);
    let located = locate::locate((&panel, &model), view, &recipe).fit.expect("found");
    let points = surface::todays_points(&panel, &scan, &(located.base_from_panel.inverse() * base_from_camera));
    TodaysScan { points, errors: None }
}

#[test]
fn grids_give_the_loop_and_a_command_the_same_plan() {
    let fake = Fake::new(Scene::Good);
    let fake_again = Fake::new(Scene::Good);
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
    let stand = job.corner_tour().reach_setup(&kinematics, &panel_stands).expect("in reach");
    let taught = panelprep_toolpath::surface::fit(panel, recipe.surface()).expect("a surface");
    let fit = survey::correct_by_scan((panel, &taught), &todays_scan(&fake_again), recipe.surface()).fit;
    let tool = ToolState {
        error_mm: job.cell.limits.tool_error_mm(),
        worn_mm2: 0.0,
        removal: None,
        stroke_mm: None,
        in_air: false,
    };
    let laid = plan::lay_paths((panel, &fit), &Treated::from_grids(&grids), (recipe, tool)).expect("a path");
    let by_command = plan::judge(
        laid,
        (panel, &fit),
        plan::ReachStart::From(stand),
        (recipe, tool),
        (None, EarlierRemoval::default()),
    );
    assert!(!grids.is_empty() && by_command.checks.len() > 10);
    assert_eq!(by_loop.checks, by_command.checks);
    assert_eq!(by_loop.judgement, by_command.judgement);
}

/// Returns the checks without the elapsed times and without the values of the loop's own moves.
fn checks_of_the_stage<'c>(checks: impl IntoIterator<Item = &'c Check>) -> Vec<Check> {
    let of_the_loop = [
        name::PER_PICTURE,
        "pictures that were dropped",
        name::CORRECTION_MOVES_NAME,
        "corner from where it was looked for",
    ];
    checks.into_iter().filter(|check| !of_the_loop.contains(&&*check.name)).cloned().collect()
}

#[test]
fn a_clip_gives_the_loop_and_a_command_the_same_checks() {
    let fake = Fake::new(Scene::Good);
    let setup = fake.setup();
    let story = fake.run(Asks::one_cycle());
    let place = story.outcome.base_from_panel.expect("found");
    let film_setup = film::FilmSetup {
        panel: &setup.panel,
        camera: &setup.calibrations.scanner,
        camera_from_panel: setup.calibrations.base_from_camera.inverse() * place,
        sanded: None,
        demands: setup.film_demands(),
        recipe: &setup.recipe,
    };
    let by_loop: Vec<_> = story.findings.iter().filter(|finding| finding.kind == Kind::Inspect).collect();
    let starts: Vec<usize> = (0..story.frames.len()).filter(|index| story.frames[*index].2 == Phase::Dry).collect();
    assert_eq!(
        (by_loop.len(), starts.len(), story.films_began_s.len()),
        (2, 2, 2),
        "a broken film, and a whole one"
    );
    // Only the first film is compared, because the second film shows sanded areas.
    for (index, by_loop) in by_loop.into_iter().enumerate().take(1) {
        let end = starts.get(index + 1).copied().unwrap_or(story.frames.len());
        let mut filming =
            film::FilmRun::begin_test(&film_setup, setup.film_demands().observation_s).expect("in the picture");
        for (place, (picture, time_s, phase)) in story.frames[starts[index]..end].iter().enumerate() {
            filming.push(picture, *time_s, *phase).expect("taken");
            if place == 0 {
                filming.set_start(story.films_began_s[index]);
            }
        }
        let filmed = filming.finish().expect("a film");
        let counted = film::FilmCounts { ms_per_picture: None, dropped: None };
        let by_command = filmed.finding(&film_setup, by_loop.pass, counted);
        assert!(by_command.checks.len() > 10);
        assert_eq!(checks_of_the_stage(&by_loop.checks), checks_of_the_stage(&by_command.checks));
        assert_eq!(by_loop.judgement, by_command.judgement);
    }
}

/// The stage receives both pictures by which the loop corrected the pose for its last finding about the corners.
#[test]
fn corner_pictures_give_the_loop_and_a_command_the_same_checks() {
    let fake = Fake::new(Scene::Good);
    let setup = fake.setup();
    let story = fake.run(Asks::one_cycle());
    let by_loop = story.findings.iter().rfind(|finding| finding.kind == Kind::Refine).expect("refined");
    let located = story.findings.iter().find(|finding| finding.kind == Kind::Locate).expect("located");
    let located: KukaPose = serde_json::from_value(located.details["base_from_panel"].clone()).expect("a pose");
    let held = CornerReference {
        corners: &setup.corners,
        camera: &setup.calibrations.flange_camera,
        lens: &setup.lens,
        limits: setup.recipe.corner(),
    };
    let pictures = story.pictures.iter().filter(|(name, ..)| name.starts_with("corner"));
    let sightings: Vec<_> = setup
        .corners
        .iter()
        .enumerate()
        .zip(pictures)
        .map(|(corner, (_, picture, flange))| {
            let camera = *flange * setup.calibrations.flange_from_camera;
            held.find(corner, picture, (located.to_rigid(), camera)).expect("a corner")
        })
        .collect();
    assert_eq!(sightings.len(), 2);
    let by_command = held.refine(located.to_rigid(), &sightings, (None, None)).expect("corrected");
    let (by_loop, by_command) = (checks_of_the_stage(&by_loop.checks), checks_of_the_stage(&by_command.checks));
    assert!(by_command.len() > 5);
    for check in &by_command {
        let same = by_loop.iter().find(|of_loop| of_loop.name == check.name).unwrap_or_else(|| panic!("{check:?}"));
        assert_eq!((&same.limit, &same.message, &same.unit), (&check.limit, &check.message, &check.unit));
        // The commands receive the poses of panel and flange rounded to the digits of a pose in a file.
        let (value, other) = (same.value.expect("measured"), check.value.expect("measured"));
        assert!((value - other).abs() < 1e-3, "{}: {value} and {other}", check.name);
    }
}
