//! `panelprep render`: writes a simulated cell as files, and its ground truth to a folder that no stage reads.

use super::args::{FilmName, Render, SceneName, real_arm, scanner_distortion};
use super::disk;
use super::fault::Fault;
use super::live::FULL_WIDTH_PX;
use super::output::{self, Outcome};
use super::render_boards::{self, RenderedFiles};
use panelprep_base::geometry::{Camera, ColorPicture, Flange, KukaPose, OrganizedCloud, Rigid, Tool};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::cell::{self, FlangeCameraMount, Intrinsics, MountedPose, ScannerMount};
use panelprep_cell::files::{self, Clip, ClipEntry};
use panelprep_cell::labels;
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::Recipe;
use panelprep_sim as sim;
use panelprep_sim::{Film, FilmSpec, Grease, PanelPosition, SEARCH_BOX_MM, Scene};
use panelprep_store::store::{Store, StoreError};
use panelprep_vision::inspect::{Demands, Footprint};
use rayon::prelude::*;
use serde_json::json;
use std::fs;
use std::path::Path;

/// Name of the file that marks a folder as written by this command; only such a folder may be overwritten.
const FOLDER_MARK_FILE: &str = ".rendered-by-panelprep";
/// Duration of the observation of the wet panel, s; the default of the cell file.
const OBSERVATION_S: u32 = 60;
/// Pictures per second of a film; the default of the recipe.
const FRAMES_PER_SECOND: f64 = 5.0;

/// Uncertainty that the rendered calibration of the scanner's mount states, mm: 0.1 mm and 0.01° at 0.79 m.
const SCANNER_UNCERTAINTY_MM: f64 = 0.24;
/// Uncertainty that the rendered calibration of the flange camera's mount states, mm: 0.1 mm and 0.01° at 0.45 m.
const FLANGE_CAMERA_UNCERTAINTY_MM: f64 = 0.18;
/// Uncertainty that the rendered calibration of the TCP states, mm.
const TOOL_TIP_UNCERTAINTY_MM: f64 = 0.05;

impl FilmName {
    /// Returns the parameters of the simulated film for this seed.
    pub fn spec(self, seed: u64) -> FilmSpec {
        match self {
            FilmName::Calm => FilmSpec::CALM_FILM,
            FilmName::Usual => FilmSpec::TYPICAL_FILM,
            FilmName::Hard => FilmSpec::hardest(seed),
        }
    }
}

impl From<SceneName> for Scene {
    fn from(name: SceneName) -> Scene {
        match name {
            SceneName::Good => Scene::Good,
            SceneName::Clean => Scene::Clean,
            SceneName::NoPanel => Scene::NoPanel,
            SceneName::WrongPanel => Scene::WrongPanel,
        }
    }
}

/// Writes a simulated cell and lists its files.
///
/// # Errors
/// If the folder contains other files, or writing to the disk fails.
pub fn run(args: &Render) -> Result<Outcome, Fault> {
    let spec = args.film.spec(args.seed);
    let cell = sim::Cell::new(args.seed, args.scene.into(), args.reduction as usize);
    let arm = real_arm(args.seed, args.arm_error_mm);
    let cell = cell.with_films(spec).with_pose(args.place).with_arm(arm.clone());
    let distortion = scanner_distortion(args.seed, args.scanner_error_mm);
    let cell = cell.with_distortion(distortion);
    let progress = |line: &str| output::write_progress(line);
    let rendered = write(&cell, &args.out, args.seconds, &progress)?;
    if args.drawing {
        write_drawing(&cell, &rendered)?;
    }
    if args.boards {
        progress("rendering boards for calibration");
        render_boards::write(args.seed, args.reduction as usize, (arm.as_ref(), &rendered))?;
        render_boards::write_coupons(args.seed, &rendered)?;
    }
    if args.board_scans > 0 {
        progress("rendering scans of a board");
        render_boards::write_scans(args, distortion, &rendered)?;
    }
    for index in 1..=args.clips {
        progress(&format!("rendering clip {index} of {}", args.clips));
        write_labelled(&cell, &rendered, args.film, u64::from(index))?;
    }
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
    let mut names: Vec<String> = fs::read_dir(&rendered.folder)
        .and_then(Iterator::collect::<Result<Vec<_>, _>>)
        .map_err(|error| Fault::file_fault(&rendered.folder, error))?
        .iter()
        .map(|entry| entry.path().display().to_string())
        .collect();
    names.sort();
    outcome.lines = vec![format!("seed {}, written to {}:", args.seed, args.out.display())];
    outcome.lines.extend(names.iter().map(|name| format!("  {name}")));
    outcome.add_value("files", json!(names));
    Ok(outcome)
}

/// Renders a cell to a folder: the files with which the panel is taught, and the pictures of a cycle.
///
/// # Errors
/// The errors of [`run`].
pub fn write(
    cell: &sim::Cell,
    folder: &Path,
    seconds: u32,
    progress: &dyn Fn(&str),
) -> Result<RenderedFiles, Fault> {
    let rendered = write_taught_for(cell, folder, seconds, progress)?;
    progress("rendering the scan and the corner picture");
    disk::write(&rendered.file_path("scan.pcd"), files::write_pcd(&cell.scan()))?;
    write_corner(cell, &rendered, PanelPosition::Displaced)?;
    progress("rendering the clip");
    let film = cell.film();
    write_clip(&film, &rendered.file_path("clip"), seconds)?;
    let folder = rendered.file_path("truth");
    let numbers = serde_json::to_string_pretty(&cell.truth().numbers()).map_err(Fault::stage)?;
    disk::write(&folder.join("truth.json"), numbers)?;
    write_truth(&film, &folder, seconds)?;
    Ok(rendered)
}

/// Writes the drawing of the panel, and a recipe for teaching the panel from the drawing.
fn write_drawing(cell: &sim::Cell, rendered: &RenderedFiles) -> Result<(), Fault> {
    let (mesh, base_from_drawing) = cell.drawing();
    disk::write(&rendered.file_path("drawing.stl"), files::write_stl(&mesh))?;
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&base_from_drawing);
    let recipe = disk::read_text(&rendered.file_path("recipe.toml"))?;
    let nominal = format!(
        "\n[nominal.base_from_drawing]\nx_mm = {x_mm}\ny_mm = {y_mm}\nz_mm = {z_mm}\na_deg = {a_deg}\nb_deg = {b_deg}\n\
         c_deg = {c_deg}\n"
    );
    Ok(disk::write(&rendered.file_path("recipe_drawing.toml"), recipe + &nominal)?)
}

/// Writes one clip of a labelled set: the same panel at the same pose, with other grease.
fn write_labelled(cell: &sim::Cell, rendered: &RenderedFiles, film: FilmName, index: u64) -> Result<(), Fault> {
    let until_s = sim::WET_FROM_S + 0.85 * f64::from(rendered.seconds);
    let grease = Grease::Mixed { count: 2 + (index % 4) as usize, until_s };
    let spots = if index.is_multiple_of(3) { Vec::new() } else { cell.with_other_grease(&grease, index) };
    let film = cell.film_with_spec(&spots, &film.spec(index), index);
    let folder = rendered.file_path("set").join(format!("{index:04}"));
    write_clip(&film, &folder, rendered.seconds)?;
    write_truth(&film, &folder.join("truth"), rendered.seconds)
}

/// Renders the files with which the panel is taught: configuration, calibrations, recipe, and scan and corner pictures
/// at the nominal pose.
///
/// # Errors
/// The errors of [`run`].
pub fn write_taught(cell: &sim::Cell, folder: &Path, progress: &dyn Fn(&str)) -> Result<RenderedFiles, Fault> {
    write_taught_for(cell, folder, OBSERVATION_S, progress)
}

fn write_taught_for(
    cell: &sim::Cell,
    folder: &Path,
    seconds: u32,
    progress: &dyn Fn(&str),
) -> Result<RenderedFiles, Fault> {
    prepare_output_folder(folder)?;
    let rendered = RenderedFiles { folder: folder.to_owned(), seconds };
    progress("rendering the scan and the corner picture for teaching the panel");
    let taught_scan = cell.taught_scan();
    write_configuration(cell, &taught_scan, &rendered)?;
    render_boards::write_targets(cell, &rendered)?;
    disk::write(&rendered.file_path("taught_scan.pcd"), files::write_pcd(&taught_scan))?;
    write_corner(cell, &rendered, PanelPosition::Nominal)?;
    Ok(rendered)
}

/// Empties a folder that this command has written, or creates a new one.
fn prepare_output_folder(folder: &Path) -> Result<(), Fault> {
    let named = |error: std::io::Error| Fault::file_fault(folder, error);
    if folder.exists() {
        let ours = folder.join(FOLDER_MARK_FILE).exists();
        let empty = fs::read_dir(folder).map_err(named)?.next().is_none();
        if !ours && !empty {
            return Err(Fault::NotOwnFolder { folder: folder.to_owned() });
        }
        // If another program uses the store in the folder, the folder is not emptied.
        let store = folder.join("store");
        if let (true, Err(in_use @ StoreError::Leased { .. })) = (store.exists(), Store::create(&store)) {
            return Err(Fault::stage(in_use));
        }
        fs::remove_dir_all(folder).map_err(named)?;
    }
    Ok(disk::write(
        &folder.join(FOLDER_MARK_FILE),
        "Each `panelprep render` replaces the content of this folder.\n",
    )?)
}

fn write_configuration(
    cell: &sim::Cell,
    taught_scan: &OrganizedCloud<Camera>,
    rendered: &RenderedFiles,
) -> Result<(), Fault> {
    let mut base_from_camera =
        MountedPose::<ScannerMount>::from_pose(KukaPose::from_rigid(&cell.calibrated_base_from_camera()));
    let mut flange_from_camera =
        MountedPose::<FlangeCameraMount>::from_pose(KukaPose::from_rigid(&cell.calibrated_flange_from_camera()));
    (base_from_camera.uncertainty_mm, flange_from_camera.uncertainty_mm) =
        (Some(SCANNER_UNCERTAINTY_MM), Some(FLANGE_CAMERA_UNCERTAINTY_MM));
    let flange_from_tool: Rigid<Flange, Tool> =
        KukaPose { z_mm: sim::TOOL_LENGTH_MM, ..KukaPose::default() }.to_rigid();
    let mut tool =
        MountedPose::<panelprep_cell::cell::ToolMount>::from_pose(KukaPose::from_rigid(&flange_from_tool));
    (tool.axis_measured, tool.uncertainty_mm) = (Some(true), Some(TOOL_TIP_UNCERTAINTY_MM));
    let texts = [
        ("scanner.toml", Intrinsics::from_camera(*cell.scanner()).to_toml()),
        ("flange_camera.toml", Intrinsics::from_camera(*cell.flange_camera()).to_toml()),
        ("base_from_camera.toml", base_from_camera.to_toml()),
        ("flange_from_camera.toml", flange_from_camera.to_toml()),
        ("flange_from_tool.toml", tool.to_toml()),
        ("cell.toml", format!("{CELL_TEXT}verify_limit_mm = {:?}\n", verify_limit_mm(cell))),
        ("recipe.toml", recipe(cell, taught_scan, rendered.seconds)?),
    ];
    for (name, text) in &texts {
        disk::write(&rendered.file_path(name), text)?;
    }
    Ok(())
}

/// Returns the limit for verifications, mm: the default at full size, and more for smaller pictures, in which a board
/// is located less precisely.
fn verify_limit_mm(cell: &sim::Cell) -> f64 {
    let smaller = FULL_WIDTH_PX as f64 / cell.scanner().width_px as f64;
    0.5 + (smaller - 1.0).round() / 10.0
}

const CELL_TEXT: &str = r#"# A simulated cell, as files. Written by `panelprep render`.
store = "store"

[scanner]
kind = "simulated"

[flange_camera]
kind = "simulated"

[robot]
kind = "mock"

[poses]
park = { a1_deg = -120.0, a2_deg = -75.0, a3_deg = 110.0, a4_deg = 0.0, a5_deg = 55.0, a6_deg = 90.0 }
ready = { a1_deg = 0.0, a2_deg = -120.0, a3_deg = 145.0, a4_deg = 0.0, a5_deg = -25.0, a6_deg = 90.0 } # in front of the panel: straight motions begin here

[io.outputs]
light = 1
spray = 2
lens_shutter = 3
extraction = 4
tool = 5

[io.feedbacks]
water_off = 1
lens_shut = 2
extraction_flow = 3
tool_running = 4
light_on = 5

[calibration]
scanner = "scanner.toml"
flange_camera = "flange_camera.toml"
base_from_camera = "base_from_camera.toml"
flange_from_camera = "flange_from_camera.toml"
flange_from_tool = "flange_from_tool.toml"

[rough.base_from_camera] # measured with a tape: a calibration with a very different result is refused
x_mm = -100.0
y_mm = -250.0
z_mm = 700.0
a_deg = -70.0
b_deg = 0.0
c_deg = -115.0

[rough.flange_from_camera]
x_mm = 80.0
y_mm = 0.0
z_mm = 30.0
a_deg = 0.0
b_deg = 0.0
c_deg = 0.0

[limits] # the tool's tip stays in this box
box_min_mm = [100.0, -450.0, 50.0]
box_max_mm = [700.0, 450.0, 900.0]
"#;

/// Maximum ratio of the pixel size on a displaced panel to that at its taught pose.
const MAX_DISPLACED_PIXEL_FACTOR: f64 = 1.2;

/// Returns the recipe. If the pixels are too large for the `min_break_mm2` of the cell, the recipe states the smallest
/// break that can be found reliably with these pixels.
fn recipe(cell: &sim::Cell, taught_scan: &OrganizedCloud<Camera>, seconds: u32) -> Result<String, Fault> {
    let text = plain_recipe(cell, seconds);
    let plain = Recipe::check("recipe.toml", &text)?;
    let demanded_mm2 =
        Demands::from_recipe(&plain, cell::Cell::check("cell.toml", CELL_TEXT)?.limits()).min_break_mm2;
    let panel = TaughtPanel::learn(taught_scan, *cell.scanner(), cell.calibrated_base_from_camera(), &plain);
    let panel = panel.map_err(Fault::stage)?;
    let limit_mm2 = Footprint::taught_detection_limit_mm2(&panel, plain.inspect()).map_err(Fault::stage)?;
    let sure_mm2 = MAX_DISPLACED_PIXEL_FACTOR * limit_mm2;
    if sure_mm2 <= demanded_mm2 {
        return Ok(text);
    }
    Ok(format!(
        "{text}# The pixels of this camera are too coarse for the cell's min_break_mm2 of {demanded_mm2} mm²: at the taught pose, \
         breaks of {limit_mm2:.1} mm² or more are reliably found.\nmin_break_mm2 = {:.1}\n",
        sure_mm2.ceil()
    ))
}

fn plain_recipe(cell: &sim::Cell, seconds: u32) -> String {
    let region = cell.region();
    let corners: Vec<String> =
        region.corners_px.iter().map(|pixel| format!("[{:.1}, {:.1}]", pixel.u, pixel.v)).collect();
    let [low, high] = SEARCH_BOX_MM;
    format!(
        "# The recipe of the simulated panel. Written by `panelprep render`.\n\
         panel = \"simulated-panel\"\n\n\
         [process]\nobservation_s = {seconds}.0\nframes_per_second = {FRAMES_PER_SECOND:?}\n\n\
         [locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n\n\
         [corner]\nwhich = {which:?} # as each taught picture shows it\n\n\
         [region]\ncorners_px = [{corners}]\nrows = {rows}\ncolumns = {columns}\n\n\
         [inspect]\nmethod = \"film\"\n",
        which = cell.corner_views().iter().map(|view| view.name).collect::<Vec<_>>(),
        corners = corners.join(", "),
        rows = region.rows,
        columns = region.columns,
    )
}

fn write_corner(cell: &sim::Cell, rendered: &RenderedFiles, place: PanelPosition) -> Result<(), Fault> {
    // The file name of the first corner has no number; scripts use this name.
    for (view, number) in cell.corner_views().iter().zip(["", "2", "3", "4"]) {
        let (taught, base_from_flange) = match place {
            PanelPosition::Nominal => ("taught_", view.base_from_flange),
            PanelPosition::Displaced => ("", cell.displaced_corner_pose(view)),
        };
        let picture =
            files::write_color_png(&cell.flange_picture(&base_from_flange, place)).map_err(Fault::stage)?;
        disk::write(&rendered.file_path(&format!("{taught}corner{number}.png")), picture)?;
        let file = rendered.file_path(&format!("{taught}flange{number}.json"));
        render_boards::write_flange(&file, cell.real_arm(), &base_from_flange)?;
    }
    Ok(())
}

/// Returns the times of the pictures of a clip, from the dry panel to the end of the observation.
fn clip_times_s(seconds: u32) -> Vec<f64> {
    let end_s = sim::WET_FROM_S + f64::from(seconds);
    (0..=(end_s * FRAMES_PER_SECOND).round() as u32).map(|frame| f64::from(frame) / FRAMES_PER_SECOND).collect()
}

fn write_clip(film: &Film, folder: &Path, seconds: u32) -> Result<(), Fault> {
    let times_s = clip_times_s(seconds);
    let entry = |(index, &time_s): (usize, &f64)| {
        let phase = match film.phase(time_s) {
            sim::Phase::Dry => Phase::Dry,
            sim::Phase::Spray => Phase::Spray,
            sim::Phase::Wet => Phase::Wet,
        };
        // Dry pictures are stored without loss (PNG), because all other pictures are compared with them.
        let kind = if phase == Phase::Dry { "png" } else { "jpg" };
        ClipEntry { file: format!("{:05}.{kind}", index + 1), time_s, phase }
    };
    let entries: Vec<ClipEntry> = times_s.iter().enumerate().map(entry).collect();
    entries.par_iter().try_for_each(|entry| -> Result<(), Fault> {
        let picture = film.picture(entry.time_s);
        let bytes = match entry.phase {
            Phase::Dry => files::write_color_png(&picture),
            Phase::Spray | Phase::Wet => files::write_color_jpeg(&picture),
        };
        Ok(disk::write(&folder.join(&entry.file), bytes.map_err(Fault::stage)?)?)
    })?;
    let clip = Clip::new(entries).map_err(Fault::stage)?;
    Ok(disk::write(&folder.join("clip.csv"), clip.to_csv())?)
}

/// Writes the true mask of broken pixels, and the times at which they broke: see [`panelprep_cell::labels`].
fn write_truth(film: &Film, folder: &Path, seconds: u32) -> Result<(), Fault> {
    let last_s = clip_times_s(seconds).last().copied().unwrap_or_default();
    let broken = film.broken_pixels(last_s);
    let times_s = film.break_times_s();
    let rgb = (0..times_s.len()).map(|index| {
        let since_wet_s = (f64::from(times_s[index]) - sim::WET_FROM_S).max(0.0);
        labels::time_to_color(broken.inside[index].then_some(since_wet_s))
    });
    let times = ColorPicture { width: broken.width, height: broken.height, rgb: rgb.collect() };
    disk::write(&folder.join(labels::MASK), files::write_gray_png(&broken.to_gray()).map_err(Fault::stage)?)?;
    Ok(disk::write(&folder.join(labels::TIMES_FILE), files::write_color_png(&times).map_err(Fault::stage)?)?)
}
