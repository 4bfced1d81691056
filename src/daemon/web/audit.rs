//! The audit trail: who did what, when and from where.

use super::guard::By;
use super::layout::{Frame, failed, local};
use super::state::{Web, blocking};
use crate::store::NumberedEntry;
use axum::Extension;
use axum::extract::{Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use maud::html;
use serde::Deserialize;
use std::sync::Arc;

/// Lines of one page, and of one file.
const PAGE: usize = 100;
const FILE: usize = 100_000;

#[derive(Debug, Deserialize)]
pub(super) struct Before {
    before: Option<i64>,
}

/// The newest lines, or those before a number.
pub(super) async fn page(
    State(web): State<Arc<Web>>,
    Extension(visitor): By,
    Query(Before { before }): Query<Before>,
) -> Response {
    let lines = match blocking(move || web.read(|store| store.audit(before, PAGE))).await {
        Some(Ok(lines)) => lines,
        Some(Err(error)) => return failed(&visitor, &error),
        None => return StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    };
    let words = visitor.language();
    let word = |key| words.word(key);
    let older = lines.last().filter(|_| lines.len() == PAGE).map(|line| line.number);
    let body = html! {
        section.card {
            h2 { (word("audit.title")) }
            p { a href="/audit.csv" { "CSV" } }
            div.scroll tabindex="0" {
                table {
                    thead { tr {
                        @for key in ["audit.number", "audit.when", "audit.who", "audit.from", "audit.what", "audit.subject", "audit.before", "audit.after", "audit.refused"] {
                            th { (word(key)) }
                        }
                    } }
                    tbody { @for NumberedEntry { number, entry } in &lines {
                        tr.refused[entry.refused.is_some()] {
                            td { (number) }
                            td { (local(entry.unix_ms)) }
                            td { (entry.who.as_deref().unwrap_or("–")) @if let Some(role) = entry.role { " (" (role.word()) ")" } }
                            td { (entry.from) }
                            td { (entry.what) }
                            @for text in [&entry.subject, &entry.before, &entry.after, &entry.refused] { td { (text.as_deref().unwrap_or("")) } }
                        }
                    } }
                }
            }
            @if let Some(number) = older { p { a.button href={ "/audit?before=" (number) } { (word("older")) } } }
        }
    };
    Frame { visitor: &visitor, title: word("audit.title"), here: "/audit", scripts: &[] }.page(&body)
}

/// All of it as a file.
pub(super) async fn csv(State(web): State<Arc<Web>>, Extension(visitor): By) -> Response {
    let lines = match blocking(move || web.read(|store| store.audit(None, FILE))).await {
        Some(Ok(lines)) => lines,
        Some(Err(error)) => return failed(&visitor, &error),
        None => return StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    };
    match written(&lines) {
        Ok(bytes) => {
            let name = "attachment; filename=\"audit.csv\"";
            ([(header::CONTENT_TYPE, "text/csv; charset=utf-8"), (header::CONTENT_DISPOSITION, name)], bytes)
                .into_response()
        }
        Err(error) => failed(&visitor, &error),
    }
}

fn written(lines: &[NumberedEntry]) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record([
        "number", "unix_ms", "who", "role", "from", "what", "subject", "before", "after", "refused",
    ])?;
    for NumberedEntry { number, entry } in lines {
        let text = |text: &Option<String>| cell(text.as_deref().unwrap_or(""));
        writer.write_record([
            number.to_string(),
            entry.unix_ms.to_string(),
            text(&entry.who),
            entry.role.map_or("", |role| role.word()).to_owned(),
            cell(&entry.from),
            cell(&entry.what),
            text(&entry.subject),
            text(&entry.before),
            text(&entry.after),
            text(&entry.refused),
        ])?;
    }
    writer.into_inner().map_err(|error| error.into_error().into())
}

/// A text that no spreadsheet takes for a formula.
fn cell(text: &str) -> String {
    let is_formula = text.starts_with(['=', '+', '-', '@', '\t', '\r']);
    if is_formula { format!("'{text}") } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accounts::{AuditEntry, Role};

    #[test]
    fn a_line_is_a_row_and_no_formula() {
        let entry = AuditEntry {
            unix_ms: 7,
            who: Some("anna".to_owned()),
            role: Some(Role::Operator),
            from: "10.0.0.1".to_owned(),
            what: "log in".to_owned(),
            subject: Some("=cmd()".to_owned()),
            before: None,
            after: Some("a,\"b\"".to_owned()),
            refused: None,
        };
        let csv = written(&[NumberedEntry { number: 3, entry }]).expect("written");
        let row = String::from_utf8(csv).expect("text").lines().nth(1).map(str::to_owned);
        assert_eq!(row.as_deref(), Some("3,7,anna,operator,10.0.0.1,log in,'=cmd(),,\"a,\"\"b\"\"\","));
    }
}
