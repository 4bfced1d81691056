//! Two cycles side by side.

use super::downloads::{self, Form};
use super::guard::By;
use super::history::verdict_word;
use super::layout::{Frame, local};
use super::page_texts::Language;
use super::reading::{Answer, reading};
use super::state::Web;
use super::visitor::Visitor;
use crate::history::{CheckPair, Comparison, compare, comparison_table};
use crate::number_text::plain;
use crate::record::CycleId;
use crate::report::shown;
use crate::store::Store;
use crate::verdict::{Limit, Verdict};
use axum::Extension;
use axum::extract::{Query, State};
use axum::response::Response;
use maud::{Markup, html};
use serde::Deserialize;
use std::sync::Arc;

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct Pair {
    first: i64,
    second: i64,
}

pub(super) async fn page(state: State<Arc<Web>>, by: By, pair: Query<Pair>) -> Answer {
    compared(state, by, pair, Form::Page).await
}

pub(super) async fn csv(state: State<Arc<Web>>, by: By, pair: Query<Pair>) -> Answer {
    compared(state, by, pair, Form::Csv).await
}

pub(super) async fn json(state: State<Arc<Web>>, by: By, pair: Query<Pair>) -> Answer {
    compared(state, by, pair, Form::Json).await
}

async fn compared(
    State(web): State<Arc<Web>>,
    Extension(visitor): By,
    Query(Pair { first, second }): Query<Pair>,
    as_what: Form,
) -> Answer {
    let read =
        move |store: &Store| Ok(compare(&store.past_cycle(CycleId(first))?, &store.past_cycle(CycleId(second))?));
    let comparison = reading(&web, &visitor, read).await?;
    Ok(match as_what {
        Form::Page => framed(&visitor, &body(visitor.language(), &comparison)),
        Form::Csv => downloads::csv(&visitor, &format!("cycles-{first}-{second}"), &comparison_table(&comparison)),
        Form::Json => downloads::json(&comparison),
    })
}

fn framed(visitor: &Visitor, body: &Markup) -> Response {
    let title = visitor.language().word("compare.title");
    Frame { visitor, title, here: "/history", scripts: &[] }.page(body)
}

fn body(words: Language<'_>, comparison: &Comparison) -> Markup {
    let word = |key| words.word(key);
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
                    tr { th scope="row" { (word("audit.when")) } @for it in &comparison.cycles { td { (local(it.started_unix_s.saturating_mul(1_000))) } } td {} }
                    tr { th scope="row" { (word("run.serial")) } @for it in &comparison.cycles { td { (name(&it.part.serial)) } } td {} }
                    tr { th scope="row" { (word("history.verdict")) } @for it in &comparison.cycles { td { (verdict_word(words, it.verdict.map_or("running", Verdict::word))) } } td {} }
                    @for input in &comparison.inputs {
                        tr.differs[!input.is_same] {
                            th scope="row" { (input.name) }
                            @for value in &input.values { td { (value.as_deref().map_or("–".to_owned(), short)) } }
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
                tbody { @for pair in &comparison.checks { (check(pair)) } }
            } }
        }
        section.card {
            h2 { (word("run.grids")) }
            div.scroll tabindex="0" { table {
                thead { (head(words, comparison)) }
                tbody { @for pair in &comparison.grids {
                    tr.differs[pair.cycles[0] != pair.cycles[1]] {
                        th scope="row" { (pair.grid) }
                        @for past in &pair.cycles { td { (past.as_ref().map_or("–".to_owned(), crate::history::GridPast::words)) } }
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
        @for it in &comparison.cycles { th scope="col" { (words.word("run.cycle")) " " a href={ "/cycle/" (it.cycle) } { (it.cycle) } } }
        th scope="col" { (words.word("compare.difference")) }
    } }
}

/// Shortens a hash to its beginning, by which it can be recognised.
fn short(text: &str) -> String {
    if text.chars().count() > 20 { text.chars().take(16).chain(['…']).collect() } else { text.to_owned() }
}

/// Shows a check with the values of both cycles, each beside its limit.
fn check(pair: &CheckPair) -> Markup {
    let allowed = |limit: Option<Limit>| match limit {
        None | Some(Limit::Unlimited) => String::new(),
        Some(Limit::AtMost(bound)) => format!(" (≤ {})", plain(bound)),
        Some(Limit::AtLeast(bound)) => format!(" (≥ {})", plain(bound)),
        Some(Limit::Below(bound)) => format!(" (< {})", plain(bound)),
    };
    let number = |value: Option<f64>| value.map_or("–".to_owned(), shown);
    html! {
        tr.differs[pair.difference.is_some_and(|difference| difference != 0.0)] {
            th scope="row" {
                (pair.kind.word()) @if pair.pass > 0 { " " (pair.pass) } ": " (pair.name)
                @if !pair.unit.is_empty() { " [" (pair.unit) "]" }
            }
            @for (value, limit) in pair.values.into_iter().zip(pair.limits) { td { (number(value)) (allowed(limit)) } }
            td { (number(pair.difference)) }
        }
    }
}
