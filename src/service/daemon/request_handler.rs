//! Processing of requests in the service: passes requests to the loop, sends replies to the waiting clients, and
//! reports the state of the cell to systemd.
//!
//! The loop calls the handler in every iteration. The handler then also checks the other threads with the supervisor,
//! so that the heartbeat to systemd (`WATCHDOG=1`) proves that all of them work. SIGTERM or SIGINT stops the cycle, and
//! a second signal aborts it; the service ends only in the states Stopped and Aborted.
//!
//! While the store cannot be opened, for example because the disk is full, there is no loop: [`wait_for`] then only
//! answers requests, and tries again to open the store.

use super::camera_lease::SharedCameras;
use super::live_view::LiveView;
use super::operator_texts;
use super::ports::{LoopEvent, Requester};
use super::replay::{Recording, RecordingSwitch};
use super::request::{PageData, Reply, Request, RequestKind, RequestResult};
use super::request_queue::RequestQueue;
use panelprep_base::supervision::{SupervisedThread, Supervisor, ThreadFault, supervise};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle;
use panelprep_cell::cycle::{At, Path as PathKind, Phase, Refusal, State};
use panelprep_cell::panel::GridId;
use panelprep_cell::record::{CycleId, RequestAuthor, RequestSource};
use sd_notify::NotifyState;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// A cycle that has ended.
#[derive(Debug)]
pub struct EndedCycle {
    /// The ID of the cycle.
    pub id: CycleId,
    /// The recording of the cycle, which may still be in progress.
    pub recording: Option<Recording>,
}

/// The parts of the service outside its loop that requests use.
#[derive(Debug)]
pub struct ServiceParts {
    /// The switch that determines which cycle is recorded.
    pub recording: RecordingSwitch,
    /// Checks whether all threads work.
    pub supervisor: Supervisor,
    /// The channel by which the page of an ended cycle is ordered.
    pub pages: Sender<EndedCycle>,
    /// The last written page.
    pub written: LastWrittenPage,
    /// The cameras, which are lent while no cycle is running.
    pub cameras: Option<SharedCameras>,
    /// The live view for people.
    pub view: LiveView,
}

/// Returns the phase inside Execute; for a held cycle, the phase in which it continues.
fn phase(at: At) -> Option<Phase> {
    match at {
        At::Execute(phase) => Some(phase),
        At::Holding(hold) | At::Held(hold) => Some(hold.resume),
        At::Unholding { resume, .. } => Some(resume),
        _ => None,
    }
}

/// Returns a reason that names the author of this hold, and the reason that the author gave.
fn hold_author_reason(hold: &Request) -> Reason {
    let who = hold.requester.user.clone().unwrap_or_else(|| hold.requester.to_string());
    match &hold.what {
        RequestKind::Hold { why } => Reason::new("held_by", format!("{who}: {why}")),
        _ => Reason::new("held_by", who),
    }
}

/// Number of heartbeats that a working loop sends to systemd within the watchdog time: even if one is late, more than
/// half of this time is left.
const WATCHDOG_SIGNALS: u32 = 4;
/// Maximum time for which the loop waits for a request while the cell is idle.
const IDLE_POLL_TIMEOUT: Duration = Duration::from_millis(20);

/// Maximum number of requests for the state that are answered in one iteration of the loop.
const MAX_STATE_REQUESTS: usize = 64;

/// Number of last steps of the state table whose description is remembered: more than the number of steps between two
/// holds of a cycle.
const MAX_REMEMBERED_STEPS: usize = 64;

/// The data of a start that the loop has accepted.
#[derive(Debug)]
struct AcceptedStart {
    panel: String,
    grids: Arc<[GridId]>,
    film_total_s: f64,
}

/// Handles the requests to the service.
#[derive(Debug)]
pub struct RequestHandler {
    queue: RequestQueue,
    /// The channel for the reply to the accepted request.
    waiting: Option<oneshot::Sender<Reply>>,
    /// Whether the accepted request is a reset.
    waits_for_reset: bool,
    signals: u8,
    /// The number of signals for which a request was already sent to the state table.
    handled_signals: u8,
    /// The last state that was reported to systemd.
    reported_state: Option<At>,
    /// The interval at which systemd expects a heartbeat, and the time of the last one.
    watchdog: Option<(Duration, Instant)>,
    parts: ServiceParts,
    /// The loop's own heartbeat for the supervisor.
    sign: SupervisedThread,
    cycle: Option<CycleId>,
    verdict: Option<Verdict>,
    /// The panel of the cycle, or of the accepted start.
    panel: Option<String>,
    accepted_start: Option<AcceptedStart>,
    /// The grids of the panel of the last cycle; `film_total_s` is the planned duration of its film, s.
    grids: Arc<[GridId]>,
    film_total_s: Option<f64>,
    /// Present duration of the film in progress, s.
    film_s: Option<f64>,
    /// Description of what was done, for the reply.
    done: Option<String>,
    /// The cycle whose page must be written when the cell is idle.
    ended: Option<CycleId>,
    /// The problems that were found last; `earlier_problems` contains those from before the last request.
    problems: Vec<Reason>,
    earlier_problems: Vec<Reason>,
    /// The author of the last requested hold, with the reason if one was given.
    holder: Option<Reason>,
    /// The last state that the loop reported.
    state: State,
    /// The last steps of the state table, each with its description.
    steps: VecDeque<(u64, String)>,
}

impl RequestHandler {
    /// Creates the handler for the requests of this queue. `left` is the cycle that an earlier process did not end. The
    /// handler sends heartbeats to systemd as long as the supervisor finds that all threads work.
    pub fn new(queue: RequestQueue, left: Option<CycleId>, parts: ServiceParts) -> Self {
        let (sign, _) = supervise("loop", Duration::MAX);
        let watchdog = sd_notify::watchdog_enabled().map(|allowed| (allowed / WATCHDOG_SIGNALS, Instant::now()));
        RequestHandler {
            queue,
            waiting: None,
            waits_for_reset: false,
            signals: 0,
            handled_signals: 0,
            reported_state: None,
            watchdog,
            parts,
            sign,
            cycle: left,
            verdict: None,
            panel: None,
            accepted_start: None,
            grids: Arc::default(),
            film_total_s: None,
            film_s: None,
            done: None,
            ended: None,
            problems: Vec::new(),
            earlier_problems: Vec::new(),
            holder: None,
            state: State::INITIAL,
            steps: VecDeque::new(),
        }
    }

    fn reply(&self, answer: RequestResult, reasons: Vec<Reason>, state: &State) -> Reply {
        let counts = |path| matches!(path, PathKind::Contact | PathKind::Air);
        let path = state.intent.filter(|intent| counts(intent.motion.path));
        Reply {
            answer,
            state: Some(state.at.keyword().to_owned()),
            phase: phase(state.at).map(|phase| phase.keyword().to_owned()),
            panel: self.panel.clone(),
            pass: self.cycle.map(|_| state.job.pass),
            film_s: self.film_s.filter(|_| state.at == At::Execute(Phase::Inspect)),
            waypoint: path.map(|intent| intent.done),
            of: path.map(|intent| intent.motion.waypoints),
            page: self.cycle.and_then(|cycle| self.parts.written.get(cycle)),
            axes_deg: self
                .parts
                .cameras
                .as_ref()
                .and_then(SharedCameras::resting_joints)
                .map(|axes| axes.degrees()),
            epoch: Some(state.epoch),
            step: Some(state.step),
            cycle_id: self.cycle.map(|cycle| cycle.0),
            verdict: self.verdict,
            recording: self.parts.recording.status(),
            done: None,
            reasons,
            extras: self.page_data(state),
        }
    }

    /// Returns the data that only the operator's page and the plant show.
    fn page_data(&self, state: &State) -> PageData {
        let mut possible = operator_texts::possible_requests(state);
        possible.extend(state.at.is_at_rest().then_some("new-disc"));
        let is_review = matches!(state.at, At::Held(hold) if hold.why == cycle::Why::Review);
        let (grids, film_total_s) = (self.grids.clone(), self.film_total_s);
        PageData { table: Some(*state), possible, grids, film_total_s, is_review }
    }

    /// Returns the reasons for the cell's state, and the problems that were found last.
    fn reasons(&self, state: &State) -> Vec<Reason> {
        let is_requested = matches!(state.at, At::Held(hold) | At::Holding(hold) if hold.why == cycle::Why::Asked);
        let holder = self.holder.iter().filter(|_| is_requested);
        operator_texts::state_reason(state).into_iter().chain(holder.chain(&self.problems).cloned()).collect()
    }

    fn send_answer(&mut self, answer: RequestResult, reasons: Vec<Reason>, state: &State) {
        let done = self.done.take();
        let all: Vec<_> = self.queue.take_followers().into_iter().chain(self.waiting.take()).collect();
        if all.is_empty() {
            return;
        }
        let reply = Reply { done, ..self.reply(answer, reasons, state) };
        for waiting in all {
            #[expect(clippy::let_underscore_must_use, reason = "a client that disconnected needs no reply")]
            let _ = waiting.send(reply.clone());
        }
    }

    /// Sends these states to systemd; has no effect without systemd.
    fn notify(states: &[NotifyState<'_>]) {
        if let Err(error) = sd_notify::notify(states) {
            tracing::warn!(
                "cannot send the state to systemd: {error}; if this continues, systemd restarts the \
                            service"
            );
        }
    }

    fn publish_status(&mut self, state: &State) {
        if self.reported_state != Some(state.at) {
            let status = match self.cycle {
                Some(cycle) => {
                    format!("{}; cycle {cycle}, epoch {}", operator_texts::describe_place(state.at), state.epoch)
                }
                None => operator_texts::describe_place(state.at),
            };
            let first = self.reported_state.replace(state.at).is_none();
            let ready = first.then_some(NotifyState::Ready);
            let states: Vec<_> = ready.into_iter().chain([NotifyState::Status(&status)]).collect();
            Self::notify(&states);
        }
        if let Some((every, last)) = &mut self.watchdog
            && last.elapsed() >= *every
        {
            *last = Instant::now();
            Self::notify(&[NotifyState::Watchdog]);
        }
    }

    /// Passes a decision to the state table if it refers to the present step.
    fn pass_decision(&self, request: cycle::Request, step: u64, state: &State) -> RequestKind {
        if step == state.step {
            return RequestKind::Table(request);
        }
        let was = self.steps.iter().find(|(known, _)| *known == step).map(|(_, shown)| shown.as_str());
        RequestKind::Outdated {
            request,
            reasons: vec![operator_texts::outdated_step_reason(request, (step, was), state)],
        }
    }

    /// Remembers the description of each step, so that the refusal of a decision on an earlier step can state what has
    /// changed.
    fn remember_step(&mut self, state: &State) {
        if self.steps.back().is_some_and(|(step, _)| *step == state.step) {
            return;
        }
        if self.steps.len() == MAX_REMEMBERED_STEPS {
            self.steps.pop_front();
        }
        self.steps.push_back((state.step, operator_texts::describe_step(state)));
    }

    /// Prepares a request that is passed to the loop.
    fn pass_to_loop(&mut self, mut request: Request) -> Request {
        self.waiting = request.reply.take();
        self.waits_for_reset = matches!(request.what, RequestKind::Table(cycle::Request::Reset));
        // If the loop refuses the request, these data are restored.
        self.earlier_problems = self.problems.clone();
        // A hold is refused if the cycle is already held; its author is then not the person who held the cycle.
        if request.what.table_request() == Some(cycle::Request::Hold)
            && !matches!(self.state.at, At::Held(_) | At::Holding(_))
        {
            self.holder = Some(hold_author_reason(&request));
        }
        match &request.what {
            RequestKind::Table(asked) => {
                use cycle::Request::{Accept, Clear, Reset, Unhold};
                if matches!(asked, Reset | Clear | Unhold { .. } | Accept) {
                    self.problems.clear();
                }
            }
            RequestKind::Begin(prepared) => {
                let setup = &prepared.setup;
                // The data are only remembered here, because the state table may refuse the start while another cycle
                // runs.
                self.accepted_start = Some(AcceptedStart {
                    panel: setup.panel_name().to_owned(),
                    grids: setup.panel.grids.iter().map(|grid| grid.id).collect(),
                    film_total_s: setup.film_demands().filmed_s(),
                });
            }
            RequestKind::Outdated { reasons, .. } => {
                let (reasons, state) = (reasons.clone(), self.state);
                tracing::warn!("refused: {}", reasons[0].message);
                self.send_answer(RequestResult::Refused, reasons, &state);
            }
            _ => {}
        }
        request
    }

    /// Returns the request that follows from the signals received so far.
    fn signal_request(&mut self, state: &State) -> Option<Request> {
        if self.signals == 0 {
            return None;
        }
        if matches!(state.at, At::Stopped | At::Aborted { .. }) {
            return Some(Request::signal());
        }
        let wanted = self.signals.min(2);
        if self.handled_signals >= wanted {
            return None;
        }
        self.handled_signals = wanted;
        let request = if wanted == 1 { cycle::Request::Stop } else { cycle::Request::Abort };
        Some(Request::new(RequestKind::Table(request), RequestAuthor::from_source(RequestSource::Signal)))
    }

    fn signal(&mut self) {
        self.signals = self.signals.saturating_add(1);
        if self.signals == 1 {
            tracing::info!("a signal was received: the cycle is stopped; a second signal aborts it");
            Self::notify(&[NotifyState::Stopping]);
        } else {
            tracing::warn!("another signal: abort");
        }
    }

    /// Returns the current request, or `None` if there is none.
    fn current_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        self.state = *state;
        self.remember_step(state);
        self.sign.report_working();
        self.parts.supervisor.check_threads()?;
        // The request that was returned in the last iteration of the loop was accepted; a refused request would have
        // been answered already.
        self.send_answer(RequestResult::Done, self.reasons(state), state);
        self.publish_status(state);
        if let Some(id) = self.ended.take_if(|_| state.at.is_at_rest()) {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "the page writer has ended; the record remains, and the page can be created from it later"
            )]
            let _ = self.parts.pages.send(EndedCycle { id, recording: self.parts.recording.finished_recording() });
        }
        if let Some(request) = self.signal_request(state) {
            return Ok(Some(request));
        }
        let mut patience = if state.at.is_at_rest() { IDLE_POLL_TIMEOUT } else { Duration::ZERO };
        // All requests for the state are answered in one iteration, so that they do not delay other requests.
        for _ in 0..MAX_STATE_REQUESTS {
            let Some(request) = self.queue.next(patience) else { break };
            match request.what {
                RequestKind::State => {
                    self.waiting = request.reply;
                    self.send_answer(RequestResult::Done, self.reasons(state), state);
                    patience = Duration::ZERO;
                }
                RequestKind::Leave => {
                    self.signal();
                    break;
                }
                RequestKind::Decided { request: asked, step } => {
                    let what = self.pass_decision(asked, step, state);
                    return Ok(Some(self.pass_to_loop(Request { what, ..request })));
                }
                _ => return Ok(Some(self.pass_to_loop(request))),
            }
        }
        Ok(None)
    }
}

impl Requester for RequestHandler {
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        if let Some(cameras) = &self.parts.cameras {
            cameras.set_cell_state(state);
        }
        let request = self.current_request(state)?;
        if let (Some(cameras), Some(RequestKind::Table(_) | RequestKind::Begin(_))) =
            (&self.parts.cameras, request.as_ref().map(|request| &request.what))
        {
            cameras.reserve();
        }
        Ok(request)
    }

    fn on_loop_event(&mut self, news: LoopEvent) {
        match news {
            LoopEvent::Refused(request, refusal) => self.refused(request, refusal),
            LoopEvent::Unable(reasons) => {
                let state = self.state;
                self.send_answer(RequestResult::Fault, reasons, &state);
            }
            LoopEvent::NotPermitted(reasons) => {
                let state = self.state;
                self.problems = std::mem::take(&mut self.earlier_problems);
                self.send_answer(RequestResult::Refused, reasons, &state);
            }
            LoopEvent::Begun(cycle, _) => {
                self.problems.clear();
                self.parts.view.clear();
                (self.cycle, self.verdict) = (Some(cycle), None);
                (self.panel, self.film_s) = (None, None);
                if let Some(AcceptedStart { panel, grids, film_total_s }) = self.accepted_start.take() {
                    (self.panel, self.grids, self.film_total_s) = (Some(panel), grids, Some(film_total_s));
                }
            }
            LoopEvent::Filmed(seconds) => self.film_s = Some(seconds),
            LoopEvent::DiscMounted => {
                self.done = Some("a new disc is mounted: its wear is counted from zero".to_owned())
            }
            LoopEvent::Concluded(verdict) => {
                self.verdict = Some(verdict);
                self.ended = self.cycle;
            }
            LoopEvent::Noted(reasons) => self.problems = reasons,
        }
    }
}

impl RequestHandler {
    fn refused(&mut self, request: cycle::Request, refusal: Refusal) {
        let state = self.state;
        let reason = operator_texts::refusal(request, refusal, &state);
        tracing::warn!("refused: {}", reason.message);
        let exit = match refusal {
            Refusal::NotNow | Refusal::Review | Refusal::Undried => RequestResult::Refused,
            Refusal::Robot(_) | Refusal::Failed(_) => RequestResult::Fault,
        };
        if matches!(refusal, Refusal::Failed(_)) {
            // The request was accepted and failed later: the problems that it caused belong to its reply, even if they
            // are found before the reply is sent.
            self.problems.insert(0, reason);
            if self.waits_for_reset {
                self.send_answer(exit, self.problems.clone(), &state);
            }
        } else if self.waiting.is_some() {
            self.problems = std::mem::take(&mut self.earlier_problems);
            self.send_answer(exit, vec![reason], &state);
        } else {
            self.problems.insert(0, reason);
        }
    }
}

/// The last written page, and its cycle. Clones share the same page.
#[derive(Debug, Clone, Default)]
pub struct LastWrittenPage(Arc<Mutex<Option<(CycleId, PathBuf)>>>);

impl LastWrittenPage {
    /// Records that this page of the cycle was written.
    pub fn set_page(&self, cycle: CycleId, page: &Path) {
        *self.lock() = Some((cycle, page.to_owned()));
    }

    pub(super) fn get(&self, cycle: CycleId) -> Option<PathBuf> {
        self.lock().as_ref().filter(|(written, _)| *written == cycle).map(|(_, page)| page.clone())
    }

    fn lock(&self) -> MutexGuard<'_, Option<(CycleId, PathBuf)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Interval between two attempts to open the store.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);

/// Answers each request with the reason why nothing can be executed, until `attempt` succeeds; returns `None` if a
/// signal ends the wait. The state in the reply is Aborted: nothing moves, and the last action of the cell cannot be
/// read from the store.
pub fn wait_for<T>(queue: &RequestQueue, mut attempt: impl FnMut() -> Result<T, Reason>) -> Option<T> {
    let mut is_reported = false;
    loop {
        let why = match attempt() {
            Ok(opened) => return Some(opened),
            Err(why) => why,
        };
        if !std::mem::replace(&mut is_reported, true) {
            tracing::error!("the service waits for its store: {}", why.message);
            notify(&[NotifyState::Ready, NotifyState::Status(&why.message)]);
        }
        notify(&[NotifyState::Watchdog]);
        let Some(Request { what, reply, .. }) = queue.next(RETRY_INTERVAL) else { continue };
        if matches!(what, RequestKind::Leave) {
            return None;
        }
        // A request without a reply channel was already answered, and no store is open that could record it.
        for reply in queue.take_followers().into_iter().chain(reply) {
            let answer =
                if matches!(what, RequestKind::State) { RequestResult::Done } else { RequestResult::Fault };
            let state = Some("aborted".to_owned());
            #[expect(clippy::let_underscore_must_use, reason = "a client that disconnected needs no reply")]
            let _ = reply.send(Reply { state, ..Reply::refused(answer, vec![why.clone()]) });
        }
    }
}

/// Sends these states to systemd; has no effect without systemd.
fn notify(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!(
            "cannot send the state to systemd: {error}; if this continues, systemd restarts the service"
        );
    }
}

#[cfg(test)]
mod tests;
