//! Tests that the parked arm is out of the camera's view and that the arm reaches all its targets, for ten seeds and
//! with the nominal and a displaced panel.

use crate::mock::Arm;
use nalgebra::{Point3, Rotation3, Vector3};
use panelprep_base::geometry::{Base, Camera, Flange, Joints, KukaPose, Panel, Point, Rigid, Tool, Vector};
use panelprep_cell::cell;
use panelprep_sim::{Cell, CellTruth, Scene};

pub(super) const ARM: Arm = Arm::kr6_r700_2();

fn pose(name: &str) -> Joints {
    let text = include_str!("../../../../../config/cell.toml");
    cell::Cell::check("config/cell.toml", text).expect("a shipped file").pose(name).expect("is there")
}

fn park() -> Joints {
    pose("park")
}

fn joints([a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg]: [f64; 6]) -> Joints {
    Joints { a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg }
}

fn angles_deg(joints: &Joints) -> [f64; 6] {
    [joints.a1_deg, joints.a2_deg, joints.a3_deg, joints.a4_deg, joints.a5_deg, joints.a6_deg]
}

pub(super) fn tool() -> Rigid<Flange, Tool> {
    KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid()
}

/// Returns points along the links of the arm from the shoulder to the TCP; their thickness is ignored.
fn skeleton(joints: &Joints) -> Vec<Point<Base>> {
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -joints.a1_deg.to_radians());
    let q2_rad = (joints.a2_deg + 90.0).to_radians();
    let at = |radius_mm: f64, height_mm: f64| Point::new(turn * Point3::new(radius_mm, 0.0, height_mm));
    let base_from_flange = ARM.base_from_flange(joints);
    let flange = |z_mm: f64| base_from_flange * Point::<Flange>::at(0.0, 0.0, z_mm);
    vec![
        at(25.0, 400.0),
        at(25.0 + 335.0 * q2_rad.sin(), 400.0 + 335.0 * q2_rad.cos()),
        flange(-90.0),
        flange(0.0),
        flange(120.0),
    ]
}

/// When the arm is parked, every part of it is outside of the scanner's field of view; the links are assumed to be 130
/// mm thick.
#[test]
fn the_park_pose_is_out_of_view() {
    const HALF_THICK_MM: f64 = 65.0;
    let cell = Cell::new(1, Scene::Good, 8);
    let camera_from_base = cell.truth().base_from_camera.inverse();
    let camera = cell.scanner();
    // The field of view is assumed to be 3 % wider than the picture, because of the lens distortion.
    let tangent = |size: usize, focal_px: f64| size as f64 / 2.0 / focal_px * 1.03;
    let (across, down) = (tangent(camera.width_px, camera.fx_px), tangent(camera.height_px, camera.fy_px));
    let sides = [(1.0, 0.0, across), (-1.0, 0.0, across), (0.0, 1.0, down), (0.0, -1.0, down)];
    let outside_mm = |point: Point<Base>| {
        let seen: Point<Camera> = camera_from_base * point;
        let of_side =
            |(x, y, tangent): (f64, f64, f64)| Vector3::new(x, y, -tangent).normalize().dot(&seen.mm.coords);
        sides.map(of_side).into_iter().fold(-seen.mm.z, f64::max)
    };
    ARM.within_limits(&park()).expect("within limits");
    let bones = skeleton(&park());
    let along = |pair: &[Point<Base>]| {
        let (from, to) = (pair[0], pair[1]);
        (0..=20).map(move |step| from + (to - from) * (f64::from(step) / 20.0)).collect::<Vec<_>>()
    };
    for point in bones.windows(2).flat_map(along) {
        assert!(outside_mm(point) > HALF_THICK_MM, "{:?}: {:.0} mm outside", point.mm, outside_mm(point));
        assert!(point.mm.x < 300.0, "near the panel");
    }
    // The middle of the panel is in the field of view.
    assert!(outside_mm(Point::at(560.0, 0.0, 360.0)) < 0.0);
}

/// Returns the pose of the tool at this height above a point of the true surface; its X axis points along the panel's
/// −Y axis.
pub(super) fn tool_pose_above(truth: &CellTruth, point: Point<Panel>, height_mm: f64) -> Rigid<Panel, Tool> {
    let normal = truth.normal(point);
    let z = -normal.mm;
    let x = (-Vector3::y() + z * z.y).normalize();
    Rigid::from_axes([x, z.cross(&x), z].map(Vector::new), point + normal * height_mm)
}

/// The smallest margins over all tested poses.
#[derive(Debug, Clone, Copy)]
struct Margins {
    /// Minimum distance to an axis limit, degrees.
    limit_deg: f64,
    /// Minimum |A5|, the distance from the wrist singularity, degrees.
    bend_deg: f64,
    /// Maximum step of an axis between neighbouring poses, degrees.
    step_deg: f64,
    /// Minimum distance from the displaced panel during the motion from the park pose to the panel, mm.
    gap_mm: f64,
    /// Maximum step of an axis in one fortieth of the linear part of this motion, degrees.
    line_step_deg: f64,
}

impl Margins {
    fn add(&mut self, joints: &Joints) {
        for (angle, [low, high]) in angles_deg(joints).into_iter().zip(ARM.limits_deg) {
            self.limit_deg = self.limit_deg.min(angle - low).min(high - angle);
        }
        self.bend_deg = self.bend_deg.min(joints.a5_deg.abs());
    }

    /// Moves the axes from the park pose to the ready pose, and then the TCP linearly to the target. Asserts that TCP,
    /// flange and camera stay in front of the panel, and records the largest step of an axis.
    fn way(&mut self, truth: &CellTruth, target: &Rigid<Base, Flange>) {
        let (from, to) = (angles_deg(&park()), angles_deg(&pose("ready")));
        for step in 0..=40 {
            let share = f64::from(step) / 40.0;
            let at = joints(std::array::from_fn(|axis| from[axis] + (to[axis] - from[axis]) * share));
            self.stay_before(truth, &ARM.base_from_flange(&at));
        }
        let mut stands = pose("ready");
        let (from, to) = (ARM.base_from_flange(&stands) * tool(), *target * tool());
        for step in 1..=40 {
            let share = f64::from(step) / 40.0;
            let tip: Rigid<Base, Tool> =
                Rigid::from_isometry_unchecked(from.isometry().lerp_slerp(to.isometry(), share));
            let flange = tip * tool().inverse();
            self.stay_before(truth, &flange);
            let next = ARM.nearest(&flange, &stands).unwrap_or_else(|why| panic!("on the way: {why}"));
            self.line_step_deg = self.line_step_deg.max(largest_step_deg(&stands, &next));
            stands = next;
        }
    }

    fn stay_before(&mut self, truth: &CellTruth, base_from_flange: &Rigid<Base, Flange>) {
        for (x, y, z) in [(0.0, 0.0, 120.0), (0.0, 0.0, 0.0), (80.0, 4.0, 30.0)] {
            let point = *base_from_flange * Point::<Flange>::at(x, y, z);
            let seen = truth.base_from_panel.inverse() * point;
            if point.mm.x > 430.0 && truth.outline_distance_mm(seen) < 40.0 {
                self.gap_mm = self.gap_mm.min(truth.distance_mm(seen));
            }
        }
    }
}

fn largest_step_deg(from: &Joints, to: &Joints) -> f64 {
    let pairs = angles_deg(from).into_iter().zip(angles_deg(to));
    pairs.map(|(from, to)| (from - to).abs()).fold(0.0, f64::max)
}

/// Tests every corner pose and every position that can be sanded, on the panel and 40 mm above it, for the nominal and
/// the displaced panel. All poses are at least 8° away from the limits and away from the wrist singularity, and the
/// configuration never changes between two poses.
#[test]
fn the_arm_reaches_every_pose_of_ten_seeds() {
    let mut margins =
        Margins { limit_deg: 180.0, bend_deg: 180.0, step_deg: 0.0, gap_mm: f64::INFINITY, line_step_deg: 0.0 };
    for seed in 0..10 {
        let cell = Cell::new(seed, Scene::Good, 8);
        let truth = cell.truth();
        let moved: Rigid<Base, Base> = Rigid::from_isometry_unchecked(*truth.base_from_panel.isometry());
        for view in cell.corner_views() {
            let poses = [view.base_from_flange, moved * view.base_from_flange, cell.displaced_corner_pose(&view)];
            for pose in poses {
                let joints =
                    ARM.nearest(&pose, &park()).unwrap_or_else(|why| panic!("{seed} {}: {why}", view.name));
                margins.way(&truth, &pose);
                margins.add(&joints);
            }
        }
        let inside: Vec<Point<Panel>> =
            truth.surface_points().into_iter().filter(|&point| truth.outline_distance_mm(point) < -5.0).collect();
        for place in [Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity()), truth.base_from_panel] {
            let mut near = None;
            for point in &inside {
                let reach = |height_mm: f64, near: &Joints| {
                    let pose = place * tool_pose_above(&truth, *point, height_mm) * tool().inverse();
                    ARM.nearest(&pose, near).unwrap_or_else(|why| panic!("seed {seed}, {point:?}: {why}"))
                };
                let on = reach(0.0, &near.unwrap_or(park()));
                let above = reach(40.0, &on);
                [on, above].iter().for_each(|joints| margins.add(joints));
                margins.step_deg = margins.step_deg.max(largest_step_deg(&above, &on));
                near = Some(on);
            }
            for point in inside.iter().step_by(37) {
                let above = truth.base_from_panel * tool_pose_above(&truth, *point, 40.0) * tool().inverse();
                margins.way(&truth, &above);
            }
            // The arm moves between any two of these positions without a full rotation of the wrist.
            let ends: Vec<[f64; 6]> = inside
                .iter()
                .map(|point| place * tool_pose_above(&truth, *point, 0.0) * tool().inverse())
                .map(|pose| angles_deg(&ARM.nearest(&pose, &near.unwrap_or(park())).expect("reached before")))
                .collect();
            for axis in 0..6 {
                let (low, high) = ends.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), angles| {
                    (low.min(angles[axis]), high.max(angles[axis]))
                });
                assert!(high - low < 120.0, "seed {seed}, axis {}: {low:.0} to {high:.0}", axis + 1);
            }
        }
    }
    assert!(margins.limit_deg > 8.0 && margins.bend_deg > 30.0 && margins.step_deg < 15.0, "{margins:?}");
    assert!(margins.gap_mm > 30.0 && margins.line_step_deg < 15.0, "{margins:?}");
}
