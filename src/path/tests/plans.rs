//! Plans by hand, what is refused, and the program for running one by hand.

use super::*;

/// By hand: on a plane seen from +z with feed along x, Z = (0, 0, −1), X = (1, 0, 0), Y = Z × X = (0, −1, 0), which is
/// C = 180°; approach and retract stand 40 mm above; 160 mm of contact and 2 · 40 mm of air take 4 s at 60 mm/s, and
/// the six starts and stops at the four ends of the air moves 0.06 s / 2 each at 1000 mm/s².
#[test]
fn a_plan_over_a_plane_by_hand() {
    let (surface, settings) = (rectangle(50.0, 50.0), settings("landing_mm = 0"));
    let one = one_grid();
    let plan = plan(&surface, &one, &[GridId { row: 1, column: 1 }], &[], &settings).expect("a plan");
    let waypoints = &plan.paths[0].waypoints;
    assert_eq!(waypoints.iter().filter(|waypoint| waypoint.contact).count(), 23);
    let first = KukaPose { x_mm: 9.0, y_mm: 9.0, z_mm: 40.0, c_deg: 180.0, ..KukaPose::default() };
    let apart = tool(&waypoints[0]).inverse() * first.to_rigid::<Panel, Tool>();
    assert!(apart.turn() < Degrees(1e-6) && apart.origin().mm.coords.norm() < 1e-6, "{}", waypoints[0].pose);
    assert!(!waypoints[0].contact && waypoints[1].contact && !waypoints[24].contact);
    assert!(
        (plan.length_mm - 240.0).abs() < 1e-6
            && (plan.duration_s - 4.18).abs() < 1e-7
            && (plan.contact_mm - 160.0).abs() < 1e-6
    );
    let step_over = plan.step_over_mm.expect("four rows");
    assert!((step_over.min_mm - 32.0 / 3.0).abs() < 1e-6 && (step_over.max_mm - 32.0 / 3.0).abs() < 1e-6);
    assert!((plan.coverage - 1.0).abs() < 1e-12);
}

#[test]
fn grids_that_are_not_there_or_twice_are_refused() {
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

/// One planted defect each; the plan without one is accepted.
#[test]
fn every_planted_defect_has_its_reason() {
    let (good, settings) = good_plan();
    assert_eq!(judge(&good, &settings).verdict, Verdict::Accept, "{:?}", judge(&good, &settings));
    let planted = |spoil: fn(&mut Plan)| {
        let mut plan = good.clone();
        spoil(&mut plan);
        let judgement = judge(&plan, &settings);
        (judgement.verdict, judgement.reasons.first().map(|reason| reason.code.clone()))
    };
    let reject = |code: &'static str| (Verdict::Reject, Some(code.into()));
    assert_eq!(planted(|plan| plan.paths[1].waypoints[7].pose.b_deg = f64::NAN), reject("not_finite"));
    assert_eq!(planted(|plan| plan.paths[1].waypoints[20].pose.x_mm += 9.0), reject("large_step"));
    assert_eq!(planted(|plan| plan.paths[2].waypoints[30].pose.a_deg += 16.0), reject("large_turn"));
    assert_eq!(planted(|plan| plan.paths[0].waypoints[0].contact = true), reject("no_air"));
    let review = |code: &'static str| (Verdict::Review, Some(code.into()));
    assert_eq!(planted(|plan| plan.grids[1].covered_mm2 *= 0.94), review("coverage"));
    assert_eq!(planted(|plan| plan.overhang.largest_mm = 2.1), review("edge_overhang"));
}

/// By hand: a pad of 6 mm takes up 2 mm of error.
#[test]
fn a_press_in_needs_a_pad_that_takes_up_the_error() {
    let pressed = settings("press_in_mm = 2\npad_stroke_mm = 6");
    assert_eq!(judge_pad(&pressed, Some(2.0)).verdict, Verdict::Accept);
    assert_eq!(judge_pad(&pressed, Some(2.01)).reasons[0].code, "pad_stroke");
    assert_eq!(judge_pad(&pressed, None).verdict, Verdict::Reject);
    assert_eq!(judge_pad(&settings(""), None).verdict, Verdict::Accept, "nothing is pressed");
}

#[test]
fn the_krl_program_is_as_written() {
    let surface = rectangle(12.0, 12.0);
    let one = one_grid();
    let straight = settings("landing_mm = 0");
    let plan = plan(&surface, &one, &[GridId { row: 1, column: 1 }], &[], &straight).expect("a plan");
    let panel = KukaPose { x_mm: 600.5, a_deg: -1.25, ..KukaPose::default() };
    let text = krl(&"PANEL_1".parse().expect("a name"), &plan, Some(panel), &settings(""));
    let expected = "\
&ACCESS RVP
&REL 1
DEF PANEL_1()
; Sanding paths in the frame of the panel. Check $TOOL, run in T1 first.
BAS(#INITMOV, 0)
; $TOOL = TOOL_DATA[1] ; the sanding tool, Z out of the pad
$BASE = {X 600.500, Y 0.000, Z 0.000, A -1.2500, B 0.0000, C 0.0000} ; where the panel stands
$ACC.CP = 1.000 ; m/s2
PTP $AXIS_ACT ; block coincidence, no motion
; grid r1c1
$VEL.CP = 0.0600 ; m/s
LIN {X 6.000, Y 6.000, Z 40.000, A 0.0000, B 0.0000, C 180.0000}
; contact
LIN {X 6.000, Y 6.000, Z 0.000, A 0.0000, B 0.0000, C 180.0000}
; air
LIN {X 6.000, Y 6.000, Z 40.000, A 0.0000, B 0.0000, C 180.0000}
END
";
    assert_eq!(text.replace("-0.0000", "0.0000").replace("-180.0000", "180.0000"), expected);
    for wrong in ["", "1st", "a b", "größe", "a_name_longer_than_24_chars"] {
        assert!(wrong.parse::<ProgramName>().is_err(), "{wrong}");
    }
}
