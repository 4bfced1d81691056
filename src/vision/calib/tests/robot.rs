//! Tests of the calibration of arms with known errors: the estimated errors are compared with the true values.

use crate::calib::arm_errors::{ARM_PARAMETER_COUNT, AxisFault, base_from_flange, prior_std};
use crate::calib::gate;
use crate::calib::robot::{
    ArmPose, ArmTouch, ArmView, Correction, Rig, RigKind, RobotData, RobotFound, TouchTarget, calibrate,
};
use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Flange, Joints, Point};
use panelprep_base::verdict::Verdict;
use panelprep_cell::cell::Cell;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn normal(random: &mut Pcg64) -> f64 {
    (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
}

/// A KR 6 with zero errors of up to 0.05°, twists of up to 0.03°, lengths of up to 0.4 mm and a sag of up to 0.3 mm.
/// The data are 40 pictures of both cameras and touches of two spots.
struct Simulated {
    data: RobotData,
    errors: [f64; ARM_PARAMETER_COUNT],
    tip: Vector3<f64>,
}

const REPEATABILITY_MM: f64 = 0.03;
const PICTURE_STD_MM: f64 = 0.04;
const PICTURE_STD_RAD: f64 = 1e-4;

fn simulated(seed: u64, count: usize) -> Simulated {
    let geometry = *Cell::check("f", "").unwrap_or_else(|problems| panic!("{problems}")).arm().geometry();
    let mut random = Pcg64::seed_from_u64(seed);
    let errors: [f64; ARM_PARAMETER_COUNT] = std::array::from_fn(|index| match index {
        30 | 31 => random.random::<f64>() * prior_std()[index],
        _ => (random.random::<f64>() * 2.0 - 1.0) * prior_std()[index],
    });
    let turn = |x: f64, y: f64, z: f64| UnitQuaternion::from_scaled_axis(Vector3::new(x, y, z));
    let iso = |x, y, z, r| Isometry3::from_parts(Translation3::new(x, y, z), r);
    // One rig has a fixed camera above the panel and a board on the flange; the other has a camera on the flange and a
    // board on the table.
    let rigs = [
        Rig {
            kind: RigKind::EyeToHand,
            mount: iso(560.0, 0.0, 1300.0, turn(std::f64::consts::PI, 0.0, 0.0)),
            board: iso(-60.0, -40.0, 20.0, turn(0.02, 0.01, 0.1)),
        },
        Rig {
            kind: RigKind::EyeInHand,
            mount: iso(0.0, 60.0, 40.0, turn(0.02, -0.1, 0.03)),
            board: iso(480.0, -60.0, 100.0, turn(std::f64::consts::PI, 0.0, 0.2)),
        },
    ];
    let tip = Vector3::new(3.0, -2.0, 150.0);
    let pose = |random: &mut Pcg64| {
        let mut at = |middle: f64, spread: f64| middle + (random.random::<f64>() * 2.0 - 1.0) * spread;
        Joints {
            a1_deg: at(0.0, 35.0),
            a2_deg: at(-75.0, 25.0),
            a3_deg: at(90.0, 30.0),
            a4_deg: at(0.0, 60.0),
            a5_deg: at(60.0, 40.0),
            a6_deg: at(0.0, 90.0),
        }
    };
    let noisy = |truth: Isometry3<f64>, random: &mut Pcg64| -> Isometry3<f64> {
        let mut n = |sigma: f64| sigma * normal(random);
        let shift = PICTURE_STD_MM.hypot(REPEATABILITY_MM);
        truth
            * Isometry3::new(
                Vector3::new(n(shift), n(shift), n(shift)),
                Vector3::new(n(PICTURE_STD_RAD), n(PICTURE_STD_RAD), n(PICTURE_STD_RAD)),
            )
    };
    let information = Matrix6::from_diagonal(&nalgebra::Vector6::new(
        PICTURE_STD_RAD.powi(-2),
        PICTURE_STD_RAD.powi(-2),
        PICTURE_STD_RAD.powi(-2),
        0.05f64.powi(-2),
        0.05f64.powi(-2),
        0.05f64.powi(-2),
    ));
    let arm_pose = |joints: Joints| ArmPose {
        joints: Some(joints),
        base_from_flange: base_from_flange(&geometry, &joints, &[0.0; ARM_PARAMETER_COUNT]),
    };
    let views = (0..count).map(|index| {
        let (rig, joints) = (index % 2, pose(&mut random));
        let flange = *base_from_flange(&geometry, &joints, &errors).isometry();
        let truth = match rigs[rig].kind {
            RigKind::EyeToHand => rigs[rig].mount.inverse() * flange * rigs[rig].board,
            RigKind::EyeInHand => (flange * rigs[rig].mount).inverse() * rigs[rig].board,
        };
        ArmView {
            name: format!("{index}.png"),
            rig,
            pose: arm_pose(joints),
            camera_from_board: noisy(truth, &mut random),
            information,
            rms_px: 0.05,
        }
    });
    let views: Vec<ArmView> = views.collect();
    // For each touch, an arm pose near a known one is moved until the true tip is at the spot.
    let spots = [Vector3::new(450.0, -100.0, 250.0), Vector3::new(560.0, 90.0, 300.0)];
    let mut touches = Vec::new();
    for index in 0..10 {
        let spot = index % 2;
        if let Some(joints) =
            solve_axis_angles(&geometry, &errors, tip, spots[spot], pose(&mut random), &mut random)
        {
            touches.push(ArmTouch { target: TouchTarget::Spot(spot), pose: arm_pose(joints) });
        }
    }
    let near = |truth: &Isometry3<f64>| {
        truth * Isometry3::new(Vector3::new(3.0, -2.0, 4.0), Vector3::new(0.01, 0.02, -0.01))
    };
    let started = rigs.iter().map(|rig| Rig { kind: rig.kind, mount: near(&rig.mount), board: near(&rig.board) });
    Simulated { data: RobotData { geometry, rigs: started.collect(), views, touches }, errors, tip }
}

/// Finds axis angles, near a start, at which the true tip is at a spot: Newton's method with the first three axes.
fn solve_axis_angles(
    geometry: &panelprep_cell::cell::ArmGeometry,
    errors: &[f64; ARM_PARAMETER_COUNT],
    tip: Vector3<f64>,
    spot: Vector3<f64>,
    start: Joints,
    random: &mut Pcg64,
) -> Option<Joints> {
    let at = |j: &Joints| (base_from_flange(geometry, j, errors) * Point::<Flange>::new(tip.into())).mm.coords;
    let moved = |j: &Joints, d: Vector3<f64>| Joints {
        a1_deg: j.a1_deg + d.x,
        a2_deg: j.a2_deg + d.y,
        a3_deg: j.a3_deg + d.z,
        ..*j
    };
    let mut joints = start;
    for _ in 0..50 {
        let off = spot - at(&joints);
        if off.norm() < 1e-6 {
            let slip = Vector3::new(normal(random), normal(random), normal(random)) * 0.004;
            return Some(moved(&joints, slip));
        }
        let column = |axis: usize| (at(&moved(&joints, Vector3::ith(axis, 1e-4))) - at(&joints)) / 1e-4;
        let step = nalgebra::Matrix3::from_columns(&[column(0), column(1), column(2)]).try_inverse()? * off;
        joints = moved(&joints, step * (5.0 / step.norm()).min(1.0));
    }
    None
}

/// Returns the distance between the corrected tip and the spot as the scanner camera sees it, for spots over a panel of
/// 360 × 260 mm.
fn contact_errors_mm(simulated: &Simulated, found: &RobotFound, corrected: bool) -> Vec<(f64, f64)> {
    let geometry = &simulated.data.geometry;
    let truth = Isometry3::from_parts(
        Translation3::new(560.0, 0.0, 1300.0),
        UnitQuaternion::from_scaled_axis(Vector3::new(std::f64::consts::PI, 0.0, 0.0)),
    );
    let mut random = Pcg64::seed_from_u64(99);
    let mut all = Vec::new();
    for index in 0..25 {
        let spot = Vector3::new(400.0 + 65.0 * f64::from(index % 5), -180.0 + 90.0 * f64::from(index / 5), 260.0);
        let start = Joints { a1_deg: 0.0, a2_deg: -70.0, a3_deg: 95.0, a4_deg: 0.0, a5_deg: 60.0, a6_deg: 0.0 };
        let joints = solve_axis_angles(geometry, &simulated.errors, simulated.tip, spot, start, &mut random)
            .expect("in reach");
        let nominal = base_from_flange(geometry, &joints, &[0.0; ARM_PARAMETER_COUNT]);
        let pose = ArmPose { joints: Some(joints), base_from_flange: nominal };
        // The camera sees the true spot, and gives its position with the estimated mount.
        let seen = (found.rigs[0].mount * truth.inverse() * nalgebra::Point3::from(spot)).coords;
        let flange = if corrected { found.correction.base_from_flange(&pose).expect("axes") } else { nominal };
        let tip = found.tip_mm.expect("touched");
        let believed = (flange * Point::<Flange>::new(tip.into())).mm.coords;
        all.push(((believed - seen).norm(), found.tip_uncertainty_mm(&pose).expect("axes")));
    }
    all
}

#[test]
fn the_kinematics_agree_with_the_controller() {
    let arm = Cell::check("f", "").unwrap_or_else(|problems| panic!("{problems}")).arm().geometry().to_owned();
    // Expected pose of the KR 6 with axes 2 and 3 at −90° and 90°, calculated by hand: upper arm up, forearm ahead.
    let joints = Joints { a2_deg: -90.0, a3_deg: 90.0, ..Joints::default() };
    let flange = base_from_flange(&arm, &joints, &[0.0; ARM_PARAMETER_COUNT]).origin().mm;
    assert!(
        (flange - nalgebra::Point3::new(25.0 + 365.0 + 90.0, 0.0, 400.0 + 335.0 + 25.0)).norm() < 1e-9,
        "{flange}"
    );
}

/// The correction removes most of the error of an arm over the whole panel. From data without axis angles, it removes a
/// part of the error.
#[test]
fn an_arm_s_own_errors_are_found() {
    for seed in 1..=3 {
        let simulated = simulated(seed, 40);
        let found = calibrate(&simulated.data).expect("an arm");
        let worst = |corrected| {
            contact_errors_mm(&simulated, &found, corrected).iter().map(|(mm, _)| *mm).fold(0.0, f64::max)
        };
        assert!(matches!(found.correction, Correction::Geometry { .. }));
        assert!(
            found.corrected_left_out_mm < 0.6 * found.uncorrected_left_out_mm,
            "{} {}",
            found.uncorrected_left_out_mm,
            found.corrected_left_out_mm
        );
        assert!(worst(true) < 0.3, "seed {seed}: {} mm, before {}", worst(true), worst(false));
        let reported = found.numbers.iter().filter(|number| number.remaining_share < 0.5).count();
        assert!(reported >= 8 && found.numbers.iter().all(|number| number.remaining_share < 1.01), "{reported}");
        println!(
            "seed {seed}: left out {:.3} → {:.3} mm, contact {:.3} → {:.3} mm, {reported} numbers told",
            found.uncorrected_left_out_mm,
            found.corrected_left_out_mm,
            worst(false),
            worst(true)
        );
        let mut blind = simulated.data.clone();
        blind.views.iter_mut().for_each(|view| view.pose.joints = None);
        blind.touches.iter_mut().for_each(|touch| touch.pose.joints = None);
        let found = calibrate(&blind).expect("a smooth correction");
        assert!(matches!(found.correction, Correction::Smooth { .. }));
        println!(
            "seed {seed}, smooth: left out {:.3} → {:.3} mm",
            found.uncorrected_left_out_mm, found.corrected_left_out_mm
        );
    }
}

/// If the arm is nearly accurate and a correction removes less than 10 % of the error, the arm needs no correction. If
/// the arm is less accurate and a correction removes no more, the data do not determine a correction.
#[test]
fn an_arm_that_no_correction_improves_needs_none() {
    let found = calibrate(&simulated(1, 40).data).expect("an arm");
    let judged = |before: f64, after: f64| {
        let found = RobotFound { uncorrected_left_out_mm: before, corrected_left_out_mm: after, ..found.clone() };
        (gate::needs_no_correction(&found), gate::robot(&found, 40).verdict)
    };
    assert_eq!(judged(0.07, 0.02), (true, Verdict::Accept));
    assert_eq!(judged(0.083, 0.078), (true, Verdict::Accept));
    assert_eq!(judged(0.10, 0.03), (false, Verdict::Accept));
    assert_eq!(judged(0.20, 0.19), (false, Verdict::Reject));
    assert_eq!(judged(0.10, f64::NAN), (false, Verdict::Reject));
}

/// Each error of the axis angles is named, with and without the poses of the controller.
#[test]
fn exchanged_axes_and_wrong_signs_are_named() {
    let simulated = simulated(4, 24);
    for fault in [
        AxisFault::Exchanged(4, 6),
        AxisFault::Exchanged(2, 3),
        AxisFault::Sign(1),
        AxisFault::Sign(5),
        AxisFault::Sign(4),
    ] {
        for with_poses in [true, false] {
            let mut data = simulated.data.clone();
            for view in &mut data.views {
                let wrong = fault.correct_angles(&view.pose.joints.expect("axes"));
                view.pose.joints = Some(wrong);
                if !with_poses {
                    view.pose.base_from_flange =
                        base_from_flange(&data.geometry, &wrong, &[0.0; ARM_PARAMETER_COUNT]);
                }
            }
            let error = calibrate(&data).expect_err("wrong axes").to_string();
            assert!(error.contains(&fault.to_string()), "{fault}, {with_poses}: {error}");
        }
    }
}
