//! Tests what the cycle checks about surface and paths, and when: the reach before the panel is wetted, every motion
//! from the actual axis positions, feed and rounding as planned, the executed path, and the disc.

use super::*;
use crate::setup::CycleSetup;
use panelprep_base::geometry::{Base, Flange, Joints, Panel, Rigid, Tool};
use panelprep_cell::cell::CorrectionNumbers;
use panelprep_toolpath::path::approach::Approach;
use panelprep_toolpath::path::reach::Obstacles;
use panelprep_toolpath::path::routes::{self, StartState};
use panelprep_toolpath::path::{self, Kinematics, PanelPoses, Plan, panel_reach};
use std::collections::BTreeSet;
use std::sync::Arc;

fn codes(story: &fake::Story, kind: Kind) -> Vec<String> {
    let of_kind = story.findings.iter().filter(|finding| finding.kind == kind);
    of_kind.flat_map(|finding| &finding.judgement.reasons).map(|reason| reason.code.to_string()).collect()
}

fn number(story: &fake::Story, kind: Kind, name: &str) -> f64 {
    let finding = story.findings.iter().find(|finding| finding.kind == kind).expect("a finding");
    finding.number(name).unwrap_or_else(|| panic!("{name}: {finding:?}"))
}

/// A wall is in front of the panel: no grid can be reached, and this is detected before the water is switched on.
#[test]
fn a_panel_out_of_reach_is_rejected_before_it_is_wet() {
    let mut fake = Fake::new(Scene::Good);
    fake.more_cell = "[[keep_out]]\nname = 'wall'\nmin_mm = [575, -220, 0]\nmax_mm = [700, 220, 560]\n";
    let story = fake.run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Reject), "{story}");
    assert_eq!(story.stages().last(), Some(&Kind::Reach), "{story}");
    assert_eq!(codes(&story, Kind::Reach).first().map(String::as_str), Some("out_of_reach"), "{story}");
    let wet = story.events.iter().any(|event| format!("{event:?}").contains("Spray"));
    assert!(!wet, "{story}");
}

/// An obstacle is in front of the lower left grids: a person may continue the cycle if these grids are not expected to
/// fail.
#[test]
fn a_panel_partly_out_of_reach_is_for_a_person_to_decide() {
    let mut fake = Fake::new(Scene::Clean);
    fake.more_cell = "[[keep_out]]\nname = 'post'\nmin_mm = [480, 60, 0]\nmax_mm = [700, 260, 270]\n";
    let story = fake.run(Asks::one_cycle());
    assert!(matches!(story.outcome.state.at, At::Held(hold) if hold.why == Why::Review), "{story}");
    let reach = story.findings.iter().find(|finding| finding.kind == Kind::Reach).expect("looked at");
    assert_eq!(reach.judgement.verdict, Verdict::Review);
    let message = &reach.judgement.reasons[0].message;
    assert!(message.contains("grid r") && message.contains("\"post\"") && message.contains("panel"), "{message}");
    assert!(number(&story, Kind::Reach, "grids within the arm's reach") > 2.0);
}

/// The upper arm in the cell's file is 10 mm longer than the real one: no linear motion is started.
#[test]
fn an_arm_with_another_geometry_does_not_move() {
    let mut fake = Fake::new(Scene::Good);
    fake.more_cell = "[arm]\nmodel = 'custom'\na1_mm = 25\na2_mm = -25\nb_mm = 0\nc1_mm = 400\nc2_mm = 345\nc3_mm = 365\n\
                      c4_mm = 90\noffsets_deg = [0, -90, 0, 0, 0, 0]\nsigns = [-1, 1, 1, -1, 1, -1]\n\
                      min_deg = [-170, -190, -120, -185, -120, -350]\nmax_deg = [170, 45, 156, 185, 120, 350]\n\
                      max_speed_deg_s = [360, 300, 360, 450, 450, 540]\n";
    let story = fake.run(Asks::one_cycle());
    assert!(matches!(story.outcome.state.at, At::Aborted { .. }), "{story}");
    assert_eq!((story.lines, codes(&story, Kind::Gate)), (0, vec!["arm_model".to_owned()]), "{story}");
}

/// Expected values, calculated by hand: lines of at most 10 mm that take 200 ms to plan have a feed of at most 50 mm/s,
/// or less if the dwell time is then more uniform. Corners are rounded by a fifth of the shorter adjacent line. Paths
/// stop only at their ends.
#[test]
fn each_line_has_its_feed_and_rounding() {
    let mut fake = Fake::new(Scene::Good);
    fake.more_recipe = "[path]\nplanning_time_ms = 200\nlift_hole_mm = 30\n";
    let story = fake.run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    assert_eq!(story.feeds.len(), story.contact_points);
    let fastest = story.feeds.iter().map(|(feed, _)| *feed).fold(0.0, f64::max);
    let in_rows = story.feeds.iter().filter(|(feed, _)| *feed > 0.0199 && *feed <= 0.0501).count();
    assert!(fastest < 0.0601 && in_rows > story.feeds.len() / 2, "{fastest} {in_rows}");
    assert!(story.feeds.iter().all(|(_, blend_mm)| *blend_mm <= 0.2 * 40.0 + 1e-9));
    let stops = story.feeds.iter().filter(|(_, blend_mm)| *blend_mm == 0.0).count();
    // The path of each area stops in the air before and after the area; the first stop belongs to the approach.
    assert_eq!(stops % 2, 1, "{stops}");
}

/// A plan for the grid r2c3 of the panel at its taught pose, and the axis positions at each waypoint of the plan.
struct OnOneGrid {
    setup: CycleSetup,
    place: Rigid<Base, Panel>,
    flange_from_tool: Rigid<Flange, Tool>,
    plan: Plan,
    joints: Vec<Joints>,
}

impl OnOneGrid {
    fn new(fake: &Fake) -> Self {
        let (cell, recipe, taught, calibrations) = fake.files();
        let setup = fake::setup(&cell, &recipe, &taught, calibrations);
        let (panel, place) = (&taught.0, panelprep_cell::panel::panel_from_base_at_teaching().inverse());
        let fit = panelprep_toolpath::surface::fit(panel, recipe.surface()).expect("a surface");
        let grids = ["r2c3".parse().expect("a grid")];
        let plan = path::plan(&fit.surface, &panel.region, &grids, &panel.outline, recipe.path()).expect("a plan");
        let (arm, flange_from_tool) = (Kinematics::new(cell.arm()), calibrations.flange_from_tool);
        let stand =
            panel_reach::ReachSetup { arm: &arm, flange_from_tool, base_from_panel: place, start_joints: None };
        let reached = panel_reach::follow_plan(&plan, &stand, recipe.path()).expect("in reach");
        let plan = panel_reach::plan_with_spin(&plan, reached.spin);
        OnOneGrid { setup, place, flange_from_tool, plan, joints: reached.arm_travel.joints }
    }
}

/// A plan that fails its checks is not sent, even if a person accepted something before; a plan that a person reviewed
/// is sent.
#[test]
fn no_plan_is_sent_that_its_gate_rejects() {
    let OnOneGrid { setup, place, flange_from_tool, plan, joints } = OnOneGrid::new(&Fake::new(Scene::Good));
    let (job, joints) = (&setup, joints[0]);
    let standing =
        StartState { limits: &job.cell.limits, arm: &job.cell.arm, flange_from_tool, joints, obstacles: None };
    let first = plan.paths[0].waypoints[0].as_sent();
    let poses = PanelPoses { now: place, nominal: job.panel.nominal_pose };
    let gated = |plan: &Plan| routes::gate_contact_path(&standing, poses, (first, plan), job.recipe.path());
    assert!(gated(&plan).is_sendable(), "{:?}", gated(&plan).judgement());
    let mut doubtful = plan.clone();
    doubtful.grid_dwell[0].1.low_s *= 0.1;
    assert_eq!(path::judge(&doubtful, job.recipe.path()).verdict, Verdict::Review);
    assert!(gated(&doubtful).is_sendable(), "a person was asked before");
    for (spoil, code) in [
        ((|plan| plan.paths[0].waypoints[0].contact = true) as fn(&mut Plan), "no_air"),
        (|plan| plan.duration_s = f64::NAN, "not_finite"),
    ] {
        let mut spoilt = plan.clone();
        spoil(&mut spoilt);
        let refused = gated(&spoilt);
        assert!(!refused.is_sendable() && refused.joints.is_none(), "{code}");
        assert_eq!(refused.judgement().reasons[0].code, code);
    }
}

/// Returns the pose of the flange at a contact waypoint, with the tool lifted by this distance along its axis, and the
/// approximate axis positions there.
fn standing_over_the_panel(fake: &Fake, lifted_mm: f64) -> (Rigid<Base, Flange>, Joints) {
    let OnOneGrid { place, flange_from_tool, plan, joints, .. } = OnOneGrid::new(fake);
    let lifted = routes::lift_contact_points(&plan, lifted_mm);
    let at = routes::waypoints(&plan).iter().position(|waypoint| waypoint.contact).expect("contact") + 3;
    let base_from_flange = place * routes::waypoints(&lifted)[at].as_sent() * flange_from_tool.inverse();
    (base_from_flange, joints[at])
}

/// After a stop in contact the tool touches the panel, so no axis motion may begin. After the arm was jogged 80 mm
/// away, the cycle continues automatically.
#[test]
fn an_arm_left_at_the_panel_does_not_move_by_its_axes() {
    let fake = Fake::new(Scene::Clean);
    let stands = standing_over_the_panel(&fake, 0.0);
    let story = fake.whose_flange_stands_at(stands).run(Asks::one_cycle());
    assert!(matches!(story.outcome.state.at, At::Aborted { .. }), "{story}");
    assert_eq!(codes(&story, Kind::Gate), ["unknown_place"], "{story}");
    assert!(story.intents.iter().all(|(_, end)| end.is_none_or(|(_, done)| done == 0)), "{story}");

    let fake = Fake::new(Scene::Clean);
    let stands = standing_over_the_panel(&fake, 80.0);
    let story = fake.whose_flange_stands_at(stands).run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
}

/// The panel has bowed by 0.6 mm since it was taught. The path follows its present surface, and the record contains the
/// distance from the taught surface. If the path followed the taught surface, the distances of the contact points from
/// the panel would vary by more than half of the bow.
#[test]
fn the_path_follows_the_present_surface() {
    let spread_mm = |story: &fake::Story| {
        let mut off_mm = story.contact_off_mm.clone();
        off_mm.sort_by(f64::total_cmp);
        off_mm[off_mm.len() * 19 / 20] - off_mm[off_mm.len() / 20]
    };
    let deviation_mm = |story: &fake::Story| number(story, Kind::Reach, name::DEVIATION);
    let plain = Fake::new(Scene::Good).run(Asks::one_cycle());
    let bowed = Fake::new(Scene::Good).whose_panel_bows(0.6).run(Asks::one_cycle());
    assert_eq!([&plain, &bowed].map(|story| story.outcome.verdict), [Some(Verdict::Pass); 2], "{bowed}");
    println!(
        "spread {:.3} {:.3} mm, deviation {:.3} {:.3} mm",
        spread_mm(&plain),
        spread_mm(&bowed),
        deviation_mm(&plain),
        deviation_mm(&bowed)
    );
    assert!(spread_mm(&plain) < 0.3 && spread_mm(&bowed) < 0.3, "{} {}", spread_mm(&plain), spread_mm(&bowed));
    assert!(deviation_mm(&plain) < 0.3 && (0.2..0.7).contains(&deviation_mm(&bowed)), "{}", deviation_mm(&bowed));
}

/// A recipe that positions a drawing by datum points. Expected value, calculated by hand: the drawing's frame is at
/// (560, −200, 360) mm, rotated by 90° about z, far from the base that is the frame of a scanned panel.
const BY_DATUMS: &str = "[surface]\nmax_profile_mm = 3.0\n[nominal]\ndatums_drawing_mm = [[0, 0, 0], [400, 0, 0], [0, 250, 0]]\n\
                         datums_base_mm = [[560, -200, 360], [560, 200, 360], [310, -200, 360]]\n";

/// The panel's frame is that of the drawing, so that other programs can use the base that is set. The tool touches the
/// panel as it touches a panel that was taught by a scan, and the same checks accept it.
#[test]
fn the_base_of_a_drawn_panel_is_the_frame_of_the_drawing() {
    let by_scan = Fake::new(Scene::Good).run(Asks::one_cycle());
    let mut fake = Fake::new(Scene::Good);
    fake.more_recipe = BY_DATUMS;
    let by_drawing = fake.run(Asks::one_cycle());
    assert_eq!(by_drawing.outcome.verdict, Some(Verdict::Pass), "{by_drawing}");
    let nominal: Rigid<Base, Panel> = panelprep_base::geometry::KukaPose {
        x_mm: 560.0,
        y_mm: -200.0,
        z_mm: 360.0,
        a_deg: 90.0,
        ..Default::default()
    }
    .to_rigid();
    let expected =
        by_drawing.truth.base_from_panel * panelprep_cell::panel::panel_from_base_at_teaching() * nominal;
    let found = by_drawing.outcome.base_from_panel.expect("found");
    for corner in [[0.0, 0.0, 0.0], [400.0, 250.0, 0.0]] {
        let off_mm = found.distance_at_mm(expected, panelprep_base::geometry::Point::new(corner.into()));
        assert!(off_mm < 1.0, "{off_mm} mm at {corner:?}");
    }
    let is_set = |base: &panelprep_base::geometry::KukaPose| {
        base.to_rigid::<Base, Panel>().origin().distance_mm(found.origin()) < 1e-3
    };
    assert!(by_drawing.bases.iter().any(is_set), "{:?}", by_drawing.bases);
    let worst_mm = |story: &fake::Story| story.contact_off_mm.iter().map(|mm| mm.abs()).fold(0.0, f64::max);
    let [scanned_mm, drawn_mm] = [worst_mm(&by_scan), worst_mm(&by_drawing)];
    assert!(drawn_mm > 0.0 && (drawn_mm - scanned_mm).abs() < 0.05, "{drawn_mm} {scanned_mm}");
    assert_eq!(by_drawing.contact_points, by_scan.contact_points);
    let profile_mm = number(&by_drawing, Kind::Reach, name::PROFILE_FROM_DRAWING);
    let uncertainty_mm = number(&by_drawing, Kind::Reach, name::PROFILE_UNCERTAINTY);
    assert!(
        (0.0..1.0).contains(&profile_mm) && (0.05..2.0).contains(&uncertainty_mm),
        "{profile_mm} {uncertainty_mm}"
    );
}

/// The robot reports its poses: every failed grid was under the disc, and the swept area is recorded.
#[test]
fn the_executed_path_is_evaluated() {
    let story = Fake::new(Scene::Good).slow().run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    let abraded = story.findings.iter().find(|finding| finding.kind == Kind::Abrade).expect("abraded");
    let shares: Vec<f64> = abraded
        .checks
        .iter()
        .filter(|number| number.name.ends_with("under the disc"))
        .filter_map(|number| number.value)
        .collect();
    assert_eq!(shares.len(), abraded.details["grids"].as_array().expect("names").len());
    assert!(!shares.is_empty() && shares.iter().all(|share| *share > 0.985), "{shares:?}");
    assert!(number(&story, Kind::Abrade, "farthest of them from the planned path") < 0.5);
    assert!(number(&story, Kind::Abrade, "poses reported on the way") > 10.0);
    let contact_mm = number(&story, Kind::Abrade, "way in contact");
    assert!((story.worn_mm2 - 30.0 * contact_mm).abs() < 1e-6 && contact_mm > 100.0);
    // The wear of the whole path is recorded before the motion begins; the swept area replaces it while the motion is
    // still open.
    let [(planned_mm2, false), (correction_mm2, true)] = story.wears.as_slice() else {
        panic!("{:?}", story.wears)
    };
    assert!(*planned_mm2 > 1_000.0 && correction_mm2.abs() < 0.05 * planned_mm2, "{:?}", story.wears);
}

const BY_BREAK: &str = "[treat]\nby = \"break\"\n";

/// With grids of 97 mm, areas around water breaks are sanded. The cycle passes as with whole grids, and the contact
/// path is shorter. Every grid into which an area extends is recorded as sanded, even if it did not fail, and the
/// contact path names this grid. The second film evaluates all six grids.
#[test]
fn only_areas_around_breaks_are_abraded() {
    let run = |more_recipe: &'static str| {
        let mut fake = Fake::new(Scene::Good).slow();
        (fake.more_recipe, fake.grids) = (more_recipe, Some([2, 3]));
        fake.run(Asks::one_cycle())
    };
    let [by_grid, by_break] = ["", BY_BREAK].map(run);
    assert_eq!(by_break.outcome.verdict, Some(Verdict::Pass), "{by_break}");
    let plan = by_break.findings.iter().find(|finding| finding.kind == Kind::Plan).expect("planned");
    assert_eq!(plan.judgement.verdict, Verdict::Accept, "{plan:?}");
    assert_eq!(plan.number(name::BREAKS_REACHED), Some(1.0));
    assert!(plan.number(name::BREAKS_UNCERTAIN).is_some_and(|mm| mm < 2.0), "{plan:?}");
    let costs = plan.names("cost around the breaks and of whole grids");
    assert_eq!(costs.last().map(String::as_str), Some("chosen: around the breaks"), "{costs:?}");
    let contact_mm = |story: &fake::Story| number(story, Kind::Abrade, "way in contact");
    assert!(
        contact_mm(&by_break) < 0.9 * contact_mm(&by_grid),
        "{} {}",
        contact_mm(&by_break),
        contact_mm(&by_grid)
    );
    let abraded = by_break.findings.iter().find(|finding| finding.kind == Kind::Abrade).expect("abraded");
    let beside = plan.names("grids beside that are abraded as well");
    let both: BTreeSet<String> = plan.names("grids").into_iter().chain(beside).collect();
    assert_eq!(abraded.names("grids").into_iter().collect::<BTreeSet<_>>(), both);
    let reached = by_break.contacts[0].0.grids.iter().map(|reached| reached.grid.clone());
    assert_eq!(reached.collect::<BTreeSet<_>>(), both);
    let films = by_break.findings.iter().filter(|finding| finding.kind == Kind::Inspect);
    let judged = |film: &Finding| {
        let references = film.details.keys().filter(|detail| detail.starts_with("evaluated by the "));
        references.flat_map(|detail| film.names(detail)).collect::<BTreeSet<_>>().len()
    };
    // No grid is sanded before the first film, so the finding of this film contains no reference.
    assert_eq!(films.map(judged).next_back(), Some(6));
    // The record of a recipe with default values contains none of these values.
    let plain = by_grid.findings.iter().find(|finding| finding.kind == Kind::Plan).expect("planned");
    assert!(plain.number(name::BREAKS_REACHED).is_none() && plain.number(name::AROUND_BREAKS).is_none());
}

/// Sanding around the water breaks removes no grease here. The next film breaks in the same grids, which are sanded
/// again; then the cycle ends without a pass.
#[test]
fn a_remaining_break_is_found_again() {
    let mut fake = Fake::new(Scene::Good).whose_panel_stays_greasy();
    (fake.more_recipe, fake.grids) = (BY_BREAK, Some([2, 3]));
    let story = fake.run(Asks::one_cycle());
    assert_ne!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    let of_kind = |kind: Kind| story.findings.iter().filter(move |finding| finding.kind == kind);
    let failed: Vec<Vec<String>> = of_kind(Kind::Inspect).map(|film| film.names("failed")).collect();
    assert!(failed.len() > 1 && failed.iter().all(|names| !names.is_empty() && *names == failed[0]), "{failed:?}");
    let around = of_kind(Kind::Plan).filter(|plan| plan.number(name::AROUND_BREAKS).is_some()).count();
    assert!(around > 0, "{story}");
}

/// Only 100 mm² of the disc's life are left: a new disc is requested before the panel is wetted.
#[test]
fn a_new_disc_is_requested_before_the_panel_is_wet() {
    let mut fake = Fake::new(Scene::Good);
    (fake.more_recipe, fake.worn_mm2) = ("[path]\ndisc_life_mm2 = 100000\n", 99_900.0);
    let story = fake.run(Asks::one_cycle());
    assert!(matches!(story.outcome.state.at, At::Held(hold) if hold.why == Why::Review), "{story}");
    assert_eq!(codes(&story, Kind::Reach), ["disc_worn"], "{story}");
    assert!(story.motions(Path::Contact).is_empty());
}

/// The pad's stroke is shorter than the error at the tool: the part is rejected before the panel is wetted.
#[test]
fn a_stroke_shorter_than_the_error_is_rejected_before_the_panel_is_wet() {
    let mut fake = Fake::new(Scene::Good);
    fake.more_recipe = "[path]\npress_in_mm = 1\npad_stroke_mm = 4\n";
    let story = fake.run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Reject), "{story}");
    assert_eq!(codes(&story, Kind::Reach), ["pad_stroke"], "{story}");
}

/// The reach check uses the same posture of the arm as the later motion: the arm moves through the corners that
/// determine the panel's pose, in the same order and with the same obstacles.
#[test]
fn the_reach_check_uses_the_posture_of_the_corner_tour() {
    let fake = Fake::new(Scene::Good);
    let (cell, recipe, taught, calibrations) = fake.files();
    let setup = fake::setup(&cell, &recipe, &taught, calibrations);
    let (job, (_, corners)) = (&setup, taught);
    let (arm, place) =
        (Kinematics::new(cell.arm()), panelprep_cell::panel::panel_from_base_at_teaching().inverse());
    let at = |corners: &[usize], obstacles: Option<&Arc<Obstacles>>| {
        job.corner_tour().reach_setup(&arm, &Approach { base_from_panel: place, corners, obstacles })
    };
    assert_eq!(job.corner_tour().reachable_corners(&arm, place, 2).expect("in reach"), [0, 1]);
    for (chosen, last) in [(&[0, 1][..], 1), (&[0], 0)] {
        let joints = at(chosen, None).expect("in reach").start_joints.expect("known");
        let camera = arm.base_from_flange(&joints).expect("finite") * calibrations.flange_from_camera;
        let wanted = place * corners[last].teaching_data.panel_from_camera;
        assert!(camera.origin().distance_mm(wanted.origin()) < 0.01, "{chosen:?}");
    }
    // On a direct motion from the ready pose to the second corner, axis 3 would leave its permitted range.
    let second_first = at(&[1, 0], None).expect_err("out of reach");
    assert!(
        second_first.message.contains("corner 2") && second_first.message.contains("axis 3"),
        "{second_first:?}"
    );
    assert_eq!(at(&[], None).expect_err("no corner").code, "no_corner");
    // An obstacle at the position of the camera.
    let eye = (place * corners[1].teaching_data.panel_from_camera).origin();
    let obstacles = Arc::new(Obstacles::default().with_points_of("what the scan saw", [eye]));
    let refused = at(&[0, 1], Some(&obstacles)).expect_err("in the way");
    assert_eq!(refused.code, "out_of_reach");
    assert!(
        refused.message.contains("corner 2") && refused.message.contains("what the scan saw"),
        "{}",
        refused.message
    );
}

/// A smooth correction of the arm is valid only inside the volume in which it was measured. Outside of it, neither
/// contact nor a corner view is permitted.
#[test]
fn outside_the_correction_volume_nothing_is_measured_or_touched() {
    let fake = Fake::new(Scene::Good);
    let (cell, recipe, taught, calibrations) = fake.files();
    let panel = &taught.0;
    let place = panelprep_cell::panel::panel_from_base_at_teaching().inverse();
    let fit = panelprep_toolpath::surface::fit(panel, recipe.surface()).expect("a surface");
    let grids = ["r2c3".parse().expect("a grid")];
    let plan = path::plan(&fit.surface, &panel.region, &grids, &panel.outline, recipe.path()).expect("a plan");
    for (half_mm, code) in [(600.0, None), (30.0, Some("outside_correction"))] {
        let smooth = CorrectionNumbers::Smooth {
            middle_mm: [540.0, 300.0, 360.0],
            half_mm: [half_mm; 3],
            numbers: [0.0; panelprep_cell::cell::SMOOTH_PARAMETER_COUNT],
        };
        let cell = cell.clone().with_arm_correction(smooth);
        let setup = fake::setup(&cell, &recipe, &taught, calibrations);
        let job = &setup;
        let arm = Kinematics::new(cell.arm());
        let flange_from_tool = calibrations.flange_from_tool;
        let stand =
            panel_reach::ReachSetup { arm: &arm, flange_from_tool, base_from_panel: place, start_joints: None };
        let reached = panel_reach::follow_plan(&plan, &stand, recipe.path()).expect("in reach");
        let plan = panel_reach::plan_with_spin(&plan, reached.spin);
        let joints = reached.arm_travel.joints[0];
        let standing =
            StartState { limits: &job.cell.limits, arm: &job.cell.arm, flange_from_tool, joints, obstacles: None };
        let from = plan.paths[0].waypoints[0].as_sent();
        let poses =
            PanelPoses { now: place, nominal: panelprep_cell::panel::panel_from_base_at_teaching().inverse() };
        let contact = routes::gate_contact_path(&standing, poses, (from, &plan), recipe.path());
        let [here, there] = [0, 1].map(|index| place * plan.paths[0].waypoints[index].as_sent());
        let view = routes::gate_view(&standing, (here, there), job.sander());
        for gated in [contact, view] {
            assert_eq!(gated.is_sendable(), code.is_none(), "{:?}", gated.judgement());
            assert_eq!(gated.judgement().reasons.first().map(|reason| reason.code.to_string()).as_deref(), code);
            assert_eq!(gated.joints.is_none(), code.is_some());
        }
    }
}
