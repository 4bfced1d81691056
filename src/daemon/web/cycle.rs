//! The record of one cycle.

use super::guard::{By, not_found};
use super::layout::failed;
use super::state::{Web, blocking};
use crate::record::{CycleId, CycleRecord};
use crate::report::cycle_page;
use crate::store::{Store, StoreError};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The record's page has its style and its pictures inside, and no script.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; form-action 'none'; base-uri 'none'; \
                      frame-ancestors 'none'";

/// A cycle's page as a person reads and prints it.
pub(super) async fn page(
    State(web): State<Arc<Web>>,
    Extension(visitor): By,
    Path(number): Path<String>,
) -> Response {
    let Some(id) = id(&number) else { return not_found().await };
    match blocking(move || web.read(|store| rendered(store, id))).await {
        Some(Ok(html)) => {
            let headers =
                [(header::CONTENT_TYPE, "text/html; charset=utf-8"), (header::CONTENT_SECURITY_POLICY, POLICY)];
            (headers, html).into_response()
        }
        Some(Err(StoreError::UnknownCycle { .. })) => not_found().await,
        Some(Err(error)) => failed(&visitor, &error),
        None => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

fn id(number: &str) -> Option<CycleId> {
    number.parse().ok().filter(|number| *number > 0).map(CycleId)
}

fn rendered(store: &Store, id: CycleId) -> Result<String, StoreError> {
    let record = store.cycle(id)?;
    let pictures = record.findings.iter().flat_map(|finding| &finding.pictures);
    // One that is missing is said to be, on the page.
    let pictures: BTreeMap<String, Vec<u8>> =
        pictures.filter_map(|picture| Some((picture.hash.clone(), store.blob(&picture.hash).ok()?))).collect();
    Ok(cycle_page(&record, &pictures).html())
}

/// A cycle's record as JSON.
pub(super) async fn json(
    State(web): State<Arc<Web>>,
    Extension(visitor): By,
    Path(number): Path<String>,
) -> Response {
    let Some(id) = id(&number) else { return not_found().await };
    match blocking(move || web.read(|store| store.cycle(id))).await {
        Some(Ok(record)) => Json(record).into_response(),
        Some(Err(StoreError::UnknownCycle { .. })) => not_found().await,
        Some(Err(error)) => failed(&visitor, &error),
        None => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

/// A picture that a finding of the cycle names.
pub(super) async fn picture(
    State(web): State<Arc<Web>>,
    Extension(visitor): By,
    Path((number, finding, picture)): Path<(String, usize, usize)>,
) -> Response {
    let Some(id) = id(&number) else { return not_found().await };
    let read = move || {
        web.read(|store| {
            let record: CycleRecord = store.cycle(id)?;
            let named = record.findings.get(finding).and_then(|finding| finding.pictures.get(picture));
            named.map(|picture| store.blob(&picture.hash)).transpose()
        })
    };
    match blocking(read).await {
        Some(Ok(Some(jpeg))) => ([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response(),
        Some(Ok(None) | Err(StoreError::UnknownCycle { .. })) => not_found().await,
        Some(Err(error)) => failed(&visitor, &error),
        None => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}
