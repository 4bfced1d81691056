//! The page on which a person draws on the taught picture: the region, its grids, the masked areas, the panel's outline
//! and the held places.
//!
//! The drawing area with its tools (`canvas`) is the same as on the operator's page. Requests: `GET .` the page · `GET
//! drawing.json` the recipe's shapes · `GET picture.png` · `POST save` the drawn shapes, which are written to the
//! recipe's file if the resulting recipe is valid, otherwise the problems are returned · `POST done` ends the page.

pub mod canvas;

use super::{LocalError, LocalServer, Session};
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

/// A function that writes the new text of the recipe, either completely or not at all.
pub type WriteRecipe = dyn Fn(&str) -> Result<(), String> + Send + Sync;

/// The picture on which a person draws, and the recipe to edit.
pub struct DrawingSheet {
    /// The path of the recipe.
    pub recipe: PathBuf,
    /// The taught picture, PNG.
    pub picture_png: Vec<u8>,
    /// Width and height of the picture, px.
    pub size_px: [usize; 2],
    /// The function that writes the recipe.
    pub write: Box<WriteRecipe>,
}

struct PageState {
    sheet: DrawingSheet,
    session: Session,
}

/// Serves the page until the person ends it, and returns how many times the recipe was saved.
///
/// # Errors
/// If the server cannot be run.
pub fn serve(local: LocalServer, sheet: DrawingSheet) -> Result<u32, LocalError> {
    let (session, done) = Session::new();
    let inside = Arc::new(PageState { sheet, session });
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

async fn picture(State(inside): State<Arc<PageState>>) -> Response {
    ([(header::CONTENT_TYPE, "image/png")], inside.sheet.picture_png.clone()).into_response()
}

/// Reads and parses the present file of the recipe.
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

async fn drawing(State(inside): State<Arc<PageState>>) -> Response {
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

async fn save(State(inside): State<Arc<PageState>>, Json(drawn): Json<DrawnShapes>) -> Response {
    match write_shapes(&inside.sheet, &drawn) {
        Ok(()) => {
            inside.session.count_save();
            Json(json!({ "saved": inside.sheet.recipe.display().to_string() })).into_response()
        }
        Err(problems) => refused(&problems),
    }
}

/// Writes the drawn shapes to the file if the resulting recipe is valid.
fn write_shapes(sheet: &DrawingSheet, drawn: &DrawnShapes) -> Result<(), Vec<String>> {
    let (text, _) = read(sheet)?;
    let name = sheet.recipe.display().to_string();
    let edited = canvas::recipe_with_shapes((&name, &text), sheet.size_px, drawn)?;
    (sheet.write)(&edited).map_err(|problem| vec![problem])
}

async fn end(State(inside): State<Arc<PageState>>) -> Response {
    inside.session.end()
}

/// Tests of the page with requests like those of a browser.
#[cfg(test)]
mod tests {
    use super::super::local_client;
    use super::*;
    use std::thread::JoinHandle;

    const RECIPE: &str = "panel = \"door\" # the left one\n\n[locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [900, 900, 900]\n\n\
                          [region]\ncorners_px = [[10, 10], [90, 10], [90, 60], [10, 60]] # from the ruler\nrows = 2\ncolumns = 3\n";

    struct Open {
        url: String,
        serving: JoinHandle<u32>,
        folder: tempfile::TempDir,
    }

    fn open() -> Open {
        let folder = tempfile::tempdir().expect("a folder");
        let recipe = folder.path().join("door.toml");
        std::fs::write(&recipe, RECIPE).expect("written");
        let file = recipe.clone();
        let write = Box::new(move |text: &str| std::fs::write(&file, text).map_err(|error| error.to_string()));
        let sheet = DrawingSheet { recipe, picture_png: vec![1, 2, 3], size_px: [100, 80], write };
        let local = LocalServer::listen(([127, 0, 0, 1], 0).into()).expect("a port");
        let url = local.url();
        Open { url, serving: std::thread::spawn(move || serve(local, sheet).expect("served")), folder }
    }

    impl Open {
        fn host(&self) -> &str {
            local_client::address(&self.url)
        }

        /// Sends a request with this host name, and returns the status and the body.
        fn ask_as(&self, host: &str, method: &str, path: &str, body: &str) -> (u16, String) {
            let (status, answer) = local_client::ask(self.host(), host, [method, path, body]);
            (status, answer.split_once("\r\n\r\n").map_or(String::new(), |(_, body)| body.to_owned()))
        }

        fn ask(&self, method: &str, page: &str, body: &str) -> (u16, String) {
            let key = self.url.trim_end_matches('/').rsplit('/').next().expect("a key").to_owned();
            self.ask_as(self.host(), method, &format!("/{key}/{page}"), body)
        }

        fn recipe(&self) -> String {
            std::fs::read_to_string(self.folder.path().join("door.toml")).expect("the recipe")
        }
    }

    const DRAWN: &str = r#"{"corners_px":[[12,10],[90,10],[90.26,60],[10,60]],"rows":4,"columns":3,"masked_px":[[[20,20],[30,20],[30,30],[20,30]]],"outline_px":[[2,2],[97,2],[97,70],[2,70]],"held_px":[[[40,0],[60,0],[60,6],[40,6]]]}"#;

    #[test]
    fn drawn_shapes_are_written_to_the_recipe() {
        let page = open();
        let (status, found) = page.ask("GET", "drawing.json", "");
        assert!(status == 200 && found.contains(r#""corners_px":[[10.0,10.0],[90.0,10.0]"#), "{status} {found}");
        for (file, words) in [
            ("", "Region of panel"),
            ("sheet.js", "pointerdown"),
            ("drawing.js", "./sheet.js"),
            ("sheet.css", ".corner"),
        ] {
            let (status, text) = page.ask("GET", file, "");
            assert!(status == 200 && text.contains(words), "{file}: {status}");
        }
        let html = page.ask("GET", "", "").1;
        assert!(html.contains("Add a mask") && !html.contains("{draw.") && !html.contains("{words}"), "{html}");
        let (status, reported) = page.ask("POST", "save", DRAWN);
        assert!(status == 200 && reported.contains("door.toml"), "{status} {reported}");
        let expected = RECIPE
            .replace("[[10, 10], [90, 10], [90, 60], [10, 60]]", "[[12, 10], [90, 10], [90.3, 60], [10, 60]]")
            .replace("rows = 2", "rows = 4")
            .replace("panel = \"door\" # the left one\n", "panel.name = \"door\" # the left one\n\
                     panel.outline_px = [[2, 2], [97, 2], [97, 70], [2, 70]]\npanel.held_px = [[[40, 0], [60, 0], [60, 6], [40, 6]]]\n");
        assert!(page.recipe().starts_with(&expected), "{}", page.recipe());
        assert!(page.recipe().contains("masked_px = [[[20, 20], [30, 20], [30, 30], [20, 30]]]"));
        assert_eq!(page.ask("POST", "done", "").0, 200);
        assert_eq!(page.serving.join().expect("it ends"), 1, "saved once");
    }

    #[test]
    fn an_invalid_region_changes_nothing() {
        let page = open();
        let crossed = DRAWN.replace("[12,10],[90,10]", "[90,10],[12,10]");
        let twisted = DRAWN.replace("[2,2],[97,2]", "[97,2],[2,2]");
        let outside = DRAWN.replace("[12,10]", "[100,10]");
        for (body, words) in [
            (&*crossed, "must be in order around"),
            (&twisted, "the outline crosses itself"),
            (&outside, "outside the picture (100×80 px)"),
        ] {
            let (status, told) = page.ask("POST", "save", body);
            assert!(status == 422 && told.contains(words), "{status} {told}");
        }
        assert!(page.ask("POST", "save", "{}").0 >= 400);
        assert_eq!(page.recipe(), RECIPE);
    }

    /// A page of another website in the same browser does not know the key, and its requests name another host.
    #[test]
    fn no_other_client_is_served() {
        let page = open();
        assert_eq!(page.ask_as(page.host(), "GET", "/", "").0, 404);
        assert_eq!(page.ask_as(page.host(), "GET", "/0123/drawing.json", "").0, 404);
        let key = page.url.trim_end_matches('/').rsplit('/').next().expect("a key");
        assert_eq!(page.ask_as("evil.example", "GET", &format!("/{key}/drawing.json"), "").0, 403);
        assert!(LocalServer::listen(([0, 0, 0, 0], 0).into()).is_err(), "not for the whole network");
    }
}
