//! `panelprep label`: a person marks the broken film of a clip on a page in a browser. The labels are saved in the
//! folder of the clip: `labels.json` with its mask and times, earlier versions, and a draft with unsaved changes.
//!
//! Before `labels.json` is replaced, it is copied to the first free `labels.N.json`, so that no version is lost; the
//! lowest number is the oldest version. Mask and times are written before `labels.json`, and the draft is deleted last.
//! After a power failure in between, the draft still exists and is saved again.

use super::args::{Common, Label};
use super::disk;
use super::fault::{ClipFault, Fault};
use super::inspected::{PlacedPanel, clip_hash, read_clip};
use super::load;
use super::output::{Outcome, write_progress};
use panelprep_base::geometry::PinholeCamera;
use panelprep_base::number_text::utc_text;
use panelprep_base::phase::Phase;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::files::{self, ClipEntry};
use panelprep_cell::labels::{
    self, ClipFrame, DRAFT_FILE, LABELS, LabelFile, MASK, Statement, TIMES_FILE, VERSION, broken_pixels, problems,
};
use panelprep_interfaces::page::LocalServer;
use panelprep_interfaces::page::label::{self, CurrentLabels, GridOutline, LabelSheet, LabelStorage, SaveResult};
use panelprep_service::setup::{self, CellFiles, clock::now_unix_s};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Serves the page until the person ends it, and reports what was saved.
///
/// # Errors
/// If the folder contains no clip, its labels or draft are invalid, the recipe does not match the panel, or the page
/// cannot be served.
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

/// Returns the size of the clip's pictures, from the first picture. With a recipe, it must be the size of the
/// calibrated camera.
fn size_px(folder: &Path, shots: &[ClipEntry], camera: Option<&PinholeCamera>) -> Result<[usize; 2], Fault> {
    let Some(first) = shots.first() else { return Err(Fault::stage(files::ClipError::Empty)) };
    let file = folder.join(&first.file);
    let picture = match camera {
        Some(camera) => load::picture(&file, camera)?,
        None => files::read_color(&disk::read(&file)?).map_err(|error| Fault::file_fault(&file, error))?,
    };
    Ok([picture.width, picture.height])
}

/// Returns the outlines of the grids in the camera's picture, and the camera.
fn grids(recipe_file: &Path, args: &Label, common: &Common) -> Result<(Vec<GridOutline>, PinholeCamera), Fault> {
    let cell_files = CellFiles::read(&common.paths())?;
    let recipe = load::read_recipe(recipe_file)?;
    let placed = PlacedPanel::read(&cell_files, &recipe, args.located.as_ref())?;
    let taught = setup::taught(&cell_files, recipe_file, &recipe)?;
    let camera_from_panel = placed.base_from_camera.inverse() * placed.base_from_panel;
    let outline = |grid: &panelprep_cell::panel::Grid| {
        let seen = grid.edge.iter().filter_map(|&point| placed.camera.project(camera_from_panel * point));
        GridOutline { id: grid.id.to_string(), edge_px: seen.map(|pixel| [pixel.u, pixel.v]).collect() }
    };
    Ok((taught.panel.grids.iter().map(outline).collect(), placed.camera))
}

/// Reports the labels that are saved in the folder.
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

/// The folder in which the labels of a clip are saved.
struct LabelFolder {
    folder: PathBuf,
    clip_sha256: String,
    frame: ClipFrame,
}

impl LabelFolder {
    /// Creates the storage for the labels of the clip in this folder.
    fn new(folder: &Path, clip_sha256: String, frame: ClipFrame) -> Self {
        LabelFolder { folder: folder.to_owned(), clip_sha256, frame }
    }

    fn read(&self, name: &str) -> Result<Option<LabelFile>, Fault> {
        let file = self.folder.join(name);
        if !file.exists() {
            return Ok(None);
        }
        let found = labels::read(&disk::read(&file)?)
            .map_err(|error| ClipFault::BadLabels { file: file.clone(), cause: error })?;
        Ok(Some(found))
    }

    /// Returns the labels that were saved last; `None` if there are none.
    ///
    /// # Errors
    /// If the file is invalid.
    fn labels(&self) -> Result<Option<LabelFile>, Fault> {
        self.read(LABELS)
    }

    /// Returns the current marks: the draft if there is one, otherwise the saved labels.
    ///
    /// # Errors
    /// If a file is invalid.
    fn now(&self) -> Result<CurrentLabels, Fault> {
        let (labels, draft) = (self.labels()?, self.read(DRAFT_FILE)?);
        let saved_at = labels.as_ref().map(|labels| labels.saved_at.clone());
        let is_draft = draft.is_some();
        let Some(found) = draft.or(labels) else {
            return Ok(CurrentLabels { said: Statement::default(), saved_at, is_draft, note: None });
        };
        let note = (found.clip_sha256 != self.clip_sha256).then(|| {
            "the clip has changed since these labels were made: check each break again, and save".to_owned()
        });
        Ok(CurrentLabels { said: found.statement(), saved_at, is_draft, note })
    }

    fn label_file(&self, said: &Statement) -> LabelFile {
        LabelFile {
            version: VERSION,
            author: said.author.trim().to_owned(),
            saved_at: utc_text(now_unix_s()),
            clip_sha256: self.clip_sha256.clone(),
            size_px: self.frame.size_px,
            clean: said.clean,
            breaks: said.breaks.clone(),
        }
    }

    /// Copies the current labels to the file with the first free number, and returns its name.
    fn back_up_former(&self) -> Result<Option<String>, Fault> {
        let file = self.folder.join(LABELS);
        if !file.exists() {
            return Ok(None);
        }
        let bytes = disk::read(&file)?;
        let mut number = 1_u32;
        loop {
            let name = format!("labels.{number}.json");
            match disk::write_new(&self.folder.join(&name), &bytes) {
                Err(Fault::AlreadyExists { .. }) => number += 1,
                written => return written.map(|()| Some(name)),
            }
        }
    }

    /// Writes labels, mask and times; returns the name of the file to which the former labels were copied.
    fn write(&self, labels: &LabelFile) -> Result<Option<String>, Fault> {
        let broken = broken_pixels(&labels.breaks, &self.frame);
        let pictures = [
            (MASK, files::write_gray_png(&broken.mask().to_gray())),
            (TIMES_FILE, files::write_color_png(&broken.times())),
        ];
        let former = self.back_up_former()?;
        for (name, bytes) in pictures {
            disk::write_durable(&self.folder.join(name), bytes.map_err(Fault::stage)?)?;
        }
        disk::write_durable(&self.folder.join(LABELS), labels::write(labels))?;
        let draft = self.folder.join(DRAFT_FILE);
        if draft.exists() {
            std::fs::remove_file(&draft).map_err(|error| Fault::file_fault(&draft, error))?;
        }
        Ok(former)
    }
}

impl LabelStorage for LabelFolder {
    fn now(&self) -> Result<CurrentLabels, String> {
        LabelFolder::now(self).map_err(|fault| fault.to_string())
    }

    fn store_draft(&self, said: &Statement) -> Result<(), String> {
        let text = labels::write(&self.label_file(said));
        disk::write(&self.folder.join(DRAFT_FILE), text).map_err(|fault| fault.to_string())
    }

    fn save(&self, said: &Statement) -> Result<SaveResult, Vec<String>> {
        let problems = problems(said, &self.frame);
        if !problems.is_empty() {
            return Err(problems.iter().map(ToString::to_string).collect());
        }
        let labels = self.label_file(said);
        let former = self.write(&labels).map_err(|fault| vec![fault.to_string()])?;
        Ok(SaveResult { labels: self.folder.join(LABELS).display().to_string(), saved_at: labels.saved_at, former })
    }
}
