//! Cycles of all cells: a search with its results as a page, a table or JSON; and the page of one cycle from the
//! archive, with the signed content, all measured values with their limits, and the pictures.

use super::shared;
use super::shared::{Shared, archive_error_page, time, verdict};
use crate::report::check_row;
use axum::Json;
use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use maud::{Markup, html};
use panelprep_base::verdict::Verdict;
use panelprep_cell::files::content_hash;
use panelprep_interfaces::archive::ArchiveError;
use panelprep_interfaces::archive::reading::{CycleQuery, CycleRow, Record, RecordSignature};
use panelprep_store::history::{Edge, unix_s};
use panelprep_store::signing::{SignedCycle, exported_files};
use serde::Deserialize;
use serde_json::{Value, json};
use strum::VariantArray;

const PAGE: i64 = 50;
const FILE: i64 = 10_000;

/// The fields of the search form; an empty field is ignored.
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

    /// Returns time, cycle and cell of the last cycle on the previous page, from the text "TIME,CYCLE,CELL".
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
        shared::address(&filled)
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
        Ok((panels, cells)) => shared::page("Cycles", "/cycles", None, &body(&form, &rows, &panels, &cells)),
        Err(error) => archive_error_page(&error),
    }
}

pub(super) async fn csv(State(shared): State<Shared>, Query(form): Query<SearchForm>) -> Response {
    match find_cycles(&shared, &form, FILE).await {
        Ok(rows) => shared::csv("cycles", &shared::table(&rows)),
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
                        td { a href={ "/cycle?" (shared::address(&[("cell", &row.cell), ("number", &row.cycle.to_string())])) } { (row.cycle) } }
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

/// Returns a selection list from which a person chooses one item or none.
pub(super) fn select_list<'c>(words: &str, name: &str, chosen: &str, all: impl Iterator<Item = &'c str>) -> Markup {
    html! {
        label { (words) select name=(name) {
            option value="" { "any" }
            @for one in all { option value=(one) selected[one == chosen] { (one) } }
        } }
    }
}

/// The key of a cycle: its cell and its number.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct CycleKey {
    cell: String,
    number: i64,
}

async fn record(shared: &Shared, CycleKey { cell, number }: &CycleKey) -> Result<Record, Response> {
    match shared.reader().record(cell, *number).await {
        Ok(Some(record)) => Ok(record),
        Ok(None) => {
            let words = format!("The archive has no cycle {number} of cell {}.", cell.escape_debug());
            Err((StatusCode::NOT_FOUND, words).into_response())
        }
        Err(error) => Err(archive_error_page(&error)),
    }
}

pub(super) async fn cycle_page(State(shared): State<Shared>, Query(key): Query<CycleKey>) -> Response {
    match record(&shared, &key).await {
        Ok(record) => shared::page("Cycle", "/cycles", None, &cycle_body(&record)),
        Err(response) => response,
    }
}

pub(super) async fn cycle_json(State(shared): State<Shared>, Query(key): Query<CycleKey>) -> Response {
    let Record { row, signed, statement } = match record(&shared, &key).await {
        Ok(record) => record,
        Err(response) => return response,
    };
    let signed = signed.iter().map(|one| {
        let RecordSignature { statement, record_hash, unix_ms, person } = one;
        json!({"statement": statement, "record_hash": record_hash, "unix_ms": unix_ms, "person": person})
    });
    Json(json!({"cycle": row, "signed": signed.collect::<Vec<_>>(), "record": statement.map(|cycle| cycle.record)}))
        .into_response()
}

/// Serves a file that a record names: a picture as a picture, any other file as text that no browser executes.
pub(super) async fn serve_file(State(shared): State<Shared>, Path(hash): Path<String>) -> Response {
    let reader = shared.reader().clone();
    let Ok(Some(bytes)) = tokio::task::spawn_blocking(move || reader.file(&hash)).await else {
        return (
            StatusCode::NOT_FOUND,
            "This file is missing in the archive or damaged. Run panelprep archive check.",
        )
            .into_response();
    };
    let kind = match bytes.as_slice() {
        [0xff, 0xd8, ..] => "image/jpeg",
        [0x89, b'P', b'N', b'G', ..] => "image/png",
        _ => "text/plain; charset=utf-8",
    };
    // The name of the file is its hash, so its content never changes.
    ([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "private, max-age=31536000, immutable")], bytes)
        .into_response()
}

fn cycle_body(Record { row, signed, statement }: &Record) -> Markup {
    let reasons: Vec<Value> = serde_json::from_str(&row.reasons).unwrap_or_default();
    let text = |reason: &Value, key: &str| reason.get(key).and_then(Value::as_str).unwrap_or("").to_owned();
    let address = shared::address(&[("cell", &row.cell), ("number", &row.cycle.to_string())]);
    html! {
        section.card {
            h2 { "Cycle " (row.cycle) " of cell " (row.cell) ": " (verdict(&row.verdict)) }
            @for reason in &reasons { p { (text(reason, "message")) " (" (text(reason, "code")) ")" } }
            table { tbody {
                tr { th { "Began (UTC)" } td { (time(row.started_unix_s)) } }
                tr { th { "Ended" } td { @if let Some(ended) = row.ended_unix_s { (time(ended)) } @else { "–" } } }
                tr { th { "Panel" } td { (row.panel) } }
                tr { th { "Serial number" } td { (row.serial.as_deref().unwrap_or("–")) } }
                tr { th { "Work order" } td { (row.work_order.as_deref().unwrap_or("–")) } }
                tr { th { "Operator" } td { (row.operator.as_deref().unwrap_or("–")) } }
                tr { th { "Recipe" } td { a href={ "/recipe?" (shared::address(&[("hash", &row.recipe_hash)])) } { (row.recipe_hash) } } }
                tr { th { "Program" } td { (row.program_version) } }
            } }
            p.links { a href={ "/cycle.json?" (address) } { "JSON" } }
        }
        section.card {
            h2 { "Signatures" }
            @if signed.is_empty() { p { "⚠ The signed record of this cycle has not arrived yet." } }
            ul { @for one in signed { li { (signature(one)) } } }
        }
        @if let Some(cycle) = statement { (findings(cycle)) (files(cycle)) }
    }
}

fn signature(RecordSignature { statement, record_hash, unix_ms, person }: &RecordSignature) -> Markup {
    html! {
        (time(unix_ms.div_euclid(1_000))) ": "
        @match person {
            Some((name, meaning)) => { strong { (name) } ", " (meaning) },
            None => "signed by the cell",
        }
        ", record number " (statement) ", SHA-256 " code { (record_hash) }
    }
}

/// Shows every check of the record; a record of another version of the program is only available as JSON.
fn findings(cycle: &SignedCycle) -> Markup {
    let Ok(record) = cycle.cycle_record() else {
        return html! { section.card { p { "This record was written by another version of the program: open it as \
        JSON." } } };
    };
    html! {
        @for finding in &record.findings {
            section.card {
                h2 { (finding.kind.keyword()) @if finding.pass > 0 { ", after pass " (finding.pass) } ": " (verdict(finding.judgement.verdict.keyword())) }
                @for reason in &finding.judgement.reasons { p { (reason.message) " (" (reason.code) ")" } }
                @if !finding.checks.is_empty() {
                    div.scroll tabindex="0" { table {
                        thead { tr { th { "Number" } th { "Value" } th { "Allowed" } } }
                        tbody { @for check in &finding.checks { @let row = check_row(check, ""); tr { td { (row.name) } td { (row.value) } td { (row.allowed) } } } }
                    } }
                }
                div.evidence { @for picture in &finding.pictures {
                    figure {
                        a href={ "/file/" (picture.hash) } { img src={ "/file/" (picture.hash) } alt=(picture.caption) loading="lazy"; }
                        figcaption { (picture.caption) }
                    }
                } }
            }
        }
    }
}

fn files(cycle: &SignedCycle) -> Markup {
    let named = exported_files(cycle).into_iter().filter(|(name, _)| !name.starts_with("picture "));
    html! {
        section.card {
            h2 { "Files used by the cycle" }
            ul { @for (name, hash) in named { li { a href={ "/file/" (hash) } { (name) } " " code { (hash) } } } }
            p.note { "The SHA-256 of an empty file is " code { (content_hash(b"")) } "; each file here has the SHA-256 that the signed record names." }
        }
    }
}
