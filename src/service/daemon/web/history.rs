//! The history: a search for cycles with a table of the results, and the comparison of two cycles.

use super::answers;
use super::answers::{Answer, DownloadFormat, read_store};
use super::guard::VisitorExtension;
use super::layout::{Frame, local_time};
use super::page_texts::Language;
use super::sessions::Visitor;
use super::state::Web;
use crate::report::format_value;
use axum::Extension;
use axum::extract::{Query as QueryString, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use maud::{Markup, html};
use panelprep_base::number_text::shortest_text;
use panelprep_base::verdict::{Limit, Reason, Verdict};
use panelprep_cell::record::{CycleId, states_no_part};
use panelprep_store::history::{
    CheckPair, Comparison, DateError, Edge, Hit, Hits, Query, RequiredEnd, compare, comparison_table, hits_table,
    unix_s,
};
use panelprep_store::store::Store;
use serde::Deserialize;
use std::sync::Arc;

/// Number of cycles on one page.
const PAGE_CYCLES: usize = 50;
/// Maximum number of cycles in one file.
const MAX_FILE_CYCLES: usize = panelprep_store::history::MAX_HITS_PER_PAGE;
const VERDICTS: [Verdict; 7] = [
    Verdict::Pass,
    Verdict::Fail,
    Verdict::Invalid,
    Verdict::Review,
    Verdict::Reject,
    Verdict::Accept,
    Verdict::Aborted,
];
/// The entry in the list of verdicts for a cycle that has not ended.
const RUNNING: &str = "running";

/// The fields of the search form; an empty field is ignored.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct SearchForm {
    part: String,
    order: String,
    panel: String,
    operator: String,
    from: String,
    to: String,
    verdict: String,
    text: String,
    before: Option<i64>,
}

impl SearchForm {
    fn query(&self, limit: usize) -> Result<Query, DateError> {
        let filled = |text: &str| Some(text.trim().to_owned()).filter(|text| !text.is_empty());
        let date = |text: &str, edge| filled(text).map(|text| unix_s(&text, edge)).transpose();
        let verdict = VERDICTS.into_iter().find(|verdict| verdict.keyword() == self.verdict).map(RequiredEnd::With);
        Ok(Query {
            serial: filled(&self.part),
            order: filled(&self.order),
            panel: filled(&self.panel),
            operator: filled(&self.operator),
            from_unix_s: date(&self.from, Edge::Start)?,
            until_unix_s: date(&self.to, Edge::Behind)?,
            end: verdict.or_else(|| (self.verdict == RUNNING).then_some(RequiredEnd::Running)),
            words: self.text.split_whitespace().map(str::to_owned).collect(),
            before_cycle: self.before.map(CycleId),
            limit,
        })
    }

    /// Returns the search as the query string of a URL.
    fn address(&self) -> String {
        let fields = [
            ("part", &self.part),
            ("order", &self.order),
            ("panel", &self.panel),
            ("operator", &self.operator),
            ("from", &self.from),
            ("to", &self.to),
            ("verdict", &self.verdict),
            ("text", &self.text),
        ];
        let filled = fields.into_iter().filter(|(_, value)| !value.is_empty());
        form_urlencoded::Serializer::new(String::new()).extend_pairs(filled).finish()
    }
}

pub(super) async fn page(state: State<Arc<Web>>, by: VisitorExtension, form: QueryString<SearchForm>) -> Answer {
    search_cycles(state, by, form, DownloadFormat::Page).await
}

pub(super) async fn csv(state: State<Arc<Web>>, by: VisitorExtension, form: QueryString<SearchForm>) -> Answer {
    search_cycles(state, by, form, DownloadFormat::Csv).await
}

pub(super) async fn json(state: State<Arc<Web>>, by: VisitorExtension, form: QueryString<SearchForm>) -> Answer {
    search_cycles(state, by, form, DownloadFormat::Json).await
}

async fn search_cycles(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    QueryString(form): QueryString<SearchForm>,
    as_what: DownloadFormat,
) -> Answer {
    let query = form.query(if as_what == DownloadFormat::Page { PAGE_CYCLES } else { MAX_FILE_CYCLES }).map_err(
        |error| {
            let message = match as_what {
                DownloadFormat::Page => {
                    history_page(&visitor, &body(visitor.language(), &form, &Hits::default(), Some(&error)))
                }
                DownloadFormat::Csv | DownloadFormat::Json => error.to_string().into_response(),
            };
            (StatusCode::BAD_REQUEST, message).into_response()
        },
    )?;
    let hits = read_store(&web, &visitor, move |store| store.search(&query)).await?;
    Ok(match as_what {
        DownloadFormat::Page => history_page(&visitor, &body(visitor.language(), &form, &hits, None)),
        DownloadFormat::Csv => answers::csv(&visitor, "cycles", &hits_table(&hits.hits)),
        DownloadFormat::Json => answers::json(&hits),
    })
}

fn history_page(visitor: &Visitor, body: &Markup) -> Response {
    let title = visitor.language().text("history.title");
    Frame { visitor, title, here: "/history", scripts: &[] }.page(body)
}

fn body(words: Language<'_>, form: &SearchForm, hits: &Hits, error: Option<&DateError>) -> Markup {
    let word = |key| words.text(key);
    let address = form.address();
    let first = form.before.is_none();
    html! {
        section.card {
            h2 { (word("history.title")) }
            (fields(words, form))
            @if let Some(error) = error { p.bad role="alert" { (error) } }
            p.links {
                a href="/trends" { (word("trends.title")) } " · "
                a href="/alarms" { (word("alarms.title")) } " · "
                a href={ "/history.csv?" (address) } { "CSV" } " · "
                a href={ "/history.json?" (address) } { "JSON" }
            }
        }
        section.card {
            @if hits.hits.is_empty() { p { (word("history.none")) } } @else { (table(words, &hits.hits)) }
            p.links {
                @if !first { a.button href={ "/history?" (address) } { (word("history.newest")) } }
                @if let Some(next) = hits.next { a.button href={ "/history?" (address) "&before=" (next) } { (word("older")) } }
            }
        }
    }
}

fn fields(words: Language<'_>, form: &SearchForm) -> Markup {
    let word = |key| words.text(key);
    let texts = [
        ("part", "run.serial", &form.part),
        ("order", "run.order", &form.order),
        ("panel", "history.panel", &form.panel),
        ("operator", "role.operator", &form.operator),
        ("from", "history.from", &form.from),
        ("to", "history.to", &form.to),
        ("text", "history.text", &form.text),
    ];
    html! {
        form.search method="get" action="/history" {
            @for (name, key, value) in texts {
                label { (word(key)) input name=(name) value=(value) maxlength="200" autocomplete="off"; }
            }
            label {
                (word("history.verdict"))
                select name="verdict" {
                    option value="" { (word("history.any")) }
                    @for verdict in VERDICTS.map(|verdict| verdict.keyword()).into_iter().chain([RUNNING]) {
                        option value=(verdict) selected[form.verdict == verdict] { (verdict_text(words, verdict)) }
                    }
                }
            }
            button.primary type="submit" { (word("history.search")) }
        }
        p.note { (word("history.help")) }
    }
}

/// Returns the word for a verdict in the visitor's language.
pub(super) fn verdict_text(words: Language<'_>, verdict: &str) -> String {
    match verdict {
        RUNNING => words.text("js.state.execute").to_owned(),
        _ => words
            .texts_with_prefix("js.verdict.")
            .get(format!("js.verdict.{verdict}").as_str())
            .map_or(verdict, |word| *word)
            .to_owned(),
    }
}

/// Shows the found cycles; two of them can be selected for a comparison.
fn table(words: Language<'_>, hits: &[Hit]) -> Markup {
    let word = |key| words.text(key);
    html! {
        form method="get" action="/compare" {
            div.scroll tabindex="0" {
                table {
                    thead { tr {
                        @for key in ["compare.first", "compare.second", "run.cycle", "audit.when", "history.panel", "run.serial", "run.order", "role.operator", "history.verdict", "alarms.code"] {
                            th { (word(key)) }
                        }
                    } }
                    tbody { @for hit in hits {
                        tr {
                            @for name in ["first", "second"] {
                                td { label.pick { input type="radio" name=(name) value=(hit.cycle) required aria-label={ (word(if name == "first" { "compare.first" } else { "compare.second" })) " " (hit.cycle) }; } }
                            }
                            td { a href={ "/cycle/" (hit.cycle) } { (hit.cycle) } }
                            td { (local_time(hit.started_unix_s.saturating_mul(1_000))) }
                            td { (hit.panel) }
                            @for name in [&hit.part.serial, &hit.part.order, &hit.part.operator] { td { (name.as_deref().unwrap_or("–")) } }
                            td {
                                @if states_no_part(&hit.reasons) { (word("js.verdict.no_part")) }
                                @else { (verdict_text(words, hit.verdict.map_or(RUNNING, Verdict::keyword))) }
                                @if hit.is_air_run { " (" (word("history.air_run")) ")" }
                            }
                            td { @for (reason, count) in first_reasons_by_code(&hit.reasons) { span title=(reason.message) { (reason.code) } @if count > 1 { " ×" (count) } " " } }
                        }
                    } }
                }
            }
            button type="submit" { (word("compare.do")) }
        }
    }
}

/// Returns the first reason with each code, in their order, and the number of reasons with this code.
fn first_reasons_by_code(reasons: &[Reason]) -> Vec<(&Reason, usize)> {
    let mut counted: Vec<(&Reason, usize)> = Vec::new();
    for reason in reasons {
        match counted.iter_mut().find(|(first, _)| first.code == reason.code) {
            Some((_, count)) => *count += 1,
            None => counted.push((reason, 1)),
        }
    }
    counted
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct CyclePair {
    first: i64,
    second: i64,
}

pub(super) async fn compare_page(
    state: State<Arc<Web>>,
    by: VisitorExtension,
    pair: QueryString<CyclePair>,
) -> Answer {
    compare_cycles(state, by, pair, DownloadFormat::Page).await
}

pub(super) async fn compare_csv(
    state: State<Arc<Web>>,
    by: VisitorExtension,
    pair: QueryString<CyclePair>,
) -> Answer {
    compare_cycles(state, by, pair, DownloadFormat::Csv).await
}

pub(super) async fn compare_json(
    state: State<Arc<Web>>,
    by: VisitorExtension,
    pair: QueryString<CyclePair>,
) -> Answer {
    compare_cycles(state, by, pair, DownloadFormat::Json).await
}

async fn compare_cycles(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    QueryString(CyclePair { first, second }): QueryString<CyclePair>,
    as_what: DownloadFormat,
) -> Answer {
    let read =
        move |store: &Store| Ok(compare(&store.past_cycle(CycleId(first))?, &store.past_cycle(CycleId(second))?));
    let comparison = read_store(&web, &visitor, read).await?;
    Ok(match as_what {
        DownloadFormat::Page => comparison_page(&visitor, &comparison_body(visitor.language(), &comparison)),
        DownloadFormat::Csv => {
            answers::csv(&visitor, &format!("cycles-{first}-{second}"), &comparison_table(&comparison))
        }
        DownloadFormat::Json => answers::json(&comparison),
    })
}

fn comparison_page(visitor: &Visitor, body: &Markup) -> Response {
    let title = visitor.language().text("compare.title");
    Frame { visitor, title, here: "/history", scripts: &[] }.page(body)
}

fn comparison_body(words: Language<'_>, comparison: &Comparison) -> Markup {
    let word = |key| words.text(key);
    let [first, second] = &comparison.cycles;
    let address = format!("first={}&second={}", first.cycle, second.cycle);
    let name = |name: &Option<String>| name.clone().unwrap_or_else(|| "–".to_owned());
    html! {
        section.card {
            h2 { (word("compare.title")) }
            @match comparison.is_same_part {
                Some(true) => p { (word("compare.same_part")) " " (name(&first.part.serial)) },
                Some(false) => p.bad { (word("compare.other_part")) },
                None => p.note { (word("compare.no_part")) },
            }
            p.links { a href={ "/compare.csv?" (address) } { "CSV" } " · " a href={ "/compare.json?" (address) } { "JSON" } }
            div.scroll tabindex="0" { table {
                thead { (head(words, comparison)) }
                tbody {
                    tr { th scope="row" { (word("audit.when")) } @for it in &comparison.cycles { td { (local_time(it.started_unix_s.saturating_mul(1_000))) } } td {} }
                    tr { th scope="row" { (word("run.serial")) } @for it in &comparison.cycles { td { (name(&it.part.serial)) } } td {} }
                    tr { th scope="row" { (word("history.verdict")) } @for it in &comparison.cycles { td { (verdict_text(words, it.verdict.map_or("running", Verdict::keyword))) } } td {} }
                    @for input in &comparison.inputs {
                        tr.differs[!input.is_same] {
                            th scope="row" { (input.name) }
                            @for value in &input.values { td { (value.as_deref().map_or("–".to_owned(), short_hash)) } }
                            td { (word(if input.is_same { "compare.same" } else { "compare.differs" })) }
                        }
                    }
                }
            } }
        }
        section.card {
            h2 { (word("compare.checks")) }
            div.scroll tabindex="0" { table {
                thead { (head(words, comparison)) }
                tbody { @for pair in &comparison.checks { (show_check(pair)) } }
            } }
        }
        section.card {
            h2 { (word("run.grids")) }
            div.scroll tabindex="0" { table {
                thead { (head(words, comparison)) }
                tbody { @for pair in &comparison.grids {
                    tr.differs[pair.cycles[0] != pair.cycles[1]] {
                        th scope="row" { (pair.grid) }
                        @for past in &pair.cycles { td { (past.as_ref().map_or("–".to_owned(), panelprep_store::history::GridPast::describe)) } }
                        td { (word(if pair.cycles[0] == pair.cycles[1] { "compare.same" } else { "compare.differs" })) }
                    }
                } }
            } }
        }
    }
}

fn head(words: Language<'_>, comparison: &Comparison) -> Markup {
    html! { tr {
        td {}
        @for it in &comparison.cycles { th scope="col" { (words.text("run.cycle")) " " a href={ "/cycle/" (it.cycle) } { (it.cycle) } } }
        th scope="col" { (words.text("compare.difference")) }
    } }
}

/// Returns the beginning of a hash, by which it can be recognised.
fn short_hash(text: &str) -> String {
    if text.chars().count() > 20 { text.chars().take(16).chain(['…']).collect() } else { text.to_owned() }
}

/// Shows a check with the values of both cycles, each beside its limit.
fn show_check(pair: &CheckPair) -> Markup {
    let allowed = |limit: Option<Limit>| match limit {
        None | Some(Limit::Unlimited) => String::new(),
        Some(Limit::AtMost(bound)) => format!(" (≤ {})", shortest_text(bound)),
        Some(Limit::AtLeast(bound)) => format!(" (≥ {})", shortest_text(bound)),
        Some(Limit::Below(bound)) => format!(" (< {})", shortest_text(bound)),
    };
    let number = |value: Option<f64>| value.map_or("–".to_owned(), format_value);
    html! {
        tr.differs[pair.difference.is_some_and(|difference| difference != 0.0)] {
            th scope="row" {
                (pair.kind.keyword()) @if pair.pass > 0 { " " (pair.pass) } ": " (pair.name)
                @if !pair.unit.is_empty() { " [" (pair.unit) "]" }
            }
            @for (value, limit) in pair.values.into_iter().zip(pair.limits) { td { (number(value)) (allowed(limit)) } }
            td { (number(pair.difference)) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::web::page_texts::Translations;
    use panelprep_cell::record::PartNames;

    fn hit() -> Hit {
        Hit {
            cycle: CycleId(7),
            started_unix_s: 1_000,
            ended_unix_s: None,
            panel: "wing".to_owned(),
            part: PartNames { serial: Some("<script>alert(1)</script>".to_owned()), ..PartNames::default() },
            verdict: Some(Verdict::Reject),
            is_air_run: true,
            reasons: vec![Reason::new("low_overlap", "\"85 %\"")],
        }
    }

    #[test]
    fn a_form_is_a_query_and_an_address() {
        let form = SearchForm {
            part: " SN&1 ".to_owned(),
            from: "2026-05-31".to_owned(),
            verdict: "running".to_owned(),
            text: "low  overlap".to_owned(),
            ..SearchForm::default()
        };
        let query = form.query(PAGE_CYCLES).expect("a date");
        assert_eq!((query.serial.as_deref(), query.end), (Some("SN&1"), Some(RequiredEnd::Running)));
        assert_eq!((query.words.len(), query.panel), (2, None));
        assert!(form.address().contains("part=+SN%261+&from=2026-05-31"), "{}", form.address());
        assert!(SearchForm { to: "yesterday".to_owned(), ..form }.query(PAGE_CYCLES).is_err());
    }

    #[test]
    fn the_page_has_every_word_and_executes_no_script_in_a_name() {
        let words = Translations::read(None).expect("the program's own");
        for language in ["en", "de"] {
            let hits = Hits { hits: vec![hit()], next: Some(CycleId(7)) };
            let error = unix_s("x", Edge::Start).expect_err("no date");
            let html = body(words.language(Some(language), None), &SearchForm::default(), &hits, Some(&error))
                .into_string();
            assert!(html.contains("&lt;script&gt;") && !html.contains("<script>"), "{html}");
            assert!(
                html.contains("href=\"/cycle/7\"")
                    && html.contains("before=7")
                    && html.contains("&quot;85 %&quot;")
            );
            assert!(
                !html.contains("history.") || html.matches("history.").count() == 2,
                "a key without a word: {html}"
            );
            assert!(!html.contains("style="));
        }
    }
}
