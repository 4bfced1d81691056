//! Tests of plans whose expected values are calculated by hand, of rejected plans, and of the KRL program.
//!
//! Also tests of the tool's orientation along a path: along the normal, during the landing, between areas, and with
//! lead and tilt.

use super::*;
use panelprep_base::verdict::{Check, Severity};

/// Expected values, calculated by hand. On a plane seen from +z with feed along x, Z = (0, 0, −1), X = (1, 0, 0), Y = Z
/// × X = (0, −1, 0), which is C = 180°. Approach and retraction are 40 mm above the plane. 5 rows of 44 mm with 4
/// connections of 11 mm are 264 mm of contact, in addition to 2 · 40 mm in the air at 60 mm/s. In contact the feed is
/// 20 to 60 mm/s, so the contact lasts 4.4 to 13.2 s.
#[test]
fn a_plan_over_a_plane_agrees_with_hand_calculation() {
    let (surface, settings) = (rectangle(50.0, 50.0), settings("landing_mm = 0"));
    let one = one_grid();
    let plan = plan(&surface, &one, &[GridId { row: 1, column: 1 }], &[], &settings).expect("a plan");
    let waypoints = &plan.paths[0].waypoints;
    assert_eq!(waypoints.iter().filter(|waypoint| waypoint.contact).count(), 34);
    let first = KukaPose { x_mm: 3.0, y_mm: 3.0, z_mm: 40.0, c_deg: 180.0, ..KukaPose::default() };
    let apart = tool(&waypoints[0]).inverse() * first.to_rigid::<Panel, Tool>();
    assert!(
        apart.rotation_angle() < Degrees(1e-6) && apart.origin().mm.coords.norm() < 1e-6,
        "{}",
        waypoints[0].pose()
    );
    assert!(!waypoints[0].contact && waypoints[1].contact && !waypoints[35].contact);
    assert!((plan.length_mm - 344.0).abs() < 1e-6 && (plan.contact_mm - 264.0).abs() < 1e-6);
    let air_s = 80.0 / 60.0;
    assert!((air_s + 4.4..air_s + 13.2 + 0.2).contains(&plan.duration_s), "{}", plan.duration_s);
    assert!(waypoints.iter().all(|waypoint| (20.0 - 1e-9..=60.0).contains(&waypoint.feed_mm_s)));
    let step_over = plan.step_over_mm.expect("five rows");
    assert!((step_over.min_mm - 11.0).abs() < 1e-6 && (step_over.max_mm - 11.0).abs() < 1e-6);
    assert!((plan.coverage - 1.0).abs() < 1e-12);
}

#[test]
fn unknown_or_repeated_grids_are_refused() {
    let region = region();
    let surface = rectangle(280.0, 168.0);
    let asked = |grids: &[&str]| {
        let grids: Vec<GridId> = grids.iter().map(|id| id.parse().expect("a grid")).collect();
        plan(&surface, &region, &grids, &[], &settings("")).map(|_| ())
    };
    assert_eq!(asked(&[]), Err(PlanError::NoGrids));
    assert!(matches!(asked(&["r1c1", "r4c1"]), Err(PlanError::UnknownGrid { rows: 3, columns: 5, .. })));
    assert!(matches!(asked(&["r1c1", "r2c1", "r1c1"]), Err(PlanError::Repeated { .. })));
}

fn good_plan() -> (Plan, recipe::Path) {
    let (surface, settings) = (rectangle(280.0, 168.0), settings(""));
    let region = region();
    let corner = |n: usize| {
        let along = (n % 50) as f64 / 50.0;
        let (x, y) = [(along, 0.0), (1.0, along), (1.0 - along, 1.0), (0.0, 1.0 - along)][n / 50];
        Point::at(-20.0 + 320.0 * x, -20.0 + 208.0 * y, 0.0)
    };
    let outline: Vec<Point<Panel>> = (0..200).map(corner).collect();
    let grids = ["r1c1", "r1c4", "r3c2"].map(|id| id.parse().expect("a grid"));
    (plan(&surface, &region, &grids, &outline, &settings).expect("a plan"), settings)
}

/// The tool runs on each line of a plan, also in the air between two areas. Calculated by hand: the longest line is the
/// retraction from the landing height, 3 mm, to the approach height, 40 mm. The motion through the air has waypoints
/// every 10 mm. Both are below `[limits] max_step_mm`, 100 mm, and the controller's `CELL_STEP_MM`, 110 mm, which no
/// such line may exceed.
#[test]
fn the_longest_line_with_the_tool_running_is_the_lift() {
    let (plan, settings) = good_plan();
    let waypoints: Vec<Waypoint> = plan.paths.iter().flat_map(|path| path.waypoints.clone()).collect();
    let lines = waypoints.windows(2).map(|pair| {
        let length_mm = tool(&pair[0]).origin().distance_mm(tool(&pair[1]).origin());
        (length_mm, !pair[0].contact && !pair[1].contact)
    });
    let in_air: Vec<f64> = lines.clone().filter(|(_, air)| *air).map(|(length_mm, _)| length_mm).collect();
    let longest_mm = lines.map(|(length_mm, _)| length_mm).fold(0.0, f64::max);
    let lift_mm = settings.approach_mm() - settings.landing_height_mm();
    assert!(
        plan.paths.len() == 3 && in_air.len() > 20,
        "{} paths, {} lines in the air",
        plan.paths.len(),
        in_air.len()
    );
    assert!((longest_mm - lift_mm).abs() < 1e-6 && (lift_mm - 37.0).abs() < 1e-9, "{longest_mm} mm, {lift_mm} mm");
}

/// Changes the pose of one waypoint.
fn spoil(plan: &mut Plan, path: usize, waypoint: usize, change: fn(&mut KukaPose)) {
    let waypoint = &mut plan.paths[path].waypoints[waypoint];
    let mut pose = waypoint.pose();
    change(&mut pose);
    waypoint.panel_from_tool = pose.to_rigid();
}

/// Each case has one inserted defect; the plan without a defect is accepted.
#[test]
fn every_inserted_defect_has_its_reason() {
    let (good, settings) = good_plan();
    assert_eq!(judge(&good, &settings).verdict, Verdict::Accept, "{:?}", judge(&good, &settings));
    let planted = |defect: fn(&mut Plan)| {
        let mut plan = good.clone();
        defect(&mut plan);
        let judgement = judge(&plan, &settings);
        (judgement.verdict, judgement.reasons.first().map(|reason| reason.code.clone()))
    };
    let reject = |code: &'static str| (Verdict::Reject, Some(code.into()));
    assert_eq!(planted(|plan| spoil(plan, 1, 7, |pose| pose.b_deg = f64::NAN)), reject("not_finite"));
    assert_eq!(planted(|plan| plan.paths[1].waypoints[7].feed_mm_s = f64::NAN), reject("not_finite"));
    assert_eq!(planted(|plan| plan.paths[1].waypoints[7].feed_mm_s = 0.0), reject("not_finite"));
    assert_eq!(planted(|plan| plan.duration_s = f64::NAN), reject("not_finite"));
    assert_eq!(planted(|plan| spoil(plan, 1, 20, |pose| pose.x_mm += 9.0)), reject("large_step"));
    assert_eq!(planted(|plan| spoil(plan, 2, 30, |pose| pose.a_deg += 16.0)), reject("large_turn"));
    assert_eq!(planted(|plan| plan.paths[0].waypoints[0].contact = true), reject("no_air"));
    let review = |code: &'static str| (Verdict::Review, Some(code.into()));
    assert_eq!(planted(|plan| plan.grids[1].covered_mm2 *= 0.94), review("coverage"));
    assert_eq!(planted(|plan| plan.overhang.largest_mm = 2.1), review("edge_overhang"));
    assert_eq!(planted(|plan| plan.overhang.largest_mm = 2.000_02), review("edge_overhang"), "gate and row: 2 mm");
    assert_eq!(planted(|plan| plan.grid_dwell[2].1.low_s *= 0.5), review("uneven"));
    assert_eq!(planted(|plan| plan.step_over_mm.as_mut().expect("rows").max_mm = 12.01), review("step_over"));
}

/// A path with a number that is not finite is a fault of the program: the message must not ask the operator to move the
/// panel.
#[test]
#[should_panic(expected = "is not finite")]
fn a_path_that_is_not_finite_is_never_followed() {
    let (mut plan, settings) = good_plan();
    plan.paths[1].waypoints[7].feed_mm_s = 0.0;
    let cell = panelprep_cell::cell::Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
    let arm = Kinematics::new(cell.arm());
    let stand = panel_reach::ReachSetup {
        arm: &arm,
        flange_from_tool: Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity()),
        base_from_panel: Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity()),
        start_joints: None,
    };
    let _ = panel_reach::follow_plan(&plan, &stand, &settings);
}

/// A person may decide on a grid that is out of reach, but not on a path that the plan checks reject.
#[test]
fn a_path_that_the_gate_rejects_needs_no_review() {
    let unreached = panel_reach::UnreachablePlan {
        fault: reach::ReachFault { index: 3, cause: reach::Infeasibility::OutOfReach { beyond_mm: 5.0 } },
        at: Point::at(0.0, 0.0, 0.0),
        shift: None,
    };
    let grid = |column: usize, outcome: Result<f64, Box<panel_reach::UnreachablePlan>>, refused: Vec<Check>| {
        panel_reach::GridReach { id: GridId { row: 1, column }, outcome, swept_mm2: 1.0, refused }
    };
    let mut grids = vec![grid(1, Ok(20.0), vec![]), grid(2, Err(Box::new(unreached)), vec![])];
    assert_eq!(panel_reach::judge_grids(&grids).verdict, Verdict::Review);
    grids.push(grid(
        3,
        Ok(20.0),
        vec![Check::new("step", "mm", 9.0).with_consequence_if(true, Severity::Reject, "large_turn", || {
            "grid r1c3: the tool rotates by 20°".to_owned()
        })],
    ));
    let judgement = panel_reach::judge_grids(&grids);
    assert_eq!((judgement.verdict, &*judgement.reasons[0].code), (Verdict::Reject, "large_turn"));
}

/// Expected value, calculated by hand: a pad of 6 mm stroke absorbs an error of 2 mm.
#[test]
fn a_press_in_needs_a_pad_that_absorbs_the_error() {
    let pressed = settings("press_in_mm = 2\npad_stroke_mm = 6");
    assert_eq!(judge_pad(&pressed, Some(2.0)).verdict, Verdict::Accept);
    assert_eq!(judge_pad(&pressed, Some(2.01)).reasons[0].code, "pad_stroke");
    assert_eq!(judge_pad(&pressed, None).verdict, Verdict::Reject);
    assert_eq!(judge_pad(&settings(""), None).verdict, Verdict::Accept, "nothing is pressed");
}

/// Expected values, calculated by hand: on a grid of 6 mm, a disc of 30 mm covers the grid from one point. The disc
/// moves over this point by half of its radius, 7.5 mm. The feed has its minimum, because the dwell time would
/// otherwise be too short.
#[test]
fn the_krl_program_agrees_with_the_expected_text() {
    let surface = rectangle(6.0, 6.0);
    let one = one_grid();
    let straight = settings("landing_mm = 0");
    let plan = plan(&surface, &one, &[GridId { row: 1, column: 1 }], &[], &straight).expect("a plan");
    let text = to_krl(
        &Program {
            name: &"PANEL_1".parse().expect("a name"),
            plan: &plan,
            flange_from_tool: KukaPose { z_mm: 120.0, ..KukaPose::default() },
            base_from_panel: KukaPose { x_mm: 600.5, a_deg: -1.25, b_deg: -0.00001, ..KukaPose::default() },
            start: panelprep_base::geometry::Joints {
                a1_deg: 1.5,
                a2_deg: -90.0,
                a5_deg: -0.00004,
                ..Default::default()
            },
            remarks: &["A person must decide:\nDEF".to_owned()],
        },
        &settings(""),
    );
    let expected = "\
&ACCESS RVP
&REL 1
DEF PANEL_1()
; Sanding paths in the frame of the panel. The program does not switch the tool or the water. Run it in T1 first.
; A person must decide: DEF
BAS(#INITMOV, 0)
$IPO_MODE = #BASE
$ORI_TYPE = #VAR
$TOOL = {X 0.000, Y 0.000, Z 120.000, A 0.0000, B 0.0000, C 0.0000} ; the sanding tool, its Z out of the pad; its load data is not set here
$BASE = {X 600.500, Y 0.000, Z 0.000, A -1.2500, B 0.0000, C 0.0000} ; the pose of the panel
BAS(#VEL_PTP, 20)
BAS(#ACC_PTP, 20)
$ACC.CP = 1.000 ; m/s2
; In the air above the first place. The motion to this point has not been checked.
PTP {A1 1.5000, A2 -90.0000, A3 0.0000, A4 0.0000, A5 0.0000, A6 0.0000}
; grid r1c1
$VEL.CP = 0.0600 ; m/s
LIN {X -0.750, Y 3.000, Z 40.000, A 0.0000, B 0.0000, C 180.0000}
; contact
LIN {X -0.750, Y 3.000, Z 0.000, A 0.0000, B 0.0000, C 180.0000}
$VEL.CP = 0.0200 ; m/s
LIN {X 6.750, Y 3.000, Z 0.000, A 0.0000, B 0.0000, C 180.0000}
; air
$VEL.CP = 0.0600 ; m/s
LIN {X 6.750, Y 3.000, Z 40.000, A 0.0000, B 0.0000, C 180.0000}
END
";
    assert_eq!(text.replace("-180.0000", "180.0000"), expected);
    for wrong in ["", "1st", "a b", "größe", "a_name_longer_than_24_chars", "lin", "ENDIF"] {
        assert!(wrong.parse::<ProgramName>().is_err(), "{wrong}");
    }
}

#[test]
fn the_tool_is_on_the_normal_and_turns_gently() {
    let spoil = ScanDefects { noise_mm: 0.03, flying: 0.01, ..ScanDefects::default() };
    for (shape, axis) in SHAPES.into_iter().zip(["[0, 0, 0]", "[1, 0, 0]", "[0, 1, 0]", "[0.6, -0.8, 0.1]"]) {
        let (fit, region, outline, settings) = fitted(shape, spoil, &format!("[path]\nreference_axis = {axis}\n"));
        let grids: Vec<GridId> = region.ids().collect();
        let plan = plan(&fit.surface, &region, &grids, &outline, &settings).unwrap_or_else(|e| panic!("{e}"));
        let judgement = judge(&plan, &settings);
        assert_eq!(judgement.verdict, Verdict::Accept, "{shape:?}: {judgement:?}");
        assert!(plan.grids.iter().all(|grid| grid.covered_fraction() > 0.995), "{shape:?}: {:?}", plan.grids);
        let reference = Vector3::from(settings.reference_axis());
        let (mut angle, mut spin, mut turn) = (0.0f64, 0.0f64, 0.0f64);
        for path in &plan.paths {
            for waypoint in path.waypoints.iter().filter(|waypoint| waypoint.contact) {
                let rotation = tool(waypoint).rotation();
                let normal = shape.normal(tool(waypoint).origin());
                angle = angle.max((-(rotation * Vector3::z())).angle(&normal).to_degrees());
                assert!(shape.distance_mm(tool(waypoint).origin()).abs() < 0.05);
                // X is the reference projected perpendicular to the tool's axis, so Y has no component along the
                // reference.
                spin = spin.max((rotation * Vector3::y()).dot(&reference).abs());
                assert!(reference.norm() == 0.0 || (rotation * Vector3::x()).dot(&reference) > 0.5);
            }
            for pair in path.waypoints.windows(2) {
                turn = turn.max((tool(&pair[0]).inverse() * tool(&pair[1])).rotation_angle().0);
            }
        }
        println!("{shape:?}: normals {angle:.3}°, largest turn {turn:.2}°, step-over {:?}", plan.step_over_mm);
        assert!(angle < 0.25 && spin < 1e-9 && turn < 5.0, "{shape:?}: {angle}° {spin} {turn}°");
    }
}

#[test]
fn a_reference_along_the_normal_is_refused() {
    let surface = rectangle(50.0, 50.0);
    let place = Parameter { u: 0.5, v: 0.5 };
    let refused = panel_from_tool(
        &surface,
        place,
        0.0,
        ToolOrientation::from_settings(&settings("reference_axis = [0.05, 0, -1]")),
    );
    assert!(
        matches!(refused, Err(OrientationError::ReferenceAlongNormal { angle }) if (angle.0 - 2.862).abs() < 0.01)
    );
    assert!(
        panel_from_tool(
            &surface,
            place,
            0.0,
            ToolOrientation::from_settings(&settings("reference_axis = [0.2, 0, -1]"))
        )
        .is_ok()
    );
}

/// Between two grids, the tool moves through the air at 40 mm above the surface, also over a cylinder.
#[test]
fn between_grids_the_tool_stays_above_the_surface() {
    let (fit, region, outline, settings) =
        fitted(Shape::Cylinder, ScanDefects::default(), "[path]\nlanding_mm = 0\n");
    let grids = ["r1c1", "r3c5"].map(|id| id.parse().expect("a grid"));
    let plan = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let flown: Vec<_> = plan.paths[1].waypoints.iter().take_while(|waypoint| !waypoint.contact).collect();
    assert!(flown.len() > 15);
    for waypoint in flown {
        assert!((Shape::Cylinder.distance_mm(tool(waypoint).origin()) - 40.0).abs() < 0.3);
    }
}

/// Expected value, calculated by hand: a chord of length s deviates from a cylinder of 400 mm radius by s² / 8R; a
/// limit of 0.02 mm permits 8 mm.
#[test]
fn waypoints_are_closer_where_the_panel_is_curved() {
    let (fit, region, outline, settings) =
        fitted(Shape::Cylinder, ScanDefects::default(), "[path]\nchord_error_mm = 0.02\nplanning_time_ms = 200\n");
    let grids: Vec<GridId> = region.ids().collect();
    let plan = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let contact: Vec<_> = plan.paths[0].waypoints.iter().filter(|waypoint| waypoint.contact).collect();
    let steps: Vec<f64> =
        contact.windows(2).map(|pair| tool(pair[0]).origin().distance_mm(tool(pair[1]).origin())).collect();
    let longest = steps.iter().copied().fold(0.0, f64::max);
    assert!((7.7..8.05).contains(&longest), "{longest}");
    // 8 mm in 200 ms are 40 mm/s, which is lower than the recipe's 60 mm/s.
    for (pair, step) in contact.windows(2).zip(&steps) {
        assert!(pair[1].feed_mm_s <= step / 0.2 + 1e-9, "{} after {step} mm", pair[1].feed_mm_s);
        assert!(pair[1].blend_mm <= 0.2 * step + 1e-9);
    }
}

/// Expected values, calculated by hand: the disc lands over 15 mm along the surface, from 3 mm above the surface,
/// presses in by 1.5 mm and retracts in the same way.
#[test]
fn the_disc_lands_and_leaves_while_it_moves() {
    let (surface, settings) = (rectangle(50.0, 50.0), settings("press_in_mm = 1.5\npad_stroke_mm = 5"));
    let plan = plan(&surface, &one_grid(), &["r1c1".parse().expect("a grid")], &[], &settings).expect("a plan");
    let path = &plan.paths[0].waypoints;
    let place = |n: usize| tool(&path[n]).origin().mm;
    let last = path.len() - 1;
    for [air, low, on] in [[0, 1, 2], [last, last - 1, last - 2]] {
        assert!(!path[air].contact && !path[low].contact && path[on].contact);
        assert!(
            (place(air).z - 40.0).abs() < 1e-9
                && (place(low).z - 3.0).abs() < 1e-9
                && (place(on).z + 1.5).abs() < 1e-9
        );
        assert!(((place(low) - place(on)).xy().norm() - 15.0).abs() < 1e-9);
        assert!(path[on].blend_mm > 0.0, "no stop on the panel");
        assert!(
            (place(low) - nalgebra::Point3::new(25.0, 25.0, 0.0)).xy().norm()
                < (place(on).xy() - nalgebra::Point2::new(25.0, 25.0)).norm()
        );
    }
    assert_eq!((path[0].blend_mm, path[last].blend_mm), (0.0, 0.0));
}

/// Lead and tilt rotate the tool about its own axes; the tool's point does not move.
#[test]
fn lead_and_tilt_lean_the_tool_about_its_point() {
    let surface = rectangle(50.0, 50.0);
    let at = Parameter { u: 0.5, v: 0.5 };
    let upright =
        panel_from_tool(&surface, at, 0.0, ToolOrientation::from_settings(&settings(""))).expect("a pose");
    let leaning = panel_from_tool(&surface, at, 0.0, ToolOrientation::from_settings(&settings("lead_deg = 5")))
        .expect("a pose");
    assert!(leaning.origin().distance_mm(upright.origin()) < 1e-12);
    assert!(((upright.inverse() * leaning).rotation_angle().0 - 5.0).abs() < 1e-9);
    // Expected values, calculated by hand: Z = (0, 0, −1), X = (1, 0, 0); a lead of 5° rotates Z towards X.
    let z = leaning.rotation() * Vector3::z();
    assert!((z - Vector3::new(5.0f64.to_radians().sin(), 0.0, -5.0f64.to_radians().cos())).norm() < 1e-9, "{z}");
}
