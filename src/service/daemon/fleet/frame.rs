//! The frame around every page.

use crate::daemon::web::csv_file;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use maud::{DOCTYPE, Markup, html};
use panelprep_base::number_text::{utc_day, utc_text};
use panelprep_interfaces::archive::reading::CycleRow;
use panelprep_store::history::{Cell, Table};

/// The pages: path and title.
const PAGES: [(&str, &str); 5] = [
    ("/", "Cells"),
    ("/cycles", "Cycles"),
    ("/numbers", "Numbers"),
    ("/verifications", "Verifications"),
    ("/recipes", "Recipes"),
];

/// Returns the whole page; it reloads after `again_s` seconds, if that is set.
pub(super) fn page(title: &str, here: &str, again_s: Option<u32>, body: &Markup) -> Response {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width,initial-scale=1";
                @if let Some(again_s) = again_s {
                    meta name="again" content=(again_s);
                    script type="module" src="/fleet.js" {}
                }
                title { (title) " – Panelprep office" }
                link rel="stylesheet" href="/page.css";
            }
            body {
                a.skip href="#main" { "To the content" }
                header {
                    nav aria-label="Pages" {
                        @for (path, word) in PAGES {
                            a href=(path) aria-current=[(path == here).then_some("page")] { (word) }
                        }
                    }
                    @if !here.is_empty() {
                        div.who { form method="post" action="/logout" { button.plain type="submit" { "Log out" } } }
                    }
                }
                main #main { h1.hidden { (title) } (body) }
            }
        }
    };
    ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], page.into_string()).into_response()
}

/// Shows a time with its seconds, in UTC.
pub(super) fn time(unix_s: i64) -> Markup {
    html! { time { (utc_text(unix_s)) } }
}

/// A day, UTC.
pub(super) fn day(unix_s: i64) -> Markup {
    html! { time { (utc_day(unix_s)) } }
}

/// Shows a mark with the word of the verdict: a verdict is never shown by colour only.
pub(super) fn verdict(word: &str) -> Markup {
    let mark = match word {
        "pass" | "accept" => "✔",
        "fail" | "reject" | "aborted" => "✖",
        _ => "⚠",
    };
    html! { span.verdict { (mark) " " (word) } }
}

/// Returns the cycles as a table for a spreadsheet.
pub(super) fn table(rows: &[CycleRow]) -> Table {
    let text = |text: &Option<String>| text.clone().map_or(Cell::Empty, Cell::Text);
    let columns = [
        "cell",
        "cycle",
        "started_unix_s",
        "ended_unix_s",
        "panel",
        "serial",
        "work_order",
        "operator",
        "verdict",
        "recipe_hash",
        "program_version",
    ];
    Table::new(&columns).with_rows(rows.iter().map(|row| {
        vec![
            Cell::Text(row.cell.clone()),
            Cell::Whole(row.cycle),
            Cell::Whole(row.started_unix_s),
            row.ended_unix_s.map_or(Cell::Empty, Cell::Whole),
            Cell::Text(row.panel.clone()),
            text(&row.serial),
            text(&row.work_order),
            text(&row.operator),
            Cell::Text(row.verdict.clone()),
            Cell::Text(row.recipe_hash.clone()),
            Cell::Text(row.program_version.clone()),
        ]
    }))
}

/// Returns a table as a file; `name` is the file name without its extension.
pub(super) fn csv(name: &str, table: &Table) -> Response {
    csv_file(name, table)
        .unwrap_or_else(|error| (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response())
}

/// Returns the pairs as a part of an address.
pub(super) fn address(pairs: &[(&str, &str)]) -> String {
    form_urlencoded::Serializer::new(String::new()).extend_pairs(pairs).finish()
}
