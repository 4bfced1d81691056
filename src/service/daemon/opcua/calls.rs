//! Method calls of OPC UA clients: each call is checked against the table of methods, and converted to a request to the
//! service. The rate of calls of each caller is limited. Stop and abort are not limited: repeated ones get the same
//! reply.

use super::access::{Access, Caller};
use crate::daemon::alarms::AlarmId;
use crate::daemon::gateway::InterfaceContext;
use crate::daemon::request::{Reply, RequestKind, RequestResult};
use crate::setup::{RecipeTextPermission, StartRequest, clock::now_unix_ms};
use opcua::types::{StatusCode, Variant};
use panelprep_base::verdict::Reason;
use panelprep_cell::accounts::AuditEntry;
use panelprep_cell::cycle::Request;
use panelprep_cell::record::PartNames;
use panelprep_cell::record::{CycleId, RequestAuthor, RequestSource, RequestedAction};
use panelprep_interfaces::packml::{Command, LastRefusal, Method};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Mutex as AsyncMutex;
use tokio::time::timeout;

/// Time limit for the reply to a call, even if the disk does not respond.
const CALL_TIMEOUT: Duration = Duration::from_secs(20);
/// Interval within which repeated stops are executed as one stop, and repeated aborts as one abort.
const MERGE_INTERVAL: Duration = Duration::from_millis(100);
/// Maximum length of a text argument, characters.
const MAX_CHARACTERS: usize = 200;

/// The outcome of a method call.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum CallOutcome {
    /// The call was executed; the text contains information that the state of the cell does not contain.
    Done(String),
    /// The call was refused, for this reason.
    Refused(StatusCode, Reason),
}

fn refused(code: &'static str, status: StatusCode, message: impl Into<String>) -> CallOutcome {
    CallOutcome::Refused(status, Reason::new(code, message))
}

impl CallOutcome {
    fn from_reply(reply: Reply) -> Self {
        let all: Vec<&str> = reply.reasons.iter().map(|reason| reason.message.as_str()).collect();
        let code = reply.reasons.first().map_or("not_now".into(), |reason| reason.code.clone());
        let status = match (reply.answer, &*code) {
            (RequestResult::Done, _) => return CallOutcome::Done(reply.done.unwrap_or_default()),
            (_, "busy") => StatusCode::BadTooManyOperations,
            (_, "silent" | "ended") => StatusCode::BadTimeout,
            (RequestResult::Refused, _) => StatusCode::BadInvalidState,
            (RequestResult::Fault, _) => StatusCode::BadDeviceFailure,
        };
        CallOutcome::Refused(status, Reason { code, message: all.join("; ") })
    }
}

/// Converts calls to requests, and sends them to the service.
pub(super) struct Calls {
    pub access: Arc<Access>,
    pub front: InterfaceContext,
    flood: Mutex<CallLimiter>,
    refusal: Mutex<Option<LastRefusal>>,
    /// The last executed stop and the last executed abort, each with its time and reply.
    last_urgent: [AsyncMutex<Option<(Instant, Reply)>>; 2],
}

impl Calls {
    pub fn new(access: Arc<Access>, front: InterfaceContext) -> Self {
        Calls { access, front, flood: Mutex::default(), refusal: Mutex::default(), last_urgent: Default::default() }
    }

    /// Returns the last refused call.
    pub fn last_refusal(&self) -> Option<LastRefusal> {
        self.refusal.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Calls a method for a caller at this origin. If the call was refused, the node of the last refusal contains the
    /// reason.
    pub async fn call(
        &self,
        method: &'static Method,
        arguments: &[Variant],
        caller: Option<&Caller>,
        from: &str,
    ) -> CallOutcome {
        let called = self.check_call(method, arguments, caller, from);
        let outcome = timeout(CALL_TIMEOUT, called).await.unwrap_or_else(|_| {
            refused("silent", StatusCode::BadTimeout, "the service did not respond in time; check its state")
        });
        if let CallOutcome::Refused(_, reason) = &outcome {
            let user = caller.and_then(Caller::name).unwrap_or("a user who is not logged in").to_owned();
            let refusal =
                LastRefusal { method: method.name, user, at_unix_ms: now_unix_ms(), reason: reason.clone() };
            *self.refusal.lock().unwrap_or_else(PoisonError::into_inner) = Some(refusal);
        }
        outcome
    }

    async fn check_call(
        &self,
        method: &'static Method,
        arguments: &[Variant],
        caller: Option<&Caller>,
        from: &str,
    ) -> CallOutcome {
        let Some(caller) = caller else {
            let message = "the account was changed or disabled after the log-in; log in again";
            return refused("not_permitted", StatusCode::BadUserAccessDenied, message);
        };
        let is_urgent = matches!(method.command, Command::Stop | Command::Abort);
        let name = caller.name().unwrap_or_default();
        if !is_urgent {
            let turn = {
                let mut flood = self.flood.lock().unwrap_or_else(PoisonError::into_inner);
                flood.call(name, self.access.accounts_with_audit().now_s())
            };
            if let CallDecision::TooMany { must_report } = turn {
                let message = "too many calls in a short time; wait a second (Stop and Abort are always accepted)";
                if must_report {
                    self.write_audit(self.line(method, caller, from), Some("too many calls in a short time")).await;
                }
                return refused("busy", StatusCode::BadTooManyOperations, message);
            }
        }
        if !method.is_allowed(caller.role()) {
            let message = match caller.role() {
                Some(role) => format!("the role {} has no permission for this call", role.keyword()),
                None => "log in first".to_owned(),
            };
            self.write_audit(self.line(method, caller, from), Some(&message)).await;
            return refused("not_permitted", StatusCode::BadUserAccessDenied, message);
        }
        self.perform_call(method, arguments, caller, from).await
    }

    async fn perform_call(
        &self,
        method: &Method,
        arguments: &[Variant],
        caller: &Caller,
        from: &str,
    ) -> CallOutcome {
        let table = |request| RequestKind::Table(request);
        let decided = |request, step: u32| RequestKind::Decided { request, step: u64::from(step) };
        let what = match (method.command, arguments) {
            (Command::Reset, []) => table(Request::Reset),
            (Command::Hold, []) => table(Request::Hold),
            (Command::Clear, [Variant::UInt32(step)]) => decided(Request::Clear, *step),
            (Command::Accept, [Variant::UInt32(step)]) => decided(Request::Accept, *step),
            (Command::NewDisc, []) => RequestKind::NewDisc,
            (Command::Stop, []) => {
                return CallOutcome::from_reply(self.request_urgent(0, Request::Stop, caller).await);
            }
            (Command::Abort, []) => {
                return CallOutcome::from_reply(self.request_urgent(1, Request::Abort, caller).await);
            }
            (Command::Unhold, [Variant::Boolean(dried), Variant::UInt32(step)]) => {
                decided(Request::Unhold { dried: *dried }, *step)
            }
            (Command::Start, [recipe, sha256, serial, order, Variant::Boolean(another_part)]) => {
                let [Some(recipe), Some(sha256), Some(serial), Some(order)] =
                    [recipe, sha256, serial, order].map(text)
                else {
                    return argument_error(method);
                };
                let wanted = RequestedAction::Start { recipe: recipe.clone() };
                match self.start((recipe, sha256), serial, order, caller).await {
                    Ok(start) => RequestKind::Start(StartRequest { another_part: *another_part, ..start }),
                    Err(problem) => {
                        let reason = Reason::new("bad_input", problem);
                        let reasons = vec![reason.clone()];
                        self.front.gateway.keep_refused(wanted, caller_identity(caller), reasons);
                        return CallOutcome::Refused(StatusCode::BadInvalidArgument, reason);
                    }
                }
            }
            (Command::AcknowledgeAlarm, [alarm]) => {
                let Some(alarm) = text(alarm) else { return argument_error(method) };
                return self.acknowledge(&alarm, caller, from).await;
            }
            _ => return argument_error(method),
        };
        CallOutcome::from_reply(self.front.gateway.request(what, caller_identity(caller)).await)
    }

    /// Requests a stop or an abort. If the same request was executed within `MERGE_INTERVAL`, its reply is returned and
    /// no new request is sent.
    async fn request_urgent(&self, place: usize, request: Request, caller: &Caller) -> Reply {
        let mut last = self.last_urgent[place].lock().await;
        if let Some((_, reply)) = last.as_ref().filter(|(at, _)| at.elapsed() < MERGE_INTERVAL) {
            return reply.clone();
        }
        let reply = self.front.gateway.request(RequestKind::Table(request), caller_identity(caller)).await;
        *last = (reply.answer == RequestResult::Done).then(|| (Instant::now(), reply.clone()));
        reply
    }

    async fn start(
        &self,
        (recipe, sha256): (String, String),
        serial: String,
        order: String,
        caller: &Caller,
    ) -> Result<StartRequest, String> {
        let setup = self.front.setup.clone();
        let read = tokio::task::spawn_blocking(move || setup.recipe(&recipe));
        let recipe = read.await.map_err(|error| format!("the recipe could not be read: {error}"))??;
        let recipe = recipe.if_unchanged(&sha256)?;
        let some = |name: String| Some(name).filter(|name| !name.is_empty());
        let operator = match caller {
            Caller::Person { printed_name, .. } => Some(printed_name.clone()),
            Caller::Anonymous => None,
        };
        let part = PartNames { serial: some(serial), order: some(order), operator };
        Ok(StartRequest {
            recipe: recipe.name,
            text: recipe.text,
            record: None,
            part: Some(part),
            another_part: false,
            lost_passes: None,
            is_stated_clear: false,
            own_text: RecipeTextPermission::Refused,
        })
    }

    /// Records that the caller has acknowledged the alarm with this name.
    pub async fn acknowledge(&self, alarm: &str, caller: &Caller, from: &str) -> CallOutcome {
        let no_such = || {
            let message =
                "no active alarm has this ID, or it is already acknowledged; Alarms/Ids lists the active alarms";
            refused("not_now", StatusCode::BadInvalidArgument, message)
        };
        let (Some(alarm), Caller::Person { name, printed_name, role }) = (alarm_id(alarm), caller) else {
            return no_such();
        };
        let line =
            AuditEntry::for_completed_action(Some(name.clone()), Some(*role), from.to_owned(), "acknowledge alarm");
        let (alarms, who) = (self.front.alarms.clone(), format!("{printed_name} ({name})"));
        match tokio::task::spawn_blocking(move || alarms.acknowledge(&alarm, who, line)).await {
            Ok(Ok(true)) => CallOutcome::Done(String::new()),
            Ok(Ok(false)) => no_such(),
            Ok(Err(error)) => refused("store", StatusCode::BadDeviceFailure, error.to_string()),
            Err(error) => refused("store", StatusCode::BadDeviceFailure, error.to_string()),
        }
    }

    fn line(&self, method: &Method, caller: &Caller, from: &str) -> AuditEntry {
        let line = AuditEntry::for_completed_action(
            caller.name().map(str::to_owned),
            caller.role(),
            from.to_owned(),
            "request",
        );
        AuditEntry { subject: Some(method.name.to_owned()), ..line }
    }

    async fn write_audit(&self, line: AuditEntry, refused: Option<&str>) {
        let line = AuditEntry { refused: refused.map(str::to_owned), ..line };
        let people = self.access.accounts_with_audit().clone();
        if tokio::task::spawn_blocking(move || people.audit(&line)).await.is_err() {
            tracing::warn!(
                "an entry of the audit trail is lost, because the thread that writes the entries has \
                            ended: restart the service and report this"
            );
        }
    }
}

fn argument_error(method: &Method) -> CallOutcome {
    let taken: Vec<&str> = method.arguments.iter().map(|argument| argument.name).collect();
    let message = match taken[..] {
        [] => format!("{} takes no arguments", method.name),
        _ => format!(
            "{} requires the arguments {}; a text has at most {MAX_CHARACTERS} characters",
            method.name,
            taken.join(", ")
        ),
    };
    refused("bad_request", StatusCode::BadInvalidArgument, message)
}

/// Returns a text argument without leading and trailing spaces; `None` if it is too long or contains control
/// characters.
fn text(value: &Variant) -> Option<String> {
    let Variant::String(text) = value else { return None };
    let text = text.as_ref().trim();
    let is_plain = text.chars().count() <= MAX_CHARACTERS && !text.contains(char::is_control);
    is_plain.then(|| text.to_owned())
}

/// Parses the name of an alarm, which has the form of `packml::alarm_id`.
fn alarm_id(name: &str) -> Option<AlarmId> {
    let mut parts = name.split('/');
    let (cycle, code, raised) = (parts.next()?, parts.next()?, parts.next()?);
    let cycle: i64 = cycle.parse().ok()?;
    let raised_unix_ms = raised.parse().ok().filter(|_| parts.next().is_none())?;
    Some(AlarmId { cycle: (cycle != 0).then_some(CycleId(cycle)), code: code.to_owned(), raised_unix_ms })
}

fn caller_identity(caller: &Caller) -> RequestAuthor {
    RequestAuthor { front: RequestSource::OpcUa, uid: None, user: caller.name().map(str::to_owned), from: None }
}

/// Number of calls that are accepted at once, and below it the number of calls per second that are accepted after that.
const BURST_CALLS: f64 = 20.0;
const CALLS_PER_SECOND: f64 = 5.0;
/// Maximum number of callers whose calls are counted; the caller with the oldest last call is removed first.
const MAX_CALLERS: usize = 256;
/// Interval after which calls above the limit are reported again, s.
const REPORT_INTERVAL_S: f64 = 60.0;

/// The remaining calls of each caller. Times are in seconds of a monotonic clock.
#[derive(Debug, Default)]
struct CallLimiter(BTreeMap<String, Bucket>);

#[derive(Debug, Clone, Copy)]
struct Bucket {
    remaining: f64,
    at_s: f64,
    reported_s: Option<f64>,
}

/// The decision of the limiter about a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CallDecision {
    /// The call is within the limit.
    Accepted,
    /// The call exceeds the limit.
    TooMany {
        /// Whether the excess must be reported now; false if an excess was reported within `REPORT_INTERVAL_S`.
        must_report: bool,
    },
}

impl CallLimiter {
    /// Counts a call by this caller; returns whether the call is accepted.
    pub fn call(&mut self, caller: &str, now_s: f64) -> CallDecision {
        if self.0.len() >= MAX_CALLERS && !self.0.contains_key(caller) {
            let oldest = self.0.iter().min_by(|a, b| a.1.at_s.total_cmp(&b.1.at_s)).map(|(name, _)| name.clone());
            oldest.and_then(|name| self.0.remove(&name));
        }
        let bucket = self.0.entry(caller.to_owned()).or_insert(Bucket {
            remaining: BURST_CALLS,
            at_s: now_s,
            reported_s: None,
        });
        bucket.remaining = (bucket.remaining + (now_s - bucket.at_s) * CALLS_PER_SECOND).min(BURST_CALLS);
        bucket.at_s = now_s;
        if bucket.remaining >= 1.0 {
            bucket.remaining -= 1.0;
            return CallDecision::Accepted;
        }
        let must_report = bucket.reported_s.is_none_or(|reported_s| now_s - reported_s >= REPORT_INTERVAL_S);
        if must_report {
            bucket.reported_s = Some(now_s);
        }
        CallDecision::TooMany { must_report }
    }
}

#[cfg(test)]
mod tests;
