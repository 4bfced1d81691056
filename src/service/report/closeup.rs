//! Close-up pictures: the corner before and after its correction, the water film as a strip of pictures ordered by
//! time, and each failed grid.
//!
//! The close-up of a grid shows the film at its end, an outline of the broken area, and a text with the size of this
//! area and the time to break. Each close-up has its own scale.

use super::canvas::{Canvas, InkColor, PenWidth, crop, join_pictures, resize_to_width};
use super::overlay::PanelOverlay;
use panelprep_base::geometry::{ColorPicture, Mask, Pixel};
use panelprep_cell::imaging::{ImagingError, outer_contours};
use panelprep_cell::panel::Grid;

/// The view of a corner by the flange camera.
#[derive(Debug, Clone, Copy)]
pub struct CornerView<'a> {
    /// The flange camera's picture.
    pub picture: &'a ColorPicture,
    /// The expected position of the corner in the picture.
    pub expected_px: Pixel,
    /// The detected position of the corner in the picture.
    pub found_px: Pixel,
    /// Scale of the picture at the corner.
    pub px_per_mm: f64,
}

/// Width of the close-up of a corner, px.
const CORNER_WIDTH_PX: usize = 720;

impl CornerView<'_> {
    /// Draws the corner enlarged, with both positions marked; `title` states whether the picture is from before or
    /// after the correction.
    ///
    /// # Errors
    /// If OpenCV cannot draw on the picture.
    pub fn draw(&self, title: &str) -> Result<ColorPicture, ImagingError> {
        // Both marks and a part of the panel's edge must be visible, even if the marks are far apart.
        let apart_px = self.expected_px.distance_px(self.found_px);
        let half_px = (apart_px * 1.3).max(8.0 * self.px_per_mm);
        let left = (self.found_px.u - half_px).max(0.0);
        let top = (self.found_px.v - half_px).max(0.0);
        let side = (2.0 * half_px).round() as usize;
        let (left_px, top_px) = (left as usize, top as usize);
        let part = crop(self.picture, left_px, top_px, (side.max(8), side.max(8)));
        let zoom = CORNER_WIDTH_PX as f64 / part.width.max(1) as f64;
        let mut canvas = Canvas::from_picture(&resize_to_width(&part, CORNER_WIDTH_PX)?)?;
        let place = |pixel: Pixel| {
            // Pixel centres have integer coordinates: half a pixel is added before the enlargement and subtracted after
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
    /// The picture of the clip, cropped to the region.
    pub picture: ColorPicture,
    /// The pixels that were broken at the time of the picture.
    pub broken: Mask,
    /// The label of the picture, such as its time.
    pub label: String,
}

/// Draws the film over time: pictures side by side, each with the area that was broken at its time.
///
/// # Errors
/// If OpenCV cannot draw on a picture.
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

/// Returns the times of the six pictures of a strip, s after the first fully wet picture: close together while the film
/// breaks.
pub fn strip_times_s(opens_s: Option<f64>, end_s: f64) -> [f64; 6] {
    let times_s = match opens_s {
        // The film is already broken in the first picture.
        Some(opens_s) if opens_s <= 0.0 => [0.0, 1.0, 3.0, 8.0, (8.0 + end_s) / 2.0, end_s],
        Some(opens_s) => [0.0, opens_s, opens_s + 1.0, opens_s + 3.0, opens_s + 8.0, end_s],
        None => [0.0, 0.2 * end_s, 0.4 * end_s, 0.6 * end_s, 0.8 * end_s, end_s],
    };
    times_s.map(|time_s| time_s.min(end_s))
}

/// Returns the bounding box of the given pixels in a picture of this width and height: its first and last column and
/// row. Pixels outside of the picture are ignored.
pub fn bounds(pixels: impl IntoIterator<Item = Pixel>, (width, height): (usize, usize)) -> [(usize, usize); 2] {
    let (mut low, mut high) = ((width, height), (0, 0));
    for (column, row) in pixels.into_iter().filter_map(|pixel| pixel.nearest_whole(width, height)) {
        low = (low.0.min(column), low.1.min(row));
        high = (high.0.max(column), high.1.max(row));
    }
    [low, high]
}

/// Crops a picture and a mask to the same box.
pub fn crop_with_mask(
    picture: &ColorPicture,
    mask: &Mask,
    [low, high]: [(usize, usize); 2],
) -> (ColorPicture, Mask) {
    let size = (high.0.saturating_sub(low.0).max(1), high.1.saturating_sub(low.1).max(1));
    let part = crop(picture, low.0, low.1, size);
    let rows = (low.1..low.1 + part.height).flat_map(|row| &mask.inside[row * mask.width + low.0..][..part.width]);
    let inside = rows.copied().collect();
    let mask = Mask { width: part.width, height: part.height, inside };
    (part, mask)
}

/// A failed grid and the text for its close-up.
#[derive(Debug, Clone)]
pub struct FailedGrid<'g> {
    /// The grid.
    pub grid: &'g Grid,
    /// Text of about 25 letters: the broken area, and the time at which it broke.
    pub words: String,
}

/// Width of the close-up of a grid, px.
const GRID_WIDTH_PX: usize = 320;
/// Height of the band with the title, px.
const TITLE_BAND_HEIGHT_PX: usize = 26;
/// Height of the letters of the title, px.
const TITLE_TEXT_HEIGHT_PX: f64 = 13.0;
/// Number of close-ups in one row.
const PICTURES_PER_ROW: usize = 4;
/// Margin around a grid, as a fraction of its width.
const GRID_MARGIN_FRACTION: f64 = 0.12;

impl PanelOverlay<'_> {
    /// Draws the failed grids side by side; `None` if no grid failed, or none of them is in the picture.
    ///
    /// # Errors
    /// If OpenCV cannot draw on a picture.
    pub fn failed_grids(
        &self,
        broken: &Mask,
        failed: &[FailedGrid<'_>],
    ) -> Result<Option<ColorPicture>, ImagingError> {
        let mut canvas = Canvas::from_picture(self.picture)?;
        for contour in outer_contours(broken)? {
            canvas.polyline(&contour, true, PenWidth { ink: InkColor::YELLOW, width_px: 1 })?;
        }
        for one in failed {
            canvas.polyline(
                &self.pixels(&one.grid.edge),
                true,
                PenWidth { ink: InkColor::VERMILLION, width_px: 1 },
            )?;
        }
        let whole = canvas.finish()?;
        let mut pictures = Vec::with_capacity(failed.len());
        for one in failed {
            if let Some(part) = crop_to_grid(&whole, &self.pixels(&one.grid.edge)) {
                let px_per_mm = self.px_per_mm(one.grid.corners[0]) * GRID_WIDTH_PX as f64 / part.width as f64;
                pictures.push(draw_close_up(&part, px_per_mm, &format!("{}: {}", one.grid.id, one.words))?);
            }
        }
        let Some(height) = pictures.iter().map(|picture| picture.height).max() else { return Ok(None) };
        let even: Vec<ColorPicture> = pictures.iter().map(|picture| extend_below(picture, height)).collect();
        let legend = [(InkColor::YELLOW, "broken film"), (InkColor::VERMILLION, "failed grid")];
        Canvas::from_picture(&join_pictures(&even, PICTURES_PER_ROW))?.with_legend(&legend)?.finish().map(Some)
    }
}

/// Crops the picture to the grid with a margin around it; `None` if the grid is outside of the picture.
fn crop_to_grid(whole: &ColorPicture, edge: &[Pixel]) -> Option<ColorPicture> {
    let [low, high] = bounds(edge.iter().copied(), (whole.width, whole.height));
    let (width, height) = (high.0.checked_sub(low.0)?, high.1.checked_sub(low.1)?);
    let margin = (width as f64 * GRID_MARGIN_FRACTION).ceil() as usize;
    let (left, top) = (low.0.saturating_sub(margin), low.1.saturating_sub(margin));
    Some(crop(whole, left, top, (width + 2 * margin, height + 2 * margin)))
}

/// Draws the enlarged part with a scale bar, below a dark band with its title; `px_per_mm` is the scale after the
/// enlargement.
fn draw_close_up(part: &ColorPicture, px_per_mm: f64, title: &str) -> Result<ColorPicture, ImagingError> {
    let mut canvas = Canvas::from_picture(&resize_to_width(part, GRID_WIDTH_PX)?)?;
    canvas.scale_bar_within(px_per_mm)?;
    let picture = canvas.finish()?;
    let mut rgb = vec![InkColor::RIM.0; TITLE_BAND_HEIGHT_PX * picture.width];
    rgb.extend_from_slice(&picture.rgb);
    let mut canvas = Canvas::from_picture(&ColorPicture {
        width: picture.width,
        height: picture.height + TITLE_BAND_HEIGHT_PX,
        rgb,
    })?;
    canvas.label(
        Pixel::at(6.0, TITLE_BAND_HEIGHT_PX as f64 - 8.0),
        title,
        TITLE_TEXT_HEIGHT_PX,
        InkColor::WHITE,
    )?;
    canvas.finish()
}

/// Extends the picture downwards to this height, in white.
fn extend_below(picture: &ColorPicture, height: usize) -> ColorPicture {
    let mut rgb = picture.rgb.clone();
    rgb.resize(picture.width * height, InkColor::WHITE.0);
    ColorPicture { width: picture.width, height, rgb }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A white square of 4 px × 4 px is in a dark picture of 100 × 80 px; the grid extends from (30, 20) to (70, 40).
    /// Expected values, calculated by hand: 40 px and a margin of 5 px on each side are 50 px, which are enlarged to
    /// 320 px. The square becomes 25.6 px wide. The part, which is 30 px high, becomes 192 px high.
    #[test]
    fn the_close_up_of_a_grid_has_a_margin_and_a_title() {
        let mut whole = ColorPicture::uniform(100, 80, [60; 3]);
        for at in (28..32).flat_map(|row| (48..52).map(move |column| row * 100 + column)) {
            whole.rgb[at] = [255; 3];
        }
        let edge = [(30.0, 20.0), (70.0, 20.0), (70.0, 40.0), (30.0, 40.0)].map(|(u, v)| Pixel::at(u, v));
        let part = crop_to_grid(&whole, &edge).expect("in the picture");
        assert_eq!((part.width, part.height), (50, 30));
        let close = draw_close_up(&part, 12.8, "r1c1: 41.3 mm²").expect("drawn");
        assert_eq!((close.width, close.height), (320, 192 + TITLE_BAND_HEIGHT_PX));
        let white = |row: usize| close.rgb[row * 320..][..320].iter().filter(|pixel| pixel[0] > 160).count();
        assert!((23..=29).contains(&white(TITLE_BAND_HEIGHT_PX + 96)), "{}", white(TITLE_BAND_HEIGHT_PX + 96));
        assert!((0..TITLE_BAND_HEIGHT_PX).any(|row| white(row) > 5), "letters in the band");
        assert_eq!(extend_below(&close, 300).rgb.len(), 320 * 300);
    }

    #[test]
    fn a_grid_outside_of_the_picture_has_no_close_up() {
        let whole = ColorPicture::uniform(100, 80, [60; 3]);
        assert!(crop_to_grid(&whole, &[Pixel::at(-30.0, -20.0), Pixel::at(-10.0, -5.0)]).is_none());
    }
}
