//! The water-break test: pictures are added one by one while the film is watched, or while a clip is read. After
//! the last picture the film is judged.

use super::{Drawing, keyframes::Strip, names};
use crate::geometry::{Camera, ColorPicture, Mask, Panel, PinholeCamera, Rigid};
use crate::inspect::{self, Demands, GridInspection, InspectError, Inspection, Reference, Watch};
use crate::number_text::fixed;
use crate::panel::{Grid, GridId, TaughtPanel};
use crate::phase::Phase;
use crate::recipe::Recipe;
use crate::record::{Check, Finding, Kind, name};
use crate::report::{FailedGrid, View};
use std::sync::Arc;

/// The setup with which a film is watched.
#[derive(Debug, Clone, Copy)]
pub struct Setup<'a> {
    /// The taught panel.
    pub panel: &'a TaughtPanel,
    /// The camera that films.
    pub camera: &'a PinholeCamera,
    /// The panel's pose in the camera's frame.
    pub camera_from_panel: Rigid<Camera, Panel>,
    /// The taught pixels of places that were sanded since the dry picture was taken.
    pub sanded: Option<&'a Mask>,
    /// How long the film is watched, and the criteria of failure.
    pub demands: Demands,
    /// The recipe.
    pub recipe: &'a Recipe,
}

/// A film that is being watched.
#[derive(Debug)]
pub struct Filming {
    watch: Watch,
    strip: Strip,
    last: Option<Arc<ColorPicture>>,
    opened: bool,
}

/// The result of adding one picture to a film.
#[derive(Debug, Clone, PartialEq)]
pub struct Added {
    /// The picture's time after the first fully wet one, s; `None` before that.
    pub since_wet_s: Option<f64>,
    /// The grids on which the film broke, if they are the first of this film to fail.
    pub opened_on: Option<String>,
}

impl Filming {
    /// Begins a test with this expected duration, s.
    ///
    /// # Errors
    /// If the region is not in the picture at all.
    pub fn begin(setup: &Setup<'_>, lasts_s: f64) -> Result<Self, InspectError> {
        let Setup { panel, camera, camera_from_panel, sanded, demands, recipe } = *setup;
        let view = inspect::View { taught: panel, camera, camera_from_panel, sanded };
        let watch = Watch::new(&view, recipe.inspect(), demands)?;
        let strip = Strip::new(panel, (camera, camera_from_panel), lasts_s);
        Ok(Filming { watch, strip, last: None, opened: false })
    }

    /// Assumes the panel's pose, because none was given: see [`Watch::assume_place`].
    pub fn assume_place(&mut self) {
        self.watch.assume_place();
    }

    /// Sets the film's start to this time, on the clock of its pictures: see [`Watch::begins`].
    pub fn begins(&mut self, time_s: f64) {
        self.watch.begins(time_s);
    }

    /// Adds the next picture, at `time_s` of any clock that does not jump.
    ///
    /// # Errors
    /// If its size is not the camera's, or it comes out of order.
    pub fn push(&mut self, picture: &Arc<ColorPicture>, time_s: f64, phase: Phase) -> Result<Added, InspectError> {
        let step = self.watch.push(picture, time_s, phase)?;
        self.strip.see(picture, &step);
        self.last = Some(picture.clone());
        let opens = !self.opened && !step.newly_failed.is_empty();
        self.opened |= opens;
        let opened_on = opens.then(|| names(&step.newly_failed).join(", "));
        Ok(Added { since_wet_s: step.since_wet_s, opened_on })
    }

    /// Returns the newest picture, the pixels that have broken and the grids that have failed so far; `None` before
    /// the first picture.
    pub fn so_far(&self) -> Option<(Arc<ColorPicture>, Mask, Vec<GridId>)> {
        Some((self.last.clone()?, self.watch.mask(), self.watch.failed()))
    }

    /// Judges the film.
    ///
    /// # Errors
    /// If it has no picture of the wet panel.
    pub fn finish(self) -> Result<Filmed, InspectError> {
        let inspection = Arc::new(self.watch.finish()?);
        Ok(Filmed { inspection, last: self.last, strip: self.strip })
    }
}

/// A film that was watched.
#[derive(Debug)]
pub struct Filmed {
    /// The inspection's result, with the verdict.
    pub inspection: Arc<Inspection>,
    /// The last picture.
    pub last: Option<Arc<ColorPicture>>,
    strip: Strip,
}

/// Numbers that were measured besides the film's result.
#[derive(Debug, Clone, Copy)]
pub struct Counted {
    /// Median time from a decoded picture to its result, ms.
    pub ms_per_picture: Option<f64>,
    /// Pictures of the camera that were not fetched in time, if the camera reports it.
    pub dropped: Option<u64>,
}

impl Filmed {
    /// Draws the film over time, and on its last picture where and when the film broke.
    pub fn drawn(&self, setup: &Setup<'_>) -> Vec<Drawing> {
        let Some(last) = &self.last else { return Vec::new() };
        let inspection = &*self.inspection;
        let view = View { picture: last, camera: setup.camera, camera_from_panel: setup.camera_from_panel };
        let failed = |grid: &Grid| inspection.grids.iter().any(|found| found.id == grid.id && found.failed);
        let time_s = |column: usize, row: usize| inspection.break_time_s(column, row);
        let end_s = inspection.observation.observed_s;
        let mut drawings = vec![
            Drawing::new(
                "film",
                "The film over time, in seconds after the panel was completely wet; broken film is tinted yellow",
                self.strip.drawn(inspection, last),
            ),
            Drawing::new(
                "inspected",
                "All broken film at the end of the observation, areas that were not seen, and failed grids",
                view.inspected(setup.panel, &inspection.mask(), Some(&inspection.not_seen()), &failed),
            ),
            Drawing::new(
                "break_times",
                "Time at which the film broke, from the first fully wet picture on",
                view.break_times(setup.panel, &time_s, end_s),
            ),
        ];
        let close = view.failed_grids(&inspection.mask(), &failed_grids(setup.panel, inspection));
        if let Some(picture) = close.transpose() {
            let caption = "Each failed grid at the end of the observation: the broken area, its size, and the time \
                           at which it reached the limit";
            drawings.push(Drawing::new("failed_grids", caption, picture));
        }
        drawings
    }

    /// The result for the record.
    pub fn finding(&self, setup: &Setup<'_>, pass: u8, counted: Counted) -> Finding {
        let (inspection, process) = (&*self.inspection, setup.recipe.process());
        let failed: Vec<GridId> = inspection.grids.iter().filter(|grid| grid.failed).map(|grid| grid.id).collect();
        let temperature = process.water_temperature_c().map(|celsius| format!("{celsius} °C"));
        let water: Vec<String> = process.water().into_iter().chain(temperature).collect();
        let mut finding = Finding::new(Kind::Inspect, pass, inspection.judgement.clone());
        if !water.is_empty() {
            finding = finding.detail(name::WATER, water.join(", "));
        }
        if let Some(lamp) = process.lamp() {
            finding = finding.detail(name::LAMP, lamp);
        }
        for reference in [Reference::Wet, Reference::Both] {
            let of = inspection.grids.iter().filter(|grid| grid.reference == reference);
            let ids: Vec<GridId> = of.map(|grid| grid.id).collect();
            if !ids.is_empty() {
                finding = finding.detail(&format!("judged by the {}", reference.words()), names(&ids));
            }
        }
        let checks = inspection.checks.iter().cloned();
        finding.detail("failed", names(&failed)).with(checks).with(counts(inspection, counted))
    }
}

/// The failed grids, each with its broken area in words.
fn failed_grids<'p>(panel: &'p TaughtPanel, inspection: &Inspection) -> Vec<FailedGrid<'p>> {
    let failed = inspection.grids.iter().filter(|grid| grid.failed);
    let one = |found: &GridInspection| {
        let grid = panel.grids.iter().find(|grid| grid.id == found.id)?;
        let after = found.time_to_break_s.map_or(String::new(), |time_s| format!(", after {} s", fixed(time_s, 1)));
        Some(FailedGrid { grid, words: format!("{} mm²{after}", fixed(found.broken_mm2, 1)) })
    };
    failed.filter_map(one).collect()
}

/// Values that are reported with a film and are not judged.
fn counts(inspection: &Inspection, counted: Counted) -> [Check; 4] {
    let closed = inspection.breaks.iter().filter(|found| found.closed_again()).count();
    [
        Check::new("pictures that were dropped", "", counted.dropped.map(|count| count as f64)),
        Check::new("places where the film broke", "", inspection.breaks.len() as f64),
        Check::new("of these, closed again", "", closed as f64),
        Check::new(name::PER_PICTURE, "ms", counted.ms_per_picture),
    ]
}
