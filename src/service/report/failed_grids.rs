//! A close picture of each grid that failed: the film at the end, an outline of the broken area, and a text with the
//! size of this area and the time to break. Each picture has its own scale.

use super::canvas::{Canvas, InkColor, PenWidth, crop, join_pictures, resize_to_width};
use super::closeup::bounds;
use super::overlay::PanelOverlay;
use panelprep_base::geometry::{ColorPicture, Mask, Pixel};
use panelprep_cell::imaging::{ImagingError, outer_contours};
use panelprep_cell::panel::Grid;

/// A grid that failed.
#[derive(Debug, Clone)]
pub struct FailedGrid<'g> {
    /// The grid.
    pub grid: &'g Grid,
    /// Text of about 25 letters: how much of the film broke, and when.
    pub words: String,
}

/// Width of one close picture, px.
const WIDTH_PX: usize = 320;
/// Height of the band with the title, and of its letters, px.
const BAND_PX: usize = 26;
const TEXT_PX: f64 = 13.0;
/// Number of close pictures in one row.
const COLUMNS: usize = 4;
/// Space around a grid, as a share of its width.
const MARGIN_SHARE: f64 = 0.12;

impl PanelOverlay<'_> {
    /// Draws the failed grids side by side; `None` if none failed, or none is in the picture.
    ///
    /// # Errors
    /// If OpenCV refuses to draw.
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
            if let Some(part) = part(&whole, &self.pixels(&one.grid.edge)) {
                let px_per_mm = self.px_per_mm(one.grid.corners[0]) * WIDTH_PX as f64 / part.width as f64;
                pictures.push(close(&part, px_per_mm, &format!("{}: {}", one.grid.id, one.words))?);
            }
        }
        let Some(height) = pictures.iter().map(|picture| picture.height).max() else { return Ok(None) };
        let even: Vec<ColorPicture> = pictures.iter().map(|picture| extend_below(picture, height)).collect();
        let legend = [(InkColor::YELLOW, "broken film"), (InkColor::VERMILLION, "failed grid")];
        Canvas::from_picture(&join_pictures(&even, COLUMNS))?.with_legend(&legend)?.finish().map(Some)
    }
}

/// Cuts out the grid with some space around it.
fn part(whole: &ColorPicture, edge: &[Pixel]) -> Option<ColorPicture> {
    let [low, high] = bounds(edge.iter().copied(), (whole.width, whole.height));
    let (width, height) = (high.0.checked_sub(low.0)?, high.1.checked_sub(low.1)?);
    let margin = (width as f64 * MARGIN_SHARE).ceil() as usize;
    let (left, top) = (low.0.saturating_sub(margin), low.1.saturating_sub(margin));
    Some(crop(whole, left, top, (width + 2 * margin, height + 2 * margin)))
}

/// Draws the enlarged part with a scale bar, below a dark band with its title; `px_per_mm` is the scale after the
/// enlargement.
fn close(part: &ColorPicture, px_per_mm: f64, title: &str) -> Result<ColorPicture, ImagingError> {
    let mut canvas = Canvas::from_picture(&resize_to_width(part, WIDTH_PX)?)?;
    canvas.scale_bar_within(px_per_mm)?;
    let picture = canvas.finish()?;
    let mut rgb = vec![InkColor::RIM.0; BAND_PX * picture.width];
    rgb.extend_from_slice(&picture.rgb);
    let mut canvas =
        Canvas::from_picture(&ColorPicture { width: picture.width, height: picture.height + BAND_PX, rgb })?;
    canvas.label(Pixel::at(6.0, BAND_PX as f64 - 8.0), title, TEXT_PX, InkColor::WHITE)?;
    canvas.finish()
}

/// Adds white below the picture, up to this height.
fn extend_below(picture: &ColorPicture, height: usize) -> ColorPicture {
    let mut rgb = picture.rgb.clone();
    rgb.resize(picture.width * height, InkColor::WHITE.0);
    ColorPicture { width: picture.width, height, rgb }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A white square of 4 px in a dark picture of 100 by 80 px, cut at (30, 20) to (70, 40). 40 px and 5 px of
    /// margin on each side make 50 px, which become 320. The square becomes 25.6 px wide, and the part 30 px high
    /// becomes 192 px high.
    #[test]
    fn a_grid_is_cut_out_with_a_margin_and_has_its_title() {
        let mut whole = ColorPicture::uniform(100, 80, [60; 3]);
        for at in (28..32).flat_map(|row| (48..52).map(move |column| row * 100 + column)) {
            whole.rgb[at] = [255; 3];
        }
        let edge = [(30.0, 20.0), (70.0, 20.0), (70.0, 40.0), (30.0, 40.0)].map(|(u, v)| Pixel::at(u, v));
        let part = part(&whole, &edge).expect("in the picture");
        assert_eq!((part.width, part.height), (50, 30));
        let close = close(&part, 12.8, "r1c1: 41.3 mm²").expect("drawn");
        assert_eq!((close.width, close.height), (320, 192 + BAND_PX));
        let white = |row: usize| close.rgb[row * 320..][..320].iter().filter(|pixel| pixel[0] > 160).count();
        assert!((23..=29).contains(&white(BAND_PX + 96)), "{}", white(BAND_PX + 96));
        assert!((0..BAND_PX).any(|row| white(row) > 5), "letters in the band");
        assert_eq!(extend_below(&close, 300).rgb.len(), 320 * 300);
    }

    #[test]
    fn a_grid_outside_of_the_picture_has_no_part() {
        let whole = ColorPicture::uniform(100, 80, [60; 3]);
        assert!(part(&whole, &[Pixel::at(-30.0, -20.0), Pixel::at(-10.0, -5.0)]).is_none());
    }
}
