//! Pictures of calibrations: residuals over the picture, the corners to touch, the trend of verifications.

use super::canvas::{Canvas, InkColor, PenWidth};
use maud::{Markup, html};
use panelprep_base::geometry::{ColorPicture, Pixel};
use panelprep_cell::imaging::ImagingError;
use panelprep_vision::calib::Board;
use panelprep_vision::calib::detect::Corners;
use panelprep_vision::calib::health::Verification;
use panelprep_vision::calib::intrinsics::Calibrated;

/// The longest residual is enlarged to this fraction of the picture's width.
const MAX_RESIDUAL_SHARE: f64 = 0.04;
const GROUND: [u8; 3] = [60, 60, 60];

/// Draws every used corner with its residual, enlarged until the longest is well seen: a lens that the model fits
/// shows no pattern.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn residual_field((width, height): (usize, usize), found: &Calibrated) -> Result<ColorPicture, ImagingError> {
    let mut canvas = Canvas::from_picture(&ColorPicture::uniform(width, height, GROUND))?;
    let longest = found.residuals.iter().map(|r| r.du_px.hypot(r.dv_px)).fold(1e-6, f64::max);
    let times = MAX_RESIDUAL_SHARE * width as f64 / longest;
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

/// Number of columns and rows of fields, each with a mean residual.
const FIELDS: (usize, usize) = (8, 6);
/// Smallest number of residuals for which a mean is drawn.
const MIN_IN_FIELD: usize = 6;

/// Calculates the mean residual of each field of the picture, px, at the field's middle.
fn field_means((width, height): (usize, usize), found: &Calibrated) -> Vec<(Pixel, [f64; 2])> {
    let mut sums = vec![([0.0, 0.0], 0); FIELDS.0 * FIELDS.1];
    for residual in &found.residuals {
        if let Some((column, row)) = residual.pixel.nearest_whole(width, height) {
            let (sum, count) = &mut sums[row * FIELDS.1 / height * FIELDS.0 + column * FIELDS.0 / width];
            *sum = [sum[0] + residual.du_px, sum[1] + residual.dv_px];
            *count += 1;
        }
    }
    let middle = |index: usize, count: usize, size: usize| (index as f64 + 0.5) * size as f64 / count as f64;
    let mean = |(index, (sum, count)): (usize, &([f64; 2], usize))| {
        let at = Pixel::at(middle(index % FIELDS.0, FIELDS.0, width), middle(index / FIELDS.0, FIELDS.1, height));
        (*count >= MIN_IN_FIELD).then(|| (at, sum.map(|sum| sum / *count as f64)))
    };
    sums.iter().enumerate().filter_map(mean).collect()
}

/// Draws the board's corners in its picture, and numbers those to touch from 1.
///
/// # Errors
/// If OpenCV refuses to draw.
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

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 320.0;
const MARGIN: f64 = 55.0;

/// Draws all verifications of a subject over time with their limits, as SVG. A verification that was struck out is
/// a grey cross, not connected to the line, and does not affect the scale.
pub fn trend(subject: &str, verifications: &[Verification]) -> String {
    let times = verifications.iter().map(|v| v.at_unix_s as f64);
    let (first, last) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
    let counts = |v: &&Verification| v.struck.is_none();
    let highest = verifications.iter().filter(counts).flat_map(|v| [v.error, v.limit]).fold(0.1, f64::max) * 1.1;
    let x =
        |v: &Verification| MARGIN + (WIDTH - 2.0 * MARGIN) * (v.at_unix_s as f64 - first) / (last - first).max(1.0);
    let y = |mm: f64| HEIGHT - MARGIN - (HEIGHT - 2.0 * MARGIN) * (mm / highest).min(1.0);
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
    let (bottom, right) = (HEIGHT - MARGIN, WIDTH - MARGIN);
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox=(format_args!("0 0 {WIDTH} {HEIGHT}")) font-family="sans-serif"
            font-size="14" {
            rect width="100%" height="100%" fill="white" {}
            text x=(MARGIN) y="25" {
                (subject) ": error at the target, mm; " (verifications.len()) " verifications over "
                (format_args!("{days:.1}")) " days"
                @if struck > 0 { "; grey crosses: struck out (" (struck) ")" }
            }
            path d=(format_args!("M{MARGIN} {MARGIN}V{bottom}H{right}")) fill="none" stroke="black" {}
            text x="5" y=(format_args!("{:.1}", MARGIN + 5.0)) { (format_args!("{highest:.2}")) }
            text x="5" y=(bottom) { "0" }
            polyline points=(line(|v| v.limit)) fill="none" stroke="#d55e00" stroke-dasharray="6 4" {}
            polyline points=(line(|v| v.error)) fill="none" stroke="#0072b2" {}
            @for verification in verifications { (mark(verification)) }
        }
        "\n"
    };
    svg.into_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_vision::calib::health::Strike;

    /// Calculated by hand: the highest of errors and limits is 1.0, drawn at 1/1.1 of the axis: 265 − 210/1.1 =
    /// 74.1.
    #[test]
    fn a_trend_shows_every_verification_and_marks_the_bad_ones() {
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
}
