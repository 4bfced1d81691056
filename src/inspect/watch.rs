//! The test as it runs: pictures in, one by one, and an inspection at the end.

use super::film::{Film, NEVER};
use super::footprint::Footprint;
use super::gate::{Demands, GridInspection, Observation, judge};
use super::model::Model;
use super::pieces::{Break, breaks};
use super::quality::Quality;
use super::settle::{Seen, settled};
use super::steady::Outline;
use super::{InspectError, thesis};
use crate::geometry::{Camera, ColorPicture, Mask, Panel, PinholeCamera, Rigid};
use crate::panel::{GridId, TaughtPanel};
use crate::phase::Phase;
use crate::recipe::{self, Method};
use crate::verdict::Judgement;
use opencv::core::Mat;

/// A wet place within a break is a bead on grease, and a break that closed soon a glint that lingered, up to this area,
/// mm².
const SMALL_MM2: f64 = 20.0;

/// Watches a film break.
#[derive(Debug)]
pub struct Watch {
    settings: recipe::Inspect,
    demands: Demands,
    picture_px: (usize, usize),
    footprint: Footprint,
    outline: Outline,
    model: Model,
    /// Where the recipe asks for the thesis's method, which then says what broke.
    thesis: Option<Thesis>,
    quality: Quality,
    last: Option<(f64, Phase)>,
    first_wet_s: Option<f64>,
    observed_s: f64,
    longest_gap_s: f64,
    frames: usize,
    broken_mm2: Vec<f64>,
    time_to_break_s: Vec<Option<f64>>,
}

/// The thesis's pipeline over time.
#[derive(Debug)]
struct Thesis {
    film: Film,
    dry: Option<Mat>,
    reference: Option<Mat>,
}

/// What one picture added.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Step {
    /// The picture's time after the first fully wet one, s; `None` before that.
    pub since_wet_s: Option<f64>,
    /// Whether the picture can be judged by.
    pub usable: bool,
    /// Broken film so far, mm².
    pub broken_mm2: f64,
    /// Grids that fail from this picture on.
    pub newly_failed: Vec<GridId>,
}

/// What a test found, with its verdict.
#[derive(Debug, Clone)]
pub struct Inspection {
    /// Pass, fail or invalid, and why.
    pub judgement: Judgement,
    /// How the film was watched.
    pub observation: Observation,
    /// The connected pieces of broken film, largest first.
    pub breaks: Vec<Break>,
    /// Each grid, row by row.
    pub grids: Vec<GridInspection>,
    /// The region in the picture: grid edges to draw.
    pub footprint: Footprint,
    since_wet_s: Vec<f32>,
}

impl Watch {
    /// Begins a test of the panel where it stands now: `camera_from_panel` is
    /// `camera_from_base · base_from_panel` (Eq. 4.6, 4.7). `demands` say how long it lasts and what fails.
    ///
    /// # Errors
    /// Where the region is not in the picture at all.
    pub fn new(
        taught: &TaughtPanel,
        camera: &PinholeCamera,
        camera_from_panel: Rigid<Camera, Panel>,
        settings: &recipe::Inspect,
        demands: Demands,
    ) -> Result<Self, InspectError> {
        let is_thesis = settings.method() == Method::Thesis;
        let margin_px = if is_thesis { thesis::margin_px(settings) } else { 0 };
        let footprint = Footprint::new(taught, camera, camera_from_panel, (margin_px, &settings.masked_px()))?;
        let (grids, pixels) = (footprint.grids().len(), footprint.inside().len());
        let film = || Film::new(pixels, settings.persist_frames());
        let weights = settings.channel_weights();
        Ok(Watch {
            model: Model::new(*footprint.window(), footprint.inside(), weights, demands.persist_frames()),
            thesis: is_thesis.then(|| Thesis { film: film(), dry: None, reference: None }),
            outline: Outline::new(taught, camera, camera_from_panel),
            quality: Quality::default(),
            settings: settings.clone(),
            demands,
            picture_px: (camera.width_px, camera.height_px),
            footprint,
            last: None,
            first_wet_s: None,
            observed_s: 0.0,
            longest_gap_s: 0.0,
            frames: 0,
            broken_mm2: vec![0.0; grids],
            time_to_break_s: vec![None; grids],
        })
    }

    /// Takes the next picture, at `time_s` of any clock that does not jump.
    ///
    /// # Errors
    /// Where its size is not the camera's, or it comes out of order.
    pub fn push(&mut self, picture: &ColorPicture, time_s: f64, phase: Phase) -> Result<Step, InspectError> {
        self.check(picture, time_s, phase)?;
        self.last = Some((time_s, phase));
        match phase {
            Phase::Dry => {
                self.model.dry(picture);
                self.quality.first_sharpness = self.outline.begin(picture);
                if let Some(thesis) = &mut self.thesis {
                    thesis.dry = Some(thesis::crop(picture, self.footprint.window())?);
                }
                Ok(Step::default())
            }
            Phase::Spray => {
                self.model.spray(picture);
                Ok(Step::default())
            }
            Phase::Wet => self.wet(picture, time_s),
        }
    }

    fn check(&self, picture: &ColorPicture, time_s: f64, phase: Phase) -> Result<(), InspectError> {
        let (width, height) = self.picture_px;
        if (picture.width, picture.height) != (width, height) {
            let (found_width, found_height) = (picture.width, picture.height);
            return Err(InspectError::PictureSize { found_width, found_height, width, height });
        }
        let (previous_s, previous) = self.last.unwrap_or((f64::NEG_INFINITY, Phase::Dry));
        if !(time_s.is_finite() && time_s > previous_s) {
            return Err(InspectError::TimeOrder { time_s, previous_s });
        }
        if phase < previous {
            return Err(InspectError::PhaseOrder { time_s, phase, previous });
        }
        Ok(())
    }

    fn wet(&mut self, picture: &ColorPicture, time_s: f64) -> Result<Step, InspectError> {
        self.frames += 1;
        if self.first_wet_s.is_none() && !self.model.has_dry() {
            self.quality.first_sharpness = self.outline.begin(picture);
        }
        let since_wet_s = time_s - *self.first_wet_s.get_or_insert(time_s);
        self.longest_gap_s = self.longest_gap_s.max(since_wet_s - self.observed_s);
        self.observed_s = since_wet_s;
        let look = self.model.look(picture);
        let steady = self.outline.hold_against(picture);
        let usable = self.quality.take(&look, steady, &self.settings, since_wet_s);
        let before = self.time_to_break_s.clone();
        if usable {
            let mut newly = self.model.follow(since_wet_s);
            let mut broke_s = since_wet_s;
            if let Some(thesis) = &mut self.thesis {
                (newly, broke_s) = thesis.wet(picture, since_wet_s, &self.settings, &self.footprint)?;
            } else if let Some(first) = newly.first() {
                broke_s = self.model.broke_s(*first).map_or(since_wet_s, f64::from);
            }
            self.count(&newly, broke_s);
        }
        Ok(self.step(before, usable))
    }

    /// Adds the surface of pixels that broke at this time to their grids.
    fn count(&mut self, pixels: &[usize], since_wet_s: f64) {
        for &index in pixels {
            self.footprint.add_area(index, &mut self.broken_mm2);
        }
        for (time, broken_mm2) in self.time_to_break_s.iter_mut().zip(&self.broken_mm2) {
            if time.is_none() && *broken_mm2 >= self.demands.min_break_mm2 {
                *time = Some(since_wet_s);
            }
        }
    }

    fn step(&self, failed_before: Vec<Option<f64>>, usable: bool) -> Step {
        let failed = self.footprint.grids().iter().zip(&self.time_to_break_s).zip(failed_before);
        Step {
            since_wet_s: Some(self.observed_s),
            usable,
            broken_mm2: self.broken_mm2.iter().sum(),
            newly_failed: failed
                .filter(|((_, now), before)| now.is_some() && before.is_none())
                .map(|((grid, _), _)| grid.id)
                .collect(),
        }
    }

    fn broke_s(&self, index: usize) -> f32 {
        match &self.thesis {
            Some(thesis) => thesis.film.times()[index],
            None => self.model.broke_s(index).unwrap_or(NEVER),
        }
    }

    /// The region's pixels in the picture.
    pub fn region(&self) -> Mask {
        self.footprint.region()
    }

    /// The pixels of the picture that broke so far.
    pub fn mask(&self) -> Mask {
        self.footprint.to_picture(|index| self.broke_s(index) < NEVER)
    }

    /// Ends the test.
    ///
    /// # Errors
    /// Where no wet picture came.
    pub fn finish(mut self) -> Result<Inspection, InspectError> {
        if self.first_wet_s.is_none() {
            return Err(InspectError::NoWetPicture);
        }
        self.quality.end();
        let inside = self.footprint.inside().to_vec();
        let broke_s: Vec<f32> = (0..inside.len()).map(|index| self.broke_s(index)).collect();
        let since_wet_s = match self.thesis {
            Some(_) => broke_s,
            None => {
                let looks_dry = |index: usize| self.model.looks_dry_since_s(index).filter(|_| inside[index]);
                let seen = Seen {
                    looks_dry_since_s: &looks_dry,
                    was_open_s: &|index| self.model.was_open_s(index),
                    inside: &inside,
                    small_px: self.footprint.pixels_of(SMALL_MM2),
                };
                settled(self.footprint.window(), broke_s, &seen)
            }
        };
        let model = &self.model;
        let never_wet = |index: &usize| inside[*index] && model.sees(*index) && !model.ever_wet(*index);
        let never_wet_mm2: f64 = self.footprint.surface_mm2((0..inside.len()).filter(never_wet));
        self.footprint.lose(|index| !model.sees(index));
        let grids = self.grids(&since_wet_s);
        let observation = Observation {
            observed_s: self.observed_s,
            frames: self.frames,
            longest_gap_s: self.longest_gap_s,
            min_break_mm2: self.demands.min_break_mm2,
            has_dry: model.has_dry(),
            never_wet_percent: 100.0 * never_wet_mm2 / self.footprint.region_mm2().max(f64::MIN_POSITIVE),
            film_left: model.film(),
            dry_levels: model.mean_dry_levels(),
            detection_limit_mm2: self.footprint.detection_limit_mm2(),
            quality: self.quality.clone(),
        };
        let judgement = judge(&observation, &grids, &self.demands, &self.settings);
        let is_thesis = self.thesis.is_some();
        let closed = |index: usize| !is_thesis && !model.is_open(index) && model.broke_s(index).is_some();
        let breaks = breaks(&self.footprint, &since_wet_s, closed)?;
        Ok(Inspection { judgement, observation, breaks, grids, footprint: self.footprint, since_wet_s })
    }

    /// Each grid by the pixels that broke, in the order of their times.
    fn grids(&self, since_wet_s: &[f32]) -> Vec<GridInspection> {
        let mut broken: Vec<usize> = (0..since_wet_s.len()).filter(|&index| since_wet_s[index] < NEVER).collect();
        broken.sort_by(|&a, &b| since_wet_s[a].total_cmp(&since_wet_s[b]).then(a.cmp(&b)));
        let mut broken_mm2 = vec![0.0; self.broken_mm2.len()];
        let mut time_to_break_s = vec![None; broken_mm2.len()];
        for index in broken {
            self.footprint.add_area(index, &mut broken_mm2);
            for (time, broken_mm2) in time_to_break_s.iter_mut().zip(&broken_mm2) {
                if time.is_none() && *broken_mm2 >= self.demands.min_break_mm2 {
                    *time = Some(f64::from(since_wet_s[index]));
                }
            }
        }
        let grid = |index: usize| {
            let footprint = &self.footprint.grids()[index];
            GridInspection {
                id: footprint.id,
                failed: time_to_break_s[index].is_some(),
                seen: footprint.seen(),
                only_masked: footprint.only_masked(),
                broken_mm2: broken_mm2[index],
                time_to_break_s: time_to_break_s[index],
            }
        };
        (0..broken_mm2.len()).map(grid).collect()
    }
}

impl Thesis {
    /// The pixels that broke now, and when they did.
    fn wet(
        &mut self,
        picture: &ColorPicture,
        since_wet_s: f64,
        settings: &recipe::Inspect,
        footprint: &Footprint,
    ) -> Result<(Vec<usize>, f64), InspectError> {
        let test = thesis::crop(picture, footprint.window())?;
        let inside = footprint.inside();
        let looks_dry = thesis::looks_dry(settings, &test)?;
        let Some(reference) = &self.reference else {
            // The first fully wet picture: what still is as it was dry broke at 0 s.
            let mut never_wet = Vec::new();
            if let Some(dry) = self.dry.take() {
                let wetted = thesis::changed(settings, &dry, &test)?;
                never_wet = (0..inside.len()).filter(|&i| inside[i] && !wetted[i] && looks_dry[i]).collect();
                self.film.mark(&never_wet, 0.0);
            }
            self.reference = Some(test);
            return Ok((never_wet, 0.0));
        };
        let changed = thesis::changed(settings, reference, &test)?;
        let broken = (0..inside.len()).map(|i| inside[i] && changed[i] && looks_dry[i]);
        let newly = self.film.push(broken, since_wet_s);
        Ok((newly.pixels, newly.since_wet_s))
    }
}

impl Inspection {
    /// The pixels of the picture that broke.
    pub fn mask(&self) -> Mask {
        self.footprint.to_picture(|index| self.since_wet_s[index] < NEVER)
    }

    /// The pixels of the picture that broke until this time after the first fully wet picture.
    pub fn mask_at(&self, since_wet_s: f64) -> Mask {
        let until_s = (since_wet_s as f32).min(f32::MAX);
        self.footprint.to_picture(|index| self.since_wet_s[index] <= until_s)
    }

    /// When the film broke at a pixel of the picture, s after the first fully wet picture; `None` where it held, and
    /// outside of the region.
    pub fn break_time_s(&self, column: usize, row: usize) -> Option<f64> {
        let time = self.since_wet_s[self.footprint.index_of(column, row)?];
        (time < NEVER).then_some(f64::from(time))
    }
}
