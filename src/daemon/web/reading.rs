//! Reading the store for a page, beside the page's runtime.

use super::guard::not_found;
use super::layout::failed;
use super::state::{Web, blocking};
use super::visitor::Visitor;
use crate::store::{Store, StoreError};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
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
    match blocking(move || shared.read(read)).await {
        Some(Ok(read)) => Ok(read),
        Some(Err(StoreError::UnknownCycle { .. })) => Err(not_found().await),
        Some(Err(error)) => Err(failed(visitor, &error)),
        None => Err(ended()),
    }
}

/// Does work that may wait for a disk; an error, in words, becomes the response.
pub(super) async fn doing<T: Send + 'static>(
    visitor: &Visitor,
    work: impl FnOnce() -> Result<T, String> + Send + 'static,
) -> Result<T, Response> {
    match blocking(work).await {
        Some(Ok(done)) => Ok(done),
        Some(Err(problem)) => Err(failed(visitor, &problem)),
        None => Err(ended()),
    }
}

/// Returns the error response for a thread that panicked; the panic is in the log.
pub(super) fn ended() -> Response {
    StatusCode::INTERNAL_SERVER_ERROR.into_response()
}
