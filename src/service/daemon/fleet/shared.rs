//! The parts that all pages share: access to the archive, the sessions of people, and the frame around every page.

use crate::daemon::people::{FailedLogins, PasswordHashing, left_out_text};
use crate::daemon::web::{Sessions, csv_file};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use maud::{DOCTYPE, Markup, html};
use panelprep_base::number_text::{utc_day, utc_text};
use panelprep_cell::accounts;
use panelprep_cell::accounts::Lockout;
use panelprep_interfaces::archive::ArchiveError;
use panelprep_interfaces::archive::reading::{CycleRow, Reader};
use panelprep_store::history::{Cell, Table};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Maximum time between two requests in a session, s; after a longer time the session ends.
const MAX_IDLE_S: f64 = 8.0 * 3_600.0;
/// Maximum number of sessions of one account.
const MAX_SESSIONS: usize = 5;

/// The data that all pages share. Clones share the same data.
#[derive(Clone)]
pub(super) struct Shared(Arc<SharedParts>);

struct SharedParts {
    reader: Reader,
    is_tls: bool,
    started: Instant,
    sessions: Mutex<Sessions>,
    lockout: Mutex<Lockout>,
    hashing: PasswordHashing,
    failed_logins: FailedLogins,
}

impl Shared {
    pub fn new(reader: Reader, is_tls: bool) -> Self {
        Shared(Arc::new(SharedParts {
            reader,
            is_tls,
            started: Instant::now(),
            sessions: Mutex::new(Sessions::new(MAX_IDLE_S, MAX_SESSIONS)),
            lockout: Mutex::default(),
            hashing: PasswordHashing::default(),
            failed_logins: FailedLogins::new(Instant::now()),
        }))
    }

    pub fn reader(&self) -> &Reader {
        &self.0.reader
    }

    pub fn is_tls(&self) -> bool {
        self.0.is_tls
    }

    pub fn now_s(&self) -> f64 {
        self.0.started.elapsed().as_secs_f64()
    }

    pub fn sessions(&self) -> MutexGuard<'_, Sessions> {
        self.0.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock_lockout(&self) -> MutexGuard<'_, Lockout> {
        self.0.lockout.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Logs a failed log-in. If there are many within a minute, they are only counted, and their number is logged at
    /// the end of the minute.
    pub fn log_failed_login(&self, name: &str) {
        let counted = self.0.failed_logins.count();
        let left_out =
            |count: Option<u64>| count.into_iter().for_each(|count| tracing::warn!("{}", left_out_text(count)));
        left_out(counted.left_out);
        if counted.is_written {
            tracing::warn!(
                "{}: wrong name or password at the log-in to the web page of the office server",
                name.escape_debug()
            );
        }
        if let Some(after) = counted.report_after {
            let shared = self.clone();
            tokio::spawn(async move {
                tokio::time::sleep(after).await;
                left_out(shared.0.failed_logins.over());
            });
        }
    }

    /// Checks a password against the hash of an account, one password at a time, and counts a wrong password. The check
    /// takes the same time if the account does not exist. Returns `None` if the program is ending.
    pub async fn check_password(
        &self,
        name: String,
        password: String,
        hash: Option<String>,
    ) -> Option<PasswordCheck> {
        let shared = self.clone();
        let judge = move || {
            let who = (name.as_str(), hash.is_some());
            if let Some(left_s) = shared.lock_lockout().pauses_s(who, shared.now_s()) {
                return PasswordCheck::Pauses(left_s);
            }
            match accounts::is_correct_password(&password, hash.as_deref().unwrap_or_default()) {
                true => shared.lock_lockout().record_success(&name),
                false => {
                    shared.lock_lockout().record_failure(who, shared.now_s());
                    return PasswordCheck::Wrong;
                }
            }
            PasswordCheck::Right
        };
        self.0.hashing.run(judge).await
    }
}

/// The result of a password check.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum PasswordCheck {
    Right,
    Wrong,
    /// The password was not checked: log-ins to this account are blocked for this number of seconds.
    Pauses(f64),
}

/// Returns the page that is shown if the archive cannot be read.
pub(super) fn archive_error_page(error: &ArchiveError) -> Response {
    tracing::warn!("{error}");
    (StatusCode::SERVICE_UNAVAILABLE, format!("The archive cannot be read now: {error}. Load the page again."))
        .into_response()
}

/// Path and title of each page.
const PAGES: [(&str, &str); 5] = [
    ("/", "Cells"),
    ("/cycles", "Cycles"),
    ("/numbers", "Numbers"),
    ("/verifications", "Verifications"),
    ("/recipes", "Recipes"),
];

/// Returns a complete page. The browser reloads it after `again_s` seconds if this is given.
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

/// Returns a time with its seconds, in UTC.
pub(super) fn time(unix_s: i64) -> Markup {
    html! { time { (utc_text(unix_s)) } }
}

/// A day, UTC.
pub(super) fn day(unix_s: i64) -> Markup {
    html! { time { (utc_day(unix_s)) } }
}

/// Returns a symbol together with the word of the verdict, so that a verdict is never shown by colour only.
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

/// Returns the query string of a URL with these keys and values.
pub(super) fn address(pairs: &[(&str, &str)]) -> String {
    form_urlencoded::Serializer::new(String::new()).extend_pairs(pairs).finish()
}
