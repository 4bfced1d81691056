//! The thesis's pipeline for one picture (4.3, Fig. 4.9), by OpenCV, on the window around the region alone.
//!
//!     sub = |reference − test|                                                  in each channel      (4.1)
//!     g = α · sub + β, saturated to 0…255; then successive median blurs of g                          (4.2)
//!     changed where max over the channels of g ≥ threshold
//!     broken where changed, and H, S, V of the test picture are in the range of a dry pixel        (4.3–4.5)
//!
//! The thesis leaves open how the three channels become one binary picture. Here the largest counts: a film changes
//! the panel most in one channel (its blue one, 4.2), and the grey of the difference would dilute that one by the
//! others. The thesis masks the test picture and filters the masked one by HSV, where black means masked out; here the
//! two binary pictures meet in an "and", which is the same and lets the range contain black.
//!
//! H, S and V are OpenCV's 8-bit ones: H/2 in 0…179, S and V in 0…255, and a negative hue wraps by 360°.

use super::footprint::Window;
use crate::geometry::ColorPicture;
use crate::imaging::{ImagingError, named};
use crate::recipe;
use opencv::core::{self, CV_8U, Mat, MatTraitConst, MatTraitConstManual, Rect};
use opencv::imgproc;

/// How far beyond a window the medians look: a window wider by this gives the same pixels as the whole picture.
pub fn margin_px(settings: &recipe::Inspect) -> usize {
    settings.median_passes() * (settings.median_px() / 2)
}

/// The window's part of a picture, three channels.
pub fn crop(picture: &ColorPicture, window: &Window) -> Result<Mat, ImagingError> {
    named("the window", crop_of(picture, window))
}

fn crop_of(picture: &ColorPicture, window: &Window) -> opencv::Result<Mat> {
    // Bytes have a safe view and triples have none, hence columns of bytes until the copy.
    let bytes = picture.rgb.as_flattened();
    let whole = Mat::new_rows_cols_with_data(picture.height as i32, picture.width as i32 * 3, bytes)?;
    let [left, top, width, height] = [window.left, window.top, window.width, window.height].map(|n| n as i32);
    let part = Mat::roi(&whole, Rect::new(left * 3, top, width * 3, height))?;
    part.reshape_def(3)?.try_clone()
}

/// Which pixels of `test` differ from `reference`, row by row.
pub fn changed(settings: &recipe::Inspect, reference: &Mat, test: &Mat) -> Result<Vec<bool>, ImagingError> {
    let largest = named("the difference to the reference", adjusted_difference(settings, reference, test))?;
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
    Ok(channels.iter().map(|&[r, g, b]| r.max(g).max(b)).collect())
}

/// Which pixels have the colour of a dry panel, row by row.
pub fn looks_dry(settings: &recipe::Inspect, test: &Mat) -> Result<Vec<bool>, ImagingError> {
    let (low, high) = (settings.hsv_min(), settings.hsv_max());
    let in_range = |hsv: &[u8; 3]| (0..3).all(|i| (low[i]..=high[i]).contains(&usize::from(hsv[i])));
    Ok(named("hue, saturation and value", hue_saturation_value(test))?.iter().map(in_range).collect())
}

fn hue_saturation_value(test: &Mat) -> opencv::Result<Vec<[u8; 3]>> {
    let mut hsv = Mat::default();
    imgproc::cvt_color_def(test, &mut hsv, imgproc::COLOR_RGB2HSV)?; // Eq. 4.3–4.5
    let (pixels, _) = hsv.data_bytes()?.as_chunks::<3>();
    Ok(pixels.to_vec())
}
