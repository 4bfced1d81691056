//! The end of the test: computes breaks, grids and a verdict from the history of every pixel.
//!
//! Breaks are the connected components of the broken film, each with its contour (thesis Fig. 4.17).
//!
//! Places that were already wet in the dry picture cannot be judged. Water that remained from rinsing darkens the dry
//! picture, as a film does. Under the film the brightness there does not change, as on a surface without water. The dry
//! picture distinguishes the two cases. A dry place is as bright as its surroundings. A wet place is darker: the ratio
//! of its brightness to that of its surroundings is closer to τ, the ratio of film brightness to dry brightness, than
//! to 1.

use super::break_mask::{FeatureSizes, FinalMask, ModelObservations, break_ratio_range, determine_breaks};
use super::error::InspectError;
use super::footprint::{Footprint, Window};
use super::gate::{JudgedFilm, judge};
use super::observed::{ComparisonReference, GridInspection, Observation};
use super::sanded::SandedPixels;
use super::thesis::NOT_BROKEN;
use super::watch::FilmWatch;
use panelprep_base::geometry::statistics::mean;
use panelprep_base::geometry::{ALL_NEIGHBOURS, Mask, Pixel};
use panelprep_base::verdict::{Check, Judgement};
use panelprep_cell::imaging;
use panelprep_cell::imaging::{ImagingError, outer_contours};
use panelprep_cell::panel::GridId;
use std::f64::consts::PI;

/// Area of the smallest sanding disc (diameter 25 mm), mm².
const MIN_DISC_MM2: f64 = PI * 12.5 * 12.5;

/// The results of a water-break test, with its verdict.
#[derive(Debug, Clone)]
pub struct Inspection {
    /// All checks of the test, with measured value and limit.
    pub checks: Vec<Check>,
    /// The verdict pass, fail or invalid, with its reasons.
    pub judgement: Judgement,
    /// Evidence that the film was observed completely.
    pub observation: Observation,
    /// The connected components of the broken film, in the order of their size, the largest first.
    pub breaks: Vec<Break>,
    /// The result of each grid, row by row.
    pub grids: Vec<GridInspection>,
    /// The region in the picture, with the edges of the grids for drawing.
    pub footprint: Footprint,
    since_wet_s: Vec<f32>,
    unseen: Vec<bool>,
}

impl FilmWatch {
    /// Ends the test and judges it.
    ///
    /// # Errors
    /// If the test has no wet picture.
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
            // Places that were already wet do not change under the film, like a break at 0 s: they are treated as not
            // seen.
            for index in self.initially_wet_pixels(&since_wet_s, &inside) {
                (since_wet_s[index], was_wet[index]) = (NOT_BROKEN, true);
            }
        }
        // With both methods, a sanded place is judged only if there is evidence that it was wet.
        let sanded = SandedPixels {
            model: &self.model,
            window: self.footprint.window(),
            inside: &inside,
            broke_s: &since_wet_s,
            disc_px: self.smallest_disc_px(),
            break_px: self.footprint.pixels_for_area(self.demands.min_break_mm2),
            break_to_film: break_ratio_range(&self.model),
        };
        let without = sanded.pixels_without_evidence()?;
        is_unsure.iter_mut().zip(without).for_each(|(is_unsure, without)| *is_unsure |= without);
        let model = &self.model;
        let never_wet = |index: &usize| inside[*index] && model.is_evaluated(*index) && !model.ever_wet(*index);
        let never_wet_mm2: f64 = self.footprint.surface_mm2((0..inside.len()).filter(never_wet));
        let holds = |i: usize| inside[i] && model.is_evaluated(i) && since_wet_s[i] == NOT_BROKEN;
        let is_faint = |i: usize| holds(i) && model.ever_wet(i) && !model.has_contrast(i);
        let mut faint_mm2 = vec![0.0; self.broken_mm2.len()];
        let faint: Vec<usize> = (0..inside.len()).filter(|&i| is_faint(i)).collect();
        faint.iter().for_each(|index| self.footprint.add_area(*index, &mut faint_mm2));
        // A broken pixel has a certain result, even if it was hidden at other times.
        let is_lost = |index: usize| since_wet_s[index] == NOT_BROKEN && !model.was_observed(index);
        let not_seen: Vec<bool> =
            (0..inside.len()).map(|i| inside[i] && (was_wet[i] || is_unsure[i] || is_lost(i))).collect();
        // Unseen pixels are subtracted before the grids are evaluated, since each of them is treated as if it might
        // have broken.
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

    /// Computes the result of each grid from the pixels that broke, in the order of their times.
    fn grids(&self, since_wet_s: &[f32], was_wet: &[bool], faint_mm2: &[f64]) -> Vec<GridInspection> {
        let mut broken: Vec<usize> =
            (0..since_wet_s.len()).filter(|&index| since_wet_s[index] < NOT_BROKEN).collect();
        // Sorted by time and then by index, so that the time at which a grid failed does not depend on the order of
        // equal times.
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
        let sanded_fractions = self.footprint.sanded_fractions();
        let grid = |index: usize| {
            let footprint = &self.footprint.grids()[index];
            let failed = time_to_break_s[index].is_some();
            // The unseen area must be so small that the grid would not fail even if this area had broken as well.
            let no_contrast = faint_mm2[index] >= self.demands.min_break_mm2;
            let unknown_mm2 = footprint.lost_mm2 + faint_mm2[index];
            let might_break_mm2 = if failed { unknown_mm2 } else { broken_mm2[index] + unknown_mm2 };
            let little_lost = might_break_mm2 < self.demands.min_break_mm2;
            GridInspection {
                id: footprint.id,
                reference: ComparisonReference::from_sanded_share(sanded_fractions[index]),
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
    /// Returns the broken pixels of the picture.
    pub fn mask(&self) -> Mask {
        self.footprint.to_picture(|index| self.since_wet_s[index] < NOT_BROKEN)
    }

    /// Returns the broken pixels of the taught picture.
    pub fn broken_in_taught(&self) -> Mask {
        self.footprint.taught_pixels(&self.mask())
    }

    /// Returns the pixels of the picture for which it is unknown whether they broke, without the masked pixels.
    pub fn unseen_pixels(&self) -> Mask {
        self.footprint.to_picture(|index| self.unseen[index])
    }

    /// Returns the pixels of the picture that broke up to this time after the first fully wet picture, s.
    pub fn mask_at(&self, since_wet_s: f64) -> Mask {
        let until_s = (since_wet_s as f32).min(f32::MAX);
        self.footprint.to_picture(|index| self.since_wet_s[index] <= until_s)
    }

    /// Returns the time at which the film broke at a pixel of the picture, s after the first fully wet picture; `None`
    /// outside of the region or if the film did not break there.
    pub fn break_time_s(&self, column: usize, row: usize) -> Option<f64> {
        let time = self.since_wet_s[self.footprint.window_index(column, row)?];
        (time < NOT_BROKEN).then_some(f64::from(time))
    }
}

/// One connected component of the broken film.
#[derive(Debug, Clone)]
pub struct Break {
    /// Surface area of the break, mm².
    pub area_mm2: f64,
    /// Time at which the first pixel of the break broke, s after the first fully wet picture.
    pub first_seen_s: f64,
    /// Fraction of the break over which the film had closed again at the end, 0…1.
    pub closed_share: f64,
    /// The grids in which the break lies, row by row.
    pub grids: Vec<GridId>,
    /// The outer contour of the break in the picture, px.
    pub contour_px: Vec<Pixel>,
}

/// Minimum fraction of a break over which the film has closed, for the break to be closed again.
const MIN_CLOSED_FRACTION: f64 = 0.8;

impl Break {
    /// Returns whether the film had closed over the break at the end.
    pub fn has_closed_again(&self) -> bool {
        self.closed_share >= MIN_CLOSED_FRACTION
    }
}

/// Returns the breaks within a window, the largest first. A component without surface area is not a break.
pub fn breaks(
    footprint: &Footprint,
    since_wet_s: &[f32],
    is_closed: impl Fn(usize) -> bool,
) -> Result<Vec<Break>, ImagingError> {
    let window = footprint.window();
    let inside = since_wet_s.iter().map(|&time| time < NOT_BROKEN).collect();
    let pieces = imaging::connected_components(&Mask { width: window.width, height: window.height, inside }, true)?;
    let mut breaks = Vec::with_capacity(pieces.len());
    for piece in &pieces {
        let mut area_mm2 = vec![0.0; footprint.grids().len()];
        piece.iter().for_each(|&index| footprint.add_area(index, &mut area_mm2));
        let touched = footprint.grids().iter().zip(&area_mm2).filter(|(_, area)| **area > 0.0);
        breaks.push(Break {
            area_mm2: area_mm2.iter().sum(),
            first_seen_s: piece.iter().map(|&index| since_wet_s[index]).fold(NOT_BROKEN, f32::min).into(),
            closed_share: piece.iter().filter(|&&index| is_closed(index)).count() as f64 / piece.len() as f64,
            grids: touched.map(|(grid, _)| grid.id).collect(),
            contour_px: contour(footprint, piece)?,
        });
    }
    breaks.retain(|found| found.area_mm2 > 0.0);
    breaks.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    Ok(breaks)
}

/// Returns the outer contour of a single component. If all components were traced together, a component inside the hole
/// of another component would have no outer contour.
fn contour(footprint: &Footprint, piece: &[usize]) -> Result<Vec<Pixel>, ImagingError> {
    let places = || piece.iter().map(|&index| footprint.pixel_position(index));
    let (left, right) = min_and_max(places().map(|(column, _)| column));
    let (top, bottom) = min_and_max(places().map(|(_, row)| row));
    let mut mask = Mask::all_outside(right - left + 1, bottom - top + 1);
    for (column, row) in places() {
        mask.inside[(row - top) * mask.width + column - left] = true;
    }
    let outer = outer_contours(&mask)?.into_iter().next().unwrap_or_default();
    Ok(outer.into_iter().map(|pixel| Pixel::at(pixel.u + left as f64, pixel.v + top as f64)).collect())
}

fn min_and_max(values: impl Iterator<Item = usize>) -> (usize, usize) {
    values.fold((usize::MAX, 0), |(low, high), value| (low.min(value), high.max(value)))
}

/// Minimum number of pixels of a connected component; smaller ones are noise.
const MIN_COMPONENT_PX: usize = 4;
/// Distances from a dark component at which its surroundings are measured, px: beyond the soft edge of a drop.
const SURROUNDING_DISTANCE_PX: std::ops::RangeInclusive<usize> = 4..=9;
/// Minimum fraction of the pixels of an initially wet component that were wet in no later picture.
const MIN_NEVER_WET_FRACTION: f64 = 0.5;

/// The inputs for finding places that were already wet in the dry picture.
pub struct DrynessInputs<'a> {
    /// Returns whether the pixel broke, or was wet in no picture.
    pub is_suspect: &'a dyn Fn(usize) -> bool,
    /// Returns whether the pixel is evaluated and was wet in no picture.
    pub never_wet: &'a dyn Fn(usize) -> bool,
    /// Returns whether the pixel is evaluated.
    pub sees: &'a dyn Fn(usize) -> bool,
    /// Returns the dry brightness of a pixel.
    pub dry: &'a dyn Fn(usize) -> f64,
    /// The ratio τ of film brightness to dry brightness.
    pub film: f64,
}

/// Returns the pixels that were already wet in the dry picture.
pub fn initially_wet_pixels(window: &Window, known: &DrynessInputs<'_>) -> Vec<usize> {
    let was_wet = |piece: &Vec<usize>| {
        let never_wet = piece.iter().filter(|i| (known.never_wet)(**i)).count() as f64;
        piece.len() >= MIN_COMPONENT_PX
            && never_wet >= MIN_NEVER_WET_FRACTION * piece.len() as f64
            && mean(surrounding_pixels(window, piece, known).into_iter().map(known.dry))
                .zip(mean(piece.iter().copied().map(known.dry)))
                // The limit is halfway between the look of the dry surroundings and that of a film over them.
                .is_some_and(|(around, own)| own < around * (1.0 + known.film) / 2.0)
    };
    window
        .raster()
        .connected_components(&ALL_NEIGHBOURS, known.is_suspect)
        .into_iter()
        .filter(was_wet)
        .flatten()
        .collect()
}

fn surrounding_pixels(window: &Window, piece: &[usize], known: &DrynessInputs<'_>) -> Vec<usize> {
    let mut reached: std::collections::BTreeSet<usize> = piece.iter().copied().collect();
    let (mut rim, mut found) = (piece.to_vec(), Vec::new());
    for away_px in 1..=*SURROUNDING_DISTANCE_PX.end() {
        let next: Vec<usize> = rim.iter().flat_map(|&i| window.raster().neighbours(i, &ALL_NEIGHBOURS)).collect();
        rim = next.into_iter().filter(|&i| reached.insert(i)).collect();
        if SURROUNDING_DISTANCE_PX.contains(&away_px) {
            // Another drop beside this one would also darken the surroundings, and this drop would not be detected.
            found.extend(rim.iter().copied().filter(|&i| (known.sees)(i) && !(known.is_suspect)(i)));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Window = Window { left: 0, top: 0, width: 40, height: 40 };

    /// Expected values, calculated by hand for τ = 0.6: a component of 6 × 6 px is wet if its brightness is less than
    /// (1 + 0.6)/2 = 0.8 of its surroundings.
    #[test]
    fn a_dark_place_in_the_dry_picture_was_wet() {
        let place = |i: usize| (17..23).contains(&(i % 40)) && (17..23).contains(&(i / 40));
        let found = |own: f64, never_wet: &dyn Fn(usize) -> bool| {
            let dry = |i: usize| if place(i) { own } else { 100.0 };
            let known = DrynessInputs { is_suspect: &place, never_wet, sees: &|_| true, dry: &dry, film: 0.6 };
            initially_wet_pixels(&WINDOW, &known).len()
        };
        assert_eq!([79.0, 81.0, 100.0].map(|own| found(own, &place)), [36, 0, 0]);
        assert_eq!(
            found(60.0, &|i| place(i) && i % 40 < 19),
            0,
            "most of it was wet later: it is a film that broke"
        );
    }
}
