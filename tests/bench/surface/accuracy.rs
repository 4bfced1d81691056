//! Compares the fit with the ground truth in the camera's frame: with all of the camera's noise, and with only its
//! white noise.

use super::goal::Figure;
use super::scanned::Scanned;
use super::{Timed, held, held_time, most, timed};
use panelprep::geometry::statistics::{self, QuantileRank, quantile};
use panelprep::surface::{self, BSplineSurface, Fit, Parameter};

const FIT_MS: f64 = 100.0;
const RMS_OF_NOISE: f64 = 0.03;
const MEAN_MM: f64 = 0.04;
const P95_MM: f64 = 0.09;
const NORMAL_P95_DEG: f64 = 0.2;
const NORMAL_MAX_DEG: f64 = 0.7;
const WHITE_MEAN_MM: f64 = 0.004;
const WHITE_NORMAL_P95_DEG: f64 = 0.06;
/// Maximum number of seeds with only white noise.
const WHITE_SEEDS: u64 = 5;
/// Number of fits of one scan, of which the median time is used.
const RUNS: usize = 5;

pub fn measure(seeds: u64) -> usize {
    let all = over(seeds, "all noise", Scanned::upright);
    let white = over(seeds.min(WHITE_SEEDS), "white noise alone", Scanned::white);
    most(Figure("surface: distance to the true surface, mean"), all.mean_mm, MEAN_MM, " mm");
    most(Figure("surface: distance to the true surface, 95 %"), all.p95_mm, P95_MM, " mm");
    most(Figure("surface: angle to the true normal, 95 %"), all.normal_p95_deg, NORMAL_P95_DEG, "°");
    most(Figure("surface: angle to the true normal, largest"), all.normal_max_deg, NORMAL_MAX_DEG, "°");
    held_time("time of a fit of 300,000 points, median over seeds", &all.fit, FIT_MS)
        + held(
            "residual rms off the white noise, worst seed with white noise alone",
            white.rms_off,
            RMS_OF_NOISE,
            "",
        )
        + held("residual rms off the white noise, worst seed with all noise", all.rms_off, RMS_OF_NOISE, "")
        + held("distance to the true surface, mean", all.mean_mm, MEAN_MM, "mm")
        + held("distance to the true surface, 95 %", all.p95_mm, P95_MM, "mm")
        + held("angle to the true normal, 95 %", all.normal_p95_deg, NORMAL_P95_DEG, "°")
        + held("angle to the true normal, largest", all.normal_max_deg, NORMAL_MAX_DEG, "°")
        + held("distance with white noise alone, mean", white.mean_mm, WHITE_MEAN_MM, "mm")
        + held("normals with white noise alone, 95 %", white.normal_p95_deg, WHITE_NORMAL_P95_DEG, "°")
}

struct Found {
    fit: Timed,
    rms_off: f64,
    mean_mm: f64,
    p95_mm: f64,
    normal_p95_deg: f64,
    normal_max_deg: f64,
}

fn over(seeds: u64, what: &str, scanned: impl Fn(u64) -> Scanned) -> Found {
    println!("   {what}");
    println!("   seed  points   fit ms   rms mm  white mm  λ      mean mm  p95 mm  normal p95 °  largest °");
    let (mut distances, mut angles, mut times, mut rms_off) =
        (Vec::new(), Vec::new(), [const { Vec::new() }; 2], 0.0_f64);
    for seed in 1..=seeds {
        let scanned = scanned(seed);
        let Fit { surface, deviation: d, .. } =
            surface::fit(&scanned.panel, scanned.recipe.surface()).expect("a fit");
        let took = timed(RUNS, || surface::fit(&scanned.panel, scanned.recipe.surface()));
        let white_mm = scanned.white_mm();
        let (mut of_seed, mut turns) = against_truth(&scanned, &surface);
        println!(
            "   {seed:4}  {:6}  {:6.1}  {:7.4}  {white_mm:8.4}  {:.0e}  {:7.4}  {:6.4}  {:12.3}  {:9.3}",
            d.points,
            took.share_ms,
            d.rms_mm,
            d.smoothing,
            mean(&of_seed),
            share(&mut of_seed, 0.95),
            share(&mut turns, 0.95),
            share(&mut turns, 1.0)
        );
        let of_300k = 300_000.0 / d.points as f64;
        times[0].push(took.wall_ms * of_300k);
        times[1].push(took.share_ms * of_300k);
        rms_off = rms_off.max((d.rms_mm / white_mm - 1.0).abs());
        distances.extend(of_seed);
        angles.extend(turns);
    }
    Found {
        fit: Timed { wall_ms: share(&mut times[0], 0.5), share_ms: share(&mut times[1], 0.5) },
        rms_off,
        mean_mm: mean(&distances),
        p95_mm: share(&mut distances, 0.95),
        normal_p95_deg: share(&mut angles, 0.95),
        normal_max_deg: share(&mut angles, 1.0),
    }
}

fn against_truth(scanned: &Scanned, surface: &BSplineSurface) -> (Vec<f64>, Vec<f64>) {
    let truth = scanned.cell.truth();
    let (mut distances, mut angles) = (Vec::new(), Vec::new());
    for n in 0..101 * 101 {
        let at = Parameter { u: f64::from(n % 101) / 100.0, v: f64::from(n / 101) / 100.0 };
        let point = surface.point(at);
        distances.push(truth.distance_mm(point).abs());
        angles.push(surface.normal(at).expect("a normal").angle_between(truth.normal(point)).0);
    }
    (distances, angles)
}

fn mean(values: &[f64]) -> f64 {
    statistics::mean(values.iter().copied()).unwrap_or(0.0)
}

fn share(values: &mut [f64], share: f64) -> f64 {
    quantile(values, share, QuantileRank::Lower).expect("values")
}
