//! The page on which a person marks the breaks in a clip: polygons over its pictures, with times.
//!
//! `GET .` the page · `GET clip.json` the clip, the grids, and the data stored until now · `GET picture/N` picture N
//! of the clip, from 1 · `POST draft` the current drawing, stored unchanged so that a reload loses nothing · `POST
//! save` the same drawing as labels: they are stored if they are valid, otherwise the problems are returned · `POST
//! done` ends the page.

use super::session::Session;
use super::{LocalError, LocalServer};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use panelprep_base::disk;
use panelprep_cell::files::{self, ClipEntry};
use panelprep_cell::labels::Statement;
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE_SHEET: &str = "text/css; charset=utf-8";
/// The page's own files.
const FILES: [(&str, &str, &str); 9] = [
    ("", HTML, include_str!("label.html")),
    ("label.css", STYLE_SHEET, include_str!("label.css")),
    ("label.js", SCRIPT, include_str!("label.js")),
    ("breaks.js", SCRIPT, include_str!("breaks.js")),
    ("overlay.js", SCRIPT, include_str!("overlay.js")),
    ("film.js", SCRIPT, include_str!("film.js")),
    ("keys.js", SCRIPT, include_str!("keys.js")),
    ("panel.js", SCRIPT, include_str!("panel.js")),
    ("program.js", SCRIPT, include_str!("program.js")),
];

/// The outline of a grid as the camera sees it.
#[derive(Debug, Clone, Serialize)]
pub struct GridOutline {
    /// Its name.
    pub id: String,
    /// The edge of the grid, px, closed.
    pub edge_px: Vec<[f64; 2]>,
}

/// The labels stored so far.
#[derive(Debug, Clone, Serialize)]
pub struct CurrentLabels {
    /// The person's statement.
    pub said: Statement,
    /// When labels were last saved, UTC; `None` if they never were.
    pub saved_at: Option<String>,
    /// Whether the statement is a draft that is not saved yet.
    pub is_draft: bool,
    /// A note for the person.
    pub note: Option<String>,
}

/// The result of a save.
#[derive(Debug, Clone, Serialize)]
pub struct SaveResult {
    /// The labels' file.
    pub labels: String,
    /// The time of the save, UTC.
    pub saved_at: String,
    /// The name under which the former labels are stored.
    pub former: Option<String>,
}

/// The storage of labels.
pub trait LabelStorage: Send + Sync {
    /// Returns the data stored until now.
    ///
    /// # Errors
    /// If a file is not valid; the error is a text for people.
    fn now(&self) -> Result<CurrentLabels, String>;

    /// Stores the current drawing, valid or not.
    ///
    /// # Errors
    /// If the file cannot be written; the error is a text for people.
    fn store_draft(&self, said: &Statement) -> Result<(), String>;

    /// Saves the statement as labels.
    ///
    /// # Errors
    /// Everything in the statement that is not possible, or the reason why the files cannot be written, as text.
    fn save(&self, said: &Statement) -> Result<SaveResult, Vec<String>>;
}

/// The clip to mark, with its pictures and panel.
pub struct LabelSheet {
    /// The clip's folder.
    pub folder: PathBuf,
    /// Its pictures.
    pub shots: Vec<ClipEntry>,
    /// Their size, px.
    pub size_px: [usize; 2],
    /// The grids to show, if they are known.
    pub grids: Vec<GridOutline>,
    /// The storage of labels.
    pub keep: Arc<dyn LabelStorage>,
}

struct Inside {
    sheet: LabelSheet,
    session: Session,
}

/// Serves the page until the person is done; returns how often labels were saved.
///
/// # Errors
/// If the operating system refuses what the server needs.
pub fn serve(local: LocalServer, sheet: LabelSheet) -> Result<u32, LocalError> {
    let (session, done) = Session::new();
    let inside = Arc::new(Inside { sheet, session });
    let mut pages = Router::new();
    for (name, kind, text) in FILES {
        pages = pages.route(&local.path(name), get(move || async move { ([(header::CONTENT_TYPE, kind)], text) }));
    }
    let pages = pages
        .route(&local.path("clip.json"), get(clip))
        .route(&local.path("picture/{number}"), get(picture))
        .route(&local.path("draft"), post(handle_draft))
        .route(&local.path("save"), post(save))
        .route(&local.path("done"), post(end))
        .with_state(inside.clone());
    local.serve(pages, done)?;
    Ok(inside.session.save_count())
}

fn refused(status: StatusCode, problems: &[String]) -> Response {
    (status, Json(json!({ "problems": problems }))).into_response()
}

async fn clip(State(inside): State<Arc<Inside>>) -> Response {
    let LabelSheet { folder, shots, size_px, grids, keep } = &inside.sheet;
    let shots: Vec<_> = shots
        .iter()
        .map(|shot| json!({"file": shot.file, "time_s": shot.time_s, "phase": shot.phase.keyword()}))
        .collect();
    match keep.now() {
        Ok(now) => {
            let clip = folder.display().to_string();
            Json(json!({"clip": clip, "shots": shots, "size_px": size_px, "grids": grids, "now": now}))
                .into_response()
        }
        Err(problem) => refused(StatusCode::UNPROCESSABLE_ENTITY, &[problem]),
    }
}

async fn picture(State(inside): State<Arc<Inside>>, Path(number): Path<String>) -> Response {
    let LabelSheet { folder, shots, .. } = &inside.sheet;
    let shot = number.parse::<usize>().ok().and_then(|number| shots.get(number.checked_sub(1)?));
    let Some(shot) = shot else {
        let problem = format!("the clip has no picture {number}; valid: 1 to {}", shots.len());
        return refused(StatusCode::NOT_FOUND, &[problem]);
    };
    let file = folder.join(&shot.file);
    match disk::read(&file).map_err(|error| error.to_string()).and_then(browser_picture) {
        Ok((kind, bytes)) => ([(header::CONTENT_TYPE, kind)], bytes).into_response(),
        Err(problem) => refused(StatusCode::UNPROCESSABLE_ENTITY, &[format!("{}: {problem}", file.display())]),
    }
}

/// Returns a picture in a format that browsers show, with the pixels as the program reads them. PNG and JPEG are sent
/// unchanged, TIFF is converted to PNG. A browser rotates a picture by its EXIF data, so that the drawing would lie at
/// other pixels: a picture that may have EXIF data is encoded again.
fn browser_picture(bytes: Vec<u8>) -> Result<(&'static str, Vec<u8>), String> {
    let has = |name: &[u8]| bytes.windows(name.len()).any(|part| part == name);
    if bytes.starts_with(b"\x89PNG") && !has(b"eXIf") {
        return Ok(("image/png", bytes));
    }
    if bytes.starts_with(&[0xff, 0xd8]) && !has(b"Exif") {
        return Ok(("image/jpeg", bytes));
    }
    let png = files::read_color(&bytes).and_then(|picture| files::write_color_png(&picture));
    png.map(|png| ("image/png", png)).map_err(|error| error.to_string())
}

async fn handle_draft(State(inside): State<Arc<Inside>>, Json(said): Json<Statement>) -> Response {
    match inside.sheet.keep.store_draft(&said) {
        Ok(()) => Json(json!({ "kept": true })).into_response(),
        Err(problem) => refused(StatusCode::UNPROCESSABLE_ENTITY, &[problem]),
    }
}

async fn save(State(inside): State<Arc<Inside>>, Json(said): Json<Statement>) -> Response {
    match inside.sheet.keep.save(&said) {
        Ok(saved) => {
            inside.session.count_save();
            Json(saved).into_response()
        }
        Err(problems) => refused(StatusCode::UNPROCESSABLE_ENTITY, &problems),
    }
}

async fn end(State(inside): State<Arc<Inside>>) -> Response {
    inside.session.end()
}

#[cfg(test)]
mod tests;
