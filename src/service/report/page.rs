//! A self-contained HTML page: verdict, values with their limits, pictures. It contains no scripts and loads nothing.
//!
//! A check is a row of the page: the value with its unit, its limit, and the source of the limit.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals, shortest_text};
use panelprep_base::verdict::{Check, Judgement, Limit, LimitSource, Verdict};

/// The content of a page, from top to bottom.
#[derive(Debug, Clone)]
pub struct Page {
    /// HTML before all other parts of the page, such as the sheet to sign; empty if there is none.
    pub first: String,
    /// Heading.
    pub title: String,
    /// One line below the title: what was done with which object.
    pub subtitle: String,
    /// The verdict with its reasons.
    pub judgement: Judgement,
    /// The sections of the page, in order.
    pub sections: Vec<Section>,
    /// The time at which the page was created, and the program, as a separate line; empty if this is not stated.
    pub made: String,
}

/// One section of a page.
#[derive(Debug, Clone)]
pub struct Section {
    /// Heading.
    pub heading: String,
    /// A few sentences that explain the pictures.
    pub text: String,
    /// Numbers.
    pub rows: Vec<Row>,
    /// Pictures.
    pub figures: Vec<Figure>,
}

/// One value with its limit.
#[derive(Debug, Clone)]
pub struct Row {
    /// Name of the value.
    pub name: String,
    /// The value with its unit.
    pub value: String,
    /// The limit with its unit; empty if there is no limit.
    pub allowed: String,
}

impl Row {
    /// Creates a row from its three texts.
    pub fn new(name: &str, value: impl Into<String>, allowed: impl Into<String>) -> Self {
        Row { name: name.to_owned(), value: value.into(), allowed: allowed.into() }
    }
}

/// One picture.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Text that describes the picture, also for readers who cannot see the picture.
    pub caption: String,
    /// The picture, encoded as JPEG.
    pub jpeg: Vec<u8>,
}

const STYLE_SHEET: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:1100px;margin:2rem auto;padding:0 1rem;color:#1a1a1a;\
background:#fff}h1{margin-bottom:0}.sub{color:#555;margin-top:.2rem}.verdict{padding:.6rem 1rem;border-left:.6rem solid;\
background:#f4f4f4;font-size:1.15rem}.good{border-color:#009e73}.doubt{border-color:#e69f00}.bad{border-color:#d55e00}\
table{border-collapse:collapse;margin:.6rem 0}th,td{text-align:left;padding:.15rem 1.2rem .15rem 0;border-bottom:1px solid #ddd;\
font-variant-numeric:tabular-nums}td:nth-child(2){overflow-wrap:anywhere}td:nth-child(3){white-space:nowrap}figure{margin:1rem 0}img{max-width:100%;height:auto;border:1px solid #ccc}\
figcaption{color:#555;font-size:.9rem}@media print{figure{break-inside:avoid}}";

impl Page {
    /// Returns the page as HTML text.
    pub fn html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width,initial-scale=1";
                    title { (self.title) }
                    style { (PreEscaped(STYLE_SHEET)) }
                }
                body {
                    @if !self.first.is_empty() { (PreEscaped(&self.first)) (PreEscaped("\n")) }
                    h1 { (self.title) }
                    p.sub { (self.subtitle) }
                    (verdict(&self.judgement))
                    // Each section is one line of the HTML, and the creation time is another line, so that a person who
                    // compares two pages can ignore that line.
                    @for section in &self.sections { (PreEscaped("\n")) (section) }
                    (PreEscaped("\n"))
                    @if !self.made.is_empty() { p.sub { (self.made) } (PreEscaped("\n")) }
                }
            }
        };
        page.into_string() + "\n"
    }
}

impl Render for Section {
    fn render(&self) -> Markup {
        let has_limits = self.rows.iter().any(|row| !row.allowed.is_empty());
        html! {
            h2 { (self.heading) }
            p { (self.text) }
            @if !self.rows.is_empty() {
                table {
                    @if has_limits { thead { tr { th {} th { "measured" } th { "allowed" } } } }
                    tbody { @for row in &self.rows { (row) } }
                }
            }
            @for figure in &self.figures { (figure) }
        }
    }
}

impl Render for Row {
    fn render(&self) -> Markup {
        html! { tr { td { (self.name) } td { (self.value) } td { (self.allowed) } } }
    }
}

impl Render for Figure {
    fn render(&self) -> Markup {
        let source = format!("data:image/jpeg;base64,{}", STANDARD.encode(&self.jpeg));
        html! { figure { img alt=(self.caption) src=(source); figcaption { (self.caption) } } }
    }
}

fn verdict(judgement: &Judgement) -> Markup {
    // A cycle that was stopped on request also has the verdict `Aborted`, but the page does not show this as a fault.
    let is_stopped =
        judgement.verdict == Verdict::Aborted && judgement.reasons.iter().any(|reason| reason.code == "stopped");
    let word = if is_stopped { "stopped on request" } else { judgement.verdict.keyword() };
    let class = match judgement.verdict {
        _ if is_stopped => "doubt",
        Verdict::Accept | Verdict::Pass => "good",
        Verdict::Review | Verdict::Invalid => "doubt",
        Verdict::Reject | Verdict::Fail | Verdict::Aborted => "bad",
    };
    html! {
        p.verdict.(class) {
            b { (word) }
            @for reason in &judgement.reasons { br; (reason.message) " " small { "(" (reason.code) ")" } }
        }
    }
}

pub(super) const NOT_MEASURED_TEXT: &str = "not measured";

/// Returns a check as a row; `beside` is written after its value. A limit without a file as its source is a limit of
/// the program.
pub fn check_row(check: &Check, beside: &str) -> Row {
    let with_unit = |text: String| format!("{text} {}", check.unit).trim_end().to_owned();
    let (sign, limit) = match check.limit {
        Limit::Unlimited => ("", None),
        Limit::AtMost(limit) => ("≤ ", Some(limit)),
        Limit::AtLeast(limit) => ("≥ ", Some(limit)),
        Limit::Below(limit) => ("< ", Some(limit)),
    };
    let (mut value, mut allowed) = (check.value.map(format_value), limit.map(format_value));
    let is_beyond = !check.is_met();
    if let (true, Some(found), Some(limit)) = (is_beyond && value == allowed, check.value, limit) {
        let [found, limit] = distinguishable_texts(found, limit, decimals(limit));
        (value, allowed) = (Some(found), Some(limit));
    }
    let value = match value {
        None => NOT_MEASURED_TEXT.to_owned(),
        Some(value) if is_beyond => format!("{}{beside}, outside of the limit", with_unit(value)),
        Some(value) => format!("{}{beside}", with_unit(value)),
    };
    let set_by = match &check.set_by {
        Some(LimitSource::Recipe(key)) => format!(" (recipe, {key})"),
        Some(LimitSource::Cell(key)) => format!(" (cell, {key})"),
        Some(LimitSource::Program) | None => String::new(),
    };
    let allowed = allowed.map_or(String::new(), |limit| format!("{sign}{}{set_by}", with_unit(limit)));
    Row::new(&check.name, value, allowed)
}

/// Formats a value with four significant digits, and with all digits before the decimal point; the store contains the
/// full value.
pub fn format_value(value: f64) -> String {
    if value == 0.0 || !value.is_finite() || value.fract() == 0.0 {
        return shortest_text(value);
    }
    let text = fixed_decimals(value, decimals(value)).to_string();
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Returns the number of decimals with which a value has four significant digits.
fn decimals(value: f64) -> usize {
    if value == 0.0 || !value.is_finite() {
        return 0;
    }
    (3 - value.abs().log10().floor() as i32).clamp(0, 9) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::Reason;

    #[test]
    fn a_page_shows_verdict_numbers_and_pictures_and_escapes_text() {
        let reasons = vec![Reason::new("shift_limit", "moved 80 mm, allowed < 60 mm")];
        let page = Page {
            first: String::new(),
            title: "Panel <A & B>".to_owned(),
            subtitle: "seed 1".to_owned(),
            judgement: Judgement { verdict: Verdict::Reject, reasons },
            sections: vec![Section {
                heading: "Where".to_owned(),
                text: "Found.".to_owned(),
                rows: vec![Row::new("rms", "0.1 mm", "≤ 0.25 mm")],
                figures: vec![Figure { caption: "outline".to_owned(), jpeg: vec![1, 2, 3] }],
            }],
            made: "Made today".to_owned(),
        };
        let html = page.html();
        assert!(html.contains("<h1>Panel &lt;A &amp; B&gt;</h1>"));
        assert!(html.contains("class=\"verdict bad\"><b>reject</b><br>moved 80 mm, allowed &lt; 60 mm"));
        assert!(html.contains("<td>0.1 mm</td><td>≤ 0.25 mm</td>"));
        assert!(html.contains("data:image/jpeg;base64,AQID"));
        assert!(!html.contains("http"), "nothing is fetched");
    }

    #[test]
    fn a_cycle_stopped_on_request_is_not_shown_as_a_fault() {
        let of = |code| Judgement { verdict: Verdict::Aborted, reasons: vec![Reason::new(code, "why")] };
        assert!(verdict(&of("stopped")).0.starts_with("<p class=\"verdict doubt\"><b>stopped on request</b>"));
        assert!(verdict(&of("late")).0.starts_with("<p class=\"verdict bad\"><b>aborted</b>"));
    }

    #[test]
    fn a_row_states_the_source_of_its_limit() {
        let check = Check::new("residual", "mm", 0.3);
        let of_recipe = check.clone().with_max(0.25, LimitSource::recipe("locate.max_rms_mm"));
        let row = check_row(&of_recipe, "");
        assert_eq!(
            (&*row.value, &*row.allowed),
            ("0.3 mm, outside of the limit", "≤ 0.25 mm (recipe, locate.max_rms_mm)")
        );
        assert_eq!(check_row(&check.with_max(0.25, LimitSource::Program), "").allowed, "≤ 0.25 mm");
    }
}
