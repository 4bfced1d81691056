//! How a fitted surface lies in the scan, and how today's surface differs from the taught one, as maps that an
//! engineer can read.
//!
//! Each pixel shows the mean deviation of the points around it, so that the scan's white noise, which contains no
//! information about the surface, does not hide errors of the shape. Points that are missing or were left out are
//! shown as they are, one by one.

use super::canvas::{Canvas, InkColor};
use panelprep_base::geometry::ColorPicture;
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::TaughtSource;
use panelprep_toolpath::surface::{DeviationMap, MapPixel};

/// Deviation that has the full colour, mm.
const FULL_COLOR_MM: f64 = 0.1;
/// Half the width n of the square over which the mean is calculated: 2 n + 1 pixels.
const MEAN_RADIUS_PX: usize = 3;
const OUTSIDE: InkColor = InkColor([245, 245, 245]);
const MISSING: InkColor = InkColor([204, 121, 167]);
const REJECTED_COLOR: InkColor = InkColor::YELLOW;
const FRONT_COLOR: InkColor = InkColor::VERMILLION;
const BACK_COLOR: InkColor = InkColor::DEEP_BLUE;

/// Draws the map of a fit with its legend and scale.
///
/// # Errors
/// If OpenCV refuses to draw.
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

/// Draws the map of today's surface compared with the taught one, or with the drawing; at this deviation it has full
/// colour, mm.
///
/// # Errors
/// If OpenCV refuses to draw.
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
    let mut picture = ColorPicture::uniform(width, pixels.len() / width.max(1), OUTSIDE.0);
    for ((color, pixel), mean_mm) in picture.rgb.iter_mut().zip(pixels).zip(means) {
        *color = match pixel {
            MapPixel::Outside => OUTSIDE,
            MapPixel::Missing => MISSING,
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
        (MISSING, missing),
    ];
    canvas.with_legend(&legend)?.finish()
}

/// Returns the mean of the points in the fit around each pixel, mm; 0 if there is none. The sums are calculated along
/// the rows and then along the columns.
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

/// Calculates the sums over 2 n + 1 values along each of `lines` lines of `length` values; the last argument states
/// the distances between lines and between values.
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

/// Returns white at 0, the colour for the front at 1, and the colour for the back at −1.
fn deviation_color(share: f64) -> InkColor {
    let full = if share >= 0.0 { FRONT_COLOR } else { BACK_COLOR };
    InkColor::WHITE.mix_with(full, share.abs().min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: in a row with 0.3, nothing, 0.1 the mean around each value is 0.2.
    #[test]
    fn a_mean_is_over_what_is_there() {
        let row = [MapPixel::Fits { mm: 0.3 }, MapPixel::Missing, MapPixel::Fits { mm: 0.1 }];
        assert!(means_mm(3, &row).iter().all(|mean| (mean - 0.2).abs() < 1e-7));
        // Two distant rows in a column do not affect each other; the squares are seven high.
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
