//! Compares the localization with the renderer's ground truth: panels of many shapes anywhere in a search box, scenes
//! that must not be accepted, and wet verifications. Some of the scans are also processed by third-party libraries. All
//! scans have full size and the true calibration. `cargo bench --bench locate --
//! [good|bad|bows|held|teach|correlated|identify|wet|memory|peers]… [SEEDS|FIRST-LAST]`; `make bench-locate` sets up the peers
//! and names their Python in `PANELPREP_PEERS`.

use goal::Figure;
use panelprep::geometry::statistics::{self, QuantileRank};
use panelprep::geometry::{Base, Camera, Rigid};
use panelprep::locate::{Fit, LocateError, PreparedScan, RangeErrors, ScanView, TaughtModel, gate};
use panelprep::panel::TaughtPanel;
use panelprep::recipe::Recipe;
use panelprep::sim::{PlacementError, SceneDefect, TRIAL_BOX_MM, TrialScene};
use panelprep::verdict::{Judgement, Verdict};
use std::ops::RangeInclusive;
use std::process::ExitCode;
use std::time::Instant;

#[path = "locate/bows.rs"]
mod bows;
#[path = "locate/correlated.rs"]
mod correlated;
#[path = "goal.rs"]
mod goal;
#[path = "locate/held.rs"]
mod held;
#[path = "locate/identify.rs"]
mod identify;
#[path = "locate/memory.rs"]
mod memory;
#[path = "locate/peers.rs"]
mod peers;
#[path = "locate/plot.rs"]
mod plot;
#[path = "locate/teach.rs"]
mod teach;
#[path = "locate/wet.rs"]
mod wet;

/// Default number of seeds of the part `good`; the following constants are those of the other parts.
const GOOD_SEEDS: u64 = 200;
const BAD_SCENES: u64 = 714;
const BOW_SEEDS: u64 = 40;
const HELD_SEEDS: u64 = 25;
const CORRELATED_SEEDS: u64 = 25;
/// Scenes of each of the twenty panels.
const IDENTIFY_SCENES: u64 = 20;
const WET_SEEDS: u64 = 100;
const PEER_SCANS: u64 = 20;
/// Maximum error of an accepted pose that is correct, mm.
const MAX_CORRECT_ERROR_MM: f64 = 0.3;
const MIN_ACCEPTED_FRACTION: f64 = 0.99;
/// Minimum accepted fraction of all panels, including those whose visible surface and outline do not determine the pose
/// well enough.
const MIN_ACCEPTED_FRACTION_OF_ALL: f64 = 0.97;
const LARGE_MM: [f64; 2] = [250.0, 180.0];
const LITTLE_HIDDEN: f64 = 0.05;
const MEAN_MM: f64 = 0.07;
const MAX_MM: f64 = 0.15;
const LARGE_SHARE: f64 = 0.95;
const MIN_STATED_FRACTION: f64 = 0.9;
const STATED_MM: f64 = gate::MAX_UNCERTAINTY_MM;
const VERDICT_MS: f64 = 300.0;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if let [word, folder] = &words[..]
        && word == memory::SEPARATE_PROCESS_ARGUMENT
    {
        memory::run_separate_process(std::path::Path::new(folder));
        return ExitCode::SUCCESS;
    }
    let seeds = |usual: u64| words.iter().find_map(|word| range(word)).unwrap_or(1..=usual);
    let parts = || words.iter().filter(|word| range(word).is_none() && !word.starts_with('-'));
    let asked = |part: &str| parts().count() == 0 || parts().any(|word| word == part);
    let mut missed = 0;
    if asked("good") {
        missed += good(seeds(GOOD_SEEDS));
    }
    if asked("bad") {
        missed += bad(seeds(BAD_SCENES));
    }
    if asked("bows") {
        missed += bows::panels(seeds(BOW_SEEDS));
    }
    if asked("held") {
        missed += held::scenes(seeds(HELD_SEEDS));
    }
    if asked("teach") {
        missed += teach::panels(seeds(HELD_SEEDS));
    }
    if asked("correlated") {
        missed += correlated::errors(seeds(CORRELATED_SEEDS));
    }
    if asked("identify") {
        missed += identify::panels(seeds(IDENTIFY_SCENES));
    }
    if asked("wet") {
        missed += wet::verifications(seeds(WET_SEEDS));
    }
    if asked("memory") {
        missed += memory::measure_memory();
    }
    if asked("peers") {
        peers::compared(seeds(PEER_SCANS));
    }
    println!("{missed} floors were missed");
    if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Parses a range of seeds: `20` means the seeds from 1 to 20, `7-9` and `seeds=7-9` those from 7 to 9.
fn range(word: &str) -> Option<RangeInclusive<u64>> {
    let word = word.strip_prefix("seeds=").unwrap_or(word);
    match word.split_once('-') {
        Some((first, last)) => Some(first.parse().ok()?..=last.parse().ok()?),
        None => Some(1..=word.parse().ok()?),
    }
}

/// Returns the factor by which pictures are smaller than real ones; 1 unless a quick run is requested.
fn reduction() -> usize {
    std::env::var("PANELPREP_REDUCTION").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

struct Tried {
    judgement: Judgement,
    fit: Option<Fit>,
    error: Option<PlacementError>,
    elapsed_ms: f64,
}

/// Returns the recipe of a trial, with additional keys of its panel.
fn recipe(trial: &TrialScene, keys: &str) -> Recipe {
    named_recipe(trial, "trial", keys)
}

fn named_recipe(trial: &TrialScene, name: &str, keys: &str) -> Recipe {
    let corners = trial.region_px().map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = TRIAL_BOX_MM;
    let text = format!(
        "panel = {{ name = \"{name}\"{keys} }}\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\nmax_shift_mm = 900.0\n\
         turn_limit_deg = 180.0\nmax_tilt_deg = 35.0\n\
         [region]\ncorners_px = {corners:?}\nrows = 2\ncolumns = 3\n"
    );
    Recipe::check("bench.toml", &text).expect("a valid recipe")
}

fn taught(trial: &TrialScene) -> (TaughtPanel, Recipe) {
    let recipe = recipe(trial, "");
    let scan = trial.taught_scan();
    let panel = TaughtPanel::learn(&scan, *trial.camera(), trial.base_from_camera(), &recipe).expect("a panel");
    (panel, recipe)
}

fn tried(trial: &TrialScene) -> Tried {
    located(trial, taught(trial))
}

/// Runs a trial with additional keys of the recipe's panel. If the panel cannot be taught, prints the reason and
/// returns `None`.
fn tried_with(trial: &TrialScene, keys: &str) -> Option<Tried> {
    let recipe = recipe(trial, keys);
    match TaughtPanel::learn(&trial.taught_scan(), *trial.camera(), trial.base_from_camera(), &recipe) {
        Ok(panel) => Some(located(trial, (panel, recipe))),
        Err(error) => {
            println!("not taught: {error}");
            None
        }
    }
}

fn located(trial: &TrialScene, taught: (TaughtPanel, Recipe)) -> Tried {
    located_with(trial, taught, (range_errors(), trial.base_from_camera()))
}

/// Returns the range errors that are assumed for a camera that was not measured, except for a scale error of zero,
/// because the camera has its true calibration.
fn range_errors() -> RangeErrors {
    RangeErrors { scale: 0.0, ..RangeErrors::default() }
}

/// Locates a trial's panel with these known errors of the scans and this known mount of the camera.
fn located_with(
    trial: &TrialScene,
    (panel, recipe): (TaughtPanel, Recipe),
    (range, base_from_camera): (RangeErrors, Rigid<Base, Camera>),
) -> Tried {
    let scan = trial.scan();
    let view = ScanView { scan: &scan, camera: trial.camera(), base_from_camera, range };
    let model = TaughtModel::from_panel(&panel, range);
    let begun = Instant::now();
    let model = model.as_ref().map_err(LocateError::clone);
    let found = model.and_then(|model| PreparedScan::new((&panel, model), &view, recipe.locate()).locate());
    let judgement = match &found {
        Ok(fit) => gate::judge(fit, &recipe),
        Err(error) => gate::refusal(error),
    };
    let elapsed_ms = begun.elapsed().as_secs_f64() * 1e3;
    let fit = found.ok();
    let error = fit.as_ref().map(|fit| trial.error_mm(&fit.base_from_panel));
    Tried { judgement, fit, error, elapsed_ms }
}

fn words(judgement: &Judgement) -> String {
    judgement.reasons.iter().map(|reason| reason.message.as_str()).collect::<Vec<_>>().join("; ")
}

fn share(part: usize, whole: usize) -> f64 {
    if whole == 0 { 1.0 } else { part as f64 / whole as f64 }
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    statistics::quantile(values, share, QuantileRank::Nearest).unwrap_or(f64::NAN)
}

/// Reports the fraction of a number of cases, with its minimum.
fn shared(figure: Figure, part: usize, whole: usize, least: f64) {
    let found = format!("{part} of {whole}");
    figure.report(&format!("{} %", 100.0 * least), &found, whole > 0 && share(part, whole) >= least);
}

fn row(good: bool, words: &str) -> usize {
    println!("{:6} {words}", if good { "ok" } else { "MISSED" });
    usize::from(!good)
}

/// Tests scenes in which the panel must be found.
fn good(seeds: RangeInclusive<u64>) -> usize {
    println!("seed  size mm  hidden  verdict  mean mm  max mm  stated mm  weakest  rms mm  outline px  ms");
    let (mut accepted, mut known, mut wrong, mut times) = (0, 0, 0, Vec::new());
    let (mut large, mut large_good, mut others, mut stated, mut too_much) = (0, 0, 0, 0, 0);
    let (mut means, mut largest) = (Vec::new(), Vec::new());
    let count = seeds.clone().count();
    for seed in seeds {
        let trial = TrialScene::good_scene(seed, reduction());
        let tried = tried(&trial);
        let [length, width] = trial.size_mm();
        times.push(tried.elapsed_ms);
        let (Some(fit), Some(error)) = (&tried.fit, tried.error) else {
            // A panel that was not found is treated as one that should have been accepted.
            known += 1;
            println!(
                "{seed:4}  {length:.0}×{width:.0}  {:.2}  not found: {}",
                trial.hidden_fraction(),
                words(&tried.judgement)
            );
            continue;
        };
        println!(
            "{seed:4}  {length:.0}×{width:.0}  {:.2}  {:6}  {:.3}  {:.3}  {:.3}  {:?}  {:.3}  {:.2}  {:.0}  {}",
            trial.hidden_fraction(),
            tried.judgement.verdict.keyword(),
            error.mean_mm,
            error.max_mm,
            fit.uncertainty_mm,
            fit.weakest_direction,
            fit.rms_mm,
            fit.outline_rms_px,
            tried.elapsed_ms,
            words(&tried.judgement)
        );
        known += usize::from(fit.uncertainty_mm <= STATED_MM);
        if tried.judgement.verdict != Verdict::Accept {
            continue;
        }
        accepted += 1;
        wrong += usize::from(error.max_mm > MAX_CORRECT_ERROR_MM);
        if length >= LARGE_MM[0] && width >= LARGE_MM[1] && trial.hidden_fraction() <= LITTLE_HIDDEN {
            large += 1;
            large_good += usize::from(error.mean_mm <= MEAN_MM && error.max_mm <= MAX_MM);
            means.push(error.mean_mm);
            largest.push(error.max_mm);
        } else {
            others += 1;
            stated += usize::from(error.max_mm <= fit.uncertainty_mm);
            too_much += usize::from(fit.uncertainty_mm > STATED_MM);
        }
    }
    let median_ms = quantile(&mut times, 0.5);
    println!(
        "large and hardly hidden: mean error, median {:.3} mm, {:.3} mm at 95 %; largest {:.3} and {:.3} mm",
        quantile(&mut means, 0.5),
        quantile(&mut means, 0.95),
        quantile(&mut largest, 0.5),
        quantile(&mut largest, 0.95)
    );
    shared(Figure("locate: good scans accepted, of all"), accepted, count, MIN_ACCEPTED_FRACTION_OF_ALL);
    shared(
        Figure("locate: of those that their covariance knows well enough"),
        accepted,
        known,
        MIN_ACCEPTED_FRACTION,
    );
    let found = format!("{wrong} of {accepted}");
    Figure("locate: accepted poses with more than 0.3 mm error").report("0", &found, wrong == 0 && accepted > 0);
    let within = Figure("locate: within 0.07 mm on average and 0.15 mm at most, large panels");
    shared(within, large_good, large, LARGE_SHARE);
    shared(Figure("locate: within the stated error, others"), stated, others, MIN_STATED_FRACTION);
    let (goal, found) = (format!("{VERDICT_MS} ms"), format!("{median_ms:.0} ms"));
    Figure("locate: scan in memory to verdict, median").report(&goal, &found, median_ms <= VERDICT_MS);
    row(
        wrong == 0,
        &format!("{wrong} of {accepted} accepted poses are wrong by more than {MAX_CORRECT_ERROR_MM} mm"),
    ) + row(
        share(accepted, known) >= MIN_ACCEPTED_FRACTION,
        &format!("{accepted} of {known} good scans that their own covariance knows to {STATED_MM} mm are accepted"),
    ) + row(
        share(accepted, count) >= MIN_ACCEPTED_FRACTION_OF_ALL,
        &format!("{accepted} of {count} good scans are accepted"),
    ) + row(
        share(large_good, large) >= LARGE_SHARE,
        &format!("{large_good} of {large} large panels within {MEAN_MM} mm on average and {MAX_MM} mm at most"),
    ) + row(
        share(stated, others) >= MIN_STATED_FRACTION && too_much == 0,
        &format!("{stated} of {others} others within what is stated; {too_much} state more than {STATED_MM} mm"),
    ) + row(median_ms <= VERDICT_MS, &format!("scan in memory to verdict: median {median_ms:.0} ms"))
}

/// Tests scenes that must not be accepted, one scene of each kind in turn.
fn bad(scenes: RangeInclusive<u64>) -> usize {
    let kinds = SceneDefect::ALL.len() as u64;
    let count = scenes.clone().count();
    let (mut wrongly, mut table) = (0, vec![[0usize; 3]; SceneDefect::ALL.len()]);
    for scene in scenes.map(|scene| scene - 1) {
        let (kind, seed) = ((scene % kinds) as usize, 1 + scene / kinds);
        let trial = TrialScene::defective_scene(seed, SceneDefect::ALL[kind], reduction());
        let tried = tried(&trial);
        let at = match tried.judgement.verdict {
            Verdict::Accept => 0,
            Verdict::Review => 1,
            _ => 2,
        };
        table[kind][at] += 1;
        // Finding the taught panel at its true pose is not an error; accepting another kind of panel is.
        let other = !matches!(
            SceneDefect::ALL[kind],
            SceneDefect::Hidden
                | SceneDefect::OutOfView
                | SceneDefect::CameraMoved
                | SceneDefect::Wet
                | SceneDefect::Smeared
                | SceneDefect::HolderMoved
                | SceneDefect::Bent
                | SceneDefect::Warped
        );
        // The correct pose of a bent panel is the one at which the taught panel fits it best. Along the panel's normal,
        // the measured surface follows the bend.
        let error_mm = match SceneDefect::ALL[kind] {
            SceneDefect::Bent | SceneDefect::Warped => {
                tried.fit.as_ref().and_then(|fit| trial.max_point_distance_mm(&fit.base_from_panel))
            }
            _ => tried.error.map(|error| error.max_mm),
        };
        let off = error_mm.is_some_and(|error_mm| error_mm > MAX_CORRECT_ERROR_MM);
        if at == 0 && (other || off) {
            wrongly += 1;
            let error_mm = error_mm.unwrap_or(f64::NAN);
            println!("seed {seed}, {}: accepted, {error_mm:.3} mm off", SceneDefect::ALL[kind].describe());
        }
    }
    println!("kind                    accept  review  reject");
    for (kind, [accept, review, reject]) in SceneDefect::ALL.iter().zip(&table) {
        println!("{:22}  {accept:6}  {review:6}  {reject:6}", kind.describe());
    }
    let found = format!("{wrongly} of {count}");
    Figure("locate: wrong scenes that were accepted").report("0", &found, wrongly == 0 && count > 0);
    row(wrongly == 0, &format!("{wrongly} of {count} bad scenes of {kinds} kinds are wrongly accepted"))
}
