//! A bar chart that shows the percentage of each class.

use super::canvas::{Canvas, InkColor, PenWidth};
use panelprep_base::geometry::{ColorPicture, Pixel};
use panelprep_cell::imaging::ImagingError;

/// One class.
#[derive(Debug, Clone)]
pub struct BarClass {
    /// Label of the class.
    pub label: String,
    /// Its share, 0…1.
    pub share: f64,
}

/// Draws bars under a title, from top to bottom.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn draw_bars(title: &str, bars: &[BarClass]) -> Result<ColorPicture, ImagingError> {
    const WIDTH_PX: usize = 760;
    const LINE_PX: f64 = 34.0;
    const BAR_START_PX: f64 = 330.0;
    const MAX_BAR_PX: f64 = 340.0;
    let height = (LINE_PX * (bars.len() as f64 + 1.8)) as usize;
    let mut canvas = Canvas::from_picture(&ColorPicture::uniform(WIDTH_PX, height, [60; 3]))?;
    canvas.label(Pixel::at(14.0, LINE_PX * 0.8), title, 17.0, InkColor::WHITE)?;
    for (index, bar) in bars.iter().enumerate() {
        let middle = LINE_PX * (index as f64 + 1.7);
        canvas.label(Pixel::at(14.0, middle + 5.0), &bar.label, 13.0, InkColor::WHITE)?;
        let length = MAX_BAR_PX * bar.share.clamp(0.0, 1.0);
        let line = [Pixel::at(BAR_START_PX, middle), Pixel::at(BAR_START_PX + length.max(1.0), middle)];
        if bar.share > 0.0 {
            canvas.polyline(&line, false, PenWidth { ink: InkColor::ORANGE, width_px: 14 })?;
        }
        let words = format!("{:.1} %", 100.0 * bar.share);
        canvas.label(Pixel::at(BAR_START_PX + length + 14.0, middle + 5.0), &words, 13.0, InkColor::WHITE)?;
    }
    canvas.finish()
}
