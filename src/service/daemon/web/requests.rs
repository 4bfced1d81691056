//! Requests to the cell from the page: each request passes through the gateway, like a request from the socket.

use super::answers::panic_response;
use super::cameras::not_opened_reason;
use super::guard::VisitorExtension;
use super::messages;
use super::sessions::Visitor;
use super::state::{Web, run_blocking};
use crate::daemon::request::{Reply, RequestKind, RequestResult};
use crate::setup::{self, ProposalLimits, RecipeTextPermission, StartRequest};
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle;
use panelprep_cell::record::PartNames;
use panelprep_cell::record::RequestedAction;
use serde::Deserialize;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

/// Returns the response of the page to a request, with its result.
fn to_response(visitor: &Visitor, reply: &Reply) -> Response {
    let status = match reply.answer {
        RequestResult::Done => StatusCode::OK,
        RequestResult::Refused => StatusCode::CONFLICT,
        RequestResult::Fault => StatusCode::SERVICE_UNAVAILABLE,
    };
    let message = match reply.answer {
        RequestResult::Done => reply.done.clone().unwrap_or_default(),
        _ => messages::text(visitor.language(), &reply.reasons),
    };
    let code =
        reply.reasons.first().map(|reason| reason.code.as_ref()).filter(|_| reply.answer != RequestResult::Done);
    (status, Json(json!({ "code": code, "message": message, "state": reply.state }))).into_response()
}

async fn perform_request(web: &Web, visitor: &Visitor, what: RequestKind) -> Response {
    to_response(visitor, &web.front.gateway.request(what, visitor.as_requester()).await)
}

macro_rules! table_requests {
    ($($name:ident => $request:expr),* $(,)?) => {
        $(pub(super) async fn $name(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Response {
            perform_request(&web, &visitor, RequestKind::Table($request)).await
        })*
    };
}

table_requests! {
    stop => cycle::Request::Stop,
    abort => cycle::Request::Abort,
    reset => cycle::Request::Reset,
}

/// A person's decision that refers to the step shown on the page.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Decision {
    step: u64,
}

/// Confirms that the cause of an abort is removed.
pub(super) async fn clear(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(Decision { step }): Json<Decision>,
) -> Response {
    perform_request(&web, &visitor, RequestKind::Decided { request: cycle::Request::Clear, step }).await
}

/// Accepts a result that waits for review.
pub(super) async fn accept(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(Decision { step }): Json<Decision>,
) -> Response {
    perform_request(&web, &visitor, RequestKind::Decided { request: cycle::Request::Accept, step }).await
}

/// Maximum length of a reason, characters.
const MAX_REASON_CHARACTERS: usize = 200;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Hold {
    #[serde(default)]
    why: String,
}

/// Holds the cycle; the reason that the person gives belongs to this hold only.
pub(super) async fn hold(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(Hold { why }): Json<Hold>,
) -> Response {
    let why: String = why.trim().chars().filter(|c| !c.is_control()).take(MAX_REASON_CHARACTERS).collect();
    let what = match why.is_empty() {
        true => RequestKind::Table(cycle::Request::Hold),
        false => RequestKind::Hold { why },
    };
    perform_request(&web, &visitor, what).await
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Unhold {
    dried: bool,
    step: u64,
}

/// Continues after a hold.
pub(super) async fn unhold(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(Unhold { dried, step }): Json<Unhold>,
) -> Response {
    perform_request(&web, &visitor, RequestKind::Decided { request: cycle::Request::Unhold { dried }, step }).await
}

pub(super) async fn new_disc(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Response {
    perform_request(&web, &visitor, RequestKind::NewDisc).await
}

/// The requested start of a cycle. The operator is the person who is logged in.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Start {
    recipe: String,
    /// SHA-256 of the recipe that was shown on the page.
    sha256: String,
    #[serde(default)]
    serial: String,
    #[serde(default)]
    order: String,
    /// Whether the part in the cell is not the part of earlier cycles.
    #[serde(default)]
    another_part: bool,
    /// Whether the person confirms that the guard is closed and no person is inside the cell.
    #[serde(default)]
    is_clear: bool,
}

/// Refuses a start. The refusal is recorded with the requests to the cell, like the refusal of any other start.
fn refuse_start(web: &Web, visitor: &Visitor, recipe: String, why: Reason) -> Response {
    let wanted = RequestedAction::Start { recipe };
    web.front.gateway.keep_refused(wanted, visitor.as_requester(), vec![why.clone()]);
    to_response(visitor, &Reply::refused(RequestResult::Refused, vec![why]))
}

/// The part whose panel is looked for; the other fields of the form of a start have no effect.
#[derive(Debug, Deserialize)]
pub(super) struct NamedPart {
    #[serde(default)]
    serial: String,
}

/// Proposes the recipe of the panel in the cell, from a scan that is taken now. The recipe is selected on the page; a
/// person starts the cycle.
pub(super) async fn identify(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(NamedPart { serial }): Json<NamedPart>,
) -> Response {
    let files = web.front.setup.clone();
    let cameras = web.front.gateway.cameras.clone();
    let proposed = run_blocking(move || {
        let scan = cameras.ok_or_else(not_opened_reason)?.capture_3d()?;
        let limits = ProposalLimits {
            serial: Some(serial.trim()).filter(|serial| !serial.is_empty()),
            ..ProposalLimits::default()
        };
        setup::propose(&files, scan, &limits).map_err(|fault| Reason::new("bad_input", fault.to_string()))
    });
    let refused = |reasons| to_response(&visitor, &Reply::refused(RequestResult::Refused, reasons));
    let proposal = match proposed.await {
        Some(Ok(proposal)) => proposal,
        Some(Err(reason)) => return refused(vec![reason]),
        None => return panic_response(),
    };
    match proposal.startable() {
        Ok((panel, recipe)) => {
            let message = format!("{} {panel}", visitor.language().text("run.proposed"));
            let recipe = Path::new(&recipe.name).file_name().map(|name| name.to_string_lossy());
            Json(json!({ "message": message, "fields": { "recipe": recipe } })).into_response()
        }
        Err(reasons) => refused(reasons),
    }
}

/// Begins a cycle with one of the offered recipes.
pub(super) async fn start(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(Start { recipe, sha256, serial, order, another_part, is_clear }): Json<Start>,
) -> Response {
    if !is_clear {
        let problem = "the start does not confirm that the guard is closed and no person is inside the cell; look at \
                       the cell, then confirm both";
        return refuse_start(&web, &visitor, recipe, Reason::new("bad_input", problem));
    }
    let source = web.front.setup.clone();
    let named = recipe.clone();
    let text = run_blocking(move || source.recipe(&named)?.if_unchanged(&sha256)).await;
    let text = match text {
        Some(Ok(text)) => text,
        Some(Err(problem)) => return refuse_start(&web, &visitor, recipe, Reason::new("bad_input", problem)),
        None => return StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    };
    let some = |name: String| Some(name.trim().to_owned()).filter(|name| !name.is_empty());
    let operator = visitor.person.as_ref().map(|person| person.printed_name.clone());
    let part = PartNames { serial: some(serial), order: some(order), operator };
    let start = StartRequest {
        recipe: text.name,
        text: text.text,
        record: None,
        part: Some(part),
        another_part,
        lost_passes: None,
        is_stated_clear: is_clear,
        own_text: RecipeTextPermission::Refused,
    };
    perform_request(&web, &visitor, RequestKind::Start(start)).await
}
