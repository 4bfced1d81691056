//! Converts the drawn breaks to pixels: which pixels broke before the end of the clip, and when.
//!
//! A pixel breaks at the first evaluated time at which its centre lies inside an open break. The evaluated times are
//! the start times of the shapes and the times of the wet pictures: there is no observation between two pictures.
//!
//! `times.png` encodes the time of a break as a colour. A pixel that broke has blue 255, and red · 256 + green is the
//! time in hundredths of a second since the first fully wet picture. All other pixels are black.

use super::check::ClipFrame;
use super::statement::Break;
use panelprep_base::geometry::{ColorPicture, Mask, Pixel, polygon};

/// The time at which each pixel broke, if it broke.
#[derive(Debug, Clone, PartialEq)]
pub struct BrokenPixels {
    /// Width of the pictures, px.
    pub width: usize,
    /// Height of the pictures, px.
    pub height: usize,
    /// The time at which each pixel broke, s since the first wet picture; infinite if the pixel did not break.
    pub since_wet_s: Vec<f64>,
}

/// Returns the pixels that broke before the end of the clip. The breaks must have no [`problems`](super::problems).
pub fn broken_pixels(breaks: &[Break], frame: &ClipFrame) -> BrokenPixels {
    let [width, height] = frame.size_px;
    let mut broken = BrokenPixels { width, height, since_wet_s: vec![f64::INFINITY; width * height] };
    for one in breaks {
        let mut drawn: Vec<Pixel> = Vec::new();
        for time_s in moments_s(one, frame) {
            let corners = one.corners_at(time_s);
            if corners != drawn {
                broken.mark_polygon(&corners, time_s - frame.wet_from_s());
                drawn = corners;
            }
        }
    }
    broken
}

/// Returns the times at which a break is evaluated, in order, s of the clip.
fn moments_s(one: &Break, frame: &ClipFrame) -> Vec<f64> {
    let begins = one.shapes.iter().map(|shape| shape.from_s);
    let mut moments_s: Vec<f64> =
        begins.chain(frame.wet_times_s.iter().copied()).filter(|&time_s| one.is_open_at(time_s)).collect();
    moments_s.sort_by(f64::total_cmp);
    moments_s
}

impl BrokenPixels {
    /// Marks the pixels of a polygon as broken at this time, unless they broke earlier.
    fn mark_polygon(&mut self, corners: &[Pixel], since_wet_s: f64) {
        let range = |of: fn(&Pixel) -> f64, count: usize| {
            let low = corners.iter().map(of).fold(f64::INFINITY, f64::min).ceil().max(0.0) as usize;
            let high = corners.iter().map(of).fold(f64::NEG_INFINITY, f64::max).floor() + 1.0;
            low..(high.max(0.0) as usize).min(count)
        };
        let columns = range(|corner| corner.u, self.width);
        for row in range(|corner| corner.v, self.height) {
            for column in columns.clone() {
                if polygon::contains(corners, Pixel::at(column as f64, row as f64)) {
                    let time_s = &mut self.since_wet_s[row * self.width + column];
                    *time_s = time_s.min(since_wet_s);
                }
            }
        }
    }

    /// Returns a mask of the pixels that broke.
    pub fn mask(&self) -> Mask {
        let inside = self.since_wet_s.iter().map(|time_s| time_s.is_finite()).collect();
        Mask { width: self.width, height: self.height, inside }
    }

    /// Returns a picture with the time at which each pixel broke, encoded by [`time_to_color`].
    pub fn times(&self) -> ColorPicture {
        let rgb =
            self.since_wet_s.iter().map(|&time_s| time_to_color(time_s.is_finite().then_some(time_s))).collect();
        ColorPicture { width: self.width, height: self.height, rgb }
    }
}

/// Encodes the time of a break as a colour.
pub fn time_to_color(since_wet_s: Option<f64>) -> [u8; 3] {
    since_wet_s.map_or([0; 3], |since_wet_s| {
        let [red, green] = ((since_wet_s * 100.0).round().clamp(0.0, 65_535.0) as u16).to_be_bytes();
        [red, green, 255]
    })
}

/// Returns the time that a colour encodes; `None` for a pixel that did not break.
pub fn color_to_time([red, green, blue]: [u8; 3]) -> Option<f64> {
    (blue == 255).then(|| f64::from(u16::from_be_bytes([red, green])) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_back_from_their_colours() {
        for time_s in [None, Some(0.0), Some(0.25), Some(59.99), Some(600.0)] {
            assert_eq!(color_to_time(time_to_color(time_s)), time_s);
        }
    }
}
