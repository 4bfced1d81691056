//! Every address of the office's page.

use super::shared::Shared;
use super::{access, cells, cycle, cycles, numbers, recipes};
use axum::http::header;
use axum::response::IntoResponse;
use axum::routing::{get, post};
use axum::{Router, middleware};

/// Returns the router of all addresses, behind the access check.
pub(super) fn router(shared: Shared) -> Router {
    Router::new()
        .route("/", get(cells::page))
        .route("/cells.json", get(cells::json))
        .route("/cycles", get(cycles::page))
        .route("/cycles.csv", get(cycles::csv))
        .route("/cycles.json", get(cycles::json))
        .route("/cycle", get(cycle::page))
        .route("/cycle.json", get(cycle::json))
        .route("/file/{hash}", get(cycle::serve_file))
        .route("/numbers", get(numbers::page))
        .route("/numbers.csv", get(numbers::csv))
        .route("/numbers.json", get(numbers::json))
        .route("/verifications", get(numbers::verifications_page))
        .route("/verifications.csv", get(numbers::verifications_csv))
        .route("/verifications.json", get(numbers::verifications_json))
        .route("/recipes", get(recipes::page))
        .route("/recipe", get(recipes::text))
        .route("/login", get(access::page).post(access::log_in))
        .route("/logout", post(access::log_out))
        .route("/page.css", get(style_sheet))
        .route("/fleet.js", get(script))
        .layer(middleware::from_fn_with_state(shared.clone(), access::require_session))
        .with_state(shared)
}

async fn script() -> impl IntoResponse {
    let headers =
        [(header::CONTENT_TYPE, "text/javascript; charset=utf-8"), (header::CACHE_CONTROL, "max-age=3600")];
    (headers, include_str!("fleet.js"))
}

async fn style_sheet() -> impl IntoResponse {
    let headers = [(header::CONTENT_TYPE, "text/css; charset=utf-8"), (header::CACHE_CONTROL, "max-age=3600")];
    (headers, crate::daemon::web::STYLE_SHEET)
}
