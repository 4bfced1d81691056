//! `panelprep label`: a person marks the broken film of a clip, on a page in a browser; the labels are stored in
//! the clip's folder.

mod label_files;

use super::args::{Common, Label};
use super::disk;
use super::fault::{ClipFault, Fault};
use super::inspected::PlacedPanel;
use super::labels::{clip_hash, read_clip};
use super::load::{self, CellFiles};
use super::outcome::Outcome;
use super::output::write_progress;
use label_files::LabelFolder;
use panelprep_base::geometry::PinholeCamera;
use panelprep_base::phase::Phase;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::files::{self, ClipEntry};
use panelprep_cell::labels::{ClipFrame, LABELS};
use panelprep_interfaces::page::LocalServer;
use panelprep_interfaces::page::label::{self, GridOutline, LabelSheet};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

/// Serves the page until the person is done, and reports what was stored.
///
/// # Errors
/// If the folder holds no clip, its labels or draft are invalid, recipe and panel do not fit, or the page cannot be
/// served.
pub fn run(args: &Label, common: &Common) -> Result<Outcome, Fault> {
    if !args.clip.join("clip.csv").exists() {
        return Err(ClipFault::NoClip { folder: args.clip.clone() }.into());
    }
    let clip = read_clip(&args.clip)?;
    let (grids, camera) = match &args.recipe {
        Some(recipe) => {
            let (grids, camera) = grids(recipe, args, common)?;
            (grids, Some(camera))
        }
        None => (Vec::new(), None),
    };
    let size_px = size_px(&args.clip, clip.entries(), camera.as_ref())?;
    let wet = clip.entries().iter().filter(|shot| shot.phase == Phase::Wet);
    let frame = ClipFrame { size_px, wet_times_s: wet.map(|shot| shot.time_s).collect() };
    let keeping = Arc::new(LabelFolder::new(&args.clip, clip_hash(&args.clip, &clip)?, frame));
    let found = keeping.now()?;
    if let Some(note) = &found.note {
        write_progress(note);
    }
    let sheet = LabelSheet {
        folder: args.clip.clone(),
        shots: clip.entries().to_vec(),
        size_px,
        grids,
        keep: keeping.clone(),
    };
    let local = LocalServer::listen(args.listen).map_err(Fault::stage)?;
    write_progress(&format!("Mark where the film broke: open {} in a browser on this computer.", local.url()));
    let saved = label::serve(local, sheet).map_err(Fault::stage)?;
    build_outcome(&keeping, &args.clip, saved)
}

/// The size of the clip's pictures, read from the first one. With a recipe, it must be the size of the calibrated
/// camera.
fn size_px(folder: &Path, shots: &[ClipEntry], camera: Option<&PinholeCamera>) -> Result<[usize; 2], Fault> {
    let Some(first) = shots.first() else { return Err(Fault::stage(files::ClipError::Empty)) };
    let file = folder.join(&first.file);
    let picture = match camera {
        Some(camera) => load::picture(&file, camera)?,
        None => files::read_color(&disk::read(&file)?).map_err(|error| Fault::file_fault(&file, error))?,
    };
    Ok([picture.width, picture.height])
}

/// The grids as the camera sees them, and the camera.
fn grids(recipe_file: &Path, args: &Label, common: &Common) -> Result<(Vec<GridOutline>, PinholeCamera), Fault> {
    let cell_files = CellFiles::read(common)?;
    let recipe = load::recipe(recipe_file)?;
    let placed = PlacedPanel::read(&cell_files, &recipe, args.located.as_ref())?;
    let taught = load::taught(&cell_files, recipe_file, &recipe)?;
    let camera_from_panel = placed.base_from_camera.inverse() * placed.base_from_panel;
    let outline = |grid: &panelprep_cell::panel::Grid| {
        let seen = grid.edge.iter().filter_map(|&point| placed.camera.project(camera_from_panel * point));
        GridOutline { id: grid.id.to_string(), edge_px: seen.map(|pixel| [pixel.u, pixel.v]).collect() }
    };
    Ok((taught.panel.grids.iter().map(outline).collect(), placed.camera))
}

/// Reports the labels that are stored now.
fn build_outcome(keeping: &LabelFolder, folder: &Path, saved: u32) -> Result<Outcome, Fault> {
    let (labels, is_draft) = (keeping.labels()?, keeping.now()?.is_draft);
    let file = folder.join(LABELS);
    let words = match &labels {
        Some(labels) if saved > 0 && labels.clean => "saved: the clip is clean (no breaks)".to_owned(),
        Some(labels) if saved > 0 => format!("saved, breaks: {}", labels.breaks.len()),
        _ => "nothing was saved".to_owned(),
    };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
    outcome.lines = vec![format!("{}: {words}", file.display())];
    if is_draft {
        outcome.add_line("unsaved marks are kept; run the same command again to continue with them");
    }
    outcome.add_value("labels", json!(labels.is_some().then_some(file)));
    outcome.add_value("saved", json!(saved));
    outcome.add_value("unsaved", json!(is_draft));
    Ok(outcome)
}
