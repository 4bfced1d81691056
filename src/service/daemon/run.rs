//! The main loop: the same for a service, a single cycle and a replay. Each request is recorded with its author and its
//! result.

use super::abrasion::AbrasionWork;
use super::answers::reason;
use super::computing::Computing;
use super::corrected::CalibratedRobot;
use super::error::DaemonError;
use super::operator_texts;
use super::perception::Perception;
use super::ports::{LoopEvent, RecordCommand, RecordPort, RequestPort, RobotPort, ToolPort};
use super::request::{Request, RequestKind};
use super::running::{Condition, LoopMemory, OtherPorts, seconds};
use super::tool_state::PressState;
use crate::setup::{CellSetup, CycleSetup, PreparedCycle, proof_gate};
use panelprep_base::geometry::{Base, KukaPose, Panel, Rigid};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle;
use panelprep_cell::cycle::{Action, At, Deadline, Effect, Event, Refusal, Report, State, Trouble, step};
use panelprep_cell::panel::GridId;
use panelprep_cell::record::{Answer, Clock, Kind, RequestAuthor, RequestRecord, RequestSource, RequestedAction};
use panelprep_store::tape::LoopMemoryStart;
use panelprep_toolpath::path::trace::Trace;
use panelprep_vision::inspect::Inspection;
use std::sync::Arc;
use std::time::Duration;

/// Minimum interval between two recorded stops or aborts of the same person that have no effect.
const MIN_REFUSAL_INTERVAL: Duration = Duration::from_secs(1);

/// The ports to which the loop is connected.
pub struct LoopPorts<'a> {
    /// The robot.
    pub robot: &'a mut dyn RobotPort,
    /// The compliant tool; not used if the cell has no compliant tool.
    pub tool: &'a mut dyn ToolPort,
    /// The record.
    pub record: &'a mut dyn RecordPort,
    /// The source of requests to the loop.
    pub requests: &'a mut dyn RequestPort,
    /// The queue of camera and computing actions; it owns the cameras.
    pub computing: Computing<'a>,
    /// Whether time passes only while the loop waits for the robot's next report.
    pub lock_step: bool,
}

/// The data with which the loop starts.
pub struct LoopStart {
    /// The cell.
    pub cell: Arc<CellSetup>,
    /// The cycle, if the loop runs only this cycle; `None` if cycles are requested one after the other.
    pub cycle: Option<Arc<CycleSetup>>,
    /// The state at the end of the journal.
    pub state: State,
    /// The data that the loop keeps from before, in addition to the state.
    pub before: LoopMemoryStart,
}

/// The result of the loop.
#[derive(Debug)]
pub struct LoopOutcome {
    /// The state at the end of the loop.
    pub state: State,
    /// The verdict of the last cycle, if a cycle ran.
    pub verdict: Option<Verdict>,
    /// The pose of the panel.
    pub base_from_panel: Option<Rigid<Base, Panel>>,
    /// The inspections of the water film, ordered by time.
    pub inspections: Vec<Arc<Inspection>>,
    /// For each sanded grid, the number of passes that sanded it.
    pub passes: Vec<(GridId, usize)>,
}

/// Runs the loop until a request to leave arrives while the cell is idle. A service, a single cycle and a replay use
/// this same loop with different ports.
///
/// # Errors
/// If the record cannot be written, or a thread of the program failed. In both cases the robot is commanded to stop,
/// and nothing else is done.
pub fn run(start: LoopStart, ports: LoopPorts<'_>) -> Result<LoopOutcome, DaemonError> {
    let LoopStart { cell, cycle, state, before } = start;
    let LoopPorts { robot, tool, record, requests, computing, lock_step } = ports;
    let mut robot = CalibratedRobot::new(robot, &cell.arm);
    if let LoopMemoryStart::Cycle { robot: Some(state), .. } = &before {
        robot.set_initial_axes(state.joints);
    }
    let ports = OtherPorts { robot, tool, record, requests };
    let mut running = LoopMemory::new((cell, cycle), computing, ports, (state, lock_step));
    running.restore_memory(before);
    running.run_loop()?;
    let LoopMemory { state, verdict, perception, abrasion, .. } = running;
    let passes = abrasion.pass_counts().collect();
    Ok(LoopOutcome {
        state,
        verdict,
        base_from_panel: perception.panel_pose(),
        inspections: perception.inspections,
        passes,
    })
}

impl LoopMemory<'_> {
    fn run_loop(&mut self) -> Result<(), DaemonError> {
        let ended = self.run();
        if ended.is_err() {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "best effort: without this command the controller's own watchdog stops the robot"
            )]
            let _ = self.ports.robot.abort();
        }
        ended
    }

    fn run(&mut self) -> Result<(), DaemonError> {
        if self.state.job.running {
            let message = "the program ended while this cycle was running";
            self.record_problem(Kind::Robot, vec![Reason::new("interrupted", message)])?;
        }
        while let Some(event) = self.next_event()? {
            self.process_event(event)?;
        }
        Ok(())
    }

    /// Processes one event: writes the journal, computes the step and performs its effects.
    pub(super) fn process_event(&mut self, event: Event) -> Result<(), DaemonError> {
        // Checked before the journal is written: a client that repeats a stop many times a second would fill the disk
        // with entries that have no effect.
        if let Some((request, refusal)) = self.refused_just_now(event) {
            self.ports.requests.publish(LoopEvent::Refused(request, refusal));
            return Ok(());
        }
        // The journal is written before the step: after a power failure, the state that is computed from the journal
        // must contain everything that the cell was commanded to do.
        self.ports.record.perform_and_forget(RecordCommand::Event(event))?;
        tracing::debug!(?event);
        if let Event::Reported(Report::Answered { id, .. }) = event {
            self.deadlines.disarm(id);
        }
        let (before, (state, effects)) = (self.state, step(self.state, event));
        self.has_warned &= !before.at.is_at_rest();
        if state.at != before.at {
            tracing::info!("{}", operator_texts::describe_place(state.at));
        }
        self.state = state;
        let refused = effects.iter().find_map(|effect| match effect {
            Effect::Refuse { request, refusal } => Some((*request, *refusal)),
            _ => None,
        });
        if let (Event::Asked(request), None) = (event, refused) {
            self.control.on_request_accepted(request);
        }
        if state.job.running && !before.job.running {
            self.record_clock()?;
        }
        // An action that the state table no longer requires is discarded.
        if self.pending_action.take_if(|pending| state.due.is_none_or(|due| due.id != pending.id)).is_some() {
            self.computing.abandon();
        }
        let ends = effects.contains(&Effect::Conclude { verdict: Verdict::Aborted });
        // The effects are performed in the order of the state table: an intent is on the disk before its motion is
        // sent.
        effects.into_iter().try_for_each(|effect| self.perform(event, effect))?;
        self.record_request(event, refused)?;
        if ends && event == Event::Asked(cycle::Request::Stop) {
            let stopped = operator_texts::stopped_reason();
            tracing::info!("{}", stopped.message);
            self.ports.requests.publish(LoopEvent::Noted(vec![stopped]));
        }
        if self.state.at.is_at_rest() && !self.state.job.running && !self.is_single {
            self.perception.forget_pictures();
            self.ports.record.perform_and_forget(RecordCommand::BetweenCycles)?;
        }
        Ok(())
    }

    /// Returns the refusal if this is a stop or an abort that has no effect, and the same request of the same person
    /// was refused and recorded a short time ago. Stop and abort may be requested at any time, and each entry of the
    /// record uses disk space.
    fn refused_just_now(&mut self, event: Event) -> Option<(cycle::Request, Refusal)> {
        let Event::Asked(request @ (cycle::Request::Stop | cycle::Request::Abort)) = event else { return None };
        let (_, effects) = step(self.state, event);
        let refusal = effects.iter().find_map(|effect| match effect {
            Effect::Refuse { refusal, .. } => Some(*refusal),
            _ => None,
        })?;
        let now = self.ports.robot.now();
        let is_recorded = self.last_refused.as_ref().is_some_and(|(last, who, at)| {
            *last == request
                && *who == self.requester
                && now.since_start() < at.since_start() + MIN_REFUSAL_INTERVAL
        });
        if !is_recorded {
            self.last_refused = Some((request, self.requester.clone(), now));
        }
        is_recorded.then_some((request, refusal))
    }

    /// Returns the next event; `None` when the loop must end.
    pub(super) fn next_event(&mut self) -> Result<Option<Event>, DaemonError> {
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(Some(event));
            }
            if self.accept_computation(Duration::ZERO)? {
                continue;
            }
            if let Some(why) = self.ports.record.disk_full_reason() {
                self.is_disk_full = true;
                if matches!(self.state.at, At::Completing { .. } | At::Complete { .. }) {
                    // A full disk has no effect on a cycle that already has its result.
                    tracing::warn!("{}", why.message);
                    self.ports.requests.publish(LoopEvent::Noted(vec![why]));
                } else {
                    self.record_problem(Kind::SelfTest, vec![why])?;
                }
                return Ok(Some(Event::Reported(Report::Trouble(Trouble::DiskFull))));
            }
            // After each request, the deadlines, the tool and the robot are processed first, even if further requests
            // are waiting.
            let has_turn = !std::mem::take(&mut self.has_accepted_request);
            let request = if has_turn { self.ports.requests.next(&self.state)? } else { None };
            if let Some(request) = request {
                self.has_accepted_request = true;
                match self.process_request(request)? {
                    RequestOutcome::TableEvent(event) => return Ok(Some(event)),
                    RequestOutcome::Done => continue,
                    RequestOutcome::Leave if self.state.at.is_at_rest() => return Ok(None),
                    RequestOutcome::Leave => {}
                }
            }
            let now = self.ports.robot.now();
            // Deadlines are processed before the robot's next report; otherwise a report after the deadline would be
            // accepted if it happened to be read first.
            if let Some(report) = self.deadlines.take_expired(now) {
                self.record_unproven_switch(report)?;
                return Ok(Some(Event::Reported(report)));
            }
            let computes =
                self.pending_action.as_ref().is_some_and(|pending| matches!(pending.waits, Condition::Computing));
            if computes && self.lock_step {
                // Virtual time does not pass here, so the speed of the computer has no influence.
                self.accept_computation(COMPUTATION_POLL_TIMEOUT)?;
                continue;
            }
            if self.update_tool(now)? {
                continue;
            }
            if let Some(report) = self.ports.robot.next()? {
                self.on_report(report)?;
            }
        }
    }

    /// Processes a request: returns the event that it causes, or executes it directly.
    fn process_request(
        &mut self,
        Request { what, requester: who, .. }: Request,
    ) -> Result<RequestOutcome, DaemonError> {
        self.requester = who;
        if let Some(request) = what.table_request()
            && let Some(why) = self
                .control
                .refusal(request, self.requester.front, self.robot_state.as_ref())
                .or_else(|| self.unproven_start_reason(request, &what))
        {
            self.ports.requests.publish(LoopEvent::NotPermitted(vec![why.clone()]));
            self.record_answer(
                RequestedAction::For(request),
                self.requester.clone(),
                (Answer::Refused, vec![why]),
            )?;
            return Ok(RequestOutcome::Done);
        }
        match what {
            RequestKind::Leave => return Ok(RequestOutcome::Leave),
            RequestKind::Table(request @ (cycle::Request::Unhold { .. } | cycle::Request::Accept))
                if self.is_disk_still_full() =>
            {
                let reasons = self.ports.record.disk_space_problems();
                self.record_answer(
                    RequestedAction::For(request),
                    self.requester.clone(),
                    (Answer::Failed, reasons),
                )?;
            }
            RequestKind::Table(request) => return Ok(RequestOutcome::TableEvent(Event::Asked(request))),
            RequestKind::Hold { why } => {
                self.remarks = vec![Reason::new("held_by", why)];
                return Ok(RequestOutcome::TableEvent(Event::Asked(cycle::Request::Hold)));
            }
            RequestKind::Begin(prepared) => {
                let event = self.begin_cycle(*prepared);
                self.events.extend(event);
            }
            RequestKind::NewDisc => self.record_new_disc()?,
            RequestKind::Refused { wanted, reasons } => {
                self.record_answer(wanted, self.requester.clone(), (Answer::Refused, reasons))?;
            }
            RequestKind::Outdated { request, reasons } => {
                self.record_answer(
                    RequestedAction::For(request),
                    self.requester.clone(),
                    (Answer::Refused, reasons),
                )?;
            }
            // These requests are answered by the gateway and the request handler.
            RequestKind::Decided { .. } | RequestKind::State | RequestKind::Start(_) | RequestKind::Shoot(_) => {}
        }
        Ok(RequestOutcome::Done)
    }

    /// Returns the reason why the acceptance tests of the controller do not permit this start. Each motion is checked
    /// again when it begins; the check at the start avoids a film and a record for a cycle that cannot move.
    fn unproven_start_reason(&self, request: cycle::Request, what: &RequestKind) -> Option<Reason> {
        let setup = match what {
            RequestKind::Begin(prepared) => Some(&prepared.setup),
            _ => self.cycle_setup(),
        };
        let needed = proof_gate::stage_of_request(request, setup.is_some_and(|setup| setup.on_foam))?;
        self.cell.proofs.refusal(needed, self.robot_state.as_ref())
    }

    /// Returns whether the disk was full at the last check and is still full; if so, informs the client.
    fn is_disk_still_full(&mut self) -> bool {
        let wrong = if self.is_disk_full { self.ports.record.disk_space_problems() } else { vec![] };
        self.is_disk_full = !wrong.is_empty();
        if self.is_disk_full {
            self.ports.requests.publish(LoopEvent::Unable(wrong));
        }
        self.is_disk_full
    }

    /// Accepts the result of the computation if it is ready; waits at most this time for it.
    fn accept_computation(&mut self, patience: Duration) -> Result<bool, DaemonError> {
        let ready = self.computing.ready(patience);
        if !ready.is_some_and(|id| self.ports.requests.admit_requests(id)) {
            return Ok(false);
        }
        if let Some(worked) = self.computing.ready_result() {
            self.accept_result(worked)?;
        }
        Ok(true)
    }

    /// Accepts a prepared cycle and returns the event of its start. If the state table refuses the start, or the record
    /// cannot begin, nothing is changed.
    fn begin_cycle(&mut self, prepared: PreparedCycle) -> Option<Event> {
        // The step is computed first: if the state table refuses the cycle, the record must not contain an entry of it.
        let event = Event::Asked(prepared.request);
        let (_, effects) = step(self.state, event);
        if effects.iter().any(|effect| matches!(effect, Effect::Refuse { .. })) {
            return Some(event);
        }
        match self.ports.record.begin(prepared.start) {
            Ok(cycle) => {
                let (robot, armed) = (self.robot_state.map(Box::new), self.deadlines.to_recording());
                // The next panel may have another frame; its displacement from the nominal pose is used for both
                // frames.
                let nominal = self.cycle_setup().map(|cycle| cycle.panel.nominal_pose);
                let moved = self.perception.panel_pose().zip(nominal);
                let moved = moved.map(|(place, nominal)| KukaPose::from_rigid(&(place * nominal.inverse())));
                let place = moved.or(self.last_panel_motion);
                self.last_panel_motion = place;
                self.ports
                    .requests
                    .publish(LoopEvent::Begun(cycle, LoopMemoryStart::Cycle { robot, armed, place }));
            }
            Err(error) => {
                self.ports.requests.publish(LoopEvent::Unable(vec![reason("store", &error)]));
                return None;
            }
        }
        self.cycle = Some(Arc::new(prepared.setup));
        self.remarks = prepared.remarks;
        (self.perception, self.abrasion, self.verdict) = (Perception::default(), AbrasionWork::default(), None);
        // Earlier reports of the tool are not part of this cycle's recording; the tool is read and commanded again.
        (self.trace, self.sent_path, self.press_state) = (Trace::default(), None, PressState::default());
        self.executed_at_stop = 0;
        Some(event)
    }

    fn perform(&mut self, event: Event, effect: Effect) -> Result<(), DaemonError> {
        match effect {
            Effect::Do { id, act } => self.begin_action(id, act)?,
            Effect::Arm { id, deadline } => {
                let at = self.ports.robot.now() + self.span(deadline);
                self.deadlines.arm(id, deadline, at);
            }
            Effect::OpenIntent(motion) => self.open_intent(&motion)?,
            Effect::CloseIntent { motion, outcome, done } => self.close_intent(&motion, outcome, done)?,
            Effect::Conclude { verdict } => {
                // A cycle that an earlier process did not complete is concluded before the clock of this process is
                // known.
                if self.condition != cycle::Robot::Unknown {
                    self.record_clock()?;
                }
                let because =
                    operator_texts::end_reason(event, self.state.at).filter(|_| verdict == Verdict::Aborted);
                let kept = self.ports.record.conclude(verdict, because.into_iter().collect())?;
                if kept != verdict {
                    // Only an error in the program leads here, because the state table never ends a cycle with a better
                    // verdict than its findings. For safety, the worse verdict is used.
                    tracing::error!(
                        table = verdict.keyword(),
                        record = kept.keyword(),
                        "internal fault: the verdict of the findings is worse than the verdict of the cycle's state \
                         table; the worse verdict is used"
                    );
                }
                let verdict = kept;
                self.verdict = Some(verdict);
                tracing::info!(verdict = verdict.keyword(), "the cycle has ended");
                self.ports.requests.publish(LoopEvent::Concluded(verdict));
            }
            Effect::Refuse { request, refusal } => {
                self.ports.requests.publish(LoopEvent::Refused(request, refusal))
            }
        }
        Ok(())
    }

    fn span(&self, deadline: Deadline) -> Duration {
        let (job, limits) = (self.cycle_setup(), &self.cell.limits);
        let process = job.map(|job| job.recipe.process());
        seconds(match (deadline, process) {
            (Deadline::Answer, _) => self.answer_timeout_s(),
            (Deadline::Stop, _) => limits.stop_deadline_s(),
            (Deadline::Token, _) => limits.token_s(),
            (Deadline::Rinse, Some(process)) => process.rinse_s(),
            (Deadline::Spray, Some(process)) => process.spray_s(),
            (Deadline::Drain, Some(process)) => process.drain_s(),
            (Deadline::Settle, Some(process)) => process.light_settle_s(),
            (_, None) => DEFAULT_TIME_LIMIT_S,
        })
    }

    /// Returns the time limit of the present action, s.
    fn answer_timeout_s(&self) -> f64 {
        match self.state.due.map(|due| due.act) {
            Some(Action::Move(motion)) => {
                let path_s = self.abrasion.plan(motion.plan).map_or(0.0, |plan| plan.duration_s);
                AIR_MOTION_TIMEOUT_S + MAX_DURATION_RATIO * path_s
            }
            Some(Action::Film) => {
                self.cycle_setup().map_or(0.0, |job| job.film_demands().filmed_s()) + FILM_TIMEOUT_MARGIN_S
            }
            Some(
                Action::Locate
                | Action::Refine { .. }
                | Action::Verify { .. }
                | Action::Plan { .. }
                | Action::DryPicture
                | Action::SelfTest,
            ) => COMPUTING_TIMEOUT_S,
            _ => FEEDBACK_S,
        }
    }
}

/// The outcome of a request.
enum RequestOutcome {
    /// The request becomes an event for the cycle's state table.
    TableEvent(Event),
    /// The request was executed directly.
    Done,
    /// The program must end, if the cell is idle.
    Leave,
}

/// Time limits for the answer to an action, s: for a switch with its feedback, and below it for a computation, for a
/// motion through the air, and for a film in addition to its observation time.
const FEEDBACK_S: f64 = 5.0;
const COMPUTING_TIMEOUT_S: f64 = 60.0;
const AIR_MOTION_TIMEOUT_S: f64 = 120.0;
const FILM_TIMEOUT_MARGIN_S: f64 = 10.0;
/// Time limit without a recipe, as before the first cycle, s: the maximum that a recipe may contain.
const DEFAULT_TIME_LIMIT_S: f64 = 600.0;
/// Maximum time for which the loop waits for a computation before it checks its other inputs.
const COMPUTATION_POLL_TIMEOUT: Duration = Duration::from_millis(5);
/// Maximum duration of a contact path, as a multiple of its duration at the planned feed: the arm is slower at changes
/// of direction.
const MAX_DURATION_RATIO: f64 = 5.0;

impl LoopMemory<'_> {
    /// Records a request after the effects of its event, and whether the request was refused. A reset that fails later
    /// is recorded in a separate entry, because it was accepted before.
    pub(super) fn record_request(
        &mut self,
        event: Event,
        refused: Option<(cycle::Request, Refusal)>,
    ) -> Result<(), DaemonError> {
        let answer = |refusal: Refusal| match refusal {
            Refusal::NotNow | Refusal::Review | Refusal::Undried => Answer::Refused,
            Refusal::Robot(_) | Refusal::Failed(_) => Answer::Failed,
        };
        let why =
            |request, refusal| (answer(refusal), vec![operator_texts::refusal(request, refusal, &self.state)]);
        match (event, refused) {
            (Event::Asked(request), None) => {
                let remarks = std::mem::take(&mut self.remarks);
                self.record_answer(RequestedAction::For(request), self.requester.clone(), (Answer::Done, remarks))
            }
            (Event::Asked(request), Some((_, refusal))) => {
                self.remarks.clear();
                let outcome = why(request, refusal);
                self.record_answer(RequestedAction::For(request), self.requester.clone(), outcome)
            }
            (Event::Reported(_), Some((request, refusal))) => {
                let outcome = why(request, refusal);
                self.record_answer(
                    RequestedAction::For(request),
                    RequestAuthor::from_source(RequestSource::Program),
                    outcome,
                )
            }
            (Event::Reported(_), None) => Ok(()),
        }
    }

    /// Records one request with its reply.
    pub(super) fn record_answer(
        &mut self,
        wanted: RequestedAction,
        who: RequestAuthor,
        (answer, reasons): (Answer, Vec<Reason>),
    ) -> Result<(), DaemonError> {
        let asked =
            RequestRecord { unix_ms: 0, wanted, who: Some(who), answer: Some(answer), reasons, findings: None };
        Ok(self.ports.record.perform_and_forget(RecordCommand::Asked(asked))?)
    }

    /// Records that a new disc was mounted, if the cell is idle.
    pub(super) fn record_new_disc(&mut self) -> Result<(), DaemonError> {
        if self.state.at.is_at_rest() {
            self.ports.record.perform_and_forget(RecordCommand::MountDisc)?;
            self.ports.requests.publish(LoopEvent::DiscMounted);
            return self.record_answer(RequestedAction::NewDisc, self.requester.clone(), (Answer::Done, vec![]));
        }
        let message = "a disc can be changed only while the cell is held, idle or stopped";
        let reasons = vec![Reason::new("not_now", message)];
        self.ports.requests.publish(LoopEvent::Unable(reasons.clone()));
        self.record_answer(RequestedAction::NewDisc, self.requester.clone(), (Answer::Refused, reasons))
    }

    /// Records the time of the clock, when a cycle begins and when it is concluded.
    pub(super) fn record_clock(&mut self) -> Result<(), DaemonError> {
        let clock = match self.lock_step {
            true => {
                let since = self.ports.robot.now().since_start();
                Clock::Simulated { at_ms: u64::try_from(since.as_millis()).unwrap_or(u64::MAX) }
            }
            false => Clock::Wall,
        };
        Ok(self.ports.record.perform_and_forget(RecordCommand::Clock(clock))?)
    }
}
