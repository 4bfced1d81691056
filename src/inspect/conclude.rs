//! The end of the test: computes breaks, grids and a verdict from the history of every pixel.

use super::InspectError;
use super::alike::alike;
use super::doubt::{Dryness, wet_when_dry};
use super::film::NEVER;
use super::footprint::Footprint;
use super::gate::{Judged, MIN_CHANGE_LEVELS, judge};
use super::observed::{GridInspection, Observation};
use super::pieces::{Break, breaks};
use super::settle::{FilmObservation, settled};
use super::watch::Watch;
use crate::geometry::Mask;
use crate::verdict::{Check, Judgement};

/// Between the dry panel and the wet one the light is known to this share of itself, which is no change by a film.
const LIGHT_SHARE: f64 = 0.02;
/// A glint that lingers is at most this large where it is as bright as a dry place, mm² …
const GLINT_MM2: f64 = 40.0;
/// … and a bead of water on grease this large.
const BEAD_MM2: f64 = 20.0;

/// What a test found, with its verdict.
#[derive(Debug, Clone)]
pub struct Inspection {
    /// Every number that was judged.
    pub checks: Vec<Check>,
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
        let mut since_wet_s: Vec<f32> = (0..inside.len()).map(|index| self.broke_s(index)).collect();
        let (mut was_wet, mut is_unsure) = (vec![false; inside.len()], vec![false; inside.len()]);
        if self.thesis.is_none() {
            let (settled, unsure) = self.settled(since_wet_s, &inside);
            since_wet_s = settled;
            unsure.into_iter().for_each(|index| is_unsure[index] = true);
            for index in self.wet_when_dry(&since_wet_s, &inside) {
                (since_wet_s[index], was_wet[index]) = (NEVER, true);
            }
        }
        let model = &self.model;
        let never_wet = |index: &usize| inside[*index] && model.sees(*index) && !model.ever_wet(*index);
        let never_wet_mm2: f64 = self.footprint.surface_mm2((0..inside.len()).filter(never_wet));
        let alike =
            model.mirror().map_or_else(Vec::new, |mirror| alike(self.footprint.window(), &since_wet_s, mirror));
        let mut is_alike = vec![false; inside.len()];
        alike.into_iter().for_each(|index| (since_wet_s[index], is_alike[index]) = (NEVER, true));
        // A film takes too little where the panel is dark, or where it mirrors something bright.
        let tiles = model.tiles();
        let is_clear = |i: usize| {
            let tile = tiles.as_ref().and_then(|tiles| tiles[model.tile_of(i)].as_ref());
            tile.is_none_or(|tile| tile.change_levels >= MIN_CHANGE_LEVELS + LIGHT_SHARE * tile.dry_levels)
        };
        let has_contrast = |i: usize| model.has_contrast(i) && (model.broke_s(i).is_some() || is_clear(i));
        let faint = (0..inside.len()).filter(|&i| inside[i] && model.sees(i) && (is_alike[i] || !has_contrast(i)));
        let mut faint_mm2 = vec![0.0; self.broken_mm2.len()];
        faint.for_each(|index| self.footprint.add_area(index, &mut faint_mm2));
        // What broke is known, whatever hid it at other times.
        let is_lost = |index: usize| since_wet_s[index] == NEVER && !model.saw(index);
        self.footprint.lose(|index| was_wet[index] || is_alike[index] || is_unsure[index] || is_lost(index));
        let grids = self.grids(&since_wet_s, &was_wet, &faint_mm2);
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
            is_place_assumed: self.is_place_assumed,
            quality: self.quality.clone(),
        };
        let Judged { checks, judgement } = judge(&observation, &grids, &self.demands, &self.settings);
        let is_thesis = self.thesis.is_some();
        let closed = |index: usize| !is_thesis && !model.is_open(index) && model.broke_s(index).is_some();
        let breaks = breaks(&self.footprint, &since_wet_s, closed)?;
        Ok(Inspection { checks, judgement, observation, breaks, grids, footprint: self.footprint, since_wet_s })
    }

    fn settled(&self, broke_s: Vec<f32>, inside: &[bool]) -> (Vec<f32>, Vec<usize>) {
        let seen = FilmObservation {
            looks_dry_since_s: &|index| self.model.looks_dry_since_s(index).filter(|_| inside[index]),
            was_open_s: &|index| self.model.was_open_s(index),
            off_dry: &|index| self.model.off_dry(index),
            was_hidden: &|index| inside[index] && !self.model.saw(index),
            inside,
            // Where the film mirrors, what a glint is as bright as says nothing.
            glint_px: if self.model.mirror().is_some() { 0 } else { self.footprint.pixels_of(GLINT_MM2) },
            bead_px: self.footprint.pixels_of(BEAD_MM2),
        };
        settled(self.footprint.window(), broke_s, &seen)
    }

    fn wet_when_dry(&self, since_wet_s: &[f32], inside: &[bool]) -> Vec<usize> {
        let Some(film) = self.model.film() else { return Vec::new() };
        let never_wet = |index: usize| inside[index] && self.model.sees(index) && !self.model.ever_wet(index);
        let known = Dryness {
            is_suspect: &|index| since_wet_s[index] < NEVER || never_wet(index),
            never_wet: &never_wet,
            sees: &|index| inside[index] && self.model.sees(index),
            dry: &|index| self.model.dry_brightness(index),
            film,
        };
        wet_when_dry(self.footprint.window(), &known)
    }

    /// Each grid by the pixels that broke, in the order of their times.
    fn grids(&self, since_wet_s: &[f32], was_wet: &[bool], faint_mm2: &[f64]) -> Vec<GridInspection> {
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
        let mut was_wet_mm2 = vec![0.0; broken_mm2.len()];
        let wet_pixels = (0..was_wet.len()).filter(|&index| was_wet[index]);
        wet_pixels.for_each(|index| self.footprint.add_area(index, &mut was_wet_mm2));
        let grid = |index: usize| {
            let footprint = &self.footprint.grids()[index];
            let failed = time_to_break_s[index].is_some();
            // What could not be seen is small enough that the grid would not fail if all of it had broken, too.
            let little_lost = failed || broken_mm2[index] + footprint.lost_mm2 < self.demands.min_break_mm2;
            GridInspection {
                id: footprint.id,
                failed,
                seen: footprint.seen() && little_lost,
                only_masked: footprint.only_masked() && little_lost,
                no_contrast: faint_mm2[index] >= self.demands.min_break_mm2,
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
