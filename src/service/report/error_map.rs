//! The remaining error over the working volume, as SVG: from above and from the side, mm in the robot's base.

use maud::{Markup, html};
use panelprep_base::geometry::{Base, Point};

/// A place and the remaining error there.
#[derive(Debug, Clone, PartialEq)]
pub struct RemainingError {
    /// Name of the place: the picture, or the corner that was touched.
    pub name: String,
    /// The place.
    pub place: Point<Base>,
    /// The remaining error, mm.
    pub error_mm: f64,
}

const SIDE_PX: f64 = 420.0;
const MARGIN_PX: f64 = 60.0;
const TOP_PX: f64 = 70.0;
/// The radius of the limit's circle, px.
const LIMIT_PX: f64 = 16.0;
const MAX_PX: f64 = 32.0;
/// Colours that colour-blind people can distinguish; errors beyond the limit also have a thick rim.
const WITHIN_LIMIT_COLOR: &str = "#0072b2";
const BEYOND_LIMIT_COLOR: &str = "#d55e00";

/// Draws two views of the same positions: along x and y, and along x and z, with x to the right. The larger the
/// circle, the larger the error.
pub fn error_map(title: &str, places: &[RemainingError], limit_mm: f64) -> String {
    let width = 2.0 * (SIDE_PX + MARGIN_PX) + MARGIN_PX;
    let height = TOP_PX + SIDE_PX + MARGIN_PX;
    let worst_mm = places.iter().map(|left| left.error_mm).fold(0.0, f64::max);
    let rms_mm = (places.iter().map(|left| left.error_mm.powi(2)).sum::<f64>() / places.len().max(1) as f64).sqrt();
    // All axes have the same scale, so that a view is not distorted.
    let coordinates = |axis: usize| places.iter().map(move |left| left.place.mm[axis]);
    let bounds = [0, 1, 2].map(|axis| {
        let (low, high) =
            coordinates(axis).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), mm| (a.min(mm), b.max(mm)));
        if low <= high { (low, high) } else { (0.0, 0.0) }
    });
    let span_mm = bounds.iter().map(|(low, high)| high - low).fold(50.0, f64::max) * 1.2;
    let view = |(view, (across, name)): (usize, (usize, &str))| {
        let left_px = MARGIN_PX + view as f64 * (SIDE_PX + MARGIN_PX);
        let middle = |axis: usize| (bounds[axis].0 + bounds[axis].1) / 2.0;
        let x = |mm: f64| left_px + SIDE_PX * (0.5 + (mm - middle(0)) / span_mm);
        let y = |mm: f64| TOP_PX + SIDE_PX * (0.5 - (mm - middle(across)) / span_mm);
        html! {
            (frame((left_px, name), (middle(0), middle(across)), span_mm))
            @for left in places { (circle(left, (x(left.place.mm.x), y(left.place.mm[across])), limit_mm)) }
        }
    };
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox=(format_args!("0 0 {width:.0} {height:.0}")) font-family="sans-serif"
            font-size="13" {
            rect width="100%" height="100%" fill="white" {}
            text x=(MARGIN_PX) y="24" font-size="16" { (title) }
            text x=(MARGIN_PX) y="46" {
                (places.len()) " places, " (format_args!("{rms_mm:.3} mm rms, largest {worst_mm:.3} mm")) "; blue: at most "
                (limit_mm) " mm, orange with a rim: above this limit; the radius of each circle shows its error"
            }
            @for one in [(1, "y"), (2, "z")].into_iter().enumerate() { (view(one)) }
        }
        "\n"
    };
    svg.into_string()
}

/// Draws a view's frame with its axes: ends and middle in mm.
fn frame((left_px, name): (f64, &str), (x_mm, y_mm): (f64, f64), span_mm: f64) -> Markup {
    let bottom = TOP_PX + SIDE_PX;
    html! {
        rect x=(left_px) y=(TOP_PX) width=(SIDE_PX) height=(SIDE_PX) fill="none" stroke="#888888" {}
        @for (share, anchor) in [(0.0, "start"), (0.5, "middle"), (1.0, "end")] {
            @let mm = x_mm + span_mm * (share - 0.5);
            text x=(left_px + share * SIDE_PX) y=(bottom + 20.0) text-anchor=(anchor) {
                @if share == 0.5 { (format_args!("x {mm:.0} mm")) } @else { (format_args!("{mm:.0}")) }
            }
            @let mm = y_mm + span_mm * (share - 0.5);
            text x=(left_px - 6.0) y=(bottom - share * (SIDE_PX - 12.0)) text-anchor="end" {
                @if share == 0.5 { (name) " " } (format_args!("{mm:.0}"))
            }
        }
    }
}

fn circle(left: &RemainingError, (cx, cy): (f64, f64), limit_mm: f64) -> Markup {
    let radius = (LIMIT_PX * left.error_mm / limit_mm).clamp(2.0, MAX_PX);
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

/// Formats a coordinate in a drawing.
fn format_tenths(px: f64) -> String {
    format!("{px:.1}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: the limit has 16 px; half of the limit 8 px, and three times the limit 32 px, the largest size, in
    /// the other colour.
    #[test]
    fn an_error_is_as_large_as_its_circle() {
        let left = |name: &str, x, error_mm| RemainingError {
            name: name.to_owned(),
            place: Point::at(x, 0.0, 300.0),
            error_mm,
        };
        let svg = error_map("a & b", &[left("1.png", 400.0, 0.25), left("2.png", 600.0, 1.5)], 0.5);
        assert!(svg.contains("a &amp; b") && svg.contains("2 places, 1.075 mm rms, largest 1.500 mm"), "{svg}");
        assert_eq!(svg.matches("r=\"8.0\" fill=\"#0072b2\"").count(), 2, "in both views");
        assert_eq!(svg.matches("r=\"32.0\" fill=\"#d55e00\"").count(), 2);
        // The points are 200 mm apart; the drawing spans 1.2 times this distance: 420 px / 240 mm.
        assert!(svg.contains("cx=\"95.0\"") && svg.contains("cx=\"445.0\""), "{svg}");
    }
}
