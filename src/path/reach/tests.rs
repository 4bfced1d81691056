//! Obstacles at hand-made places.

use super::*;
use crate::cell::Cell;
use crate::geometry::KukaPose;

const CELL: &str = "[[keep_out]]\nname = 'post'\nmin_mm = [900, -600, 0]\nmax_mm = [1000, -500, 900]\n\
                    [[keep_out]]\nname = 'rack'\nmin_mm = [300, 250, 0]\nmax_mm = [400, 350, 900]\n";

struct Gates {
    arm: Kinematics,
    flange_from_tool: Rigid<Flange, Tool>,
}

impl Gates {
    fn new() -> Self {
        let cell = Cell::check("cell.toml", CELL).unwrap_or_else(|e| panic!("{e}"));
        let flange_from_tool = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        Gates { arm: Kinematics::new(cell.arm()), flange_from_tool }
    }
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
    let kept = from(&gates.arm, angles(&there), beside);
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
