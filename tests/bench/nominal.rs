//! Panels that were taught from their drawing and are bent by 0.2 to 3 mm: measures whether the error of the deviation
//! from the drawing is within its stated uncertainty. For comparison, the simple point-to-mesh distance at the same
//! pose is computed as in CloudCompare, and by Open3D if `PANELPREP_PEERS` names a Python with Open3D. Accuracy and
//! time are measured in the same run. `cargo bench --bench nominal -- [FIRST-LAST]`; with `PANELPREP_REDUCTION` the
//! pictures are smaller.
//!
//! The true deviation is that of the present panel from the taught panel at the best-fit pose of their points, at the
//! centre of each cell.

use goal::Figure;
use mesh_distance::MeshDistance;
use panelprep::files::{read_mesh, write_stl};
use panelprep::geometry::statistics::{self, QuantileRank};
use panelprep::geometry::{Base, KukaPose, Panel, Rigid};
use panelprep::locate::{self, Fit, RangeErrors, ScanView};
use panelprep::nominal::{Part, PartRays, PartView};
use panelprep::panel::TaughtPanel;
use panelprep::recipe::Recipe;
use panelprep::sim::{PanelBend, TRIAL_BOX_MM, TrialScene};
use panelprep::surface::{self, Form, FormCell, FormErrors, TodaysPoint};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::ops::RangeInclusive;
use std::process::{Command, ExitCode};
use std::time::Instant;

#[path = "goal.rs"]
mod goal;
#[path = "nominal/mesh_distance.rs"]
mod mesh_distance;

/// The fraction of the panel's length and width that the region covers.
const REGION_FRACTION: f64 = 0.6;
const BOW_RANGE_MM: [f64; 2] = [0.2, 3.0];
const WAVE_RANGE_MM: [f64; 2] = [0.02, 0.2];
const WAVELENGTH_RANGE_MM: [f64; 2] = [150.0, 600.0];
/// Range of the fraction of cells whose error must be within the stated 95 % uncertainty.
const WITHIN_FRACTION_RANGE: RangeInclusive<f64> = 0.90..=0.99;
/// Maximum fraction of panels whose true profile is larger than its upper bound.
const MAX_UNBOUNDED_FRACTION: f64 = 0.05;

/// The results for one panel.
#[derive(Default)]
struct Compared {
    /// Errors of the deviation, mm, each with its uncertainty.
    map: Vec<[f64; 2]>,
    /// Errors of the simple distance of the point nearest to the centre of each cell, mm.
    plain_mm: Vec<f64>,
    /// Absolute errors of the distances that Open3D computes for the same points, mm.
    open3d_mm: Vec<f64>,
    is_profile_bounded: bool,
    ms: [f64; 2],
    open3d_ms: Option<f64>,
}

fn main() -> ExitCode {
    mesh_distance::check();
    let mut all = Vec::new();
    println!("seed  bow mm  places  profile mm  true mm  map error 95 % mm  plain mm  within %");
    for seed in seeds() {
        let mut random = Pcg64::seed_from_u64(seed);
        let trial = TrialScene::good_scene(seed, reduction());
        let bend = drawn(&mut random, &trial);
        match compare(&trial.with_bend(bend)) {
            Ok((form, true_mm, compared)) => {
                let within = compared.map.iter().filter(|[error, bound]| error.abs() <= *bound).count();
                println!(
                    "{seed:4}  {:+.2}  {:4}  {:.2} ± {:.2}  {true_mm:.2}  {:.3}  {:.3}  {:.1}",
                    bend.bow_mm,
                    form.places.len(),
                    form.profile.value_mm,
                    form.profile.uncertainty_mm,
                    quantile(compared.map.iter().map(|[error, _]| error.abs()), 0.95),
                    quantile(compared.plain_mm.iter().map(|mm| mm.abs()), 0.95),
                    100.0 * within as f64 / compared.map.len() as f64
                );
                all.push(compared);
            }
            Err(words) => println!("{seed:4}  {:+.2}  not measured: {words}", bend.bow_mm),
        }
    }
    report(&all);
    if goal::missed() == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn seeds() -> RangeInclusive<u64> {
    let range = |word: String| {
        let (first, last) = word.split_once('-')?;
        Some(first.parse().ok()?..=last.parse().ok()?)
    };
    std::env::args().skip(1).find_map(range).unwrap_or(1..=20)
}

fn reduction() -> usize {
    std::env::var("PANELPREP_REDUCTION").ok().and_then(|text| text.parse().ok()).unwrap_or(2)
}

fn drawn(random: &mut Pcg64, trial: &TrialScene) -> PanelBend {
    let mut between = |[low, high]: [f64; 2]| random.random_range(low..high);
    let turn = [0.0, std::f64::consts::TAU];
    let (bow_mm, sign) = (between(BOW_RANGE_MM), between([-1.0, 1.0]).signum());
    PanelBend {
        bow_mm: sign * bow_mm,
        half_mm: trial.size_mm()[0] / 2.0,
        along_rad: between(turn),
        wave_mm: between(WAVE_RANGE_MM),
        length_mm: between(WAVELENGTH_RANGE_MM),
        runs_rad: between(turn),
        phase_rad: between(turn),
    }
}

/// A panel that was taught from its drawing.
struct Drawn {
    part: Part,
    recipe: Recipe,
    panel: TaughtPanel,
    base_from_drawing: Rigid<Base, Panel>,
}

fn taught(trial: &TrialScene) -> Result<Drawn, String> {
    let (mesh, base_from_drawing) = trial.drawing();
    let mesh = read_mesh(&write_stl(&mesh)).map_err(|error| error.to_string())?;
    let part = Part::choose(mesh, None, None).map_err(|error| error.to_string())?;
    let camera_from_drawing = trial.base_from_camera().inverse() * base_from_drawing;
    let rays = PartRays::new(part.clone(), &camera_from_drawing);
    let seen = PartView::view_part(&rays, trial.camera()).map_err(|error| error.to_string())?;
    let cloud = seen.and_then(|seen| seen.cloud()).ok_or("the drawing is not seen")?;
    let corners = trial.middle_px(REGION_FRACTION).map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = TRIAL_BOX_MM;
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&base_from_drawing);
    let text = format!(
        "panel = \"bent\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\nmax_shift_mm = 900.0\n\
         turn_limit_deg = 180.0\nmax_tilt_deg = 35.0\n[region]\ncorners_px = {corners:?}\nrows = 2\ncolumns = 3\n\
         [nominal.base_from_drawing]\nx_mm = {x_mm:?}\ny_mm = {y_mm:?}\nz_mm = {z_mm:?}\na_deg = {a_deg:?}\nb_deg = {b_deg:?}\n\
         c_deg = {c_deg:?}\n"
    );
    let recipe = Recipe::check("bench.toml", &text).map_err(|problems| problems.to_string())?;
    let panel = TaughtPanel::learn(&cloud, *trial.camera(), trial.base_from_camera(), &recipe)
        .map_err(|error| error.to_string())?;
    let base_from_drawing = Rigid::from_isometry_unchecked(*base_from_drawing.isometry());
    Ok(Drawn { part, recipe, panel, base_from_drawing })
}

/// Measures one panel; also returns its true profile, mm.
fn compare(trial: &TrialScene) -> Result<(Form, f64, Compared), String> {
    let Drawn { part, recipe, panel, base_from_drawing } = &taught(trial)?;
    let fit = surface::fit(panel, recipe.surface()).map_err(|error| error.to_string())?;
    let range = RangeErrors { scale: 0.0, ..RangeErrors::default() };
    let (scan, base_from_camera) = (trial.scan(), trial.base_from_camera());
    let view = ScanView { scan: &scan, camera: trial.camera(), base_from_camera, range };
    let located: Fit = locate::locate(panel, &view, recipe.locate()).map_err(|error| error.to_string())?;
    let panel_from_camera = located.base_from_panel.inverse() * base_from_camera;
    let points = surface::todays_points(panel, &scan, &panel_from_camera);
    let begun = Instant::now();
    let hole_mm = recipe.surface().max_hole_mm();
    let todays = surface::correct_taught_surface(&fit.surface, panel, &fit.map, (&points, hole_mm))
        .map_err(|error| error.to_string())?;
    let errors = FormErrors { scan_mm: range.point_mm(), pose: located.pose_uncertainty(base_from_camera) };
    let form = Form::compute((&fit, 0), &todays, &errors).ok_or("the region is hidden")?;
    let form_ms = begun.elapsed().as_secs_f64() * 1e3;
    let right = trial.best_fit_pose().ok_or("no panel")? * panel_from_panel(base_from_drawing);
    let truth_mm =
        |place: &FormCell| -trial.height_over_surface_mm(right * fit.surface.point(place.at)).unwrap_or(f64::NAN);
    let truths: Vec<f64> = form.places.iter().map(truth_mm).collect();
    let begun = Instant::now();
    let mesh = MeshDistance::new(part);
    let distances: Vec<Option<f64>> = points.iter().map(|point| mesh.signed_mm(&point.position().mm)).collect();
    let plain_ms = begun.elapsed().as_secs_f64() * 1e3;
    let nearest: Vec<usize> = form.places.iter().map(|place| nearest(&points, place)).collect();
    let plain = nearest.iter().zip(&truths).filter_map(|(index, truth)| Some(distances[*index]? - truth));
    let true_mm = 2.0 * truths.iter().map(|mm| mm.abs()).fold(0.0, f64::max);
    let peer = open3d(part, &points);
    let of_peer = |(index, truth): (&usize, &f64)| peer.as_ref().map(|(found, _)| found[*index] - truth.abs());
    let compared = Compared {
        map: form
            .places
            .iter()
            .zip(&truths)
            .map(|(place, truth)| [place.deviation.value_mm - truth, place.deviation.uncertainty_mm])
            .collect(),
        plain_mm: plain.collect(),
        open3d_mm: nearest.iter().zip(&truths).filter_map(of_peer).collect(),
        is_profile_bounded: true_mm <= form.profile.value_mm + form.profile.uncertainty_mm,
        ms: [form_ms, plain_ms],
        open3d_ms: peer.as_ref().map(|(_, ms)| *ms),
    };
    Ok((form, true_mm, compared))
}

/// Returns the frame of the drawn panel in that of the simulated panel, which coincides with the base at the nominal
/// pose.
fn panel_from_panel(base_from_drawing: &Rigid<Base, Panel>) -> Rigid<Panel, Panel> {
    Rigid::from_isometry_unchecked(*base_from_drawing.isometry())
}

/// Returns the index of the point nearest to the centre of a cell.
fn nearest(points: &[TodaysPoint], place: &FormCell) -> usize {
    let off = |point: &TodaysPoint| {
        (point.parameter().u - place.at.u).powi(2) + (point.parameter().v - place.at.v).powi(2)
    };
    let nearest = points.iter().enumerate().min_by(|a, b| off(a.1).total_cmp(&off(b.1)));
    nearest.map_or(0, |(index, _)| index)
}

/// Returns the distances that Open3D computes for the points, mm, and its time, ms; `None` without Open3D.
fn open3d(part: &Part, points: &[TodaysPoint]) -> Option<(Vec<f64>, f64)> {
    let python = std::env::var("PANELPREP_PEERS").ok()?;
    let file = std::env::temp_dir().join(format!("panelprep-nominal-{}.json", std::process::id()));
    let numbers = |point: &nalgebra::Point3<f64>| [point.x, point.y, point.z];
    let given = serde_json::json!({
        "vertices": part.vertices.iter().map(numbers).collect::<Vec<_>>(),
        "triangles": part.triangles,
        "points": points.iter().map(|point| numbers(&point.position().mm)).collect::<Vec<_>>(),
    });
    std::fs::write(&file, given.to_string()).ok()?;
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bench/nominal_peers.py");
    let output = Command::new(python).arg(script).arg(&file).output();
    // The result is ignored: a leftover file is inside of the system's folder for temporary files.
    let _ = std::fs::remove_file(&file);
    let text = String::from_utf8(output.ok()?.stdout).ok()?;
    let found: serde_json::Value = serde_json::from_str(text.lines().last()?).ok()?;
    let distances: Vec<f64> = serde_json::from_value(found["distances"].clone()).ok()?;
    Some((distances, found["ms"].as_f64()?))
}

fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    statistics::quantile(&mut values, share, QuantileRank::Nearest).unwrap_or(f64::NAN)
}

fn report(all: &[Compared]) {
    let map = || all.iter().flat_map(|compared| &compared.map);
    let (within, of) = (map().filter(|[error, bound]| error.abs() <= *bound).count(), map().count());
    let share = within as f64 / of.max(1) as f64;
    let found = format!("{:.1} % of {of}", 100.0 * share);
    Figure("nominal: places of the map within the stated 95 %").report(
        "90–99 %",
        &found,
        WITHIN_FRACTION_RANGE.contains(&share),
    );
    let above = all.iter().filter(|compared| !compared.is_profile_bounded).count();
    let is_bounded = !all.is_empty() && above as f64 <= MAX_UNBOUNDED_FRACTION * all.len() as f64;
    let found = format!("{above} of {}", all.len());
    Figure("nominal: true profiles above the stated bound").report("5 %", &found, is_bounded);
    let map_mm = quantile(map().map(|[error, _]| error.abs()), 0.95);
    let plain_mm = quantile(all.iter().flat_map(|compared| &compared.plain_mm).map(|mm| mm.abs()), 0.95);
    let found = format!("{map_mm:.3} mm");
    Figure("nominal: error of the map, 95 %").report("that of the plain distance", &found, map_mm <= plain_mm);
    Figure("nominal: error of the plain distance, 95 %").report("–", &format!("{plain_mm:.3} mm"), true);
    let ms = |index: usize| quantile(all.iter().map(|compared| compared.ms[index]), 0.5);
    Figure("nominal: time of today's surface and form").report("–", &format!("{:.0} ms", ms(0)), true);
    Figure("nominal: time of the plain distance").report("–", &format!("{:.0} ms", ms(1)), true);
    if all.iter().all(|compared| compared.open3d_ms.is_none()) {
        Figure("nominal: Open3D's distance, error 95 % and time").not_run("–");
        return;
    }
    let open3d_mm = quantile(all.iter().flat_map(|compared| &compared.open3d_mm).map(|mm| mm.abs()), 0.95);
    let open3d_ms = quantile(all.iter().filter_map(|compared| compared.open3d_ms), 0.5);
    let found = format!("{open3d_mm:.3} mm, {open3d_ms:.0} ms");
    Figure("nominal: Open3D's distance, error 95 % and time").report("–", &found, true);
}
