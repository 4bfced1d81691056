//! Pictures of a scan, and maps of a surface over the pixels of the scan.
//!
//! - The scan: its colours, the pixels without points, and the region of the recipe.
//! - The deviation of a scan from a fitted surface, and of today's surface from the taught surface, as maps for an
//!   engineer. Each pixel shows the mean deviation of the points around it, so that the white noise of the scan, which
//!   contains no information about the surface, does not hide form errors. Missing and excluded points are shown pixel
//!   by pixel.

use super::canvas::{Canvas, InkColor, PenWidth};
use panelprep_base::geometry::{ColorPicture, Frame, Mask, OrganizedCloud, Pixel};
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::TaughtSource;
use panelprep_toolpath::surface::{DeviationMap, MapPixel};

/// Returns the pixels of a scan that have no point.
pub fn missing_pixels<F: Frame>(scan: &OrganizedCloud<F>) -> Mask {
    let inside = (0..scan.width() * scan.height()).map(|index| scan.point_at(index).is_none()).collect();
    Mask { width: scan.width(), height: scan.height(), inside }
}

/// Returns the fraction of a scan's pixels that have no point, 0 to 1.
pub fn missing_fraction<F: Frame>(scan: &OrganizedCloud<F>) -> f64 {
    missing_pixels(scan).count() as f64 / (scan.width() * scan.height()) as f64
}

/// Draws the scan with a pixel ruler; pixels without a point are tinted.
///
/// # Errors
/// If OpenCV cannot draw the picture.
pub fn scan_picture<F: Frame>(scan: &OrganizedCloud<F>) -> Result<ColorPicture, ImagingError> {
    let canvas = tint_scan(scan)?;
    canvas.draw_ruler()?.with_legend(&[(NO_POINT_COLOR, &depth_legend(scan))])?.finish()
}

/// Draws the scan with the corners of the recipe's region. `wrong` contains the numbers of the unusable corners, from
/// 1, which are marked.
///
/// # Errors
/// If OpenCV cannot draw the picture.
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
        // The text is white, because coloured letters of this size are difficult to read. The cross has the colour of a
        // usable or of an unusable corner; the text of an unusable corner also states this.
        let text = format!("{number} [{:.0}, {:.0}]{word}", corner.u, corner.v);
        canvas.label(Pixel::at(corner.u + size_px, corner.v - size_px), &text, text_px, InkColor::WHITE)?;
    }
    let legend = depth_legend(scan);
    let lines = [
        (InkColor::WHITE, "region of the recipe: corners_px, from the first to the fourth"),
        (InkColor::BLUE, "usable corner of the region"),
        (InkColor::VERMILLION, "wrong corner"),
        (NO_POINT_COLOR, &*legend),
    ];
    let lines = if wrong.is_empty() { [&lines[..2], &lines[3..]].concat() } else { lines.to_vec() };
    canvas.draw_ruler()?.with_legend(&lines)?.finish()
}

const NO_POINT_COLOR: InkColor = InkColor::YELLOW;

fn tint_scan<F: Frame>(scan: &OrganizedCloud<F>) -> Result<Canvas, ImagingError> {
    let mut canvas = Canvas::from_picture(&scan.picture())?;
    canvas.tint_mask(&missing_pixels(scan), NO_POINT_COLOR, 0.45)?;
    Ok(canvas)
}

fn depth_legend<F: Frame>(scan: &OrganizedCloud<F>) -> String {
    format!("no 3D point: {:.1} % of {} x {} px", 100.0 * missing_fraction(scan), scan.width(), scan.height())
}

/// Deviation at which the colour has its full strength, mm.
const FULL_COLOR_MM: f64 = 0.1;
/// Number n of pixels on each side of the centre: the mean is computed over a square of 2 n + 1 by 2 n + 1 pixels.
const MEAN_RADIUS_PX: usize = 3;
const OUTSIDE_COLOR: InkColor = InkColor([245, 245, 245]);
const MISSING_COLOR: InkColor = InkColor([204, 121, 167]);
const REJECTED_COLOR: InkColor = InkColor::YELLOW;
const FRONT_COLOR: InkColor = InkColor::VERMILLION;
const BACK_COLOR: InkColor = InkColor::DEEP_BLUE;

/// Draws the deviation of a scan from a fitted surface, with legend and scale bar.
///
/// # Errors
/// If OpenCV cannot draw the picture.
pub fn surface_map(map: &DeviationMap) -> Result<ColorPicture, ImagingError> {
    let side_mm = (2 * MEAN_RADIUS_PX + 1) as f64 * map.mm_per_px();
    let front = format!("scan {FULL_COLOR_MM} mm or more in front of the surface, mean over {side_mm:.1} mm");
    let behind = format!("scan {FULL_COLOR_MM} mm or more behind it");
    draw_deviation(
        map,
        FULL_COLOR_MM,
        [&front, "scan on the surface", &behind, "point excluded from the fit", "no point"],
    )
}

/// Draws the deviation of today's surface from the taught surface, or from the drawing. `full_mm` is the deviation at
/// which the colour has its full strength, mm.
///
/// # Errors
/// If OpenCV cannot draw the picture.
pub fn today_map(map: &DeviationMap, reference: TaughtSource, full_mm: f64) -> Result<ColorPicture, ImagingError> {
    let front = format!("panel {full_mm} mm or more in front of {}", reference.describe());
    let level = match reference {
        TaughtSource::Scan => "as taught",
        TaughtSource::Drawing => "as drawn",
    };
    let behind = format!("panel {full_mm} mm or more behind it");
    draw_deviation(map, full_mm, [&front, level, &behind, "excluded from the fit", "not seen by the scan"])
}

fn draw_deviation(
    map: &DeviationMap,
    full_mm: f64,
    [front, level, behind, left_out, missing]: [&str; 5],
) -> Result<ColorPicture, ImagingError> {
    let (width, pixels) = (map.width(), map.pixels());
    let means = means_mm(width, pixels);
    let mut picture = ColorPicture::uniform(width, pixels.len() / width.max(1), OUTSIDE_COLOR.0);
    for ((color, pixel), mean_mm) in picture.rgb.iter_mut().zip(pixels).zip(means) {
        *color = match pixel {
            MapPixel::Outside => OUTSIDE_COLOR,
            MapPixel::Missing => MISSING_COLOR,
            MapPixel::Rejected { .. } => REJECTED_COLOR,
            MapPixel::Fits { .. } => deviation_color(mean_mm / full_mm),
        }
        .0;
    }
    let mut canvas = Canvas::from_picture(&picture)?;
    canvas.scale_bar_within(1.0 / map.mm_per_px())?;
    let legend = [
        (FRONT_COLOR, front),
        (InkColor::WHITE, level),
        (BACK_COLOR, behind),
        (REJECTED_COLOR, left_out),
        (MISSING_COLOR, missing),
    ];
    canvas.with_legend(&legend)?.finish()
}

/// Returns the mean deviation of the fitted points around each pixel, mm; 0 if there is no such point. The sums are
/// computed first along the rows and then along the columns.
fn means_mm(width: usize, pixels: &[MapPixel]) -> Vec<f64> {
    let own = |pixel: &MapPixel| match pixel {
        MapPixel::Fits { mm } => [f64::from(*mm), 1.0],
        _ => [0.0, 0.0],
    };
    let values: Vec<[f64; 2]> = pixels.iter().map(own).collect();
    let height = values.len() / width.max(1);
    let along_rows = moving_sums(&values, (height, width), (width, 1));
    let both = moving_sums(&along_rows, (width, height), (1, width));
    both.into_iter().map(|[sum, count]| if count > 0.0 { sum / count } else { 0.0 }).collect()
}

/// Computes the sums over 2 n + 1 adjacent values in each of `lines` lines of `length` values. The last argument
/// contains the distances in memory between two lines, and between two values of a line.
fn moving_sums(
    values: &[[f64; 2]],
    (lines, length): (usize, usize),
    (line_step, step): (usize, usize),
) -> Vec<[f64; 2]> {
    let mut summed = vec![[0.0; 2]; values.len()];
    for line in 0..lines {
        let at = |place: usize| line * line_step + place * step;
        for place in 0..length {
            let window = place.saturating_sub(MEAN_RADIUS_PX)..(place + MEAN_RADIUS_PX + 1).min(length);
            summed[at(place)] = window.fold([0.0; 2], |[sum, count], near| {
                let [mm, one] = values[at(near)];
                [sum + mm, count + one]
            });
        }
    }
    summed
}

/// Returns the colour for a relative deviation: white at 0, the front colour at 1, the back colour at −1.
fn deviation_color(share: f64) -> InkColor {
    let full = if share >= 0.0 { FRONT_COLOR } else { BACK_COLOR };
    InkColor::WHITE.mix_with(full, share.abs().min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::Camera;

    fn scan() -> OrganizedCloud<Camera> {
        let points = (0..1000 * 300).map(|i| if i % 1000 < 250 { [f32::NAN; 3] } else { [1.0, 2.0, 800.0] });
        OrganizedCloud::new(1000, 300, points.collect(), vec![[100; 3]; 1000 * 300]).expect("organised")
    }

    /// Expected values, calculated by hand: the left quarter of the scan has no points. Yellow is (240, 228, 66), and
    /// 0.45 of the difference from 100 to this colour gives (163, 158, 85).
    #[test]
    fn missing_points_are_counted_and_tinted() {
        assert!((missing_fraction(&scan()) - 0.25).abs() < 1e-12);
        let picture = scan_picture(&scan()).expect("drawn");
        // The ruler is to the left of the picture and above it; the legend is above both.
        let (left, top) = (picture.width - 1000, picture.height - 300);
        let at = |u: usize, v: usize| picture.rgb[(top + v) * picture.width + left + u];
        assert_eq!((at(33, 33), at(333, 33)), ([163, 158, 85], [100; 3]));
    }

    #[test]
    fn wrong_and_usable_corners_have_different_colours() {
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

    /// Expected value, calculated by hand: in a row of 0.3, a missing point and 0.1, the mean around each pixel is 0.2.
    #[test]
    fn a_mean_ignores_missing_points() {
        let row = [MapPixel::Fits { mm: 0.3 }, MapPixel::Missing, MapPixel::Fits { mm: 0.1 }];
        assert!(means_mm(3, &row).iter().all(|mean| (mean - 0.2).abs() < 1e-7));
        // Two values at a distance of 8 rows do not affect each other, because the square is seven rows high.
        let mut column = vec![MapPixel::Outside; 9];
        (column[0], column[8]) = (MapPixel::Fits { mm: 1.0 }, MapPixel::Fits { mm: -1.0 });
        assert_eq!(means_mm(1, &column), [1.0, 1.0, 1.0, 1.0, 0.0, -1.0, -1.0, -1.0, -1.0]);
    }

    #[test]
    fn front_and_back_have_their_colours() {
        assert_eq!(
            [deviation_color(2.0), deviation_color(0.0), deviation_color(-1.0)],
            [FRONT_COLOR, InkColor::WHITE, BACK_COLOR]
        );
        assert_eq!(deviation_color(0.5), InkColor([234, 175, 128]));
    }
}
