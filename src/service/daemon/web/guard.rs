//! The checks before each route: who sends the request, whether it comes from the operator's page itself, and whether
//! the role permits it. [`Route`] is a route with its method and the required access.

use super::layout;
use super::sessions::{Person, Session, Visitor, role_key};
use super::state::{Web, entry, run_blocking};
use axum::body::Body;
use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Redirect, Response};
use axum::routing::MethodRouter;
use axum::{Extension, Json};
use panelprep_cell::accounts::Permission;
use serde_json::json;
use std::net::SocketAddr;
use std::sync::Arc;

/// Name of the header with the session's token, which each change by a person must contain.
const CSRF_HEADER: &str = "x-csrf-token";
/// The content security policy: the browser loads nothing from other sites, executes no inline script, and does not
/// show the page in a frame of another site.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; frame-src 'self'; \
                      form-action 'self'; base-uri 'none'; frame-ancestors 'none'";

/// The visitors who may use a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    /// All visitors, logged in or not.
    Open,
    /// Visitors with a role that has this permission.
    Needs(Permission),
}

/// HTTP method of a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Method {
    Get,
    Post,
}

/// A route of the operator's page.
pub(super) struct Route {
    pub path: &'static str,
    pub method: Method,
    pub access: Access,
    pub handler: fn() -> MethodRouter<Arc<Web>>,
}

/// Returns the name of the cookie; with TLS, a name that only this host can set.
pub(in crate::daemon) fn cookie_name(is_tls: bool) -> &'static str {
    if is_tls { "__Host-panelprep" } else { "panelprep" }
}

/// Returns the value of this cookie.
pub(in crate::daemon) fn cookie<'h>(headers: &'h HeaderMap, name: &str) -> Option<&'h str> {
    let all = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut each = all.flat_map(|value| value.split(';')).filter_map(|part| part.trim().split_once('='));
    each.find(|(found, _)| *found == name).map(|(_, value)| value)
}

/// The text of a refusal, which is returned beside its JSON: the error page shows it.
#[derive(Debug, Clone)]
struct RefusalText(String);

/// Returns the response to a refused request.
pub(super) fn refusal(status: StatusCode, code: &str, message: &str) -> Response {
    let mut response = (status, Json(json!({ "code": code, "message": message }))).into_response();
    response.extensions_mut().insert(RefusalText(message.to_owned()));
    response
}

/// Identifies the visitor, and passes permitted requests to their handlers.
pub(super) async fn identify_visitor(
    State((web, route)): State<(Arc<Web>, &'static Route)>,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
    mut request: Request<Body>,
    next: Next,
) -> Response {
    let headers = request.headers();
    let (is_change, access) = (route.method == Method::Post, route.access);
    let mut visitor = find_visitor(&web, headers, from, is_change || !is_automatic_request(request.uri().path()));
    // A request that all visitors may send, such as a stop, does not wait for a disk.
    if let (Access::Needs(_), Some(person)) = (access, &visitor.person)
        && !web.stamps.is_session_valid(&web.front.people, person).await
    {
        web.sessions().end(&person.token);
        (visitor.person, visitor.has_ended) = (None, true);
    }
    if is_change && let Some(refused) = cross_site_refusal(headers, &visitor, access) {
        return refused;
    }
    if let Access::Needs(permission) = access
        && !visitor.has_permission(permission)
    {
        let path = request.uri().path().to_owned();
        return refused(&web, visitor, path, is_change).await;
    }
    request.extensions_mut().insert(visitor);
    next.run(request).await
}

/// Returns whether a page sends this request automatically, without a person; such a request does not extend a session.
fn is_automatic_request(path: &str) -> bool {
    ["/events", "/frame.jpg", "/now.json", "/review"].contains(&path) || path.starts_with("/assets/")
}

fn find_visitor(web: &Web, headers: &HeaderMap, from: SocketAddr, is_action: bool) -> Visitor {
    let text = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok()).map(str::to_owned);
    let token = cookie(headers, cookie_name(web.is_tls));
    let person = token.and_then(|token| {
        let session = web.sessions().find(token, web.now_s(), is_action)?;
        let Session { name, printed_name, role, stamp, csrf, .. } = session;
        Some(Person { name, printed_name, role, stamp, csrf, token: token.to_owned() })
    });
    Visitor {
        from: from.ip().to_canonical().to_string(),
        has_ended: token.is_some() && person.is_none(),
        person,
        chosen: cookie(headers, "language").map(str::to_owned),
        accepted: text(header::ACCEPT_LANGUAGE),
        words: web.translations.clone(),
    }
}

/// Returns the refusal of a change that was not sent by the operator's page. The browser states the site from which the
/// request comes, or the host of the page as origin. For a logged-in person, the page also sends the token of the
/// session.
fn cross_site_refusal(headers: &HeaderMap, visitor: &Visitor, access: Access) -> Option<Response> {
    let text = |name: &str| headers.get(name).and_then(|value| value.to_str().ok());
    let host = text("host").unwrap_or("");
    let is_same = match (text("sec-fetch-site"), text("origin")) {
        (Some(site), _) => site == "same-origin",
        (None, Some(origin)) => origin.split_once("://").is_some_and(|(_, rest)| rest == host),
        (None, None) => false,
    };
    if !is_same {
        return Some(refusal(StatusCode::FORBIDDEN, "origin", "the request was not sent from the operator's page"));
    }
    if text("content-type").is_none_or(|kind| !kind.starts_with("application/json")) {
        return Some(refusal(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            "content_type",
            "a change must be sent as JSON (content type application/json)",
        ));
    }
    // A request that requires no session requires no token either: a stop from a page with an ended session is still
    // executed.
    match &visitor.person {
        Some(person) if access != Access::Open && text(CSRF_HEADER) != Some(&person.csrf) => {
            Some(refusal(StatusCode::FORBIDDEN, "token", visitor.language().text("refused.token")))
        }
        _ => None,
    }
}

async fn refused(web: &Arc<Web>, visitor: Visitor, path: String, is_change: bool) -> Response {
    let words = visitor.language();
    let Some(person) = &visitor.person else {
        let first = || refusal(StatusCode::UNAUTHORIZED, "log_in", words.text("refused.log_in"));
        return match is_change {
            true => first(),
            false if is_automatic_request(&path) => first(),
            false => Redirect::to(&format!(
                "/login?next={}",
                form_urlencoded::byte_serialize(path.as_bytes()).collect::<String>()
            ))
            .into_response(),
        };
    };
    let message = format!("the role {} has no permission for this request", person.role.keyword());
    let told = format!("{} ({})", words.text("refused.role"), words.text(role_key(person.role)));
    let (web, mut line) = (web.clone(), entry(&visitor, if is_change { "request" } else { "look" }));
    (line.subject, line.refused) = (Some(path), Some(message));
    run_blocking(move || web.audit_refusal(&line)).await;
    refusal(StatusCode::FORBIDDEN, "role", &told)
}

/// Returns the response for an address without a page. It has no text of its own: the person reads the general text in
/// the chosen language.
pub(super) async fn not_found_page() -> Response {
    let body = json!({ "code": "not_found", "message": "there is no page at this address" });
    (StatusCode::NOT_FOUND, Json(body)).into_response()
}

/// Returns the page that a person sees instead of a response without a page: with the text of the refusal, or with the
/// general text of the status. `None` if the response is already a page, or not an error.
fn error_as_page(viewer: &Visitor, response: &Response) -> Option<Response> {
    let status = response.status();
    let kind = response.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok());
    let is_page = kind.is_some_and(|kind| kind.starts_with("text/html"));
    if is_page || !(status.is_client_error() || status.is_server_error()) {
        return None;
    }
    let general = match status {
        StatusCode::NOT_FOUND | StatusCode::METHOD_NOT_ALLOWED => "refused.not_found",
        StatusCode::FORBIDDEN => "refused.role",
        StatusCode::UNAUTHORIZED => "refused.log_in",
        _ => "failed",
    };
    let own = response.extensions().get::<RefusalText>().map(|text| text.0.as_str());
    Some(layout::without_page(viewer, status, own.unwrap_or_else(|| viewer.language().text(general))))
}

/// Returns whether a person opens a page with this request. An error is then shown on a page with Stop and the
/// navigation.
fn opens_page(request: &Request) -> bool {
    let accepted = request.headers().get(header::ACCEPT).and_then(|value| value.to_str().ok());
    request.method() == axum::http::Method::GET && accepted.is_some_and(|accepted| accepted.contains("text/html"))
}

/// Sets the headers of every response. Without TLS, only requests to this computer's own name are answered.
pub(super) async fn headers(State(web): State<Arc<Web>>, request: Request<Body>, next: Next) -> Response {
    if let Some(hosts) = &web.hosts {
        let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok());
        if !host.is_some_and(|host| hosts.iter().any(|own| own == host)) {
            return refusal(
                StatusCode::MISDIRECTED_REQUEST,
                "host",
                "the host name of the request is not valid for this page; open the page as localhost or 127.0.0.1",
            );
        }
    }
    let is_asset = request.uri().path().starts_with("/assets/");
    let viewer = opens_page(&request).then(|| request.extensions().get::<ConnectInfo<SocketAddr>>().copied());
    let viewer = viewer.flatten().map(|from| find_visitor(&web, request.headers(), from.0, false));
    let mut response = next.run(request).await;
    if let Some(page) = viewer.and_then(|viewer| error_as_page(&viewer, &response)) {
        response = page;
    }
    let headers = response.headers_mut();
    let kept = if is_asset { "max-age=31536000, immutable" } else { "no-store" };
    for (name, value) in [
        (header::CACHE_CONTROL, kept),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(header::X_FRAME_OPTIONS).or_insert(HeaderValue::from_static("DENY"));
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(POLICY));
    if web.is_tls {
        let value = HeaderValue::from_static("max-age=31536000");
        headers.insert(header::STRICT_TRANSPORT_SECURITY, value);
    }
    response
}

/// The visitor, as a handler receives it.
pub(super) type VisitorExtension = Extension<Visitor>;
