//! The page on which a person draws the region, its grids, what is masked, the panel's outline and what holds it, on the taught scan's picture.
//!
//! `GET .` the page · `GET drawing.json` what the recipe says · `GET picture.png` · `POST save` what was drawn: it is put into the
//! recipe's file where the recipe's own check accepts it, else the problems come back · `POST done` ends the page.

use super::{Local, LocalError};
use crate::disk;
use crate::recipe::{Drawn, Recipe, drawn_into};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::oneshot;

const PAGE: &str = include_str!("drawing.html");
const SCRIPT: &str = include_str!("drawing.js");
const STYLE: &str = include_str!("drawing.css");

/// Writes the recipe's new text so that it is whole or not written at all.
pub type Write = dyn Fn(&str) -> Result<(), String> + Send + Sync;

/// What is drawn on.
pub struct Sheet {
    /// The recipe's file.
    pub recipe: PathBuf,
    /// The scan's picture, PNG.
    pub picture_png: Vec<u8>,
    /// Its size, px.
    pub size_px: [usize; 2],
    /// Keeps the recipe.
    pub write: Box<Write>,
}

struct Inside {
    sheet: Sheet,
    /// How often it was saved; and whom to tell that the person is done.
    saved: Mutex<(u32, Option<oneshot::Sender<()>>)>,
}

/// Serves the page until the person is done; how often the recipe was saved.
///
/// # Errors
/// Where the system refuses.
pub fn serve(local: Local, sheet: Sheet) -> Result<u32, LocalError> {
    let (tell, done) = oneshot::channel();
    let inside = Arc::new(Inside { sheet, saved: Mutex::new((0, Some(tell))) });
    let text =
        |kind: &'static str, text: &'static str| get(move || async move { ([(header::CONTENT_TYPE, kind)], text) });
    let pages = Router::new()
        .route(&local.path(""), text("text/html; charset=utf-8", PAGE))
        .route(&local.path("drawing.js"), text("text/javascript; charset=utf-8", SCRIPT))
        .route(&local.path("drawing.css"), text("text/css; charset=utf-8", STYLE))
        .route(&local.path("picture.png"), get(picture))
        .route(&local.path("drawing.json"), get(drawing))
        .route(&local.path("save"), post(save))
        .route(&local.path("done"), post(end))
        .with_state(inside.clone());
    local.serve(pages, done)?;
    let saved = inside.saved.lock().unwrap_or_else(PoisonError::into_inner).0;
    Ok(saved)
}

async fn picture(State(inside): State<Arc<Inside>>) -> Response {
    ([(header::CONTENT_TYPE, "image/png")], inside.sheet.picture_png.clone()).into_response()
}

/// The recipe as its file is now.
fn read(sheet: &Sheet) -> Result<(String, Recipe), Vec<String>> {
    let name = sheet.recipe.display().to_string();
    let bytes = disk::read(&sheet.recipe).map_err(|error| vec![format!("{name}: {error}")])?;
    let text = String::from_utf8(bytes).map_err(|error| vec![format!("{name}: {error}")])?;
    let recipe = checked(&name, &text)?;
    Ok((text, recipe))
}

fn checked(name: &str, text: &str) -> Result<Recipe, Vec<String>> {
    Recipe::check(name, text).map_err(|problems| problems.to_string().lines().map(str::to_owned).collect())
}

fn refused(problems: &[String]) -> Response {
    (StatusCode::UNPROCESSABLE_ENTITY, Json(json!({ "problems": problems }))).into_response()
}

async fn drawing(State(inside): State<Arc<Inside>>) -> Response {
    let sheet = &inside.sheet;
    match read(sheet) {
        Ok((_, recipe)) => {
            let region = recipe.region();
            let told: Value = json!({
                "panel": recipe.panel(), "recipe": sheet.recipe.display().to_string(), "size_px": sheet.size_px,
                "drawn": Drawn {
                    corners_px: region.corners_px(),
                    rows: u32::try_from(region.rows()).unwrap_or(u32::MAX),
                    columns: u32::try_from(region.columns()).unwrap_or(u32::MAX),
                    masked_px: recipe.inspect().masked_px(),
                    outline_px: recipe.outline().outline_px(),
                    held_px: recipe.outline().held_px(),
                },
            });
            Json(told).into_response()
        }
        Err(problems) => refused(&problems),
    }
}

async fn save(State(inside): State<Arc<Inside>>, Json(drawn): Json<Drawn>) -> Response {
    match put(&inside.sheet, &drawn) {
        Ok(()) => {
            inside.saved.lock().unwrap_or_else(PoisonError::into_inner).0 += 1;
            Json(json!({ "saved": inside.sheet.recipe.display().to_string() })).into_response()
        }
        Err(problems) => refused(&problems),
    }
}

/// Puts what was drawn into the file, where the recipe is still one with it.
fn put(sheet: &Sheet, drawn: &Drawn) -> Result<(), Vec<String>> {
    let (text, _) = read(sheet)?;
    let [width, height] = sheet.size_px.map(|size| size as f64);
    let outside = |[u, v]: &[f64; 2]| !(0.0..=width - 1.0).contains(u) || !(0.0..=height - 1.0).contains(v);
    let quadrilaterals = drawn.masked_px.iter().chain(&drawn.held_px).flatten();
    let all = quadrilaterals.chain(&drawn.outline_px).chain(&drawn.corners_px);
    if let Some([u, v]) = all.into_iter().find(|corner| outside(corner)) {
        return Err(vec![format!("({u:.1}, {v:.1}) px is outside of the picture, {width}×{height} px")]);
    }
    let edited = drawn_into(&text, drawn).map_err(|error| vec![error.to_string()])?;
    let name = sheet.recipe.display().to_string();
    checked(&name, &edited)?;
    (sheet.write)(&edited).map_err(|problem| vec![problem])
}

async fn end(State(inside): State<Arc<Inside>>) -> Response {
    if let Some(tell) = inside.saved.lock().unwrap_or_else(PoisonError::into_inner).1.take() {
        #[expect(clippy::let_underscore_must_use, reason = "refused where it has ended already")]
        let _ = tell.send(());
    }
    Json(json!({ "done": true })).into_response()
}

#[cfg(test)]
mod tests;
