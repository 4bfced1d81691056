//! Tests of the arm's motion: times calculated by hand, blending, underruns, and reproducible results.

use super::*;

/// Expected times, calculated by hand: 250 mm at 100 mm/s and 1000 mm/s² take 2.5 + 0.1 = 2.6 s, 217 ticks. The tenth
/// point, after 50 mm, is passed after 0.05 + 0.5 = 0.55 s, 46 ticks.
#[test]
fn fifty_points_take_the_time_computed_by_hand() {
    let mut rig = Rig::ready(Clock::LockStep);
    let from_ms = rig.controller.time_ms();
    rig.line(50, 50, false);
    rig.settle();
    let passed_ms: Vec<u64> = rig.controller.executed_motions().iter().map(|done| done.time_ms - from_ms).collect();
    assert_eq!((passed_ms.len(), passed_ms[9], passed_ms[49]), (50, 46 * 12, 217 * 12));
    assert_eq!(rig.ids(), (4..=53).collect::<Vec<i32>>());
    assert_eq!((rig.state("Done"), rig.state("Under"), rig.flag(3), rig.flag(7)), (53, 0, false, false));
    // The base is rotated by 180° about both Z and X, so its X axis points opposite to the robot's X axis.
    let expected = Point::at(BASE_MM[0] - 250.0, BASE_MM[1], BASE_MM[2]);
    assert!(rig.tool_tip().distance_mm(expected) < 1e-6, "{:?}", rig.tool_tip());
    assert!((rig.state_number("Tcp X") - 250.0).abs() < 1e-4);
}

/// Expected time, calculated by hand: 36° of axis 1 at half of 360°/s and half of 1800°/s² take 0.2 + 0.2 = 0.4 s, 34
/// ticks.
#[test]
fn a_move_of_the_axes_takes_the_time_computed_by_hand() {
    let mut rig = Rig::new(Clock::LockStep);
    rig.command(5, [50, 50], [0.1, 1.0], [0.0; 6]);
    let mut target = START_DEG;
    target[0] = 36.0;
    target[5] = -10.0;
    rig.command(1, [0, 0], [50.0, 0.0], target);
    rig.beats(2);
    // All axes move synchronously: after half of the time, each has covered half of its angle.
    rig.settle();
    let done = rig.controller.executed_motions()[0];
    assert_eq!((done.time_ms, done.id, done.contact), (34 * 12, 2, false));
    assert_eq!(rig.controller.joints(), to_joints(target));
    assert_eq!(rig.state("Done"), 2);
}

fn zigzag(rig: &mut Rig, blend_mm: f64, contact: bool) {
    rig.command(2, [20, i32::from(contact)], [0.0; 2], [0.0; 6]);
    for point in 1..=20 {
        // A zigzag path: each step of 5 mm is at an angle of 15° to X.
        let (along, aside) = (5.0_f64 * 15_f64.to_radians().cos(), 5.0 * 15_f64.to_radians().sin());
        let p = [along * f64::from(point), aside * f64::from(point % 2), 0.0, f64::from(point), 0.0, 0.0];
        rig.command(2, [20 - point, i32::from(contact)], [blend_mm, 0.0], p);
    }
    rig.command(2, [0, 0], [0.0; 2], [100.0, 0.0, -20.0, 20.0, 0.0, 0.0]);
    rig.settle();
}

fn steps_mm(rig: &Rig) -> Vec<f64> {
    let tips: Vec<Point<Base>> =
        rig.controller.trace().iter().map(|sample| sample.base_from_tool.origin()).collect();
    tips.windows(2).map(|pair| pair[0].distance_mm(pair[1])).collect()
}

/// At 100 mm/s the tool moves 1.2 mm per tick, in the corners as well as between them.
#[test]
fn blended_corners_keep_the_speed() {
    let mut rig = Rig::ready(Clock::LockStep);
    zigzag(&mut rig, 2.0, true);
    assert_eq!((rig.causes(), rig.controller.underrun_count()), (vec![], 0));
    let steps = steps_mm(&rig);
    let run: Vec<f64> = steps.iter().copied().skip(12).take(60).collect();
    assert!(run.iter().all(|step| (1.15..1.2001).contains(step)), "{run:?}");
    // With a blend distance of 0 the arm stops at each of the 20 corners.
    let mut rig = Rig::ready(Clock::LockStep);
    zigzag(&mut rig, 0.0, true);
    let steps = steps_mm(&rig);
    let stops = steps.windows(3).filter(|steps| steps[1] < steps[0] && steps[1] <= steps[2]).count();
    assert!((18..=22).contains(&stops), "{stops}");
    assert_eq!((rig.causes(), rig.controller.underrun_count()), (vec![], 0), "an exact stop that was asked for");
}

/// A path that approaches, sands and leaves the panel: the samples cover the whole contact, and the sanding samples are
/// between contact points.
#[test]
fn the_trace_covers_the_contact() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0; 2], [0.0; 6]);
    rig.command(2, [3, 0], [0.0; 2], [10.0, 0.0, -20.0, 0.0, 0.0, 0.0]);
    rig.command(2, [2, 1], [2.0, 0.0], [20.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.command(2, [1, 1], [2.0, 0.0], [60.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.command(2, [0, 0], [2.0, 0.0], [70.0, 0.0, -20.0, 0.0, 0.0, 0.0]);
    rig.settle();
    assert_eq!(rig.causes(), []);
    let trace = rig.controller.trace();
    let off_mm = |sample: &ContactSample| sample.base_from_tool.origin().mm.z - BASE_MM[2];
    assert!(trace.iter().all(|sample| sample.tool_on));
    assert!(trace.iter().filter(|sample| sample.sanding).all(|sample| off_mm(sample) < 1.0));
    // Expected number, calculated by hand: 40 mm at 1.2 mm per tick give 33 samples. The tolerance covers half of the
    // blended corner at each end.
    let sanding = trace.iter().filter(|sample| sample.sanding).count();
    assert!((31..=35).contains(&sanding), "{sanding}");
    // The path begins and ends 20 mm above the surface, so the trace begins and ends without contact.
    assert!(off_mm(&trace[0]) > 15.0 && off_mm(trace.last().expect("some")) > 15.0);
    assert!(rig.controller.executed_motions().iter().map(|done| done.contact).eq([false, true, true, false]));
}

/// Only ten of twenty points are sent: the arm stops exactly at the tenth point, once, and continues when the other
/// points arrive.
#[test]
fn a_missing_point_in_the_air_gives_an_exact_stop_and_is_counted() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.line(20, 10, false);
    rig.settle();
    assert_eq!((rig.state("Under"), rig.flag(7), rig.causes()), (1, false, vec![]));
    assert!(rig.tool_tip().distance_mm(Point::at(BASE_MM[0] - 50.0, 0.0, BASE_MM[2])) < 1e-6);
    for point in 11..=20 {
        rig.command(2, [20 - point, 0], [2.0, 0.0], [5.0 * f64::from(point), 0.0, 0.0, 0.0, 0.0, 0.0]);
    }
    rig.settle();
    assert_eq!((rig.state("Under"), rig.ids().len()), (1, 20));
    assert!(rig.tool_tip().distance_mm(Point::at(BASE_MM[0] - 100.0, 0.0, BASE_MM[2])) < 1e-6);
}

/// Four motions are planned, and the braking distance must not be longer than these motions. With points 1 mm apart and
/// 1000 mm/s² the maximum speed is √(2 · 1000 · 4) = 89 mm/s, although 200 mm/s are commanded.
#[test]
fn dense_points_slow_the_arm_down() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.command(5, [100, 100], [0.2, 1.0], [0.0; 6]);
    for point in 1..=90 {
        rig.command(2, [90 - point, 0], [0.5, 0.0], [f64::from(point), 0.0, 0.0, 0.0, 0.0, 0.0]);
    }
    rig.settle();
    let times: Vec<u64> = rig.controller.executed_motions().iter().map(|done| done.time_ms).collect();
    let speed_mm_s = 40.0 / ((times[60] - times[20]) as f64 / 1000.0);
    assert!((60.0..90.0).contains(&speed_mm_s), "{speed_mm_s}");
    assert_eq!(rig.state("Under"), 0);
}

/// A fast motion is followed by a slower one: 200 mm/s are commanded for the first half and 50 mm/s for the second. The
/// speed is already reduced when the second half begins.
#[test]
fn the_speed_is_reduced_before_a_slower_move_begins() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.command(5, [100, 100], [0.2, 1.0], [0.0; 6]);
    rig.command(2, [2, 1], [0.0; 2], [0.0; 6]);
    rig.command(2, [1, 1], [1.0, 0.0], [100.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.command(5, [100, 100], [0.05, 1.0], [0.0; 6]);
    rig.command(2, [0, 1], [0.0; 2], [150.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.command(2, [0, 0], [0.0; 2], [150.0, 0.0, -10.0, 0.0, 0.0, 0.0]);
    rig.settle();
    let tip_mm = |sample: &ContactSample| BASE_MM[0] - sample.base_from_tool.origin().mm.x;
    let trace = rig.controller.trace();
    let fastest = |from_mm: f64, to_mm: f64| {
        let inside = trace.windows(2).filter(|pair| tip_mm(&pair[0]) >= from_mm && tip_mm(&pair[1]) <= to_mm);
        inside.map(|pair| (tip_mm(&pair[1]) - tip_mm(&pair[0])) / 0.012).fold(0.0, f64::max)
    };
    assert!((fastest(20.0, 80.0) - 200.0).abs() < 1.0, "{}", fastest(20.0, 80.0));
    assert!((fastest(101.0, 150.0) - 50.0).abs() < 1.0, "{}", fastest(101.0, 150.0));
}

/// A rotation without translation takes time: 90° at 200°/s take 0.45 s plus acceleration and braking.
#[test]
fn a_rotation_without_translation_takes_time() {
    let mut rig = Rig::ready(Clock::LockStep);
    let from_ms = rig.controller.time_ms();
    rig.command(2, [0, 0], [0.0; 2], [0.0, 0.0, 0.0, 90.0, 0.0, 0.0]);
    rig.settle();
    // Expected time, calculated by hand: one degree is as long as 100/200 mm, so 90° are as long as 45 mm. At 100 mm/s
    // and 1000 mm/s² they take 0.55 s, 46 ticks.
    assert_eq!(rig.controller.executed_motions()[0].time_ms - from_ms, 46 * 12);
    assert!((rig.controller.joints().a6_deg.abs() - 90.0).abs() < 1e-6, "{:?}", rig.controller.joints());
}

/// T1 limits the tool's speed to 250 mm/s. The arm moves only while the Start key is held, and waits when it is
/// released.
#[test]
fn t1_is_slow_and_waits_for_the_key() {
    let mut rig = Rig::new(Clock::LockStep);
    rig.controller.select_mode(Mode::T1);
    rig.controller.set_start_key(true);
    rig.open();
    rig.prepare();
    rig.command(5, [100, 100], [2.0, 5.0], [0.0; 6]);
    let from_ms = rig.controller.time_ms();
    rig.command(2, [0, 0], [0.0; 2], [100.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.beats(2);
    rig.controller.set_start_key(false);
    rig.beats(3);
    let waits = rig.tool_tip();
    rig.beat();
    assert!(rig.tool_tip().distance_mm(waits) < 1e-9 && rig.ids().is_empty() && !rig.flag(4));
    rig.controller.set_start_key(true);
    rig.settle();
    let took_ms = rig.controller.executed_motions()[0].time_ms - from_ms;
    // Expected time, calculated by hand: 100/250 + 250/5000 = 0.45 s plus the four heartbeats of waiting, with a
    // tolerance for acceleration and braking.
    assert!((800..=960).contains(&took_ms), "{took_ms}");
    assert_eq!(rig.state("Mode"), 1);
}

/// An output on the path is switched at the end of the preceding point, without a stop of the arm. A second output at
/// the same point waits until the arm has stopped there.
#[test]
fn an_output_on_the_path_does_not_stop_the_arm() {
    let run = |synchronous: &[f64]| {
        let mut rig = Rig::ready(Clock::LockStep);
        rig.line(20, 10, false);
        for (&r1, output) in synchronous.iter().zip(3..) {
            rig.command(6, [output, 1], [r1, 0.0], [0.0; 6]);
        }
        for point in 11..=20 {
            rig.command(2, [20 - point, 0], [2.0, 0.0], [5.0 * f64::from(point), 0.0, 0.0, 0.0, 0.0, 0.0]);
        }
        rig.settle();
        assert_eq!((rig.ids().len(), rig.state("Under"), rig.ack("Done")), (20, 0, rig.id));
        let times: Vec<u64> = rig.controller.executed_motions().iter().map(|step| step.time_ms).collect();
        (times, rig.wires.changes())
    };
    let (blended, changes) = run(&[1.0]);
    assert_eq!(changes, [(3, true, blended[9])]);
    // Expected difference, calculated by hand: to brake and accelerate again at 100 mm/s and 1000 mm/s² takes 0.1 s
    // longer.
    for standing in [&[0.0][..], &[1.0, 1.0]] {
        let (times, _) = run(standing);
        assert!((84..=132).contains(&(times[19] - blended[19])), "{} {}", times[19], blended[19]);
    }
}

/// Returns the flange pose at these axis angles as the six numbers of a motion, in the robot's own base and without a
/// tool.
fn flange_numbers(angles_deg: [f64; 6]) -> [f64; 6] {
    let pose =
        panelprep_base::geometry::KukaPose::from_rigid(&Arm::kr6_r700_2().base_from_flange(&to_joints(angles_deg)));
    [pose.x_mm, pose.y_mm, pose.z_mm, pose.a_deg, pose.b_deg, pose.c_deg]
}

/// Creates a controller with the arm at these axis angles, in the robot's own base and without a tool.
fn standing_at(angles_deg: [f64; 6]) -> Rig {
    let mut rig = Rig::new(Clock::LockStep);
    rig.command(3, [0, 0], [0.0; 2], [0.0; 6]);
    rig.command(4, [0, 0], [0.0; 2], [0.0; 6]);
    rig.command(1, [0, 0], [100.0, 0.0], angles_deg);
    rig.settle();
    rig
}

/// The wrist moves from 20° on one side to the other side and passes the singularity at a distance of about 1.5°. Axis
/// 4 must rotate by almost 180°, so the tool slows down. Expected values, calculated by hand: the rotation alone would
/// take about 0.3 s; axis 4 needs 150° / 450°/s = 0.33 s more.
#[test]
fn near_the_wrist_singularity_the_tool_slows_down() {
    let mut rig = standing_at([0.0, -90.0, 90.0, 90.0, 20.0, -90.0]);
    rig.command(2, [0, 0], [0.0; 2], flange_numbers([0.0, -90.0, 90.0, -81.5, 20.2, 81.5]));
    let (from_ms, mut fastest_deg_s) = (rig.controller.time_ms(), 0.0_f64);
    while rig.ids().len() < 2 {
        let before_deg = rig.controller.joints().a4_deg;
        rig.ask(9, 0);
        rig.controller.advance_ms(12);
        fastest_deg_s = fastest_deg_s.max((rig.controller.joints().a4_deg - before_deg).abs() / 0.012);
        assert!(rig.controller.program_stops().is_empty(), "{:?}", rig.controller.program_stops());
    }
    let took_ms = rig.controller.time_ms() - from_ms;
    assert!((225.0..450.001).contains(&fastest_deg_s), "{fastest_deg_s}");
    assert!((500..1500).contains(&took_ms), "{took_ms}");
    assert!((rig.controller.joints().a4_deg + 81.5).abs() < 0.01, "{:?}", rig.controller.joints());
}

/// A linear motion behind the robot from A1 = 160° to A1 = −160° would have to pass 180°: both ends can be reached, but
/// the points between them cannot.
#[test]
fn a_line_that_needs_another_configuration_stops() {
    let behind = |a1_deg: f64| [a1_deg, -90.0, 90.0, 0.0, 60.0, 0.0];
    let mut rig = standing_at(behind(160.0));
    let id = rig.command(2, [0, 0], [0.0; 2], flange_numbers(behind(-160.0)));
    rig.settle();
    assert_eq!((rig.ack("Err"), rig.ack("ErrId"), rig.ids().len()), (Refusal::Unreachable as i32, id, 1));
    assert!(rig.controller.program_stops()[0].detail.contains("axis"), "{:?}", rig.controller.program_stops());
    assert!(rig.controller.joints().a1_deg > 165.0, "{:?}", rig.controller.joints());
}

/// The same commands result in the same state of the controller, bit for bit, regardless of how the bytes were divided
/// and when they arrived.
#[test]
fn two_runs_are_equal_to_the_bit() {
    let run = |piece: usize, early: bool| {
        let mut rig = Rig::ready(Clock::LockStep);
        let documents: Vec<String> = (1..=40)
            .map(|point: i32| {
                let p = [4.0 * f64::from(point), f64::from(point % 3), 0.0, f64::from(point), 0.0, 0.0];
                rig.document(2, [40 - point, i32::from(point > 2 && point < 40)], [1.5, 0.0], p)
            })
            .collect();
        let feed = |rig: &mut Rig, documents: &[String]| {
            documents.concat().as_bytes().chunks(piece).for_each(|part| rig.controller.command_bytes(part));
        };
        let first = rig.id - 40;
        if early {
            feed(&mut rig, &documents);
        }
        for (part, documents) in (1..).zip(documents.chunks(10)) {
            rig.ask(10, first + 10 * part);
            if !early {
                feed(&mut rig, documents);
            }
            rig.listen();
        }
        rig.settle();
        (rig.controller.trace().to_vec(), rig.controller.executed_motions().to_vec(), rig.acks, rig.states)
    };
    let first = run(1000, true);
    assert!(first.0.len() > 50 && first.1.len() == 40, "{} {}", first.0.len(), first.1.len());
    assert_eq!(first, run(7, false));
}

impl Rig {
    fn state_number(&self, name: &str) -> f64 {
        let (node, name) = name.split_once(' ').expect("node and name");
        let start = self.states.rfind(&format!("<{node} ")).expect("told");
        let end = start + self.states[start..].find('>').expect("closed");
        last(&self.states[start..end], name).parse().expect("a number")
    }
}
