//! The true arm: a chain of Denavit–Hartenberg frames with erroneous parameters, compliant axes that bend under the
//! weight of the links, and gears with errors that depend on the angle.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep::cell::ArmGeometry;
use panelprep::geometry::Joints;
use rand::RngExt;
use rand_pcg::Pcg64;

/// A link of the Denavit–Hartenberg chain: a rotation about z and a shift along z, a shift along x and a rotation about
/// x, and Hayati's rotation about y.
#[derive(Clone, Copy)]
struct Link {
    turn: f64,
    d_mm: f64,
    a_mm: f64,
    twist: f64,
    beta: f64,
}

impl Link {
    fn at(&self, angle: f64) -> Isometry3<f64> {
        let z = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle + self.turn);
        let x = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), self.twist);
        let y = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), self.beta);
        z * Translation3::new(0.0, 0.0, self.d_mm) * Translation3::new(self.a_mm, 0.0, 0.0) * x * y
    }
}

/// An arm with its true errors.
pub struct TrueArm {
    geometry: ArmGeometry,
    links: [Link; 6],
    /// Compliance of axes 2 to 5, rad per N·m.
    yields: [f64; 4],
    /// Error of each gear: amplitude, rad, phase, and number of periods in one rotation.
    gears: [(f64, f64, f64); 6],
}

/// Masses that axes 2, 3 and 5 carry, kg.
const MASSES_KG: [f64; 3] = [9.0, 8.0, 5.0];

impl TrueArm {
    /// Creates an arm without errors.
    pub fn drawn(geometry: ArmGeometry) -> Self {
        let g = geometry;
        let quarter = std::f64::consts::FRAC_PI_2;
        let link = |turn, d_mm, a_mm, twist| Link { turn, d_mm, a_mm, twist, beta: 0.0 };
        TrueArm {
            geometry,
            links: [
                link(0.0, g.c1_mm, g.a1_mm, -quarter),
                link(-quarter, g.b_mm, g.c2_mm, 0.0),
                link(quarter, 0.0, g.a2_mm, quarter),
                link(0.0, g.c3_mm, 0.0, -quarter),
                link(0.0, 0.0, 0.0, quarter),
                link(0.0, g.c4_mm, 0.0, 0.0),
            ],
            yields: [0.0; 4],
            gears: [(0.0, 0.0, 0.0); 6],
        }
    }

    /// Creates an arm with random errors. With `is_hard`, the errors under load and those of the gears are larger.
    pub fn random(geometry: ArmGeometry, random: &mut Pcg64, is_hard: bool) -> Self {
        let mut arm = TrueArm::drawn(geometry);
        let mut within = |reach: f64| (2.0 * random.random::<f64>() - 1.0) * reach;
        for link in &mut arm.links {
            link.turn += within(0.05f64.to_radians());
            link.d_mm += within(0.4);
            link.a_mm += within(0.4);
            link.twist += within(0.03f64.to_radians());
        }
        arm.links[1].d_mm = geometry.b_mm;
        arm.links[1].beta = within(0.03f64.to_radians());
        // Up to 0.3 mm at the end of the extended arm, mostly from axis 2.
        let most = if is_hard { 1.0 } else { 0.5 };
        let share = |within: &mut dyn FnMut(f64) -> f64| 0.5 + 0.5 * within(1.0).abs();
        arm.yields = [3.0e-6, 4.0e-6, 3.0e-6, 5.0e-6].map(|most_yield| most * most_yield * share(&mut within));
        let amplitude = if is_hard { 0.004f64 } else { 0.002 }.to_radians();
        let periods = [30.0, 25.0, 28.0, 11.0, 13.0, 9.0];
        arm.gears = periods.map(|periods| (within(amplitude), within(std::f64::consts::PI), periods));
        arm
    }

    /// Returns the true pose of the flange at these axis angles.
    pub fn base_from_flange(&self, joints: &Joints) -> Isometry3<f64> {
        let all = joints.degrees();
        let g = &self.geometry;
        let mut q: [f64; 6] =
            std::array::from_fn(|axis| (all[axis] * f64::from(g.signs[axis]) - g.offsets_deg[axis]).to_radians());
        for (angle, (amplitude, phase, periods)) in q.iter_mut().zip(&self.gears) {
            *angle += amplitude * (periods * *angle + phase).sin();
        }
        // The moments of the links' weights about axes 2 to 5 at the arm's current pose, N·m.
        let frames = self.frames(&q);
        let middles = [
            frames[0].translation.vector * 0.55 + frames[1].translation.vector * 0.45,
            frames[2].translation.vector * 0.6 + frames[3].translation.vector * 0.4,
            frames[5].translation.vector,
        ];
        let carried = [&middles[0..3], &middles[1..3], &middles[1..3], &middles[2..3]];
        let masses = [&MASSES_KG[0..3], &MASSES_KG[1..3], &MASSES_KG[1..3], &MASSES_KG[2..3]];
        for axis in 0..4 {
            let frame = frames[axis];
            let (about, from) = (frame.rotation * Vector3::z(), frame.translation.vector);
            let moment: f64 = carried[axis]
                .iter()
                .zip(masses[axis])
                .map(|(at, kg)| (at - from).cross(&(Vector3::z() * -9.81 * *kg)).dot(&about) / 1000.0)
                .sum();
            q[axis + 1] += self.yields[axis] * moment;
        }
        self.frames(&q)[5]
    }

    /// Returns the frame behind each axis.
    fn frames(&self, q: &[f64; 6]) -> [Isometry3<f64>; 6] {
        let mut at = Isometry3::identity();
        std::array::from_fn(|axis| {
            at *= self.links[axis].at(q[axis]);
            at
        })
    }
}
