//! A scan as a picture: its colours, the pixels without points, and the recipe's region in it.

use super::canvas::{Canvas, InkColor, PenWidth};
use panelprep_base::geometry::{ColorPicture, Frame, Mask, OrganizedCloud, Pixel};
use panelprep_cell::imaging::ImagingError;

/// Returns the pixels of a scan that have no point.
pub fn missing_pixels<F: Frame>(scan: &OrganizedCloud<F>) -> Mask {
    let inside = (0..scan.width() * scan.height()).map(|index| scan.point_at(index).is_none()).collect();
    Mask { width: scan.width(), height: scan.height(), inside }
}

/// Returns the share of a scan's pixels that have no point, 0…1.
pub fn missing_share<F: Frame>(scan: &OrganizedCloud<F>) -> f64 {
    missing_pixels(scan).count() as f64 / (scan.width() * scan.height()) as f64
}

/// Draws the scan with a pixel ruler, its missing points tinted.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn scan_picture<F: Frame>(scan: &OrganizedCloud<F>) -> Result<ColorPicture, ImagingError> {
    let canvas = tint_scan(scan)?;
    canvas.draw_ruler()?.with_legend(&[(MISSING, &depth_legend(scan))])?.finish()
}

/// Draws the scan with the corners of the region that a recipe chooses; wrong corners, counted from 1, are marked.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn draw_region<F: Frame>(
    scan: &OrganizedCloud<F>,
    corners_px: &[Pixel; 4],
    wrong: &[usize],
) -> Result<ColorPicture, ImagingError> {
    let mut canvas = tint_scan(scan)?;
    let size_px = (scan.height() as f64 / 60.0).max(9.0);
    let text_px = (scan.height() as f64 / 50.0).max(11.0);
    let width_px = (scan.height() as f64 / 600.0).round().max(1.0) as i32;
    canvas.polyline(corners_px, true, PenWidth { ink: InkColor::WHITE, width_px })?;
    for (index, corner) in corners_px.iter().enumerate() {
        let number = index + 1;
        let (ink, word) =
            if wrong.contains(&number) { (InkColor::VERMILLION, " wrong") } else { (InkColor::BLUE, "") };
        canvas.cross(*corner, size_px, PenWidth { ink, width_px: width_px + 1 })?;
        // The text is white, because coloured letters of this size are hard to read. The cross has the colour of a
        // usable or a wrong corner; the text of a wrong corner also contains this word.
        let text = format!("{number} [{:.0}, {:.0}]{word}", corner.u, corner.v);
        canvas.label(Pixel::at(corner.u + size_px, corner.v - size_px), &text, text_px, InkColor::WHITE)?;
    }
    let legend = depth_legend(scan);
    let lines = [
        (InkColor::WHITE, "region of the recipe: corners_px, from the first to the fourth"),
        (InkColor::BLUE, "usable corner of the region"),
        (InkColor::VERMILLION, "wrong corner"),
        (MISSING, &*legend),
    ];
    let lines = if wrong.is_empty() { [&lines[..2], &lines[3..]].concat() } else { lines.to_vec() };
    canvas.draw_ruler()?.with_legend(&lines)?.finish()
}

const MISSING: InkColor = InkColor::YELLOW;

fn tint_scan<F: Frame>(scan: &OrganizedCloud<F>) -> Result<Canvas, ImagingError> {
    let mut canvas = Canvas::from_picture(&scan.picture())?;
    canvas.tint_mask(&missing_pixels(scan), MISSING, 0.45)?;
    Ok(canvas)
}

fn depth_legend<F: Frame>(scan: &OrganizedCloud<F>) -> String {
    format!("no 3D point: {:.1} % of {} x {} px", 100.0 * missing_share(scan), scan.width(), scan.height())
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::Camera;

    fn scan() -> OrganizedCloud<Camera> {
        let points = (0..1000 * 300).map(|i| if i % 1000 < 250 { [f32::NAN; 3] } else { [1.0, 2.0, 800.0] });
        OrganizedCloud::new(1000, 300, points.collect(), vec![[100; 3]; 1000 * 300]).expect("organised")
    }

    /// Calculated by hand: the left quarter of the scan has no points; yellow is (240, 228, 66), and 0.45 of the
    /// difference from 100 to this colour gives (163, 158, 85).
    #[test]
    fn missing_points_are_counted_and_tinted() {
        assert!((missing_share(&scan()) - 0.25).abs() < 1e-12);
        let picture = scan_picture(&scan()).expect("drawn");
        // The ruler and the legend lie to the left and above.
        let (left, top) = (picture.width - 1000, picture.height - 300);
        let at = |u: usize, v: usize| picture.rgb[(top + v) * picture.width + left + u];
        assert_eq!((at(33, 33), at(333, 33)), ([163, 158, 85], [100; 3]));
    }

    #[test]
    fn wrong_corners_differ_from_right_ones() {
        let corners = [[350.0, 50.0], [750.0, 50.0], [750.0, 250.0], [20.0, 250.0]].map(|[u, v]| Pixel::at(u, v));
        let picture = draw_region(&scan(), &corners, &[4]).expect("drawn");
        let (left, top) = (picture.width - 1000, picture.height - 300);
        let at = |u: usize, v: usize| picture.rgb[(top + v) * picture.width + left + u];
        // The drawn edges are anti-aliased, so a pixel may be lighter than its ink.
        let off =
            |found: [u8; 3], ink: InkColor| -> u32 { (0..3).map(|i| u32::from(found[i].abs_diff(ink.0[i]))).sum() };
        let is_blue = |pixel: [u8; 3]| 3 * off(pixel, InkColor::BLUE) < off(pixel, InkColor::VERMILLION);
        let is_red = |pixel: [u8; 3]| 3 * off(pixel, InkColor::VERMILLION) < off(pixel, InkColor::BLUE);
        assert!(is_blue(at(350, 50)) && is_blue(at(750, 250)) && is_red(at(20, 250)));
        let outside = corners.map(|corner| Pixel::at(corner.u + 700.0, corner.v));
        assert!(draw_region(&scan(), &outside, &[1, 2, 3]).is_ok(), "also beyond the picture");
    }
}
