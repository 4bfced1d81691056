//! Reading the store for a page, beside the page's runtime.

use super::guard::not_found_page;
use super::layout::error_page;
use super::state::{Web, run_blocking};
use super::visitor::Visitor;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use panelprep_store::store::{Store, StoreError};
use std::sync::Arc;

/// The answer of a handler: a page, or an error response in its place.
pub(super) type Answer = Result<Response, Response>;

/// Reads the store. If the data does not exist or cannot be read, the error becomes the response.
pub(super) async fn reading<T: Send + 'static>(
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

/// Does work that may wait for a disk; an error, in words, becomes the response.
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
