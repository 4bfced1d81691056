//! Mounts that were calibrated with an uncalibrated arm, whose errors are similar in similar poses.
//!
//! The true mount is that in the arm's own coordinates, in which poses are commanded: the mount that follows from exact
//! pictures in the whole volume. The poses are distributed over the whole volume, or lie in three regions of it, as if
//! a person jogs the arm only a little between two pictures.

use super::boards::{self, CORNER_PX, Lens, Side};
use super::{row, value_quantile};
use panelprep::calib::hand_eye::hand_eye;
use panelprep::calib::{BoardObservation, HandEye, Station};
use panelprep::cell::{FlangeCameraMount, ScannerMount};
use panelprep::geometry::{Base, Flange, Rigid};
use panelprep::sim::{RealArm, RobotNoise};
use rayon::prelude::*;

const SEEDS: u64 = 40;
const ERRORS_MM: [f64; 2] = [0.3, 1.0];
/// Number of camera poses that are drawn; the arm reaches most of them.
const DRAWN: usize = 40;
const REGIONS: usize = 3;
const POSES_EACH: usize = 5;
/// Weight of a rotation in the distance between two poses, mm per rad.
const MM_PER_RADIAN: f64 = 300.0;
const REPEAT: RobotNoise = RobotNoise { shift_mm: 0.01, turn_deg: 0.001 };
const EXACT: RobotNoise = RobotNoise { shift_mm: 0.0, turn_deg: 0.0 };
/// Noise of the corners for the true mount, px: not zero, because the least-squares adjustment needs noise.
const EXACT_PX: f64 = 0.005;
/// Only every nth corner is used, because the arm's errors are much larger than those of the corners.
const CORNER_STEP: usize = 7;

/// Range of the fraction of mounts whose error must be within the stated bound. Above the range the bound is wider than
/// necessary.
const STATED_FRACTION_RANGE: std::ops::RangeInclusive<f64> = 0.90..=0.99;
/// Maximum ratio of the stated bound to the median error.
const MAX_STATED: f64 = 8.0;

/// Compares the stated bounds with the errors; returns the number of missed targets.
pub fn arms() -> usize {
    let both = |error_mm| mounts::<ScannerMount>(error_mm) + mounts::<FlangeCameraMount>(error_mm);
    ERRORS_MM.into_iter().map(both).sum()
}

fn stations<A: Side>(seed: u64, error_mm: f64, (robot, noise_px): (RobotNoise, f64)) -> Vec<Station<A::From>> {
    let (cell, arm) = (boards::cell(seed, robot), RealArm::new(seed, error_mm));
    let camera = A::camera(&cell);
    let station = |shot: &panelprep::sim::BoardShot<A::From>| {
        let corners = cell.corners(&camera, shot, noise_px).into_iter().step_by(CORNER_STEP).collect();
        Some(Station {
            name: shot.index.to_string(),
            base_from_flange: arm.reported_pose(&shot.base_from_flange)?.base_from_flange,
            observation: BoardObservation::Pixels(corners),
        })
    };
    A::shots(&cell, DRAWN).iter().filter_map(station).collect()
}

/// Returns poses in regions that are far from each other, each with poses near it.
fn poses_in_regions<A: Side>(all: &[Station<A::From>]) -> Vec<Station<A::From>> {
    let distance_mm = |one: &Station<A::From>, other: &Station<A::From>| {
        let [one, other]: [Rigid<Base, Flange>; 2] = [one.base_from_flange, other.base_from_flange];
        one.origin()
            .distance_mm(other.origin())
            .hypot(MM_PER_RADIAN * (one.inverse() * other).rotation_angle().to_rad())
    };
    let mut middles = vec![&all[0]];
    while middles.len() < REGIONS {
        let from_all = |own: &Station<A::From>| {
            middles.iter().map(|middle| distance_mm(own, middle)).fold(f64::INFINITY, f64::min)
        };
        middles.extend(all.iter().max_by(|a, b| from_all(a).total_cmp(&from_all(b))));
    }
    let mut left: Vec<&Station<A::From>> = all.iter().collect();
    let mut chosen = Vec::new();
    for middle in middles {
        left.sort_by(|a, b| distance_mm(a, middle).total_cmp(&distance_mm(b, middle)));
        chosen.extend(left.drain(..POSES_EACH).cloned());
    }
    chosen
}

/// Returns the error, the stated bound, and the number of poses per independent pose; `None` if the poses are refused.
fn judged<A: Side>(lens: &Lens, stations: &[Station<A::From>], own: &HandEye<A>) -> Option<(f64, f64, f64)> {
    let found = hand_eye::<A>(&lens.camera, &boards::board(), stations, None).ok()?;
    let error_mm =
        found.adjustment.to_from_camera.distance_at_mm(own.adjustment.to_from_camera, found.stated_point);
    Some((error_mm, found.uncertainty_mm, found.correlated_pose_count))
}

fn mounts<A: Side>(error_mm: f64) -> usize {
    let one = |seed: u64| {
        let lens = Lens::truth::<A>(&boards::cell(seed, EXACT));
        let all = stations::<A>(seed, error_mm, (REPEAT, CORNER_PX));
        let exact = stations::<A>(seed, error_mm, (EXACT, EXACT_PX));
        let own = hand_eye::<A>(&lens.camera, &boards::board(), &exact, None).expect("the arm's own mount");
        let over_volume = &all[..REGIONS * POSES_EACH];
        [judged::<A>(&lens, over_volume, &own), judged::<A>(&lens, &poses_in_regions::<A>(&all), &own)]
    };
    let found: Vec<_> = (1..=SEEDS).into_par_iter().map(one).collect();
    let mut missed = 0;
    for (index, poses) in ["over the whole volume", "in three regions"].into_iter().enumerate() {
        let known: Vec<(f64, f64, f64)> = found.iter().filter_map(|pair| pair[index]).collect();
        let held = known.iter().filter(|(mm, stated_mm, _)| mm <= stated_mm).count() as f64 / known.len() as f64;
        let median =
            |of: fn(&(f64, f64, f64)) -> f64| value_quantile(&mut known.iter().map(of).collect::<Vec<_>>(), 0.5);
        let (mm, stated_mm, each) = (median(|one| one.0), median(|one| one.1), median(|one| one.2));
        let good =
            STATED_FRACTION_RANGE.contains(&held) && stated_mm <= MAX_STATED * mm && known.len() as u64 == SEEDS;
        let numbers = format!(
            "the error is within the stated 95 % bound in {:.1} % of {} seeds ({:.0} to {:.0} %); median error {mm:.3} mm, stated {stated_mm:.3} mm, {each:.1} poses \
             count as one",
            100.0 * held,
            known.len(),
            100.0 * STATED_FRACTION_RANGE.start(),
            100.0 * STATED_FRACTION_RANGE.end()
        );
        missed += row(&format!("{}, arm {error_mm} mm off, 15 poses {poses}", A::NAME), good, &numbers);
    }
    missed
}
