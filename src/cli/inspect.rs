//! `panelprep inspect`: the water-break test on a clip, or on a labelled set of them.

use super::args::{Common, Inspect};
use super::disk;
use super::fault::Fault;
use super::labels::{Labels, read_clip};
use super::load::{self, CellFiles, Taught};
use super::outcome::Outcome;
use super::output;
use super::pictures;
use super::validate;
use crate::files::{self, ClipEntry};
use crate::geometry::{Base, Camera, ColorPicture, Panel, PinholeCamera, Rigid, median};
use crate::inspect::{Confusion, Demands, Inspection, Score, Watch, score};
use crate::labels::{LABELS, MASK};
use crate::panel::Grid;
use crate::phase::Phase;
use crate::recipe::Recipe;
use crate::report::page::Figure;
use crate::report::{StripPicture, View, bounds, cut, film_strip, inspection_page, strip_times_s};
use rayon::prelude::*;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Pictures decoded at once; bounds the memory of a long clip.
const DECODED_AT_ONCE: usize = 8;

/// An inspected clip.
pub struct Inspected {
    /// The inspection.
    pub inspection: Inspection,
    /// From a decoded wet picture to its result, median, ms.
    pub ms_per_frame: f64,
    /// Agreement with a truth that was given.
    pub score: Option<(Score, Confusion)>,
    clip: PathBuf,
    shots: Vec<ClipEntry>,
    camera: PinholeCamera,
    camera_from_panel: Rigid<Camera, Panel>,
}

/// Where the panel stands in the camera's view.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    /// The camera.
    pub camera: PinholeCamera,
    /// Where it stands.
    pub base_from_camera: Rigid<Base, Camera>,
    /// Where the panel stands.
    pub base_from_panel: Rigid<Base, Panel>,
    /// Did nobody say where, so that it is taken to stand in its nominal place?
    pub is_assumed: bool,
}

impl Placed {
    /// From the cell's files and where `locate` found the panel.
    ///
    /// # Errors
    /// Where a file is not what it must be.
    pub fn read(files: &CellFiles, located: Option<&PathBuf>) -> Result<Self, Fault> {
        Ok(Placed {
            camera: files.scanner()?.value,
            base_from_camera: files.base_from_camera()?.value,
            base_from_panel: load::located(located)?,
            is_assumed: located.is_none(),
        })
    }
}

/// Inspects a clip and tells.
///
/// # Errors
/// Where a file is not what it must be, or the panel was not taught.
pub fn run(args: &Inspect, common: &Common) -> Result<Outcome, Fault> {
    if let Some(folder) = args.pictures.as_ref().filter(|folder| folder.join(LABELS).exists()) {
        return Err(Fault::HoldsLabels { folder: folder.clone() });
    }
    let files = CellFiles::read(common)?;
    let recipe = load::recipe(&args.recipe)?;
    let placed = Placed::read(&files, args.located.as_ref())?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let demands = Demands::of(&recipe, files.cell.limits());
    let clip = match (&args.clip, &args.truth) {
        (Some(clip), _) => clip,
        (None, Some(set)) => {
            return validate::run(&taught, set, placed, &recipe, demands, args.pictures.as_deref());
        }
        (None, None) => return Err(Fault::stage(files::ClipError::Empty)),
    };
    let inspected = stage(&taught, clip, placed, &recipe, demands, args.truth.as_deref())?;
    let mut mask = None;
    if let Some(folder) = &args.pictures {
        let file = folder.join(MASK);
        let bytes = files::write_gray_png(&inspected.inspection.mask().to_gray()).map_err(Fault::stage)?;
        disk::write(&file, bytes)?;
        mask = Some(file);
        let drawn = [
            (
                "inspected",
                "What broke by the end of the film, and the grids that failed",
                inspected.drawn(&taught)?,
            ),
            ("break_times", "When it broke", inspected.break_times(&taught)?),
            ("film", "The film in time; in colour what had broken by then", inspected.strip()?),
        ];
        let mut figures = Vec::with_capacity(drawn.len());
        for (name, caption, picture) in &drawn {
            pictures::save(folder, name, picture)?;
            let jpeg = files::write_color_jpeg(picture).map_err(Fault::stage)?;
            figures.push(Figure { caption: (*caption).to_owned(), jpeg });
        }
        let page =
            inspection_page(&inspected.inspection, (&recipe, &demands), &clip.display().to_string(), figures);
        disk::write(&folder.join("inspection.html"), page.html())?;
    }
    Ok(inspected.outcome(mask))
}

/// Runs the test on the pictures of a clip folder.
///
/// # Errors
/// Where `clip.csv` or a picture is missing, damaged or of another size.
pub fn stage(
    taught: &Taught,
    clip: &Path,
    placed: Placed,
    recipe: &Recipe,
    demands: Demands,
    truth: Option<&Path>,
) -> Result<Inspected, Fault> {
    let list = clip.join("clip.csv");
    let shots = read_clip(clip)?.shots().to_vec();
    let camera_from_panel = placed.base_from_camera.inverse() * placed.base_from_panel;
    let mut watch = Watch::new(&taught.panel, &placed.camera, camera_from_panel, recipe.inspect(), demands)
        .map_err(Fault::stage)?;
    if placed.is_assumed {
        watch.assume_place();
    }
    let (mut wet_ms, mut opened) = (Vec::with_capacity(shots.len()), false);
    for group in shots.chunks(DECODED_AT_ONCE) {
        let decoded: Vec<Result<ColorPicture, Fault>> =
            group.par_iter().map(|shot| load::picture(&clip.join(&shot.file), &placed.camera)).collect();
        for (shot, picture) in group.iter().zip(decoded) {
            let picture = picture?;
            let begin = Instant::now();
            let step = watch.push(&picture, shot.time_s, shot.phase);
            let step = step.map_err(|error| Fault::file(&clip.join(&shot.file), error))?;
            let Some(since_wet_s) = step.since_wet_s else { continue };
            wet_ms.push(begin.elapsed().as_secs_f64() * 1e3);
            if !opened && !step.newly_failed.is_empty() {
                opened = true;
                let grids: Vec<String> = step.newly_failed.iter().map(ToString::to_string).collect();
                output::tell_line(&format!("{since_wet_s:6.1} s  the film broke on {}", grids.join(", ")));
            }
        }
    }
    let inspection = watch.finish().map_err(|error| Fault::file(&list, error))?;
    let score = truth.map(|folder| scored(&inspection, folder, clip)).transpose()?;
    let ms_per_frame = median(&mut wet_ms).unwrap_or_default();
    let clip = clip.to_owned();
    Ok(Inspected { inspection, ms_per_frame, score, clip, shots, camera: placed.camera, camera_from_panel })
}

fn scored(inspection: &Inspection, folder: &Path, clip: &Path) -> Result<(Score, Confusion), Fault> {
    let file = folder.join(MASK);
    let truth = Labels::read(folder, clip)?.mask;
    let agreement = score(&inspection.mask(), &truth, &inspection.footprint.region());
    let named = |error| Fault::file(&file, error);
    Ok((agreement.map_err(named)?, inspection.confusion(&truth).map_err(named)?))
}

impl Inspected {
    fn picture(&self, shot: &ClipEntry) -> Result<ColorPicture, Fault> {
        load::picture(&self.clip.join(&shot.file), &self.camera)
    }

    /// Did this grid fail?
    pub fn failed(&self, grid: &Grid) -> bool {
        self.inspection.grids.iter().any(|inspected| inspected.id == grid.id && inspected.failed)
    }

    /// The last picture, with the camera and where the panel stands before it.
    ///
    /// # Errors
    /// Where the picture cannot be read again.
    pub fn last_view(&self) -> Result<(ColorPicture, PinholeCamera, Rigid<Camera, Panel>), Fault> {
        let last = self.shots.last().ok_or_else(|| Fault::stage(files::ClipError::Empty))?;
        Ok((self.picture(last)?, self.camera, self.camera_from_panel))
    }

    /// The last picture with everything that broke.
    ///
    /// # Errors
    /// Where the picture cannot be read again, or OpenCV refuses to draw.
    pub fn drawn(&self, taught: &Taught) -> Result<ColorPicture, Fault> {
        let (picture, ..) = self.last_view()?;
        let view = View { picture: &picture, camera: &self.camera, camera_from_panel: self.camera_from_panel };
        let mask = self.inspection.mask();
        view.inspected(&taught.panel, &mask, &|grid| self.failed(grid)).map_err(Fault::stage)
    }

    /// When everything broke.
    ///
    /// # Errors
    /// As [`Inspected::drawn`].
    pub fn break_times(&self, taught: &Taught) -> Result<ColorPicture, Fault> {
        let (picture, ..) = self.last_view()?;
        let view = View { picture: &picture, camera: &self.camera, camera_from_panel: self.camera_from_panel };
        let time_s = |column: usize, row: usize| self.inspection.break_time_s(column, row);
        view.break_times(&taught.panel, &time_s, self.inspection.observation.observed_s).map_err(Fault::stage)
    }

    /// The film in time: from the first fully wet picture to the last.
    ///
    /// # Errors
    /// As [`Inspected::drawn`].
    pub fn strip(&self) -> Result<ColorPicture, Fault> {
        let wet: Vec<&ClipEntry> = self.shots.iter().filter(|shot| shot.phase == Phase::Wet).collect();
        let Some(first) = wet.first() else { return Err(Fault::stage(files::ClipError::Empty)) };
        let edges = self.inspection.footprint.grids().iter().flat_map(|grid| grid.edge_px.iter().copied());
        let bounds = bounds(edges, (self.camera.width_px, self.camera.height_px));
        let opens_s = self.inspection.breaks.iter().map(|found| found.first_seen_s).reduce(f64::min);
        let chosen = strip_times_s(opens_s, self.inspection.observation.observed_s).into_iter().map(|time_s| {
            let later = wet.iter().find(|shot| shot.time_s - first.time_s >= time_s - 1e-6);
            later.or(wet.last()).copied().unwrap_or(first)
        });
        let pictures = chosen
            .map(|shot| {
                let since_wet_s = shot.time_s - first.time_s;
                let broken = self.inspection.mask_at(since_wet_s);
                let (picture, broken) = cut(&self.picture(shot)?, &broken, bounds);
                Ok(StripPicture { picture, broken, label: format!("{since_wet_s:.1} s") })
            })
            .collect::<Result<Vec<_>, Fault>>()?;
        film_strip(&pictures).map_err(Fault::stage)
    }

    fn outcome(&self, mask: Option<PathBuf>) -> Outcome {
        let inspection = &self.inspection;
        let mut outcome = Outcome::of(&inspection.judgement);
        let breaks: Vec<_> = inspection
            .breaks
            .iter()
            .map(|found| {
                let grids: Vec<String> = found.grids.iter().map(ToString::to_string).collect();
                json!({"area_mm2": found.area_mm2, "first_seen_s": found.first_seen_s, "grids": grids,
                       "closed_again": found.closed_again()})
            })
            .collect();
        let grids: Vec<_> = inspection
            .grids
            .iter()
            .map(|grid| {
                json!({"id": grid.id.to_string(), "failed": grid.failed, "seen": grid.seen,
                       "wet_when_dry": grid.wet_when_dry,
                       "broken_mm2": grid.broken_mm2, "time_to_break_s": grid.time_to_break_s})
            })
            .collect();
        let observation = &inspection.observation;
        outcome.say(format!(
            "watched {:.1} s, {} wet pictures, {} breaks; {:.1} ms a picture",
            observation.observed_s,
            observation.frames,
            breaks.len(),
            self.ms_per_frame
        ));
        outcome.put("observed_s", json!(observation.observed_s));
        outcome.put("frames", json!(observation.frames));
        outcome.put("breaks", json!(breaks));
        outcome.put("grids", json!(grids));
        let quality = &observation.quality;
        let limit_mm2 = observation.detection_limit_mm2;
        outcome.say(format!(
            "{} of them can be judged by; light {:.2} to {:.2} of the dry picture's; wet in no picture {:.1} %; smallest \
             break that is surely found {limit_mm2:.1} mm²",
            quality.usable, quality.light[0], quality.light[1], observation.never_wet_percent
        ));
        outcome.put("usable_frames", json!(quality.usable));
        outcome.put("never_wet_percent", json!(observation.never_wet_percent));
        outcome.put("detection_limit_mm2", json!(limit_mm2));
        outcome.put("outline_off_px", json!(quality.off_px));
        outcome.put("light", json!(quality.light.map(|share| share.is_finite().then_some(share))));
        outcome.put("moved_px", json!(quality.moved_px));
        outcome.put("sharpness", json!(quality.sharpness));
        outcome.put("mask", json!(mask));
        outcome.put("ms_per_frame", json!(self.ms_per_frame));
        if let Some((score, confusion)) = &self.score {
            outcome.say(format!(
                "against the truth: intersection over union {:.3}, precision {:.3}, recall {:.3}; grids: {} rightly \
                 failed, {} wrongly failed, {} wrongly passed",
                score.iou, score.precision, score.recall, confusion.true_fail, confusion.false_fail, confusion.false_pass
            ));
            outcome.put(
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
