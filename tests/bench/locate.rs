//! Localization against the renderer's truth: panels of many shapes anywhere in a search box, scenes that must not be
//! accepted, wet verifications, and some of the scans through the libraries that others use. All at full size and with the
//! true calibration. `cargo bench --bench locate -- [good|bad|wet|peers] [SEEDS]`; `make bench-locate` sets up the peers
//! and names their Python in `PANELPREP_PEERS`.

use panelprep::geometry::{Base, Camera, OrganizedCloud, Panel, Rigid};
use panelprep::locate::{self, Fit, View, gate, thesis_icp};
use panelprep::panel::TaughtPanel;
use panelprep::recipe::Recipe;
use panelprep::sim::{PlacementError, TRIAL_BOX_MM, Trial, Wrong};
use panelprep::verdict::{Judgement, Verdict};
use std::fmt::Write as _;
use std::process::{Command, ExitCode};
use std::time::Instant;

#[path = "locate/plot.rs"]
mod plot;
#[path = "locate/wet.rs"]
mod wet;

/// Seeds of a part unless the command line says otherwise.
const GOOD_SEEDS: u64 = 200;
const BAD_SCENES: u64 = 500;
const WET_SEEDS: u64 = 100;
const PEER_SCANS: u64 = 20;
/// What must be reached.
const RIGHT_MM: f64 = 0.3;
const ACCEPTED: f64 = 0.99;
const LARGE_MM: [f64; 2] = [250.0, 180.0];
const LITTLE_HIDDEN: f64 = 0.05;
const MEAN_MM: f64 = 0.07;
const LARGEST_MM: f64 = 0.15;
const LARGE_SHARE: f64 = 0.95;
const STATED_SHARE: f64 = 0.9;
const STATED_MM: f64 = 0.25;
const VERDICT_MS: f64 = 300.0;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let seeds = words.iter().find_map(|word| word.parse::<u64>().ok());
    let asked = |part: &str| {
        words.iter().all(|word| word.parse::<u64>().is_ok() || word.starts_with('-'))
            || words.iter().any(|word| word == part)
    };
    let mut missed = 0;
    if asked("good") {
        missed += good(seeds.unwrap_or(GOOD_SEEDS));
    }
    if asked("bad") {
        missed += bad(seeds.unwrap_or(BAD_SCENES));
    }
    if asked("wet") {
        missed += wet::verifications(seeds.unwrap_or(WET_SEEDS));
    }
    if asked("peers") {
        peers(seeds.unwrap_or(PEER_SCANS));
    }
    println!("{missed} floors were missed");
    if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// How many times smaller than the real ones pictures are; 1 unless a quick look is wanted.
fn reduction() -> usize {
    std::env::var("PANELPREP_REDUCTION").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

struct Tried {
    judgement: Judgement,
    fit: Option<Fit>,
    error: Option<PlacementError>,
    elapsed_ms: f64,
}

fn recipe(trial: &Trial) -> Recipe {
    let corners = trial.region_px().map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = TRIAL_BOX_MM;
    let text = format!(
        "panel = \"trial\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\nmax_shift_mm = 900.0\n\
         turn_limit_deg = 180.0\nmax_tilt_deg = 35.0\n\
         [region]\ncorners_px = {corners:?}\nrows = 1\ncolumns = 1\n"
    );
    Recipe::check("bench.toml", &text).expect("a valid recipe")
}

fn taught(trial: &Trial) -> (TaughtPanel, Recipe) {
    let recipe = recipe(trial);
    let scan = trial.taught_scan();
    let panel = TaughtPanel::learn(&scan, *trial.camera(), trial.base_from_camera(), &recipe).expect("a panel");
    (panel, recipe)
}

fn tried(trial: &Trial) -> Tried {
    let (panel, recipe) = taught(trial);
    let scan = trial.scan();
    let view = View { scan: &scan, camera: trial.camera(), base_from_camera: trial.base_from_camera() };
    let begun = Instant::now();
    let found = locate::locate(&panel, &view, recipe.locate());
    let judgement = match &found {
        Ok(fit) => gate::judge(fit, recipe.locate()),
        Err(error) => gate::refusal(error),
    };
    let elapsed_ms = begun.elapsed().as_secs_f64() * 1e3;
    let fit = found.ok();
    let error = fit.as_ref().map(|fit| trial.error_mm(&fit.base_from_panel));
    Tried { judgement, fit, error, elapsed_ms }
}

fn codes(judgement: &Judgement) -> String {
    judgement.reasons.iter().map(|reason| reason.code.as_ref()).collect::<Vec<_>>().join(", ")
}

fn share(part: usize, whole: usize) -> f64 {
    if whole == 0 { 1.0 } else { part as f64 / whole as f64 }
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(((values.len().max(1) - 1) as f64 * share).round() as usize).copied().unwrap_or(f64::NAN)
}

fn row(good: bool, words: &str) -> usize {
    println!("{:6} {words}", if good { "ok" } else { "MISSED" });
    usize::from(!good)
}

/// Scenes that must be found.
fn good(seeds: u64) -> usize {
    println!("seed  size mm  hidden  verdict  mean mm  max mm  stated mm  weakest  rms mm  outline px  ms");
    let (mut accepted, mut wrong, mut times) = (0, 0, Vec::new());
    let (mut large, mut large_good, mut others, mut stated, mut too_much) = (0, 0, 0, 0, 0);
    let (mut means, mut largest) = (Vec::new(), Vec::new());
    for seed in 1..=seeds {
        let trial = Trial::good(seed, reduction());
        let tried = tried(&trial);
        let [length, width] = trial.size_mm();
        times.push(tried.elapsed_ms);
        let (Some(fit), Some(error)) = (&tried.fit, tried.error) else {
            println!(
                "{seed:4}  {length:.0}×{width:.0}  {:.2}  not found: {}",
                trial.hidden(),
                codes(&tried.judgement)
            );
            continue;
        };
        println!(
            "{seed:4}  {length:.0}×{width:.0}  {:.2}  {:6}  {:.3}  {:.3}  {:.3}  {:?}  {:.3}  {:.2}  {:.0}  {}",
            trial.hidden(),
            tried.judgement.verdict.word(),
            error.mean_mm,
            error.max_mm,
            fit.uncertainty_mm,
            fit.weakest,
            fit.rms_mm,
            fit.outline_rms_px,
            tried.elapsed_ms,
            codes(&tried.judgement)
        );
        if tried.judgement.verdict != Verdict::Accept {
            continue;
        }
        accepted += 1;
        wrong += usize::from(error.max_mm > RIGHT_MM);
        if length >= LARGE_MM[0] && width >= LARGE_MM[1] && trial.hidden() <= LITTLE_HIDDEN {
            large += 1;
            large_good += usize::from(error.mean_mm <= MEAN_MM && error.max_mm <= LARGEST_MM);
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
        "large and hardly hidden: mean error {:.3} mm in the middle, {:.3} mm at 95 %; largest {:.3} and {:.3} mm",
        quantile(&mut means, 0.5),
        quantile(&mut means, 0.95),
        quantile(&mut largest, 0.5),
        quantile(&mut largest, 0.95)
    );
    row(wrong == 0, &format!("{wrong} of {accepted} accepted poses are wrong by more than {RIGHT_MM} mm"))
        + row(
            share(accepted, seeds as usize) >= ACCEPTED,
            &format!("{accepted} of {seeds} good scans are accepted"),
        )
        + row(
            share(large_good, large) >= LARGE_SHARE,
            &format!(
                "{large_good} of {large} large panels within {MEAN_MM} mm on average and {LARGEST_MM} mm at most"
            ),
        )
        + row(
            share(stated, others) >= STATED_SHARE && too_much == 0,
            &format!(
                "{stated} of {others} others within what is stated; {too_much} state more than {STATED_MM} mm"
            ),
        )
        + row(median_ms <= VERDICT_MS, &format!("scan in memory to verdict {median_ms:.0} ms in the middle"))
}

/// Scenes that must not be accepted, in turn of each kind.
fn bad(scenes: u64) -> usize {
    let kinds = Wrong::ALL.len() as u64;
    let (mut wrongly, mut table) = (0, vec![[0usize; 3]; Wrong::ALL.len()]);
    for scene in 0..scenes {
        let (kind, seed) = ((scene % kinds) as usize, 1 + scene / kinds);
        let trial = Trial::bad(seed, Wrong::ALL[kind], reduction());
        let tried = tried(&trial);
        let at = match tried.judgement.verdict {
            Verdict::Accept => 0,
            Verdict::Review => 1,
            _ => 2,
        };
        table[kind][at] += 1;
        // What is the taught panel after all, and found where it stands, is not wrong: another kind of panel is.
        let other = !matches!(
            Wrong::ALL[kind],
            Wrong::Hidden | Wrong::OutOfView | Wrong::CameraMoved | Wrong::Wet | Wrong::Smeared
        );
        let off = tried.error.is_some_and(|error| error.max_mm > RIGHT_MM);
        if at == 0 && (other || off) {
            wrongly += 1;
            println!("seed {seed}, {}: accepted, {:?}", Wrong::ALL[kind].words(), tried.error);
        }
    }
    println!("kind                    accept  review  reject");
    for (kind, [accept, review, reject]) in Wrong::ALL.iter().zip(&table) {
        println!("{:22}  {accept:6}  {review:6}  {reject:6}", kind.words());
    }
    row(wrongly == 0, &format!("{wrongly} of {scenes} bad scenes of {kinds} kinds are wrongly accepted"))
}

/// The same scans through this program, the thesis's method and the libraries of others.
fn peers(scans: u64) {
    let mut runs: Vec<plot::Run> = Vec::new();
    let folder = std::env::temp_dir().join(format!("panelprep-locate-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for passing files");
    for seed in 1..=scans {
        let trial = Trial::good(seed, reduction());
        let tried = tried(&trial);
        if let Some(error) = tried.error {
            runs.push(plot::Run {
                method: "panelprep".to_owned(),
                seed,
                ms: tried.elapsed_ms,
                error_mm: error.mean_mm,
            });
        }
        let (panel, _) = taught(&trial);
        let (source, target) = clouds(&trial, &panel);
        let begun = Instant::now();
        let points = |points: &[[f64; 3]], every: usize| points.iter().step_by(every).copied().collect::<Vec<_>>();
        let on_panel =
            points(&source, 20).into_iter().map(|[x, y, z]| panelprep::geometry::Point::<Panel>::at(x, y, z));
        let scanned =
            points(&target, 8).into_iter().map(|[x, y, z]| panelprep::geometry::Point::<Base>::at(x, y, z));
        let start = near(&trial);
        let found = thesis_icp(&on_panel.collect::<Vec<_>>(), &scanned.collect::<Vec<_>>(), start);
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        let error_mm = trial.error_mm(&found).mean_mm;
        runs.push(plot::Run { method: "thesis ICP, ours".to_owned(), seed, ms, error_mm });
        let text = serde_json::json!({"source": source, "target": target, "start": numbers(&start)});
        std::fs::write(folder.join(format!("{seed}.json")), text.to_string()).expect("written");
    }
    match std::env::var("PANELPREP_PEERS") {
        Ok(python) => runs.extend(of_peers(&python, &folder, scans)),
        Err(_) => println!("peers: not run; `make bench-locate` sets them up"),
    }
    // Best effort: what stays behind is in the system's own folder for such things.
    let _ = std::fs::remove_dir_all(&folder);
    println!("method                          scans  error mm: median  largest   right  ms: median");
    for method in plot::methods(&runs) {
        let of: Vec<&plot::Run> = runs.iter().filter(|run| run.method == method).collect();
        let mut errors: Vec<f64> = of.iter().map(|run| run.error_mm).collect();
        let mut ms: Vec<f64> = of.iter().map(|run| run.ms).collect();
        let right = errors.iter().filter(|&&mm| mm <= RIGHT_MM).count();
        println!(
            "{method:30}  {:5}  {:16.3}  {:7.2}  {right:6}  {:10.0}",
            of.len(),
            quantile(&mut errors, 0.5),
            quantile(&mut errors, 1.0),
            quantile(&mut ms, 0.5)
        );
    }
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/target/bench-locate.svg");
    std::fs::write(file, plot::svg(&runs)).expect("written");
    println!("error against time: target/bench-locate.svg");
}

/// The taught panel's points, and the scan's in the search box; mm, in panel and base.
fn clouds(trial: &Trial, panel: &TaughtPanel) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let source = panel.points().map(|(_, point)| point.mm.coords.into()).collect();
    let scan: OrganizedCloud<Camera> = trial.scan();
    let base_from_camera = trial.base_from_camera();
    let [low, high] = TRIAL_BOX_MM;
    let in_box = |p: &[f64; 3]| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&p[axis]));
    let target = scan
        .valid()
        .map(|(_, point)| <[f64; 3]>::from((base_from_camera * point).mm.coords))
        .filter(in_box)
        .collect();
    (source, target)
}

/// A start for methods that need one: the true place, 10 mm and 3° off.
fn near(trial: &Trial) -> Rigid<Base, Panel> {
    let turn = nalgebra::Vector3::new(0.04, 0.025, -0.02);
    let centre = trial.base_from_panel().isometry() * nalgebra::Point3::new(560.0, 0.0, 360.0);
    let rotation = nalgebra::UnitQuaternion::from_scaled_axis(turn);
    let shift = centre.coords + nalgebra::Vector3::new(2.0, 8.0, -5.0) - rotation * centre.coords;
    let off: Rigid<Base, Base> = Rigid::claim(nalgebra::Isometry3::from_parts(shift.into(), rotation));
    off * trial.base_from_panel()
}

fn numbers(rigid: &Rigid<Base, Panel>) -> Vec<f64> {
    rigid.isometry().to_homogeneous().transpose().as_slice().to_vec()
}

fn of_peers(python: &str, folder: &std::path::Path, scans: u64) -> Vec<plot::Run> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bench/locate/peers.py");
    let mut runs = Vec::new();
    for seed in 1..=scans {
        let trial = Trial::good(seed, reduction());
        let output = Command::new(python).arg(script).arg(folder.join(format!("{seed}.json"))).output();
        let Ok(output) = output else {
            println!("peers did not start");
            return runs;
        };
        let text = String::from_utf8_lossy(&output.stdout);
        let Some(found) = text.lines().last().and_then(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        else {
            println!("peers failed on seed {seed}: {}", String::from_utf8_lossy(&output.stderr));
            continue;
        };
        for (method, result) in found.as_object().into_iter().flatten() {
            let row: Vec<f64> = serde_json::from_value(result["pose"].clone()).unwrap_or_default();
            if row.len() != 16 {
                println!("{method} failed on seed {seed}: {}", result["error"]);
                continue;
            }
            let matrix = nalgebra::Matrix4::from_row_slice(&row);
            let rotation = nalgebra::Rotation3::from_matrix(&matrix.fixed_view::<3, 3>(0, 0).into_owned());
            let shift = nalgebra::Translation3::from(matrix.fixed_view::<3, 1>(0, 3).into_owned());
            let pose = Rigid::claim(nalgebra::Isometry3::from_parts(shift, rotation.into()));
            let error_mm = trial.error_mm(&pose).mean_mm;
            runs.push(plot::Run {
                method: method.clone(),
                seed,
                ms: result["ms"].as_f64().unwrap_or(f64::NAN),
                error_mm,
            });
        }
    }
    runs
}

/// A table's text, for the plot's title.
fn title(runs: &[plot::Run]) -> String {
    let mut text = String::new();
    let scans = runs.iter().map(|run| run.seed).max().unwrap_or(0);
    let _ = write!(text, "{scans} scans, mean error over the panel against time");
    text
}
