//! Accounts: who may log in, and with which role; log-in and log-out, and the change of the own password.

use super::answers::{Answer, panic_response, read_store};
use super::guard::{VisitorExtension, cookie_name, refusal};
use super::layout::{Frame, Script};
use super::sessions::{SessionHolder, Visitor, role_key};
use super::state::{Web, entry, hashing, lock_text, run_blocking};
use crate::daemon::people::{LoginResult, account_stamp};
use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Redirect, Response};
use axum::{Extension, Json};
use maud::{Markup, html};
use panelprep_base::random;
use panelprep_cell::accounts;
use panelprep_cell::accounts::{Account, AuditEntry, MAX_PRINTED_CHARACTERS, Permission, Role};
use panelprep_cell::files::content_hash;
use panelprep_store::store::Store;
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::Arc;
use strum::VariantArray;

#[derive(Debug, Deserialize)]
pub(super) struct NextPath {
    #[serde(default)]
    next: String,
}

/// Returns the path if it is on this page, otherwise `/`, because a log-in must not lead to another site. A browser
/// removes tabs and line feeds from an address before it uses the address, so `/<tab>/host` would be another host.
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
        LoginResult::Pauses(left_s) => return wrong(&lock_text(left_s, words)),
        LoginResult::Unknown => return wrong(words.text("login.wrong")),
    };
    write_audit(&web, AuditEntry { role: Some(account.role), ..line }).await;
    begin_session(&web, &visitor, account)
}

/// Begins a session with a new token, whatever token the browser had before.
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
    web.sessions().begin_session((&token, csrf), session_holder(account), web.now_s());
    let cookie = set_cookie(web, &token, lasts);
    ([(header::SET_COOKIE, cookie)], Json(json!({ "message": "" }))).into_response()
}

fn session_holder(account: Account) -> SessionHolder {
    let stamp = account_stamp(&account);
    let Account { name, printed_name, role, .. } = account;
    SessionHolder { name, printed_name, role, stamp }
}

/// Returns the token of a wall display's session. It is computed from the hash of the password, which only the store
/// has, so that the service can begin the same session again when it starts. Another password gives another token.
fn display_token(account: &Account) -> String {
    content_hash(format!("session of a display\n{}\n{}", account.name, account.password_hash).as_bytes())
}

/// Begins the sessions of all wall displays when the service starts, because no person logs in there. The call blocks
/// while it reads the store.
pub(super) fn begin_displays(web: &Web) {
    let accounts = match web.read(|store| store.accounts()) {
        Ok(accounts) => accounts,
        Err(error) => {
            return tracing::warn!(
                "the sessions of the wall displays cannot be started: {error}; log in at \
                                             each display"
            );
        }
    };
    let displays = accounts.into_values().filter(|account| account.role == Role::Display && account.is_enabled);
    for account in displays {
        let Ok(csrf) = random::token() else { return };
        let token = display_token(&account);
        web.sessions().begin_session((&token, csrf), session_holder(account), web.now_s());
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

/// Shows the form with which people change their own passwords, so that no other person knows them.
pub(super) async fn own_password_page(Extension(visitor): VisitorExtension) -> Response {
    let words = visitor.language();
    let word = |key| words.text(key);
    let body = html! {
        section.card.narrow {
            h2 { (word("login.own")) }
            form data-post="/password" data-then="/login" {
                label { (word("login.old_password")) input name="password" type="password" autocomplete="current-password" required maxlength="200"; }
                label { (word("login.new_password")) input name="new" type="password" autocomplete="new-password" required maxlength="200" minlength=(accounts::MIN_PASSWORD_CHARACTERS); }
                p.told role="status" {}
                button.primary type="submit" { (word("save")) }
            }
        }
    };
    Frame { visitor: &visitor, title: word("login.own"), here: "/password", scripts: &[Script::Forms] }.page(&body)
}

/// Changes the person's own password; the old password is required.
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
            refusal(StatusCode::UNAUTHORIZED, "log_in", &lock_text(left_s, words))
        }
        Some(Err(NotChanged::WrongPassword)) => refused(words.text("login.old_wrong")),
        Some(Err(NotChanged::Problem(problem))) => refused(&problem),
        None => panic_response(),
    }
}

/// The reason why a password was not changed.
enum NotChanged {
    /// Log-ins to the account are blocked for this number of seconds.
    Pauses(f64),
    /// The old password is wrong.
    WrongPassword,
    /// A message for the person.
    Problem(String),
}

/// Sets the language of the page, and returns to the page on which it was chosen.
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

/// Shows all accounts, each with a form to change it.
pub(super) async fn people_page(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Answer {
    let accounts = read_store(&web, &visitor, Store::accounts).await?;
    let words = visitor.language();
    let word = |key| words.text(key);
    let body = html! {
        section.card {
            h2 { (word("people.title")) }
            table {
                thead { tr { th { (word("login.name")) } th { (word("people.printed")) } th { (word("people.role")) } th { (word("people.enabled")) } td {} } }
                tbody {
                    @for account in accounts.values() {
                        tr {
                            td { (account.name) }
                            td { (account.printed_name) }
                            td { (word(role_key(account.role))) }
                            td { (word(if account.is_enabled { "yes" } else { "no" })) }
                            td { details { summary { (word("people.change")) } (account_form(&visitor, Some(account))) } }
                        }
                    }
                }
            }
        }
        section.card.narrow { h2 { (word("people.add")) } (account_form(&visitor, None)) }
    };
    let frame =
        Frame { visitor: &visitor, title: word("people.title"), here: "/people", scripts: &[Script::Forms] };
    Ok(frame.page(&body))
}

fn account_form(visitor: &Visitor, account: Option<&Account>) -> Markup {
    let words = visitor.language();
    let word = |key| words.text(key);
    let (name, printed) = account.map_or(("", ""), |account| (&account.name, &account.printed_name));
    html! {
        form data-post="/people" data-then="/people" {
            @match account {
                Some(_) => input type="hidden" name="name" value=(name);,
                None => {
                    input type="hidden" name="is_new" value="true";
                    label { (word("login.name")) input name="name" required maxlength="40" autocomplete="off"; }
                },
            }
            label { (word("people.printed")) input name="printed_name" value=(printed) required maxlength=(MAX_PRINTED_CHARACTERS) autocomplete="off"; }
            label { (word("people.role"))
                select name="role" {
                    @for role in Role::VARIANTS {
                        option value=(role.keyword()) selected[account.is_some_and(|account| account.role == *role)] { (word(role_key(*role))) }
                    }
                }
            }
            label { (word(if account.is_some() { "people.new_password" } else { "login.password" }))
                input name="password" type="password" autocomplete="new-password" required[account.is_none()] maxlength="200"; }
            @if let Some(account) = account {
                label.check { input type="checkbox" name="is_enabled" checked[account.is_enabled]; (word("people.enabled")) }
            } @else {
                input type="hidden" name="is_enabled" value="true";
            }
            p.told role="status" {}
            button.primary type="submit" { (word("save")) }
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AccountChange {
    /// Whether the account must be new; an account that already exists is then not changed.
    #[serde(default)]
    is_new: bool,
    name: String,
    printed_name: String,
    role: Role,
    #[serde(default)]
    password: String,
    is_enabled: bool,
}

/// Adds an account or changes one.
pub(super) async fn save_account(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(changed): Json<AccountChange>,
) -> Response {
    let (shared, line, name) = (web.clone(), entry(&visitor, "change account"), changed.name.clone());
    let exists = visitor.language().text("people.exists").to_owned();
    match hashing(&web, move || store_change(&shared, line, changed, exists)).await {
        Some(Ok(())) => {
            // The person's permissions have changed, so sessions with the old role must end.
            web.sessions().end_account_sessions(&name);
            Json(json!({ "message": visitor.language().text("saved") })).into_response()
        }
        Some(Err(problem)) => refusal(StatusCode::UNPROCESSABLE_ENTITY, "account", &problem),
        None => panic_response(),
    }
}

fn store_change(web: &Web, line: AuditEntry, changed: AccountChange, exists: String) -> Result<(), String> {
    let accounts = web.read(|store| store.accounts()).map_err(|error| error.to_string())?;
    let former = accounts.get(&changed.name);
    if changed.is_new && former.is_some() {
        // Signatures under this name would be assigned to another person.
        return Err(exists);
    }
    let account = account(&changed, former)?;
    if removes_last_administrator(&accounts, &account) {
        return Err(
            "this account is the last enabled account that may manage accounts; create another administrator first"
                .to_owned(),
        );
    }
    let line = AuditEntry {
        subject: Some(account.name.clone()),
        before: former.map(Account::summary),
        after: Some(account.summary()),
        ..line
    };
    web.write(|store| store.store_account(&account, &line)).map_err(|error| error.to_string())
}

fn account(changed: &AccountChange, former: Option<&Account>) -> Result<Account, String> {
    let AccountChange { name, printed_name, role, password, is_enabled, .. } = changed;
    let salt = random::bytes()
        .map_err(|error| format!("this computer's random number generator cannot be used: {error}; try again"))?;
    let password = Some(password.as_str()).filter(|password| !password.is_empty());
    Account::create_validated((name, printed_name), (*role, *is_enabled), (password, salt), former)
}

/// Returns whether no account that may change accounts would remain after this change.
fn removes_last_administrator(accounts: &BTreeMap<String, Account>, changed: &Account) -> bool {
    let may = |account: &Account| account.is_enabled && account.role.has_permission(Permission::ManagePeople);
    !may(changed) && !accounts.values().any(|other| other.name != changed.name && may(other))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_browser_is_redirected_to_another_site() {
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
