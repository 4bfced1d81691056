//! A bar chart that shows the percentage of each class.

use super::canvas::{Canvas, Ink, Pen};
use crate::geometry::{ColorPicture, Pixel};
use crate::imaging::ImagingError;

/// One class.
#[derive(Debug, Clone)]
pub struct Bar {
    /// What it is.
    pub label: String,
    /// Its share, 0…1.
    pub share: f64,
}

/// Draws bars under a title, from top to bottom.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn bars(title: &str, bars: &[Bar]) -> Result<ColorPicture, ImagingError> {
    const WIDTH_PX: usize = 760;
    const LINE_PX: f64 = 34.0;
    const FROM_PX: f64 = 330.0;
    const MAX_BAR_PX: f64 = 340.0;
    let height = (LINE_PX * (bars.len() as f64 + 1.8)) as usize;
    let mut canvas = Canvas::on(&ColorPicture::filled(WIDTH_PX, height, [60; 3]))?;
    canvas.label(Pixel::at(14.0, LINE_PX * 0.8), title, 17.0, Ink::WHITE)?;
    for (index, bar) in bars.iter().enumerate() {
        let middle = LINE_PX * (index as f64 + 1.7);
        canvas.label(Pixel::at(14.0, middle + 5.0), &bar.label, 13.0, Ink::WHITE)?;
        let length = MAX_BAR_PX * bar.share.clamp(0.0, 1.0);
        let line = [Pixel::at(FROM_PX, middle), Pixel::at(FROM_PX + length.max(1.0), middle)];
        if bar.share > 0.0 {
            canvas.polyline(&line, false, Pen { ink: Ink::ORANGE, width_px: 14 })?;
        }
        let words = format!("{:.1} %", 100.0 * bar.share);
        canvas.label(Pixel::at(FROM_PX + length + 14.0, middle + 5.0), &words, 13.0, Ink::WHITE)?;
    }
    canvas.finish()
}
