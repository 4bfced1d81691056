//! The end of the test: computes breaks, grids and a verdict from the history of every pixel.

use super::InspectError;
use super::break_mask::{FeatureSizes, FinalMask, ModelObservations, break_ratio_range, determine_breaks};
use super::film::NOT_BROKEN;
use super::footprint::Footprint;
use super::gate::{JudgedFilm, judge};
use super::initially_wet::{DrynessInputs, initially_wet_pixels};
use super::observed::{ComparisonReference, GridInspection, Observation};
use super::pieces::{Break, breaks};
use super::sanded::SandedPlaces;
use super::watch::FilmWatch;
use panelprep_base::geometry::Mask;
use panelprep_base::verdict::{Check, Judgement};
use std::f64::consts::PI;

/// Area of the smallest sanding disc, mm²: 25 mm in diameter.
const MIN_DISC_MM2: f64 = PI * 12.5 * 12.5;

/// The results of a test, with its verdict.
#[derive(Debug, Clone)]
pub struct Inspection {
    /// All numbers that were judged.
    pub checks: Vec<Check>,
    /// Pass, fail or invalid, and why.
    pub judgement: Judgement,
    /// Evidence of the observation.
    pub observation: Observation,
    /// The connected pieces of broken film, largest first.
    pub breaks: Vec<Break>,
    /// Each grid, row by row.
    pub grids: Vec<GridInspection>,
    /// The region in the picture, with grid edges for drawing.
    pub footprint: Footprint,
    since_wet_s: Vec<f32>,
    unseen: Vec<bool>,
}

impl FilmWatch {
    /// Ends the test.
    ///
    /// # Errors
    /// If there was no wet picture.
    pub fn finish(mut self) -> Result<Inspection, InspectError> {
        if self.first_wet_s.is_none() {
            return Err(InspectError::NoWetPicture);
        }
        self.quality.end();
        self.model.end();
        let inside = self.footprint.region_pixels().to_vec();
        let mut since_wet_s: Vec<f32> = (0..inside.len()).map(|index| self.broke_s(index)).collect();
        let (mut was_wet, mut is_unsure) = (vec![false; inside.len()], vec![false; inside.len()]);
        if self.thesis.is_none() {
            let FinalMask { broke_s, unsure } = self.final_mask(since_wet_s, &inside);
            since_wet_s = broke_s;
            unsure.into_iter().for_each(|index| is_unsure[index] = true);
            // Places that were already wet look unchanged under the film, like a break from the first moment on: they
            // are not seen.
            for index in self.initially_wet_pixels(&since_wet_s, &inside) {
                (since_wet_s[index], was_wet[index]) = (NOT_BROKEN, true);
            }
        }
        // For either method, a sanded place needs evidence that it was wet.
        let sanded = SandedPlaces {
            model: &self.model,
            window: self.footprint.window(),
            inside: &inside,
            broke_s: &since_wet_s,
            disc_px: self.smallest_disc_px(),
            break_px: self.footprint.pixels_for_area(self.demands.min_break_mm2),
            break_to_film: break_ratio_range(&self.model),
        };
        let without = sanded.unproven_pixels()?;
        is_unsure.iter_mut().zip(without).for_each(|(is_unsure, without)| *is_unsure |= without);
        let model = &self.model;
        let never_wet = |index: &usize| inside[*index] && model.is_evaluated(*index) && !model.ever_wet(*index);
        let never_wet_mm2: f64 = self.footprint.surface_mm2((0..inside.len()).filter(never_wet));
        let holds = |i: usize| inside[i] && model.is_evaluated(i) && since_wet_s[i] == NOT_BROKEN;
        let is_faint = |i: usize| holds(i) && model.ever_wet(i) && !model.has_contrast(i);
        let mut faint_mm2 = vec![0.0; self.broken_mm2.len()];
        let faint: Vec<usize> = (0..inside.len()).filter(|&i| is_faint(i)).collect();
        faint.iter().for_each(|index| self.footprint.add_area(*index, &mut faint_mm2));
        // A pixel that broke has a known result, even if it was hidden at other times.
        let is_lost = |index: usize| since_wet_s[index] == NOT_BROKEN && !model.was_observed(index);
        let not_seen: Vec<bool> =
            (0..inside.len()).map(|i| inside[i] && (was_wet[i] || is_unsure[i] || is_lost(i))).collect();
        // Before the grids are evaluated, since each unseen place counts against its grid as if it might have broken.
        self.footprint.subtract_unseen(|index| not_seen[index]);
        let grids = self.grids(&since_wet_s, &was_wet, &faint_mm2);
        let observation = Observation {
            observed_s: self.observed_s,
            frames: self.frames,
            longest_gap_s: self.longest_gap_s,
            min_break_mm2: self.demands.min_break_mm2,
            has_dry: model.has_dry(),
            never_wet_percent: 100.0 * never_wet_mm2 / self.footprint.region_mm2().max(f64::MIN_POSITIVE),
            film_left: model.film(),
            change_levels: model.change_levels().filter(|_| self.thesis.is_none()),
            noise_levels: model.noise_levels(),
            detection_limit_mm2: self.footprint.detection_limit_mm2(),
            is_place_assumed: self.is_place_assumed,
            quality: self.quality.clone(),
        };
        let JudgedFilm { checks, judgement } = judge(&observation, &grids, &self.demands, &self.settings);
        let is_thesis = self.thesis.is_some();
        let closed = |index: usize| !is_thesis && !model.is_open_now(index) && model.broke_s(index).is_some();
        let breaks = breaks(&self.footprint, &since_wet_s, closed)?;
        Ok(Inspection {
            checks,
            judgement,
            observation,
            breaks,
            grids,
            footprint: self.footprint,
            since_wet_s,
            unseen: not_seen,
        })
    }

    /// Returns the radius of the smallest sanding disc in the picture, px.
    pub(super) fn smallest_disc_px(&self) -> usize {
        (self.footprint.pixels_for_area(MIN_DISC_MM2) as f64 / PI).sqrt().floor() as usize
    }

    fn final_mask(&self, broke_s: Vec<f32>, inside: &[bool]) -> FinalMask {
        let sizes = FeatureSizes {
            glint_px: self.footprint.pixels_for_area(self.settings.glint_mm2()),
            bead_px: self.footprint.pixels_for_area(self.settings.bead_mm2()),
            break_px: self.footprint.pixels_for_area(self.demands.min_break_mm2),
        };
        determine_breaks(self.footprint.window(), broke_s, sizes, &ModelObservations::new(&self.model, inside))
    }

    fn initially_wet_pixels(&self, since_wet_s: &[f32], inside: &[bool]) -> Vec<usize> {
        // If the film is brighter than the dry panel, water in the dry picture is not visible as a darker place.
        let Some(film) = self.model.film().filter(|film| *film < 1.0) else { return Vec::new() };
        let never_wet =
            |index: usize| inside[index] && self.model.is_evaluated(index) && !self.model.ever_wet(index);
        let known = DrynessInputs {
            is_suspect: &|index| since_wet_s[index] < NOT_BROKEN || never_wet(index),
            never_wet: &never_wet,
            sees: &|index| inside[index] && self.model.is_evaluated(index),
            dry: &|index| self.model.dry_brightness(index),
            film,
        };
        initially_wet_pixels(self.footprint.window(), &known)
    }

    /// Evaluates each grid from the pixels that broke, in the order of their times.
    fn grids(&self, since_wet_s: &[f32], was_wet: &[bool], faint_mm2: &[f64]) -> Vec<GridInspection> {
        let mut broken: Vec<usize> =
            (0..since_wet_s.len()).filter(|&index| since_wet_s[index] < NOT_BROKEN).collect();
        // By time and then by index: the time at which a grid failed must not depend on the order of equal times.
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
        let mut was_wet_mm2 = vec![0.0; broken_mm2.len()];
        let wet_pixels = (0..was_wet.len()).filter(|&index| was_wet[index]);
        wet_pixels.for_each(|index| self.footprint.add_area(index, &mut was_wet_mm2));
        let sanded_shares = self.footprint.sanded_shares();
        let grid = |index: usize| {
            let footprint = &self.footprint.grids()[index];
            let failed = time_to_break_s[index].is_some();
            // The area that could not be seen must be small enough: even if all of that area had broken in addition,
            // the grid would not fail.
            let no_contrast = faint_mm2[index] >= self.demands.min_break_mm2;
            let unknown_mm2 = footprint.lost_mm2 + faint_mm2[index];
            let might_break_mm2 = if failed { unknown_mm2 } else { broken_mm2[index] + unknown_mm2 };
            let little_lost = might_break_mm2 < self.demands.min_break_mm2;
            GridInspection {
                id: footprint.id,
                reference: ComparisonReference::from_sanded_share(sanded_shares[index]),
                failed,
                seen: footprint.is_inspected() && little_lost && !no_contrast,
                only_masked: footprint.is_only_masked() && (failed || little_lost),
                no_contrast,
                wet_when_dry: was_wet_mm2[index] >= self.demands.min_break_mm2,
                broken_mm2: broken_mm2[index],
                time_to_break_s: time_to_break_s[index],
            }
        };
        (0..broken_mm2.len()).map(grid).collect()
    }
}

impl Inspection {
    /// The pixels of the picture that broke.
    pub fn mask(&self) -> Mask {
        self.footprint.to_picture(|index| self.since_wet_s[index] < NOT_BROKEN)
    }

    /// The pixels of the taught picture that broke.
    pub fn broken_in_taught(&self) -> Mask {
        self.footprint.taught_pixels(&self.mask())
    }

    /// Returns the pixels of the picture for which it is not known whether they broke; masked pixels are not
    /// included.
    pub fn unseen_pixels(&self) -> Mask {
        self.footprint.to_picture(|index| self.unseen[index])
    }

    /// Returns the pixels of the picture that broke until this time after the first fully wet picture.
    pub fn mask_at(&self, since_wet_s: f64) -> Mask {
        let until_s = (since_wet_s as f32).min(f32::MAX);
        self.footprint.to_picture(|index| self.since_wet_s[index] <= until_s)
    }

    /// The time at which the film broke at a pixel of the picture, s after the first fully wet picture; `None` if the
    /// film did not break there, and outside of the region.
    pub fn break_time_s(&self, column: usize, row: usize) -> Option<f64> {
        let time = self.since_wet_s[self.footprint.window_index(column, row)?];
        (time < NOT_BROKEN).then_some(f64::from(time))
    }
}
