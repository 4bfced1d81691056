//! The thesis's pipeline for one picture (4.3, Fig. 4.9), with OpenCV, on the window around the region; and its
//! evaluation over time.
//!
//!     sub = |reference − test|                                                  in each channel      (4.1)
//!     g = α · sub + β, saturated to 0…255; then successive median blurs of g                          (4.2)
//!     changed if max over the channels of g ≥ threshold
//!     broken if changed, and H, S, V of the test picture are in the range of a dry pixel           (4.3–4.5)
//!
//! The thesis does not state how the three channels become one binary picture. Here the difference of each channel is
//! multiplied by its weight, with a maximum weight of 1 (`channel_weights`), and the largest product is used. The
//! reason: a film changes the panel most in one channel (blue, 4.2), and a grey value of the difference would dilute
//! this channel by the others. The thesis masks the test picture and filters the masked picture by HSV; black means
//! masked. Here the two binary pictures are combined by a logical AND, which has the same result and permits black in
//! the range.
//!
//! H, S and V are OpenCV's 8-bit values: H/2 in 0…179, S and V in 0…255; 360° are added to a negative hue.
//!
//! Over time a pixel is broken from the first of `persist_frames` consecutive pictures that show it as broken. It stays
//! broken: water that runs over the place afterwards does not clean it. A flash in fewer consecutive pictures is not a
//! break.

use super::error::InspectError;
use super::footprint::{Footprint, Window};
use opencv::core::{CV_8U, Mat, MatTraitConst, MatTraitConstManual, Rect};
use opencv::{core, imgproc};
use panelprep_base::geometry::ColorPicture;
use panelprep_cell::imaging::{ImagingError, with_operation};
use panelprep_cell::recipe;
use std::collections::VecDeque;

/// Returns the distance over which the median filters use pixels beyond a window: a window with this margin gives the
/// same pixels as the whole picture.
pub fn margin_px(settings: &recipe::Inspect) -> usize {
    settings.median_passes() * (settings.median_px() / 2)
}

/// Returns the part of a picture within a window, with three channels.
pub fn crop(picture: &ColorPicture, window: &Window) -> Result<Mat, ImagingError> {
    with_operation("the window", crop_to_window(picture, window))
}

fn crop_to_window(picture: &ColorPicture, window: &Window) -> opencv::Result<Mat> {
    // OpenCV offers a safe view of bytes but not of triples. Therefore the matrix has single bytes as columns until it
    // is copied.
    let bytes = picture.rgb.as_flattened();
    let whole = Mat::new_rows_cols_with_data(picture.height as i32, picture.width as i32 * 3, bytes)?;
    let [left, top, width, height] = [window.left, window.top, window.width, window.height].map(|n| n as i32);
    let part = Mat::roi(&whole, Rect::new(left * 3, top, width * 3, height))?;
    part.reshape_def(3)?.try_clone()
}

/// Returns the adjusted difference of two pictures, row by row: the value that is compared with the threshold.
pub fn levels(
    settings: &recipe::Inspect,
    reference: &ColorPicture,
    test: &ColorPicture,
) -> Result<Vec<u8>, ImagingError> {
    let whole = Window { left: 0, top: 0, width: test.width, height: test.height };
    let (reference, test) = (crop(reference, &whole)?, crop(test, &whole)?);
    with_operation("the difference from the reference", adjusted_difference(settings, &reference, &test))
}

/// Returns hue, saturation and value of each pixel of a picture.
pub fn to_hsv(picture: &ColorPicture) -> Result<Vec<[u8; 3]>, ImagingError> {
    let whole = Window { left: 0, top: 0, width: picture.width, height: picture.height };
    with_operation("hue, saturation and value", hue_saturation_value(&crop(picture, &whole)?))
}

/// Returns the pixels of `test` that differ from `reference`, row by row.
pub fn changed(settings: &recipe::Inspect, reference: &Mat, test: &Mat) -> Result<Vec<bool>, ImagingError> {
    let largest =
        with_operation("the difference from the reference", adjusted_difference(settings, reference, test))?;
    let threshold = settings.threshold();
    Ok(largest.into_iter().map(|difference| usize::from(difference) >= threshold).collect())
}

fn adjusted_difference(settings: &recipe::Inspect, reference: &Mat, test: &Mat) -> opencv::Result<Vec<u8>> {
    let (mut difference, mut adjusted, mut blurred) = (Mat::default(), Mat::default(), Mat::default());
    core::absdiff(reference, test, &mut difference)?; // Eq. 4.1
    difference.convert_to(&mut adjusted, CV_8U, settings.gain(), settings.bias())?; // Eq. 4.2
    for _ in 0..settings.median_passes() {
        imgproc::median_blur(&adjusted, &mut blurred, settings.median_px() as i32)?;
        std::mem::swap(&mut adjusted, &mut blurred);
    }
    let (channels, _) = adjusted.data_bytes()?.as_chunks::<3>();
    let weights = settings.channel_weights();
    let heaviest = weights.iter().copied().fold(0.0, f64::max);
    let weighed = |channels: &[u8; 3]| {
        let weighed = (0..3).map(|i| (f64::from(channels[i]) * weights[i] / heaviest).round() as u8);
        weighed.max().unwrap_or_default()
    };
    // Equal weights need no arithmetic.
    if weights.iter().all(|weight| *weight == heaviest) {
        return Ok(channels.iter().map(|&[r, g, b]| r.max(g).max(b)).collect());
    }
    Ok(channels.iter().map(weighed).collect())
}

/// Returns the pixels that have the colour of a dry panel, row by row.
pub fn dry_coloured_pixels(settings: &recipe::Inspect, test: &Mat) -> Result<Vec<bool>, ImagingError> {
    let (low, high) = (settings.hsv_min(), settings.hsv_max());
    let in_range = |hsv: &[u8; 3]| (0..3).all(|i| (low[i]..=high[i]).contains(&usize::from(hsv[i])));
    Ok(with_operation("hue, saturation and value", hue_saturation_value(test))?.iter().map(in_range).collect())
}

fn hue_saturation_value(test: &Mat) -> opencv::Result<Vec<[u8; 3]>> {
    let mut hsv = Mat::default();
    imgproc::cvt_color_def(test, &mut hsv, imgproc::COLOR_RGB2HSV)?; // Eq. 4.3–4.5
    let (pixels, _) = hsv.data_bytes()?.as_chunks::<3>();
    Ok(pixels.to_vec())
}

/// The thesis's pipeline over time.
#[derive(Debug)]
pub struct ThesisPipeline {
    film: Film,
    dry: Option<Mat>,
    reference: Option<Mat>,
}

impl ThesisPipeline {
    pub fn new(pixels: usize, settings: &recipe::Inspect) -> Self {
        ThesisPipeline { film: Film::new(pixels, settings.persist_frames()), dry: None, reference: None }
    }

    /// Sets the picture of the dry panel; of several pictures the last one is used.
    pub fn set_dry(&mut self, picture: &ColorPicture, window: &Window) -> Result<(), InspectError> {
        self.dry = Some(crop(picture, window)?);
        Ok(())
    }

    /// Returns the time at which each pixel of the window broke, s.
    pub fn times_s(&self) -> &[f32] {
        self.film.times()
    }

    /// Evaluates a wet picture. Returns the pixels that broke in it and the time at which they broke.
    pub fn process_wet(
        &mut self,
        picture: &ColorPicture,
        since_wet_s: f64,
        settings: &recipe::Inspect,
        footprint: &Footprint,
    ) -> Result<(Vec<usize>, f64), InspectError> {
        let test = crop(picture, footprint.window())?;
        let inside = footprint.region_pixels();
        let looks_dry = dry_coloured_pixels(settings, &test)?;
        let Some(reference) = &self.reference else {
            // Pixels that still appear dry in the first fully wet picture are treated as broken at 0 s.
            let mut never_wet = Vec::new();
            if let Some(dry) = self.dry.take() {
                let wetted = changed(settings, &dry, &test)?;
                never_wet = (0..inside.len()).filter(|&i| inside[i] && !wetted[i] && looks_dry[i]).collect();
                self.film.mark_broken(&never_wet, 0.0);
            }
            self.reference = Some(test);
            return Ok((never_wet, 0.0));
        };
        let changed = changed(settings, reference, &test)?;
        let broken = (0..inside.len()).map(|i| inside[i] && changed[i] && looks_dry[i]);
        let newly = self.film.push(broken, since_wet_s);
        Ok((newly.pixels, newly.since_wet_s))
    }
}

/// The time of a pixel at which the film did not break.
pub const NOT_BROKEN: f32 = f32::INFINITY;

/// The state of the film in one window, updated with each picture.
#[derive(Debug)]
pub struct Film {
    persist_frames: usize,
    /// For each pixel, the number of consecutive pictures that showed it as broken.
    run: Vec<u8>,
    since_wet_s: Vec<f32>,
    /// Times of the last `persist_frames` pictures, the oldest first.
    recent_s: VecDeque<f64>,
}

/// Pixels that have been broken for the required number of pictures since this picture.
#[derive(Debug, PartialEq)]
pub struct NewBreaks {
    /// Time of the break, s: the time of the first of the consecutive pictures.
    pub since_wet_s: f64,
    /// The indices of the pixels in the window.
    pub pixels: Vec<usize>,
}

impl Film {
    pub fn new(pixels: usize, persist_frames: usize) -> Self {
        Film {
            persist_frames,
            run: vec![0; pixels],
            since_wet_s: vec![NOT_BROKEN; pixels],
            recent_s: VecDeque::new(),
        }
    }

    /// Adds the broken pixels of the next picture.
    pub fn push(&mut self, broken: impl Iterator<Item = bool>, since_wet_s: f64) -> NewBreaks {
        if self.recent_s.len() == self.persist_frames {
            self.recent_s.pop_front();
        }
        self.recent_s.push_back(since_wet_s);
        let began_s = self.recent_s.front().copied().unwrap_or(since_wet_s);
        let mut pixels = Vec::new();
        for (index, broken) in broken.enumerate() {
            self.run[index] = if broken { self.run[index].saturating_add(1) } else { 0 };
            if usize::from(self.run[index]) >= self.persist_frames && self.since_wet_s[index] == NOT_BROKEN {
                pixels.push(index);
            }
        }
        self.mark_broken(&pixels, began_s);
        NewBreaks { since_wet_s: began_s, pixels }
    }

    /// Marks pixels as broken since this time.
    pub fn mark_broken(&mut self, pixels: &[usize], since_wet_s: f64) {
        for &index in pixels {
            self.since_wet_s[index] = since_wet_s as f32;
        }
    }

    /// Returns the time at which each pixel broke, s; [`NOT_BROKEN`] if its film did not break.
    pub fn times(&self) -> &[f32] {
        &self.since_wet_s
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{inspect_table, pseudo_random};
    use super::*;

    const WHOLE: Window = Window { left: 0, top: 0, width: 8, height: 8 };

    /// Expected values, calculated by hand: blue differs by 30 in a block of 4 × 4 px, so g = 2·30 − 20 = 40 there; one
    /// more pixel is white. A median of 3 × 3 removes the single pixel and the four corners of the block, around which
    /// only 4 of 9 pixels are set.
    #[test]
    fn the_difference_of_two_pictures_equals_the_hand_calculation() {
        let reference = ColorPicture::uniform(8, 8, [100, 100, 100]);
        let mut test = reference.clone();
        for index in (0..64).filter(|i| (2..6).contains(&(i % 8)) && (2..6).contains(&(i / 8))) {
            test.rgb[index] = [100, 100, 130];
        }
        test.rgb[7] = [255; 3];
        let [reference, test] = [&reference, &test].map(|picture| crop(picture, &WHOLE).expect("a picture"));
        let found = |threshold: usize| {
            let table = format!("gain = 2\nbias = -20\nmedian_px = 3\nmedian_passes = 1\nthreshold = {threshold}");
            let changed = changed(&inspect_table(&table), &reference, &test).expect("one size");
            (0..64).filter(|&i| changed[i]).collect::<Vec<usize>>()
        };
        assert_eq!(found(40), [19, 20, 26, 27, 28, 29, 34, 35, 36, 37, 43, 44]);
        assert_eq!(found(41), [0usize; 0]);
    }

    /// Expected value, calculated by hand: red differs by 40, blue by 30; with a weight of 0.25 for red the difference
    /// is max(10, 30) · 2 = 60.
    #[test]
    fn each_channel_is_multiplied_by_its_weight() {
        let reference = ColorPicture::uniform(8, 8, [100, 100, 100]);
        let test = ColorPicture::uniform(8, 8, [140, 100, 130]);
        let [reference, test] = [&reference, &test].map(|picture| crop(picture, &WHOLE).expect("a picture"));
        let found = |weights: &str, threshold: usize| {
            let table = format!("gain = 2\nmedian_px = 3\nthreshold = {threshold}\nchannel_weights = {weights}");
            changed(&inspect_table(&table), &reference, &test).expect("one size")[0]
        };
        assert!(found("[1, 1, 1]", 80) && !found("[0.25, 1, 1]", 61) && found("[0.25, 1, 1]", 60));
        assert!(found("[0.1, 0.1, 0.1]", 80), "weights count against the heaviest");
    }

    /// Expected values, calculated by hand with Eq. 4.3–4.5 in 8 bits: green has 120°/2 = 60. (255, 0, 128) has 60·(0 −
    /// 128)/255 = −30.1°, which wraps to 329.9°, half of which is 165. (100, 50, 50) has the saturation 255·50/100 =
    /// 127.5 and the value 100.
    #[test]
    fn colours_become_hue_saturation_value() {
        let rgb = vec![[0, 255, 0], [255, 0, 128], [100, 50, 50], [0, 0, 0]];
        let picture = ColorPicture { width: 4, height: 1, rgb };
        let window = Window { left: 0, top: 0, width: 4, height: 1 };
        let hsv = hue_saturation_value(&crop(&picture, &window).expect("a picture")).expect("three channels");
        assert_eq!(hsv, [[60, 255, 255], [165, 255, 255], [0, 128, 100], [0, 0, 0]]);
    }

    #[test]
    fn a_window_with_its_margin_gives_the_pixels_of_the_whole_picture() {
        let settings = inspect_table("median_px = 5\nmedian_passes = 2\ngain = 2\nthreshold = 170");
        let whole = Window { left: 0, top: 0, width: 40, height: 30 };
        let [reference, test] = [1, 2].map(|seed| pseudo_random(40, 30, seed));
        let changed_in = |window: &Window| {
            let [reference, test] = [&reference, &test].map(|picture| crop(picture, window).expect("inside"));
            changed(&settings, &reference, &test).expect("one size")
        };
        let expected = changed_in(&whole);
        let margin = margin_px(&settings);
        let part = Window { left: 10 - margin, top: 8 - margin, width: 15 + 2 * margin, height: 9 + 2 * margin };
        let found = changed_in(&part);
        let (mut same, mut changed) = (0, 0);
        for (row, column) in (8..17).flat_map(|row| (10..25).map(move |column| (row, column))) {
            let index = (row - part.top) * part.width + column - part.left;
            same += usize::from(found[index] == expected[row * 40 + column]);
            changed += usize::from(found[index]);
        }
        assert_eq!(same, 9 * 15);
        assert!((20..115).contains(&changed), "noise is cut in two: {changed}");
    }

    /// Three consecutive pictures are required. Expected results: pixel 0 breaks at 2 s and stays broken, pixel 1
    /// flashes for two pictures, pixel 2 flashes first and breaks at 3 s.
    #[test]
    fn a_break_begins_at_the_first_of_three_consecutive_pictures() {
        let mut film = Film::new(3, 3);
        let pictures = [
            [false, false, true],
            [false, true, false],
            [true, true, false],
            [true, false, true],
            [true, false, true],
            [true, false, true],
            [false, false, true],
        ];
        let found: Vec<NewBreaks> = pictures
            .iter()
            .enumerate()
            .map(|(i, picture)| film.push(picture.iter().copied(), i as f64))
            .filter(|newly| !newly.pixels.is_empty())
            .collect();
        let expected =
            [NewBreaks { since_wet_s: 2.0, pixels: vec![0] }, NewBreaks { since_wet_s: 3.0, pixels: vec![2] }];
        assert_eq!(found, expected);
        assert_eq!(film.times(), [2.0, NOT_BROKEN, 3.0]);
    }
}
