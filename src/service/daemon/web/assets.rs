//! The page's own files: styles and scripts, which are part of the program. Their address contains the hash of all of
//! them, so that a browser caches them until the program changes.

use axum::extract::Path;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use panelprep_cell::files::hex;
use panelprep_interfaces::page::drawing::canvas;
use sha2::{Digest, Sha256};
use std::sync::LazyLock;

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
pub(super) fn address(name: &str) -> String {
    format!("/assets/{}-{name}", *VERSION)
}

/// Serves a file under its address.
pub(super) async fn serve_asset(Path(name): Path<String>) -> Response {
    let own = name.strip_prefix(VERSION.as_str()).and_then(|rest| rest.strip_prefix('-'));
    match own.and_then(|own| FILES.iter().find(|(name, ..)| *name == own)) {
        Some((_, kind, text)) => {
            // A script refers to another script by its address.
            let text = ["PAGE_JS", "SHEET_JS", "MATRIX_JS"].iter().fold(text.to_string(), |text, name| {
                text.replace(name, &format!("{}-{}", *VERSION, name.to_lowercase().replace('_', ".")))
            });
            ([(header::CONTENT_TYPE, *kind)], text).into_response()
        }
        None => StatusCode::NOT_FOUND.into_response(),
    }
}
