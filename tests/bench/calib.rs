//! Sweeps of calibrations, compared with the renderer's ground truth. `cargo bench --bench calib -- [SEEDS [RENDERED]]`
//! sets the number of seeds of the statistics (default 200) and of the rendered sweeps (default 20); `-- uncalibrated`
//! runs only the uncalibrated arms.

#[path = "../boards.rs"]
mod boards;
#[path = "goal.rs"]
mod goal;
#[path = "calib/uncalibrated.rs"]
mod uncalibrated;

use boards::{BAD_ROBOT, Error, FAULTS, GOOD_ROBOT, Lens, POSES, Side};
use goal::{Figure, larger};
use panelprep::cell::{FlangeCameraMount, ScannerMount};
use panelprep::geometry::statistics::{QuantileRank, quantile};
use panelprep::sim::{BoardCell, BoardShot, RobotNoise};
use rayon::prelude::*;
use std::process::ExitCode;
use std::time::Instant;

/// Number of seeds for lenses from rendered pictures, with 25 full-size pictures each.
const RENDERED_LENSES: u64 = 8;
/// Maximum error of a mount that is calibrated from rendered pictures with the true lens, mm.
const MAX_ERROR_WITH_TRUE_LENS_MM: f64 = 0.06;
/// Maximum error of such a mount, degrees.
const MAX_ERROR_WITH_TRUE_LENS_DEG: f64 = 0.015;
/// Maximum error of a mount that is calibrated from rendered pictures with the calibrated lens, mm.
const MAX_ERROR_WITH_OWN_LENS_MM: f64 = 0.10;
/// Maximum error of a mount that is calibrated with a robot with errors of 0.5 mm, mm.
const MAX_ERROR_WITH_BAD_ROBOT_MM: f64 = 0.6;
/// Range of the fraction of cases in which the stated 95 % region must contain the true value. Below the range the
/// stated region is too small, above it too large.
const STATED_FRACTION_RANGE: std::ops::RangeInclusive<f64> = 0.90..=0.99;
/// Number of seeds for which the limits in mm apply.
const LIMIT_SEEDS: usize = 20;

fn main() -> ExitCode {
    if std::env::args().any(|argument| argument == "uncalibrated") {
        return finished(uncalibrated::arms());
    }
    let mut numbers = std::env::args().skip(1).filter_map(|argument| argument.parse::<u64>().ok());
    let seeds = numbers.next().unwrap_or(200);
    let few = numbers.next().unwrap_or(seeds.div_ceil(10));
    let mut missed = three_points(seeds);
    let mut regions = Vec::new();
    for (name, robot, limit_mm) in
        [("robot 0.02 mm", GOOD_ROBOT, 0.06), ("robot 0.5 mm", BAD_ROBOT, MAX_ERROR_WITH_BAD_ROBOT_MM)]
    {
        regions.push(region::<ScannerMount>(seeds, name, robot, (Lens::truth::<ScannerMount>, limit_mm)));
        regions.push(region::<FlangeCameraMount>(seeds, name, robot, (Lens::truth::<FlangeCameraMount>, limit_mm)));
    }
    let by_bad_robot_mm = larger(regions[2].first_mm, regions[3].first_mm);
    let own = "robot 0.02 mm, own lens of 15 pictures";
    let by_own = (boards::synthetic_lens::<ScannerMount> as fn(&BoardCell) -> Lens, 0.2);
    regions.push(region::<ScannerMount>(seeds, own, GOOD_ROBOT, by_own));
    let by_own = (boards::synthetic_lens::<FlangeCameraMount> as fn(&BoardCell) -> Lens, 0.2);
    regions.push(region::<FlangeCameraMount>(seeds, own, GOOD_ROBOT, by_own));
    missed += regions.iter().map(|region| region.missed).sum::<usize>();
    regions_reported(&regions, by_bad_robot_mm);
    let (fixed, moving) = (test_input_faults::<ScannerMount>(seeds), test_input_faults::<FlangeCameraMount>(seeds));
    let found = format!("all but {} of 6 kinds, {seeds} seeds each", fixed + moving);
    let what = Figure("calib: flipped board, swapped pictures, mistyped number: named");
    missed += usize::from(!what.report("all", &found, fixed + moving == 0 && seeds > 0));
    let synthetic = "synthetic corners";
    let fixed = Figure("calib: corners of new pictures within what the lens states, fixed");
    missed += lenses::<ScannerMount>(few, synthetic, boards::synthetic::<ScannerMount>, Some(fixed));
    let moving = Figure("calib: flange camera");
    missed += lenses::<FlangeCameraMount>(few, synthetic, boards::synthetic::<FlangeCameraMount>, Some(moving));
    let pictures = few.min(RENDERED_LENSES);
    missed += lenses::<ScannerMount>(pictures, "rendered pictures", boards::rendered::<ScannerMount>, None);
    missed +=
        lenses::<FlangeCameraMount>(pictures, "rendered pictures", boards::rendered::<FlangeCameraMount>, None);
    let mounts = [rendered::<ScannerMount>(few), rendered::<FlangeCameraMount>(few)];
    missed += mounts.iter().map(|mount| mount.missed).sum::<usize>();
    mounts_reported(&mounts);
    missed += uncalibrated::arms();
    finished(missed)
}

fn finished(missed: usize) -> ExitCode {
    println!("{missed} floors were missed");
    if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Returns the value below which this share of all values lies.
fn value_quantile(values: &mut [f64], share: f64) -> f64 {
    quantile(values, share, QuantileRank::Covering).expect("values")
}

fn row(name: &str, good: bool, numbers: &str) -> usize {
    println!("{:6} {name}: {numbers}", if good { "ok" } else { "MISSED" });
    usize::from(!good)
}

/// The results of a sweep over one mount and robot.
struct RegionFound {
    missed: usize,
    /// Fraction of the seeds whose stated 95 % region contains the true value.
    held: f64,
    /// Largest error of the first [`LIMIT_SEEDS`] seeds, mm.
    first_mm: f64,
}

fn regions_reported(regions: &[RegionFound], by_bad_robot_mm: f64) {
    let held = || regions.iter().map(|region| region.held);
    let (least, most) = (held().fold(f64::INFINITY, f64::min), held().fold(0.0, f64::max));
    let found = format!("{:.1}–{:.1} % in {} settings", 100.0 * least, 100.0 * most, regions.len());
    let is_held = held().all(|held| STATED_FRACTION_RANGE.contains(&held));
    Figure("calib: stated 95 % region contains the truth").report("90–99 %", &found, is_held);
    let found = format!("{by_bad_robot_mm:.2} mm");
    let is_small = by_bad_robot_mm <= MAX_ERROR_WITH_BAD_ROBOT_MM;
    let what = Figure("calib: robot 0.5 mm off, mount, worst of the first 20 seeds");
    what.report(&format!("{MAX_ERROR_WITH_BAD_ROBOT_MM} mm"), &found, is_small);
}

/// The largest errors of mounts that were calibrated from rendered pictures.
struct MountFound {
    missed: usize,
    truth_mm: f64,
    truth_deg: f64,
    own_mm: f64,
}

fn mounts_reported(mounts: &[MountFound]) {
    let worst = |number: fn(&MountFound) -> f64| mounts.iter().map(number).fold(0.0, larger);
    let (mm, deg) = (worst(|mount| mount.truth_mm), worst(|mount| mount.truth_deg));
    let is_met = mm <= MAX_ERROR_WITH_TRUE_LENS_MM && deg <= MAX_ERROR_WITH_TRUE_LENS_DEG;
    Figure("calib: mount from rendered pictures, worst, true lens").report(
        &format!("{MAX_ERROR_WITH_TRUE_LENS_MM} mm, {MAX_ERROR_WITH_TRUE_LENS_DEG}°"),
        &format!("{mm:.3} mm, {deg:.4}°"),
        is_met,
    );
    let own_mm = worst(|mount| mount.own_mm);
    Figure("calib: own lens").report(
        &format!("{MAX_ERROR_WITH_OWN_LENS_MM} mm"),
        &format!("{own_mm:.3} mm"),
        own_mm <= MAX_ERROR_WITH_OWN_LENS_MM,
    );
}

fn three_points(seeds: u64) -> usize {
    let errors: Vec<[f64; 2]> =
        (1..=seeds).into_par_iter().map(|seed| boards::three_point_errors(seed, 0.1, true)).collect();
    let at = |index: usize| value_quantile(&mut errors.iter().map(|error| error[index]).collect::<Vec<_>>(), 0.95);
    let (centre, corner) = (at(0), at(1));
    let numbers = format!(
        "95 % of {seeds} rendered seeds: centre {centre:.3} mm (0.30), farthest corner {corner:.3} mm (0.70)"
    );
    row("three points, touch 0.1 mm", centre <= 0.30 && corner <= 0.70, &numbers)
}

fn rendered<A: Side>(seeds: u64) -> MountFound {
    let (mut missed, mut held) = (0, 0);
    let (mut with_truth, mut with_own, mut deg, mut seconds) = (vec![], vec![], vec![], vec![]);
    for seed in 1..=seeds {
        let cell = boards::cell(seed, GOOD_ROBOT);
        let (camera, shots) = (A::camera(&cell), A::shots(&cell, POSES));
        let pictures: Vec<_> = shots.iter().map(|shot| cell.picture(&camera, shot)).collect();
        let (own, truth) = (boards::own_lens::<A>(&cell), Lens::truth::<A>(&cell));
        let started = Instant::now();
        let find = |picture| panelprep::calib::detect::detect("picture", picture, &boards::board(), None);
        let corners: Vec<_> = pictures.par_iter().map(|p| find(p).expect("a board").corners).collect();
        let _lens = boards::calibrate_lens(&camera, &corners);
        let by_own = boards::error(&cell, &boards::calibrate_from_many_poses::<A>(&own, &shots, &corners));
        seconds.push(started.elapsed().as_secs_f64());
        let by_truth = boards::error(&cell, &boards::calibrate_from_many_poses::<A>(&truth, &shots, &corners));
        held += usize::from(by_own.held);
        with_truth.push(by_truth.mm);
        deg.push(by_truth.deg);
        with_own.push(by_own.mm);
        missed += usize::from(by_truth.suspects + by_own.suspects > 0);
    }
    let [truth, deg, own, slowest] =
        [with_truth, deg, with_own, seconds].map(|mut values| value_quantile(&mut values, 1.0));
    let good = truth <= MAX_ERROR_WITH_TRUE_LENS_MM
        && deg <= MAX_ERROR_WITH_TRUE_LENS_DEG
        && own <= MAX_ERROR_WITH_OWN_LENS_MM
        && slowest <= 20.0
        && missed == 0;
    let numbers = format!(
        "worst of {seeds} seeds: {truth:.3} mm ({MAX_ERROR_WITH_TRUE_LENS_MM}) and {deg:.4}° ({MAX_ERROR_WITH_TRUE_LENS_DEG}) with the true lens, {own:.3} mm ({MAX_ERROR_WITH_OWN_LENS_MM}) with its own, \
         whose stated region contains the true mount in {held}; corners, lens and mount in {slowest:.1} s (20); {missed} false alarms"
    );
    let missed = row(&format!("{}, 15 rendered poses", A::NAME), good, &numbers);
    MountFound { missed, truth_mm: truth, truth_deg: deg, own_mm: own }
}

/// Calibrates lenses with 15 pictures and tests them with ten other pictures: the corner errors must be as small as
/// predicted by the cross-validation.
fn lenses<A: Side>(
    seeds: u64,
    name: &str,
    corners: fn(&BoardCell, &[BoardShot<A::From>]) -> Vec<panelprep::calib::detect::Corners>,
    figure: Option<Figure>,
) -> usize {
    let judged: Vec<(usize, usize, &str)> = (1..=seeds)
        .into_par_iter()
        .map(|seed| {
            let cell = boards::cell(seed, GOOD_ROBOT);
            let camera = A::camera(&cell);
            let shots = cell.lens_shots::<A::From>(&camera, POSES + 10);
            let all = corners(&cell, &shots);
            let (own, others) = all.split_at(POSES);
            let found = boards::calibrated_lens(&camera, own);
            let within = |corners: &panelprep::calib::detect::Corners| {
                let seen = panelprep::calib::BoardObservation::<A::From>::Pixels(corners.clone());
                let pose = panelprep::calib::board_pose(&found.camera, &seen).expect("a pose").camera_from_board;
                let off = |&(q, at): &(_, panelprep::geometry::Pixel)| {
                    found.camera.project(pose * q).map(|p| p.distance_px(at))
                };
                corners.iter().filter_map(off).filter(|px| *px <= found.left_out_95_px).count()
            };
            let count = others.iter().map(Vec::len).sum();
            (others.iter().map(within).sum(), count, found.model.name())
        })
        .collect();
    let (within, all) = judged.iter().fold((0, 0), |(within, all), (w, a, _)| (within + w, all + a));
    let share = within as f64 / all as f64;
    let mut models: Vec<&str> = judged.iter().map(|(.., model)| *model).collect();
    models.sort_unstable();
    let counts: Vec<String> =
        models.chunk_by(|a, b| a == b).map(|same| format!("{} {}", same.len(), same[0])).collect();
    let numbers = format!(
        "{:.1} % of the corners of new pictures within what is stated (90 to 99); models: {}",
        share * 100.0,
        counts.join(", ")
    );
    let is_held = STATED_FRACTION_RANGE.contains(&share);
    if let Some(figure) = figure {
        figure.report("90–99 %", &format!("{:.1} %", 100.0 * share), is_held);
    }
    row(&format!("{}, lenses of {seeds} seeds, {name}", A::NAME), is_held, &numbers)
}

/// Injects a flipped board, two exchanged pictures and a mistyped number; each must be found and named.
fn test_input_faults<A: Side>(seeds: u64) -> usize {
    let named = |fault: usize| {
        let is_named = |seed: &u64| boards::is_fault_named(&boards::calibrate_with_fault::<A>(*seed, fault), fault);
        (1..=seeds).into_par_iter().filter(is_named).count()
    };
    let [flipped, swapped, mistyped] = [0, 1, 2].map(named);
    let all = FAULTS.len() as u64 * seeds;
    let numbers =
        format!("found and named in {seeds} seeds each: flipped {flipped}, swapped {swapped}, mistyped {mistyped}");
    row(&format!("{}, faults", A::NAME), (flipped + swapped + mistyped) as u64 == all, &numbers)
}

fn region<A: Side>(
    seeds: u64,
    name: &str,
    robot: RobotNoise,
    (lens, limit_mm): (fn(&BoardCell) -> Lens, f64),
) -> RegionFound {
    let one = |seed: u64| {
        let cell = boards::cell(seed, robot);
        let shots = A::shots(&cell, POSES);
        let corners = boards::synthetic::<A>(&cell, &shots);
        boards::error(&cell, &boards::calibrate_from_many_poses::<A>(&lens(&cell), &shots, &corners))
    };
    let errors: Vec<Error> = (1..=seeds).into_par_iter().map(one).collect();
    let held = errors.iter().filter(|error| error.held).count() as f64 / seeds as f64;
    let in_sphere = errors.iter().filter(|error| error.mm <= error.stated_mm).count() as f64 / seeds as f64;
    let mut mm: Vec<f64> = errors.iter().map(|error| error.mm).collect();
    let mut stated: Vec<f64> = errors.iter().map(|error| error.stated_mm).collect();
    let first = value_quantile(&mut mm[..mm.len().min(LIMIT_SEEDS)].to_vec(), 1.0);
    let (worst, median, stated) =
        (value_quantile(&mut mm, 1.0), value_quantile(&mut mm, 0.5), value_quantile(&mut stated, 0.5));
    let alarms = errors.iter().filter(|error| error.suspects > 0).count();
    let good = STATED_FRACTION_RANGE.contains(&held) && first <= limit_mm;
    let numbers = format!(
        "the 95 % region contains the true mount in {:.1} % of {seeds} seeds (90 to 99), the sphere in {:.1} %; worst of the first {LIMIT_SEEDS} \
         {first:.3} mm ({limit_mm}), of all {worst:.3} mm, median {median:.3}, stated {stated:.3} mm; {alarms} with a picture set aside",
        held * 100.0,
        in_sphere * 100.0,
    );
    let missed = row(&format!("{}, {name}, synthetic corners", A::NAME), good, &numbers);
    RegionFound { missed, held, first_mm: first }
}
