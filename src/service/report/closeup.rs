//! Close-up pictures: the corner before and after its correction, and the water film as a strip of pictures in the
//! order of time.

use super::canvas::{Canvas, InkColor, PenWidth, crop, join_pictures, resize_to_width};
use panelprep_base::geometry::{ColorPicture, Mask, Pixel};
use panelprep_cell::imaging::ImagingError;

/// A corner as the flange camera sees it.
#[derive(Debug, Clone, Copy)]
pub struct CornerView<'a> {
    /// The flange camera's picture.
    pub picture: &'a ColorPicture,
    /// The expected position of the corner.
    pub expected_px: Pixel,
    /// The found position of the corner.
    pub found_px: Pixel,
    /// Pixels for one mm at the corner.
    pub px_per_mm: f64,
}

/// Width of a close picture, px.
const CLOSE_PX: usize = 720;

impl CornerView<'_> {
    /// Draws the corner enlarged, with both positions marked; `title` states which of the two pictures it is.
    ///
    /// # Errors
    /// If OpenCV refuses to draw.
    pub fn draw(&self, title: &str) -> Result<ColorPicture, ImagingError> {
        // Both marks and a part of the edge must be visible, at any distance between the marks.
        let apart_px = self.expected_px.distance_px(self.found_px);
        let half_px = (apart_px * 1.3).max(8.0 * self.px_per_mm);
        let left = (self.found_px.u - half_px).max(0.0);
        let top = (self.found_px.v - half_px).max(0.0);
        let side = (2.0 * half_px).round() as usize;
        let (left_px, top_px) = (left as usize, top as usize);
        let part = crop(self.picture, left_px, top_px, (side.max(8), side.max(8)));
        let zoom = CLOSE_PX as f64 / part.width.max(1) as f64;
        let mut canvas = Canvas::from_picture(&resize_to_width(&part, CLOSE_PX)?)?;
        let place = |pixel: Pixel| {
            // Pixel centres are whole numbers: half a pixel is added before the enlargement and subtracted after
            // it.
            let enlarge = |n: f64, first: usize| (n - first as f64 + 0.5) * zoom - 0.5;
            Pixel::at(enlarge(pixel.u, left_px), enlarge(pixel.v, top_px))
        };
        let (expected, found) = (place(self.expected_px), place(self.found_px));
        canvas.polyline(&[expected, found], false, PenWidth { ink: InkColor::WHITE, width_px: 1 })?;
        canvas.cross(expected, 16.0, PenWidth { ink: InkColor::BLUE, width_px: 2 })?;
        canvas.cross(found, 16.0, PenWidth { ink: InkColor::ORANGE, width_px: 2 })?;
        canvas.scale_bar(5.0, self.px_per_mm * zoom)?;
        let apart = format!("{title}: {apart_px:.2} px, {:.2} mm apart", apart_px / self.px_per_mm);
        canvas
            .with_legend(&[(InkColor::BLUE, "expected"), (InkColor::ORANGE, "found"), (InkColor::WHITE, &apart)])?
            .finish()
    }
}

/// One picture of a film strip.
#[derive(Debug, Clone)]
pub struct StripPicture {
    /// The clip's picture, cut to the region.
    pub picture: ColorPicture,
    /// The pixels that were broken at the time of the picture.
    pub broken: Mask,
    /// Its label, such as the time.
    pub label: String,
}

/// Draws the film over time: pictures side by side, each with the area that had broken until its time.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn film_strip(pictures: &[StripPicture]) -> Result<ColorPicture, ImagingError> {
    const WIDTH_PX: usize = 420;
    let one = |strip: &StripPicture| {
        let mut canvas = Canvas::from_picture(&strip.picture)?;
        canvas.tint_mask(&strip.broken, InkColor::YELLOW, 0.55)?;
        let mut canvas = Canvas::from_picture(&resize_to_width(&canvas.finish()?, WIDTH_PX)?)?;
        canvas.label(Pixel::at(8.0, 24.0), &strip.label, 16.0, InkColor::WHITE)?;
        canvas.finish()
    };
    let drawn = pictures.iter().map(one).collect::<Result<Vec<_>, _>>()?;
    Ok(join_pictures(&drawn, 3))
}

/// Returns the times of a strip's six pictures, s after the first fully wet one: close together while the film
/// opens.
pub fn strip_times_s(opens_s: Option<f64>, end_s: f64) -> [f64; 6] {
    let times_s = match opens_s {
        // The first picture already shows the break.
        Some(opens_s) if opens_s <= 0.0 => [0.0, 1.0, 3.0, 8.0, (8.0 + end_s) / 2.0, end_s],
        Some(opens_s) => [0.0, opens_s, opens_s + 1.0, opens_s + 3.0, opens_s + 8.0, end_s],
        None => [0.0, 0.2 * end_s, 0.4 * end_s, 0.6 * end_s, 0.8 * end_s, end_s],
    };
    times_s.map(|time_s| time_s.min(end_s))
}

/// Returns the box around pixels inside a picture of this width and height: its first and its last pixel.
pub fn bounds(pixels: impl IntoIterator<Item = Pixel>, (width, height): (usize, usize)) -> [(usize, usize); 2] {
    let (mut low, mut high) = ((width, height), (0, 0));
    for (column, row) in pixels.into_iter().filter_map(|pixel| pixel.nearest_whole(width, height)) {
        low = (low.0.min(column), low.1.min(row));
        high = (high.0.max(column), high.1.max(row));
    }
    [low, high]
}

/// Cuts the part inside a box out of a picture and a mask.
pub fn cut_out(picture: &ColorPicture, mask: &Mask, [low, high]: [(usize, usize); 2]) -> (ColorPicture, Mask) {
    let size = (high.0.saturating_sub(low.0).max(1), high.1.saturating_sub(low.1).max(1));
    let part = crop(picture, low.0, low.1, size);
    let rows = (low.1..low.1 + part.height).flat_map(|row| &mask.inside[row * mask.width + low.0..][..part.width]);
    let inside = rows.copied().collect();
    let mask = Mask { width: part.width, height: part.height, inside };
    (part, mask)
}
