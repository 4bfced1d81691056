//! Compares edges, curvature and tilt with a finer reference of our own: stationary discs every 0.1 mm, each at 24
//! points of its orbit, with the force balanced over a square grid of 0.15 mm. The reference uses the same formulas for
//! the pad as the code under test, but none of its code.

use super::goal::{Figure, larger};
use super::scene::{FORCE_N, ORBIT, PAD, PRESTON_MM2_PER_N, bent, disc, exact_model, pose, region};
use super::{held, most};
use panelprep::panel::GridId;
use panelprep::removal::map::removed;
use panelprep::removal::track::path_stretches;
use panelprep::surface::{Parameter, Treated};
use std::f64::consts::TAU;

const OFF_PERCENT: f64 = 3.0;
/// Sides slightly shorter than whole millimetres, so that sample points are 1 mm apart.
const SIDES_MM: [f64; 2] = [119.999_9, 79.999_9];
const FEED_MM_S: f64 = 60.0;
const STEP_MM: f64 = 0.1;
const NET_MM: f64 = 0.15;
const PHASES: usize = 24;

/// A path line along x at this y on a surface with these curvatures; the tool leans about Y, and the panel ends at a
/// second y.
struct Case {
    name: &'static str,
    bends: [f64; 2],
    y_mm: f64,
    lean_deg: f64,
    edge_mm: f64,
}

const CASES: [Case; 8] = [
    Case { name: "flat, no edge", bends: [0.0, 0.0], y_mm: 0.0, lean_deg: 0.0, edge_mm: 99.0 },
    Case { name: "flat, 5 mm over the edge", bends: [0.0, 0.0], y_mm: 10.0, lean_deg: 0.0, edge_mm: 20.0 },
    Case { name: "flat, 13 mm over the edge", bends: [0.0, 0.0], y_mm: 18.0, lean_deg: 0.0, edge_mm: 20.0 },
    Case { name: "flat, tool tilted by 1°", bends: [0.0, 0.0], y_mm: 0.0, lean_deg: 1.0, edge_mm: 99.0 },
    Case {
        name: "flat, tool tilted by 6°, half in contact",
        bends: [0.0, 0.0],
        y_mm: 0.0,
        lean_deg: 6.0,
        edge_mm: 99.0,
    },
    Case { name: "cylinder of 300 mm across", bends: [0.0, 1.0 / 300.0], y_mm: 0.0, lean_deg: 0.0, edge_mm: 99.0 },
    Case {
        name: "bowl of 250 mm, on its rim",
        bends: [-1.0 / 250.0, -1.0 / 250.0],
        y_mm: 0.0,
        lean_deg: 0.0,
        edge_mm: 99.0,
    },
    Case {
        name: "saddle, tool tilted, over the edge",
        bends: [1.0 / 600.0, -1.0 / 400.0],
        y_mm: 0.0,
        lean_deg: 1.0,
        edge_mm: 9.0,
    },
];

pub fn measure() -> usize {
    let (mut missed, mut worst) = (0, 0.0);
    for case in &CASES {
        let (ours, theirs) = (ours(case), finer(case));
        let deepest = theirs.iter().copied().fold(0.0, f64::max);
        let sums = [&ours, &theirs].map(|all| all.iter().sum::<f64>());
        let off = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / deepest;
        let rms = (ours.iter().zip(&theirs).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / ours.len() as f64).sqrt()
            / deepest;
        println!(
            "   {}: {deepest:.2} µm at most; all of it {:+.2} %, rms {:.2} %",
            case.name,
            100.0 * (sums[0] / sums[1] - 1.0),
            100.0 * rms
        );
        missed += held("  off, of the largest depth", 100.0 * off, OFF_PERCENT, "%");
        worst = larger(worst, 100.0 * off);
    }
    most(Figure("removal: off the finer reference, worst case"), worst, OFF_PERCENT, " %");
    missed
}

fn normal_mm([k1, k2]: [f64; 2], x: f64, y: f64) -> [f64; 3] {
    [k1 * x, k2 * y, 1.0]
}

fn height_mm([k1, k2]: [f64; 2], x: f64, y: f64) -> f64 {
    -0.5 * (k1 * x * x + k2 * y * y)
}

/// Returns the depth across the middle of the line, µm, at y = −39.5, −38.5 … mm.
fn ours(case: &Case) -> Vec<f64> {
    let surface = bent(SIDES_MM, case.bends);
    let line: Vec<_> = (0..=16)
        .map(|n| {
            let x = -40.0 + 5.0 * f64::from(n);
            let seconds = if n == 0 { 0.0 } else { 5.0 / FEED_MM_S };
            let at = [x, case.y_mm, height_mm(case.bends, x, case.y_mm)];
            pose(at, normal_mm(case.bends, x, case.y_mm), (case.lean_deg, seconds))
        })
        .collect();
    let edge_v = 0.5 + case.edge_mm / SIDES_MM[1];
    let ground = |at: Parameter| at.v < edge_v;
    let all = path_stretches(&surface, &line, (&disc(true), FORCE_N), &ground);
    let map = removed(
        (&surface, &region([1, 1]), &ground),
        &Treated::from_grids(&[GridId { row: 1, column: 1 }]),
        &all,
        (&exact_model(), 0.0),
        1.0,
    );
    let grid = &map.grids[0];
    let rows = grid.depth_um.len() / grid.columns;
    // The depth is the mean of the two columns beside the middle.
    let column = |row: usize, away: usize| f64::from(grid.depth_um[row * grid.columns + grid.columns / 2 - away]);
    (0..rows).map(|row| 0.5 * (column(row, 0) + column(row, 1))).collect()
}

fn finer(case: &Case) -> Vec<f64> {
    let rows = SIDES_MM[1].round() as usize;
    let places: Vec<f64> = (0..rows).map(|row| row as f64 + 0.5 - SIDES_MM[1] / 2.0).collect();
    let mut depth_um = vec![0.0; rows];
    let steps = (80.0 / STEP_MM).round() as usize;
    let grain_mm_s = ORBIT.grain_mm_s(FEED_MM_S);
    for step in 0..steps {
        let x = -40.0 + (step as f64 + 0.5) * STEP_MM;
        if x.abs() > PAD.radius_mm + ORBIT.diameter_mm {
            continue;
        }
        let disc = StationaryDisc::at(case, x);
        for (place, depth_um) in places.iter().zip(&mut depth_um) {
            if *place >= case.edge_mm {
                continue;
            }
            let mean = (0..PHASES)
                .map(|phase| {
                    let turn = TAU * phase as f64 / PHASES as f64;
                    let e = ORBIT.diameter_mm / 2.0;
                    disc.pressure(-x - e * turn.cos(), *place - case.y_mm - e * turn.sin())
                })
                .sum::<f64>()
                / PHASES as f64;
            *depth_um += 1_000.0 * PRESTON_MM2_PER_N * mean * grain_mm_s * STEP_MM / FEED_MM_S;
        }
    }
    depth_um
}

/// A stationary disc at one point of the line.
struct StationaryDisc {
    bends: [f64; 2],
    tilt_x: f64,
    depth_mm: f64,
}

impl StationaryDisc {
    fn at(case: &Case, _x: f64) -> Self {
        let mut disc =
            StationaryDisc { bends: case.bends, tilt_x: case.lean_deg.to_radians().tan(), depth_mm: 0.0 };
        let count = (PAD.radius_mm / NET_MM).ceil() as i32;
        let net = (-count..count).flat_map(|i| (-count..count).map(move |j| [i, j]));
        let places: Vec<f64> = net
            .map(|[i, j]| [(f64::from(i) + 0.5) * NET_MM, (f64::from(j) + 0.5) * NET_MM])
            .filter(|[dx, dy]| dx.hypot(*dy) <= PAD.radius_mm && case.y_mm + dy < case.edge_mm)
            .map(|[dx, dy]| disc.deeper(dx, dy))
            .collect();
        let force = |depth_mm: f64| {
            let pressed = places.iter().map(|deeper| (depth_mm + deeper).max(0.0)).sum::<f64>();
            PAD.stiffness_n_mm3 * NET_MM * NET_MM * pressed
        };
        let (mut low, mut high) = (-10.0, 20.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if force(middle) < FORCE_N { low = middle } else { high = middle }
        }
        disc.depth_mm = 0.5 * (low + high);
        disc
    }

    fn deeper(&self, dx: f64, dy: f64) -> f64 {
        self.tilt_x * dx - 0.5 * (self.bends[0] * dx * dx + self.bends[1] * dy * dy)
    }

    fn pressure(&self, dx: f64, dy: f64) -> f64 {
        if dx.hypot(dy) > PAD.radius_mm {
            0.0
        } else {
            PAD.stiffness_n_mm3 * (self.depth_mm + self.deeper(dx, dy)).max(0.0)
        }
    }
}
