//! The picture that people look on at: drawn, made small and encoded once for all who look.

use crate::daemon::live_view::{LiveFrame, LiveView};
use crate::files;
use crate::geometry::ColorPicture;
use std::sync::{Arc, Mutex, PoisonError};

/// The widest picture that is sent, px.
const WIDEST: usize = 960;

/// The newest picture as a JPEG.
pub(super) struct Frames {
    view: LiveView,
    last: Mutex<Option<(u64, Arc<Vec<u8>>)>>,
}

impl Frames {
    pub fn new(view: LiveView) -> Self {
        Frames { view, last: Mutex::new(None) }
    }

    /// The number of the newest picture and its name.
    pub fn newest(&self) -> (u64, Option<String>) {
        let (number, frame) = self.view.newest();
        (number, frame.map(|frame| frame.name.clone()))
    }

    /// The newest picture; `None` where there is none. It takes a few hundredths of a second, once for each picture.
    pub fn jpeg(&self) -> Option<Arc<Vec<u8>>> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let (number, frame) = self.view.newest();
        if let Some((kept, jpeg)) = last.as_ref()
            && *kept == number
        {
            return Some(jpeg.clone());
        }
        let jpeg = Arc::new(encoded(&*frame?)?);
        *last = Some((number, jpeg.clone()));
        Some(jpeg)
    }
}

fn encoded(frame: &LiveFrame) -> Option<Vec<u8>> {
    let drawn = frame.drawn().map(small);
    let jpeg = drawn.map_err(|error| error.to_string());
    match jpeg.and_then(|picture| files::write_color_jpeg(&picture).map_err(|error| error.to_string())) {
        Ok(jpeg) => Some(jpeg),
        Err(error) => {
            tracing::warn!("the picture {} cannot be shown: {error}", frame.name);
            None
        }
    }
}

/// The mean of blocks of pixels, so that it is no wider than a screen shows it.
fn small(picture: ColorPicture) -> ColorPicture {
    let block = picture.width.div_ceil(WIDEST).max(1);
    if block == 1 {
        return picture;
    }
    let (width, height) = (picture.width / block, picture.height / block);
    let mean = |column: usize, row: usize| {
        let mut sums = [0_usize; 3];
        for y in row * block..(row + 1) * block {
            for pixel in &picture.rgb[y * picture.width + column * block..][..block] {
                sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += usize::from(*value));
            }
        }
        sums.map(|sum| (sum / (block * block)) as u8)
    };
    let rgb = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    let rgb = rgb.map(|(column, row)| mean(column, row)).collect();
    ColorPicture { width, height, rgb }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: blocks of two by two of 0, 10, 20, 30 have the mean 15.
    #[test]
    fn a_large_picture_is_made_small_by_means() {
        let value = |column: usize, row: usize| [(10 * (column % 2) + 20 * (row % 2)) as u8; 3];
        let rgb = (0..4).flat_map(|row| (0..1_920).map(move |column| value(column, row))).collect();
        let made = small(ColorPicture { width: 1_920, height: 4, rgb });
        assert_eq!((made.width, made.height), (960, 2));
        assert!(made.rgb.iter().all(|pixel| *pixel == [15; 3]));
        let as_it_is = ColorPicture::filled(960, 1, [1, 2, 3]);
        assert_eq!(small(as_it_is.clone()).rgb, as_it_is.rgb);
    }
}
