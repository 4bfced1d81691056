//! Drawings of calibrations.
//!
//! - The residuals of a lens calibration over the picture, and the corners to touch.
//! - The trend of verifications, as SVG.
//! - The remaining error in the working volume, as SVG: from above and from the side, mm in the robot's base.
//! - The depth errors of a 3D camera over its picture. The systematic error, which is the same in each scan, is shown
//!   as colour. Each field of the picture contains three numbers: the systematic error, the remaining error, and the
//!   number of scans on which they are based.

use super::canvas::{Canvas, InkColor, PenWidth};
use maud::{Markup, html};
use panelprep_base::geometry::statistics::rms;
use panelprep_base::geometry::{Base, Camera, ColorPicture, PinholeCamera, Pixel, Point, REFERENCE_DEPTH_MM};
use panelprep_cell::imaging::ImagingError;
use panelprep_vision::calib::Board;
use panelprep_vision::calib::detect::Corners;
use panelprep_vision::calib::health::Verification;
use panelprep_vision::calib::intrinsics::Calibrated;
use panelprep_vision::calib::scanner_errors::{MIN_SCANS, PicturePart, ScannerErrors};
use rayon::prelude::*;

/// Length of the longest drawn residual, as a fraction of the picture's width.
const MAX_RESIDUAL_FRACTION: f64 = 0.04;
const BACKGROUND: [u8; 3] = [60, 60, 60];

/// Draws each used corner with its residual, enlarged so that the longest residual is clearly visible. If the lens
/// model fits, the residuals show no pattern.
///
/// # Errors
/// If OpenCV cannot draw on the picture.
pub fn residual_field((width, height): (usize, usize), found: &Calibrated) -> Result<ColorPicture, ImagingError> {
    let mut canvas = Canvas::from_picture(&ColorPicture::uniform(width, height, BACKGROUND))?;
    let longest = found.residuals.iter().map(|r| r.du_px.hypot(r.dv_px)).fold(1e-6, f64::max);
    let times = MAX_RESIDUAL_FRACTION * width as f64 / longest;
    let pen = PenWidth { ink: InkColor::ORANGE, width_px: (width / 900).max(1) as i32 };
    for residual in &found.residuals {
        let end = Pixel::at(residual.pixel.u + times * residual.du_px, residual.pixel.v + times * residual.dv_px);
        canvas.polyline(&[residual.pixel, end], false, pen)?;
    }
    let mean_times = 4.0 * times;
    for (at, [du_px, dv_px]) in field_means((width, height), found) {
        let end = Pixel::at(at.u + mean_times * du_px, at.v + mean_times * dv_px);
        canvas.polyline(&[at, end], false, PenWidth { ink: InkColor::BLUE, width_px: 3 * pen.width_px })?;
        canvas.cross(at, width as f64 / 200.0, PenWidth { ink: InkColor::BLUE, width_px: pen.width_px })?;
    }
    let [low, high] = found.tilt_deg;
    let each =
        format!("residuals, drawn {times:.0} times larger; longest {longest:.3} px, rms {:.3} px", found.rms_px);
    let mean = format!(
        "mean residual of each field, drawn {mean_times:.0} times larger: systematic error of the lens model"
    );
    let seen = format!(
        "corners cover {:.0} % of the picture; board tilted by {low:.0} to {high:.0} degrees",
        found.coverage * 100.0
    );
    canvas.with_legend(&[(InkColor::ORANGE, &each), (InkColor::BLUE, &mean), (InkColor::WHITE, &seen)])?.finish()
}

/// Number of columns and rows of fields into which the picture is divided; a mean residual is drawn in each field.
const FIELD_COUNTS: (usize, usize) = (8, 6);
/// Minimum number of residuals in a field for which the mean is drawn.
const MIN_RESIDUALS_IN_FIELD: usize = 6;

/// Computes the mean residual of each field of the picture, px, with the centre of the field.
fn field_means((width, height): (usize, usize), found: &Calibrated) -> Vec<(Pixel, [f64; 2])> {
    let mut sums = vec![([0.0, 0.0], 0); FIELD_COUNTS.0 * FIELD_COUNTS.1];
    for residual in &found.residuals {
        if let Some((column, row)) = residual.pixel.nearest_whole(width, height) {
            let (sum, count) =
                &mut sums[row * FIELD_COUNTS.1 / height * FIELD_COUNTS.0 + column * FIELD_COUNTS.0 / width];
            *sum = [sum[0] + residual.du_px, sum[1] + residual.dv_px];
            *count += 1;
        }
    }
    let middle = |index: usize, count: usize, size: usize| (index as f64 + 0.5) * size as f64 / count as f64;
    let mean = |(index, (sum, count)): (usize, &([f64; 2], usize))| {
        let at = Pixel::at(
            middle(index % FIELD_COUNTS.0, FIELD_COUNTS.0, width),
            middle(index / FIELD_COUNTS.0, FIELD_COUNTS.1, height),
        );
        (*count >= MIN_RESIDUALS_IN_FIELD).then(|| (at, sum.map(|sum| sum / *count as f64)))
    };
    sums.iter().enumerate().filter_map(mean).collect()
}

/// Draws the board's corners in its picture, and numbers the corners that must be touched from 1.
///
/// # Errors
/// If OpenCV cannot draw on the picture.
pub fn draw_corners_to_touch(
    picture: &ColorPicture,
    board: &Board,
    corners: &Corners,
    to_touch: &[(usize, usize)],
) -> Result<ColorPicture, ImagingError> {
    let mut canvas = Canvas::from_picture(picture)?;
    let size_px = (picture.width as f64 / 60.0).max(10.0);
    let at = |(column, row): (usize, usize)| {
        let place = board.corner(column, row)?;
        corners.iter().find(|(q, _)| *q == place).map(|(_, pixel)| *pixel)
    };
    for (_, pixel) in corners {
        canvas.cross(*pixel, size_px / 5.0, PenWidth { ink: InkColor::BLUE, width_px: 1 })?;
    }
    for (index, corner) in to_touch.iter().enumerate() {
        let Some(pixel) = at(*corner) else { continue };
        canvas.cross(pixel, size_px * 0.6, PenWidth { ink: InkColor::ORANGE, width_px: 3 })?;
        let label = format!("{} [{}, {}]", index + 1, corner.0, corner.1);
        canvas.label(
            Pixel::at(pixel.u + size_px * 0.7, pixel.v - size_px * 0.4),
            &label,
            size_px,
            InkColor::YELLOW,
        )?;
    }
    let legend = [
        (InkColor::ORANGE, "touch these corners in this order: 1 is the origin, 4 is the check point"),
        (InkColor::BLUE, "found corners"),
    ];
    canvas.with_legend(&legend)?.finish()
}

const TREND_WIDTH: f64 = 900.0;
const TREND_HEIGHT: f64 = 320.0;
const TREND_MARGIN: f64 = 55.0;

/// Draws all verifications of a subject over time with their limits, as SVG. A verification that a person struck out is
/// a grey cross; it is not connected to the line, and does not affect the scale.
pub fn trend(subject: &str, verifications: &[Verification]) -> String {
    let times = verifications.iter().map(|v| v.at_unix_s as f64);
    let (first, last) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
    let counts = |v: &&Verification| v.struck.is_none();
    let highest = verifications.iter().filter(counts).flat_map(|v| [v.error, v.limit]).fold(0.1, f64::max) * 1.1;
    let x = |v: &Verification| {
        TREND_MARGIN + (TREND_WIDTH - 2.0 * TREND_MARGIN) * (v.at_unix_s as f64 - first) / (last - first).max(1.0)
    };
    let y = |mm: f64| TREND_HEIGHT - TREND_MARGIN - (TREND_HEIGHT - 2.0 * TREND_MARGIN) * (mm / highest).min(1.0);
    let line = |value: fn(&Verification) -> f64| {
        let points = verifications.iter().filter(counts).map(|v| format!("{:.1},{:.1}", x(v), y(value(v))));
        points.collect::<Vec<_>>().join(" ")
    };
    let mark = |v: &Verification| -> Markup {
        let (x, y) = (x(v), y(v.error));
        match &v.struck {
            Some(strike) => html! {
                path d=(format_args!("M{:.1} {:.1}l8 8m0 -8l-8 8", x - 4.0, y - 4.0)) stroke="#666666" stroke-width="2" {
                    title { (format_args!("{:.3} mm", v.error)) ", struck out by " (strike.by) ": " (strike.why) }
                }
            },
            None => html! {
                circle cx=(format_args!("{x:.1}")) cy=(format_args!("{y:.1}")) r="4"
                    fill=(if v.error <= v.limit { "#009e73" } else { "#d55e00" }) {}
            },
        }
    };
    let struck = verifications.iter().filter(|v| v.struck.is_some()).count();
    let days = (last - first).max(0.0) / 86_400.0;
    let (bottom, right) = (TREND_HEIGHT - TREND_MARGIN, TREND_WIDTH - TREND_MARGIN);
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox=(format_args!("0 0 {TREND_WIDTH} {TREND_HEIGHT}")) font-family="sans-serif"
            font-size="14" {
            rect width="100%" height="100%" fill="white" {}
            text x=(TREND_MARGIN) y="25" {
                (subject) ": error at the target, mm; " (verifications.len()) " verifications over "
                (format_args!("{days:.1}")) " days"
                @if struck > 0 { "; grey crosses: struck out (" (struck) ")" }
            }
            path d=(format_args!("M{TREND_MARGIN} {TREND_MARGIN}V{bottom}H{right}")) fill="none" stroke="black" {}
            text x="5" y=(format_args!("{:.1}", TREND_MARGIN + 5.0)) { (format_args!("{highest:.2}")) }
            text x="5" y=(bottom) { "0" }
            polyline points=(line(|v| v.limit)) fill="none" stroke="#d55e00" stroke-dasharray="6 4" {}
            polyline points=(line(|v| v.error)) fill="none" stroke="#0072b2" {}
            @for verification in verifications { (mark(verification)) }
        }
        "\n"
    };
    svg.into_string()
}

/// A place in the working volume, and the remaining error there.
#[derive(Debug, Clone, PartialEq)]
pub struct RemainingError {
    /// Name of the place: a picture, or a corner that was touched.
    pub name: String,
    /// The place.
    pub place: Point<Base>,
    /// The remaining error, mm.
    pub error_mm: f64,
}

const VIEW_SIDE_PX: f64 = 420.0;
const VIEW_MARGIN_PX: f64 = 60.0;
const VIEW_TOP_PX: f64 = 70.0;
/// Radius of the circle for an error equal to the limit, px.
const LIMIT_RADIUS_PX: f64 = 16.0;
const MAX_RADIUS_PX: f64 = 32.0;
/// Colours of errors within the limit, and below it beyond the limit, which colour-blind people can distinguish; errors
/// beyond the limit also have a thick rim.
const WITHIN_LIMIT_COLOR: &str = "#0072b2";
const BEYOND_LIMIT_COLOR: &str = "#d55e00";

/// Draws two views of the places, both with x to the right: one with y upwards, one with z upwards. The radius of a
/// circle is proportional to the error.
pub fn error_map(title: &str, places: &[RemainingError], limit_mm: f64) -> String {
    let width = 2.0 * (VIEW_SIDE_PX + VIEW_MARGIN_PX) + VIEW_MARGIN_PX;
    let height = VIEW_TOP_PX + VIEW_SIDE_PX + VIEW_MARGIN_PX;
    let worst_mm = places.iter().map(|left| left.error_mm).fold(0.0, f64::max);
    let rms_mm = rms(places.iter().map(|left| left.error_mm));
    // All axes have the same scale, so that a view is not distorted.
    let coordinates = |axis: usize| places.iter().map(move |left| left.place.mm[axis]);
    let bounds = [0, 1, 2].map(|axis| {
        let (low, high) =
            coordinates(axis).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), mm| (a.min(mm), b.max(mm)));
        if low <= high { (low, high) } else { (0.0, 0.0) }
    });
    let span_mm = bounds.iter().map(|(low, high)| high - low).fold(50.0, f64::max) * 1.2;
    let view = |(view, (across, name)): (usize, (usize, &str))| {
        let left_px = VIEW_MARGIN_PX + view as f64 * (VIEW_SIDE_PX + VIEW_MARGIN_PX);
        let middle = |axis: usize| (bounds[axis].0 + bounds[axis].1) / 2.0;
        let x = |mm: f64| left_px + VIEW_SIDE_PX * (0.5 + (mm - middle(0)) / span_mm);
        let y = |mm: f64| VIEW_TOP_PX + VIEW_SIDE_PX * (0.5 - (mm - middle(across)) / span_mm);
        html! {
            (frame((left_px, name), (middle(0), middle(across)), span_mm))
            @for left in places { (circle(left, (x(left.place.mm.x), y(left.place.mm[across])), limit_mm)) }
        }
    };
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox=(format_args!("0 0 {width:.0} {height:.0}")) font-family="sans-serif"
            font-size="13" {
            rect width="100%" height="100%" fill="white" {}
            text x=(VIEW_MARGIN_PX) y="24" font-size="16" { (title) }
            text x=(VIEW_MARGIN_PX) y="46" {
                (places.len()) " places, " (format_args!("{rms_mm:.3} mm rms, largest {worst_mm:.3} mm")) "; blue: at most "
                (limit_mm) " mm, orange with a rim: above this limit; the radius of each circle shows its error"
            }
            @for one in [(1, "y"), (2, "z")].into_iter().enumerate() { (view(one)) }
        }
        "\n"
    };
    svg.into_string()
}

/// Draws the frame of a view with three numbers on each axis, mm: both ends and the middle.
fn frame((left_px, name): (f64, &str), (x_mm, y_mm): (f64, f64), span_mm: f64) -> Markup {
    let bottom = VIEW_TOP_PX + VIEW_SIDE_PX;
    html! {
        rect x=(left_px) y=(VIEW_TOP_PX) width=(VIEW_SIDE_PX) height=(VIEW_SIDE_PX) fill="none" stroke="#888888" {}
        @for (share, anchor) in [(0.0, "start"), (0.5, "middle"), (1.0, "end")] {
            @let mm = x_mm + span_mm * (share - 0.5);
            text x=(left_px + share * VIEW_SIDE_PX) y=(bottom + 20.0) text-anchor=(anchor) {
                @if share == 0.5 { (format_args!("x {mm:.0} mm")) } @else { (format_args!("{mm:.0}")) }
            }
            @let mm = y_mm + span_mm * (share - 0.5);
            text x=(left_px - 6.0) y=(bottom - share * (VIEW_SIDE_PX - 12.0)) text-anchor="end" {
                @if share == 0.5 { (name) " " } (format_args!("{mm:.0}"))
            }
        }
    }
}

fn circle(left: &RemainingError, (cx, cy): (f64, f64), limit_mm: f64) -> Markup {
    let radius = (LIMIT_RADIUS_PX * left.error_mm / limit_mm).clamp(2.0, MAX_RADIUS_PX);
    let is_beyond = left.error_mm.is_nan() || left.error_mm > limit_mm;
    let (color, rim) = if is_beyond { (BEYOND_LIMIT_COLOR, 3) } else { (WITHIN_LIMIT_COLOR, 1) };
    html! {
        circle cx=(format_tenths(cx)) cy=(format_tenths(cy)) r=(format_tenths(radius)) fill=(color) fill-opacity="0.45" stroke=(color)
            stroke-width=(rim) {
            title { (left.name) ": " (format_args!("{:.3} mm", left.error_mm)) }
        }
        text x=(format_tenths(cx + radius + 2.0)) y=(format_tenths(cy + 4.0)) font-size="11" { (format_args!("{:.2}", left.error_mm)) }
    }
}

/// Formats a coordinate of a drawing with a resolution of 0.1 px.
fn format_tenths(px: f64) -> String {
    format!("{px:.1}")
}

/// Maximum width of the drawn picture, px.
const MAX_DEPTH_MAP_PX: usize = 1200;
/// Minimum error at which the colours have their full strength, mm. They have it at the largest error of the picture,
/// if this is greater.
const MIN_FULL_COLOR_MM: f64 = 0.01;
const FAR_COLOR: InkColor = InkColor::VERMILLION;
const NEAR_COLOR: InkColor = InkColor::DEEP_BLUE;
const UNKNOWN_COLOR: InkColor = InkColor([150, 150, 150]);

/// Draws the depth errors of the scanner as a picture with a legend.
///
/// # Errors
/// If OpenCV cannot draw the picture.
pub fn depth_error_map(camera: &PinholeCamera, found: &ScannerErrors) -> Result<ColorPicture, ImagingError> {
    let step = camera.width_px.div_ceil(MAX_DEPTH_MAP_PX).max(1);
    let (width, height) = (camera.width_px / step, camera.height_px / step);
    let most_mm = found.max_field_mm.max(MIN_FULL_COLOR_MM);
    let at_mm = |direction| found.field.map_or(0.0, |field| field.at_mm(direction));
    let is_known = |at| found.parts.part_at(at).is_some_and(PicturePart::has_enough_scans);
    let mut picture = ColorPicture::uniform(width, height, UNKNOWN_COLOR.0);
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
            "systematic error, the same in each scan, which is corrected from now on; values at a distance of \
             {REFERENCE_DEPTH_MM:.0} mm"
        ),
        None => "no systematic error, the same in each scan, was found".to_owned(),
    };
    let far = format!("measured {most_mm:.2} mm or more too far");
    let near = format!("measured {most_mm:.2} mm or more too near");
    let left = "left number: remaining deviation of the scans from a plane, mm rms";
    let unknown = format!("the board was seen here in fewer than {MIN_SCANS} scans");
    let legend = [
        (InkColor::WHITE, same.as_str()),
        (FAR_COLOR, &far),
        (NEAR_COLOR, &near),
        (InkColor::WHITE, left),
        (UNKNOWN_COLOR, &unknown),
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

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_vision::calib::health::Strike;

    /// Expected value, calculated by hand: the maximum of all errors and limits is 1.0. It is drawn at 1/1.1 of the
    /// axis: 265 − 210/1.1 = 74.1.
    #[test]
    fn a_trend_shows_every_verification_and_marks_failed_ones() {
        let verified = |error: f64, at_unix_s: i64| Verification {
            subject: "scanner".to_owned(),
            error,
            limit: 0.5,
            calibration_hash: String::new(),
            at_unix_s,
            struck: None,
        };
        let svg = trend("scanner", &[verified(0.2, 0), verified(1.0, 86_400)]);
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.contains("cx=\"845.0\" cy=\"74.1\" r=\"4\" fill=\"#d55e00\""), "{svg}");
        assert!(svg.contains("2 verifications over 1.0 days<"));
        let strike = Strike { by: "A & B".to_owned(), why: "<moved>".to_owned(), at_unix_s: 0 };
        let struck = Verification { struck: Some(strike), ..verified(203.0, 43_200) };
        let with = trend("scanner", &[verified(0.2, 0), struck, verified(1.0, 86_400)]);
        assert!(
            with.matches("<circle").count() == 2 && with.contains("cy=\"74.1\""),
            "the scale is the others': {with}"
        );
        assert!(
            with.contains("203.000 mm, struck out by A &amp; B: &lt;moved&gt;") && with.contains("struck out (1)")
        );
        assert!(!trend("tool", &[]).contains("NaN") && !trend("tool", &[]).contains("circle"));
    }

    /// Expected radii, calculated by hand: 16 px for the limit; 8 px for half of the limit; 32 px for three times the
    /// limit, which is the maximum radius, with the other colour.
    #[test]
    fn the_radius_of_a_circle_shows_its_error() {
        let left = |name: &str, x, error_mm| RemainingError {
            name: name.to_owned(),
            place: Point::at(x, 0.0, 300.0),
            error_mm,
        };
        let svg = error_map("a & b", &[left("1.png", 400.0, 0.25), left("2.png", 600.0, 1.5)], 0.5);
        assert!(svg.contains("a &amp; b") && svg.contains("2 places, 1.075 mm rms, largest 1.500 mm"), "{svg}");
        assert_eq!(svg.matches("r=\"8.0\" fill=\"#0072b2\"").count(), 2, "in both views");
        assert_eq!(svg.matches("r=\"32.0\" fill=\"#d55e00\"").count(), 2);
        // The points are 200 mm apart. The drawing covers 1.2 times this distance, so the scale is 420 px / 240 mm.
        assert!(svg.contains("cx=\"95.0\"") && svg.contains("cx=\"445.0\""), "{svg}");
    }
}
