//! Compares the stated error with the real error for scanners whose smooth errors are correlated over short or long
//! distances: on panels of many shapes and on flat plates, with the results of `calibrate scanner` and with the
//! manufacturer's specification only.

use super::goal::Figure;
use super::{MAX_CORRECT_ERROR_MM, Tried, located_with, quantile, range_errors, reduction, row, share, taught};
use nalgebra::Translation3;
use panelprep::geometry::{Base, Camera, Rigid};
use panelprep::locate::RangeErrors;
use panelprep::panel::TaughtPanel;
use panelprep::recipe::Recipe;
use panelprep::sim::TrialScene;
use panelprep::verdict::Verdict;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::ops::RangeInclusive;

/// Correlation lengths of the smooth error, mm.
const CORRELATION_LENGTHS_MM: [f64; 4] = [30.0, 65.0, 120.0, 200.0];
/// Standard deviation of the simulator's smooth error, mm: 0.06 mm at the nodes of its lattice, 26/35 of this on
/// average.
const SMOOTH_ERROR_MM: f64 = 0.06 * 26.0 / 35.0;
/// Standard deviation of the relative scale error of a camera, which is common to all its scans.
const SCALE_DEVIATION: f64 = 0.000_5;
/// Standard deviation of the relative scale error that differs from scan to scan.
const SCALE_DEVIATION_BETWEEN_SCANS: f64 = 0.0001;
/// Range of the fraction of accepted poses whose error must be within the stated error. Below the range the stated
/// error is too small, above it too large.
const STATED_FRACTION_RANGE: RangeInclusive<f64> = 0.9..=1.0;

/// Runs each correlation length on both kinds of panel with these seeds, or only rows whose text contains the value of
/// the environment variable `CORRELATED`. Returns the number of missed targets.
pub fn errors(seeds: RangeInclusive<u64>) -> usize {
    let asked = std::env::var("CORRELATED").unwrap_or_default();
    let kinds: [(&str, fn(u64, usize) -> TrialScene); 2] =
        [("bent", TrialScene::good_scene), ("flat", TrialScene::flat_scene)];
    let (mut missed, mut least) = (0, [None; 2]);
    for (kind, trial) in kinds {
        for alike_mm in CORRELATION_LENGTHS_MM {
            let range = RangeErrors {
                correlation_mm: alike_mm,
                scan_to_scan_mm: std::f64::consts::SQRT_2 * SMOOTH_ERROR_MM,
                taught_scan_mm: 1.5 * SMOOTH_ERROR_MM,
                scale: 0.0,
                scan_to_scan_scale: 0.0,
                is_measured: true,
            };
            for (index, (words, range)) in
                [("measured", range), ("not measured", range_errors())].into_iter().enumerate()
            {
                let words = format!("{kind}, alike over {alike_mm} mm, {words}");
                if !words.contains(&asked) {
                    continue;
                }
                let trials = seeds.clone().map(|seed| {
                    let trial = trial(seed, reduction()).with_correlated_error(alike_mm);
                    let (taught, mount) = (taught(&trial), trial.base_from_camera());
                    (trial, taught, mount)
                });
                let found = stated(&words, trials, range);
                missed += found.missed;
                least[index] = Some(found.least(least[index]));
            }
        }
    }
    let [measured, not_measured] = least;
    reported(
        Figure("locate: smooth errors, least of four lengths, within the stated error, measured camera"),
        measured,
    );
    reported(Figure("locate: camera not measured"), not_measured);
    let scaled = |(kind, trial): (&str, fn(u64, usize) -> TrialScene)| match "distances off".contains(&asked) {
        true => scaled(kind, trial, &seeds),
        false => 0,
    };
    missed + kinds.into_iter().map(scaled).sum::<usize>()
}

/// Tests a camera that measures distances too long by a fraction that is the same in all its scans, and by a second
/// fraction that differs from scan to scan. Its mount was calibrated with the same camera at the panel's taught pose,
/// so the first fraction cancels at this pose.
fn scaled(kind: &str, trial: fn(u64, usize) -> TrialScene, seeds: &RangeInclusive<u64>) -> usize {
    let range = RangeErrors {
        scale: SCALE_DEVIATION,
        scan_to_scan_scale: SCALE_DEVIATION_BETWEEN_SCANS,
        is_measured: true,
        ..RangeErrors::default()
    };
    let trials = seeds.clone().map(|seed| {
        let mut random = Pcg64::seed_from_u64(seed);
        let shared = drawn(&mut random, SCALE_DEVIATION);
        let scale = [0, 1].map(|_| shared + drawn(&mut random, SCALE_DEVIATION_BETWEEN_SCANS));
        let trial = trial(seed, reduction()).with_scale_error(scale);
        let (panel, recipe) = taught(&trial);
        let centre = panel.panel_from_camera.inverse() * panel.centre();
        let shift: Rigid<Camera, Camera> =
            Rigid::from_isometry_unchecked(Translation3::from(-shared * centre.mm.coords).into());
        let mount = trial.base_from_camera() * shift;
        let panel = TaughtPanel::learn(&trial.taught_scan(), *trial.camera(), mount, &recipe).expect("a panel");
        (trial, (panel, recipe), mount)
    });
    let words = format!(
        "{kind}, distances off by {:.2} % in all scans and {:.2} % from scan to scan, measured",
        100.0 * SCALE_DEVIATION,
        100.0 * SCALE_DEVIATION_BETWEEN_SCANS
    );
    stated(&words, trials, range).missed
}

/// Draws a number with this standard deviation from a uniform distribution.
fn drawn(random: &mut Pcg64, deviation: f64) -> f64 {
    deviation * 3.0_f64.sqrt() * random.random_range(-1.0..1.0)
}

/// A trial, its panel as taught, and the camera's calibrated mount.
type Scanned = (TrialScene, (TaughtPanel, Recipe), Rigid<Base, Camera>);

/// Number of accepted scans of one row, and number of these within the stated error.
#[derive(Clone, Copy)]
struct Stated {
    missed: usize,
    kept: usize,
    accepted: usize,
}

impl Stated {
    /// Returns the row with the smaller fraction within the stated error; the fraction of a row without an accepted
    /// scan is the smallest.
    fn least(self, other: Option<Stated>) -> Stated {
        let within = |row: Stated| if row.accepted == 0 { 0.0 } else { share(row.kept, row.accepted) };
        other.filter(|other| within(*other) <= within(self)).unwrap_or(self)
    }
}

/// Reports the row with the smallest fraction; nothing if no row of its kind was requested.
fn reported(figure: Figure, least: Option<Stated>) {
    if let Some(Stated { kept, accepted, .. }) = least {
        super::shared(figure, kept, accepted, *STATED_FRACTION_RANGE.start());
    }
}

fn stated(words: &str, trials: impl Iterator<Item = Scanned>, range: RangeErrors) -> Stated {
    let (mut count, mut accepted, mut wrong, mut kept) = (0, 0, 0, 0);
    let (mut ratios, mut largest) = (Vec::new(), Vec::new());
    for (trial, taught, mount) in trials {
        count += 1;
        let Tried { judgement, fit, error, .. } = located_with(&trial, taught, (range, mount));
        let (Verdict::Accept, Some(fit), Some(error)) = (judgement.verdict, fit, error) else { continue };
        let error_mm = error.max_mm;
        accepted += 1;
        wrong += usize::from(error_mm > MAX_CORRECT_ERROR_MM && error_mm > 2.0 * fit.uncertainty_mm);
        kept += usize::from(error_mm <= fit.uncertainty_mm);
        ratios.push(error_mm / fit.uncertainty_mm);
        largest.push(error_mm);
    }
    let summary = format!(
        "{words}: {accepted} of {count} are accepted, {wrong} of them wrong, {kept} within what is stated ({:.1} %); error divided by stated error: median {:.2}, 95 % {:.2}, largest error {:.3} mm",
        100.0 * share(kept, accepted),
        quantile(&mut ratios, 0.5),
        quantile(&mut ratios, 0.95),
        quantile(&mut largest, 1.0)
    );
    Stated {
        missed: row(wrong == 0 && STATED_FRACTION_RANGE.contains(&share(kept, accepted)), &summary),
        kept,
        accepted,
    }
}
