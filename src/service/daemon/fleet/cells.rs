//! The page of all cells with their present state.

use super::shared;
use super::shared::{Shared, archive_error_page, time, verdict};
use axum::Json;
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use maud::{Markup, html};
use panelprep_interfaces::archive::reading::CellNow;
use serde_json::json;

/// Interval at which the page reloads itself, s.
const RELOAD_INTERVAL_S: u32 = 5;
/// Maximum age of the last report of a cell, ms; the state of a cell with an older report is marked as stale. A cell
/// reports its state every two seconds.
const MAX_REPORT_AGE_MS: i64 = 15_000;

pub(super) async fn page(State(shared): State<Shared>) -> Response {
    match shared.reader().cells().await {
        Ok((cells, now_unix_ms)) => shared::page("Cells", "/", Some(RELOAD_INTERVAL_S), &body(&cells, now_unix_ms)),
        Err(error) => archive_error_page(&error),
    }
}

pub(super) async fn json(State(shared): State<Shared>) -> Response {
    let (cells, now_unix_ms) = match shared.reader().cells().await {
        Ok(found) => found,
        Err(error) => return archive_error_page(&error),
    };
    let cells = cells.iter().map(|cell| {
        let last = cell.last.as_ref().map(|(cycle, verdict, at)| json!({"cycle": cycle, "verdict": verdict, "started_unix_s": at}));
        let day = cell.last_day_counts.iter().map(|counted| (counted.verdict.clone(), json!(counted.count)));
        json!({"cell": cell.cell, "heard_unix_ms": cell.heard_unix_ms, "is_stale": is_report_stale(cell, now_unix_ms), "state": cell.state,
            "behind": cell.missing_records, "last": last, "day": serde_json::Map::from_iter(day)})
    });
    Json(json!({"now_unix_ms": now_unix_ms, "cells": cells.collect::<Vec<_>>()})).into_response()
}

fn is_report_stale(cell: &CellNow, now_unix_ms: i64) -> bool {
    cell.heard_unix_ms.is_none_or(|heard| now_unix_ms - heard > MAX_REPORT_AGE_MS)
}

fn body(cells: &[CellNow], now_unix_ms: i64) -> Markup {
    html! {
        section.card {
            h2 { "Cells" }
            @if cells.is_empty() {
                p { "No cell has sent data yet. Set [office] in a cell's file and start its service." }
            } @else {
                div.scroll tabindex="0" {
                    table {
                        thead { tr {
                            th { "Cell" } th { "State" } th { "Cycle" } th { "Needs a person" } th { "Last cycle" } th { "Last 24 h" }
                            th { "Records not here" }
                        } }
                        tbody { @for cell in cells { (row(cell, now_unix_ms)) } }
                    }
                }
            }
            p.links { a href="/cells.json" { "JSON" } }
            p.note { "Times are UTC. A cell is stale if it has not reported for " (MAX_REPORT_AGE_MS / 1_000) " s; \
                      the page then shows its last reported state." }
        }
    }
}

fn row(cell: &CellNow, now_unix_ms: i64) -> Markup {
    let stale = is_report_stale(cell, now_unix_ms);
    let state = cell.state.as_ref();
    let needs = state.into_iter().flat_map(|state| state.reasons.iter().chain(&state.standing));
    html! {
        tr.(if stale { "stale" } else { "live" }) {
            th scope="row" { a href={ "/cycles?" (shared::address(&[("cell", &cell.cell)])) } { (cell.cell) } }
            td {
                @match state.and_then(|state| state.state.as_deref()) {
                    Some(word) => strong { (word) },
                    None => "–",
                }
                @if stale {
                    br;
                    "⚠ stale"
                    @if let Some(heard) = cell.heard_unix_ms { " since " (time(heard.div_euclid(1_000))) } @else { ": no state was ever reported" }
                }
            }
            td {
                @if let Some(state) = state {
                    @if let Some(cycle) = state.cycle { (cycle) " " }
                    (state.panel.as_deref().unwrap_or(""))
                    @if let Some(phase) = &state.phase { ", " (phase) }
                    @if let Some([at, of]) = state.waypoint { ", waypoint " (at) " of " (of) }
                }
            }
            td { @for alarm in needs { div { "⚠ " (alarm.message) " (" (alarm.code) ")" } } }
            td {
                @if let Some((cycle, word, at)) = &cell.last {
                    a href={ "/cycle?" (shared::address(&[("cell", &cell.cell), ("number", &cycle.to_string())])) } { "cycle " (cycle) }
                    " " (verdict(word)) br; (time(*at))
                }
            }
            td { @for counted in &cell.last_day_counts { div { (counted.count) " × " (verdict(&counted.verdict)) } } }
            td { @match cell.missing_records { Some(0) => "none", Some(behind) => { "⚠ " (behind) }, None => "not reported" } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cell::CellName;
    use panelprep_store::office::{CellState, ReasonText};

    #[test]
    fn a_cell_without_reports_is_stale_and_its_texts_are_escaped() {
        let mut state = CellState::new(&CellName::new("cell-1").expect("a name"));
        state.state = Some("execute".to_owned());
        state.standing =
            vec![ReasonText { code: "disk_scarce".to_owned(), message: "<b>5 MB</b> are free".to_owned() }];
        let cell = CellNow {
            cell: "cell-1".to_owned(),
            heard_unix_ms: Some(1_000_000),
            state: Some(state),
            missing_records: Some(3),
            last: None,
            last_day_counts: Vec::new(),
        };
        let fresh = body(std::slice::from_ref(&cell), 1_000_000 + MAX_REPORT_AGE_MS).into_string();
        assert!(!fresh.contains("stale since") && fresh.contains("<strong>execute</strong>"), "{fresh}");
        assert!(
            fresh.contains("⚠ &lt;b&gt;5 MB&lt;/b&gt; are free (disk_scarce)") && fresh.contains("⚠ 3"),
            "{fresh}"
        );
        let late = body(&[cell], 1_000_001 + MAX_REPORT_AGE_MS).into_string();
        assert!(late.contains("⚠ stale since <time>1970-01-01 00:16:40"), "{late}");
    }
}
