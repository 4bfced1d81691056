//! Comparison across all cells, in two parts. Values of one quantity of a panel, and of the verifications: which cell
//! differs from the others, and which cell drifts. Versions of a panel's recipe: which cell uses which version, and how
//! two versions differ.

use super::cycles::select_list;
use super::shared;
use super::shared::{Shared, archive_error_page, day};
use crate::daemon::web::show_difference;
use crate::report::{ChartTexts, trend_chart};
use axum::Json;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use maud::{Markup, html};
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::Limit;
use panelprep_interfaces::archive::ArchiveError;
use panelprep_interfaces::archive::reading::{CellNumbers, RecipeUse};
use panelprep_store::history::{Cell, KnownQuantity, Table, Trend};
use panelprep_store::office::RecipeOffer;
use serde::Deserialize;

/// Maximum number of shown values over all cells.
const MAX_SHOWN_VALUES: i64 = 2_000;
/// Maximum number of shown verifications of each cell.
const MAX_VERIFICATIONS_PER_CELL: i64 = 200;
/// Number of newest values of a cell whose mean is compared with that of its earlier values.
const RECENT_VALUE_COUNT: usize = 10;
const SUBJECTS: [&str; 4] = ["scanner", "flange_camera", "tool", "tool_force"];

/// The requested quantity and panel.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct NumbersQuery {
    panel: String,
    quantity: String,
    subject: String,
}

struct FoundValues {
    panels: Vec<String>,
    query: NumbersQuery,
    cells: Vec<CellNumbers>,
}

async fn numbers(shared: &Shared, mut query: NumbersQuery) -> Result<FoundValues, ArchiveError> {
    let (panels, _) = shared.reader().names().await?;
    if query.panel.is_empty() {
        query.panel = panels.first().cloned().unwrap_or_default();
    }
    if query.quantity.is_empty() {
        KnownQuantity::LocalizationError.keyword().clone_into(&mut query.quantity);
    }
    let cells = shared.reader().numbers(&query.panel, &query.quantity, MAX_SHOWN_VALUES).await?;
    Ok(FoundValues { panels, query, cells })
}

async fn verifications(shared: &Shared, mut query: NumbersQuery) -> Result<FoundValues, ArchiveError> {
    if !SUBJECTS.contains(&query.subject.as_str()) {
        SUBJECTS[0].clone_into(&mut query.subject);
    }
    let cells = shared.reader().verifications(&query.subject, MAX_VERIFICATIONS_PER_CELL).await?;
    Ok(FoundValues { panels: Vec::new(), query, cells })
}

pub(super) async fn page(State(shared): State<Shared>, Query(query): Query<NumbersQuery>) -> Response {
    match numbers(&shared, query).await {
        Ok(found) => shared::page("Numbers", "/numbers", None, &numbers_body(&found)),
        Err(error) => archive_error_page(&error),
    }
}

pub(super) async fn csv(State(shared): State<Shared>, Query(query): Query<NumbersQuery>) -> Response {
    numbers(&shared, query)
        .await
        .map_or_else(|error| archive_error_page(&error), |found| shared::csv("numbers", &table(&found.cells)))
}

pub(super) async fn json(State(shared): State<Shared>, Query(query): Query<NumbersQuery>) -> Response {
    numbers(&shared, query)
        .await
        .map_or_else(|error| archive_error_page(&error), |found| Json(found.cells).into_response())
}

pub(super) async fn verifications_page(
    State(shared): State<Shared>,
    Query(query): Query<NumbersQuery>,
) -> Response {
    match verifications(&shared, query).await {
        Ok(found) => shared::page("Verifications", "/verifications", None, &verifications_body(&found)),
        Err(error) => archive_error_page(&error),
    }
}

pub(super) async fn verifications_csv(State(shared): State<Shared>, Query(query): Query<NumbersQuery>) -> Response {
    let found = verifications(&shared, query).await;
    found
        .map_or_else(|error| archive_error_page(&error), |found| shared::csv("verifications", &table(&found.cells)))
}

pub(super) async fn verifications_json(
    State(shared): State<Shared>,
    Query(query): Query<NumbersQuery>,
) -> Response {
    verifications(&shared, query)
        .await
        .map_or_else(|error| archive_error_page(&error), |found| Json(found.cells).into_response())
}

fn table(cells: &[CellNumbers]) -> Table {
    let rows = cells.iter().flat_map(|cell| {
        cell.points.iter().map(|point| {
            let limit = point.limit.value().map_or(Cell::Empty, Cell::Number);
            vec![Cell::Text(cell.cell.clone()), Cell::Whole(point.at_unix_s), Cell::Number(point.value), limit]
        })
    });
    Table::new(&["cell", "at_unix_s", "value", "limit"]).with_rows(rows)
}

fn numbers_body(FoundValues { panels, query, cells }: &FoundValues) -> Markup {
    let known = query.quantity.parse::<KnownQuantity>().ok();
    let (title, unit) = match known {
        Some(known) => known.title_and_unit(),
        None => (query.quantity.as_str(), ""),
    };
    let words: Vec<&str> = KnownQuantity::keywords();
    html! {
        section.card {
            h2 { "Measured values of a panel over all cells" }
            form.search method="get" action="/numbers" {
                (select_list("Panel", "panel", &query.panel, panels.iter().map(String::as_str)))
                (select_list("Number", "quantity", &query.quantity, words.into_iter()))
                button.primary type="submit" { "Show" }
            }
            @let address = shared::address(&[("panel", &query.panel), ("quantity", &query.quantity)]);
            p.links { a href={ "/numbers.csv?" (address) } { "CSV" } " · " a href={ "/numbers.json?" (address) } { "JSON" } }
            p.note { "The newest " (MAX_SHOWN_VALUES) " values over all cells." }
        }
        (compare_cells((title, unit), cells))
    }
}

fn verifications_body(FoundValues { query, cells, .. }: &FoundValues) -> Markup {
    let known = [
        KnownQuantity::ScannerVerification,
        KnownQuantity::FlangeCameraVerification,
        KnownQuantity::ToolVerification,
        KnownQuantity::ForceVerification,
    ];
    let known = known.into_iter().find(|known| known.verified_subject() == Some(&query.subject));
    let (title, unit) = known.map_or(("verification", ""), KnownQuantity::title_and_unit);
    html! {
        section.card {
            h2 { "Verifications of all cells" }
            form.search method="get" action="/verifications" {
                (select_list("What was verified", "subject", &query.subject, SUBJECTS.into_iter()))
                button.primary type="submit" { "Show" }
            }
            @let address = shared::address(&[("subject", &query.subject)]);
            p.links { a href={ "/verifications.csv?" (address) } { "CSV" } " · " a href={ "/verifications.json?" (address) } { "JSON" } }
            p.note { "The newest " (MAX_VERIFICATIONS_PER_CELL) " of each cell." }
        }
        (compare_cells((title, unit), cells))
    }
}

/// Returns a table that compares the cells, with a chart of each cell.
fn compare_cells((title, unit): (&str, &str), cells: &[CellNumbers]) -> Markup {
    html! {
        section.card {
            h2 { (title) @if !unit.is_empty() { " [" (unit) "]" } }
            @if cells.is_empty() { p { "There are no values." } } @else {
                div.scroll tabindex="0" { table {
                    thead { tr { th { "Cell" } th { "Values" } th { "Mean" } th { "Standard deviation" } th { "Mean of the last " (RECENT_VALUE_COUNT) } th { "Drift" } th { "Last value, % of its limit" } } }
                    tbody { @for cell in cells { (row(cell)) } }
                } }
            }
            p.note { "Drift: the mean of the last " (RECENT_VALUE_COUNT) " values minus the mean of the earlier \
                values, in standard errors; more than 3 is marked." }
        }
        @for cell in cells {
            section.card {
                h2 { (cell.cell) }
                @let trend = Trend::from_points((title.to_owned(), unit.to_owned()), cell.points.clone(), 0);
                (trend_chart(&trend, WORDS))
            }
        }
    }
}

const WORDS: ChartTexts<'_> = ChartTexts {
    cycle: "time (UTC)",
    usual: "as usual",
    unusual: "unusual by the Western Electric rules",
    beyond: "beyond its limit",
    limit: "limit",
    mean: "mean",
};

fn row(cell: &CellNumbers) -> Markup {
    let values: Vec<f64> = cell.points.iter().map(|point| point.value).collect();
    let share = cell.points.last().and_then(|point| match point.limit {
        Limit::AtMost(limit) | Limit::Below(limit) if limit > 0.0 => Some(point.value / limit),
        _ => None,
    });
    let (mean, deviation) = spread(&values);
    let drift = drift_in_errors(&values);
    html! {
        tr {
            th scope="row" { (cell.cell) }
            td { (values.len()) }
            td { (fixed_decimals(mean, 4)) }
            td { (fixed_decimals(deviation, 4)) }
            td { (fixed_decimals(spread(&values[values.len().saturating_sub(RECENT_VALUE_COUNT)..]).0, 4)) }
            td { @match drift { Some(drift) => { @if drift.abs() > 3.0 { "⚠ " } (fixed_decimals(drift, 1)) }, None => "–" } }
            td { @match share { Some(share) => { @if share > 0.8 { "⚠ " } (fixed_decimals(100.0 * share, 0)) " %" }, None => "–" } }
        }
    }
}

fn spread(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0).max(1.0)).sqrt())
}

/// Returns the difference between the mean of the newest values and the mean of the earlier values, divided by the
/// standard error of the difference; `None` if there are too few values.
fn drift_in_errors(values: &[f64]) -> Option<f64> {
    let late = values.len().checked_sub(RECENT_VALUE_COUNT).filter(|before| *before >= RECENT_VALUE_COUNT)?;
    let (before, late) = values.split_at(late);
    let ((was, was_deviation), (is, is_deviation)) = (spread(before), spread(late));
    let error = (was_deviation.powi(2) / before.len() as f64 + is_deviation.powi(2) / late.len() as f64).sqrt();
    (error > 0.0).then(|| (is - was) / error)
}

/// Number of hexadecimal digits of a hash that are shown.
const SHORT_HASH_DIGITS: usize = 12;

/// The panel whose recipes are requested.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct RecipesQuery {
    panel: String,
}

pub(super) async fn recipes_page(
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
            shared::page("Recipes", "/recipes", None, &recipes_body(&panels, &panel, &uses, offer.as_ref()))
        }
        Err(error) => archive_error_page(&error),
    }
}

fn recipes_body(panels: &[String], panel: &str, uses: &[RecipeUse], offer: Option<&RecipeOffer>) -> Markup {
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
                    (shared::time(offer.unix_ms.div_euclid(1_000))) ", because: " (offer.why) ". Cells that have run it: " (taken) "."
                }
            }
            @if uses.is_empty() { p { "No cycle of this panel is archived." } } @else {
                div.scroll tabindex="0" { table {
                    thead { tr { th { "Version" } th { "Cell" } th { "First used" } th { "Last used" } th { "Cycles" } th { "Passed" } th { "Difference" } } }
                    tbody { @for one in uses { tr {
                        td { a href={ "/recipe?" (shared::address(&[("hash", &one.recipe_hash)])) } { code { (short(&one.recipe_hash)) } } }
                        td { (one.cell) }
                        td { (day(one.first_unix_s)) }
                        td { (day(one.last_unix_s)) }
                        td { (one.cycles) }
                        td { (fixed_decimals(100.0 * one.passed as f64 / one.cycles.max(1) as f64, 0)) " %" }
                        td { @if let Some(newest) = newest.filter(|newest| *newest != one.recipe_hash) {
                            a href={ "/recipe?" (shared::address(&[("hash", newest), ("before", &one.recipe_hash)])) } { "to " (short(newest)) }
                        } }
                    } } }
                } }
            }
        }
    }
}

/// The requested version of a recipe, and the version with which it is compared.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct RecipeVersions {
    hash: String,
    before: String,
}

pub(super) async fn recipe_text(
    State(shared): State<Shared>,
    Query(RecipeVersions { hash, before }): Query<RecipeVersions>,
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
                Some(before) => (show_difference(&before, &text)),
                None => pre.scroll tabindex="0" { (text) },
            }
        }
    };
    shared::page("Recipe", "/recipes", None, &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected value, calculated by hand: twenty values 1, 3, 1, 3, … have the mean 2 and the variance 20/19. The mean
    /// of ten further values is 4 higher. The difference is 4 / √(1.0526/20 + 1.1111/10) = 9.885 standard errors.
    #[test]
    fn a_drift_is_reported_in_standard_errors() {
        let swing = |count: usize, by: f64| (0..count).map(move |index| by + 1.0 + 2.0 * (index % 2) as f64);
        let values: Vec<f64> = swing(20, 0.0).chain(swing(10, 4.0)).collect();
        assert!((drift_in_errors(&values).expect("enough") - 9.885).abs() < 1e-3, "{:?}", drift_in_errors(&values));
        assert_eq!(drift_in_errors(&values[..19]), None);
        assert_eq!(drift_in_errors(&[2.0; 40]), None, "without any spread nothing is said");
    }
}
