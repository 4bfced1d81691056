//! The motions that can be planned for the arm, and the geometry and speed of the path that they form.
//!
//! The tool's path consists of legs: straight lines between poses, and the parabolas by which C_DIS replaces corners. A
//! blend leaves the incoming line at the distance d before the corner and joins the outgoing line at the distance d
//! after the corner; d is at most half of either line. Position: B(t) = (1−t)² start + 2t(1−t) corner + t² end;
//! orientation: the same construction on arcs. The length of a path has one measure: millimetres, or, if the rotation
//! at the maximum rotation speed takes longer than the translation, the rotation converted to millimetres.
//!
//! The speed profile along a path is a trapezoid: maximum acceleration, constant maximum speed, deceleration to a
//! standstill at the end of the path. The maximum speed at the distance d before a stop, with the current speed v, is
//! √(v²/2 + a d); braking from v needs the distance v²/2a. The unit of length is the caller's: mm on a line, otherwise
//! degrees of the leading axis.

use nalgebra::{Isometry3, Translation3};
use panelprep_base::geometry::{Base, Flange, Joints, Rigid, Tool};

/// Maximum difference between two lengths that are treated as equal, mm.
pub(super) const ROUNDING_MM: f64 = 1e-9;

const ARC_STEP_COUNT: usize = 32;
/// Minimum length of a blend, mm; a shorter blend is an exact stop.
const MIN_BLEND_MM: f64 = 1e-6;

/// The command to which a motion belongs; a retract belongs to no command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MoveKey {
    pub(super) epoch: i32,
    pub(super) id: i32,
}

/// A linear motion of the TCP.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lin {
    pub(super) key: Option<MoveKey>,
    pub(super) target: Pose,
    pub(super) flange_from_tool: Rigid<Flange, Tool>,
    /// Blend distance, mm; 0 for an exact stop.
    pub(super) blend_mm: f64,
    pub(super) contact: bool,
    /// The output that is switched at the end of the motion, and its value.
    pub(super) switched_output: Option<(u16, bool)>,
    /// Number of points of this path that follow.
    pub(super) remaining_points: i32,
    pub(super) speed_mm_s: f64,
    pub(super) acceleration_mm_s2: f64,
}

/// A PTP motion of the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ptp {
    pub(super) key: Option<MoveKey>,
    pub(super) target: Joints,
    /// Speed as a fraction of each axis's maximum speed, 0 to 1.
    pub(super) speed_share: f64,
    /// Acceleration as a fraction of each axis's maximum acceleration, 0 to 1.
    pub(super) acceleration_share: f64,
    /// The output that is switched at the end of the motion, and its value.
    pub(super) switched_output: Option<(u16, bool)>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Move {
    Lin(Lin),
    Ptp(Ptp),
}

impl Move {
    pub(super) fn key(&self) -> Option<MoveKey> {
        match self {
            Move::Lin(lin) => lin.key,
            Move::Ptp(ptp) => ptp.key,
        }
    }

    pub(super) fn contact(&self) -> bool {
        matches!(self, Move::Lin(lin) if lin.contact)
    }

    pub(super) fn switched_output(&self) -> Option<(u16, bool)> {
        match self {
            Move::Lin(lin) => lin.switched_output,
            Move::Ptp(ptp) => ptp.switched_output,
        }
    }
}

/// The speed limits of the operating mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Override {
    pub(super) tool_mm_s: f64,
    pub(super) axis_share: f64,
    /// $OV_PRO as a fraction of every programmed speed, 0 to 1.
    pub(super) share: f64,
}

/// The pose of the tool in the base frame.
pub(super) type Pose = Rigid<Base, Tool>;

/// Interpolates between two poses: the position on a line, the orientation by a rotation about one axis.
fn interpolate_pose(from: &Pose, to: &Pose, share: f64) -> Pose {
    let (from, to) = (from.isometry(), to.isometry());
    let origin = from.translation.vector.lerp(&to.translation.vector, share);
    let turn = (from.rotation.inverse() * to.rotation).powf(share);
    Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::from(origin), from.rotation * turn))
}

/// Returns the distance between two poses, mm.
pub(super) fn distance_mm(from: &Pose, to: &Pose) -> f64 {
    from.origin().distance_mm(to.origin())
}

/// Returns the length of the path between two poses, mm, if a rotation of one degree is as long as `mm_per_deg`.
pub(super) fn measure_mm(from: &Pose, to: &Pose, mm_per_deg: f64) -> f64 {
    let turn_deg = from.isometry().rotation.angle_to(&to.isometry().rotation).to_degrees();
    distance_mm(from, to).max(turn_deg * mm_per_deg)
}

/// A corner between two lines, and the maximum blend.
#[derive(Debug, Clone, Copy)]
pub(super) struct CornerBlend {
    /// A pose on the incoming line.
    pub(super) incoming_pose: Pose,
    /// Length of the whole incoming line between its two corners, mm.
    pub(super) incoming_length_mm: f64,
    /// The corner.
    pub(super) vertex: Pose,
    /// The end of the outgoing line.
    pub(super) outgoing_end: Pose,
    /// The requested blend distance, mm.
    pub(super) blend_mm: f64,
    /// Length that is equivalent to a rotation of one degree, mm.
    pub(super) mm_per_deg: f64,
}

/// A blended corner.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Corner {
    pub(super) start: Pose,
    vertex: Pose,
    pub(super) end: Pose,
    /// Its measure, mm.
    pub(super) length_mm: f64,
    /// Length of the whole outgoing line, mm.
    pub(super) outgoing_length_mm: f64,
    /// Arc lengths from the start of the blend, at equal steps of t.
    arc_mm: [f64; ARC_STEP_COUNT + 1],
}

impl Corner {
    /// Creates the blend of a corner; `None` if the arm must stop at the corner.
    pub(super) fn new(bend: &CornerBlend) -> Option<Self> {
        let whole_out_mm = distance_mm(&bend.vertex, &bend.outgoing_end);
        let blend_mm = bend.blend_mm.min(bend.incoming_length_mm / 2.0).min(whole_out_mm / 2.0);
        let in_mm = distance_mm(&bend.incoming_pose, &bend.vertex);
        if blend_mm < MIN_BLEND_MM || in_mm < blend_mm - 1e-9 {
            return None;
        }
        let start = interpolate_pose(&bend.incoming_pose, &bend.vertex, (1.0 - blend_mm / in_mm).max(0.0));
        let end = interpolate_pose(&bend.vertex, &bend.outgoing_end, blend_mm / whole_out_mm);
        let vertex = bend.vertex;
        let mut corner = Corner {
            start,
            vertex,
            end,
            length_mm: 0.0,
            outgoing_length_mm: whole_out_mm,
            arc_mm: [0.0; ARC_STEP_COUNT + 1],
        };
        let mut before = start.origin().mm.coords;
        for part in 1..=ARC_STEP_COUNT {
            let here = corner.origin_mm(part as f64 / ARC_STEP_COUNT as f64);
            corner.arc_mm[part] = corner.arc_mm[part - 1] + (here - before).norm();
            before = here;
        }
        let turned_mm = measure_mm(&start, &vertex, bend.mm_per_deg) + measure_mm(&vertex, &end, bend.mm_per_deg);
        let chords_mm = 2.0 * blend_mm;
        // Position and rotation progress together. If the rotation does not limit the speed on the lines, it does not
        // limit it in the corner either.
        corner.length_mm = corner.arc_mm[ARC_STEP_COUNT] * (turned_mm / chords_mm).max(1.0);
        Some(corner)
    }

    fn origin_mm(&self, t: f64) -> nalgebra::Vector3<f64> {
        let (start, vertex, end) = (self.start.isometry(), self.vertex.isometry(), self.end.isometry());
        let (start, vertex, end) = (&start.translation, &vertex.translation, &end.translation);
        let shares = ((1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t), t * t);
        let of = |start: f64, vertex: f64, end: f64| start * shares.0 + vertex * shares.1 + end * shares.2;
        nalgebra::Vector3::new(
            of(start.x, vertex.x, end.x),
            of(start.y, vertex.y, end.y),
            of(start.z, vertex.z, end.z),
        )
    }

    /// Returns the pose at this length of the path after the start of the blend.
    pub(super) fn pose_at(&self, gone_mm: f64) -> Pose {
        let arc_mm = self.arc_mm[ARC_STEP_COUNT] * (gone_mm / self.length_mm).clamp(0.0, 1.0);
        let after = self.arc_mm.iter().position(|&end_mm| end_mm >= arc_mm).unwrap_or(ARC_STEP_COUNT).max(1);
        let [low, high] = [self.arc_mm[after - 1], self.arc_mm[after]];
        // If the direction is reversed, the two halves of the parabola coincide, and a chord may have zero length.
        let inside = if high > low { (arc_mm - low) / (high - low) } else { 1.0 };
        let t = ((after - 1) as f64 + inside) / ARC_STEP_COUNT as f64;
        let turned = interpolate_pose(
            &interpolate_pose(&self.start, &self.vertex, t),
            &interpolate_pose(&self.vertex, &self.end, t),
            t,
        );
        let origin = Translation3::from(self.origin_mm(t));
        Rigid::from_isometry_unchecked(Isometry3::from_parts(origin, turned.isometry().rotation))
    }
}

#[derive(Debug, Clone)]
pub(super) enum MoverLeg {
    /// A straight line; `stops` is true if the arm must stop at its end.
    Line {
        from: Pose,
        to: Pose,
        length_mm: f64,
        lin: Lin,
        stops: bool,
    },
    Corner {
        corner: Box<Corner>,
        lin: Lin,
    },
}

impl MoverLeg {
    pub(super) fn length_mm(&self) -> f64 {
        match self {
            MoverLeg::Line { length_mm, .. } => *length_mm,
            MoverLeg::Corner { corner, .. } => corner.length_mm,
        }
    }

    pub(super) fn linear_motion(&self) -> &Lin {
        match self {
            MoverLeg::Line { lin, .. } | MoverLeg::Corner { lin, .. } => lin,
        }
    }

    pub(super) fn pose_at(&self, gone_mm: f64) -> Pose {
        match self {
            MoverLeg::Line { to, length_mm, .. } if gone_mm >= *length_mm => *to,
            MoverLeg::Line { from, to, length_mm, .. } => interpolate_pose(from, to, gone_mm / length_mm),
            MoverLeg::Corner { corner, .. } => corner.pose_at(gone_mm),
        }
    }
}

/// Returns the pose at this length of the path after the start of the first leg.
pub(super) fn pose_ahead(legs: &[MoverLeg], mut gone_mm: f64) -> Option<Pose> {
    for leg in legs {
        if gone_mm <= leg.length_mm() {
            return Some(leg.pose_at(gone_mm));
        }
        gone_mm -= leg.length_mm();
    }
    legs.last().map(|leg| leg.pose_at(leg.length_mm()))
}

/// The limits of the speed for one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limits {
    /// Remaining length to the next required stop.
    pub(super) to_stop: f64,
    /// Maximum speed, in units of length per second.
    pub(super) speed: f64,
    /// Maximum acceleration and deceleration, in units of length per second².
    pub(super) acceleration: f64,
}

/// Returns the distance covered in a step of `step_s` that begins at `speed`, and the speed at the end of the step.
pub(super) fn ramp_step(speed: f64, limits: Limits, step_s: f64) -> (f64, f64) {
    let Limits { to_stop, speed: highest, acceleration } = limits;
    let (mut gone, mut now, mut left_s) = (0.0, speed, step_s);
    let change = |gone: &mut f64, now: &mut f64, left_s: &mut f64, target: f64| {
        let rate = acceleration.copysign(target - *now);
        let spent_s = ((target - *now) / rate).min(*left_s);
        *gone += *now * spent_s + 0.5 * rate * spent_s * spent_s;
        *now += rate * spent_s;
        *left_s -= spent_s;
    };
    if now > highest {
        change(&mut gone, &mut now, &mut left_s, highest);
    }
    let peak = (0.5 * now * now + acceleration * (to_stop - gone).max(0.0)).sqrt().min(highest);
    if peak > now {
        change(&mut gone, &mut now, &mut left_s, peak);
    }
    let level = to_stop - gone - 0.5 * now * now / acceleration;
    if now > 0.0 && level > 0.0 {
        let spent_s = (level / now).min(left_s);
        gone += now * spent_s;
        left_s -= spent_s;
    }
    if left_s > 0.0 {
        change(&mut gone, &mut now, &mut left_s, 0.0);
    }
    // A remaining distance below a nanometre is treated as zero, and so is a speed below a nanometre per second.
    // Otherwise rounding would leave remainders such as 10⁻³²⁰ and the motion would never end.
    if to_stop - gone < 1e-6 { (to_stop, 0.0) } else { (gone, if now < 1e-6 { 0.0 } else { now }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::KukaPose;
    use proptest::prelude::*;

    fn pose(x_mm: f64, y_mm: f64, a_deg: f64) -> Pose {
        KukaPose { x_mm, y_mm, a_deg, ..KukaPose::default() }.to_rigid()
    }

    fn right_angle(blend_mm: f64) -> CornerBlend {
        CornerBlend {
            incoming_pose: pose(0.0, 0.0, 0.0),
            incoming_length_mm: 10.0,
            vertex: pose(10.0, 0.0, 0.0),
            outgoing_end: pose(10.0, 6.0, 30.0),
            blend_mm,
            mm_per_deg: 0.0,
        }
    }

    /// Expected values, calculated by hand: the blend begins 2 mm before the corner and ends 2 mm after it. Its middle
    /// is ¼ (8,0) + ½ (10,0) + ¼ (10,2) = (9.5, 0.5). The arc of a parabola over a right angle is 2 d · 0.811613 =
    /// 3.2465 mm.
    #[test]
    fn a_right_angle_is_cut_by_the_blend_distance() {
        let corner = Corner::new(&right_angle(2.0)).expect("blended");
        assert!(distance_mm(&corner.start, &pose(8.0, 0.0, 0.0)) < 1e-12);
        assert!(distance_mm(&corner.end, &pose(10.0, 2.0, 0.0)) < 1e-12);
        assert!(distance_mm(&corner.pose_at(corner.length_mm / 2.0), &pose(9.5, 0.5, 0.0)) < 1e-9);
        assert!((corner.length_mm - 3.2465).abs() < 2e-3, "{}", corner.length_mm);
    }

    /// The maximum blend is half of the shorter line: 3 mm.
    #[test]
    fn a_blend_takes_at_most_half_of_either_line() {
        let corner = Corner::new(&right_angle(50.0)).expect("blended");
        assert!(distance_mm(&corner.start, &pose(7.0, 0.0, 0.0)) < 1e-12);
        assert!(Corner::new(&right_angle(0.0)).is_none());
        let whole = CornerBlend { incoming_length_mm: 2.0, ..right_angle(50.0) };
        assert!(distance_mm(&Corner::new(&whole).expect("blended").start, &pose(9.0, 0.0, 0.0)) < 1e-12);
    }

    /// Equal steps of the path's length are equal steps of the tool, and the orientation is continuous.
    #[test]
    fn the_speed_is_constant_in_the_corner() {
        let corner = Corner::new(&right_angle(2.0)).expect("blended");
        let poses: Vec<Pose> =
            (0..=20).map(|part| corner.pose_at(corner.length_mm * f64::from(part) / 20.0)).collect();
        let steps: Vec<f64> = poses.windows(2).map(|pair| distance_mm(&pair[0], &pair[1])).collect();
        let mean = steps.iter().sum::<f64>() / 20.0;
        assert!(steps.iter().all(|step| (step / mean - 1.0).abs() < 0.02), "{steps:?}");
        let turns = poses.windows(2).map(|pair| measure_mm(&pair[0], &pair[1], 1000.0) / 1000.0);
        assert!(turns.fold(0.0, f64::max) < 2.0);
        // Expected value, calculated by hand: after 2 of 6 mm of the outgoing line, a third of its rotation of 30°.
        assert!((KukaPose::from_rigid(&corner.end).a_deg - 10.0).abs() < 1e-9);
    }

    /// If a rotation of one degree is as long as 1 mm, a rotation of 30° on a line of 6 mm has the length 30 mm.
    #[test]
    fn a_rotation_determines_the_length_if_it_needs_more_time() {
        let (from, to) = (pose(10.0, 0.0, 0.0), pose(10.0, 6.0, 30.0));
        assert!((measure_mm(&from, &to, 1.0) - 30.0).abs() < 1e-9);
        assert!((measure_mm(&from, &to, 0.1) - 6.0).abs() < 1e-9);
    }

    fn run(mut limits: Limits) -> (f64, f64) {
        let (mut time_s, mut speed, mut fastest) = (0.0, 0.0, 0.0_f64);
        while limits.to_stop > 0.0 {
            let (gone, next) = ramp_step(speed, limits, 0.012);
            // At the end, the last nanometre and the small remaining speed are skipped.
            assert!((next - speed).abs() <= limits.acceleration * 0.012 + 0.2, "{speed} then {next}");
            limits.to_stop -= gone;
            speed = next;
            time_s += 0.012;
            fastest = fastest.max(speed);
            assert!(time_s < 100.0, "never ends");
        }
        (time_s, fastest)
    }

    /// Expected value, calculated by hand: 250 mm at 100 mm/s and 1000 mm/s² take 250/100 + 100/1000 = 2.6 s; 217 ticks
    /// are 2.604 s.
    #[test]
    fn a_long_path_needs_length_over_speed_plus_one_ramp() {
        let (time_s, fastest) = run(Limits { to_stop: 250.0, speed: 100.0, acceleration: 1000.0 });
        assert!((time_s - 2.604).abs() < 1e-9 && (fastest - 100.0).abs() < 1e-9, "{time_s} {fastest}");
    }

    /// Expected values, calculated by hand: on 4 mm at 1000 mm/s² the speed reaches only √(1000·4) = 63.2 mm/s instead
    /// of 100 mm/s. The motion takes 2·0.0632 = 0.126 s.
    #[test]
    fn a_short_path_has_a_triangular_speed_profile() {
        let (time_s, fastest) = run(Limits { to_stop: 4.0, speed: 100.0, acceleration: 1000.0 });
        assert!((time_s - 0.132).abs() < 1e-9 && fastest < 63.3, "{time_s} {fastest}");
    }

    /// Expected value, calculated by hand: braking from 100 mm/s to 40 mm/s at 1000 mm/s² takes 60 ms, five ticks.
    #[test]
    fn a_speed_above_the_limit_is_reduced() {
        let mut speed = 100.0;
        for _ in 0..5 {
            speed = ramp_step(speed, Limits { to_stop: 500.0, speed: 40.0, acceleration: 1000.0 }, 0.012).1;
        }
        assert!((speed - 40.0).abs() < 1e-9, "{speed}");
    }

    proptest! {
        /// Braking ends at a speed of exactly 0, at the latest one step after the calculated braking time.
        #[test]
        fn braking_ends_at_speed_zero(mut speed in 0.1..2000.0f64, acceleration in 50.0..9000.0f64) {
            let steps = (speed / acceleration / 0.012).ceil() as usize + 1;
            for _ in 0..steps {
                speed = ramp_step(speed, Limits { to_stop: 1e4, speed: 0.0, acceleration }, 0.012).1;
            }
            prop_assert_eq!(speed, 0.0);
        }

        #[test]
        fn a_motion_ends_at_the_stop_in_time(
            to_stop in 1e-3..500.0f64, speed in 10.0..2000.0f64, acceleration in 100.0..9000.0f64,
        ) {
            let (time_s, _) = run(Limits { to_stop, speed, acceleration });
            let reaches = to_stop > speed * speed / acceleration;
            let triangle_s = 2.0 * (to_stop / acceleration).sqrt();
            let needed_s = if reaches { to_stop / speed + speed / acceleration } else { triangle_s };
            prop_assert!(time_s > needed_s - 2e-4 && time_s < needed_s + 0.0121, "{time_s} {needed_s}");
        }
    }
}
