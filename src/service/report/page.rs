//! One self-contained HTML page: verdict, numbers with their limits, pictures. It has no scripts and loads nothing.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};
use panelprep_base::verdict::{Judgement, Verdict};

/// A page from top to bottom.
#[derive(Debug, Clone)]
pub struct Page {
    /// HTML that comes before everything else, such as the page to sign; empty for none.
    pub first: String,
    /// Heading.
    pub title: String,
    /// One line below the title: the action and its object.
    pub subtitle: String,
    /// Result of the cycle.
    pub judgement: Judgement,
    /// The parts, in order.
    pub sections: Vec<Section>,
    /// When and by what the page was made, on a line of its own; empty if that is not stated.
    pub made: String,
}

/// One part of a page.
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

/// One number with its limit.
#[derive(Debug, Clone)]
pub struct Row {
    /// Name of the value.
    pub name: String,
    /// The value with its unit.
    pub value: String,
    /// The limit; empty if there is no limit.
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
    /// The content of the picture, for readers who see it and for those who do not.
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
                    // Each section has its own line in the HTML, and so has the time at which the page was made: a
                    // person who compares two pages can leave that line out.
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
    // A requested stop is not a fault, though there is no other verdict for a cycle without a result.
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
    fn a_cycle_that_was_stopped_on_request_is_not_shown_as_a_fault() {
        let of = |code| Judgement { verdict: Verdict::Aborted, reasons: vec![Reason::new(code, "why")] };
        assert!(verdict(&of("stopped")).0.starts_with("<p class=\"verdict doubt\"><b>stopped on request</b>"));
        assert!(verdict(&of("late")).0.starts_with("<p class=\"verdict bad\"><b>aborted</b>"));
    }
}
