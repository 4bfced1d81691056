//! Tests of surface and paths on the simulated cell, compared with the cell's ground truth.

use super::panel_reach::{self, ReachSetup};
use super::{Kinematics, Plan, judge, plan};
use crate::surface::{Fit, fit};
use nalgebra::{Isometry3, Rotation3, Translation3, Vector3};
use panelprep_base::geometry::statistics::{QuantileRank, mean, quantile};
use panelprep_base::geometry::{Base, Degrees, KukaPose, Panel, Rigid, Tool, Vector};
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::panel::{GridId, TaughtPanel};
use panelprep_cell::recipe::Recipe;
use panelprep_sim::{Cell, SEARCH_BOX_MM, Scene};
use std::f64::consts::FRAC_PI_2;

struct Measured {
    plan: Plan,
    verdict: &'static str,
    /// Mean, 95 % quantile and maximum of the contact waypoints' distance from the true surface, mm.
    surface_mm: [f64; 3],
    /// 95 % quantile and maximum of the angle between the tool's axis and the true normal, degrees.
    normal_deg: [f64; 2],
}

/// Rotations of the whole cell about the base: the panel vertical in front of the robot, face up, face down, and
/// vertical at the side.
const ATTITUDES: [(&str, [f64; 3]); 4] = [
    ("upright", [0.0, 0.0, 0.0]),
    ("face up", [0.0, FRAC_PI_2, 0.0]),
    ("face down", [0.0, -FRAC_PI_2, 0.0]),
    ("aside", [0.0, 0.0, FRAC_PI_2]),
];

fn recipe(cell: &Cell, turn: &Rotation3<f64>) -> Recipe {
    let [low, high] = SEARCH_BOX_MM.map(|corner| turn * Vector3::from(corner));
    let (low, high) = (low.inf(&high), low.sup(&high));
    let region = cell.region();
    let corners: Vec<String> = region.corners_px.iter().map(|px| format!("[{}, {}]", px.u, px.v)).collect();
    let text = format!(
        "panel = \"p\"\n[region]\ncorners_px = [{}]\nrows = {}\ncolumns = {}\n\
         [locate]\nbox_min_mm = {:?}\nbox_max_mm = {:?}\n",
        corners.join(", "),
        region.rows,
        region.columns,
        low.as_slice(),
        high.as_slice()
    );
    Recipe::check("simulated.toml", &text).unwrap_or_else(|e| panic!("{e}"))
}

fn measured(seed: u64, reduction: usize, [roll, pitch, yaw]: [f64; 3]) -> Measured {
    let turn = Rotation3::from_euler_angles(roll, pitch, yaw);
    let cell = Cell::new(seed, Scene::Good, reduction);
    let (recipe, truth) = (recipe(&cell, &turn), cell.truth());
    // The panel's frame of the rotated cell, in the frame of the ground truth.
    let turned_from_panel: Rigid<Panel, Panel> =
        Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::identity(), turn.into()));
    let base_from_camera =
        Rigid::<Base, Base>::from_isometry_unchecked(*turned_from_panel.isometry()) * truth.base_from_camera;
    // The camera's true pose is used, because this test measures the fit and the path, not the calibration.
    let panel = TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), base_from_camera, &recipe)
        .unwrap_or_else(|e| panic!("{e}"));
    let Fit { surface, .. } = fit(&panel, recipe.surface()).unwrap_or_else(|e| panic!("{e}"));
    let grids: Vec<GridId> = panel.region.ids().collect();
    let plan =
        plan(&surface, &panel.region, &grids, &panel.outline, recipe.path()).unwrap_or_else(|e| panic!("{e}"));
    let (mut distances, mut angles) = (Vec::new(), Vec::new());
    for waypoint in plan.paths.iter().flat_map(|path| &path.waypoints).filter(|waypoint| waypoint.contact) {
        let panel_from_tool = turned_from_panel.inverse() * waypoint.panel_from_tool;
        let outward = panel_from_tool * Vector::<Tool>::new(-Vector3::z());
        distances.push(truth.distance_mm(panel_from_tool.origin()).abs());
        angles.push(outward.angle_between(truth.normal(panel_from_tool.origin())).0);
    }
    let at = |values: &mut [f64], share: f64| quantile(values, share, QuantileRank::Lower).expect("waypoints");
    Measured {
        verdict: judge(&plan, recipe.path()).verdict.keyword(),
        surface_mm: [
            mean(distances.iter().copied()).expect("waypoints"),
            at(&mut distances, 0.95),
            at(&mut distances, 1.0),
        ],
        normal_deg: [at(&mut angles, 0.95), at(&mut angles, 1.0)],
        plan,
    }
}

/// Checks the minimum quality: normals within 1°, coverage of every grid at least 0.995.
fn assert_quality(measured: &Measured) -> bool {
    measured.normal_deg[1] < 1.0
        && measured.surface_mm[2] < 0.3
        && measured.plan.grids.iter().all(|grid| grid.covered_fraction() >= 0.995)
        && measured.verdict == "accept"
}

#[test]
fn a_quarter_size_scan_is_planned_in_every_attitude() {
    for (name, turn) in ATTITUDES {
        let m = measured(1, 4, turn);
        println!("{name}: {:?} {:?} {:.4}", m.surface_mm, m.normal_deg, m.plan.coverage);
        assert!(
            assert_quality(&m),
            "{name}: {} {:?} {:?} {:?}",
            m.verdict,
            m.surface_mm,
            m.normal_deg,
            m.plan.overhang
        );
    }
}

/// The arm of the simulated cell can follow the plan over all grids at the panel's pose, and over each grid alone. If
/// the panel is 400 mm farther away, the arm cannot follow, and the message contains the waypoint, the distance and a
/// remedy.
#[test]
fn the_simulated_arm_follows_or_reports_the_cause() {
    let cell = Cell::new(1, Scene::Good, 4);
    let (recipe, truth) = (recipe(&cell, &Rotation3::identity()), cell.truth());
    let panel = TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), truth.base_from_camera, &recipe)
        .unwrap_or_else(|e| panic!("{e}"));
    let Fit { surface, .. } = fit(&panel, recipe.surface()).unwrap_or_else(|e| panic!("{e}"));
    let grids: Vec<GridId> = panel.region.ids().collect();
    let plan =
        plan(&surface, &panel.region, &grids, &panel.outline, recipe.path()).unwrap_or_else(|e| panic!("{e}"));
    let checked = panelprep_cell::cell::Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
    let arm = Kinematics::new(checked.arm());
    let flange_from_tool = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
    let stand =
        ReachSetup { arm: &arm, flange_from_tool, base_from_panel: truth.base_from_panel, start_joints: None };
    let reached = panel_reach::follow_plan(&plan, &stand, recipe.path()).unwrap_or_else(|e| panic!("{e:?}"));
    println!("room {:.1}°, spin {}", reached.arm_travel.room_deg, reached.spin);
    let waypoints: usize = plan.paths.iter().map(|path| path.waypoints.len()).sum();
    assert_eq!(reached.arm_travel.joints.len(), waypoints);
    // Checked with the forward kinematics: the axis angles put the tool at the poses of the plan.
    let legs = panel_reach::plan_legs(&panel_reach::plan_with_spin(&plan, reached.spin), &stand, 0.0);
    for (joints, leg) in reached.arm_travel.joints.iter().zip(&legs) {
        let there = arm.base_from_flange(joints).expect("numbers") * flange_from_tool;
        assert!(there.origin().distance_mm(leg.base_from_tool.origin()) < 1e-3);
        assert!((there.inverse() * leg.base_from_tool).rotation_angle().0 < 1e-3, "as the tool is turned, too");
    }
    // The poses that the arm follows with a spin of the tool are those of the plan with this spin.
    let turned = panel_reach::plan_legs(&panel_reach::plan_with_spin(&plan, Degrees(60.0)), &stand, 0.0);
    for (written, followed) in turned.iter().zip(&panel_reach::plan_legs(&plan, &stand, 60.0)) {
        let between = written.base_from_tool.inverse() * followed.base_from_tool;
        assert!(between.origin().mm.coords.norm() < 1e-9 && between.rotation_angle().0 < 1e-6);
    }
    let around = (&panel.region, panel.outline.as_slice());
    let all = panel_reach::check_grids(&surface, around, &stand, recipe.path()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((all.len(), panel_reach::judge_grids(&all).verdict), (grids.len(), Verdict::Accept));
    // The panel is so near that the arm can follow the path but cannot retract after a stop: this is reported for the
    // grids, and for the plan.
    let nearer = ReachSetup {
        base_from_panel: truth.base_from_panel.followed_by_displacement(Vector::new(Vector3::x() * -100.0)),
        ..stand
    };
    let refused = panel_reach::follow_plan(&plan, &nearer, recipe.path());
    let judgement = Judgement::from_checks([&panel_reach::check_plan(&refused, (&surface, &panel.region))]);
    let message = &judgement.reasons[0].message;
    println!("{message}");
    assert_eq!(&*judgement.reasons[0].code, "retract_out_of_reach");
    assert!(message.contains("axis 3") && message.contains("towards +X"), "{message}");
    let grids =
        panel_reach::check_grids(&surface, around, &nearer, recipe.path()).unwrap_or_else(|e| panic!("{e}"));
    let judgement = panel_reach::judge_grids(&grids);
    let reported: Vec<&str> = judgement.reasons.iter().map(|reason| reason.code.as_ref()).collect();
    assert!(judgement.verdict != Verdict::Accept && reported.contains(&"retract_out_of_reach"), "{reported:?}");
    let farther = truth.base_from_panel.followed_by_displacement(Vector::new(Vector3::x() * 400.0));
    let stand = ReachSetup { base_from_panel: farther, ..stand };
    let refused = panel_reach::follow_plan(&plan, &stand, recipe.path());
    let judgement = Judgement::from_checks([&panel_reach::check_plan(&refused, (&surface, &panel.region))]);
    let message = &judgement.reasons[0].message;
    println!("{message}");
    assert_eq!((judgement.verdict, &*judgement.reasons[0].code), (Verdict::Reject, "out_of_reach"));
    assert!(
        message.contains("grid r") && message.contains("waypoint") && message.contains("towards −X"),
        "{message}"
    );
}
