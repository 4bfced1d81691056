//! Panels that have been bent to bows and waves after they were taught. Measures whether such a panel is accepted, and
//! whether the path on today's surface lies on the true surface within the stated error. One third of the panels have a
//! camera that measures distances too long or too short, of which only the manufacturer's specification is known. Far
//! from the taught pose a person must decide on such a pose, whether the panel is bent or not.

use super::goal::Figure;
use super::{MAX_CORRECT_ERROR_MM, Tried, located_with, quantile, range_errors, reduction, row, share, shared};
use nalgebra::Translation3;
use panelprep::geometry::{Base, Camera, Rigid};
use panelprep::locate::RangeErrors;
use panelprep::panel::TaughtPanel;
use panelprep::recipe::Recipe;
use panelprep::sim::{PanelBend, TRIAL_BOX_MM, TrialScene};
use panelprep::surface::{self, Parameter};
use panelprep::verdict::Verdict;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::ops::RangeInclusive;
use std::time::Instant;

/// Number of bent panels for each seed.
const PANELS: usize = 3;
/// Range of the height of a bow over the panel's length, mm.
const BOW_RANGE_MM: [f64; 2] = [0.2, 3.0];
/// Range of the amplitude of a wave, mm.
const WAVE_RANGE_MM: [f64; 2] = [0.05, 0.3];
/// Range of the wavelength of a wave, mm.
const WAVELENGTH_RANGE_MM: [f64; 2] = [100.0, 800.0];
/// Range of the scale factor of the camera's distances.
const SCALE_RANGE: [f64; 2] = [0.999, 1.002];
/// The fraction of the panel's length and width that the region covers.
const REGION_FRACTION: f64 = 0.54;
/// Number of points along each side of the region at which the path's surface is compared with the true surface.
const PLACES: usize = 25;
/// Maximum bow of the panels to which the target `MIN_ACCEPTED_FRACTION` applies, mm.
const MAX_ACCEPTED_BOW_MM: f64 = 2.0;
/// Minimum accepted fraction of these panels.
const MIN_ACCEPTED_FRACTION: f64 = 0.95;
/// Minimum fraction of accepted panels whose path is within the stated error.
const MIN_STATED_FRACTION: f64 = 0.9;
/// Maximum distance between the path's surface and the true surface, mm.
const MAX_CONTACT_ERROR_MM: f64 = 0.15;
/// The default of `[surface] max_hole_mm`.
const MAX_HOLE_MM: f64 = 12.0;
const BOTH_MS: f64 = 120.0;

/// The results for a bent panel.
struct Found {
    bend: PanelBend,
    /// Whether the camera's scale is wrong.
    is_scaled: bool,
    tried: Tried,
    /// Mean and largest distance between the path's surface and the true surface, mm; `None` without a surface.
    contact_mm: Option<[f64; 2]>,
    /// Side of the largest square of the region that the scan does not show, mm.
    hole_mm: f64,
    /// Error of the pose in the panel's plane, mm.
    aside_mm: Option<f64>,
    fit_ms: f64,
}

/// Locates the panels of these seeds; returns the number of missed targets.
pub fn panels(seeds: RangeInclusive<u64>) -> usize {
    println!(
        "seed  bow mm  wave mm  length mm  scale  verdict  bend mm  rms mm  outline px  contact mm  hole mm  aside mm  stated mm  ms"
    );
    let mut all = Vec::new();
    for seed in seeds {
        let mut random = Pcg64::seed_from_u64(seed);
        let scaled = between(&mut random, SCALE_RANGE) - 1.0;
        for (scale, range, count) in [(0.0, range_errors(), PANELS - 1), (scaled, RangeErrors::default(), 1)] {
            let trial = TrialScene::good_scene(seed, reduction()).with_scale_error([scale; 2]);
            let (panel, recipe, mount) = taught(&trial, scale);
            let Ok(fit) = surface::fit(&panel, recipe.surface()) else {
                println!("{seed:4}  no surface was taught");
                continue;
            };
            for _ in 0..count {
                let bend = drawn(&mut random, &trial);
                let found = found(&trial.clone().with_bend(bend), bend, (&panel, &recipe, &fit), (range, mount));
                println!("{seed:4}  {scale:+.4}  {}", words(&found));
                all.push(found);
            }
        }
    }
    judged(&all)
}

fn between(random: &mut Pcg64, [low, high]: [f64; 2]) -> f64 {
    random.random_range(low..high)
}

fn drawn(random: &mut Pcg64, trial: &TrialScene) -> PanelBend {
    let sign = if random.random::<bool>() { 1.0 } else { -1.0 };
    let turn = [0.0, std::f64::consts::TAU];
    PanelBend {
        bow_mm: sign * between(random, BOW_RANGE_MM),
        half_mm: trial.size_mm()[0] / 2.0,
        along_rad: between(random, turn),
        wave_mm: between(random, WAVE_RANGE_MM),
        length_mm: between(random, WAVELENGTH_RANGE_MM),
        runs_rad: between(random, turn),
        phase_rad: between(random, turn),
    }
}

/// Returns the panel as taught with a camera that measures distances too long by this fraction, and the mount that was
/// calibrated with this camera at the panel's taught pose.
fn taught(trial: &TrialScene, scale: f64) -> (TaughtPanel, Recipe, Rigid<Base, Camera>) {
    let corners = trial.middle_px(REGION_FRACTION).map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = TRIAL_BOX_MM;
    let text = format!(
        "panel = \"trial\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\nmax_shift_mm = 900.0\n\
         turn_limit_deg = 180.0\nmax_tilt_deg = 35.0\n\
         [region]\ncorners_px = {corners:?}\nrows = 2\ncolumns = 3\n"
    );
    let recipe = Recipe::check("bench.toml", &text).expect("a valid recipe");
    let learnt =
        |mount| TaughtPanel::learn(&trial.taught_scan(), *trial.camera(), mount, &recipe).expect("a panel");
    let panel = learnt(trial.base_from_camera());
    let centre = panel.panel_from_camera.inverse() * panel.centre();
    let shift: Rigid<Camera, Camera> =
        Rigid::from_isometry_unchecked(Translation3::from(-scale / (1.0 + scale) * centre.mm.coords).into());
    let mount = trial.base_from_camera() * shift;
    (learnt(mount), recipe, mount)
}

fn found(
    trial: &TrialScene,
    bend: PanelBend,
    (panel, recipe, taught): (&TaughtPanel, &Recipe, &surface::Fit),
    (range, mount): (RangeErrors, Rigid<Base, Camera>),
) -> Found {
    let is_scaled = range.scale > 0.0;
    let tried = located_with(trial, (panel.clone(), recipe.clone()), (range, mount));
    let Some(pose) = tried.fit.as_ref().map(|fit| fit.base_from_panel) else {
        return Found { bend, is_scaled, tried, contact_mm: None, hole_mm: 0.0, aside_mm: None, fit_ms: 0.0 };
    };
    let scan = trial.scan();
    let begun = Instant::now();
    let points = surface::todays_points(panel, &scan, &(pose.inverse() * mount));
    let today = surface::correct_taught_surface(
        &taught.surface,
        panel,
        &taught.map,
        (&points, recipe.surface().max_hole_mm()),
    );
    let fit_ms = begun.elapsed().as_secs_f64() * 1e3;
    let hole_mm = today.as_ref().map_or(f64::INFINITY, |today| today.largest_hole_mm);
    let contact_mm = today.ok().map(|today| {
        let middle = |n: usize| (n as f64 + 0.5) / PLACES as f64;
        let places = (0..PLACES * PLACES).map(|n| Parameter { u: middle(n % PLACES), v: middle(n / PLACES) });
        let off = |at| trial.height_over_surface_mm(pose * today.surface.point(at)).expect("a panel").abs();
        let off_mm: Vec<f64> = places.map(off).collect();
        [off_mm.iter().sum::<f64>() / off_mm.len() as f64, off_mm.iter().copied().fold(0.0, f64::max)]
    });
    let aside_mm = trial.max_point_distance_mm(&pose);
    Found { bend, is_scaled, tried, contact_mm, hole_mm, aside_mm, fit_ms }
}

fn words(found: &Found) -> String {
    let Found { bend, tried, contact_mm, hole_mm, aside_mm, fit_ms, .. } = found;
    let shape = format!("{:+.2}  {:.2}  {:3.0}", bend.bow_mm, bend.wave_mm, bend.length_mm);
    let reasons: Vec<&str> = tried.judgement.reasons.iter().map(|reason| reason.code.as_ref()).collect();
    let Some(fit) = &tried.fit else { return format!("{shape}  not found: {}", reasons.join(", ")) };
    let [mean_mm, largest_mm] = contact_mm.unwrap_or([f64::NAN; 2]);
    format!(
        "{shape}  {:6}  {:.2}  {:.3}  {:.2}  {mean_mm:.3} {largest_mm:.3}  {hole_mm:.0}  {:.3}  {:.3}  {:.0} + {fit_ms:.0}  {}",
        tried.judgement.verdict.keyword(),
        fit.deviation_mm.unwrap_or(f64::NAN),
        fit.rms_mm,
        fit.outline_rms_px,
        aside_mm.unwrap_or(f64::NAN),
        fit.uncertainty_mm,
        tried.elapsed_ms,
        reasons.join(", ")
    )
}

fn judged(all: &[Found]) -> usize {
    let is_accepted = |found: &&Found| found.tried.judgement.verdict == Verdict::Accept;
    let little = || all.iter().filter(|found| found.bend.bow_mm.abs() <= MAX_ACCEPTED_BOW_MM && !found.is_scaled);
    let (of, accepted) = (little().count(), little().filter(is_accepted).count());
    // If the region is partly hidden, the check of today's surface requires a person's decision.
    let is_seen = |found: &&Found| found.hole_mm <= MAX_HOLE_MM;
    let used: Vec<&Found> = all.iter().filter(is_accepted).filter(is_seen).collect();
    let largest = |found: &&Found| found.contact_mm.map_or(f64::INFINITY, |[_, largest_mm]| largest_mm);
    let stated = |found: &&Found| found.tried.fit.as_ref().map_or(0.0, |fit| fit.uncertainty_mm);
    let within = used.iter().filter(|found| largest(found) <= stated(found)).count();
    let placed = used.iter().filter(|found| found.aside_mm.is_some_and(|mm| mm <= stated(found))).count();
    let is_wrong = |found: &&&Found| {
        let far = |mm: f64| mm > MAX_CORRECT_ERROR_MM && mm > stated(found);
        far(largest(found)) || found.aside_mm.is_none_or(far)
    };
    let wrong = used.iter().filter(is_wrong).count();
    let mut means: Vec<f64> = used.iter().filter_map(|found| found.contact_mm).map(|[mean, _]| mean).collect();
    let mut worst: Vec<f64> = used.iter().map(largest).collect();
    let mut bounds: Vec<f64> = used.iter().map(stated).collect();
    let mut locate_ms: Vec<f64> = all.iter().map(|found| found.tried.elapsed_ms).collect();
    let mut fit_ms: Vec<f64> = all.iter().map(|found| found.fit_ms).collect();
    let (locate_ms, fit_ms) = (quantile(&mut locate_ms, 0.5), quantile(&mut fit_ms, 0.5));
    let contact_mm = quantile(&mut worst, 0.5);
    shared(Figure("locate: bent panels accepted (bow up to 2 mm)"), accepted, of, MIN_ACCEPTED_FRACTION);
    shared(Figure("locate: path within the stated error"), within, used.len(), MIN_STATED_FRACTION);
    let (goal, found) = (format!("{MAX_CONTACT_ERROR_MM} mm"), format!("{contact_mm:.2} mm"));
    Figure("locate: bent panels: contact error").report(&goal, &found, contact_mm <= MAX_CONTACT_ERROR_MM);
    let found = format!("{locate_ms:.0} + {fit_ms:.0} ms");
    let is_fast = locate_ms + fit_ms <= BOTH_MS;
    Figure("locate: localization and today's surface, medians").report(&format!("{BOTH_MS} ms"), &found, is_fast);
    row(
        share(accepted, of) >= MIN_ACCEPTED_FRACTION,
        &format!(
            "{accepted} of {of} panels that bow by {MAX_ACCEPTED_BOW_MM} mm at most, scanned with the right scale, are accepted; of all {}, {} are accepted and show their region",
            all.len(),
            used.len()
        ),
    ) + row(
        share(within, used.len()) >= MIN_STATED_FRACTION,
        &format!(
            "{within} of {} accepted paths lie within what is stated anywhere in the region, whose median is {:.3} mm; {placed} poses in the \
             panel's plane",
            used.len(),
            quantile(&mut bounds, 0.5)
        ),
    ) + row(
        contact_mm <= MAX_CONTACT_ERROR_MM,
        &format!(
            "contact error of accepted ones median of the largest in the region {contact_mm:.3} mm; {:.3} mm on average over it",
            quantile(&mut means, 0.5)
        ),
    ) + row(
        wrong == 0,
        &format!(
            "{wrong} of {} accepted ones are more than {MAX_CORRECT_ERROR_MM} mm off and beyond what is stated",
            used.len()
        ),
    ) + row(
        locate_ms + fit_ms <= BOTH_MS,
        &format!("localization {locate_ms:.0} ms and today's surface {fit_ms:.0} ms, medians"),
    )
}
