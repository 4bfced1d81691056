//! A ruler of a picture's pixels, from which the pixel position of a place can be read.

use super::canvas::{Canvas, FONT, InkColor, PenWidth, drawing_result, letter_size};
use opencv::core::{Mat, MatTraitConst, MatTraitManual};
use opencv::imgproc;
use panelprep_base::geometry::Pixel;
use panelprep_cell::imaging::ImagingError;

/// Possible distances between the numbers of a ruler, px, and the largest number of labels.
const RULER_STEPS_PX: [usize; 6] = [20, 50, 100, 200, 500, 1000];
const MAX_NUMBERS: usize = 20;

impl Canvas {
    /// Adds a ruler of the picture's pixels above and beside it, and faint lines across the picture at the ruler's
    /// numbers.
    ///
    /// # Errors
    /// As [`Canvas::polyline`].
    pub fn draw_ruler(mut self) -> Result<Self, ImagingError> {
        let (width, height) = (self.mat.cols() as usize, self.mat.rows() as usize);
        let text_px = (height as f64 / 60.0).max(11.0);
        let step = RULER_STEPS_PX.into_iter().find(|step| width.max(height) / step <= MAX_NUMBERS);
        let step = step.unwrap_or(width.max(height));
        self.draw_lines(step)?;
        // The band is as wide as the largest number and a tick; a tick ends before its rim would touch the picture.
        let (scale, weight) = letter_size(text_px);
        let widest =
            drawing_result(imgproc::get_text_size(&width.max(height).to_string(), FONT, scale, weight, &mut 0))?;
        let band = widest.width + (1.6 * text_px).ceil() as i32;
        let mut mat = Mat::default();
        let (border, ground) = (opencv::core::BORDER_CONSTANT, InkColor::RIM.scalar());
        drawing_result(opencv::core::copy_make_border(&self.mat, &mut mat, band, 0, band, 0, border, ground))?;
        let (mut canvas, band) = (Canvas { mat }, f64::from(band));
        let pen = PenWidth { ink: InkColor::WHITE, width_px: 1 };
        let tick = |at: usize| if at.is_multiple_of(step) { 0.9 * text_px } else { 0.4 * text_px };
        for u in (0..width).step_by(step / 5) {
            let at = band + u as f64;
            canvas.polyline(&[Pixel::at(at, band - tick(u)), Pixel::at(at, band - 3.0)], false, pen)?;
            if u % step == 0 {
                let place = Pixel::at(at + 0.2 * text_px, band - 1.1 * text_px);
                canvas.label(place, &u.to_string(), text_px, InkColor::WHITE)?;
            }
        }
        for v in (0..height).step_by(step / 5) {
            let at = band + v as f64;
            canvas.polyline(&[Pixel::at(band - tick(v), at), Pixel::at(band - 3.0, at)], false, pen)?;
            if v % step == 0 {
                let place = Pixel::at(0.2 * text_px, at + 1.1 * text_px);
                canvas.label(place, &v.to_string(), text_px, InkColor::WHITE)?;
            }
        }
        let corner = Pixel::at(0.2 * text_px, band - 1.1 * text_px);
        canvas.label(corner, "px", text_px, InkColor::WHITE)?;
        Ok(canvas)
    }

    /// Draws faint lines at this distance in pixels, across and down.
    fn draw_lines(&mut self, step: usize) -> Result<(), ImagingError> {
        const LINE_OPACITY: f64 = 0.25;
        let width = self.mat.cols() as usize;
        let pixels = drawing_result(self.mat.data_bytes_mut())?.as_chunks_mut::<3>().0;
        for (index, pixel) in pixels.iter_mut().enumerate() {
            let (u, v) = (index % width, index / width);
            if (u > 0 && u % step == 0) || (v > 0 && v % step == 0) {
                *pixel = InkColor(*pixel).mix_with(InkColor::WHITE, LINE_OPACITY).0;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::ColorPicture;

    /// By hand: 300 px have 15 numbers 20 px apart; the picture begins where the ruler ends, and its lines are at
    /// whole steps.
    #[test]
    fn a_ruler_is_beside_the_picture_and_counts_its_pixels() {
        let mut plain = ColorPicture::uniform(300, 200, [90; 3]);
        plain.rgb[37 * 300 + 45] = [1, 2, 3];
        let ruled =
            Canvas::from_picture(&plain).expect("a picture").draw_ruler().expect("drawn").finish().expect("pixels");
        let band = ruled.width - 300;
        assert!(band > 20 && ruled.height == 200 + band, "{band}");
        let at = |u: usize, v: usize| ruled.rgb[(v + band) * ruled.width + u + band];
        assert_eq!(
            (at(45, 37), at(9, 11), at(30, 31)),
            ([1, 2, 3], [90; 3], [90; 3]),
            "nothing between the lines is changed"
        );
        assert!(at(40, 37)[0] > 100 && at(45, 60)[0] > 100, "lines at 40 and 60");
        let tick = |u: usize| ruled.rgb[(band - 6) * ruled.width + band + u][0];
        assert!(tick(100) > 200 && tick(90) < 60, "a long tick at 100, none at 90");
    }
}
