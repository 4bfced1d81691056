//! Random paths through every gate before motion: the good ones pass, and one planted defect refuses all of a path.

use super::kinematics::{Kinematics, joints};
use super::reach::{Leg, Obstacle, Singular, follow};
use super::{Route, WaypointLimits, judge_route};
use crate::cell::{Cell, Workspace};
use crate::geometry::{Base, Degrees, Flange, Joints, KukaPose, Point, Rigid, Tool, Vector};
use crate::verdict::Verdict;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const CELL: &str = "[[keep_out]]\nname = 'post'\nmin_mm = [900, -600, 0]\nmax_mm = [1000, -500, 900]\n\
                    [[keep_out]]\nname = 'rack'\nmin_mm = [300, 250, 0]\nmax_mm = [400, 350, 900]\n";

struct Gates {
    arm: Kinematics,
    flange_from_tool: Rigid<Flange, Tool>,
    limits: WaypointLimits,
}

impl Gates {
    fn new() -> Self {
        let cell = Cell::check("cell.toml", CELL).unwrap_or_else(|e| panic!("{e}"));
        Gates {
            arm: Kinematics::new(cell.arm()),
            flange_from_tool: KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid(),
            limits: WaypointLimits {
                workspace: Some(Workspace {
                    min: Point::at(300.0, -320.0, 150.0),
                    max: Point::at(700.0, 320.0, 750.0),
                }),
                max_step_mm: 60.0,
                max_turn: Degrees(15.0),
                max_tilt: Degrees(40.0),
            },
        }
    }

    /// Whether the whole path may be moved, from where the arm stands.
    fn pass(&self, from: &Joints, legs: &[Leg]) -> Result<(), String> {
        let waypoints: Vec<Rigid<Base, Tool>> = legs.iter().map(|leg| leg.base_from_tool).collect();
        let stands = self.arm.base_from_flange(from).expect("numbers") * self.flange_from_tool;
        let route = Route { from: stands, waypoints: &waypoints, taught_axis: Some(Vector::new(Vector3::x())) };
        let judgement = judge_route(&route, &self.limits);
        if judgement.verdict != Verdict::Accept {
            return Err(format!("{:?}", judgement.reasons));
        }
        follow(&self.arm, self.flange_from_tool, Some(from), legs).map(|_| ()).map_err(|fault| fault.to_string())
    }
}

/// A path like one over an upright panel: rows of 10 mm steps, the tool along X, leaning a little; `None` for the few
/// that come too near to the wrist's pole whatever the configuration.
fn good(random: &mut Pcg64Mcg, gates: &Gates) -> Option<(Joints, Vec<Leg>)> {
    let mut share = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
    let (x, y, z) = (share(480.0, 560.0), share(-60.0, 60.0), share(300.0, 440.0));
    let (lean_y, lean_z, bend) = (share(-8.0, 8.0), share(-8.0, 8.0), share(-0.4, 0.4));
    let mut legs = Vec::new();
    for row in 0..4 {
        for step in 0..6 {
            let along = if row % 2 == 0 { step as f64 } else { 5.0 - step as f64 };
            let pose = KukaPose {
                x_mm: x,
                y_mm: y + 10.0 * along,
                z_mm: z + 10.0 * f64::from(row),
                a_deg: lean_z + bend * along,
                b_deg: 90.0 + lean_y,
                c_deg: 0.0,
            };
            legs.push(Leg { base_from_tool: pose.to_rigid(), feed_mm_s: share(20.0, 80.0), blend_mm: 2.0 });
        }
    }
    // The arm stands 15 mm before the first point.
    let before = KukaPose { x_mm: x - 15.0, ..KukaPose::from_rigid(&legs[0].base_from_tool) };
    let start = Leg { base_from_tool: before.to_rigid(), feed_mm_s: 50.0, blend_mm: 0.0 };
    let whole: Vec<Leg> = std::iter::once(start).chain(legs.iter().copied()).collect();
    follow(&gates.arm, gates.flange_from_tool, None, &whole).ok().map(|travel| (travel.joints[0], legs))
}

/// Puts one defect into a path; its name.
fn spoil(random: &mut Pcg64Mcg, from: &mut Joints, legs: &mut [Leg]) -> &'static str {
    let nth = 1 + (random.random::<f64>() * (legs.len() - 2) as f64) as usize;
    let pose = KukaPose::from_rigid(&legs[nth].base_from_tool);
    let mut put = |pose: KukaPose| legs[nth].base_from_tool = pose.to_rigid();
    match (random.random::<f64>() * 11.0) as usize {
        0 => put(KukaPose { x_mm: f64::NAN, ..pose }),
        1 => put(KukaPose { c_deg: f64::INFINITY, ..pose }),
        2 => put(KukaPose { y_mm: pose.y_mm + 75.0, ..pose }),
        3 => put(KukaPose { z_mm: 149.0, ..pose }),
        4 => put(KukaPose { c_deg: pose.c_deg + 16.0, ..pose }),
        5 => legs.iter_mut().for_each(|leg| leg.base_from_tool = turned(leg.base_from_tool, 41.0)),
        6 => legs[nth].feed_mm_s = 0.0,
        7 => legs[nth].feed_mm_s = 20_000.0,
        8 => legs[nth].feed_mm_s = f64::NAN,
        9 => from.a1_deg += 12.0,
        // The configuration of the start is another one, or beyond its limits.
        _ => from.a5_deg = -from.a5_deg,
    }
    "planted"
}

/// Leans the tool by an angle about the base's Z, about its own point.
fn turned(pose: Rigid<Base, Tool>, deg: f64) -> Rigid<Base, Tool> {
    let kuka = KukaPose::from_rigid(&pose);
    KukaPose { a_deg: if kuka.a_deg > 0.0 { kuka.a_deg + deg } else { kuka.a_deg - deg }, ..kuka }.to_rigid()
}

fn run(paths: usize) {
    let gates = Gates::new();
    let mut random = Pcg64Mcg::seed_from_u64(11);
    let mut barren = 0;
    for path in 0..paths {
        let (mut from, mut legs) = loop {
            match good(&mut random, &gates) {
                Some(good) => break good,
                None => barren += 1,
            }
        };
        if let Err(reason) = gates.pass(&from, &legs) {
            panic!("good path {path}: {reason}");
        }
        spoil(&mut random, &mut from, &mut legs);
        assert!(gates.pass(&from, &legs).is_err(), "planted path {path}: {from:?} {legs:?}");
    }
    assert!(barren * 4 < paths, "{barren} of {paths} paths were no paths");
}

#[test]
fn a_thousand_paths_with_one_defect_are_refused_and_without_it_pass() {
    run(1_000);
}

/// `cargo test --release a_hundred_thousand -- --ignored`
#[test]
#[ignore = "a minute in release"]
fn a_hundred_thousand_paths_with_one_defect_are_refused() {
    run(100_000);
}

/// What refuses a path, one obstacle each, at hand-made places.
#[test]
fn every_obstacle_of_the_arm_has_its_name() {
    let gates = Gates::new();
    let leg = |x_mm: f64, y_mm: f64, z_mm: f64| Leg {
        base_from_tool: KukaPose { x_mm, y_mm, z_mm, b_deg: 90.0, ..KukaPose::default() }.to_rigid(),
        feed_mm_s: 50.0,
        blend_mm: 0.0,
    };
    let refused =
        |legs: &[Leg]| follow(&gates.arm, gates.flange_from_tool, None, legs).expect_err("refused").obstacle;
    // By hand: the wrist's centre 210 mm behind the tip, 1000 mm out: 975 from axis 2, of 700.9.
    let Obstacle::OutOfReach { beyond_mm } = refused(&[leg(1_210.0, 0.0, 400.0)]) else { panic!("reached") };
    assert!((beyond_mm - (975.0 - 700.855)).abs() < 0.01, "{beyond_mm}");
    // By hand: at home the wrist is straight, axis 5 at 0; the tip 480 + 120 mm out at 760.
    let from = |arm: &Kinematics, angles: [f64; 6], to: Leg| {
        follow(arm, gates.flange_from_tool, Some(&joints(angles)), &[to]).expect_err("refused").obstacle
    };
    let straight = from(&gates.arm, [0.0, -90.0, 90.0, 0.0, 0.0, 0.0], leg(600.0, 0.0, 760.0));
    assert!(matches!(straight, Obstacle::Singular { which: Singular::Wrist, .. }), "{straight:?}");
    let free = Kinematics::new(Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}")).arm());
    let beside = leg(380.0, 240.0, 500.0);
    let there = follow(&free, gates.flange_from_tool, None, &[beside]).expect("nothing in the way").joints[0];
    let kept = from(&gates.arm, super::kinematics::angles(&there), beside);
    assert!(matches!(&kept, Obstacle::KeepOut { name, .. } if name == "rack"), "{kept:?}");
    assert!(matches!(refused(&[leg(f64::NAN, 0.0, 400.0)]), Obstacle::NotFinite));
    let fast = Leg { feed_mm_s: 15_000.0, ..leg(560.0, -100.0, 400.0) };
    assert!(matches!(refused(&[leg(560.0, 60.0, 400.0), fast]), Obstacle::AxisSpeed { .. }));
    // There and back in a corner rounded over 0.5 mm at 400 mm/s changes the speed within 2.5 ms, a step's time at most.
    let quick = |y_mm: f64| Leg { feed_mm_s: 900.0, blend_mm: 0.5, ..leg(560.0, y_mm, 400.0) };
    assert!(matches!(
        refused(&[quick(0.0), quick(10.0), quick(20.0), quick(10.0)]),
        Obstacle::AxisAcceleration { .. }
    ));
    // All axes within ±limits, yet A1 beyond them: behind the arm.
    let found = follow(
        &gates.arm,
        gates.flange_from_tool,
        Some(&joints([0.0, -100.0, 110.0, 0.0, -10.0, 0.0])),
        &[leg(-500.0, 5.0, 500.0)],
    );
    assert!(found.is_err());
}
