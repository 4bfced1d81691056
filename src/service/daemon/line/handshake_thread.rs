//! The thread of the handshake.

use crate::daemon::background::lower_priority;
use crate::daemon::camera_lease::LastState;
use crate::daemon::gateway::Gateway;
use crate::daemon::people::AccountService;
use crate::daemon::reply::{Reply, RequestResult};
use crate::daemon::request::{PartNames, RecipeTextPermission, RequestKind, StartRequest};
use crate::daemon::setup_source::RecipeText;
use panelprep_base::disk;
use panelprep_base::verdict::Reason;
use panelprep_cell::accounts::AuditEntry;
use panelprep_cell::cell::{InputsOutputs, LINE_INPUTS, Line};
use panelprep_cell::cycle;
use panelprep_cell::line::{CellStatus, Handshake, LineInputs, LineObservation, LineRequest};
use panelprep_cell::record::{RequestAuthor, RequestSource, RequestedAction};
use panelprep_devices::robot::LineOutputs;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;
use tokio::runtime::Builder;
use tokio::sync::oneshot;
use tokio::time::{MissedTickBehavior, interval};

/// Interval at which the controller reports its inputs.
const UPDATE_INTERVAL: Duration = Duration::from_millis(100);
/// Threads that read the recipe and wait for the store's disk.
const BLOCKING_THREADS: usize = 2;
/// How long the end of the program waits for these threads.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(1);

/// The parts that the handshake needs.
pub struct LineParts {
    /// The `[line]` table of the cell's file.
    pub line: Line,
    /// The bits of `part_present` and `start_request` among the controller's inputs.
    pub inputs: [u32; 2],
    /// The robot's last state.
    pub last: LastState,
    /// The controller's outputs for a line.
    pub outputs: LineOutputs,
    /// The destination of requests.
    pub gateway: Gateway,
    /// The audit trail.
    pub people: Arc<AccountService>,
}

impl LineParts {
    /// Returns the bits of the line's inputs, if the cell names both.
    pub fn bits(io: &InputsOutputs) -> Option<[u32; 2]> {
        let [part_present, start_request] = LINE_INPUTS.map(|name| io.input_bit(name));
        Some([part_present?, start_request?])
    }
}

/// The handshake with the line; it is served until this is dropped.
#[derive(Debug)]
pub struct LineFront {
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl LineFront {
    /// Begins to read the line.
    ///
    /// # Errors
    /// If the system provides no thread.
    pub fn serve(parts: LineParts) -> std::io::Result<Self> {
        let runtime = Builder::new_current_thread().enable_time().max_blocking_threads(BLOCKING_THREADS).build()?;
        let (end, mut ended) = oneshot::channel();
        let serve = move || {
            lower_priority();
            runtime.block_on(async {
                tokio::select! {
                    () = run_handshake(parts) => {}
                    _ = &mut ended => {}
                }
            });
            runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
        };
        let thread = thread::Builder::new().name("line".to_owned()).spawn(serve)?;
        Ok(LineFront { end: Some(end), thread: Some(thread) })
    }
}

impl Drop for LineFront {
    fn drop(&mut self) {
        drop(self.end.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

async fn run_handshake(parts: LineParts) {
    let mut handshake = Handshake::default();
    let mut tick = interval(UPDATE_INTERVAL);
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut last_reported = None;
    // A signal cannot name a recipe, so the recipe with which the service was started is used.
    let recipe = parts.recipe().await;
    loop {
        tick.tick().await;
        let look = parts.read_observation().await;
        let request = handshake.evaluate(look.clone());
        let now = handshake.output_signals(&look);
        if last_reported.replace(now) != Some(now) {
            parts.outputs.set(now.0);
        }
        if let Some(request) = request
            && !parts.send_request(request, &recipe).await
        {
            handshake.refused(request);
        }
    }
}

impl LineParts {
    async fn read_observation(&self) -> LineObservation {
        let reply = self.gateway.request(RequestKind::State, RequestAuthor::from_source(RequestSource::Line)).await;
        let inputs = self.last.inputs().map(|bits| {
            let [part_present, start_request] = self.inputs.map(|bit| bits >> bit & 1 == 1);
            LineInputs { part_present, start_request }
        });
        let cell = reply.state.map(|state| CellStatus {
            state,
            is_review: reply.extras.is_review,
            verdict: reply.verdict,
        });
        LineObservation { inputs, cell }
    }

    /// Sends the request to the cell; returns whether the request was accepted. The loop records the request with its
    /// result.
    async fn send_request(&self, request: LineRequest, recipe: &Result<RecipeText, String>) -> bool {
        let (word, asked) = match request {
            LineRequest::Start => ("start", self.start(recipe).await),
            LineRequest::Reset => ("reset", Ok(RequestKind::Table(cycle::Request::Reset))),
        };
        let who = RequestAuthor::from_source(RequestSource::Line);
        let reply = match asked {
            Ok(what) => self.gateway.request(what, who).await,
            Err(problem) => {
                let reasons = vec![Reason::new("bad_input", problem)];
                let wanted = RequestedAction::Start { recipe: self.line.recipe.display().to_string() };
                self.gateway.keep_refused(wanted, who, reasons.clone());
                Reply::refused(RequestResult::Refused, reasons)
            }
        };
        if reply.answer == RequestResult::Done {
            return true;
        }
        tracing::warn!("the line requested a {word}, which was refused: {}", reply.joined_reasons());
        if reply.may_be_unrecorded() {
            self.write_audit(word, reply.joined_reasons()).await;
        }
        false
    }

    /// Writes a line of the audit trail for a request that the loop never received.
    async fn write_audit(&self, word: &str, refused: String) {
        let from = "the line's digital signals".to_owned();
        let entry =
            AuditEntry { refused: Some(refused), ..AuditEntry::for_completed_action(None, None, from, word) };
        let people = self.people.clone();
        #[expect(
            clippy::let_underscore_must_use,
            reason = "an entry that cannot be stored is written to the service's log"
        )]
        let _ = tokio::task::spawn_blocking(move || people.audit(&entry)).await;
    }

    /// Starts a cycle with the recipe and the part that the cell's file names. A recipe that was changed since the
    /// service started is refused.
    async fn start(&self, recipe: &Result<RecipeText, String>) -> Result<RequestKind, String> {
        let Line { serial, order, operator, .. } = self.line.clone();
        let wanted = recipe.as_ref().map_err(|problem| add_restart_advice(problem))?;
        let now = self.recipe().await?;
        let RecipeText { name, text } =
            now.if_unchanged(&wanted.sha256()).map_err(|problem| add_restart_advice(&problem))?;
        let part = Some(PartNames { serial, order, operator });
        Ok(RequestKind::Start(StartRequest {
            recipe: name,
            text,
            record: None,
            part,
            another_part: false,
            lost_passes: None,
            is_stated_clear: false,
            own_text: RecipeTextPermission::Allowed,
        }))
    }

    /// Reads the recipe that the cell's file names, as the recipe's file is now.
    async fn recipe(&self) -> Result<RecipeText, String> {
        let file = self.line.recipe.clone();
        let name = file.display().to_string();
        let read =
            tokio::task::spawn_blocking(move || disk::read(&file)).await.map_err(|error| error.to_string())?;
        let bytes = read.map_err(|error| format!("{name}: {error}"))?;
        let text = String::from_utf8(bytes).map_err(|_| format!("{name}: the file is not valid UTF-8 text"))?;
        Ok(RecipeText { name, text })
    }
}

/// Adds to a problem that the service must be restarted to use the recipe as it is now.
fn add_restart_advice(problem: &str) -> String {
    format!("{problem}; restart the service if the line is to use the current recipe")
}
