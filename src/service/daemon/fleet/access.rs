//! Access to the web page of the office server, for people with an account there, who log in with a form. All addresses
//! except the form and its files require a session.

use super::shared;
use super::shared::{PasswordCheck, Shared, archive_error_page};
use crate::daemon::web::{SessionHolder, cookie, cookie_name};
use axum::Form;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Redirect, Response};
use maud::html;
use panelprep_base::random;
use panelprep_cell::accounts::{Role, checked_name};
use panelprep_cell::files::content_hash;
use panelprep_interfaces::archive::reading::OfficeAccount;
use serde::Deserialize;

/// The content security policy: the browser loads nothing from other sites, executes no inline script, and does not
/// show the page in a frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; connect-src 'self'; style-src 'self'; img-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'";
/// The header by which a page marks requests that it sends automatically, without a person.
const AUTOMATIC_REQUEST_HEADER: &str = "x-by-itself";
/// Paths that require no session.
const PUBLIC_PATHS: [&str; 3] = ["/login", "/page.css", "/fleet.js"];

/// Accepts requests with a session; answers other requests with the log-in form.
pub(super) async fn require_session(State(shared): State<Shared>, request: Request<Body>, next: Next) -> Response {
    let path = request.uri().path();
    let is_open = PUBLIC_PATHS.contains(&path);
    let is_action = !request.headers().contains_key(AUTOMATIC_REQUEST_HEADER);
    let session = token(request.headers(), &shared)
        .and_then(|token| shared.sessions().find(token, shared.now_s(), is_action));
    let mut response = match (is_open, session) {
        (true, _) => next.run(request).await,
        (false, None) => Redirect::to("/login").into_response(),
        // A session ends when its account is removed or gets a new password.
        (false, Some(session)) => match shared.reader().account(&session.name).await {
            Ok(account) if is_current(account.as_ref(), &session.stamp) => next.run(request).await,
            Ok(_) => {
                shared.sessions().end_account_sessions(&session.name);
                Redirect::to("/login").into_response()
            }
            Err(error) => archive_error_page(&error),
        },
    };
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("same-origin"));
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

/// Returns whether a session that began with this account stamp is still valid: its account exists and is unchanged.
fn is_current(account: Option<&OfficeAccount>, began_with: &str) -> bool {
    account.is_some_and(|account| account_stamp(account) == began_with)
}

/// Returns a stamp that changes when the account gets a new password.
fn account_stamp(account: &OfficeAccount) -> String {
    content_hash(account.password_hash.as_bytes()).chars().take(16).collect()
}

fn token<'h>(headers: &'h HeaderMap, shared: &Shared) -> Option<&'h str> {
    cookie(headers, cookie_name(shared.is_tls()))
}

/// Returns the form.
pub(super) async fn page() -> Response {
    login_form(StatusCode::OK, None)
}

fn login_form(status: StatusCode, problem: Option<&str>) -> Response {
    let body = html! {
        section.card.narrow {
            h2 { "Log in" }
            form method="post" action="/login" {
                label { "Name" input name="name" autocomplete="username" autofocus required maxlength="40"; }
                label { "Password" input name="password" type="password" autocomplete="current-password" required maxlength="200"; }
                @if let Some(problem) = problem { p.bad role="alert" { (problem) } }
                button.primary type="submit" { "Log in" }
            }
            p.note { "Create accounts on the computer of the office server with: panelprep archive account NAME" }
        }
    };
    (status, shared::page("Log in", "", None, &body)).into_response()
}

#[derive(Deserialize)]
pub(super) struct Credentials {
    name: String,
    password: String,
}

/// Begins a session if name and password are correct.
pub(super) async fn log_in(
    State(shared): State<Shared>,
    headers: HeaderMap,
    Form(Credentials { name, password }): Form<Credentials>,
) -> Response {
    if is_cross_site(&headers) {
        return login_form(
            StatusCode::FORBIDDEN,
            Some("The form was not sent from this page. Open this page again and log in."),
        );
    }
    let wrong = || login_form(StatusCode::UNAUTHORIZED, Some("Name or password is wrong. Try again."));
    if checked_name(&name).is_err() {
        return wrong();
    }
    let account = match shared.reader().account(&name).await {
        Ok(account) => account,
        Err(error) => return archive_error_page(&error),
    };
    let hash = account.as_ref().map(|account| account.password_hash.clone());
    let account = match (shared.check_password(name.clone(), password, hash).await, account) {
        (Some(PasswordCheck::Right), Some(account)) => account,
        (Some(PasswordCheck::Pauses(left_s)), _) => {
            let words = format!("This account is locked after wrong passwords. Try again in {} s.", left_s.ceil());
            return login_form(StatusCode::TOO_MANY_REQUESTS, Some(&words));
        }
        _ => {
            shared.log_failed_login(&name);
            return wrong();
        }
    };
    let (Ok(token), Ok(csrf)) = (random::token(), random::token()) else {
        return login_form(
            StatusCode::SERVICE_UNAVAILABLE,
            Some("The computer's random number generator is not ready yet. Try again."),
        );
    };
    let stamp = account_stamp(&account);
    let (name, printed_name) = (account.name, account.printed_name);
    let who = SessionHolder { name, printed_name, role: Role::Viewer, stamp };
    shared.sessions().begin_session((&token, csrf), who, shared.now_s());
    ([(header::SET_COOKIE, set_cookie(&shared, &token, ""))], Redirect::to("/")).into_response()
}

/// Ends the session.
pub(super) async fn log_out(State(shared): State<Shared>, headers: HeaderMap) -> Response {
    if let Some(token) = token(&headers, &shared) {
        shared.sessions().end(token);
    }
    ([(header::SET_COOKIE, set_cookie(&shared, "", "; Max-Age=0"))], Redirect::to("/login")).into_response()
}

fn set_cookie(shared: &Shared, token: &str, more: &str) -> String {
    let secure = if shared.is_tls() { "; Secure" } else { "" };
    format!("{}={token}; Path=/; HttpOnly; SameSite=Strict{secure}{more}", cookie_name(shared.is_tls()))
}

/// Returns whether the browser states that the form was sent from another site.
fn is_cross_site(headers: &HeaderMap) -> bool {
    let site = headers.get("sec-fetch-site").and_then(|value| value.to_str().ok());
    site.is_some_and(|site| site != "same-origin" && site != "none")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A new password and the removal of an account end every session of the account; a new printed name ends none.
    #[test]
    fn a_session_ends_when_its_account_changes() {
        let account = |password_hash: &str, printed_name: &str| OfficeAccount {
            name: "anna".to_owned(),
            printed_name: printed_name.to_owned(),
            password_hash: password_hash.to_owned(),
        };
        let began_with = account_stamp(&account("$argon2id$1", "Anna"));
        assert!(is_current(Some(&account("$argon2id$1", "Anna")), &began_with));
        assert!(is_current(Some(&account("$argon2id$1", "Anna Berg")), &began_with));
        assert!(!is_current(Some(&account("$argon2id$2", "Anna")), &began_with), "another password");
        assert!(!is_current(None, &began_with), "removed");
    }
}
