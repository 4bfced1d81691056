//! Evidence of a film on places that were sanded since the dry picture, and have no dry look of their own.
//!
//! Such a place is compared with its own wet look while the film is watched. A bare place keeps its look, too, so
//! it needs separate evidence that it was wet when the film began. The evidence is that water moves: places beside
//! each other then differ over time by more than the sensor's noise ([`Shimmer`]). A place was wet if the places
//! near it that look alike shimmer. They are searched in squares that grow until there are enough of them. A bare
//! place does not look like the film around it, and it is still. If drops run over a part of it, most of it is
//! still.
//!
//! Water that runs over a bare place moves as a film does. So a place that is narrower than any disc, and differs
//! from the looks around it as a break differs from its film, has no evidence either: it was made by a break and
//! not by a disc ([`Looks::narrow`]).
//!
//! If a film does not move at all, its sanded places stay unseen. A new dry picture, recorded after they dried,
//! helps.

use super::footprint::Window;
use super::model::{DIFFERENCES, Model, Shimmer};
use super::narrow_spots::Looks;
use crate::geometry::median;
use crate::imaging::{ImagingError, named};
use opencv::core::{self, Mat, MatTraitConstManual, Point, Scalar};
use opencv::imgproc;
use rayon::prelude::*;

/// The shimmer of a film is at least this many times the sensor's noise …
const MIN_SHIMMER: f64 = 1.35;
/// … and exceeds the value that noise alone would give by at least this many standard deviations.
const SURE_SIGMA: f64 = 4.5;
/// The shimmer of still places lies below that factor by at least this many standard deviations.
const STILL_SIGMA: f64 = 3.0;
/// A place is still if it surely moves less than this share of the water that moves on a film of the clip. More
/// than this share of the places that look alike is still only if there is no film: on rendered films at most 0.023
/// was, for 99 % of all places, on bare ones 0.31.
const MIN_FILM_SHARE: f64 = 0.2;
const MAX_STILL_SHARE: f64 = 0.05;
/// This share of the differences may show a shadow or a glint that passes, and does not count. Fewer other
/// differences, or fewer places, give no result.
const PASSING: f64 = 0.34;
const MIN_DIFFERENCES: usize = 3;
const MIN_SITES: f64 = 6.0;
/// Half sides of the squares that are evaluated, in steps of the lattice on which shimmer is measured.
const RADII: [usize; 4] = [2, 4, 8, 16];
/// The number of radii, from the smallest, that show only the nearest places.
const NEAREST: usize = 2;
/// Places look alike if their looks differ by at most this many times the noise of one pixel, or by a quarter of
/// the change that a break causes.
const ALIKE_SIGMA: f64 = 3.0;
/// The shape of the smallest break that is surely found, 12 px.
const SURE_BREAK: [[u8; 4]; 4] = [[0, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1], [0, 1, 1, 0]];

/// The data about the sanded places.
pub struct Sanded<'a> {
    pub model: &'a Model,
    pub window: &'a Window,
    /// For each pixel of the window, whether the pixel is judged.
    pub inside: &'a [bool],
    /// Time at which each pixel broke, s; infinite if the pixel did not break.
    pub broke_s: &'a [f32],
    /// The smallest radius of a disc, px.
    pub disc_px: usize,
    /// The least and the largest look of a break, as a share of its film's look; `None` if the range is not known.
    pub break_to_film: Option<[f32; 2]>,
}

/// One place of the lattice.
#[derive(Debug, Clone, Copy)]
struct Site {
    /// The look of the film at this site, levels; 0 for a place that is not judged.
    look: f64,
    /// One standard deviation of the site's look in a picture, levels.
    noise: f64,
    /// The site's shimmer in each difference.
    shimmer: [f32; DIFFERENCES],
}

impl Site {
    /// Returns the noise of a site as a share of its look.
    fn noise_share(&self) -> f64 {
        self.noise / self.look
    }
}

/// The statistics of several places in each difference: the number of places, the sum of their z and the sum of z².
#[derive(Debug, Clone, Copy, Default)]
struct Shown([[f64; 3]; DIFFERENCES]);

impl Shown {
    fn add(&mut self, site: &Site) {
        for ([count, sum, squares], z) in self.0.iter_mut().zip(site.shimmer) {
            if !z.is_nan() {
                let z = f64::from(z);
                (*count, *sum, *squares) = (*count + 1.0, *sum + z, *squares + z * z);
            }
        }
    }

    /// Returns the ratio of these places' variance to the variance of still places, and the standard deviation of
    /// this ratio for still places. The ratio is the mean over the smaller differences. The variance of n normal
    /// deviates has the relative standard deviation √(2/(n − 1)).
    fn shimmer(&self) -> Option<(f64, f64)> {
        let seen = self.0.iter().filter(|[count, ..]| *count >= MIN_SITES);
        let mut shown: Vec<(f64, f64)> = seen
            .map(|[count, sum, squares]| ((squares - sum * sum / count) / (count - 1.0), count - 1.0))
            .collect();
        shown.sort_by(|a, b| a.0.total_cmp(&b.0));
        let passing = (PASSING * shown.len() as f64).ceil() as usize;
        let kept = Some(shown.len() - passing).filter(|kept| *kept >= MIN_DIFFERENCES)?;
        let (variance, degrees) = shown[..kept].iter().fold((0.0, 0.0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
        // Differences that share a span are not independent, so only a third of them is counted.
        Some((variance / kept as f64, (2.0 * 3.0 / degrees).sqrt()))
    }
}

impl Sanded<'_> {
    /// Returns the sanded pixels without evidence that they were wet.
    ///
    /// # Errors
    /// If OpenCV refuses the mask.
    pub fn without_evidence(&self) -> Result<Vec<bool>, ImagingError> {
        let Some(shimmer) = self.model.shimmer() else { return Ok(vec![false; self.inside.len()]) };
        let lattice = Lattice { sites: self.sites(shimmer), shimmer, tolerance: self.model.away_share() };
        let is_wet = lattice.wet();
        // A pixel gets the evidence of a site beside it that looks as it does, or of a place beside it that was not
        // sanded.
        let has_evidence = |i: usize| {
            let (row, column) = (i / self.window.width, i % self.window.width);
            let look = self.look_levels(i);
            let is_like_wet_site = |at: usize| {
                let Some(site) = lattice.sites.get(at).filter(|site| site.look > 0.0) else { return false };
                is_wet[at] && (look - site.look).abs() <= lattice.tolerance * site.look
            };
            shimmer.sites_about(row, column).any(is_like_wet_site) || self.is_like_film_beside(row, column, look)
        };
        let tolerance = self.model.away_share() as f32;
        let looks = Looks { window: self.window, levels: self.looks(), disc_px: self.disc_px, tolerance };
        let is_narrow = named("the places narrower than a disc", looks.narrow(self.break_to_film))?;
        let is_without = |i: usize| {
            let is_whole = self.inside[i] && self.model.is_without_dry(i) && self.broke_s[i].is_infinite();
            is_whole && (is_narrow[i] || !has_evidence(i))
        };
        let without: Vec<bool> = (0..self.inside.len()).into_par_iter().map(is_without).collect();
        self.wide(&without)
    }

    /// Returns the pixels without evidence that lie in a place wide enough for the smallest break that is surely
    /// found. Broken pixels and pixels outside of the region beside them count as part of this place. A thinner
    /// place cannot hide a break.
    fn wide(&self, without: &[bool]) -> Result<Vec<bool>, ImagingError> {
        let hides = |i: usize| without[i] || !self.inside[i] || self.broke_s[i].is_finite();
        let bytes: Vec<u8> = (0..without.len()).map(|i| u8::from(hides(i))).collect();
        let opened = named("the opening of the mask of unseen places", opened(self.window, &bytes))?;
        Ok(without.iter().zip(opened).map(|(without, opened)| *without && opened).collect())
    }

    /// Does a pixel look as the film of places that were not sanded and lie within a site's side from it? The area
    /// that counts as sanded is wider than the area that a disc touched, and a bare strip would look as the film
    /// beside it only by chance.
    fn is_like_film_beside(&self, row: usize, column: usize, look: f64) -> bool {
        let near =
            |at: usize, end: usize| at.saturating_sub(Shimmer::SIDE_PX)..(at + Shimmer::SIDE_PX + 1).min(end);
        let mut looks: Vec<f64> = near(row, self.window.height)
            .flat_map(|row| near(column, self.window.width).map(move |column| row * self.window.width + column))
            .filter(|&at| self.is_film_with_dry(at))
            .map(|at| self.look_levels(at))
            .collect();
        let Some(film) = median(&mut looks).filter(|_| looks.len() >= Shimmer::SIDE_PX) else { return false };
        (look - film).abs() <= (self.model.away_share() / 2.0 * film).max(ALIKE_SIGMA * self.model.noise_levels())
    }

    fn is_film_with_dry(&self, i: usize) -> bool {
        let model = self.model;
        self.inside[i]
            && !model.is_without_dry(i)
            && model.ever_wet(i)
            && self.broke_s[i].is_infinite()
            && model.saw(i)
    }

    /// Returns the look of a pixel's film, levels. For a place that left its wet look and became film, returns the
    /// look at the end.
    fn look_levels(&self, i: usize) -> f64 {
        if self.model.is_open(i) { f64::from(self.model.levels(i)[0]) } else { self.model.wet_look_levels(i) }
    }

    /// Returns the looks of the film that did not break, levels; 0 elsewhere.
    fn looks(&self) -> Vec<f32> {
        let holds = |i: usize| self.inside[i] && self.broke_s[i].is_infinite() && self.model.saw(i);
        (0..self.inside.len()).map(|i| if holds(i) { self.look_levels(i) as f32 } else { 0.0 }).collect()
    }

    fn sites(&self, shimmer: &Shimmer) -> Vec<Site> {
        let none = Site { look: 0.0, noise: 0.0, shimmer: [f32::NAN; DIFFERENCES] };
        let site = |at: usize| {
            let (top, left) = shimmer.place(at);
            let rows = top..(top + Shimmer::SIDE_PX).min(self.window.height);
            let columns = left..(left + Shimmer::SIDE_PX).min(self.window.width);
            let pixels: Vec<usize> =
                rows.flat_map(|row| columns.clone().map(move |column| row * self.window.width + column)).collect();
            let counts =
                |i: &usize| self.inside[*i] && self.model.is_without_dry(*i) && self.broke_s[*i].is_infinite();
            let mut looks: Vec<f64> = pixels.iter().filter(|i| counts(i)).map(|i| self.look_levels(*i)).collect();
            // A part of a site shows too little of what is common to the whole site.
            if looks.len() < Shimmer::SIDE_PX * Shimmer::SIDE_PX / 2 {
                return None;
            }
            let look = median(&mut looks)?;
            let variance = self.model.site_variance(pixels[0], look)?;
            Some(Site { look, noise: variance.sqrt(), shimmer: shimmer.at(at, variance.sqrt() / look.max(1.0)) })
        };
        (0..shimmer.len()).map(|at| site(at).unwrap_or(none)).collect()
    }
}

/// Returns the morphological opening of a mask by the smallest break that is surely found; the mask counts as set
/// outside of the window.
fn opened(window: &Window, bytes: &[u8]) -> opencv::Result<Vec<bool>> {
    let mask = Mat::new_rows_cols_with_data(window.height as i32, window.width as i32, bytes)?;
    let kernel = Mat::from_slice_2d(&SURE_BREAK)?;
    let (border, kind) = (Scalar::all(1.0), core::BORDER_CONSTANT);
    let (mut eroded, mut opened) = (Mat::default(), Mat::default());
    // An even kernel has no middle: the second step returns by the way of the first one.
    imgproc::erode(&mask, &mut eroded, &kernel, Point::new(1, 1), 1, kind, border)?;
    imgproc::dilate(&eroded, &mut opened, &kernel, Point::new(2, 2), 1, kind, Scalar::all(0.0))?;
    Ok(opened.data_bytes()?.iter().map(|&byte| byte > 0).collect())
}

/// All sites.
struct Lattice<'a> {
    sites: Vec<Site>,
    shimmer: &'a Shimmer,
    /// Half of the change that a break causes in a film, as a share of the film's look.
    tolerance: f64,
}

impl Lattice<'_> {
    /// Returns for each site whether the site was wet.
    fn wet(&self) -> Vec<bool> {
        let sites = 0..self.sites.len();
        let water: Vec<Option<f64>> = sites.clone().into_par_iter().map(|at| self.water(at)).collect();
        let mut known: Vec<f64> = water.iter().flatten().copied().collect();
        let Some(film) = median(&mut known) else { return vec![false; water.len()] };
        let is_still: Vec<bool> = sites.clone().into_par_iter().map(|at| self.is_still(at, film)).collect();
        // Drops that run over a bare place move as well, on a part of it: the rest is still, and looks alike.
        let is_wet =
            |at: usize| water[at].is_some() && !is_still[at] && self.still_share(at, &is_still) <= MAX_STILL_SHARE;
        sites.into_par_iter().map(is_wet).collect()
    }

    /// Returns how much the water on a site moves: the variance of the site's look in excess of the noise, relative
    /// to the look; `None` without evidence.
    fn water(&self, at: usize) -> Option<f64> {
        let site = &self.sites[at];
        if site.look <= 0.0 {
            return None;
        }
        for (nth, radius) in RADII.into_iter().enumerate() {
            let (ratio, deviation) = self.alike(at, radius).shimmer()?;
            if ratio >= MIN_SHIMMER.max(1.0 + SURE_SIGMA * deviation) {
                return Some((ratio - 1.0) * site.noise_share().powi(2));
            }
            // If the nearest places are surely still, farther places that move do not count.
            if nth < NEAREST && ratio + STILL_SIGMA * deviation < MIN_SHIMMER {
                return None;
            }
        }
        None
    }

    /// Checks from the nearest places whether a site surely moves less than a film of this clip.
    fn is_still(&self, at: usize, film: f64) -> bool {
        let site = &self.sites[at];
        if site.look <= 0.0 {
            return false;
        }
        let least = 1.0 + MIN_FILM_SHARE * film / site.noise_share().powi(2);
        RADII[..NEAREST].iter().all(|radius| {
            let shown = self.alike(at, *radius).shimmer();
            shown.is_some_and(|(ratio, deviation)| ratio + STILL_SIGMA * deviation < least)
        })
    }

    /// Returns the share of still sites among the near sites that look like this one.
    fn still_share(&self, at: usize, is_still: &[bool]) -> f64 {
        let (mut still, mut all) = (0, 0);
        self.near_alike(at, RADII[RADII.len() - 1], |near| {
            all += 1;
            still += usize::from(is_still[near]);
        });
        still as f64 / all.max(1) as f64
    }

    /// Returns the combined statistics of the near places that look like this one.
    fn alike(&self, at: usize, radius: usize) -> Shown {
        let mut shown = Shown::default();
        self.near_alike(at, radius, |near| shown.add(&self.sites[near]));
        shown
    }

    /// Calls `takes` for each site that looks like this one, within a square around this site.
    fn near_alike(&self, at: usize, radius: usize, mut takes: impl FnMut(usize)) {
        let own = &self.sites[at];
        let alike = (self.tolerance / 2.0 * own.look).max(ALIKE_SIGMA * own.noise);
        let columns = self.shimmer.columns();
        let rows = self.sites.len() / columns;
        let (row, column) = (at / columns, at % columns);
        for row in row.saturating_sub(radius)..(row + radius + 1).min(rows) {
            for near in
                row * columns + column.saturating_sub(radius)..row * columns + (column + radius + 1).min(columns)
            {
                let site = &self.sites[near];
                if site.look > 0.0 && (site.look - own.look).abs() <= alike {
                    takes(near);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::Terms;
    use super::*;
    use crate::geometry::ColorPicture;

    const SIDE: usize = 128;
    /// The window lies in the middle of the picture, which shows the sensor's noise around it.
    const WINDOW: Window = Window { left: 32, top: 32, width: 64, height: 64 };

    /// Returns a normal deviate with standard deviation 1, from the sum of four bytes that the picture number and
    /// the pixel determine.
    fn noise(picture: usize, index: usize) -> f64 {
        let mixed = (picture as u64 * 0x9E37_79B9 + index as u64).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 31)).wrapping_mul(0x94D0_49BB_1331_11EB);
        let bytes = (mixed ^ (mixed >> 29)).to_le_bytes();
        // A byte has the variance (256² − 1)/12 = 5461; the sum of four bytes has 148².
        (bytes[..4].iter().map(|byte| f64::from(*byte)).sum::<f64>() - 510.0) / 147.8
    }

    /// The whole window was sanded. On its left half water of ±`film` levels moves from place to place and from
    /// second to second. Its right half is as bright as a break in that film and shows only the sensor's noise.
    /// `also` adds levels to a place of the window in a picture.
    fn without_evidence(film: f64, also: impl Fn(usize, usize, f64) -> f64) -> [usize; 2] {
        let terms = Terms { channel_weights: [1.0; 3], persist_s: 0.6, damp: 0.8 };
        let inside = [true; 64 * 64];
        let mut model = Model::new(WINDOW, &inside, &inside, terms);
        let shot = |number: usize, time_s: f64| {
            let level = |index: usize| {
                let (column, row) = (index % SIDE, index / SIDE);
                let on_panel = [column, row].iter().all(|at| (32..96).contains(at));
                let water = if column < 64 { film * noise(900 + (time_s / 2.0) as usize, index / 2) } else { 0.0 };
                let own = if on_panel { water + also(column - 32, row - 32, time_s) } else { 0.0 };
                let level = if on_panel && column >= 64 { 100.0 } else { 70.0 };
                [0, 1, 2].map(|channel| (level + own + 1.2 * noise(number, 3 * index + channel)).round() as u8)
            };
            ColorPicture { width: SIDE, height: SIDE, rgb: (0..SIDE * SIDE).map(level).collect() }
        };
        model.dry(&shot(0, -2.0));
        for number in 1..=100 {
            let time_s = 0.2 * number as f64 - 0.2;
            let picture = shot(number, time_s);
            model.look(&picture);
            model.follow(&picture, time_s);
        }
        model.end();
        let broke_s = vec![f32::INFINITY; 64 * 64];
        let sanded = Sanded {
            model: &model,
            window: &WINDOW,
            inside: &inside,
            broke_s: &broke_s,
            disc_px: 12,
            break_to_film: Some([1.25, 2.0]),
        };
        let found = sanded.without_evidence().expect("a mask");
        let (left, right): (Vec<usize>, Vec<usize>) =
            (0..64 * 64).filter(|i| found[*i]).partition(|i| *i % 64 < 32);
        [left.len(), right.len()]
    }

    /// By hand: each half has 2,048 px. Water of 2 levels is 1.7 times the noise of one channel, and 2.9 times the
    /// noise of the mean of three channels.
    #[test]
    fn water_that_moves_is_evidence_and_a_still_place_is_none() {
        let [left, right] = without_evidence(2.0, |_, _, _| 0.0);
        assert!(left < 40 && right > 2_000, "{left} {right}");
        let [left, right] = without_evidence(0.0, |_, _, _| 0.0);
        assert!(left > 2_000 && right > 2_000, "{left} {right}");
    }

    /// By hand: the smallest break is 4 px wide. The break fits into a strip of 4 px, but not into a strip of 3 px;
    /// in a square of 4 px, it does not cover the corners.
    #[test]
    fn a_thin_strip_hides_no_break() {
        let window = Window { left: 0, top: 0, width: 40, height: 30 };
        let count = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
            let bytes: Vec<u8> =
                (0..1_200).map(|i| u8::from(columns.contains(&(i % 40)) && rows.contains(&(i / 40)))).collect();
            opened(&window, &bytes).expect("a mask").iter().filter(|open| **open).count()
        };
        assert_eq!((count(10..13, 0..30), count(10..14, 0..30), count(10..14, 5..9)), (0, 120, 12));
    }

    /// A place that dries by 4 levels, unevenly, and a shadow of 20 levels that passes within 3 s: neither of them
    /// is water.
    #[test]
    fn drying_and_a_passing_shadow_are_no_evidence() {
        let dries = |column: usize, row: usize, time_s: f64| 0.2 * time_s * ((column / 4 + row / 4) % 2) as f64;
        let [_, right] = without_evidence(0.0, dries);
        assert!(right > 2_000, "{right}");
        let shadow = |column: usize, _: usize, time_s: f64| {
            if (9.0..12.0).contains(&time_s) && (column as f64) < 21.0 * (time_s - 9.0) { -20.0 } else { 0.0 }
        };
        let [_, right] = without_evidence(0.0, shadow);
        assert!(right > 1_900, "{right}");
    }
}
