//! Determines the broken pixels after the end of the film, from the pixels that appear bare. It also determines which
//! pixels cannot be classified.
//!
//! A candidate is a connected component of pixels that appear bare. Pixels that appeared bare at the end, but for less
//! than the required time, belong to the candidate that they touch.
//!
//! A break has a uniform brightness over its whole area, and the film around it has another brightness. Three other
//! causes are recognised:
//! - A static glint has a bell-shaped brightness; only on a ring it is as bright as a bare surface.
//! - The brightness of the edge of a reflection increases from that of the film to that of a bare surface and beyond.
//! - A film that happens to be as bright as a bare surface has no rim.
//!
//! A candidate with one of these signs is treated as not seen, unless it closed again quickly and moved. A candidate
//! that is smaller than a break may move together with the candidates beside it. A small wet area within a break is a
//! bead of water on grease and not a film; it belongs to the break.

use super::footprint::Window;
use super::model::{ASSUMED_FILM_TRANSMISSION, MAX_FILM_POWER, Model, REFLECTION_TIME_S};
use super::thesis::NOT_BROKEN;
use panelprep_base::geometry::{ALL_NEIGHBOURS, DIRECT_NEIGHBOURS};
use std::collections::{BTreeSet, VecDeque};
use std::f64::consts::PI;

/// Minimum number of pixels of a connected component; smaller ones are noise.
const MIN_COMPONENT_PX: usize = 4;
/// Maximum interquartile range of the brightness over the inner part of a break, as a fraction of the brightness
/// difference between bare surface and film. Glints and edges of reflections vary by more (`make bench-inspect`).
const MAX_RELATIVE_BRIGHTNESS_SPREAD: f32 = 0.14;
/// Interquartile range that noise alone causes in an area of uniform brightness, as a multiple of σ: 1.35 in theory,
/// larger for few pixels.
const NOISE_SPREAD_SIGMA: f32 = 1.8;
/// Width of the rim of a disc, px: the pixels that touch its outside.
const RIM_WIDTH_PX: f64 = 0.9;
/// Minimum number of pixels of the inner part for a test of its uniformity.
const MIN_CORE_PX: usize = 9;
/// Minimum fraction of the pixels around a candidate that must be brighter than any bare surface, for the candidate to
/// lie along a reflection. The rims of breaks reflect lamps: around breaks in rendered films the fraction was at most
/// 0.12.
const MIN_REFLECTION_FRACTION: f64 = 0.25;
/// Minimum fraction of the film around a break that must be distinguishable from a bare surface. The film around a
/// break consists of the pixels within `SURROUNDING_DISTANCE_PX` of it.
const MIN_DISTINGUISHABLE_FRACTION: f64 = 0.6;
/// A pixel of a candidate became film if its brightness agrees with at least this fraction of the film pixels around
/// the candidate. In addition, the pixel must have the brightness of a break relative to less than this fraction of
/// these pixels.
const MIN_SIMILAR_FRACTION_AROUND: f64 = 0.35;
/// Minimum fraction of the pixels of a candidate that became film, for the whole candidate to have become film: the
/// rest is its blurred rim.
const MIN_FILM_LIKE_FRACTION: f64 = 0.6;
/// Minimum change of brightness of a broken candidate without a dry reference, as a fraction of the smallest change
/// that a break causes. With a smaller change the result is uncertain.
const MIN_RELATIVE_BREAK_CHANGE: f64 = 0.7;
const SURROUNDING_DISTANCE_PX: usize = 3;

/// The sizes that distinguish glints, beads and breaks.
#[derive(Debug, Clone, Copy)]
pub struct FeatureSizes {
    /// Maximum size of a glint, px.
    pub glint_px: usize,
    /// Maximum size of a bead of water, px.
    pub bead_px: usize,
    /// Minimum size of a break that makes a grid fail, px.
    pub break_px: usize,
}

/// The observations of the pixels in the window, except the times at which they broke.
pub trait PixelObservations {
    /// Returns the time since which an unbroken pixel has appeared bare, s.
    fn bare_since_s(&self, index: usize) -> Option<f32>;
    /// Returns the time for which the film was open at a broken pixel, s; `None` if the film did not close again.
    fn open_time_s(&self, index: usize) -> Option<f32>;
    /// Returns the pixel's mean brightness while the pixel appeared bare, relative to its dry brightness; for a pixel
    /// without a dry reference, relative to the brightness of its film.
    fn bare_brightness_ratio(&self, index: usize) -> f32;
    /// Returns the brightness of the film at the pixel, relative to the same reference as `bare_brightness_ratio`.
    fn film_brightness_ratio(&self, index: usize) -> f32;
    /// Returns the standard deviation of `bare_brightness_ratio`.
    fn noise(&self, index: usize) -> f32;
    /// Returns whether the film at the pixel is brighter than any bare surface.
    fn is_film_brighter(&self, index: usize) -> bool;
    /// Returns whether film and bare surface can be distinguished at the pixel.
    fn has_contrast(&self, index: usize) -> bool;
    /// Returns the minimum time for which a broken pixel appears bare, s.
    fn persist_s(&self) -> f32;
    /// Returns the longest time between two successive pictures, s.
    fn longest_step_s(&self) -> f32;
    /// Returns whether the pixel belongs to the region.
    fn is_inside(&self, index: usize) -> bool;
    /// Returns whether the pixel has no dry reference.
    fn has_no_dry_brightness(&self, index: usize) -> bool;
    /// Returns the mean brightness of the pixel while it appeared bare, and its present brightness. Both are in grey
    /// levels, in the light of the first wet picture.
    fn levels(&self, index: usize) -> [f32; 2];
    /// Returns the relative difference that is permitted between the brightness of the film at two neighbouring places.
    fn neighbour_tolerance(&self) -> f32;
    /// Returns the minimum and the maximum brightness of a break at a pixel without a dry reference, relative to the
    /// brightness of its film; `None` if the range is not known.
    fn break_ratio_range(&self) -> Option<[f32; 2]>;
}

/// The final classification of each pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct FinalMask {
    /// For each pixel, the time at which the film broke, s; [`NOT_BROKEN`] if the film did not break.
    pub broke_s: Vec<f32>,
    /// Pixels for which it is uncertain whether they broke; in `broke_s` they are [`NOT_BROKEN`].
    pub unsure: Vec<usize>,
}

/// Determines which pixels broke, and for which pixels this is uncertain.
pub fn determine_breaks(
    window: &Window,
    broke_s: Vec<f32>,
    sizes: FeatureSizes,
    seen: &impl PixelObservations,
) -> FinalMask {
    let mut broke_s = broke_s;
    grow_breaks(window, &mut broke_s, |index| seen.bare_since_s(index));
    let is_bead = fill_beads(window, &mut broke_s, sizes.bead_px, seen);
    let pieces = window.raster().connected_components(&ALL_NEIGHBOURS, |i| broke_s[i] < NOT_BROKEN);
    let mut unsure = Vec::new();
    let all_s = broke_s.clone();
    let mut short = Vec::new();
    for piece in pieces {
        let place = BareCandidate { window, broke_s: &broke_s, is_bead: &is_bead, piece: &piece };
        match place.classify(sizes.glint_px, seen) {
            CandidateVerdict::Broke => continue,
            CandidateVerdict::Passed => {}
            // A candidate as large as a break is not judged together with others: its own times must show that it
            // moves.
            CandidateVerdict::Unsure if piece.len() < sizes.break_px && place.has_closed_quickly(seen) => {
                short.extend_from_slice(&piece);
            }
            CandidateVerdict::Unsure => unsure.extend_from_slice(&piece),
        }
        // Neither a passed nor an uncertain candidate is a break. Uncertain pixels are listed, so that their grid does
        // not pass either.
        piece.iter().for_each(|&i| broke_s[i] = NOT_BROKEN);
    }
    let short = BareCandidate { window, broke_s: &all_s, is_bead: &is_bead, piece: &short };
    for trail in short.group_trails(sizes.glint_px) {
        if !(BareCandidate { piece: &trail, ..short }).has_moved(seen) {
            unsure.extend(trail);
        }
    }
    unsure.sort_unstable();
    FinalMask { broke_s, unsure }
}

/// Treats small wet areas within an area that appears bare as beads. A bead is treated as broken from the time at which
/// its rim was complete. Returns which pixels are beads.
fn fill_beads(window: &Window, broke_s: &mut [f32], bead_px: usize, seen: &impl PixelObservations) -> Vec<bool> {
    let mut is_bead = vec![false; broke_s.len()];
    for wet in window.raster().connected_components(&DIRECT_NEIGHBOURS, |i| broke_s[i] == NOT_BROKEN) {
        // A bead within a break is water that receded, not a film; without the bead the measured break would be too
        // small.
        let enclosed =
            wet.len() <= bead_px && wet.iter().all(|&i| seen.is_inside(i) && !is_at_window_edge(window, i));
        if enclosed {
            let rim =
                wet.iter().flat_map(|&i| window.raster().neighbours(i, &DIRECT_NEIGHBOURS)).map(|i| broke_s[i]);
            let closed_in_s = rim.filter(|time_s| *time_s < NOT_BROKEN).fold(0.0, f32::max);
            wet.iter().for_each(|&i| (broke_s[i], is_bead[i]) = (closed_in_s, true));
        }
    }
    is_bead
}

/// The classification of a candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CandidateVerdict {
    Broke,
    /// A glint moved over the candidate.
    Passed,
    Unsure,
}

/// A candidate: one connected component of pixels that appear bare, or the components of one trail.
#[derive(Clone, Copy)]
struct BareCandidate<'a> {
    window: &'a Window,
    broke_s: &'a [f32],
    is_bead: &'a [bool],
    piece: &'a [usize],
}

impl BareCandidate<'_> {
    fn classify(&self, glint_px: usize, seen: &impl PixelObservations) -> CandidateVerdict {
        let passed = self.piece.len() <= glint_px && self.has_moved(seen) || self.has_become_film(seen);
        let unless_passed = if passed { CandidateVerdict::Passed } else { CandidateVerdict::Unsure };
        if self.piece.len() < MIN_COMPONENT_PX {
            return unless_passed;
        }
        let next = self.pixels_around(1, |i| self.broke_s[i] == NOT_BROKEN);
        let around =
            self.pixels_around(SURROUNDING_DISTANCE_PX, |i| self.broke_s[i] == NOT_BROKEN && seen.is_inside(i));
        let core = self.core_pixels();
        let is_even = brightness_spread(&core, seen)
            .is_none_or(|spread| spread <= max_brightness_spread(&core, &around, seen));
        // A break in a film that is itself bright does not lie along a reflection.
        let is_along_reflection = fraction_where(&next, |i| seen.is_film_brighter(i)) >= MIN_REFLECTION_FRACTION
            && fraction_where(self.piece, |i| seen.is_film_brighter(i)) < MIN_REFLECTION_FRACTION;
        let is_distinguishable = fraction_where(&around, |i| seen.has_contrast(i)) >= MIN_DISTINGUISHABLE_FRACTION;
        let is_break = is_compact(self.piece.len(), core.len())
            && is_even
            && !is_along_reflection
            && is_distinguishable
            && self.is_contrast_plausible(seen);
        // With a small inner part, its uniformity contains little information; in this case motion decides.
        if is_break && !(passed && core.len() < MIN_CORE_PX) { CandidateVerdict::Broke } else { unless_passed }
    }

    /// Checks whether the bare appearance moved over the candidate. A break is open over its whole area at one time. If
    /// a glint passed, the first part is film again before the glint reaches the last part.
    fn has_moved(&self, seen: &impl PixelObservations) -> bool {
        let own = || self.piece.iter().copied().filter(|&i| !self.is_bead[i]);
        let mut since_s: Vec<f32> = own().map(|i| self.broke_s[i]).collect();
        let until_s: Option<Vec<f32>> = own().map(|i| Some(self.broke_s[i] + seen.open_time_s(i)?)).collect();
        let Some(mut until_s) = until_s.filter(|until_s| !until_s.is_empty()) else { return false };
        // The 10th and the 90th percentile are used instead of the extremes, because a few pixels of the blurred rim
        // open and close at other times.
        since_s.sort_by(f32::total_cmp);
        until_s.sort_by(f32::total_cmp);
        // The closing is detected late, as the opening is: the counter must first return to zero, which takes one
        // picture less than the time that it represents. The candidate may have closed up to one picture later than the
        // counter states.
        let closed_s = until_s[until_s.len() / 10] - seen.persist_s() + 2.0 * seen.longest_step_s();
        since_s[since_s.len() - 1 - since_s.len() / 10] > closed_s
    }

    /// Groups the components of this candidate that one moving reflection may have caused: each group is a trail. A
    /// moving reflection looks bare at some positions on its path, and no single position shows the motion. Components
    /// that are less than two diameters of the largest glint apart belong to one trail.
    fn group_trails(&self, glint_px: usize) -> Vec<Vec<usize>> {
        let diameter_px = 2.0 * (glint_px as f64 / PI).sqrt();
        let own: BTreeSet<usize> = self.piece.iter().copied().collect();
        let mut near = own.clone();
        near.extend(self.pixels_around(diameter_px as usize, |_| true));
        let trails = self.window.raster().connected_components(&ALL_NEIGHBOURS, |i| near.contains(&i));
        trails.into_iter().map(|trail| trail.into_iter().filter(|i| own.contains(i)).collect()).collect()
    }

    /// Checks whether each pixel of the candidate became film again within the time in which a reflection moves on.
    fn has_closed_quickly(&self, seen: &impl PixelObservations) -> bool {
        let mut own = self.piece.iter().filter(|&&i| !self.is_bead[i]);
        own.all(|&i| seen.open_time_s(i).is_some_and(|open_s| f64::from(open_s) <= REFLECTION_TIME_S))
    }

    /// Checks whether a candidate without a dry reference became as bright as the film around it. This happens if a
    /// glint covered the place while its film brightness was learnt, or if water reached the place later. A break
    /// differs from the film around it. Along an edge of a sanded area only the film on one side is as bright as the
    /// candidate; in this case the candidate must not have the brightness of a break of the film on the other side.
    fn has_become_film(&self, seen: &impl PixelObservations) -> bool {
        let of_film =
            |i: usize| self.broke_s[i] == NOT_BROKEN && seen.is_inside(i) && seen.has_no_dry_brightness(i);
        let around = self.pixels_around(SURROUNDING_DISTANCE_PX, of_film);
        let own: Vec<usize> = self.piece.iter().copied().filter(|&i| !self.is_bead[i]).collect();
        if !own.iter().all(|&i| seen.has_no_dry_brightness(i)) || around.len() < MIN_CORE_PX {
            return false;
        }
        let films: Vec<f32> = around.iter().map(|&i| seen.levels(i)[1]).collect();
        let share_of = |holds: &dyn Fn(f32) -> bool| {
            films.iter().filter(|&&film| holds(film)).count() as f64 / films.len() as f64
        };
        // Each pixel is compared individually: the mean brightness of a break over two kinds of film matches neither of
        // them.
        let is_film = |i: usize| {
            let [bare, now] = seen.levels(i);
            // A pixel that has not returned to its film brightness is compared in the last picture, in which it has the
            // same light as the film around it.
            let look = if seen.open_time_s(i).is_none() { now } else { bare };
            let is_break_of = |film: f32| {
                seen.break_ratio_range().is_none_or(|[least, most]| (least..=most).contains(&(look / film)))
            };
            share_of(&|film| (look - film).abs() <= seen.neighbour_tolerance() * film)
                >= MIN_SIMILAR_FRACTION_AROUND
                && share_of(&is_break_of) < MIN_SIMILAR_FRACTION_AROUND
        };
        fraction_where(&own, is_film) >= MIN_FILM_LIKE_FRACTION
    }

    /// Checks whether the brightness differs from that of the candidate's own film as in a break; only pixels without a
    /// dry reference are compared.
    fn is_contrast_plausible(&self, seen: &impl PixelObservations) -> bool {
        let own = self.piece.iter().copied().filter(|&i| seen.has_no_dry_brightness(i) && !self.is_bead[i]);
        let shares: Vec<f32> = own.map(|i| seen.bare_brightness_ratio(i)).collect();
        let mean = shares.iter().sum::<f32>() / shares.len().max(1) as f32;
        let within = |[least, most]: [f32; 2]| least <= mean && mean <= most;
        shares.is_empty() || seen.break_ratio_range().is_some_and(within)
    }

    /// Returns the pixels within this distance of the candidate for which `counts` is true.
    fn pixels_around(&self, away_px: usize, counts: impl Fn(usize) -> bool) -> Vec<usize> {
        let inner: BTreeSet<usize> = self.piece.iter().copied().collect();
        let (mut reached, mut rim) = (inner.clone(), self.piece.to_vec());
        for _ in 0..away_px {
            let raster = self.window.raster();
            let next: Vec<usize> = rim.iter().flat_map(|&i| raster.neighbours(i, &ALL_NEIGHBOURS)).collect();
            rim = next.into_iter().filter(|&i| reached.insert(i)).collect();
        }
        reached.into_iter().filter(|i| !inner.contains(i) && counts(*i)).collect()
    }

    /// Returns the pixels of the inner part: neither at the rim of the candidate nor in a bead.
    fn core_pixels(&self) -> Vec<usize> {
        let is_inner = |&i: &usize| {
            self.window.raster().neighbours(i, &DIRECT_NEIGHBOURS).all(|next| self.broke_s[next] < NOT_BROKEN)
        };
        self.piece.iter().copied().filter(is_inner).filter(|&i| !self.is_bead[i]).collect()
    }
}

/// Returns the maximum brightness spread of the inner part of a break, from its contrast to the film around it and the
/// noise.
fn max_brightness_spread(core: &[usize], around: &[usize], seen: &impl PixelObservations) -> f32 {
    let mean = |pixels: &[usize], of: &dyn Fn(usize) -> f32| {
        pixels.iter().map(|&i| of(i)).sum::<f32>() / pixels.len().max(1) as f32
    };
    let bare = mean(core, &|i| seen.bare_brightness_ratio(i));
    let film = mean(around, &|i| seen.film_brightness_ratio(i));
    (MAX_RELATIVE_BRIGHTNESS_SPREAD * (bare - film)).hypot(NOISE_SPREAD_SIGMA * mean(core, &|i| seen.noise(i)))
}

/// Returns the interquartile range of the brightness of the pixels; `None` for too few pixels.
fn brightness_spread(core: &[usize], seen: &impl PixelObservations) -> Option<f32> {
    let mut looks: Vec<f32> = core.iter().map(|&i| seen.bare_brightness_ratio(i)).collect();
    looks.sort_by(f32::total_cmp);
    (looks.len() >= MIN_CORE_PX).then(|| looks[looks.len() - 1 - looks.len() / 4] - looks[looks.len() / 4])
}

/// Returns whether the candidate has at least half of the inner pixels of a disc with the same number of pixels. A
/// trail and the edge of a reflection are thin and have fewer inner pixels.
fn is_compact(size_px: usize, core_px: usize) -> bool {
    let radius_px = (size_px as f64 / PI).sqrt();
    core_px as f64 >= PI * (radius_px - RIM_WIDTH_PX).max(0.0).powi(2) / 2.0
}

/// Returns the fraction of the pixels for which `holds` is true; 1 if there are no pixels.
fn fraction_where(pixels: &[usize], holds: impl Fn(usize) -> bool) -> f64 {
    let count = pixels.iter().filter(|&&i| holds(i)).count();
    if pixels.is_empty() { 1.0 } else { count as f64 / pixels.len() as f64 }
}

/// Returns whether the pixel lies at an edge of the window.
fn is_at_window_edge(window: &Window, index: usize) -> bool {
    window.raster().neighbours(index, &DIRECT_NEIGHBOURS).count() < 4
}

fn grow_breaks(window: &Window, broke_s: &mut [f32], looks_bare_since_s: impl Fn(usize) -> Option<f32>) {
    let mut rim: VecDeque<usize> = (0..broke_s.len()).filter(|&i| broke_s[i] < NOT_BROKEN).collect();
    while let Some(index) = rim.pop_front() {
        for next in window.raster().neighbours(index, &ALL_NEIGHBOURS) {
            if broke_s[next] == NOT_BROKEN
                && let Some(since_s) = looks_bare_since_s(next)
            {
                broke_s[next] = since_s;
                rim.push_back(next);
            }
        }
    }
}

/// The model of a film, together with the pixels of the region that is judged.
pub struct ModelObservations<'a> {
    model: &'a Model,
    inside: &'a [bool],
    break_to_film: Option<[f32; 2]>,
}

impl<'a> ModelObservations<'a> {
    /// Combines the model with a mask of the pixels that are judged.
    pub fn new(model: &'a Model, inside: &'a [bool]) -> Self {
        ModelObservations { model, inside, break_to_film: break_ratio_range(model) }
    }
}

/// Returns the minimum and the maximum brightness of a break at a pixel without a dry reference, relative to the
/// brightness of its film. Both are calculated from the film at the pixels that have a dry reference, or from the
/// assumed film if there are none. If the film is darker than the dry panel at some pixels and brighter at others, the
/// result is `None`.
pub fn break_ratio_range(model: &Model) -> Option<[f32; 2]> {
    let [low, high] = model.film_range().unwrap_or([ASSUMED_FILM_TRANSMISSION; 2]);
    let away = MIN_RELATIVE_BREAK_CHANGE * 2.0 * model.away_threshold();
    if high < model.min_damp_ratio() {
        Some([1.0 + away, low.powf(-MAX_FILM_POWER) * 1.125].map(|share| share as f32))
    } else if low > 1.0 {
        Some([model.min_damp_ratio() * high.powf(-MAX_FILM_POWER), 1.0 - away].map(|share| share as f32))
    } else {
        None
    }
}

impl PixelObservations for ModelObservations<'_> {
    fn bare_since_s(&self, index: usize) -> Option<f32> {
        self.model.bare_since_s(index).filter(|_| self.inside[index])
    }

    fn open_time_s(&self, index: usize) -> Option<f32> {
        self.model.open_time_s(index)
    }

    fn bare_brightness_ratio(&self, index: usize) -> f32 {
        self.model.bare_brightness_ratio(index)
    }

    fn film_brightness_ratio(&self, index: usize) -> f32 {
        self.model.film_brightness_ratio(index)
    }

    fn noise(&self, index: usize) -> f32 {
        self.model.bare_ratio_noise(index)
    }

    fn is_film_brighter(&self, index: usize) -> bool {
        self.model.is_film_brighter(index)
    }

    fn has_contrast(&self, index: usize) -> bool {
        self.model.has_contrast(index)
    }

    fn persist_s(&self) -> f32 {
        self.model.persist_s()
    }

    fn longest_step_s(&self) -> f32 {
        self.model.longest_step_s()
    }

    fn is_inside(&self, index: usize) -> bool {
        self.inside[index]
    }

    fn has_no_dry_brightness(&self, index: usize) -> bool {
        self.model.has_no_dry_brightness(index)
    }

    fn levels(&self, index: usize) -> [f32; 2] {
        self.model.levels(index)
    }

    fn neighbour_tolerance(&self) -> f32 {
        self.model.away_threshold() as f32 / 2.0
    }

    fn break_ratio_range(&self) -> Option<[f32; 2]> {
        self.break_to_film
    }
}

#[cfg(test)]
mod tests;
