//! The audit trail: who did what, when and from which address.

use super::downloads;
use super::guard::By;
use super::layout::{Frame, local};
use super::reading::{Answer, reading};
use super::state::Web;
use crate::accounts::Role;
use crate::history::Table;
use crate::store::NumberedEntry;
use axum::Extension;
use axum::extract::{Query, State};
use maud::html;
use serde::Deserialize;
use std::sync::Arc;

/// Number of lines on one page, and in one file.
const PAGE: usize = 100;
const FILE: usize = 100_000;

#[derive(Debug, Deserialize)]
pub(super) struct Before {
    before: Option<i64>,
}

/// Shows the newest lines, or the lines before a number.
pub(super) async fn page(
    State(web): State<Arc<Web>>,
    Extension(visitor): By,
    Query(Before { before }): Query<Before>,
) -> Answer {
    let lines = reading(&web, &visitor, move |store| store.audit(before, PAGE)).await?;
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
    let frame = Frame { visitor: &visitor, title: word("audit.title"), here: "/audit", scripts: &[] };
    Ok(frame.page(&body))
}

/// Returns the whole trail as a file.
pub(super) async fn csv(State(web): State<Arc<Web>>, Extension(visitor): By) -> Answer {
    let lines = reading(&web, &visitor, |store| store.audit(None, FILE)).await?;
    Ok(downloads::csv(&visitor, "audit", &table(&lines)))
}

fn table(lines: &[NumberedEntry]) -> Table {
    let columns = ["number", "unix_ms", "who", "role", "from", "what", "subject", "before", "after", "refused"];
    Table::new(&columns).with(lines.iter().map(|NumberedEntry { number, entry }| {
        vec![
            (*number).into(),
            entry.unix_ms.into(),
            entry.who.clone().into(),
            entry.role.map(Role::word).into(),
            entry.from.as_str().into(),
            entry.what.as_str().into(),
            entry.subject.clone().into(),
            entry.before.clone().into(),
            entry.after.clone().into(),
            entry.refused.clone().into(),
        ]
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accounts::AuditEntry;

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
        let csv = table(&[NumberedEntry { number: 3, entry }]).csv().expect("written");
        let row = csv.lines().nth(1).map(str::to_owned);
        assert_eq!(row.as_deref(), Some("3,7,anna,operator,10.0.0.1,log in,'=cmd(),,\"a,\"\"b\"\"\","));
    }
}
