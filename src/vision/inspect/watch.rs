//! The test while it runs: accepts pictures one by one.

use super::error::InspectError;
use super::footprint::{Footprint, InspectedPart};
use super::gate::displaced_panel_reason;
use super::model::{FilmParameters, MAX_FILM_S, MAX_PICTURES, Model};
use super::observed::Demands;
use super::quality::Quality;
use super::steady::DryOutline;
use super::thesis;
use super::thesis::NOT_BROKEN;
use panelprep_base::geometry::{Camera, ColorPicture, Mask, Panel, PinholeCamera, Rigid};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::Reason;
use panelprep_cell::panel::{GridId, TaughtPanel};
use panelprep_cell::recipe;
use panelprep_cell::recipe::Method;

/// A panel in front of the camera that films it.
#[derive(Debug, Clone, Copy)]
pub struct FilmView<'a> {
    /// The taught panel.
    pub taught: &'a TaughtPanel,
    /// The lens model of the camera.
    pub camera: &'a PinholeCamera,
    /// The pose of the panel in the camera, `camera_from_base · base_from_panel` (Eq. 4.6, 4.7).
    pub camera_from_panel: Rigid<Camera, Panel>,
    /// The taught pixels of places that were sanded after the dry picture; they are judged only by the brightness of
    /// their film.
    pub sanded: Option<&'a Mask>,
}

/// Observes how a film breaks, picture by picture.
#[derive(Debug)]
pub struct FilmWatch {
    pub(super) settings: recipe::Inspect,
    pub(super) demands: Demands,
    pub(super) picture_px: (usize, usize),
    pub(super) footprint: Footprint,
    pub(super) outline: DryOutline,
    pub(super) model: Model,
    /// The thesis's pipeline, if the recipe requests it: it then determines which pixels broke.
    pub(super) thesis: Option<thesis::ThesisPipeline>,
    pub(super) quality: Quality,
    pub(super) is_place_assumed: bool,
    pub(super) last: Option<(f64, Phase)>,
    pub(super) start_s: Option<f64>,
    pub(super) first_wet_s: Option<f64>,
    pub(super) observed_s: f64,
    pub(super) longest_gap_s: f64,
    pub(super) frames: usize,
    pub(super) broken_mm2: Vec<f64>,
    pub(super) time_to_break_s: Vec<Option<f64>>,
}

/// The result of one picture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PictureResult {
    /// Time of the picture after the first fully wet picture, s; `None` before the first one.
    pub since_wet_s: Option<f64>,
    /// Whether the picture can be judged.
    pub usable: bool,
    /// Area of broken film so far, mm²; glints that are recognised at the end are subtracted then.
    pub broken_mm2: f64,
    /// Grids that failed in this picture.
    pub newly_failed: Vec<GridId>,
}

impl FilmWatch {
    /// Begins a test of a panel at its present pose. `demands` state the duration of the test and the criteria for a
    /// failure.
    ///
    /// # Errors
    /// If the region is completely outside of the picture.
    pub fn new(view: &FilmView<'_>, settings: &recipe::Inspect, demands: Demands) -> Result<Self, InspectError> {
        let FilmView { taught, camera, camera_from_panel, sanded } = *view;
        let is_thesis = settings.method() == Method::Thesis;
        let margin_px = if is_thesis { thesis::margin_px(settings) } else { 0 };
        let masked_px = &settings.masked_px();
        let looked = InspectedPart { margin_px, masked_px, sanded };
        let footprint = Footprint::new(taught, camera, camera_from_panel, looked)?;
        let (grids, pixels) = (footprint.grids().len(), footprint.region_pixels().len());
        let terms = FilmParameters {
            channel_weights: settings.channel_weights(),
            persist_s: demands.persist_s,
            damp: settings.damp(),
        };
        Ok(FilmWatch {
            model: Model::new(*footprint.window(), footprint.region_pixels(), &footprint.sanded_pixels(), terms),
            thesis: is_thesis.then(|| thesis::ThesisPipeline::new(pixels, settings)),
            outline: DryOutline::new(taught, camera, camera_from_panel),
            quality: Quality::default(),
            is_place_assumed: false,
            settings: settings.clone(),
            demands,
            picture_px: (camera.width_px, camera.height_px),
            footprint,
            last: None,
            start_s: None,
            first_wet_s: None,
            observed_s: 0.0,
            longest_gap_s: 0.0,
            frames: 0,
            broken_mm2: vec![0.0; grids],
            time_to_break_s: vec![None; grids],
        })
    }

    /// Accepts the next picture, recorded at `time_s` of a monotonic clock.
    ///
    /// # Errors
    /// If the picture differs in size from the camera's, or is out of order.
    pub fn push(
        &mut self,
        picture: &ColorPicture,
        time_s: f64,
        phase: Phase,
    ) -> Result<PictureResult, InspectError> {
        self.check_picture(picture, time_s, phase)?;
        self.last = Some((time_s, phase));
        match phase {
            Phase::Dry => {
                self.model.add_dry(picture);
                self.quality.first_sharpness = self.outline.set_reference(picture);
                self.quality.off_px = self.outline.outline_offset_px(picture);
                if let Some(thesis) = &mut self.thesis {
                    thesis.set_dry(picture, self.footprint.window())?;
                }
                Ok(PictureResult::default())
            }
            Phase::Spray => {
                self.model.spray(picture);
                Ok(PictureResult::default())
            }
            // All work below enters the thread pool only once: each entry wakes a sleeping thread.
            Phase::Wet => rayon::scope(|_| self.process_wet(picture, time_s)),
        }
    }

    /// Assumes the panel at its nominal pose, because no pose was stated; the dry picture must confirm this.
    pub fn assume_nominal_pose(&mut self) {
        self.is_place_assumed = true;
    }

    /// Sets the beginning of the film, on the clock of its pictures: pictures that are missing before the first one are
    /// then treated as a gap.
    pub fn set_start(&mut self, time_s: f64) {
        self.start_s = Some(time_s);
    }

    fn check_picture(&self, picture: &ColorPicture, time_s: f64, phase: Phase) -> Result<(), InspectError> {
        let (width, height) = self.picture_px;
        if (picture.width, picture.height) != (width, height) {
            let (found_width, found_height) = (picture.width, picture.height);
            return Err(InspectError::PictureSize { found_width, found_height, width, height });
        }
        let (previous_s, previous) = self.last.unwrap_or((f64::NEG_INFINITY, Phase::Dry));
        // All times of breaks come from the timestamps of the pictures; a clock that jumps would falsify all of them.
        if !(time_s.is_finite() && time_s > previous_s) {
            return Err(InspectError::TimeOrder { time_s, previous_s });
        }
        if self.first_wet_s.is_some_and(|first_s| time_s - first_s > MAX_FILM_S) {
            return Err(InspectError::TooLong { most_s: MAX_FILM_S });
        }
        if self.frames + 1 >= MAX_PICTURES {
            return Err(InspectError::TooManyPictures { most: MAX_PICTURES - 1 });
        }
        // In a dry picture after the film began, water would be learnt as dry brightness, which would hide every break
        // there.
        if phase < previous {
            return Err(InspectError::PhaseOrder { time_s, phase, previous });
        }
        Ok(())
    }

    fn process_wet(&mut self, picture: &ColorPicture, time_s: f64) -> Result<PictureResult, InspectError> {
        self.frames += 1;
        // Without a dry picture the first wet picture is the reference for outline and sharpness, so that a motion is
        // still detected.
        if self.first_wet_s.is_none() && !self.model.has_dry() {
            self.quality.first_sharpness = self.outline.set_reference(picture);
        }
        // Pictures that are missing at the beginning are a gap like any other: a break may have opened meanwhile.
        let late_s = self.start_s.take().map_or(0.0, |begins_s| time_s - begins_s);
        let since_wet_s = time_s - *self.first_wet_s.get_or_insert(time_s);
        self.longest_gap_s = self.longest_gap_s.max(late_s).max(since_wet_s - self.observed_s);
        self.observed_s = since_wet_s;
        let (model, outline) = (&mut self.model, &self.outline);
        let (look, steady) = rayon::join(|| model.measure_wet(picture), || outline.measure_against_first(picture));
        // A picture that cannot be used is skipped and counted. If it were judged, a shadow would be treated as a
        // break, or a flash as film.
        let usable = self.quality.add(&look, steady, &self.settings, since_wet_s);
        let before = self.time_to_break_s.clone();
        if usable {
            let mut newly = self.model.judge_last(picture, since_wet_s);
            let mut broke_s = since_wet_s;
            if let Some(thesis) = &mut self.thesis {
                (newly, broke_s) = thesis.process_wet(picture, since_wet_s, &self.settings, &self.footprint)?;
            } else if let Some(first) = newly.first() {
                broke_s = self.model.broke_s(*first).map_or(since_wet_s, f64::from);
            }
            self.add_broken_surface(&newly, broke_s);
        }
        Ok(self.picture_result(before, usable))
    }

    /// Adds the area of the pixels that broke at this time to their grids.
    fn add_broken_surface(&mut self, pixels: &[usize], since_wet_s: f64) {
        for &index in pixels {
            self.footprint.add_area(index, &mut self.broken_mm2);
        }
        for (time, broken_mm2) in self.time_to_break_s.iter_mut().zip(&self.broken_mm2) {
            // The first time is kept: a break that closes again has still occurred.
            if time.is_none() && *broken_mm2 >= self.demands.min_break_mm2 {
                *time = Some(since_wet_s);
            }
        }
    }

    fn picture_result(&self, failed_before: Vec<Option<f64>>, usable: bool) -> PictureResult {
        let failed = self.footprint.grids().iter().zip(&self.time_to_break_s).zip(failed_before);
        PictureResult {
            since_wet_s: Some(self.observed_s),
            usable,
            broken_mm2: self.broken_mm2.iter().sum(),
            newly_failed: failed
                .filter(|((_, now), before)| now.is_some() && before.is_none())
                .map(|((grid, _), _)| grid.id)
                .collect(),
        }
    }

    /// Returns the time at which a pixel of the window broke, s, as known so far; [`NOT_BROKEN`] if it did not break.
    pub(super) fn broke_s(&self, index: usize) -> f32 {
        match &self.thesis {
            Some(thesis) => thesis.times_s()[index],
            None => self.model.broke_s(index).unwrap_or(NOT_BROKEN),
        }
    }

    /// Returns the reason if, according to the dry pictures so far, the panel is not at the pose at which the grids are
    /// evaluated; `None` if it is.
    pub fn displaced_panel_reason(&self) -> Option<Reason> {
        displaced_panel_reason(self.quality.off_px, (self.is_place_assumed, self.model.has_dry()))
    }

    /// Returns the pixels of the picture in each grid, row by row.
    pub fn grid_pixels(&self) -> Vec<(GridId, Vec<usize>)> {
        self.footprint.grid_pixels()
    }

    /// Returns the area of the smallest break that is reliably detected at the position of the panel, mm².
    pub fn detection_limit_mm2(&self) -> f64 {
        self.footprint.detection_limit_mm2()
    }

    /// Returns the grids that have failed so far.
    pub fn failed_grids(&self) -> Vec<GridId> {
        let grids = self.footprint.grids().iter().zip(&self.time_to_break_s);
        grids.filter(|(_, time_s)| time_s.is_some()).map(|(grid, _)| grid.id).collect()
    }

    /// Returns the region's pixels in the picture.
    pub fn region(&self) -> Mask {
        self.footprint.region()
    }

    /// Returns the pixels of the picture that broke so far.
    pub fn mask(&self) -> Mask {
        self.footprint.to_picture(|index| self.broke_s(index) < NOT_BROKEN)
    }
}
