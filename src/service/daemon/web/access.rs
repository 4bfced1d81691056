//! A route, and who may use it.

use super::state::Web;
use axum::routing::MethodRouter;
use panelprep_cell::accounts::Permission;
use std::sync::Arc;

/// Who may use a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    /// All persons may use the route, logged in or not.
    Open,
    /// Visitors with a role that has this permission.
    Needs(Permission),
}

/// HTTP method of a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Method {
    Get,
    Post,
}

/// A route of the page.
pub(super) struct Route {
    pub path: &'static str,
    pub method: Method,
    pub access: Access,
    pub handler: fn() -> MethodRouter<Arc<Web>>,
}
