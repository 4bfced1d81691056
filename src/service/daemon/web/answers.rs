//! The responses of the pages: the store is read outside of the page's runtime, an error becomes a page, and the data
//! of a page is also available as a file: CSV for a spreadsheet, JSON for a program.

use super::guard::not_found_page;
use super::layout::error_page;
use super::sessions::Visitor;
use super::state::{Web, run_blocking};
use axum::Json;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use panelprep_store::history::Table;
use panelprep_store::store::{Store, StoreError};
use serde::Serialize;
use std::sync::Arc;

/// The response of a handler: a page, or an error response.
pub(super) type Answer = Result<Response, Response>;

/// Reads the store. If the data do not exist or cannot be read, the error becomes the response.
pub(super) async fn read_store<T: Send + 'static>(
    web: &Arc<Web>,
    visitor: &Visitor,
    read: impl FnOnce(&Store) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, Response> {
    let shared = web.clone();
    match run_blocking(move || shared.read(read)).await {
        Some(Ok(read)) => Ok(read),
        Some(Err(StoreError::UnknownCycle { .. })) => Err(not_found_page().await),
        Some(Err(error)) => Err(error_page(visitor, &error)),
        None => Err(panic_response()),
    }
}

/// Performs work that may wait for a disk; an error becomes the response.
pub(super) async fn with_store<T: Send + 'static>(
    visitor: &Visitor,
    work: impl FnOnce() -> Result<T, String> + Send + 'static,
) -> Result<T, Response> {
    match run_blocking(work).await {
        Some(Ok(done)) => Ok(done),
        Some(Err(problem)) => Err(error_page(visitor, &problem)),
        None => Err(panic_response()),
    }
}

/// Returns the error response for a thread that panicked; the panic is in the log.
pub(super) fn panic_response() -> Response {
    StatusCode::INTERNAL_SERVER_ERROR.into_response()
}

/// The requested format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DownloadFormat {
    Page,
    Csv,
    Json,
}

/// Returns a table as a CSV file; `name` is the file name without its extension.
pub(super) fn csv(visitor: &Visitor, name: &str, table: &Table) -> Response {
    csv_file(name, table).unwrap_or_else(|error| error_page(visitor, &error))
}

/// Returns a table as a CSV file, for callers that report a failure differently.
///
/// # Errors
/// If a row does not have the same length as the header.
pub(in crate::daemon) fn csv_file(name: &str, table: &Table) -> Result<Response, csv::Error> {
    let named = format!("attachment; filename=\"{name}.csv\"");
    let headers =
        [(header::CONTENT_TYPE, "text/csv; charset=utf-8".to_owned()), (header::CONTENT_DISPOSITION, named)];
    Ok((headers, table.csv()?).into_response())
}

/// Returns the data of a page as JSON.
pub(super) fn json(data: &impl Serialize) -> Response {
    Json(data).into_response()
}
