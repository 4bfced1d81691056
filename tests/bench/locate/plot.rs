//! A plot of error against time with logarithmic axes and a colour for each method.

use std::fmt::Write as _;

/// The result of one method on one scan.
pub struct Run {
    /// Name of the method.
    pub method: String,
    /// Seed of the scan.
    pub seed: u64,
    /// Duration of the localization, ms.
    pub ms: f64,
    /// Mean error over the panel, mm.
    pub error_mm: f64,
}

/// Returns the methods in the order of their first run.
pub fn methods(runs: &[Run]) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for run in runs {
        if !found.contains(&run.method) {
            found.push(run.method.clone());
        }
    }
    found
}

/// Colours that most people can distinguish (Okabe & Ito).
const COLOURS: [&str; 8] = ["#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000", "#999999"];
const SIZE: [f64; 2] = [760.0, 460.0];
const LEFT: f64 = 70.0;
const RIGHT: f64 = 230.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 50.0;
/// Minimum and maximum power of ten on the time axis, ms.
const MS: [f64; 2] = [1.0, 5.0];
/// Minimum and maximum power of ten on the error axis, mm.
const MM: [f64; 2] = [-2.0, 3.0];

/// Returns the plot as an SVG document.
pub fn svg(runs: &[Run]) -> String {
    let across =
        |ms: f64| LEFT + (ms.log10().clamp(MS[0], MS[1]) - MS[0]) / (MS[1] - MS[0]) * (SIZE[0] - LEFT - RIGHT);
    let up = |mm: f64| {
        let share = (mm.log10().clamp(MM[0], MM[1]) - MM[0]) / (MM[1] - MM[0]);
        SIZE[1] - BOTTOM - share * (SIZE[1] - TOP - BOTTOM)
    };
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"{LEFT}\" y=\"22\" font-size=\"15\">{}</text>\n",
        SIZE[0],
        SIZE[1],
        title(runs)
    );
    for power in MS[0] as i32..=MS[1] as i32 {
        let x = across(10f64.powi(power));
        let (low, high) = (SIZE[1] - BOTTOM, TOP);
        let _ = writeln!(svg, "<line x1=\"{x}\" y1=\"{low}\" x2=\"{x}\" y2=\"{high}\" stroke=\"#ddd\"/>");
        let _ = writeln!(
            svg,
            "<text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{} ms</text>",
            low + 18.0,
            10f64.powi(power)
        );
    }
    for power in MM[0] as i32..=MM[1] as i32 {
        let (y, right) = (up(10f64.powi(power)), SIZE[0] - RIGHT);
        let _ = writeln!(svg, "<line x1=\"{LEFT}\" y1=\"{y}\" x2=\"{right}\" y2=\"{y}\" stroke=\"#ddd\"/>");
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{} mm</text>",
            LEFT - 6.0,
            y + 4.0,
            10f64.powi(power)
        );
    }
    for (index, method) in methods(runs).iter().enumerate() {
        let colour = COLOURS[index % COLOURS.len()];
        for run in runs.iter().filter(|run| run.method == *method) {
            let (x, y) = (across(run.ms), up(run.error_mm));
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{colour}\" fill-opacity=\"0.7\"/>"
            );
        }
        let (x, y) = (SIZE[0] - RIGHT + 18.0, TOP + 12.0 + 22.0 * index as f64);
        let _ = writeln!(svg, "<circle cx=\"{x}\" cy=\"{y}\" r=\"5\" fill=\"{colour}\"/>");
        let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\">{method}</text>", x + 12.0, y + 4.0);
    }
    svg.push_str("</svg>\n");
    svg
}

fn title(runs: &[Run]) -> String {
    let mut seeds: Vec<u64> = runs.iter().map(|run| run.seed).collect();
    seeds.sort_unstable();
    seeds.dedup();
    format!("{} scans: mean error over the panel against time", seeds.len())
}
