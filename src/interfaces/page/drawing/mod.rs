//! The page on which a person draws on the taught scan's picture: the region, its grids, the masked areas, the panel's
//! outline and the places that hold the panel.
//!
//! The sheet with its tools (`canvas`) is the same as on the operator's page. Requests: `GET .` the page · `GET
//! drawing.json` the recipe's shapes · `GET picture.png` · `POST save` the drawn shapes: they are written to the
//! recipe's file if the recipe's own check accepts them, otherwise the problems are returned · `POST done` ends the
//! page.

pub mod canvas;

use super::session::Session;
use super::{LocalError, LocalServer};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use panelprep_base::disk;
use panelprep_cell::recipe::{DrawnShapes, Recipe};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;

const PAGE: &str = include_str!("drawing.html");
const SCRIPT: &str = include_str!("drawing.js");
const STYLE_SHEET: &str = include_str!("drawing.css");
const BUTTONS: &str = include_str!("buttons.html");

/// Writes the recipe's new text completely or not at all.
pub type WriteRecipe = dyn Fn(&str) -> Result<(), String> + Send + Sync;

/// The data on which a person draws.
pub struct DrawingSheet {
    /// The recipe's file.
    pub recipe: PathBuf,
    /// The scan's picture, PNG.
    pub picture_png: Vec<u8>,
    /// Its size, px.
    pub size_px: [usize; 2],
    /// Function that stores the recipe.
    pub write: Box<WriteRecipe>,
}

struct Inside {
    sheet: DrawingSheet,
    session: Session,
}

/// Serves the page until the person is done; returns how often the recipe was saved.
///
/// # Errors
/// If the operating system refuses what the server needs.
pub fn serve(local: LocalServer, sheet: DrawingSheet) -> Result<u32, LocalError> {
    let (session, done) = Session::new();
    let inside = Arc::new(Inside { sheet, session });
    let text =
        |kind: &'static str, text: &'static str| get(move || async move { ([(header::CONTENT_TYPE, kind)], text) });
    let pages = Router::new()
        .route(&local.path(""), get(page))
        .route(&local.path("sheet.js"), text("text/javascript; charset=utf-8", canvas::SCRIPT))
        .route(&local.path("sheet.css"), text("text/css; charset=utf-8", canvas::STYLE_SHEET))
        .route(&local.path("drawing.js"), text("text/javascript; charset=utf-8", SCRIPT))
        .route(&local.path("drawing.css"), text("text/css; charset=utf-8", STYLE_SHEET))
        .route(&local.path("picture.png"), get(picture))
        .route(&local.path("drawing.json"), get(drawing))
        .route(&local.path("save"), post(save))
        .route(&local.path("done"), post(end))
        .with_state(inside.clone());
    local.serve(pages, done)?;
    Ok(inside.session.save_count())
}

async fn page() -> Html<String> {
    Html(PAGE.replace(
        "{sheet}",
        &canvas::sheet_markup("picture.png", BUTTONS, |key| canvas::english_text(key).unwrap_or_default()),
    ))
}

async fn picture(State(inside): State<Arc<Inside>>) -> Response {
    ([(header::CONTENT_TYPE, "image/png")], inside.sheet.picture_png.clone()).into_response()
}

/// Reads the recipe's file as it is now.
fn read(sheet: &DrawingSheet) -> Result<(String, Recipe), Vec<String>> {
    let name = sheet.recipe.display().to_string();
    let bytes = disk::read(&sheet.recipe).map_err(|error| vec![format!("{name}: {error}")])?;
    let text = String::from_utf8(bytes).map_err(|error| vec![format!("{name}: {error}")])?;
    let recipe = canvas::check_recipe(&name, &text)?;
    Ok((text, recipe))
}

fn refused(problems: &[String]) -> Response {
    (StatusCode::UNPROCESSABLE_ENTITY, Json(json!({ "problems": problems }))).into_response()
}

async fn drawing(State(inside): State<Arc<Inside>>) -> Response {
    let sheet = &inside.sheet;
    match read(sheet) {
        Ok((_, recipe)) => {
            let body: Value = json!({
                "panel": recipe.panel(), "recipe": sheet.recipe.display().to_string(), "drawn": canvas::recipe_shapes(&recipe),
            });
            Json(body).into_response()
        }
        Err(problems) => refused(&problems),
    }
}

async fn save(State(inside): State<Arc<Inside>>, Json(drawn): Json<DrawnShapes>) -> Response {
    match write_shapes(&inside.sheet, &drawn) {
        Ok(()) => {
            inside.session.count_save();
            Json(json!({ "saved": inside.sheet.recipe.display().to_string() })).into_response()
        }
        Err(problems) => refused(&problems),
    }
}

/// Writes the drawn shapes to the file if the result is still a valid recipe.
fn write_shapes(sheet: &DrawingSheet, drawn: &DrawnShapes) -> Result<(), Vec<String>> {
    let (text, _) = read(sheet)?;
    let name = sheet.recipe.display().to_string();
    let edited = canvas::recipe_with_shapes((&name, &text), sheet.size_px, drawn)?;
    (sheet.write)(&edited).map_err(|problem| vec![problem])
}

async fn end(State(inside): State<Arc<Inside>>) -> Response {
    inside.session.end()
}

#[cfg(test)]
mod tests;
