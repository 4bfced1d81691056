//! Drawing on a picture: lines, areas, labels and a scale bar, in colours that colour-blind people can distinguish; and
//! a ruler along the picture, on which a person reads pixel coordinates.
//!
//! Every line and label has a dark rim, so that it is readable on light and on dark backgrounds. The drawing functions
//! are those of OpenCV.

use opencv::core::{Mat, MatTraitConst, MatTraitConstManual, MatTraitManual, Point2i, Scalar, Size, Vector};
use opencv::imgproc;
use panelprep_base::geometry::{ColorPicture, Mask, Pixel};
use panelprep_cell::imaging::ImagingError;

/// A colour: red, green, blue. The named colours are those of Okabe and Ito (2008), which people with every common type
/// of colour vision can distinguish.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InkColor(pub [u8; 3]);

impl InkColor {
    /// Colour of expected or taught objects.
    pub const BLUE: InkColor = InkColor([86, 180, 233]);
    /// Colour of detected water breaks.
    pub const ORANGE: InkColor = InkColor([230, 159, 0]);
    /// Colour of failed grids and values beyond a limit.
    pub const VERMILLION: InkColor = InkColor([213, 94, 0]);
    /// Colour of one end of a colour scale; the other end is vermillion.
    pub const DEEP_BLUE: InkColor = InkColor([0, 114, 178]);
    /// Colour of passed grids and values within a limit.
    pub const GREEN: InkColor = InkColor([0, 158, 115]);
    /// Tool paths.
    pub const YELLOW: InkColor = InkColor([240, 228, 66]);
    /// Labels.
    pub const WHITE: InkColor = InkColor([255, 255, 255]);
    pub(super) const RIM: InkColor = InkColor([20, 20, 20]);

    /// Mixes this colour with a fraction of another colour, 0 to 1.
    #[must_use]
    pub fn mix_with(self, other: InkColor, share: f64) -> InkColor {
        let mix = |i: usize| (f64::from(self.0[i]) * (1.0 - share) + f64::from(other.0[i]) * share).round() as u8;
        InkColor([mix(0), mix(1), mix(2)])
    }

    fn scalar(self) -> Scalar {
        let [r, g, b] = self.0;
        Scalar::new(r.into(), g.into(), b.into(), 0.0)
    }
}

/// The width of a line, or the size of a label.
#[derive(Debug, Clone, Copy)]
pub struct PenWidth {
    /// Its colour.
    pub ink: InkColor,
    /// Its width, px.
    pub width_px: i32,
}

/// Number of fractional bits in the fixed-point coordinates for OpenCV's drawing functions.
const SUB_PIXEL_BITS: i32 = 4;
const FONT: i32 = imgproc::FONT_HERSHEY_SIMPLEX;
/// Height of a capital letter at font scale 1, px.
const FONT_HEIGHT_PX: f64 = 22.0;

/// Possible lengths of a scale bar, mm.
const SCALE_BAR_LENGTHS_MM: [f64; 9] = [500.0, 200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0];
/// Maximum length of a scale bar, as a fraction of the picture's width.
const MAX_SCALE_BAR_FRACTION: f64 = 0.25;

/// Possible distances between two numbers of a ruler, px.
const RULER_STEPS_PX: [usize; 6] = [20, 50, 100, 200, 500, 1000];
/// Maximum number of numbers along a ruler.
const MAX_RULER_NUMBERS: usize = 20;

/// A picture on which the program draws.
pub struct Canvas {
    mat: Mat,
}

fn drawing_result<T>(result: opencv::Result<T>) -> Result<T, ImagingError> {
    result.map_err(|error| ImagingError { operation: "a drawing", words: error.message })
}

/// Replaces characters that are not ASCII, because OpenCV's fonts would show them as question marks.
fn ascii(text: &str) -> String {
    text.replace('²', "2")
        .replace('µ', "u")
        .replace('°', " deg")
        .replace('≥', ">=")
        .replace('≤', "<=")
        .replace('–', "-")
}

/// Returns OpenCV's font scale and line width for letters of this height.
fn letter_size(height_px: f64) -> (f64, i32) {
    let scale = height_px / FONT_HEIGHT_PX;
    (scale, (scale * 1.6).round().max(1.0) as i32)
}

fn to_fixed_point(pixel: Pixel) -> Point2i {
    let scaled = |n: f64| (n * f64::from(1 << SUB_PIXEL_BITS)).round() as i32;
    Point2i::new(scaled(pixel.u), scaled(pixel.v))
}

impl Canvas {
    /// Creates a canvas with a copy of a picture.
    ///
    /// # Errors
    /// If OpenCV cannot use the picture, for example because it is empty.
    pub fn from_picture(picture: &ColorPicture) -> Result<Self, ImagingError> {
        let flat = drawing_result(Mat::from_slice(picture.rgb.as_flattened()))?;
        let shaped = drawing_result(flat.reshape(3, picture.height as i32))?;
        Ok(Canvas { mat: drawing_result(shaped.try_clone())? })
    }

    /// Returns the picture with all drawings.
    ///
    /// # Errors
    /// If OpenCV does not return the pixels.
    pub fn finish(self) -> Result<ColorPicture, ImagingError> {
        let (width, height) = (self.mat.cols() as usize, self.mat.rows() as usize);
        let bytes = drawing_result(self.mat.data_bytes())?;
        Ok(ColorPicture { width, height, rgb: bytes.as_chunks::<3>().0.to_vec() })
    }

    /// Draws a polyline through these pixels.
    ///
    /// # Errors
    /// If OpenCV cannot draw on the picture. This also applies to the other shapes.
    pub fn polyline(&mut self, pixels: &[Pixel], closed: bool, pen: PenWidth) -> Result<(), ImagingError> {
        if pixels.len() < 2 {
            return Ok(());
        }
        let points: Vector<Point2i> = pixels.iter().copied().map(to_fixed_point).collect();
        let lines: Vector<Vector<Point2i>> = std::iter::once(points).collect();
        for (ink, width) in [(InkColor::RIM, pen.width_px + 2), (pen.ink, pen.width_px)] {
            drawing_result(imgproc::polylines(
                &mut self.mat,
                &lines,
                closed,
                ink.scalar(),
                width,
                imgproc::LINE_AA,
                SUB_PIXEL_BITS,
            ))?;
        }
        Ok(())
    }

    /// Draws a cross with a ring, the symbol of a measured point.
    ///
    /// # Errors
    /// As [`Canvas::polyline`].
    pub fn cross(&mut self, at: Pixel, radius_px: f64, pen: PenWidth) -> Result<(), ImagingError> {
        let arm = |du: f64, dv: f64| [Pixel::at(at.u - du, at.v - dv), Pixel::at(at.u + du, at.v + dv)];
        self.polyline(&arm(radius_px, 0.0), false, pen)?;
        self.polyline(&arm(0.0, radius_px), false, pen)?;
        let ring: Vec<Pixel> = (0..24)
            .map(|i| f64::from(i) * std::f64::consts::TAU / 24.0)
            .map(|angle_rad| {
                Pixel::at(at.u + radius_px * 0.7 * angle_rad.cos(), at.v + radius_px * 0.7 * angle_rad.sin())
            })
            .collect();
        self.polyline(&ring, true, pen)
    }

    /// Tints the pixels inside a mask.
    pub fn tint_mask(&mut self, mask: &Mask, ink: InkColor, strength: f64) -> Result<(), ImagingError> {
        use opencv::core::MatTraitManual;
        let pixels = drawing_result(self.mat.data_bytes_mut())?.as_chunks_mut::<3>().0;
        for (pixel, _) in pixels.iter_mut().zip(&mask.inside).filter(|(_, inside)| **inside) {
            *pixel = InkColor(*pixel).mix_with(ink, strength).0;
        }
        Ok(())
    }

    /// Draws a label on a dark background; `at` is the left end of the text's baseline. A label that would extend
    /// beyond the picture is moved completely into the picture.
    ///
    /// # Errors
    /// As [`Canvas::polyline`].
    pub fn label(&mut self, at: Pixel, text: &str, height_px: f64, ink: InkColor) -> Result<(), ImagingError> {
        let text = &ascii(text);
        let (scale, weight) = letter_size(height_px);
        let mut below = 0;
        let size = drawing_result(imgproc::get_text_size(text, FONT, scale, weight * 3 + 1, &mut below))?;
        let within = |at: f64, least: i32, most: i32| (at.round() as i32).min(most).max(least);
        let origin = Point2i::new(
            within(at.u, 0, self.mat.cols() - size.width),
            within(at.v, size.height, self.mat.rows() - below),
        );
        for (ink, weight) in [(InkColor::RIM, weight * 3 + 1), (ink, weight)] {
            let color = ink.scalar();
            drawing_result(imgproc::put_text(
                &mut self.mat,
                text,
                origin,
                FONT,
                scale,
                color,
                weight,
                imgproc::LINE_AA,
                false,
            ))?;
        }
        Ok(())
    }

    /// Draws a scale bar in the lower left corner, with at most a quarter of the picture's width; `px_per_mm` is the
    /// scale at the panel's depth.
    ///
    /// # Errors
    /// As [`Canvas::polyline`].
    pub fn scale_bar_within(&mut self, px_per_mm: f64) -> Result<(), ImagingError> {
        let most_px = MAX_SCALE_BAR_FRACTION * f64::from(self.mat.cols());
        let bar_mm = SCALE_BAR_LENGTHS_MM.into_iter().find(|bar_mm| bar_mm * px_per_mm <= most_px);
        self.scale_bar(bar_mm.unwrap_or(SCALE_BAR_LENGTHS_MM[SCALE_BAR_LENGTHS_MM.len() - 1]), px_per_mm)
    }

    /// Draws a scale bar in the lower left corner; `px_per_mm` is the scale at the panel's depth.
    ///
    /// # Errors
    /// As [`Canvas::polyline`].
    pub fn scale_bar(&mut self, length_mm: f64, px_per_mm: f64) -> Result<(), ImagingError> {
        let height = f64::from(self.mat.rows());
        let text_px = (height / 48.0).max(11.0);
        let (left, base) = (text_px * 1.5, height - text_px * 1.5);
        let right = left + length_mm * px_per_mm;
        let bar = [(left, -0.4), (left, 0.4), (left, 0.0), (right, 0.0), (right, 0.4), (right, -0.4)]
            .map(|(u, rise)| Pixel::at(u, base + rise * text_px));
        self.polyline(
            &bar,
            false,
            PenWidth { ink: InkColor::WHITE, width_px: (text_px / 8.0).round().max(1.0) as i32 },
        )?;
        let above = Pixel::at(left + text_px * 0.3, base - text_px * 0.7);
        self.label(above, &format!("{length_mm:.0} mm"), text_px, InkColor::WHITE)
    }

    /// Adds a dark band with a legend above the picture: a line in each colour, and its meaning.
    ///
    /// # Errors
    /// As [`Canvas::polyline`].
    pub fn with_legend(self, lines: &[(InkColor, &str)]) -> Result<Self, ImagingError> {
        let text_px = (f64::from(self.mat.rows()) / 48.0).max(11.0);
        let line_px = text_px * 1.8;
        let band = (line_px * (lines.len() as f64 + 0.4)).ceil() as i32;
        let (border, ground) = (opencv::core::BORDER_CONSTANT, InkColor::RIM.scalar());
        // A picture that is narrower than its legend is widened.
        let (scale, weight) = letter_size(text_px);
        let mut widest = 0;
        for (_, meaning) in lines {
            let size = drawing_result(imgproc::get_text_size(&ascii(meaning), FONT, scale, weight, &mut 0))?;
            widest = widest.max((text_px * 4.6).ceil() as i32 + size.width);
        }
        let beside = (widest - self.mat.cols()).max(0);
        let mut mat = Mat::default();
        drawing_result(opencv::core::copy_make_border(&self.mat, &mut mat, band, 0, 0, beside, border, ground))?;
        let mut canvas = Canvas { mat };
        for (index, (ink, meaning)) in lines.iter().enumerate() {
            let base = line_px * (index as f64 + 1.0) - text_px * 0.2;
            let stroke = [Pixel::at(text_px, base - text_px * 0.4), Pixel::at(text_px * 3.0, base - text_px * 0.4)];
            canvas.polyline(&stroke, false, PenWidth { ink: *ink, width_px: (text_px / 4.0).round() as i32 })?;
            canvas.label(Pixel::at(text_px * 3.6, base), meaning, text_px, InkColor::WHITE)?;
        }
        Ok(canvas)
    }

    /// Adds a pixel ruler above the picture and to the left of it, and faint lines across the picture at the numbers of
    /// the ruler.
    ///
    /// # Errors
    /// As [`Canvas::polyline`].
    pub fn draw_ruler(mut self) -> Result<Self, ImagingError> {
        let (width, height) = (self.mat.cols() as usize, self.mat.rows() as usize);
        let text_px = (height as f64 / 60.0).max(11.0);
        let step = RULER_STEPS_PX.into_iter().find(|step| width.max(height) / step <= MAX_RULER_NUMBERS);
        let step = step.unwrap_or(width.max(height));
        self.draw_lines(step)?;
        // The band is as wide as the widest number and a tick; a tick ends early enough that its rim does not touch the
        // picture.
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

    /// Draws faint vertical and horizontal lines, `step` pixels apart.
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

/// Returns a part of a picture, clipped at the picture's border.
pub fn crop(picture: &ColorPicture, left: usize, top: usize, size: (usize, usize)) -> ColorPicture {
    let width = size.0.min(picture.width.saturating_sub(left));
    let height = size.1.min(picture.height.saturating_sub(top));
    let rows = (top..top + height).flat_map(|row| &picture.rgb[row * picture.width + left..][..width]);
    ColorPicture { width, height, rgb: rows.copied().collect() }
}

/// Scales the picture to another width and keeps its aspect ratio.
///
/// # Errors
/// If OpenCV cannot scale the picture.
pub fn resize_to_width(picture: &ColorPicture, width: usize) -> Result<ColorPicture, ImagingError> {
    let height = (picture.height * width).div_ceil(picture.width.max(1)).max(1);
    let canvas = Canvas::from_picture(picture)?;
    let (mut mat, size) = (Mat::default(), Size::new(width as i32, height as i32));
    let way = if width < picture.width { imgproc::INTER_AREA } else { imgproc::INTER_LINEAR };
    drawing_result(imgproc::resize(&canvas.mat, &mut mat, size, 0.0, 0.0, way))?;
    Canvas { mat }.finish()
}

/// Joins pictures of the same size side by side, `columns` in each row.
pub fn join_pictures(pictures: &[ColorPicture], columns: usize) -> ColorPicture {
    const GAP_PX: usize = 6;
    let Some(first) = pictures.first() else { return ColorPicture::uniform(1, 1, [255; 3]) };
    let columns = columns.clamp(1, pictures.len());
    let rows = pictures.len().div_ceil(columns);
    let (step_u, step_v) = (first.width + GAP_PX, first.height + GAP_PX);
    let mut sheet = ColorPicture::uniform(columns * step_u - GAP_PX, rows * step_v - GAP_PX, [255; 3]);
    for (index, picture) in pictures.iter().enumerate() {
        let (left, top) = (index % columns * step_u, index / columns * step_v);
        for row in 0..picture.height.min(first.height) {
            let width = picture.width.min(first.width);
            let source = &picture.rgb[row * picture.width..][..width];
            sheet.rgb[(top + row) * sheet.width + left..][..width].copy_from_slice(source);
        }
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_its_colour_and_a_dark_rim() {
        let mut canvas = Canvas::from_picture(&ColorPicture::uniform(40, 20, [128; 3])).expect("a picture");
        let line = [Pixel::at(5.0, 10.0), Pixel::at(35.0, 10.0)];
        canvas.polyline(&line, false, PenWidth { ink: InkColor::BLUE, width_px: 3 }).expect("drawn");
        let picture = canvas.finish().expect("pixels");
        assert_eq!(picture.rgb[10 * 40 + 20], InkColor::BLUE.0);
        let dark = |row: usize| picture.rgb[row * 40 + 20].iter().all(|&value| value < 100);
        assert!((11..16).any(dark) && (4..9).any(dark), "a rim on both sides");
        assert_eq!(picture.rgb[20], [128; 3]);
    }

    /// A label that would extend beyond the right or upper border is moved completely into the picture: no letter
    /// touches the border.
    #[test]
    fn a_label_is_never_cut_off() {
        for at in [Pixel::at(195.0, 50.0), Pixel::at(400.0, -30.0), Pixel::at(-20.0, 99.0)] {
            let mut canvas = Canvas::from_picture(&ColorPicture::uniform(200, 100, [128; 3])).expect("a picture");
            canvas.label(at, "3 [1944, 1200]", 14.0, InkColor::WHITE).expect("drawn");
            let picture = canvas.finish().expect("pixels");
            let white: Vec<usize> = (0..200 * 100).filter(|&index| picture.rgb[index][0] > 200).collect();
            assert!(white.len() > 100, "{at:?}: {} bright pixels", white.len());
            assert!(white.iter().all(|index| (1..199).contains(&(index % 200))), "{at:?}");
        }
    }

    /// A legend of 30 letters on a picture with a width of 60 px is shown completely. A wide picture keeps its width.
    #[test]
    fn a_legend_is_never_cut_off() {
        let width = |px: usize| {
            let canvas = Canvas::from_picture(&ColorPicture::uniform(px, 40, [90; 3])).expect("a picture");
            let picture =
                canvas.with_legend(&[(InkColor::BLUE, "moved by more than half a pixel")]).expect("drawn").finish();
            let picture = picture.expect("pixels");
            let is_dark = |row: usize| picture.rgb[row * picture.width + picture.width - 1] == InkColor::RIM.0;
            assert!((0..picture.height - 40).all(is_dark), "letters at the border");
            picture.width
        };
        assert!(width(60) > 200);
        assert_eq!(width(900), 900);
    }

    /// Expected values, calculated by hand: the colour at a quarter between black (20, 20, 20) and white is 20 + 0.25 ·
    /// 235 = 78.75. In a picture with a width of 300 px, a bar may be up to 75 px long: 20 mm at 3 px per mm, 5 mm at
    /// 10 px per mm.
    #[test]
    fn mixed_colours_and_scale_bars_have_the_calculated_values() {
        assert_eq!(InkColor::RIM.mix_with(InkColor::WHITE, 0.25), InkColor([79; 3]));
        let bar_px = |px_per_mm: f64| {
            let mut canvas = Canvas::from_picture(&ColorPicture::uniform(300, 200, [90; 3])).expect("a picture");
            canvas.scale_bar_within(px_per_mm).expect("drawn");
            let picture = canvas.finish().expect("pixels");
            let whites = (0..300).filter(|u| (170..200).any(|v| picture.rgb[v * 300 + u][0] > 180));
            whites.clone().next_back().unwrap_or(0) - whites.clone().next().unwrap_or(0)
        };
        assert!(
            (58..=63).contains(&bar_px(3.0)) && (48..=53).contains(&bar_px(10.0)),
            "{} {}",
            bar_px(3.0),
            bar_px(10.0)
        );
    }

    /// Expected value, calculated by hand: pixel (3, 2) of the picture is pixel (1, 1) of the part that begins at (2,
    /// 1).
    #[test]
    fn a_cropped_part_begins_at_the_given_pixel() {
        let mut picture = ColorPicture::uniform(6, 5, [0; 3]);
        picture.rgb[2 * 6 + 3] = [9; 3];
        let part = crop(&picture, 2, 1, (3, 10));
        assert_eq!((part.width, part.height, part.rgb[3 + 1]), (3, 4, [9; 3]));
    }

    #[test]
    fn pictures_are_joined_in_rows() {
        let pictures: Vec<_> = (1..=3).map(|shade| ColorPicture::uniform(4, 4, [shade; 3])).collect();
        let sheet = join_pictures(&pictures, 2);
        assert_eq!((sheet.width, sheet.height), (14, 14));
        assert_eq!(sheet.rgb[10 * 14], [3; 3]);
    }

    /// Expected values, calculated by hand: on 300 px there are 15 numbers at distances of 20 px. The picture begins
    /// where the ruler ends, and its lines are at multiples of 20 px.
    #[test]
    fn a_ruler_outside_of_the_picture_counts_its_pixels() {
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
