//! The water-break test: pictures are added one by one while the film is observed, or while a clip is read. After the
//! last picture the film is evaluated.
//!
//! Some pictures are kept for the strip, cropped to the region: uniformly distributed over time, and at short intervals
//! after the film has broken.

use super::{ResultDrawing, names};
use crate::report::{FailedGrid, PanelOverlay, StripPicture, bounds, crop_with_mask, film_strip, strip_times_s};
use panelprep_base::geometry::{Camera, ColorPicture, Mask, Panel, PinholeCamera, Rigid};
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::phase::Phase;
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::{Grid, GridId, TaughtPanel};
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{Check, Finding, Kind, name};
use panelprep_vision::inspect::{
    self, ComparisonReference, Demands, FilmWatch, GridInspection, InspectError, Inspection, PictureResult,
};
use std::sync::Arc;

/// The data for the observation of a film.
#[derive(Debug, Clone, Copy)]
pub struct FilmSetup<'a> {
    /// The taught panel.
    pub panel: &'a TaughtPanel,
    /// The camera that records the film.
    pub camera: &'a PinholeCamera,
    /// The panel's pose in the camera's frame.
    pub camera_from_panel: Rigid<Camera, Panel>,
    /// The taught pixels of places that were sanded after the dry picture was captured.
    pub sanded: Option<&'a Mask>,
    /// The duration of the observation, and the criteria of failure.
    pub demands: Demands,
    /// The recipe.
    pub recipe: &'a Recipe,
}

/// A film in progress.
#[derive(Debug)]
pub struct FilmRun {
    watch: FilmWatch,
    strip: KeyframeStrip,
    last: Option<Arc<ColorPicture>>,
    has_opened: bool,
}

/// The result of adding one picture to a film.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureOutcome {
    /// The time of the picture after the first fully wet picture, s; `None` before that.
    pub since_wet_s: Option<f64>,
    /// Names of the grids on which the film broke, if these are the first failed grids of this film.
    pub newly_broken_grids: Option<String>,
}

impl FilmRun {
    /// Begins a test with this expected duration, s.
    ///
    /// # Errors
    /// If no part of the region is in the picture.
    pub fn begin_test(setup: &FilmSetup<'_>, lasts_s: f64) -> Result<Self, InspectError> {
        let FilmSetup { panel, camera, camera_from_panel, sanded, demands, recipe } = *setup;
        let view = inspect::FilmView { taught: panel, camera, camera_from_panel, sanded };
        let watch = FilmWatch::new(&view, recipe.inspect(), demands)?;
        let strip = KeyframeStrip::new(panel, (camera, camera_from_panel), lasts_s);
        Ok(FilmRun { watch, strip, last: None, has_opened: false })
    }

    /// Uses the panel's nominal pose, because no pose was given: see [`Watch::assume_nominal_pose`].
    pub fn assume_nominal_pose(&mut self) {
        self.watch.assume_nominal_pose();
    }

    /// Sets the start time of the film on the clock of its pictures: see [`Watch::set_start`].
    pub fn set_start(&mut self, time_s: f64) {
        self.watch.set_start(time_s);
    }

    /// Adds the next picture; `time_s` is its time on any monotonic clock.
    ///
    /// # Errors
    /// If the picture does not have the size of the camera's pictures, or the pictures are not ordered by time.
    pub fn push(
        &mut self,
        picture: &Arc<ColorPicture>,
        time_s: f64,
        phase: Phase,
    ) -> Result<PictureOutcome, InspectError> {
        let step = self.watch.push(picture, time_s, phase)?;
        self.strip.offer_picture(picture, &step);
        self.last = Some(picture.clone());
        let opens = !self.has_opened && !step.newly_failed.is_empty();
        self.has_opened |= opens;
        let opened_on = opens.then(|| names(&step.newly_failed).join(", "));
        Ok(PictureOutcome { since_wet_s: step.since_wet_s, newly_broken_grids: opened_on })
    }

    /// Returns the newest picture, the pixels that have broken and the grids that have failed so far; `None` before the
    /// first picture.
    pub fn current_breaks(&self) -> Option<(Arc<ColorPicture>, Mask, Vec<GridId>)> {
        Some((self.last.clone()?, self.watch.mask(), self.watch.failed_grids()))
    }

    /// Evaluates the film: computes the verdict.
    ///
    /// # Errors
    /// If the film has no picture of the wet panel.
    pub fn finish(self) -> Result<FilmOutcome, InspectError> {
        let inspection = Arc::new(self.watch.finish()?);
        Ok(FilmOutcome { inspection, last: self.last, strip: self.strip })
    }
}

/// A completed film.
#[derive(Debug)]
pub struct FilmOutcome {
    /// The result of the inspection, with the verdict.
    pub inspection: Arc<Inspection>,
    /// The last picture.
    pub last: Option<Arc<ColorPicture>>,
    strip: KeyframeStrip,
}

/// Counts and times that do not belong to the result of the film.
#[derive(Debug, Clone, Copy)]
pub struct FilmCounts {
    /// Median time from the decoding of a picture to its result, ms.
    pub ms_per_picture: Option<f64>,
    /// Number of the camera's pictures that were not fetched in time, if the camera reports this number.
    pub dropped: Option<u64>,
}

impl FilmOutcome {
    /// Draws the film over time, and marks on its last picture where and when the film broke.
    pub fn draw_film(&self, setup: &FilmSetup<'_>) -> Vec<ResultDrawing> {
        let Some(last) = &self.last else { return Vec::new() };
        let inspection = &*self.inspection;
        let view = PanelOverlay { picture: last, camera: setup.camera, camera_from_panel: setup.camera_from_panel };
        let failed = |grid: &Grid| inspection.grids.iter().any(|found| found.id == grid.id && found.failed);
        let time_s = |column: usize, row: usize| inspection.break_time_s(column, row);
        let end_s = inspection.observation.observed_s;
        let mut drawings = vec![
            ResultDrawing::new(
                "film",
                "The film over time, in seconds after the first fully wet picture; broken film is tinted yellow",
                self.strip.draw_strip(inspection, last),
            ),
            ResultDrawing::new(
                "inspected",
                "All broken film at the end of the observation, areas that were not visible, and failed grids",
                view.draw_inspection(setup.panel, &inspection.mask(), Some(&inspection.unseen_pixels()), &failed),
            ),
            ResultDrawing::new(
                "break_times",
                "Time at which the film broke, from the first fully wet picture on",
                view.break_times(setup.panel, &time_s, end_s),
            ),
        ];
        let close = view.failed_grids(&inspection.mask(), &failed_grids(setup.panel, inspection));
        if let Some(picture) = close.transpose() {
            let caption = "Each failed grid at the end of the observation: the broken area, its size, and the time \
                           at which it reached the limit";
            drawings.push(ResultDrawing::new("failed_grids", caption, picture));
        }
        drawings
    }

    /// Returns the result for the record.
    pub fn finding(&self, setup: &FilmSetup<'_>, pass: u8, counted: FilmCounts) -> Finding {
        let (inspection, process) = (&*self.inspection, setup.recipe.process());
        let failed: Vec<GridId> = inspection.grids.iter().filter(|grid| grid.failed).map(|grid| grid.id).collect();
        let temperature = process.water_temperature_c().map(|celsius| format!("{celsius} °C"));
        let water: Vec<String> = process.water().into_iter().chain(temperature).collect();
        let mut finding = Finding::new(Kind::Inspect, pass, inspection.judgement.clone());
        if !water.is_empty() {
            finding = finding.with_detail(name::WATER, water.join(", "));
        }
        if let Some(lamp) = process.lamp() {
            finding = finding.with_detail(name::LAMP, lamp);
        }
        for reference in [ComparisonReference::Wet, ComparisonReference::Both] {
            let of = inspection.grids.iter().filter(|grid| grid.reference == reference);
            let ids: Vec<GridId> = of.map(|grid| grid.id).collect();
            if !ids.is_empty() {
                finding = finding.with_detail(&format!("evaluated by the {}", reference.describe()), names(&ids));
            }
        }
        let checks = inspection.checks.iter().cloned();
        finding.with_detail("failed", names(&failed)).with_checks(checks).with_checks(counts(inspection, counted))
    }
}

/// Returns the failed grids, each with a text that contains its broken area.
fn failed_grids<'p>(panel: &'p TaughtPanel, inspection: &Inspection) -> Vec<FailedGrid<'p>> {
    let failed = inspection.grids.iter().filter(|grid| grid.failed);
    let one = |found: &GridInspection| {
        let grid = panel.grids.iter().find(|grid| grid.id == found.id)?;
        let after = found
            .time_to_break_s
            .map_or(String::new(), |time_s| format!(", after {} s", fixed_decimals(time_s, 1)));
        Some(FailedGrid { grid, words: format!("{} mm²{after}", fixed_decimals(found.broken_mm2, 1)) })
    };
    failed.filter_map(one).collect()
}

/// Returns the values of a film that are reported but have no limit.
fn counts(inspection: &Inspection, counted: FilmCounts) -> [Check; 4] {
    let closed = inspection.breaks.iter().filter(|found| found.has_closed_again()).count();
    [
        Check::new("pictures that were dropped", "", counted.dropped.map(|count| count as f64)),
        Check::new("places where the film broke", "", inspection.breaks.len() as f64),
        Check::new("of these, closed again", "", closed as f64),
        Check::new(name::PER_PICTURE, "ms", counted.ms_per_picture),
    ]
}

/// Maximum difference between two times that are treated as equal, s.
const TIME_TOLERANCE_S: f64 = 1e-3;

/// The pictures that were selected for the strip so far.
#[derive(Debug)]
struct KeyframeStrip {
    /// The bounding box of the region in the picture, px.
    bounds: [(usize, usize); 2],
    /// The expected duration of the film, s.
    lasts_s: f64,
    opened_s: Option<f64>,
    cuts: Vec<(f64, ColorPicture)>,
}

impl KeyframeStrip {
    fn new(
        panel: &TaughtPanel,
        (camera, camera_from_panel): (&PinholeCamera, Rigid<Camera, Panel>),
        lasts_s: f64,
    ) -> Self {
        let edges = panel.grids.iter().flat_map(|grid| &grid.edge);
        let pixels = edges.filter_map(|&point| camera.project(camera_from_panel * point));
        let bounds = bounds(pixels, (camera.width_px, camera.height_px));
        KeyframeStrip { bounds, lasts_s, opened_s: None, cuts: Vec::new() }
    }

    /// Keeps the picture if the strip may need it.
    fn offer_picture(&mut self, picture: &ColorPicture, step: &PictureResult) {
        let Some(since_wet_s) = step.since_wet_s else { return };
        let opens = self.opened_s.is_none() && step.broken_mm2 > 0.0;
        if opens {
            self.opened_s = Some(since_wet_s);
        }
        let end_s = self.lasts_s;
        let wanted = strip_times_s(None, end_s).into_iter().chain(strip_times_s(self.opened_s, end_s));
        let last_s = self.cuts.last().map_or(f64::NEG_INFINITY, |(time_s, _)| *time_s);
        if wanted
            .into_iter()
            .any(|time_s| last_s < time_s - TIME_TOLERANCE_S && time_s - TIME_TOLERANCE_S <= since_wet_s)
        {
            let nothing = Mask::all_outside(picture.width, picture.height);
            self.cuts.push((since_wet_s, crop_with_mask(picture, &nothing, self.bounds).0));
        }
    }

    /// Draws the strip: each picture with the area that was broken at its time; `last` is the film's last picture.
    fn draw_strip(&self, inspection: &Inspection, last: &ColorPicture) -> Result<ColorPicture, ImagingError> {
        let broke_s = inspection.breaks.iter().map(|found| found.first_seen_s).reduce(f64::min);
        let end_s = inspection.observation.observed_s;
        let pictures: Vec<StripPicture> = strip_times_s(broke_s, end_s)
            .into_iter()
            .map(|time_s| {
                let kept = self.cuts.iter().find(|(kept_s, _)| *kept_s >= time_s - TIME_TOLERANCE_S);
                // After the last kept picture, the strip shows the film's last picture.
                let shown_s = kept.map_or(end_s, |(kept_s, _)| *kept_s);
                let (last, broken) = crop_with_mask(last, &inspection.mask_at(shown_s), self.bounds);
                let picture = kept.map_or(last, |(_, picture)| picture.clone());
                StripPicture { picture, broken, label: format!("{shown_s:.1} s") }
            })
            .collect();
        film_strip(&pictures)
    }
}
