//! Checks whether the arm can follow a path: within its limits and margins, in one configuration, at the requested
//! speed.
//!
//! A path of linear motions is divided into steps of at most 10 mm and 3°. In each step, the axis solution nearest to
//! the previous one is used. So the path keeps its initial configuration, and a change of the configuration is detected
//! as a jump of an axis. The initial configuration is that of the arm, or, before this is known, the one with the most
//! room. Every step must keep the margins of the cell's file from the axis limits and from the three singularities
//! (wrist, extended elbow, wrist over axis 1). It must also keep the speed and acceleration limits of each axis, and
//! the distances from the keep-out boxes. At a corner that is rounded over b mm the speed changes within 2 b / feed; at
//! a stop, the controller's own acceleration ramp applies. A path is rejected as a whole.

mod follow;
mod infeasible;

pub use super::obstacles::Obstacles;
pub use follow::{ArmTravel, check_retracts, follow_path, helpful_shift, joint_motion, postures, retract};
pub use infeasible::{
    Infeasibility, PathLine, ReachFault, Singularity, arm_for_departure, interpolate_pose, is_clear,
};

#[cfg(test)]
mod tests {
    //! Tests of paths that are rejected, at poses calculated by hand.

    use super::infeasible::{CheckedPose, check_axis_speeds, check_keep_out, first_exceeded_axis};
    use super::*;
    use crate::path::kinematics::{JointAngles, Kinematics};
    use panelprep_base::geometry::{Flange, Joints, KukaPose, Point, Rigid, Tool};
    use panelprep_cell::cell::Cell;

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

    /// Each cause for which a path is rejected, at poses calculated by hand.
    #[test]
    fn every_cause_of_a_refusal_has_its_code() {
        let gates = Gates::new();
        let leg = |x_mm: f64, y_mm: f64, z_mm: f64| PathLine {
            base_from_tool: KukaPose { x_mm, y_mm, z_mm, b_deg: 90.0, ..KukaPose::default() }.to_rigid(),
            feed_mm_s: 50.0,
            blend_mm: 0.0,
        };
        let refused = |legs: &[PathLine]| {
            follow_path(&gates.arm, gates.flange_from_tool, None, legs).expect_err("refused").cause
        };
        // Expected value, calculated by hand: the wrist's centre is 210 mm behind the tip, at 1000 mm. It is 975 mm
        // from axis 2, while the reach is 700.9 mm.
        let Infeasibility::OutOfReach { beyond_mm } = refused(&[leg(1_210.0, 0.0, 400.0)]) else {
            panic!("reached")
        };
        assert!((beyond_mm - (975.0 - 700.855)).abs() < 0.01, "{beyond_mm}");
        // Calculated by hand: in the home position the wrist is straight with axis 5 at 0; the tip is at 480 + 120 mm,
        // at a height of 760 mm.
        let from = |arm: &Kinematics, angles: [f64; 6], to: PathLine| {
            follow_path(arm, gates.flange_from_tool, Some(&Joints::from(angles)), &[to]).expect_err("refused").cause
        };
        let straight = from(&gates.arm, [0.0, -90.0, 90.0, 0.0, 0.0, 0.0], leg(600.0, 0.0, 760.0));
        assert!(
            matches!(straight, Infeasibility::Singular { singularity: Singularity::Wrist, .. }),
            "{straight:?}"
        );
        let free = Kinematics::new(Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}")).arm());
        let beside = leg(380.0, 240.0, 500.0);
        let there =
            follow_path(&free, gates.flange_from_tool, None, &[beside]).expect("nothing in the way").joints[0];
        let kept = from(&gates.arm, there.degrees(), beside);
        assert!(matches!(&kept, Infeasibility::KeepOut { name, .. } if name == "rack"), "{kept:?}");
        assert!(matches!(refused(&[leg(f64::NAN, 0.0, 400.0)]), Infeasibility::NotFinite));
        let fast = PathLine { feed_mm_s: 15_000.0, ..leg(560.0, -100.0, 400.0) };
        assert!(matches!(refused(&[leg(560.0, 60.0, 400.0), fast]), Infeasibility::AxisSpeed { .. }));
        // A motion to one side and back, with a corner rounded over 0.5 mm at 900 mm/s, changes the speed within the
        // time of one step.
        let quick = |y_mm: f64| PathLine { feed_mm_s: 900.0, blend_mm: 0.5, ..leg(560.0, y_mm, 400.0) };
        assert!(matches!(
            refused(&[quick(0.0), quick(10.0), quick(20.0), quick(10.0)]),
            Infeasibility::AxisAcceleration { .. }
        ));
        // Behind the arm, A1 exceeds its limits; all other angles are within their limits.
        let found = follow_path(
            &gates.arm,
            gates.flange_from_tool,
            Some(&Joints::from([0.0, -100.0, 110.0, 0.0, -10.0, 0.0])),
            &[leg(-500.0, 5.0, 500.0)],
        );
        assert!(found.is_err());
    }

    fn look(seconds: f64, change_s: Option<f64>) -> CheckedPose {
        let base_from_flange = KukaPose { x_mm: 480.0, z_mm: 760.0, b_deg: 90.0, ..KukaPose::default() }.to_rigid();
        let tip = Point::at(600.0, 0.0, 760.0);
        CheckedPose { index: 0, base_from_flange, tip, seconds, change_s, is_end: true, solutions: Vec::new() }
    }

    /// Calculated by hand: in 10 ms, each axis may rotate by a hundredth of its speed limit, and its speed may change
    /// by a hundredth of its acceleration limit. If either is exceeded by a thousandth, the path is rejected because of
    /// that axis.
    #[test]
    fn speed_and_acceleration_hold_up_to_their_limits() {
        let arm = Gates::new().arm;
        let axes = arm.arm().axes();
        assert_eq!(axes.max_speed_deg_s, [360.0, 300.0, 360.0, 450.0, 450.0, 540.0]);
        for axis in 0..6 {
            let only = |value: f64| -> JointAngles { std::array::from_fn(|n| if n == axis { value } else { 0.0 }) };
            for sign in [1.0, -1.0] {
                let turned = |share: f64| only(sign * share * axes.max_speed_deg_s[axis] * 0.01);
                let free = look(0.01, None);
                assert!(check_axis_speeds(&arm, &free, &turned(0.999), &[0.0; 6]).is_ok());
                let refused = check_axis_speeds(&arm, &free, &turned(1.001), &[0.0; 6]).expect_err("too fast");
                assert!(
                    matches!(refused, Infeasibility::AxisSpeed { axis: found, .. } if found == axis + 1),
                    "{refused:?}"
                );
                // The speed changes from 10 °/s by the acceleration limit times 10 ms.
                let change = axes.max_acceleration_deg_s2[axis] * 0.01;
                let to = |share: f64| only((10.0 + sign * share * change) * 0.01);
                let held = look(0.01, Some(0.01));
                assert!(check_axis_speeds(&arm, &held, &to(0.999), &only(10.0)).is_ok());
                let refused = check_axis_speeds(&arm, &held, &to(1.001), &only(10.0)).expect_err("too quick");
                assert!(
                    matches!(refused, Infeasibility::AxisAcceleration { axis: found, .. } if found == axis + 1)
                );
            }
        }
    }

    /// Expected limits, calculated by hand: ±170, −190…45, −120…156, ±185, ±120, ±350°, each reduced by the margin of
    /// 3°.
    #[test]
    fn an_axis_keeps_the_margin_from_its_limits() {
        let arm = Gates::new().arm;
        let limits =
            [[-170.0, 170.0], [-190.0, 45.0], [-120.0, 156.0], [-185.0, 185.0], [-120.0, 120.0], [-350.0, 350.0]];
        for (axis, [low, high]) in limits.into_iter().enumerate() {
            let at = |angle: f64| -> JointAngles { std::array::from_fn(|n| if n == axis { angle } else { 0.0 }) };
            assert_eq!(
                [first_exceeded_axis(&arm, &at(low + 3.01)), first_exceeded_axis(&arm, &at(high - 3.01))],
                [None, None]
            );
            for angle_deg in [low + 2.99, high - 2.99, f64::NAN] {
                let found = first_exceeded_axis(&arm, &at(angle_deg));
                assert!(
                    matches!(found, Some(Infeasibility::AxisLimit { axis: found, .. }) if found == axis + 1),
                    "{found:?}"
                );
            }
        }
    }

    /// Calculated by hand: in the home position the forearm and the wrist lie in the plane y = 0 at z = 760, the flange
    /// at x = 480, the tip at x = 600. A box beside the wrist must be 80 mm away, a box beside the tip only 40 mm.
    #[test]
    fn the_arm_and_the_tool_keep_their_distances_from_a_box() {
        let distance = |x_mm: f64, y_mm: f64| {
            let text =
                format!("[[keep_out]]\nname = 'post'\nmin_mm = [{x_mm}, {y_mm}, 700]\nmax_mm = [900, 900, 800]\n");
            let cell = Cell::check("cell.toml", &text).unwrap_or_else(|e| panic!("{e}"));
            check_keep_out(&Kinematics::new(cell.arm()), look(0.0, None).tip, &[0.0, -90.0, 90.0, 0.0, 0.0, 0.0])
        };
        assert_eq!([distance(470.0, 80.1), distance(575.0, 40.1)], [Ok(()), Ok(())]);
        for (x_mm, y_mm, near) in [(470.0, 79.9, "wrist"), (575.0, 39.9, "tool")] {
            let found = distance(x_mm, y_mm).expect_err("too near");
            let Infeasibility::KeepOut { part, distance_mm, .. } = found else { panic!("{found:?}") };
            assert!(part == near && (distance_mm - y_mm).abs() < 1e-9, "{part} {distance_mm}");
        }
    }
}
