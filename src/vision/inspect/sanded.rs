//! Finds evidence of a film at places that were sanded since the dry picture, and therefore have no dry reference.
//!
//! While the film is observed, a pixel there is compared with the brightness of its own film. A bare pixel also keeps
//! its brightness, so additional evidence is needed that the pixel was wet when the film began. This evidence is moving
//! water: the differences between sample points then vary over time by more than the noise of the sensor
//! ([`TemporalNoise`]). A sample point was wet if the nearby sample points of similar brightness have temporal noise.
//! They are searched in squares that grow until there are enough of them, and the nearest of them must show temporal
//! noise themselves. A bare place has another brightness than the film around it, and is static. If drops run over a
//! part of it, most of it is still static.
//!
//! Water that runs over a bare place moves as a film does. Therefore an area also has no evidence if it is narrower
//! than any disc and differs from its surroundings as a break differs from its film: its shape is that of a break and
//! not of a disc ([`BrightnessLevels::narrow_pixels`]).
//!
//! If a film does not move at all, its sanded places are treated as not seen. Remedy: record a new dry picture after
//! they have dried.

use super::footprint::Window;
use super::model::{DIFFERENCE_COUNT, Model, TemporalNoise};
use super::narrow_spots::BrightnessLevels;
use opencv::core::{self, Mat, MatTraitConstManual, Point, Scalar};
use opencv::imgproc;
use panelprep_base::geometry::{ALL_NEIGHBOURS, DIRECT_NEIGHBOURS, median};
use panelprep_cell::imaging::{ImagingError, with_operation};
use rayon::prelude::*;

/// Minimum temporal noise of a film: its variance relative to the variance of the sensor's noise.
const MIN_TEMPORAL_NOISE: f64 = 1.35;
/// Minimum excess of the temporal noise of a film over the value of noise alone, 1, in standard deviations.
const MIN_EXCESS_SIGMA: f64 = 4.5;
/// Minimum distance of the temporal noise of static points below `MIN_TEMPORAL_NOISE`, in standard deviations.
const MIN_STATIC_SIGMA: f64 = 3.0;
/// A sample point is static if its motion is significantly less than `MIN_FILM_MOTION_FRACTION` of the motion on a film
/// of the clip. If more than the fraction `MAX_STATIC_FRACTION` of the sample points of similar brightness are static,
/// there is no film. In rendered films, the fraction was at most 0.023 around 99 % of all sample points; on bare places
/// it was 0.31.
const MIN_FILM_MOTION_FRACTION: f64 = 0.2;
const MAX_STATIC_FRACTION: f64 = 0.05;
/// Fraction of the second differences, the largest ones, that is excluded, since they may show a passing shadow or
/// glint. `MIN_DIFFERENCES` is the minimum number of remaining differences, and `MIN_STATISTICS_POINT_COUNT` the
/// minimum number of sample points for a result.
const MAX_DISTURBED_FRACTION: f64 = 0.34;
const MIN_DIFFERENCES: usize = 3;
const MIN_STATISTICS_POINT_COUNT: f64 = 6.0;
/// Half sides of the squares in which sample points are searched, in steps of the lattice.
const SQUARE_RADII: [usize; 4] = [2, 4, 8, 16];
/// Number of radii, from the smallest, that contain only the nearest sample points.
const NEAREST_RADIUS_COUNT: usize = 2;
/// Minimum excess of the temporal noise in the first square that reaches the radius of the smallest disc, in standard
/// deviations. Sample points farther away confirm the result. Points of similar brightness that move elsewhere are no
/// evidence for a static point. The square has a fixed size on the panel, since a smaller pixel shows less motion.
const MIN_NEAR_EXCESS_SIGMA: f64 = 3.0;
/// Maximum difference between two similar brightness values, as a multiple of the noise of one pixel. A difference of
/// at most a quarter of the change by a break is also similar.
const MAX_SIMILARITY_SIGMA: f64 = 3.0;
/// The shape of the smallest break that is reliably detected, 12 px.
const MIN_BREAK_SHAPE: [[u8; 4]; 4] = [[0, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1], [0, 1, 1, 0]];

/// Maximum size of a bead of water on the smallest break, px: a quarter of the break. A larger enclosed area may be a
/// film with an edge around it.
const MAX_BEAD_PX: usize = 3;

/// The inputs for judging the sanded pixels.
pub struct SandedPixels<'a> {
    pub model: &'a Model,
    pub window: &'a Window,
    /// For each pixel of the window, whether the pixel is judged.
    pub inside: &'a [bool],
    /// For each pixel, the time at which it broke, s; infinite if it did not break.
    pub broke_s: &'a [f32],
    /// Minimum radius of a disc, px.
    pub disc_px: usize,
    /// Minimum size of a break that makes a grid fail, px.
    pub break_px: usize,
    /// Minimum and maximum brightness of a break, relative to the brightness of its film; `None` if the range is not
    /// known.
    pub break_to_film: Option<[f32; 2]>,
}

/// One sample point of the lattice.
#[derive(Debug, Clone, Copy)]
struct SamplePoint {
    /// Brightness of the film at this sample point, grey levels; 0 for a sample point that is not judged.
    look: f64,
    /// Standard deviation of the sample point's brightness in one picture, grey levels.
    noise: f64,
    /// z of the sample point for each second difference.
    shimmer: [f32; DIFFERENCE_COUNT],
}

impl SamplePoint {
    /// Returns the noise of a sample point relative to its brightness.
    fn relative_noise(&self) -> f64 {
        self.noise / self.look
    }
}

/// For each second difference, statistics of several sample points: their number, the sum of z and the sum of z².
#[derive(Debug, Clone, Copy, Default)]
struct SamplePointStatistics([[f64; 3]; DIFFERENCE_COUNT]);

impl SamplePointStatistics {
    fn add(&mut self, site: &SamplePoint) {
        for ([count, sum, squares], z) in self.0.iter_mut().zip(site.shimmer) {
            if !z.is_nan() {
                let z = f64::from(z);
                (*count, *sum, *squares) = (*count + 1.0, *sum + z, *squares + z * z);
            }
        }
    }

    /// Returns the ratio of the variance of these sample points to the variance of static points, and the standard
    /// deviation of this ratio for static points. The ratio is the mean over the smaller differences. The variance of n
    /// normal deviates has the relative standard deviation √(2/(n − 1)).
    fn relative_variance(&self) -> Option<(f64, f64)> {
        let seen = self.0.iter().filter(|[count, ..]| *count >= MIN_STATISTICS_POINT_COUNT);
        let mut shown: Vec<(f64, f64)> = seen
            .map(|[count, sum, squares]| ((squares - sum * sum / count) / (count - 1.0), count - 1.0))
            .collect();
        shown.sort_by(|a, b| a.0.total_cmp(&b.0));
        let passing = (MAX_DISTURBED_FRACTION * shown.len() as f64).ceil() as usize;
        let kept = Some(shown.len() - passing).filter(|kept| *kept >= MIN_DIFFERENCES)?;
        let (variance, degrees) = shown[..kept].iter().fold((0.0, 0.0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
        // Differences that share a span are not independent, so only a third of the degrees of freedom is used.
        Some((variance / kept as f64, (2.0 * 3.0 / degrees).sqrt()))
    }
}

impl SandedPixels<'_> {
    /// Returns the sanded pixels without evidence that they were wet.
    ///
    /// # Errors
    /// If OpenCV refuses the mask.
    pub fn pixels_without_evidence(&self) -> Result<Vec<bool>, ImagingError> {
        let Some(shimmer) = self.model.measured_temporal_noise() else { return Ok(vec![false; self.inside.len()]) };
        let reaches_disc = SQUARE_RADII.iter().position(|radius| radius * TemporalNoise::SIDE_PX >= self.disc_px);
        let lattice = SamplePointLattice {
            sites: self.lattice_sample_points(shimmer),
            shimmer,
            tolerance: self.model.away_threshold(),
            // Neither the smallest nor the largest square is used. At few pictures per second the smallest has too few
            // sample points to show water, and no larger square would confirm the result of the largest.
            near: reaches_disc
                .unwrap_or(SQUARE_RADII.len() - 1)
                .clamp(NEAREST_RADIUS_COUNT - 1, SQUARE_RADII.len() - 2),
        };
        let is_wet = lattice.wet_sample_points();
        // A pixel has evidence if a neighbouring wet sample point has a similar brightness, or if a neighbouring place
        // that was not sanded has the same film.
        let has_evidence = |i: usize| {
            let (row, column) = (i / self.window.width, i % self.window.width);
            let look = self.film_level(i);
            let is_like_wet_site = |at: usize| {
                let Some(site) = lattice.sites.get(at).filter(|site| site.look > 0.0) else { return false };
                is_wet[at] && (look - site.look).abs() <= lattice.tolerance * site.look
            };
            shimmer.nearby_sample_points(row, column).any(is_like_wet_site)
                || self.is_similar_to_nearby_film(row, column, look)
        };
        let tolerance = self.model.away_threshold() as f32;
        let looks =
            BrightnessLevels { window: self.window, levels: self.film_levels(), disc_px: self.disc_px, tolerance };
        let is_narrow =
            with_operation("the search for places narrower than a disc", looks.narrow_pixels(self.break_to_film))?;
        let is_narrow = self.with_beads(is_narrow);
        let is_without = |i: usize| {
            let is_whole = self.inside[i] && self.model.has_no_dry_brightness(i) && self.broke_s[i].is_infinite();
            is_whole && (is_narrow[i] || !has_evidence(i))
        };
        let without: Vec<bool> = (0..self.inside.len()).into_par_iter().map(is_without).collect();
        Ok(self.with_rims(self.wide_pixels_without_evidence(&without)?))
    }

    /// Adds to narrow areas the beads that they enclose.
    fn with_beads(&self, mut is_narrow: Vec<bool>) -> Vec<bool> {
        let raster = self.window.raster();
        let is_at_rim = |i: usize| raster.neighbours(i, &DIRECT_NEIGHBOURS).count() < DIRECT_NEIGHBOURS.len();
        for piece in raster.connected_components(&DIRECT_NEIGHBOURS, |i| !is_narrow[i]) {
            if piece.len() <= MAX_BEAD_PX && !piece.iter().any(|&i| is_at_rim(i)) {
                piece.iter().for_each(|&i| is_narrow[i] = true);
            }
        }
        is_narrow
    }

    /// Adds the rim to each area as large as a break: a pixel of the rim shows film as well, and may have the
    /// brightness of the film around it.
    fn with_rims(&self, mut without: Vec<bool>) -> Vec<bool> {
        let raster = self.window.raster();
        let is_whole =
            |i: usize| self.inside[i] && self.model.has_no_dry_brightness(i) && self.broke_s[i].is_infinite();
        for piece in raster
            .connected_components(&ALL_NEIGHBOURS, |i| without[i])
            .into_iter()
            .filter(|piece| piece.len() >= self.break_px)
        {
            let rim =
                piece.into_iter().flat_map(|i| raster.neighbours(i, &ALL_NEIGHBOURS)).filter(|&i| is_whole(i));
            rim.for_each(|i| without[i] = true);
        }
        without
    }

    /// Returns the pixels without evidence in areas that are wide enough for the smallest reliably detected break.
    /// Neighbouring pixels that are broken or outside of the region belong to the area. A thinner area cannot hide a
    /// break.
    fn wide_pixels_without_evidence(&self, without: &[bool]) -> Result<Vec<bool>, ImagingError> {
        let hides = |i: usize| without[i] || !self.inside[i] || self.broke_s[i].is_finite();
        let bytes: Vec<u8> = (0..without.len()).map(|i| u8::from(hides(i))).collect();
        let opened =
            with_operation("the opening of the mask of unseen places", morphological_opening(self.window, &bytes))?;
        Ok(without.iter().zip(opened).map(|(without, opened)| *without && opened).collect())
    }

    /// Returns whether a pixel is as bright as the film of nearby places that were not sanded, at most the side of a
    /// sample point away. The area that is treated as sanded is wider than the area that a disc touched. A bare strip
    /// would be as bright as the film beside it only by chance.
    fn is_similar_to_nearby_film(&self, row: usize, column: usize, look: f64) -> bool {
        let near = |at: usize, end: usize| {
            at.saturating_sub(TemporalNoise::SIDE_PX)..(at + TemporalNoise::SIDE_PX + 1).min(end)
        };
        let mut looks: Vec<f64> = near(row, self.window.height)
            .flat_map(|row| near(column, self.window.width).map(move |column| row * self.window.width + column))
            .filter(|&at| self.is_film_with_dry_brightness(at))
            .map(|at| self.film_level(at))
            .collect();
        let Some(film) = median(&mut looks).filter(|_| looks.len() >= TemporalNoise::SIDE_PX) else { return false };
        (look - film).abs()
            <= (self.model.away_threshold() / 2.0 * film).max(MAX_SIMILARITY_SIGMA * self.model.noise_levels())
    }

    fn is_film_with_dry_brightness(&self, i: usize) -> bool {
        let model = self.model;
        self.inside[i]
            && !model.has_no_dry_brightness(i)
            && model.ever_wet(i)
            && self.broke_s[i].is_infinite()
            && model.was_observed(i)
    }

    /// Returns the brightness of the film at a pixel, grey levels; if the pixel's brightness changed and it became film
    /// again, the brightness at the end.
    fn film_level(&self, i: usize) -> f64 {
        if self.model.is_open_now(i) {
            f64::from(self.model.levels(i)[0])
        } else {
            self.model.film_brightness_levels(i)
        }
    }

    /// Returns the brightness of each unbroken pixel with film, grey levels; 0 elsewhere.
    fn film_levels(&self) -> Vec<f32> {
        let holds = |i: usize| self.inside[i] && self.broke_s[i].is_infinite() && self.model.was_observed(i);
        (0..self.inside.len()).map(|i| if holds(i) { self.film_level(i) as f32 } else { 0.0 }).collect()
    }

    fn lattice_sample_points(&self, shimmer: &TemporalNoise) -> Vec<SamplePoint> {
        let none = SamplePoint { look: 0.0, noise: 0.0, shimmer: [f32::NAN; DIFFERENCE_COUNT] };
        let site = |at: usize| {
            let (top, left) = shimmer.sample_point_position(at);
            let rows = top..(top + TemporalNoise::SIDE_PX).min(self.window.height);
            let columns = left..(left + TemporalNoise::SIDE_PX).min(self.window.width);
            let pixels: Vec<usize> =
                rows.flat_map(|row| columns.clone().map(move |column| row * self.window.width + column)).collect();
            let counts = |i: &usize| {
                self.inside[*i] && self.model.has_no_dry_brightness(*i) && self.broke_s[*i].is_infinite()
            };
            let mut looks: Vec<f64> = pixels.iter().filter(|i| counts(i)).map(|i| self.film_level(*i)).collect();
            // If less than half of a sample point has a known brightness, its mean does not represent the whole sample
            // point.
            if looks.len() < TemporalNoise::SIDE_PX * TemporalNoise::SIDE_PX / 2 {
                return None;
            }
            let look = median(&mut looks)?;
            let variance = self.model.sample_point_variance(pixels[0], look)?;
            Some(SamplePoint {
                look,
                noise: variance.sqrt(),
                shimmer: shimmer.difference_statistics(at, variance.sqrt() / look.max(1.0)),
            })
        };
        (0..shimmer.len()).map(|at| site(at).unwrap_or(none)).collect()
    }
}

/// Returns the morphological opening of a mask by the shape of the smallest reliably detected break; pixels outside of
/// the window are treated as set.
fn morphological_opening(window: &Window, bytes: &[u8]) -> opencv::Result<Vec<bool>> {
    let mask = Mat::new_rows_cols_with_data(window.height as i32, window.width as i32, bytes)?;
    let kernel = Mat::from_slice_2d(&MIN_BREAK_SHAPE)?;
    let (border, kind) = (Scalar::all(1.0), core::BORDER_CONSTANT);
    let (mut eroded, mut opened) = (Mat::default(), Mat::default());
    // A kernel with an even side has no centre: the dilation must use the anchor opposite to the anchor of the erosion.
    imgproc::erode(&mask, &mut eroded, &kernel, Point::new(1, 1), 1, kind, border)?;
    imgproc::dilate(&eroded, &mut opened, &kernel, Point::new(2, 2), 1, kind, Scalar::all(0.0))?;
    Ok(opened.data_bytes()?.iter().map(|&byte| byte > 0).collect())
}

/// The sample points of the window, with the parameters of the search.
struct SamplePointLattice<'a> {
    sites: Vec<SamplePoint>,
    shimmer: &'a TemporalNoise,
    /// Half of the change that a break causes in a film, as a fraction of the film brightness.
    tolerance: f64,
    /// Index in [`SQUARE_RADII`] of the square that must show motion itself.
    near: usize,
}

impl SamplePointLattice<'_> {
    /// Returns for each sample point whether it was wet.
    fn wet_sample_points(&self) -> Vec<bool> {
        let sites = 0..self.sites.len();
        let water: Vec<Option<f64>> = sites.clone().into_par_iter().map(|at| self.water_variance(at)).collect();
        let mut known: Vec<f64> = water.iter().flatten().copied().collect();
        let Some(film) = median(&mut known) else { return vec![false; water.len()] };
        let is_still: Vec<bool> =
            sites.clone().into_par_iter().map(|at| self.is_sample_point_static(at, film)).collect();
        // Drops that run over a bare place move as well, but only on a part of the place: the rest is static and of
        // similar brightness.
        let is_wet = |at: usize| {
            water[at].is_some()
                && !is_still[at]
                && self.static_neighbour_fraction(at, &is_still) <= MAX_STATIC_FRACTION
        };
        sites.into_par_iter().map(is_wet).collect()
    }

    /// Returns the strength of the water's motion at a sample point: the part of the variance of its brightness that
    /// exceeds the noise, relative to the squared brightness; `None` without evidence.
    fn water_variance(&self, at: usize) -> Option<f64> {
        let site = &self.sites[at];
        if site.look <= 0.0 {
            return None;
        }
        for (nth, radius) in SQUARE_RADII.into_iter().enumerate() {
            let (ratio, deviation) = self.similar_neighbour_statistics(at, radius).relative_variance()?;
            if ratio >= MIN_TEMPORAL_NOISE.max(1.0 + MIN_EXCESS_SIGMA * deviation) {
                return Some((ratio - 1.0) * site.relative_noise().powi(2));
            }
            // If the nearest sample points are significantly static, motion farther away is not used.
            if nth < NEAREST_RADIUS_COUNT && ratio + MIN_STATIC_SIGMA * deviation < MIN_TEMPORAL_NOISE {
                return None;
            }
            if nth == self.near && ratio < 1.0 + MIN_NEAR_EXCESS_SIGMA * deviation {
                return None;
            }
        }
        None
    }

    /// Checks with the nearest sample points whether a sample point moves significantly less than a film of this clip.
    fn is_sample_point_static(&self, at: usize, film: f64) -> bool {
        let site = &self.sites[at];
        if site.look <= 0.0 {
            return false;
        }
        let least = 1.0 + MIN_FILM_MOTION_FRACTION * film / site.relative_noise().powi(2);
        SQUARE_RADII[..NEAREST_RADIUS_COUNT].iter().all(|radius| {
            let shown = self.similar_neighbour_statistics(at, *radius).relative_variance();
            shown.is_some_and(|(ratio, deviation)| ratio + MIN_STATIC_SIGMA * deviation < least)
        })
    }

    /// Returns the fraction of static points among the nearby sample points of similar brightness.
    fn static_neighbour_fraction(&self, at: usize, is_still: &[bool]) -> f64 {
        let (mut still, mut all) = (0, 0);
        self.for_similar_neighbours(at, SQUARE_RADII[SQUARE_RADII.len() - 1], |near| {
            all += 1;
            still += usize::from(is_still[near]);
        });
        still as f64 / all.max(1) as f64
    }

    /// Returns the combined statistics of the nearby sample points of similar brightness.
    fn similar_neighbour_statistics(&self, at: usize, radius: usize) -> SamplePointStatistics {
        let mut shown = SamplePointStatistics::default();
        self.for_similar_neighbours(at, radius, |near| shown.add(&self.sites[near]));
        shown
    }

    /// Calls `takes` for each sample point of similar brightness within a square around this one.
    fn for_similar_neighbours(&self, at: usize, radius: usize, mut takes: impl FnMut(usize)) {
        let own = &self.sites[at];
        let alike = (self.tolerance / 2.0 * own.look).max(MAX_SIMILARITY_SIGMA * own.noise);
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
    use super::super::model::FilmParameters;
    use super::*;
    use panelprep_base::geometry::ColorPicture;

    const SIDE: usize = 128;
    /// The window lies in the middle of the picture, which shows the noise of the sensor around it.
    const WINDOW: Window = Window { left: 32, top: 32, width: 64, height: 64 };

    /// Returns a normal deviate with standard deviation 1, from the sum of four bytes that the picture number and the
    /// pixel determine.
    fn noise(picture: usize, index: usize) -> f64 {
        let mixed = (picture as u64 * 0x9E37_79B9 + index as u64).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 31)).wrapping_mul(0x94D0_49BB_1331_11EB);
        let bytes = (mixed ^ (mixed >> 29)).to_le_bytes();
        // A byte has the variance (256² − 1)/12 = 5461; the sum of four bytes has 148².
        (bytes[..4].iter().map(|byte| f64::from(*byte)).sum::<f64>() - 510.0) / 147.8
    }

    /// Returns the pixels without evidence, after the whole window was sanded. `shown` gives each pixel its level and
    /// the amplitude of the moving water on it, which varies from place to place and from second to second. `also` adds
    /// levels to a pixel of the window in a picture.
    fn found(shown: impl Fn(usize, usize) -> (f64, f64), also: impl Fn(usize, usize, f64) -> f64) -> Vec<bool> {
        let terms = FilmParameters { channel_weights: [1.0; 3], persist_s: 0.6, damp: 0.8 };
        let inside = [true; 64 * 64];
        let mut model = Model::new(WINDOW, &inside, &inside, terms);
        let shot = |number: usize, time_s: f64| {
            let level = |index: usize| {
                let (column, row) = (index % SIDE, index / SIDE);
                let on_panel = [column, row].iter().all(|at| (32..96).contains(at));
                let (level, film) = if on_panel { shown(column - 32, row - 32) } else { (70.0, 0.0) };
                let water = film * noise(900 + (time_s / 2.0) as usize, index / 2);
                let own = if on_panel { water + also(column - 32, row - 32, time_s) } else { 0.0 };
                [0, 1, 2].map(|channel| (level + own + 1.2 * noise(number, 3 * index + channel)).round() as u8)
            };
            ColorPicture { width: SIDE, height: SIDE, rgb: (0..SIDE * SIDE).map(level).collect() }
        };
        model.add_dry(&shot(0, -2.0));
        for number in 1..=100 {
            let time_s = 0.2 * number as f64 - 0.2;
            let picture = shot(number, time_s);
            model.measure_wet(&picture);
            model.judge_last(&picture, time_s);
        }
        model.end();
        let broke_s = vec![f32::INFINITY; 64 * 64];
        let sanded = SandedPixels {
            model: &model,
            window: &WINDOW,
            inside: &inside,
            broke_s: &broke_s,
            disc_px: 12,
            break_px: 12,
            break_to_film: Some([1.25, 2.0]),
        };
        sanded.pixels_without_evidence().expect("a mask")
    }

    /// Returns the number of pixels without evidence in the left and in the right half of the window. Water of ±`film`
    /// levels moves on the left half. The right half is as bright as a break in that film and shows only the noise of
    /// the sensor.
    fn pixels_without_evidence(film: f64, also: impl Fn(usize, usize, f64) -> f64) -> [usize; 2] {
        let found = found(|column, _| if column < 32 { (70.0, film) } else { (100.0, 0.0) }, also);
        let (left, right): (Vec<usize>, Vec<usize>) =
            (0..64 * 64).filter(|i| found[*i]).partition(|i| *i % 64 < 32);
        [left.len(), right.len()]
    }

    /// Returns the number of pixels without evidence if `place` gives the level and the water amplitude of some pixels,
    /// and all others show a film of 70 ± 2 levels.
    fn without_evidence_of(place: impl Fn(usize, usize) -> Option<(f64, f64)>) -> usize {
        let found = found(|column, row| place(column, row).unwrap_or((70.0, 2.0)), |_, _, _| 0.0);
        found.iter().filter(|found| **found).count()
    }

    /// Returns whether a pixel lies in the square with this range of rows and columns.
    fn is_square(column: usize, row: usize, at: std::ops::Range<usize>) -> bool {
        at.contains(&column) && at.contains(&row)
    }

    /// Expected values, calculated by hand: a static square of 12 px has 9 sample points. Its temporal noise, 1 ±
    /// √(6/112) = 1 ± 0.23, is not significantly below the limit 1.35, nor significantly below that of the film. More
    /// than 100 moving sample points of similar brightness are 16 px away and are not used as evidence for the square.
    /// The square is 1.17 times as bright as its film, so it is not a narrow area. It differs from the film by more
    /// than half of the change by a break, 0.145.
    #[test]
    fn distant_water_is_no_evidence_for_a_static_place() {
        const WATER: f64 = 0.67;
        let without = |moves: f64| {
            let shown = |column: usize, row: usize| match () {
                () if is_square(column, row, 24..36) => (82.0, moves),
                () if is_square(column, row, 8..52) => (70.0, WATER),
                () => (82.0, WATER),
            };
            found(shown, |_, _, _| 0.0).iter().filter(|found| **found).count()
        };
        let [still, moving] = [0.0, WATER].map(without);
        assert!((130..260).contains(&still) && moving < 50, "{still} {moving}");
    }

    /// Expected values, calculated by hand: a static square of 5 × 5 px has a bead of film in its middle, so no part of
    /// it is wide enough for the smallest break. The bead is treated as part of the square. All pixels of the square
    /// except its four corners are returned, with a rim of 20 px: 25 − 4 + 20.
    #[test]
    fn a_narrow_area_with_a_bead_has_no_evidence() {
        let found = without_evidence_of(|column, row| {
            let is_bead = (column, row) == (32, 32);
            (is_square(column, row, 30..35) && !is_bead).then_some((100.0, 0.0))
        });
        assert!((25..=49).contains(&found), "{found}");
    }

    /// Expected values, calculated by hand: a static square of 8 × 8 px has a rim of 36 px, with nearly the brightness
    /// and the motion of the film. The smallest break does not reach into the corners of the square, so the corners of
    /// the rim are not returned.
    #[test]
    fn the_rim_of_a_static_area_belongs_to_it() {
        let found = without_evidence_of(|column, row| match () {
            () if is_square(column, row, 28..36) => Some((100.0, 0.0)),
            () if is_square(column, row, 27..37) => Some((75.0, 2.0)),
            () => None,
        });
        assert_eq!(found, 96);
    }

    /// Expected values, calculated by hand: each half has 2,048 px. Water of 2 levels is 1.7 times the noise of one
    /// channel, and 2.9 times the noise of the mean of three channels. The static half has a rim of 64 px on the other
    /// half.
    #[test]
    fn moving_water_is_evidence_and_a_static_place_is_not() {
        let [left, right] = pixels_without_evidence(2.0, |_, _, _| 0.0);
        assert!(left < 64 + 40 && right > 2_000, "{left} {right}");
        let [left, right] = pixels_without_evidence(0.0, |_, _, _| 0.0);
        assert!(left > 2_000 && right > 2_000, "{left} {right}");
    }

    /// Expected values, calculated by hand: the smallest break is 4 px wide. The break fits into a strip of 4 px, but
    /// not into a strip of 3 px; in a square of 4 px, it does not cover the corners.
    #[test]
    fn a_thin_strip_hides_no_break() {
        let window = Window { left: 0, top: 0, width: 40, height: 30 };
        let count = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
            let bytes: Vec<u8> =
                (0..1_200).map(|i| u8::from(columns.contains(&(i % 40)) && rows.contains(&(i / 40)))).collect();
            morphological_opening(&window, &bytes).expect("a mask").iter().filter(|open| **open).count()
        };
        assert_eq!((count(10..13, 0..30), count(10..14, 0..30), count(10..14, 5..9)), (0, 120, 12));
    }

    /// Neither a place that dries by 4 levels, at different speeds in its parts, nor a shadow of 20 levels that passes
    /// within 3 s is evidence of water.
    #[test]
    fn drying_and_a_passing_shadow_are_no_evidence() {
        let dries = |column: usize, row: usize, time_s: f64| 0.2 * time_s * ((column / 4 + row / 4) % 2) as f64;
        let [_, right] = pixels_without_evidence(0.0, dries);
        assert!(right > 2_000, "{right}");
        let shadow = |column: usize, _: usize, time_s: f64| {
            if (9.0..12.0).contains(&time_s) && (column as f64) < 21.0 * (time_s - 9.0) { -20.0 } else { 0.0 }
        };
        let [_, right] = pixels_without_evidence(0.0, shadow);
        assert!(right > 1_900, "{right}");
    }
}
