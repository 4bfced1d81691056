//! Drawing a recipe's region, outline and masks on the taught scan's picture. The drawing becomes a proposed recipe
//! text, shown with its differences; the text is approved and saved like every other change of a recipe.

use super::guard::{VisitorExtension, refusal};
use super::layout::{Frame, Script};
use super::reading::{Answer, panic_response};
use super::state::{Web, run_blocking};
use super::versions::difference;
use crate::daemon::sources::SetupSource;
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use maud::{Markup, PreEscaped, html};
use panelprep_cell::files;
use panelprep_cell::files::content_hash;
use panelprep_cell::recipe::DrawnShapes;
use panelprep_interfaces::page::drawing::canvas;
use serde_json::json;
use std::sync::Arc;

/// Does work with the recipes that may wait for a disk; an error becomes the response.
async fn with_recipes<T: Send + 'static>(
    web: &Web,
    work: impl FnOnce(&dyn SetupSource) -> Result<T, String> + Send + 'static,
) -> Result<T, Response> {
    let source = web.front.setup.clone();
    match run_blocking(move || work(&*source)).await {
        Some(Ok(done)) => Ok(done),
        Some(Err(problem)) => Err(refusal(StatusCode::UNPROCESSABLE_ENTITY, "recipe", &problem)),
        None => Err(panic_response()),
    }
}

/// Shows the sheet with its tools, and the form that approves the drawing.
pub(super) async fn page(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(name): Path<String>,
) -> Answer {
    let asked = name.clone();
    with_recipes(&web, move |source| source.recipe(&asked)).await?;
    let words = visitor.language();
    let word = |key| words.text(key);
    let own = format!("/setup/recipe/{}", encoded(&name));
    let title = format!("{}: {name}", word("setup.draw"));
    let sheet = canvas::sheet_markup(&format!("{own}/picture.png"), "", |key| words.text(key).to_owned());
    let body = html! {
        section.card {
            h2 { (title) }
            p.links { a href=(own) { (word("setup.text")) } }
            p.note { (word("setup.draw_note")) }
            p.told #told role="status" {}
            div.drawing data-recipe=(own) { (PreEscaped(sheet)) }
            button.primary #propose type="button" disabled { (word("setup.propose")) }
        }
        (approval_form(&own, &word))
    };
    Ok(Frame { visitor: &visitor, title: &title, here: "/setup", scripts: &[Script::Draw, Script::Forms] }
        .page(&body))
}

/// Shows the drawing as lines of the recipe, and the form that approves them.
fn approval_form<'w>(own: &str, word: &dyn Fn(&'w str) -> &'w str) -> Markup {
    html! {
        section.card #proposal hidden {
            h2 { (word("setup.proposal")) }
            div #difference {}
            form data-post=(own) data-then=(own) {
                input type="hidden" name="before";
                textarea name="text" hidden aria-label=(word("setup.text")) {}
                label { (word("setup.why")) input name="why" required maxlength="200" autocomplete="off"; }
                p.told role="status" {}
                button.primary type="submit" { (word("setup.save")) }
            }
        }
    }
}

fn encoded(name: &str) -> String {
    form_urlencoded::byte_serialize(name.as_bytes()).collect::<String>().replace('+', "%20")
}

/// Serves the taught scan's picture.
pub(super) async fn picture(State(web): State<Arc<Web>>, Path(name): Path<String>) -> Answer {
    let png = with_recipes(&web, move |source| {
        let picture = source.taught_picture(&name)?;
        files::write_color_png(&picture).map_err(|error| error.to_string())
    });
    Ok(([(header::CONTENT_TYPE, "image/png")], png.await?).into_response())
}

/// Returns the drawing of the recipe's content.
pub(super) async fn drawing(State(web): State<Arc<Web>>, Path(name): Path<String>) -> Answer {
    let drawn = with_recipes(&web, move |source| {
        let text = source.recipe(&name)?.text;
        canvas::check_recipe(&name, &text)
            .map(|recipe| canvas::recipe_shapes(&recipe))
            .map_err(|problems| problems.join("\n"))
    });
    Ok(Json(drawn.await?).into_response())
}

/// Returns the recipe's text with the drawn changes, if it has no errors; nothing is written.
pub(super) async fn propose(
    State(web): State<Arc<Web>>,
    Path(name): Path<String>,
    Json(drawn): Json<DrawnShapes>,
) -> Answer {
    let proposed = with_recipes(&web, move |source| {
        let before = source.recipe(&name)?.text;
        let picture = source.taught_picture(&name)?;
        let size_px = [picture.width, picture.height];
        let after = canvas::recipe_with_shapes((&name, &before), size_px, &drawn)
            .map_err(|problems| problems.join("\n"))?;
        match source.problems(&name, &after) {
            problems if problems.is_empty() => Ok((before, after)),
            problems => Err(problems.join("\n")),
        }
    });
    let (before, after) = proposed.await?;
    let difference = difference(&before, &after).into_string();
    let body = json!({
        "text": after, "is_changed": after != before, "difference": difference,
        "before": content_hash(before.as_bytes()),
    });
    Ok(Json(body).into_response())
}
