//! The data of a page as a file: CSV for a spreadsheet, JSON for a program.

use super::layout::error_page;
use super::visitor::Visitor;
use axum::Json;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use panelprep_store::history::Table;
use serde::Serialize;

/// The requested format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DownloadFormat {
    Page,
    Csv,
    Json,
}

/// Returns a table as a file; `name` is the file name without its extension.
pub(super) fn csv(visitor: &Visitor, name: &str, table: &Table) -> Response {
    csv_file(name, table).unwrap_or_else(|error| error_page(visitor, &error))
}

/// Returns the same file for callers that report a failure differently.
///
/// # Errors
/// If a row does not have the same length as the names of the columns.
pub(in crate::daemon) fn csv_file(name: &str, table: &Table) -> Result<Response, csv::Error> {
    let named = format!("attachment; filename=\"{name}.csv\"");
    let headers =
        [(header::CONTENT_TYPE, "text/csv; charset=utf-8".to_owned()), (header::CONTENT_DISPOSITION, named)];
    Ok((headers, table.csv()?).into_response())
}

/// Returns the same data as JSON for a program.
pub(super) fn json(data: &impl Serialize) -> Response {
    Json(data).into_response()
}
