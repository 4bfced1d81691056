//! Whether the simulated arm parks out of view and reaches what it is sent to: ten seeds, both places of the panel.

use crate::cell;
use crate::devices::mock::Arm;
use crate::geometry::{Base, Camera, Flange, Joints, KukaPose, Panel, Point, Rigid, Tool, Vector};
use crate::sim::{Cell, Scene, Truth};
use nalgebra::{Point3, Rotation3, Vector3};

pub(super) const ARM: Arm = Arm::kr6_r700_2();

fn park() -> Joints {
    let text = include_str!("../../../../config/cell.toml");
    cell::Cell::check("config/cell.toml", text).expect("a shipped file").park().expect("is there")
}

fn angles_deg(joints: &Joints) -> [f64; 6] {
    [joints.a1_deg, joints.a2_deg, joints.a3_deg, joints.a4_deg, joints.a5_deg, joints.a6_deg]
}

pub(super) fn tool() -> Rigid<Flange, Tool> {
    KukaPose { z_mm: 160.0, ..KukaPose::default() }.to_rigid()
}

/// The arm's joints from the shoulder to the tool's tip, thin.
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
        flange(160.0),
    ]
}

/// Parked, every part of the arm, taken as 90 mm thick about its bones, is outside of the scanner's pyramid of view.
#[test]
fn the_park_pose_is_out_of_view() {
    const HALF_THICK_MM: f64 = 90.0;
    let cell = Cell::new(1, Scene::Good, 8);
    let camera_from_base = cell.truth().base_from_camera.inverse();
    let camera = cell.scanner();
    // A little wider than the picture, for the lens's distortion.
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
        println!("{:.0?} {:.0}", point.mm, outside_mm(point));
        assert!(outside_mm(point) > HALF_THICK_MM, "{:?}: {:.0} mm outside", point.mm, outside_mm(point));
        assert!(point.mm.x < 300.0, "near the panel");
    }
    // What is in the middle of the panel is in view.
    assert!(outside_mm(Point::at(560.0, 0.0, 360.0)) < 0.0);
}

/// The tool on the true surface, its X along the panel's −Y.
pub(super) fn standing(truth: &Truth, point: Point<Panel>, height_mm: f64) -> Rigid<Panel, Tool> {
    let normal = truth.normal(point);
    let z = -normal.mm;
    let x = (-Vector3::y() + z * z.y).normalize();
    Rigid::from_axes([x, z.cross(&x), z].map(Vector::new), point + normal * height_mm)
}

/// Largest use of an axis's range, 0…1, and least |A5|: what is left to limits and to the wrist's pole.
#[derive(Debug, Clone, Copy)]
struct Margins {
    used: f64,
    bend_deg: f64,
    step_deg: f64,
}

impl Margins {
    fn add(&mut self, joints: &Joints) {
        for (angle, [low, high]) in angles_deg(joints).into_iter().zip(ARM.limits_deg) {
            self.used = self.used.max((angle - (low + high) / 2.0).abs() / ((high - low) / 2.0));
        }
        self.bend_deg = self.bend_deg.min(joints.a5_deg.abs());
    }
}

/// Every corner pose and every place that can be abraded, on the panel and 40 mm above it, nominal and displaced:
/// within limits by a tenth, away from the wrist's pole, without a change of configuration from one to the next.
#[test]
fn the_arm_reaches_every_pose_of_ten_seeds() {
    let mut margins = Margins { used: 0.0, bend_deg: 180.0, step_deg: 0.0 };
    for seed in 0..10 {
        let cell = Cell::new(seed, Scene::Good, 8);
        let truth = cell.truth();
        let moved: Rigid<Base, Base> = Rigid::claim(*truth.base_from_panel.isometry());
        for view in cell.corner_views() {
            let poses = [view.base_from_flange, moved * view.base_from_flange, cell.displaced_corner_pose(&view)];
            for pose in poses {
                let joints =
                    ARM.nearest(&pose, &park()).unwrap_or_else(|why| panic!("{seed} {}: {why}", view.name));
                println!("seed {seed} {}: {:.0?}", view.name, angles_deg(&joints));
                margins.add(&joints);
            }
        }
        let inside: Vec<Point<Panel>> =
            truth.surface_points().into_iter().filter(|&point| truth.outline_distance_mm(point) < -5.0).collect();
        for place in [Rigid::claim(nalgebra::Isometry3::identity()), truth.base_from_panel] {
            let mut near = None;
            for point in &inside {
                let reach = |height_mm: f64, near: &Joints| {
                    let pose = place * standing(&truth, *point, height_mm) * tool().inverse();
                    ARM.nearest(&pose, near).unwrap_or_else(|why| panic!("seed {seed}, {point:?}: {why}"))
                };
                let on = reach(0.0, &near.unwrap_or(park()));
                let above = reach(40.0, &on);
                [on, above].iter().for_each(|joints| margins.add(joints));
                let largest = |from: Joints| {
                    let pairs = angles_deg(&from).into_iter().zip(angles_deg(&on));
                    pairs.map(|(from, to)| (from - to).abs()).fold(0.0, f64::max)
                };
                margins.step_deg = margins.step_deg.max(largest(above));
                near = Some(on);
            }
            // From any place to any other without a turn of the wrist.
            let ends: Vec<[f64; 6]> = inside
                .iter()
                .map(|point| place * standing(&truth, *point, 0.0) * tool().inverse())
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
    println!("{margins:?}");
    assert!(margins.used < 0.9 && margins.bend_deg > 10.0 && margins.step_deg < 30.0, "{margins:?}");
}
