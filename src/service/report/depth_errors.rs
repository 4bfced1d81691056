//! The errors of a 3D camera over its picture. The part that is the same in each scan is shown as colour. Each part of
//! the picture contains three numbers: this amount, the remaining error, and the number of scans on which they are
//! based.

use super::canvas::{Canvas, InkColor};
use panelprep_base::geometry::{Camera, ColorPicture, PinholeCamera, Pixel, REFERENCE_DEPTH_MM};
use panelprep_cell::imaging::ImagingError;
use panelprep_vision::calib::scanner_errors::{MIN_SCANS, PicturePart, ScannerErrors};
use rayon::prelude::*;

/// Largest width of the drawn picture, px.
const WIDTH_PX: usize = 1200;
/// Smallest error that is drawn, mm.
const MIN_MM: f64 = 0.01;
const FAR_COLOR: InkColor = InkColor::VERMILLION;
const NEAR_COLOR: InkColor = InkColor::DEEP_BLUE;
const UNKNOWN: InkColor = InkColor([150, 150, 150]);

/// Draws the scanner's depth errors as a picture with a legend.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn depth_error_map(camera: &PinholeCamera, found: &ScannerErrors) -> Result<ColorPicture, ImagingError> {
    let step = camera.width_px.div_ceil(WIDTH_PX).max(1);
    let (width, height) = (camera.width_px / step, camera.height_px / step);
    let most_mm = found.max_field_mm.max(MIN_MM);
    let at_mm = |direction| found.field.map_or(0.0, |field| field.at_mm(direction));
    let is_known = |at| found.parts.part_at(at).is_some_and(PicturePart::has_enough_scans);
    let mut picture = ColorPicture::uniform(width, height, UNKNOWN.0);
    picture.rgb.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, pixels)| {
        for (column, color) in pixels.iter_mut().enumerate() {
            let pixel = Pixel::at((column * step) as f64, (row * step) as f64);
            if let Some(direction) = direction(camera, pixel).filter(|at| is_known(*at)) {
                let share = at_mm(direction) / most_mm;
                *color = InkColor::WHITE
                    .mix_with(if share > 0.0 { FAR_COLOR } else { NEAR_COLOR }, share.abs().min(1.0))
                    .0;
            }
        }
    });
    let mut canvas = Canvas::from_picture(&picture)?;
    let text_px = (height as f64 / 48.0).max(11.0);
    for part in found.parts.iter() {
        let [x, y] = part.direction;
        let ray = panelprep_base::geometry::Point::<Camera>::at(x, y, 1.0);
        let Some(at) = camera.project(ray) else { continue };
        let (u, v) = (at.u / step as f64 - 2.2 * text_px, at.v / step as f64);
        let line = |times: f64| Pixel::at(u, v + times * text_px);
        if !part.has_enough_scans() {
            canvas.label(line(0.0), &count_scans(part.scans), text_px, InkColor::WHITE)?;
            continue;
        }
        canvas.label(line(-0.8), &format!("{:+.2} mm", at_mm(part.direction)), text_px, InkColor::WHITE)?;
        canvas.label(line(0.6), &format!("left {:.2}", part.residual_mm), text_px, InkColor::WHITE)?;
        canvas.label(line(2.0), &count_scans(part.scans), text_px, InkColor::WHITE)?;
    }
    let same = match found.field {
        Some(_) => format!(
            "error that is the same in each scan, corrected from now on; values at a distance of \
             {REFERENCE_DEPTH_MM:.0} mm"
        ),
        None => "no error is the same in each scan".to_owned(),
    };
    let far = format!("measured {most_mm:.2} mm or more too far");
    let near = format!("measured {most_mm:.2} mm or more too near");
    let left = "left: remaining deviation of the scans from a plane, mm rms";
    let unknown = format!("the board was there in fewer than {MIN_SCANS} scans");
    let legend = [
        (InkColor::WHITE, same.as_str()),
        (FAR_COLOR, &far),
        (NEAR_COLOR, &near),
        (InkColor::WHITE, left),
        (UNKNOWN, &unknown),
    ];
    canvas.with_legend(&legend)?.finish()
}

fn count_scans(count: usize) -> String {
    if count == 1 { "1 scan".to_owned() } else { format!("{count} scans") }
}

fn direction(camera: &PinholeCamera, pixel: Pixel) -> Option<[f64; 2]> {
    let ray = camera.unproject::<Camera>(pixel)?.mm;
    Some([ray.x / ray.z, ray.y / ray.z])
}
