//! Charts of results: a trend over many cycles, the water breaks of each grid, and a bar chart.
//!
//! - The trend is a drawing (SVG) of a value over many cycles: the values, the limits with which they were compared,
//!   their usual range, and the values that are unusual or beyond their limit. Colour is never the only symbol: a usual
//!   value is a dot, an unusual one a triangle, one beyond its limit a cross. The drawing contains CSS classes and no
//!   colours; the page's style sheet defines the colours, for light and dark display.
//! - The heat map shows on which grids the film breaks, over many parts: the panel's grids in their arrangement on the
//!   panel, each with its number of water breaks and the time to break. The shade shows the fraction of films that
//!   broke.
//! - The bar chart is a picture that shows the percentage of each category.

use super::canvas::{Canvas, InkColor, PenWidth};
use super::page::format_value;
use maud::{Markup, html};
use panelprep_base::geometry::{ColorPicture, Pixel};
use panelprep_base::number_text::{fixed_decimals, shortest_text, utc_day, utc_text};
use panelprep_base::verdict::Limit;
use panelprep_cell::imaging::ImagingError;
use panelprep_store::history::{HeatCell, HeatMap, Trend, TrendPoint};

const TREND_WIDTH: f64 = 900.0;
const TREND_HEIGHT: f64 = 320.0;
const LEFT_EDGE: f64 = 78.0;
const RIGHT_EDGE: f64 = 14.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 54.0;
/// Maximum number of dates below the chart.
const MAX_DATES: usize = 6;

/// The texts of a chart, in the visitor's language.
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

/// Whether a value is usual, unusual or beyond its limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PointKind {
    Usual,
    Unusual,
    Beyond,
}

/// Draws the chart; each value is a link to the page of its cycle. If there is no value, the frame is empty.
pub fn trend_chart(trend: &Trend, words: ChartTexts<'_>) -> Markup {
    let limits = trend.points.iter().filter_map(|point| point.limit.value());
    let values = trend.points.iter().map(|point| point.value).chain(limits);
    let vertical = Axis::covering(values, [TREND_HEIGHT - BOTTOM, TOP]);
    let unit = if trend.unit.is_empty() { String::new() } else { format!(" [{}]", trend.unit) };
    let title = format!("{}{unit}", trend.title);
    html! {
        svg.chart viewBox={ "0 0 " (TREND_WIDTH) " " (TREND_HEIGHT) } role="group" aria-label=(title) {
            rect.frame x=(LEFT_EDGE) y=(TOP) width=(TREND_WIDTH - LEFT_EDGE - RIGHT_EDGE) height=(TREND_HEIGHT - TOP - BOTTOM) {}
            @for (value, text) in vertical.ticks(5) {
                line.tick x1=(LEFT_EDGE) x2=(TREND_WIDTH - RIGHT_EDGE) y1=(format_coordinate(vertical.position(value))) y2=(format_coordinate(vertical.position(value))) {}
                text.number x=(LEFT_EDGE - 8.0) y=(format_coordinate(vertical.position(value) + 5.0)) text-anchor="end" { (text) }
            }
            text.axis x=(format_coordinate(-(TOP + TREND_HEIGHT - BOTTOM) / 2.0)) y="18" transform="rotate(-90)" text-anchor="middle" { (trend.unit) }
            text.axis x=(format_coordinate((LEFT_EDGE + TREND_WIDTH - RIGHT_EDGE) / 2.0)) y=(TREND_HEIGHT - 6.0) text-anchor="middle" { (words.cycle) }
            @for (index, point) in points_with_dates(&trend.points) {
                text.number x=(format_coordinate(horizontal_position(index, trend.points.len()))) y=(TREND_HEIGHT - BOTTOM + 18.0) text-anchor="middle" {
                    @if let Some(cycle) = point.cycle { (cycle) " · " }
                    (utc_day(point.at_unix_s))
                }
            }
            @if let Some(usual) = trend.usual {
                line.mean x1=(LEFT_EDGE) x2=(TREND_WIDTH - RIGHT_EDGE) y1=(format_coordinate(vertical.position(usual.mean))) y2=(format_coordinate(vertical.position(usual.mean))) {}
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

/// Formats a coordinate of the drawing with one decimal.
fn format_coordinate(place: f64) -> String {
    fixed_decimals(place, 1).to_string()
}

/// Returns the horizontal coordinate of the value with this index.
fn horizontal_position(index: usize, count: usize) -> f64 {
    LEFT_EDGE + (index as f64 + 0.5) / count.max(1) as f64 * (TREND_WIDTH - LEFT_EDGE - RIGHT_EDGE)
}

/// Returns the points whose dates are written below the axis, each with its index.
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

/// Returns the limits as horizontal lines; each range of cycles with the same limit is one path.
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

/// Draws a value with its description, and a link if the value belongs to a cycle.
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

/// An axis between two values, over a length in the chart.
#[derive(Debug, Clone, PartialEq)]
struct Axis {
    min: f64,
    max: f64,
    /// Coordinate of `min` in the chart; `to` is the coordinate of `max`.
    from: f64,
    to: f64,
}

impl Axis {
    /// Creates an axis over all of these values, with some space at both ends; NaN and infinite values are ignored.
    fn covering(values: impl Iterator<Item = f64>, [from, to]: [f64; 2]) -> Self {
        let (low, high) = values
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        let (low, high) = if low > high { (0.0, 1.0) } else { (low, high) };
        // If all values are equal, the axis still needs a length.
        let room = if high > low { 0.08 * (high - low) } else { 0.5 * high.abs().max(1.0) };
        Axis { min: low - room, max: high + room, from, to }
    }

    /// Returns the coordinate of a value.
    fn position(&self, value: f64) -> f64 {
        self.from + (value - self.min) / (self.max - self.min) * (self.to - self.from)
    }

    /// Returns approximately this number of round values on the axis, each with its text. Adjacent values differ by 1,
    /// 2 or 5 times a power of ten.
    fn ticks(&self, about: usize) -> Vec<(f64, String)> {
        let rough = (self.max - self.min) / about.max(1) as f64;
        let power = 10.0_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|times| times * power).into_iter().find(|step| *step >= 0.75 * rough);
        let step = step.unwrap_or(10.0 * power);
        let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
        let (first, last) = ((self.min / step).ceil() as i64, (self.max / step).floor() as i64);
        let text =
            |value: f64| format!("{value:.decimals$}").parse().map_or_else(|_| shortest_text(value), shortest_text);
        (first..=last).map(|index| index as f64 * step).map(|value| (value, text(value))).collect()
    }
}

/// Number of shades, without the shade of a grid that never broke.
const SHADE_COUNT: f64 = 4.0;

/// Returns the heat map as an HTML table; `words` is its caption, which explains the content of a cell.
pub fn heat_chart(map: &HeatMap, words: &str) -> Markup {
    let of = |part: fn(&HeatCell) -> u32| map.grids.iter().map(part).max().unwrap_or(0);
    let (rows, columns) = (of(|cell| cell.row), of(|cell| cell.column));
    let cell = |row, column| map.grids.iter().find(move |cell| (cell.row, cell.column) == (row, column));
    html! {
        table.heat {
            caption { (words) }
            thead { tr { td {} @for column in 1..=columns { th scope="col" { "c" (column) } } } }
            tbody { @for row in 1..=rows {
                tr {
                    th scope="row" { "r" (row) }
                    @for column in 1..=columns {
                        @match cell(row, column) {
                            Some(cell) => td class={ "shade-" (shade_index(cell)) } {
                                strong { (cell.breaks) "/" (cell.films) }
                                @if let Some(median_s) = cell.median_s { br; (fixed_decimals(median_s, 1)) " s" }
                            },
                            None => td { "–" },
                        }
                    }
                }
            } }
        }
    }
}

/// Returns 0 for a grid that never broke; otherwise 1 to 4, according to the fraction of films that broke on this grid.
fn shade_index(cell: &HeatCell) -> u8 {
    if cell.breaks == 0 || cell.films == 0 {
        return 0;
    }
    (cell.breaks as f64 / cell.films as f64 * SHADE_COUNT).ceil().clamp(1.0, SHADE_COUNT) as u8
}

/// One class.
#[derive(Debug, Clone)]
pub struct BarClass {
    /// Label of the category.
    pub label: String,
    /// Its share, 0…1.
    pub share: f64,
}

/// Draws a bar chart: the title, and below it one bar for each category.
///
/// # Errors
/// If OpenCV cannot draw the picture.
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

    /// Returns a chart of twelve values near 0.05, an unusual one and one beyond its limit; the limit changes once.
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
    fn each_kind_of_value_has_its_own_symbol_and_each_limit_a_line() {
        let svg = drawn();
        let count = |text: &str| svg.matches(text).count();
        // One symbol in the chart and one in its legend.
        assert_eq!(count("class=\"beyond\""), 2);
        assert!(count("class=\"unusual\"") >= 2, "0.20 is within 0.25 and unusual");
        assert_eq!(count("class=\"limit\""), 3, "two stretches and the key");
        assert_eq!(count("<a href=\"/cycle/"), 14);
        assert!(svg.contains("<a href=\"/cycle/14\"") && svg.contains("residual [mm]") && svg.contains(", ≤ 0.15"));
        assert!(svg.contains("1970-01-15 00:00:00 UTC, &lt;b&gt;: 0.2 mm"), "a name of a part is no script: {svg}");
        assert!(!svg.contains("style="), "the page allows no style in a text");
    }

    /// Expected coordinates, calculated by hand: two values are at a quarter and at three quarters of the width 900 -
    /// 78 - 14 = 808, measured from 78.
    #[test]
    fn values_are_at_their_calculated_positions() {
        let points = vec![point(1, 1.0, Limit::Unlimited), point(2, 3.0, Limit::Unlimited)];
        assert_eq!((horizontal_position(0, 2), horizontal_position(1, 2)), (280.0, 684.0));
        let vertical = Axis::covering([1.0, 3.0].into_iter(), [100.0, 0.0]);
        // The axis extends by 8 % of the range 2 at both ends, from 0.84 to 3.16. Therefore the value 1 is at 0.16 /
        // 2.32 = 6.9 % of the axis.
        assert_eq!(line(&points, &vertical), "M280.0 93.1L684.0 6.9");
        assert_eq!(limit_paths(&points, &vertical), [] as [String; 0]);
        let empty =
            trend_chart(&Trend::from_points(("x".to_owned(), String::new()), vec![], 3), WORDS).into_string();
        assert!(empty.contains("<svg") && !empty.contains("<a href"));
    }

    /// Expected values, calculated by hand: the range 0.05 to 0.25 with 8 % of 0.2 at both ends is 0.034 to 0.266. With
    /// steps of 0.05, the axis has five values.
    #[test]
    fn axis_ticks_have_round_values() {
        let axis = Axis::covering([0.05, 0.25, f64::NAN].into_iter(), [300.0, 0.0]);
        let texts: Vec<String> = axis.ticks(5).into_iter().map(|(_, text)| text).collect();
        assert_eq!(texts, ["0.05", "0.1", "0.15", "0.2", "0.25"]);
        // The middle of the range is in the middle of the chart, whose vertical coordinate increases downwards.
        assert!((axis.position(0.15) - 150.0).abs() < 1e-9 && axis.position(0.25) < axis.position(0.05));
        let texts = |low: f64, high: f64| {
            Axis::covering([low, high].into_iter(), [0.0, 1.0])
                .ticks(4)
                .into_iter()
                .map(|(_, text)| text)
                .collect::<Vec<_>>()
        };
        assert_eq!(texts(-7.0, 13.0), ["-5", "0", "5", "10"]);
        assert_eq!(texts(10_000.0, 52_000.0), ["10000", "20000", "30000", "40000", "50000"]);
        assert_eq!(texts(3.0, 3.0), ["2", "3", "4"], "equal values have an axis");
    }

    #[test]
    fn an_axis_without_values_is_finite() {
        let axis = Axis::covering(std::iter::empty(), [0.0, 100.0]);
        assert!(axis.ticks(4).len() >= 3 && axis.position(0.5).is_finite());
    }

    fn cell(grid: &str, at: (u32, u32), breaks: usize, median_s: Option<f64>) -> HeatCell {
        HeatCell { grid: grid.to_owned(), row: at.0, column: at.1, films: 12, breaks, median_s }
    }

    /// Expected shades, calculated by hand: 1 and 3 of 12 films are at most a quarter; 4 are more than a quarter; 12
    /// are all films.
    #[test]
    fn the_shade_increases_with_the_fraction_of_broken_films() {
        let shades = [0, 1, 3, 4, 12].map(|breaks| shade_index(&cell("r1c1", (1, 1), breaks, None)));
        assert_eq!(shades, [0, 1, 1, 2, 4]);
    }

    #[test]
    fn grids_in_the_heat_map_lie_as_on_the_panel() {
        let grids = vec![cell("r1c1", (1, 1), 0, None), cell("r2c2", (2, 2), 3, Some(6.04))];
        let html = heat_chart(&HeatMap { films: 12, grids }, "breaks").into_string();
        assert!(html.contains("<td class=\"shade-1\"><strong>3/12</strong><br>6.0 s</td>"), "{html}");
        assert_eq!(html.matches("<td>–</td>").count(), 2, "grids that no film tells of");
        assert!(html.find("shade-0") < html.find("shade-1") && !html.contains("style="));
    }
}
