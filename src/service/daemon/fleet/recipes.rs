//! The versions of a panel's recipe: which cell uses which version, and how two versions differ.

use super::cycles::select_list;
use super::frame::{self, day};
use super::shared::{Shared, archive_error_page};
use crate::daemon::web::difference;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use maud::{Markup, html};
use panelprep_base::number_text::fixed_decimals;
use panelprep_interfaces::archive::reading::RecipeUse;
use panelprep_store::office::RecipeOffer;
use serde::Deserialize;

/// Number of digits of a hash that are shown.
const SHORT_HASH_DIGITS: usize = 12;

/// The panel whose recipes are shown.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct RecipesQuery {
    panel: String,
}

pub(super) async fn page(
    State(shared): State<Shared>,
    Query(RecipesQuery { panel }): Query<RecipesQuery>,
) -> Response {
    let read = async {
        let (panels, _) = shared.reader().names().await?;
        let panel = if panel.is_empty() { panels.first().cloned().unwrap_or_default() } else { panel };
        let uses = shared.reader().recipes(&panel).await?;
        let offer = shared.reader().offer(&panel).await?;
        Ok((panels, panel, uses, offer))
    };
    match read.await {
        Ok((panels, panel, uses, offer)) => {
            frame::page("Recipes", "/recipes", None, &body(&panels, &panel, &uses, offer.as_ref()))
        }
        Err(error) => archive_error_page(&error),
    }
}

fn body(panels: &[String], panel: &str, uses: &[RecipeUse], offer: Option<&RecipeOffer>) -> Markup {
    let short = |hash: &str| hash.get(..SHORT_HASH_DIGITS).unwrap_or(hash).to_owned();
    let newest = uses.first().map(|one| one.recipe_hash.as_str());
    html! {
        section.card {
            h2 { "Recipes of a panel" }
            form.search method="get" action="/recipes" {
                (select_list("Panel", "panel", panel, panels.iter().map(String::as_str)))
                button.primary type="submit" { "Show" }
            }
            @if let Some(offer) = offer {
                @let taken = uses.iter().filter(|one| one.recipe_hash == offer.hash()).count();
                p {
                    "Offered to all cells: version " code { (short(&offer.hash())) } ", approved by " (offer.by) ", "
                    (frame::time(offer.unix_ms.div_euclid(1_000))) ", because: " (offer.why) ". Cells that have run it: " (taken) "."
                }
            }
            @if uses.is_empty() { p { "No cycle of this panel is archived." } } @else {
                div.scroll tabindex="0" { table {
                    thead { tr { th { "Version" } th { "Cell" } th { "First used" } th { "Last used" } th { "Cycles" } th { "Passed" } th { "Difference" } } }
                    tbody { @for one in uses { tr {
                        td { a href={ "/recipe?" (frame::address(&[("hash", &one.recipe_hash)])) } { code { (short(&one.recipe_hash)) } } }
                        td { (one.cell) }
                        td { (day(one.first_unix_s)) }
                        td { (day(one.last_unix_s)) }
                        td { (one.cycles) }
                        td { (fixed_decimals(100.0 * one.passed as f64 / one.cycles.max(1) as f64, 0)) " %" }
                        td { @if let Some(newest) = newest.filter(|newest| *newest != one.recipe_hash) {
                            a href={ "/recipe?" (frame::address(&[("hash", newest), ("before", &one.recipe_hash)])) } { "to " (short(newest)) }
                        } }
                    } } }
                } }
            }
        }
    }
}

/// The version that is shown, and the version with which it is compared.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct Version {
    hash: String,
    before: String,
}

pub(super) async fn text(
    State(shared): State<Shared>,
    Query(Version { hash, before }): Query<Version>,
) -> Response {
    let reader = shared.reader().clone();
    let read =
        move || [hash, before].map(|hash| reader.file(&hash).and_then(|bytes| String::from_utf8(bytes).ok()));
    let Ok([Some(text), before]) = tokio::task::spawn_blocking(read).await else {
        return (StatusCode::NOT_FOUND, "The archive does not have this recipe.").into_response();
    };
    let body = html! {
        section.card {
            h2 { "Recipe" }
            @match before {
                Some(before) => (difference(&before, &text)),
                None => pre.scroll tabindex="0" { (text) },
            }
        }
    };
    frame::page("Recipe", "/recipes", None, &body)
}
