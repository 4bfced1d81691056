//! Cycles of all cells: a search, and its results as a page, a table or JSON.

use super::frame::{self, time, verdict};
use super::shared::{Shared, archive_error_page};
use axum::Json;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use maud::{Markup, html};
use panelprep_base::verdict::Verdict;
use panelprep_interfaces::archive::ArchiveError;
use panelprep_interfaces::archive::reading::{CycleQuery, CycleRow};
use panelprep_store::history::{Edge, unix_s};
use serde::Deserialize;
use strum::VariantArray;

const PAGE: i64 = 50;
const FILE: i64 = 10_000;

/// The fields of the form; an empty field is ignored.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct SearchForm {
    cell: String,
    panel: String,
    serial: String,
    verdict: String,
    from: String,
    to: String,
    before: String,
}

impl SearchForm {
    fn query(&self, limit: i64) -> Result<CycleQuery, String> {
        let date = |text: &str, edge| match text.trim() {
            "" => Ok(None),
            text => unix_s(text, edge).map(Some).map_err(|error| error.to_string()),
        };
        Ok(CycleQuery {
            cell: self.cell.trim().to_owned(),
            panel: self.panel.trim().to_owned(),
            serial: self.serial.trim().to_owned(),
            verdict: self.verdict.clone(),
            from_unix_s: date(&self.from, Edge::Start)?,
            until_unix_s: date(&self.to, Edge::Behind)?,
            before: self.before(),
            limit,
        })
    }

    /// Returns "TIME,CYCLE,CELL" of the last cycle of the previous page.
    fn before(&self) -> Option<(i64, String, i64)> {
        let mut parts = self.before.splitn(3, ',');
        let (at, cycle, cell) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?, parts.next()?);
        Some((at, cell.to_owned(), cycle))
    }

    fn address(&self, before: &str) -> String {
        let fields = [
            ("cell", self.cell.as_str()),
            ("panel", &self.panel),
            ("serial", &self.serial),
            ("verdict", &self.verdict),
            ("from", &self.from),
            ("to", &self.to),
            ("before", before),
        ];
        let filled: Vec<(&str, &str)> = fields.into_iter().filter(|(_, value)| !value.is_empty()).collect();
        frame::address(&filled)
    }
}

async fn find_cycles(shared: &Shared, form: &SearchForm, limit: i64) -> Result<Vec<CycleRow>, Response> {
    let query = form.query(limit).map_err(|problem| (StatusCode::BAD_REQUEST, problem).into_response())?;
    shared.reader().cycles(&query).await.map_err(|error: ArchiveError| archive_error_page(&error))
}

pub(super) async fn page(State(shared): State<Shared>, Query(form): Query<SearchForm>) -> Response {
    let rows = match find_cycles(&shared, &form, PAGE).await {
        Ok(rows) => rows,
        Err(response) => return response,
    };
    match shared.reader().names().await {
        Ok((panels, cells)) => frame::page("Cycles", "/cycles", None, &body(&form, &rows, &panels, &cells)),
        Err(error) => archive_error_page(&error),
    }
}

pub(super) async fn csv(State(shared): State<Shared>, Query(form): Query<SearchForm>) -> Response {
    match find_cycles(&shared, &form, FILE).await {
        Ok(rows) => frame::csv("cycles", &frame::table(&rows)),
        Err(response) => response,
    }
}

pub(super) async fn json(State(shared): State<Shared>, Query(form): Query<SearchForm>) -> Response {
    match find_cycles(&shared, &form, FILE).await {
        Ok(rows) => Json(rows).into_response(),
        Err(response) => response,
    }
}

fn body(form: &SearchForm, rows: &[CycleRow], panels: &[String], cells: &[String]) -> Markup {
    let verdicts: Vec<&str> = Verdict::VARIANTS.iter().map(|verdict| verdict.keyword()).collect();
    let all = form.address("");
    let next = rows.last().filter(|_| rows.len() as i64 == PAGE);
    html! {
        section.card {
            h2 { "Cycles" }
            form.search method="get" action="/cycles" {
                (select_list("Cell", "cell", &form.cell, cells.iter().map(String::as_str)))
                (select_list("Panel", "panel", &form.panel, panels.iter().map(String::as_str)))
                label { "Serial number" input name="serial" value=(form.serial); }
                (select_list("Verdict", "verdict", &form.verdict, verdicts.into_iter()))
                label { "From (UTC)" input name="from" value=(form.from) placeholder="2026-11-25"; }
                label { "To" input name="to" value=(form.to) placeholder="2026-11-25"; }
                button.primary type="submit" { "Search" }
            }
            p.links { a href={ "/cycles.csv?" (all) } { "CSV" } " · " a href={ "/cycles.json?" (all) } { "JSON" } }
            @if rows.is_empty() { p { "No cycle matches this search." } } @else {
                div.scroll tabindex="0" { table {
                    thead { tr { th { "Began (UTC)" } th { "Cell" } th { "Cycle" } th { "Panel" } th { "Serial number" } th { "Work order" } th { "Verdict" } } }
                    tbody { @for row in rows { tr {
                        td { (time(row.started_unix_s)) }
                        td { (row.cell) }
                        td { a href={ "/cycle?" (frame::address(&[("cell", &row.cell), ("number", &row.cycle.to_string())])) } { (row.cycle) } }
                        td { (row.panel) }
                        td { (row.serial.as_deref().unwrap_or("–")) }
                        td { (row.work_order.as_deref().unwrap_or("–")) }
                        td { (verdict(&row.verdict)) }
                    } } }
                } }
            }
            @if let Some(last) = next {
                @let before = format!("{},{},{}", last.started_unix_s, last.cycle, last.cell);
                p.links { a href={ "/cycles?" (form.address(&before)) } { "Older" } }
            }
        }
    }
}

/// Shows a list from which one item, or none, is chosen.
pub(super) fn select_list<'c>(words: &str, name: &str, chosen: &str, all: impl Iterator<Item = &'c str>) -> Markup {
    html! {
        label { (words) select name=(name) {
            option value="" { "any" }
            @for one in all { option value=(one) selected[one == chosen] { (one) } }
        } }
    }
}
