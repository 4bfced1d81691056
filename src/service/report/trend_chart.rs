//! A number over many cycles as a drawing (SVG): its values, the limits with which they were compared, their usual
//! range, and unusual or forbidden values. No information is given by colour alone: a usual value is a dot, an
//! unusual one a triangle, one beyond its limit a cross.
//!
//! The drawing has classes and no colours; the page's style gives them, for light and dark.

use super::axis::Axis;
use super::checks::format_value;
use maud::{Markup, html};
use panelprep_base::number_text::{fixed_decimals, utc_day, utc_text};
use panelprep_base::verdict::Limit;
use panelprep_store::history::{Trend, TrendPoint};

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 320.0;
const LEFT_EDGE: f64 = 78.0;
const RIGHT_EDGE: f64 = 14.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 54.0;
/// Largest number of dates below the chart.
const MAX_DATES: usize = 6;

/// The words of a chart, in the reader's language.
#[derive(Debug, Clone, Copy)]
pub struct ChartTexts<'w> {
    /// Text below the horizontal axis.
    pub cycle: &'w str,
    /// Text for a normal value.
    pub usual: &'w str,
    /// Text for a value that violates a Western Electric rule.
    pub unusual: &'w str,
    /// Text for a value beyond its limit.
    pub beyond: &'w str,
    /// Text for the line of the limits.
    pub limit: &'w str,
    /// Text for the line of the mean.
    pub mean: &'w str,
}

/// The kind of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PointKind {
    Usual,
    Unusual,
    Beyond,
}

/// Draws the chart; each value links to the page of its cycle. Without a value, the frame is empty.
pub fn trend_chart(trend: &Trend, words: ChartTexts<'_>) -> Markup {
    let limits = trend.points.iter().filter_map(|point| point.limit.value());
    let values = trend.points.iter().map(|point| point.value).chain(limits);
    let vertical = Axis::covering(values, [HEIGHT - BOTTOM, TOP]);
    let unit = if trend.unit.is_empty() { String::new() } else { format!(" [{}]", trend.unit) };
    let title = format!("{}{unit}", trend.title);
    html! {
        svg.chart viewBox={ "0 0 " (WIDTH) " " (HEIGHT) } role="group" aria-label=(title) {
            rect.frame x=(LEFT_EDGE) y=(TOP) width=(WIDTH - LEFT_EDGE - RIGHT_EDGE) height=(HEIGHT - TOP - BOTTOM) {}
            @for (value, text) in vertical.ticks(5) {
                line.tick x1=(LEFT_EDGE) x2=(WIDTH - RIGHT_EDGE) y1=(format_coordinate(vertical.position(value))) y2=(format_coordinate(vertical.position(value))) {}
                text.number x=(LEFT_EDGE - 8.0) y=(format_coordinate(vertical.position(value) + 5.0)) text-anchor="end" { (text) }
            }
            text.axis x=(format_coordinate(-(TOP + HEIGHT - BOTTOM) / 2.0)) y="18" transform="rotate(-90)" text-anchor="middle" { (trend.unit) }
            text.axis x=(format_coordinate((LEFT_EDGE + WIDTH - RIGHT_EDGE) / 2.0)) y=(HEIGHT - 6.0) text-anchor="middle" { (words.cycle) }
            @for (index, point) in points_with_dates(&trend.points) {
                text.number x=(format_coordinate(horizontal_position(index, trend.points.len()))) y=(HEIGHT - BOTTOM + 18.0) text-anchor="middle" {
                    @if let Some(cycle) = point.cycle { (cycle) " · " }
                    (utc_day(point.at_unix_s))
                }
            }
            @if let Some(usual) = trend.usual {
                line.mean x1=(LEFT_EDGE) x2=(WIDTH - RIGHT_EDGE) y1=(format_coordinate(vertical.position(usual.mean))) y2=(format_coordinate(vertical.position(usual.mean))) {}
            }
            @for path in limit_paths(&trend.points, &vertical) { path.limit d=(path) {} }
            path.line d=(line(&trend.points, &vertical)) {}
            @for (index, point) in trend.points.iter().enumerate() {
                (draw_point(trend, index, point, [horizontal_position(index, trend.points.len()), vertical.position(point.value)]))
            }
        }
        ul.key {
            li { (sample(PointKind::Usual)) (words.usual) }
            li { (sample(PointKind::Unusual)) (words.unusual) }
            li { (sample(PointKind::Beyond)) (words.beyond) }
            li { svg.sample viewBox="0 0 24 16" aria-hidden="true" { path.limit d="M0 8H24" {} } (words.limit) }
            @if let Some(usual) = trend.usual {
                li { svg.sample viewBox="0 0 24 16" aria-hidden="true" { path.mean d="M0 8H24" {} } (words.mean) " " (format_value(usual.mean)) " ± " (format_value(usual.sigma)) (unit) }
            }
        }
    }
}

/// Formats a coordinate in the drawing, to a tenth.
fn format_coordinate(place: f64) -> String {
    fixed_decimals(place, 1).to_string()
}

/// Returns the horizontal position of the value with this index, counted from the left.
fn horizontal_position(index: usize, count: usize) -> f64 {
    LEFT_EDGE + (index as f64 + 0.5) / count.max(1) as f64 * (WIDTH - LEFT_EDGE - RIGHT_EDGE)
}

/// Returns the points with their dates written below the axis.
fn points_with_dates(points: &[TrendPoint]) -> impl Iterator<Item = (usize, &TrendPoint)> {
    let every = points.len().div_ceil(MAX_DATES).max(1);
    points.iter().enumerate().filter(move |(index, _)| index % every == 0)
}

fn line(points: &[TrendPoint], vertical: &Axis) -> String {
    let place = |(index, point): (usize, &TrendPoint)| {
        let letter = if index == 0 { 'M' } else { 'L' };
        format!(
            "{letter}{} {}",
            format_coordinate(horizontal_position(index, points.len())),
            format_coordinate(vertical.position(point.value))
        )
    };
    points.iter().enumerate().map(place).collect()
}

/// Returns the limits as steps; each segment with a constant limit is one path.
fn limit_paths(points: &[TrendPoint], vertical: &Axis) -> Vec<String> {
    let half = (horizontal_position(1, points.len()) - horizontal_position(0, points.len())) / 2.0;
    let mut paths = Vec::new();
    let mut begin = 0;
    for end in 1..=points.len() {
        if points.get(end).is_some_and(|point| point.limit == points[begin].limit) {
            continue;
        }
        if let Some(bound) = points[begin].limit.value() {
            let [from, to] = [
                horizontal_position(begin, points.len()) - half,
                horizontal_position(end - 1, points.len()) + half,
            ]
            .map(format_coordinate);
            paths.push(format!("M{from} {}H{to}", format_coordinate(vertical.position(bound))));
        }
        begin = end;
    }
    paths
}

fn kind(trend: &Trend, index: usize, point: &TrendPoint) -> PointKind {
    if !point.limit.is_met_by(point.value) {
        return PointKind::Beyond;
    }
    if trend.hints.iter().any(|hint| hint.at == index) { PointKind::Unusual } else { PointKind::Usual }
}

/// Draws a value with its description, and a link if it belongs to a cycle.
fn draw_point(trend: &Trend, index: usize, point: &TrendPoint, [x, y]: [f64; 2]) -> Markup {
    let limit = match point.limit {
        Limit::Unlimited => String::new(),
        Limit::AtMost(bound) => format!(", ≤ {}", format_value(bound)),
        Limit::AtLeast(bound) => format!(", ≥ {}", format_value(bound)),
        Limit::Below(bound) => format!(", < {}", format_value(bound)),
    };
    let hints = trend.hints.iter().filter(|hint| hint.at == index).map(|hint| hint.rule.describe());
    let hints = hints.map(|words| format!("; {words}")).collect::<String>();
    let value = format!("{} {}", format_value(point.value), trend.unit);
    let serial = point.serial.as_ref().map_or(String::new(), |serial| format!(", {serial}"));
    let tooltip = format!("{}{serial}: {}{limit}{hints}", utc_text(point.at_unix_s), value.trim_end());
    let drawn = html! { g transform={ "translate(" (format_coordinate(x)) " " (format_coordinate(y)) ")" } { title { (tooltip) } (shape(kind(trend, index, point))) } };
    match point.cycle {
        Some(cycle) => html! { a href={ "/cycle/" (cycle) } { (drawn) } },
        None => drawn,
    }
}

fn shape(mark: PointKind) -> Markup {
    match mark {
        PointKind::Usual => html! { circle.usual r="4" {} },
        PointKind::Unusual => html! { path.unusual d="M0 -7L7 5H-7Z" {} },
        PointKind::Beyond => html! { path.beyond d="M-6 -6L6 6M-6 6L6 -6" {} },
    }
}

fn sample(mark: PointKind) -> Markup {
    html! { svg.sample viewBox="-12 -8 24 16" aria-hidden="true" { (shape(mark)) } }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::record::CycleId;

    const WORDS: ChartTexts<'_> = ChartTexts {
        cycle: "cycle",
        usual: "usual",
        unusual: "unusual",
        beyond: "beyond its limit",
        limit: "limit",
        mean: "mean",
    };

    fn point(cycle: i64, value: f64, limit: Limit) -> TrendPoint {
        TrendPoint {
            cycle: Some(CycleId(cycle)),
            at_unix_s: cycle * 86_400,
            serial: Some("<b>".to_owned()),
            value,
            limit,
        }
    }

    /// Draws twelve values about 0.05, one value far off and one beyond its limit; the limit changes once.
    fn drawn() -> String {
        let mut points: Vec<TrendPoint> = (1..=12)
            .map(|cycle| point(cycle, if cycle % 2 == 0 { 0.05 } else { 0.06 }, Limit::AtMost(0.25)))
            .collect();
        points.push(point(13, 0.20, Limit::AtMost(0.25)));
        points.push(point(14, 0.20, Limit::AtMost(0.15)));
        let title = ("residual".to_owned(), "mm".to_owned());
        trend_chart(&Trend::from_points(title, points, 0), WORDS).into_string()
    }

    #[test]
    fn each_kind_of_value_has_its_own_sign_and_each_limit_its_line() {
        let svg = drawn();
        let count = |text: &str| svg.matches(text).count();
        // One mark in the chart and one in the key.
        assert_eq!(count("class=\"beyond\""), 2);
        assert!(count("class=\"unusual\"") >= 2, "0.20 is within 0.25 and unusual");
        assert_eq!(count("class=\"limit\""), 3, "two stretches and the key");
        assert_eq!(count("<a href=\"/cycle/"), 14);
        assert!(svg.contains("<a href=\"/cycle/14\"") && svg.contains("residual [mm]") && svg.contains(", ≤ 0.15"));
        assert!(svg.contains("1970-01-15 00:00:00 UTC, &lt;b&gt;: 0.2 mm"), "a name of a part is no script: {svg}");
        assert!(!svg.contains("style="), "the page allows no style in a text");
    }

    /// By hand: two values are at a quarter and at three quarters of the width 900 - 78 - 14 = 808, measured from 78.
    #[test]
    fn values_are_where_they_belong() {
        let points = vec![point(1, 1.0, Limit::Unlimited), point(2, 3.0, Limit::Unlimited)];
        assert_eq!((horizontal_position(0, 2), horizontal_position(1, 2)), (280.0, 684.0));
        let vertical = Axis::covering([1.0, 3.0].into_iter(), [100.0, 0.0]);
        // The axis extends by 8 % of the range 2 on both sides, from 0.84 to 3.16, so that 1 is 0.16 / 2.32 = 6.9 %
        // above the foot.
        assert_eq!(line(&points, &vertical), "M280.0 93.1L684.0 6.9");
        assert_eq!(limit_paths(&points, &vertical), [] as [String; 0]);
        let empty =
            trend_chart(&Trend::from_points(("x".to_owned(), String::new()), vec![], 3), WORDS).into_string();
        assert!(empty.contains("<svg") && !empty.contains("<a href"));
    }
}
