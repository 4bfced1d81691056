//! The inspection of a clip in a folder, and the labels of the clip (from the renderer or from a person): a mask and,
//! if known, the times of the breaks.

use super::disk;
use super::fault::{ClipFault, Fault};
use super::load;
use super::output::{self, Outcome};
use panelprep_base::geometry::{Base, Camera, ColorPicture, Mask, Panel, PinholeCamera, Rigid, median};
use panelprep_base::phase::Phase;
use panelprep_cell::files::{self, Clip, ClipEntry, content_hash};
use panelprep_cell::labels::{self, LABELS, MASK, TIMES_FILE, color_to_time};
use panelprep_cell::panel::GridId;
use panelprep_cell::recipe::Recipe;
use panelprep_service::setup::{CellFiles, LoadedPanel};
use panelprep_service::stages::film::{FilmOutcome, FilmRun, FilmSetup};
use panelprep_toolpath::path::touching;
use panelprep_vision::inspect::{Confusion, Demands, Inspection, Score, score};
use rayon::prelude::*;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Number of pictures that are decoded at the same time, which limits the memory for a long clip.
const DECODE_BATCH: usize = 8;

/// An inspected clip.
pub struct InspectedClip {
    /// The film.
    pub filmed: FilmOutcome,
    /// Median computing time of a wet picture, without decoding, ms.
    pub ms_per_frame: f64,
    /// The comparison with the ground truth, if one was given.
    pub score: Option<(Score, Confusion)>,
}

/// The pose of the panel in the camera's frame.
#[derive(Debug, Clone, Copy)]
pub struct PlacedPanel {
    /// The camera.
    pub camera: PinholeCamera,
    /// The camera's pose.
    pub base_from_camera: Rigid<Base, Camera>,
    /// The panel's pose.
    pub base_from_panel: Rigid<Base, Panel>,
    /// Whether the nominal pose is assumed, because no pose was given.
    pub is_assumed: bool,
}

impl PlacedPanel {
    /// Reads the mount of the camera, and the pose of the panel that `locate` found.
    ///
    /// # Errors
    /// If a file is invalid.
    pub fn read(files: &CellFiles, recipe: &Recipe, located: Option<&PathBuf>) -> Result<Self, Fault> {
        Ok(PlacedPanel {
            camera: files.scanner()?.value,
            base_from_camera: files.base_from_camera()?.value,
            base_from_panel: load::located(located, recipe)?,
            is_assumed: located.is_none(),
        })
    }

    /// Returns the parameters for the inspection of a taught panel.
    pub fn inspection_setup<'a>(
        &'a self,
        taught: &'a LoadedPanel,
        recipe: &'a Recipe,
        demands: Demands,
    ) -> FilmSetup<'a> {
        let camera_from_panel: Rigid<Camera, Panel> = self.base_from_camera.inverse() * self.base_from_panel;
        FilmSetup { panel: &taught.panel, camera: &self.camera, camera_from_panel, sanded: None, demands, recipe }
    }
}

/// Returns the pixels that the disc may have touched, from the grids that a person names; `None` if no grid is named.
///
/// # Errors
/// If a name is not that of a grid of the panel.
pub fn abraded_pixels(words: &[String], taught: &LoadedPanel, recipe: &Recipe) -> Result<Option<Mask>, Fault> {
    let region = &taught.panel.region;
    let grids = match words {
        [] => return Ok(None),
        [all] if all == "all" => region.ids().collect(),
        words => {
            let grids = words.iter().map(|word| word.parse::<GridId>().map_err(Fault::stage));
            let grids = grids.collect::<Result<Vec<_>, _>>()?;
            if let Some(grid) = grids.iter().find(|grid| !region.ids().any(|id| id == **grid)) {
                let (rows, columns) = (region.rows, region.columns);
                return Err(Fault::stage(UnknownGrid { grid: *grid, rows, columns }));
            }
            grids
        }
    };
    Ok(Some(touching::touched_pixels(&grids, &taught.panel, recipe.path())))
}

/// The error for a grid that the panel does not have.
#[derive(Debug, thiserror::Error)]
#[error("the region has no grid {grid}; valid: r1c1 to r{rows}c{columns} ({rows} rows, {columns} columns)")]
struct UnknownGrid {
    grid: GridId,
    rows: usize,
    columns: usize,
}

/// Inspects the pictures in the folder of a clip.
///
/// # Errors
/// If `clip.csv` or a picture is missing, damaged or of another size.
pub fn inspect(
    setup: &FilmSetup<'_>,
    clip: &Path,
    is_place_assumed: bool,
    truth: Option<&Path>,
) -> Result<InspectedClip, Fault> {
    let list = clip.join("clip.csv");
    let parsed = read_clip(clip)?;
    let shots = parsed.entries();
    let mut filming = FilmRun::begin_test(setup, lasts_s(shots)).map_err(Fault::stage)?;
    if is_place_assumed {
        filming.assume_nominal_pose();
    }
    let mut wet_ms = Vec::with_capacity(shots.len());
    for group in shots.chunks(DECODE_BATCH) {
        let decoded: Vec<Result<ColorPicture, Fault>> =
            group.par_iter().map(|shot| load::picture(&clip.join(&shot.file), setup.camera)).collect();
        for (shot, picture) in group.iter().zip(decoded) {
            let picture = Arc::new(picture?);
            let begin = Instant::now();
            let added = filming.push(&picture, shot.time_s, shot.phase);
            let added = added.map_err(|error| Fault::file_fault(&clip.join(&shot.file), error))?;
            let Some(since_wet_s) = added.since_wet_s else { continue };
            wet_ms.push(begin.elapsed().as_secs_f64() * 1e3);
            if let Some(grids) = added.newly_broken_grids {
                output::write_progress(&format!("{since_wet_s:6.1} s  the film broke on {grids}"));
            }
        }
    }
    let filmed = filming.finish().map_err(|error| Fault::file_fault(&list, error))?;
    let score = truth.map(|folder| score_clip(&filmed.inspection, folder, clip)).transpose()?;
    Ok(InspectedClip { filmed, ms_per_frame: median(&mut wet_ms).unwrap_or_default(), score })
}

/// Returns the time from the first picture of the wet panel to the last one, s.
fn lasts_s(shots: &[ClipEntry]) -> f64 {
    let mut wet_s = shots.iter().filter(|shot| shot.phase == Phase::Wet).map(|shot| shot.time_s);
    let first_s = wet_s.next().unwrap_or(0.0);
    wet_s.next_back().unwrap_or(first_s) - first_s
}

fn score_clip(inspection: &Inspection, folder: &Path, clip: &Path) -> Result<(Score, Confusion), Fault> {
    let file = folder.join(MASK);
    let truth = Labels::read(folder, clip)?.mask;
    let agreement = score(&inspection.mask(), &truth, &inspection.footprint.region());
    let named = |error| Fault::file_fault(&file, error);
    Ok((agreement.map_err(named)?, inspection.compare_with_truth(&truth).map_err(named)?))
}

impl InspectedClip {
    pub fn outcome(&self, mask: Option<PathBuf>) -> Outcome {
        let inspection = &*self.filmed.inspection;
        let mut outcome = Outcome::from_judgement(&inspection.judgement);
        outcome.add_checks(&inspection.checks);
        let breaks: Vec<_> = inspection
            .breaks
            .iter()
            .map(|found| {
                let grids: Vec<String> = found.grids.iter().map(ToString::to_string).collect();
                json!({"area_mm2": found.area_mm2, "first_seen_s": found.first_seen_s, "grids": grids,
                       "closed_again": found.has_closed_again()})
            })
            .collect();
        let grids: Vec<_> = inspection
            .grids
            .iter()
            .map(|grid| {
                json!({"id": grid.id.to_string(), "failed": grid.failed, "seen": grid.seen,
                       "reference": grid.reference.describe(),
                       "wet_when_dry": grid.wet_when_dry,
                       "broken_mm2": grid.broken_mm2, "time_to_break_s": grid.time_to_break_s})
            })
            .collect();
        let observation = &inspection.observation;
        outcome.add_line(format!(
            "film observed for {:.1} s: {} wet pictures, {} breaks; computing time {:.1} ms per picture",
            observation.observed_s,
            observation.frames,
            breaks.len(),
            self.ms_per_frame
        ));
        outcome.add_value("observed_s", json!(observation.observed_s));
        outcome.add_value("frames", json!(observation.frames));
        outcome.add_value("breaks", json!(breaks));
        outcome.add_value("grids", json!(grids));
        let quality = &observation.quality;
        let limit_mm2 = observation.detection_limit_mm2;
        outcome.add_line(format!(
            "{} wet pictures are usable; light {:.2} to {:.2} times that of the dry picture; {:.1} % of the area was wet in \
             no picture; smallest break that is reliably found {limit_mm2:.1} mm²",
            quality.usable, quality.light[0], quality.light[1], observation.never_wet_percent
        ));
        outcome.add_value("usable_frames", json!(quality.usable));
        outcome.add_value("never_wet_percent", json!(observation.never_wet_percent));
        outcome.add_value("detection_limit_mm2", json!(limit_mm2));
        outcome.add_value("outline_off_px", json!(quality.off_px));
        outcome.add_value("light", json!(quality.light.map(|share| share.is_finite().then_some(share))));
        outcome.add_value("moved_px", json!(quality.moved_px));
        outcome.add_value("sharpness", json!(quality.sharpness));
        outcome.add_value("mask", json!(mask));
        outcome.add_value("ms_per_frame", json!(self.ms_per_frame));
        if let Some((score, confusion)) = &self.score {
            outcome.add_line(format!(
                "compared with the true mask: intersection over union {:.3}, precision {:.3}, recall {:.3}; grids: {} rightly \
                 failed, {} wrongly failed, {} wrongly passed",
                score.iou, score.precision, score.recall, confusion.true_fail, confusion.false_fail, confusion.false_pass
            ));
            outcome.add_value(
                "score",
                json!({
                    "iou": score.iou, "precision": score.precision, "recall": score.recall,
                    "grids": {"true_fail": confusion.true_fail, "false_fail": confusion.false_fail,
                              "false_pass": confusion.false_pass, "true_pass": confusion.true_pass},
                }),
            );
        }
        outcome
    }
}

/// The ground truth of a clip.
pub struct Labels {
    /// The pixels at which the film was broken at the end of the clip.
    pub mask: Mask,
    times: Option<ColorPicture>,
}

impl Labels {
    /// Reads the labels in a folder. Labels that a person made must belong to this clip.
    ///
    /// # Errors
    /// If there is no mask, a file is invalid, or the labels belong to another clip.
    pub fn read(folder: &Path, clip: &Path) -> Result<Self, Fault> {
        let file = folder.join(LABELS);
        if file.exists() {
            let labelled = labels::read(&disk::read(&file)?).map_err(|error| Fault::file_fault(&file, error))?;
            if labelled.clip_sha256 != clip_hash(clip, &read_clip(clip)?)? {
                return Err(ClipFault::OtherClip { labels: file, clip: clip.to_owned() }.into());
            }
        }
        let file = folder.join(MASK);
        let gray = files::read_gray(&disk::read(&file)?).map_err(|error| Fault::file_fault(&file, error))?;
        let file = folder.join(TIMES_FILE);
        let times = match file.exists() {
            true => Some(files::read_color(&disk::read(&file)?).map_err(|error| Fault::file_fault(&file, error))?),
            false => None,
        };
        Ok(Labels { mask: Mask::from_gray(&gray), times })
    }

    /// Returns the time at which the film broke at a pixel, s; `None` if it did not break or the time is not known.
    pub fn time_s(&self, index: usize) -> Option<f64> {
        color_to_time(*self.times.as_ref()?.rgb.get(index)?)
    }
}

/// Finds the folder with the labels of a clip: its subfolder `truth`, in which the renderer writes them, or the folder
/// of the clip itself, in which the labels of a person are saved.
///
/// # Errors
/// If the clip has no labels.
pub fn find_label_folder(clip: &Path) -> Result<PathBuf, Fault> {
    let folders = [clip.join("truth"), clip.to_owned()];
    let labelled = folders.into_iter().find(|folder| folder.join(MASK).exists());
    labelled.ok_or_else(|| ClipFault::NoLabels { clip: clip.to_owned() }.into())
}

/// Reads the list of a clip's pictures (`clip.csv`).
///
/// # Errors
/// If the folder contains no list, or the list is invalid.
pub fn read_clip(folder: &Path) -> Result<Clip, Fault> {
    let list = folder.join("clip.csv");
    files::read_clip(&disk::read(&list)?).map_err(|error| Fault::file_fault(&list, error))
}

/// Returns the hash of a clip: the hash of the output of `sha256sum clip.csv FILE…`.
///
/// # Errors
/// If one of the files cannot be read.
pub fn clip_hash(folder: &Path, clip: &Clip) -> Result<String, Fault> {
    let names = std::iter::once("clip.csv").chain(clip.entries().iter().map(|shot| shot.file.as_str()));
    let lines: Result<String, Fault> =
        names.map(|name| Ok(format!("{}  {name}\n", content_hash(&disk::read(&folder.join(name))?)))).collect();
    Ok(content_hash(lines?.as_bytes()))
}
