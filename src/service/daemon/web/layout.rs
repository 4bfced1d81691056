//! The frame of every page (head, navigation, the bar with stop and abort, and the data for the scripts), and the
//! page's own files (styles and scripts), which are part of the program. The address of each file contains a hash of
//! all files, so that a browser caches them until the program changes.

use super::sessions::{Visitor, role_key};
use axum::extract::Path;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use maud::{DOCTYPE, Markup, html};
use panelprep_base::number_text::utc_text;
use panelprep_cell::accounts::Permission;
use panelprep_cell::files::hex;
use panelprep_interfaces::page::drawing::canvas;
use sha2::{Digest, Sha256};
use std::sync::LazyLock;

/// A script that a page uses in addition to the script of every page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Script {
    /// Sends forms as JSON.
    Forms,
    /// Updates the page of the running cell.
    Run,
    /// Shows the newest cycle in three dimensions.
    Scene,
    /// Draws on a picture; the styles of the drawing sheet are loaded too.
    Draw,
}

impl Script {
    fn script_file(self) -> &'static str {
        match self {
            Script::Forms => "forms.js",
            Script::Run => "run.js",
            Script::Scene => "scene.js",
            Script::Draw => "draw.js",
        }
    }
}

/// The data for the frame of a page.
pub(super) struct Frame<'p> {
    pub visitor: &'p Visitor,
    pub title: &'p str,
    /// The path of the page.
    pub here: &'p str,
    pub scripts: &'p [Script],
}

/// The pages of the navigation: path, key of the word, and the permission that they require.
const PAGES: [(&str, &str, Option<Permission>); 7] = [
    ("/", "nav.run", None),
    ("/history", "nav.history", Some(Permission::View)),
    ("/trends", "nav.trends", Some(Permission::View)),
    ("/alarms", "nav.alarms", Some(Permission::View)),
    ("/setup", "nav.setup", Some(Permission::View)),
    ("/people", "nav.people", Some(Permission::ManagePeople)),
    ("/audit", "nav.audit", Some(Permission::Audit)),
];

impl Frame<'_> {
    /// Returns the complete page with this body.
    pub fn page(&self, body: &Markup) -> Response {
        let words = self.visitor.language();
        let word = |key| words.text(key);
        let csrf = self.visitor.person.as_ref().map_or("", |person| &person.csrf);
        let person = self.visitor.person.as_ref().map_or("", |person| &person.name);
        let mut script_words = words.texts_with_prefix("js.");
        script_words.extend(words.texts_with_prefix("action."));
        let script_words = serde_json::to_string(&script_words).unwrap_or_default();
        let page = html! {
            (DOCTYPE)
            html lang=(words.name()) {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width,initial-scale=1";
                    meta name="csrf" content=(csrf);
                    meta name="person" content=(person);
                    meta name="words" content=(script_words);
                    title { (self.title) " – Panelprep" }
                    link rel="icon" href=(asset_address("icon.svg"));
                    link rel="stylesheet" href=(asset_address("page.css"));
                    @if self.scripts.contains(&Script::Draw) { link rel="stylesheet" href=(asset_address("sheet.css")); }
                    script type="module" src=(asset_address("page.js")) {}
                    @for script in self.scripts { script type="module" src=(asset_address(script.script_file())) {} }
                }
                body {
                    a.skip href="#main" { (word("skip")) }
                    (self.header())
                    @if self.visitor.has_ended && self.here != "/login" {
                        p.banner role="alert" { (word("js.log_in")) " " a href={ "/login?next=" (self.here) } { (word("login.do")) } }
                    }
                    p.banner #stale role="alert" hidden {}
                    main #main { h1.hidden { (self.title) } (body) }
                }
            }
        };
        ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], page.into_string()).into_response()
    }

    fn header(&self) -> Markup {
        let words = self.visitor.language();
        let word = |key| words.text(key);
        let shown = PAGES
            .iter()
            .filter(|(.., needs)| needs.is_none_or(|permission| self.visitor.has_permission(permission)));
        html! {
            header {
                nav aria-label=(word("nav.label")) {
                    @for (path, key, _) in shown {
                        a href=(path) aria-current=[(*path == self.here).then_some("page")] { (word(key)) }
                    }
                }
                div.who {
                    @for language in self.visitor.words.languages() {
                        @if language != words.name() { a href={ "/language/" (language) "?next=" (self.here) } lang=(language) hreflang=(language) { (language.to_uppercase()) } }
                    }
                    @match &self.visitor.person {
                        Some(person) => {
                            a href="/password" title=(word("login.own")) { (person.printed_name) " · " (word(role_key(person.role))) }
                            button.plain #logout type="button" { (word("login.out")) }
                        }
                        None => a href={ "/login?next=" (self.here) } { (word("login.do")) },
                    }
                }
                div.stops {
                    button.stop #stop type="button" { (word("action.stop")) }
                    button.abort #abort type="button" { (word("action.abort")) }
                    small { (word("action.no_emergency_stop")) }
                    p.told #stop-told role="alert" {}
                }
            }
        }
    }
}

/// Shows a time, which the browser displays as local time with the offset.
pub(super) fn local_time(unix_ms: i64) -> Markup {
    html! { time data-ms=(unix_ms) { (utc_text(unix_ms.div_euclid(1_000))) } }
}

/// Returns a page that reports why the requested page could not be built.
pub(super) fn error_page(visitor: &Visitor, error: &dyn std::fmt::Display) -> Response {
    tracing::warn!("the page could not be built: {error}");
    let words = visitor.language();
    let body = html! { section.card { h2 { (words.text("failed")) } p { (error.to_string()) } } };
    let title = words.text("failed");
    let page = Frame { visitor, title, here: "", scripts: &[] }.page(&body);
    (StatusCode::INTERNAL_SERVER_ERROR, page).into_response()
}

/// Returns a page with this text, if the requested page does not exist or the visitor's role may not see it.
pub(super) fn without_page(visitor: &Visitor, status: StatusCode, message: &str) -> Response {
    let body = html! { section.card { h2 { (message) } } };
    (status, Frame { visitor, title: message, here: "", scripts: &[] }.page(&body)).into_response()
}

const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
/// The styles of every page.
pub(in crate::daemon) const STYLE_SHEET: &str = include_str!("assets/page.css");
const FILES: [(&str, &str, &str); 10] = [
    ("page.css", STYLE, STYLE_SHEET),
    ("page.js", SCRIPT, include_str!("assets/page.js")),
    ("run.js", SCRIPT, include_str!("assets/run.js")),
    ("forms.js", SCRIPT, include_str!("assets/forms.js")),
    ("scene.js", SCRIPT, include_str!("assets/scene.js")),
    ("matrix.js", SCRIPT, include_str!("assets/matrix.js")),
    ("draw.js", SCRIPT, include_str!("assets/draw.js")),
    ("sheet.js", SCRIPT, canvas::SCRIPT),
    ("sheet.css", STYLE, canvas::STYLE_SHEET),
    ("icon.svg", "image/svg+xml", include_str!("assets/icon.svg")),
];

static VERSION: LazyLock<String> = LazyLock::new(|| {
    let mut hasher = Sha256::new();
    FILES.iter().for_each(|(_, _, text)| hasher.update(text.as_bytes()));
    hex(&hasher.finalize()[..6])
});

/// Returns the address of a file.
fn asset_address(name: &str) -> String {
    format!("/assets/{}-{name}", *VERSION)
}

/// Serves the file with this name.
pub(super) async fn serve_asset(Path(name): Path<String>) -> Response {
    let own = name.strip_prefix(VERSION.as_str()).and_then(|rest| rest.strip_prefix('-'));
    match own.and_then(|own| FILES.iter().find(|(name, ..)| *name == own)) {
        Some((_, kind, text)) => {
            // A script imports other scripts by their addresses.
            let text = ["PAGE_JS", "SHEET_JS", "MATRIX_JS"].iter().fold(text.to_string(), |text, name| {
                text.replace(name, &format!("{}-{}", *VERSION, name.to_lowercase().replace('_', ".")))
            });
            ([(header::CONTENT_TYPE, *kind)], text).into_response()
        }
        None => StatusCode::NOT_FOUND.into_response(),
    }
}
