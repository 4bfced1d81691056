//! Logging in and out, and one's own password.

use super::answers::panic_response;
use super::guard::{VisitorExtension, cookie_name, refusal};
use super::layout::{Frame, Script};
use super::sessions::{SessionHolder, Visitor};
use super::state::{Web, entry, hashing, pauses, run_blocking};
use crate::daemon::people::{LoginResult, account_stamp};
use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Redirect, Response};
use axum::{Extension, Json};
use maud::html;
use panelprep_base::random;
use panelprep_cell::accounts;
use panelprep_cell::accounts::{Account, AuditEntry, Role};
use panelprep_cell::files::content_hash;
use serde::Deserialize;
use serde_json::json;
use std::sync::Arc;

#[derive(Debug, Deserialize)]
pub(super) struct NextPath {
    #[serde(default)]
    next: String,
}

/// Returns the path if it is on this page, otherwise `/`: a log-in must not lead to another site. A browser removes
/// tabs and line feeds from an address before it uses the address, so that `/<tab>/host` would be another host.
fn local_path(next: &str) -> &str {
    let is_own = next.starts_with('/')
        && !next.starts_with("//")
        && !next.contains('\\')
        && !next.contains(char::is_control);
    if is_own { next } else { "/" }
}

/// Returns the form.
pub(super) async fn page(
    Extension(visitor): VisitorExtension,
    Query(NextPath { next }): Query<NextPath>,
) -> Response {
    let words = visitor.language();
    let word = |key| words.text(key);
    let body = html! {
        section.card.narrow {
            h2 { (word("login.title")) }
            form data-post="/login" data-then=(local_path(&next)) {
                label { (word("login.name")) input name="name" autocomplete="username" autofocus required maxlength="40"; }
                label { (word("login.password")) input name="password" type="password" autocomplete="current-password" required maxlength="200"; }
                p.told role="status" {}
                button.primary type="submit" { (word("login.do")) }
            }
            p.note { (word("login.stop")) }
        }
    };
    Frame { visitor: &visitor, title: word("login.title"), here: "/login", scripts: &[Script::Forms] }.page(&body)
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Credentials {
    name: String,
    password: String,
}

/// Begins a session if name and password are correct.
pub(super) async fn login(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(Credentials { name, password }): Json<Credentials>,
) -> Response {
    let wrong = |message: &str| refusal(StatusCode::UNAUTHORIZED, "log_in", message);
    let words = visitor.language();
    let line = AuditEntry { who: Some(name.clone()), role: None, ..entry(&visitor, "log in") };
    let account = match web.front.people.attempt_login(&name, password).await {
        LoginResult::Right(account) => account,
        LoginResult::Wrong(why) => {
            let line = AuditEntry { refused: Some(why.to_owned()), ..line };
            let people = web.front.people.clone();
            run_blocking(move || people.audit_failed_login(&line)).await;
            return wrong(words.text("login.wrong"));
        }
        LoginResult::Pauses(left_s) => return wrong(&pauses(left_s, words)),
        LoginResult::Unknown => return wrong(words.text("login.wrong")),
    };
    write_audit(&web, AuditEntry { role: Some(account.role), ..line }).await;
    begin_session(&web, &visitor, account)
}

/// Begins a session under a new token, whatever token the browser had before.
fn begin_session(web: &Web, visitor: &Visitor, account: Account) -> Response {
    let (Ok(token), Ok(csrf)) = (random::token(), random::token()) else {
        return refusal(
            StatusCode::SERVICE_UNAVAILABLE,
            "random",
            "the computer's random number generator is not ready yet; try again",
        );
    };
    let (token, lasts) = match account.role {
        Role::Display => (display_token(&account), "; Max-Age=31536000"),
        _ => (token, ""),
    };
    if let Some(person) = &visitor.person {
        web.sessions().end(&person.token);
    }
    web.sessions().begin_session((&token, csrf), holder(account), web.now_s());
    let cookie = set_cookie(web, &token, lasts);
    ([(header::SET_COOKIE, cookie)], Json(json!({ "message": "" }))).into_response()
}

fn holder(account: Account) -> SessionHolder {
    let stamp = account_stamp(&account);
    let Account { name, printed_name, role, .. } = account;
    SessionHolder { name, printed_name, role, stamp }
}

/// Returns the token of a wall display's session. It follows from the password's hash, which only the store has, so
/// that the service can begin the same session again when it starts; another password gives another token.
fn display_token(account: &Account) -> String {
    content_hash(format!("session of a display\n{}\n{}", account.name, account.password_hash).as_bytes())
}

/// Begins the sessions of all wall displays, as the service starts: no person logs in there. It runs on the calling
/// thread.
pub(super) fn begin_displays(web: &Web) {
    let accounts = match web.read(|store| store.accounts()) {
        Ok(accounts) => accounts,
        Err(error) => return tracing::warn!("wall displays have to log in: {error}"),
    };
    let displays = accounts.into_values().filter(|account| account.role == Role::Display && account.is_enabled);
    for account in displays {
        let Ok(csrf) = random::token() else { return };
        let token = display_token(&account);
        web.sessions().begin_session((&token, csrf), holder(account), web.now_s());
    }
}

pub(super) async fn logout(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Response {
    if let Some(person) = &visitor.person {
        web.sessions().end(&person.token);
        write_audit(&web, entry(&visitor, "log out")).await;
    }
    let cookie = set_cookie(&web, "", "; Max-Age=0");
    ([(header::SET_COOKIE, cookie)], Json(json!({ "message": "" }))).into_response()
}

fn set_cookie(web: &Web, token: &str, more: &str) -> String {
    let secure = if web.is_tls { "; Secure" } else { "" };
    format!("{}={token}; Path=/; HttpOnly; SameSite=Strict{secure}{more}", cookie_name(web.is_tls))
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NewPassword {
    password: String,
    new: String,
}

/// The form with which a person changes the own password, so that no other person knows it.
pub(super) async fn own(Extension(visitor): VisitorExtension) -> Response {
    let words = visitor.language();
    let word = |key| words.text(key);
    let body = html! {
        section.card.narrow {
            h2 { (word("login.own")) }
            form data-post="/password" data-then="/login" {
                label { (word("login.old_password")) input name="password" type="password" autocomplete="current-password" required maxlength="200"; }
                label { (word("login.new_password")) input name="new" type="password" autocomplete="new-password" required maxlength="200" minlength=(accounts::MIN_CHARACTERS); }
                p.told role="status" {}
                button.primary type="submit" { (word("save")) }
            }
        }
    };
    Frame { visitor: &visitor, title: word("login.own"), here: "/password", scripts: &[Script::Forms] }.page(&body)
}

/// Changes the person's own password; the old password is needed.
pub(super) async fn change_password(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(NewPassword { password, new }): Json<NewPassword>,
) -> Response {
    let Some(person) = visitor.person.clone() else { return StatusCode::UNAUTHORIZED.into_response() };
    let (shared, line) = (web.clone(), entry(&visitor, "change own password"));
    let name = person.name.clone();
    let changed = hashing(&web, move || -> Result<(), NotChanged> {
        let account = match shared.front.people.check_password(&person.name, &password) {
            LoginResult::Right(account) => account,
            LoginResult::Pauses(left_s) => return Err(NotChanged::Pauses(left_s)),
            LoginResult::Wrong(_) | LoginResult::Unknown => return Err(NotChanged::WrongPassword),
        };
        let problem = |problem: &dyn std::fmt::Display| NotChanged::Problem(problem.to_string());
        let salt = random::bytes().map_err(|error| problem(&error))?;
        let password_hash = accounts::hash_password(&new, &person.name, salt).map_err(|error| problem(&error))?;
        let account = Account { password_hash, ..account };
        shared.write(|store| store.store_account(&account, &line)).map_err(|error| problem(&error))
    });
    let words = visitor.language();
    let refused = |problem: &str| refusal(StatusCode::UNPROCESSABLE_ENTITY, "password", problem);
    match changed.await {
        Some(Ok(())) => {
            web.sessions().end_account_sessions(&name);
            Json(json!({ "message": words.text("login.again") })).into_response()
        }
        Some(Err(NotChanged::Pauses(left_s))) => {
            refusal(StatusCode::UNAUTHORIZED, "log_in", &pauses(left_s, words))
        }
        Some(Err(NotChanged::WrongPassword)) => refused(words.text("login.old_wrong")),
        Some(Err(NotChanged::Problem(problem))) => refused(&problem),
        None => panic_response(),
    }
}

/// The reason why a password was not changed.
enum NotChanged {
    /// Log-in to the account is blocked for this many more seconds.
    Pauses(f64),
    /// The old password is wrong.
    WrongPassword,
    /// Message for the person.
    Problem(String),
}

/// Chooses a language, and returns to the page on which it was chosen.
pub(super) async fn language(
    State(web): State<Arc<Web>>,
    Path(name): Path<String>,
    Query(NextPath { next }): Query<NextPath>,
) -> Response {
    let known = web.translations.languages().iter().find(|language| **language == name);
    let Some(known) = known else { return super::guard::not_found_page().await };
    let cookie = format!("language={known}; Path=/; SameSite=Strict; Max-Age=31536000");
    ([(header::SET_COOKIE, cookie)], Redirect::to(local_path(&next))).into_response()
}

async fn write_audit(web: &Arc<Web>, line: AuditEntry) {
    let web = web.clone();
    run_blocking(move || web.audit(&line)).await;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_browser_is_redirected() {
        for path in ["/", "/cycle/7", "/setup/recipe/panel.toml"] {
            assert_eq!(local_path(path), path);
        }
        for path in [
            "",
            "//evil.example",
            "https://evil.example",
            "/\\evil.example",
            "/a\r\nSet-Cookie: x",
            "/\t/evil.example/x",
            "/\u{1}",
        ] {
            assert_eq!(local_path(path), "/", "{path}");
        }
    }
}
