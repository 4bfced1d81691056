//! Two cycles side by side.

use super::answers;
use super::answers::{Answer, DownloadFormat, reading};
use super::guard::VisitorExtension;
use super::history::verdict_text;
use super::layout::{Frame, local_time};
use super::page_texts::Language;
use super::sessions::Visitor;
use super::state::Web;
use crate::report::format_value;
use axum::Extension;
use axum::extract::{Query, State};
use axum::response::Response;
use maud::{Markup, html};
use panelprep_base::number_text::shortest_text;
use panelprep_base::verdict::{Limit, Verdict};
use panelprep_cell::record::CycleId;
use panelprep_store::history::{CheckPair, Comparison, compare, comparison_table};
use panelprep_store::store::Store;
use serde::Deserialize;
use std::sync::Arc;

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct CyclePair {
    first: i64,
    second: i64,
}

pub(super) async fn page(state: State<Arc<Web>>, by: VisitorExtension, pair: Query<CyclePair>) -> Answer {
    compare_cycles(state, by, pair, DownloadFormat::Page).await
}

pub(super) async fn csv(state: State<Arc<Web>>, by: VisitorExtension, pair: Query<CyclePair>) -> Answer {
    compare_cycles(state, by, pair, DownloadFormat::Csv).await
}

pub(super) async fn json(state: State<Arc<Web>>, by: VisitorExtension, pair: Query<CyclePair>) -> Answer {
    compare_cycles(state, by, pair, DownloadFormat::Json).await
}

async fn compare_cycles(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Query(CyclePair { first, second }): Query<CyclePair>,
    as_what: DownloadFormat,
) -> Answer {
    let read =
        move |store: &Store| Ok(compare(&store.past_cycle(CycleId(first))?, &store.past_cycle(CycleId(second))?));
    let comparison = reading(&web, &visitor, read).await?;
    Ok(match as_what {
        DownloadFormat::Page => comparison_page(&visitor, &body(visitor.language(), &comparison)),
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

fn body(words: Language<'_>, comparison: &Comparison) -> Markup {
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

/// Shortens a hash to its beginning, by which it can be recognised.
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
