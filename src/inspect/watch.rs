//! The test as it runs: pictures in, one by one, and an inspection at the end.

use super::film::{Film, NEVER};
use super::footprint::Footprint;
use super::gate::{Demands, GridInspection, Observation, judge};
use super::pieces::{Break, breaks};
use super::{InspectError, thesis};
use crate::geometry::{Camera, ColorPicture, Mask, Panel, PinholeCamera, Rigid};
use crate::panel::{GridId, TaughtPanel};
use crate::phase::Phase;
use crate::recipe::{self, Method};
use crate::verdict::Judgement;
use opencv::core::Mat;

/// Watches a film break.
#[derive(Debug)]
pub struct Watch {
    settings: recipe::Inspect,
    demands: Demands,
    picture_px: (usize, usize),
    footprint: Footprint,
    film: Film,
    dry: Option<Mat>,
    reference: Option<Reference>,
    last: Option<(f64, Phase)>,
    observed_s: f64,
    longest_gap_s: f64,
    frames: usize,
    broken_mm2: Vec<f64>,
    time_to_break_s: Vec<Option<f64>>,
}

/// The first fully wet picture, its window.
#[derive(Debug)]
struct Reference {
    picture: Mat,
    time_s: f64,
}

/// What one picture added.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Step {
    /// The picture's time after the first fully wet one, s; `None` before that.
    pub since_wet_s: Option<f64>,
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
        let settings = settings.clone();
        let margin_px = match settings.method() {
            Method::Thesis => thesis::margin_px(&settings),
        };
        let footprint = Footprint::new(taught, camera, camera_from_panel, margin_px)?;
        let grids = footprint.grids().len();
        Ok(Watch {
            film: Film::new(footprint.inside().len(), settings.persist_frames()),
            settings,
            demands,
            picture_px: (camera.width_px, camera.height_px),
            footprint,
            dry: None,
            reference: None,
            last: None,
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
                self.dry = Some(thesis::crop(picture, self.footprint.window())?);
                Ok(Step::default())
            }
            Phase::Spray => Ok(Step::default()),
            Phase::Wet => {
                self.frames += 1;
                let test = thesis::crop(picture, self.footprint.window())?;
                let Some(reference) = self.reference.take() else { return self.begin(test, time_s) };
                let step = self.compare(&reference, &test, time_s);
                self.reference = Some(reference);
                step
            }
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

    /// The first fully wet picture: what still is as it was dry broke at 0 s.
    fn begin(&mut self, reference: Mat, time_s: f64) -> Result<Step, InspectError> {
        if let Some(dry) = self.dry.take() {
            let wetted = thesis::changed(&self.settings, &dry, &reference)?;
            let looks_dry = thesis::looks_dry(&self.settings, &reference)?;
            let inside = self.footprint.inside();
            let never_wet: Vec<usize> =
                (0..inside.len()).filter(|&i| inside[i] && !wetted[i] && looks_dry[i]).collect();
            self.film.mark(&never_wet, 0.0);
            self.count(&never_wet, 0.0);
        }
        self.reference = Some(Reference { picture: reference, time_s });
        Ok(self.step(vec![None; self.time_to_break_s.len()]))
    }

    fn compare(&mut self, reference: &Reference, test: &Mat, time_s: f64) -> Result<Step, InspectError> {
        let changed = thesis::changed(&self.settings, &reference.picture, test)?;
        let looks_dry = thesis::looks_dry(&self.settings, test)?;
        let since_wet_s = time_s - reference.time_s;
        self.longest_gap_s = self.longest_gap_s.max(since_wet_s - self.observed_s);
        self.observed_s = since_wet_s;
        let inside = self.footprint.inside();
        let broken = (0..inside.len()).map(|i| inside[i] && changed[i] && looks_dry[i]);
        let newly = self.film.push(broken, since_wet_s);
        let before = self.time_to_break_s.clone();
        self.count(&newly.pixels, newly.since_wet_s);
        Ok(self.step(before))
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

    fn step(&self, failed_before: Vec<Option<f64>>) -> Step {
        let failed = self.footprint.grids().iter().zip(&self.time_to_break_s).zip(failed_before);
        Step {
            since_wet_s: Some(self.observed_s),
            broken_mm2: self.broken_mm2.iter().sum(),
            newly_failed: failed
                .filter(|((_, now), before)| now.is_some() && before.is_none())
                .map(|((grid, _), _)| grid.id)
                .collect(),
        }
    }

    /// The pixels of the picture that broke so far.
    pub fn mask(&self) -> Mask {
        let times = self.film.times();
        self.footprint.to_picture(|index| times[index] < NEVER)
    }

    /// Ends the test.
    ///
    /// # Errors
    /// Where no wet picture came.
    pub fn finish(self) -> Result<Inspection, InspectError> {
        if self.reference.is_none() {
            return Err(InspectError::NoWetPicture);
        }
        let grid = |index: usize| GridInspection {
            id: self.footprint.grids()[index].id,
            failed: self.time_to_break_s[index].is_some(),
            seen: self.footprint.grids()[index].seen(),
            broken_mm2: self.broken_mm2[index],
            time_to_break_s: self.time_to_break_s[index],
        };
        let grids: Vec<GridInspection> = (0..self.broken_mm2.len()).map(grid).collect();
        let observation = Observation {
            observed_s: self.observed_s,
            frames: self.frames,
            longest_gap_s: self.longest_gap_s,
            min_break_mm2: self.demands.min_break_mm2,
        };
        let judgement = judge(&observation, &grids, &self.demands);
        let since_wet_s = self.film.into_times();
        let breaks = breaks(&self.footprint, &since_wet_s)?;
        Ok(Inspection { judgement, observation, breaks, grids, footprint: self.footprint, since_wet_s })
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
