//! Sends random paths through all path checks. Paths without a defect pass; with one injected defect, the checks refuse
//! the whole path. `make test` checks a few paths, `make bench-surface` a hundred thousand.

use nalgebra::Vector3;
use panelprep::cell::{Cell, Workspace};
use panelprep::geometry::{Base, Degrees, Flange, Joints, KukaPose, Point, Rigid, Tool, Vector};
use panelprep::path::reach::{PathLine, follow_path};
use panelprep::path::{Kinematics, Route, WaypointLimits, judge_route};
use panelprep::verdict::Verdict;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;

/// The result of a run with many paths.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Paths without a defect that were refused, with the message of the check.
    pub refused: Vec<String>,
    /// For each defect, the number of paths with this defect, and the number of these paths that passed.
    pub planted: BTreeMap<&'static str, [usize; 2]>,
    /// Number of random paths that no configuration of the arm can follow; they are not counted as paths without a
    /// defect.
    pub infeasible: usize,
}

struct Gates {
    arm: Kinematics,
    flange_from_tool: Rigid<Flange, Tool>,
    limits: WaypointLimits,
}

fn arm(text: &str) -> Kinematics {
    Kinematics::new(Cell::check("cell.toml", text).unwrap_or_else(|e| panic!("{e}")).arm())
}

impl Gates {
    fn new() -> Self {
        Gates {
            arm: arm(""),
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

    /// Returns whether the arm may move along the whole path from its present pose.
    fn pass(&self, path: &Path) -> Result<(), String> {
        let waypoints: Vec<Rigid<Base, Tool>> = path.legs.iter().map(|leg| leg.base_from_tool).collect();
        let stands = self.arm.base_from_flange(&path.from).expect("numbers") * self.flange_from_tool;
        let route = Route { from: stands, waypoints: &waypoints, taught_axis: Some(Vector::new(Vector3::x())) };
        let judgement = judge_route(&route, &self.limits);
        if judgement.verdict != Verdict::Accept {
            return Err(format!("{:?}", judgement.reasons));
        }
        let arm = path.arm.as_ref().unwrap_or(&self.arm);
        let followed = follow_path(arm, self.flange_from_tool, Some(&path.from), &path.legs);
        followed.map(drop).map_err(|fault| fault.to_string())
    }
}

struct Path {
    from: Joints,
    legs: Vec<PathLine>,
    joints: Vec<Joints>,
    /// The arm, if it differs from the cell's arm or has other obstacles; `None` for the cell's arm.
    arm: Option<Kinematics>,
}

/// Returns a path like one over an upright panel: rows with 10 mm steps, with the tool along X and slightly tilted.
/// `None` if the arm cannot follow it in any configuration.
fn random_path(random: &mut Pcg64Mcg, gates: &Gates) -> Option<Path> {
    let mut share = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
    let (x, y, z) = (share(480.0, 560.0), share(-60.0, 60.0), share(300.0, 440.0));
    let (lean_y, lean_z, bend) = (share(-8.0, 8.0), share(-8.0, 8.0), share(-0.4, 0.4));
    let mut legs = Vec::new();
    for row in 0..4 {
        for step in 0..6 {
            let along = if row % 2 == 0 { f64::from(step) } else { 5.0 - f64::from(step) };
            let pose = KukaPose {
                x_mm: x,
                y_mm: y + 10.0 * along,
                z_mm: z + 10.0 * f64::from(row),
                a_deg: lean_z + bend * along,
                b_deg: 90.0 + lean_y,
                c_deg: 0.0,
            };
            legs.push(PathLine { base_from_tool: pose.to_rigid(), feed_mm_s: share(20.0, 80.0), blend_mm: 2.0 });
        }
    }
    // The arm starts 15 mm before the first point.
    let before = KukaPose { x_mm: x - 15.0, ..KukaPose::from_rigid(&legs[0].base_from_tool) };
    let start = PathLine { base_from_tool: before.to_rigid(), feed_mm_s: 50.0, blend_mm: 0.0 };
    let whole: Vec<PathLine> = std::iter::once(start).chain(legs.iter().copied()).collect();
    let travel = follow_path(&gates.arm, gates.flange_from_tool, None, &whole).ok()?;
    Some(Path { from: travel.joints[0], legs, joints: travel.joints[1..].to_vec(), arm: None })
}

/// Injects one defect into a path; returns the name of the defect.
fn inject_defect(random: &mut Pcg64Mcg, path: &mut Path) -> &'static str {
    let nth = 1 + (random.random::<f64>() * (path.legs.len() - 2) as f64) as usize;
    let pose = KukaPose::from_rigid(&path.legs[nth].base_from_tool);
    let leg = &mut path.legs[nth];
    let mut put = |pose: KukaPose| leg.base_from_tool = pose.to_rigid();
    match (random.random::<f64>() * 15.0) as usize {
        0 => {
            put(KukaPose { x_mm: f64::NAN, ..pose });
            "a place that is no number"
        }
        1 => {
            put(KukaPose { c_deg: f64::INFINITY, ..pose });
            "an angle that is no number"
        }
        2 => {
            put(KukaPose { y_mm: pose.y_mm + 75.0, ..pose });
            "a large step"
        }
        3 => {
            put(KukaPose { z_mm: 149.0, ..pose });
            "a place outside of the box"
        }
        4 => {
            put(KukaPose { c_deg: pose.c_deg + 16.0, ..pose });
            "a large turn"
        }
        5 => {
            path.legs.iter_mut().for_each(|leg| leg.base_from_tool = tilted(leg.base_from_tool, 41.0));
            "a tool that leans too far"
        }
        6 => {
            leg.feed_mm_s = 0.0;
            "no feed"
        }
        7 => {
            leg.feed_mm_s = f64::NAN;
            "a feed that is no number"
        }
        8 => {
            leg.feed_mm_s = 20_000.0;
            "an axis too fast"
        }
        9 => {
            // Moves back and forth at one position, almost without rounding.
            path.legs.iter_mut().for_each(|leg| (leg.feed_mm_s, leg.blend_mm) = (900.0, 0.05));
            "an axis that speeds up too fast"
        }
        10 => {
            path.from.a1_deg += 12.0;
            "an arm that stands elsewhere"
        }
        11 => {
            path.from.a5_deg = -path.from.a5_deg;
            "an arm in another configuration"
        }
        12 => {
            let [x, y, z] = [pose.x_mm, pose.y_mm, pose.z_mm];
            path.arm = Some(arm(&format!(
                "[[keep_out]]\nname = 'post'\nmin_mm = [{}, {}, {}]\nmax_mm = [{}, {}, {}]\n",
                x - 4.0,
                y - 4.0,
                z - 4.0,
                x + 4.0,
                y + 4.0,
                z + 4.0
            )));
            "a post in the way"
        }
        13 => {
            // The limit lies in the middle of the range that axis 2 uses on the path, with its margin of 3°.
            let a2_deg = path.joints[nth].a2_deg;
            path.arm = Some(arm(&format!("[arm]\nmax_deg = [170, {}, 156, 185, 120, 350]\n", a2_deg + 2.9)));
            "an axis beyond its limits"
        }
        _ => {
            // The centre of the wrist is 210 mm behind the tip: at most 350 mm from axis 1, along X.
            path.arm = Some(arm("[arm]\noverhead_margin_mm = 450\n"));
            "a wrist too near axis 1"
        }
    }
}

/// Tilts the tool by an angle about the Z axis of the base, around the tool centre point.
fn tilted(pose: Rigid<Base, Tool>, deg: f64) -> Rigid<Base, Tool> {
    let kuka = KukaPose::from_rigid(&pose);
    KukaPose { a_deg: if kuka.a_deg > 0.0 { kuka.a_deg + deg } else { kuka.a_deg - deg }, ..kuka }.to_rigid()
}

/// Checks this number of paths without a defect, and each of them once more with a defect.
pub fn run(paths: usize) -> Outcome {
    let gates = Gates::new();
    let mut random = Pcg64Mcg::seed_from_u64(11);
    let mut outcome = Outcome::default();
    for _ in 0..paths {
        let mut path = loop {
            match random_path(&mut random, &gates) {
                Some(path) => break path,
                None => outcome.infeasible += 1,
            }
        };
        outcome.refused.extend(gates.pass(&path).err());
        let defect = inject_defect(&mut random, &mut path);
        let [planted, passed] = outcome.planted.entry(defect).or_default();
        *planted += 1;
        *passed += usize::from(gates.pass(&path).is_ok());
    }
    outcome
}

#[cfg(test)]
#[test]
fn paths_with_one_defect_are_refused_and_without_it_pass() {
    let outcome = run(1_500);
    assert_eq!(outcome.refused, [""; 0]);
    assert!(outcome.planted.len() == 15, "{:?}", outcome.planted);
    for (defect, [planted, passed]) in &outcome.planted {
        assert!(*planted > 40 && *passed == 0, "{defect}: {passed} of {planted} passed");
    }
    assert!(outcome.infeasible < 400, "{} random paths were no paths", outcome.infeasible);
}
