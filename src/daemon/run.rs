//! The loop itself.

use super::abrasion::Abrasion;
use super::acts::{Pending, Sent};
use super::deadlines::{Deadlines, seconds};
use super::ports::{Ask, Eyes, Record, Requests, Robot};
use super::sight::{Sight, reason};
use super::{DaemonError, Job};
use crate::cycle::{self, Act, Answer, Deadline, Effect, Event, Id, Path, Report, State, Trouble, fold, step};
use crate::eki::{self, Mode, StopCause};
use crate::geometry::{Base, Panel, Rigid};
use crate::inspect::Inspection;
use crate::panel::GridId;
use crate::verdict::{Reason, Verdict};
use std::collections::VecDeque;
use std::time::Duration;

/// What the loop stands on.
pub struct Ports<'a> {
    /// The robot.
    pub robot: &'a mut dyn Robot,
    /// The cameras.
    pub eyes: &'a mut dyn Eyes,
    /// The record.
    pub record: &'a mut dyn Record,
    /// Who asks.
    pub requests: &'a mut dyn Requests,
}

/// How it ended.
#[derive(Debug)]
pub struct CycleOutcome {
    /// The state that was left.
    pub state: State,
    /// The last verdict, where a cycle ran.
    pub verdict: Option<Verdict>,
    /// Where the panel stands.
    pub base_from_panel: Option<Rigid<Base, Panel>>,
    /// The last film.
    pub inspection: Option<Inspection>,
    /// In how many passes each grid was abraded, where it was.
    pub passes: Vec<(GridId, usize)>,
}

/// Runs until whoever asks leaves a state that rests. `journal` is what the store holds.
///
/// # Errors
/// Where the record cannot be written: the robot is told to stop, and nothing more is done.
pub fn run_cycle(
    job: &Job<'_>,
    ports: Ports<'_>,
    journal: impl IntoIterator<Item = Event>,
) -> Result<CycleOutcome, DaemonError> {
    let mut running = Running {
        job,
        ports,
        state: fold(journal),
        events: VecDeque::from([Event::Told(Report::Boot)]),
        deadlines: Deadlines::default(),
        sight: Sight::default(),
        abrasion: Abrasion::default(),
        pending: None,
        sent: None,
        robot_state: None,
        condition: cycle::Robot::Unknown,
        verdict: None,
    };
    let result = running.run();
    if result.is_err() {
        // Best effort: without a controller its own watchdog stops it.
        let _ = running.ports.robot.abort();
    }
    result?;
    let Running { state, verdict, sight, abrasion, .. } = running;
    let passes = abrasion.passes().collect();
    Ok(CycleOutcome { state, verdict, base_from_panel: sight.place(), inspection: sight.inspection, passes })
}

/// The loop's own memory; the table's is [`State`].
pub(super) struct Running<'j, 'p> {
    pub job: &'j Job<'j>,
    pub ports: Ports<'p>,
    pub state: State,
    pub events: VecDeque<Event>,
    deadlines: Deadlines,
    pub sight: Sight,
    pub abrasion: Abrasion,
    pub pending: Option<Pending>,
    pub sent: Option<Sent>,
    pub robot_state: Option<eki::State>,
    condition: cycle::Robot,
    verdict: Option<Verdict>,
}

impl Running<'_, '_> {
    fn run(&mut self) -> Result<(), DaemonError> {
        while let Some(event) = self.next_event()? {
            self.take(event)?;
        }
        Ok(())
    }

    /// One event: journal, step, effects.
    fn take(&mut self, event: Event) -> Result<(), DaemonError> {
        self.ports.record.event(&event)?;
        if let Event::Told(Report::Answered { id, .. }) = event {
            self.deadlines.disarm(id);
        }
        let (state, effects) = step(self.state, event);
        self.state = state;
        // What is no longer due is abandoned.
        self.pending.take_if(|pending| state.due.is_none_or(|due| due.id != pending.id));
        effects.into_iter().try_for_each(|effect| self.perform(effect))
    }

    /// The next thing that happened; `None` when it is time to leave.
    fn next_event(&mut self) -> Result<Option<Event>, DaemonError> {
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(Some(event));
            }
            match self.ports.requests.next(&self.state) {
                Ask::For(request) => return Ok(Some(Event::Asked(request))),
                Ask::Leave if self.state.at.rests() => return Ok(None),
                Ask::Leave | Ask::Nothing => {}
            }
            if let Some(report) = self.deadlines.over(self.ports.robot.now()) {
                return Ok(Some(Event::Told(report)));
            }
            if let Some(report) = self.ports.robot.next() {
                self.hear(report)?;
            }
        }
    }

    fn perform(&mut self, effect: Effect) -> Result<(), DaemonError> {
        match effect {
            Effect::Do { id, act } => self.begin(id, act)?,
            Effect::Arm { id, deadline } => {
                let at = self.ports.robot.now() + self.span(deadline);
                self.deadlines.arm(id, deadline, at);
            }
            Effect::OpenIntent(motion) => self.ports.record.open_intent(&motion)?,
            Effect::CloseIntent { motion, outcome, done } => {
                if motion.path == Path::Contact {
                    self.abrasion.executed(self.state.job.pass, done);
                }
                self.ports.record.close_intent(&motion, outcome, done)?;
            }
            Effect::Conclude { verdict } => {
                self.verdict = Some(verdict);
                self.ports.record.conclude(verdict)?;
            }
            Effect::Refuse { request, refusal } => self.ports.requests.refused(request, refusal),
        }
        Ok(())
    }

    fn span(&self, deadline: Deadline) -> Duration {
        let (process, limits) = (self.job.recipe.process(), self.job.limits);
        seconds(match deadline {
            Deadline::Answer => self.answer_s(),
            Deadline::Stop => limits.stop_deadline_s(),
            Deadline::Rinse => process.rinse_s(),
            Deadline::Spray => process.spray_s(),
            Deadline::Drain => process.drain_s(),
            Deadline::Settle => process.light_settle_s(),
            Deadline::Token => limits.token_s(),
        })
    }

    /// The longest that the act that is due may take, s.
    fn answer_s(&self) -> f64 {
        match self.state.due.map(|due| due.act) {
            Some(Act::Move(motion)) => {
                let path_s = self.abrasion.plan(motion.plan).map_or(0.0, |plan| plan.duration_s);
                MOVE_S + SLOWEST * path_s
            }
            Some(Act::Film) => self.job.demands().observation_s + FILM_SPARE_S,
            Some(Act::Locate | Act::Refine { .. } | Act::Verify | Act::Plan { .. } | Act::DryPicture) => {
                COMPUTING_S
            }
            _ => FEEDBACK_S,
        }
    }

    /// What the robot tells, as events and as answers to what is pending.
    fn hear(&mut self, report: eki::Report) -> Result<(), DaemonError> {
        use eki::Report as R;
        match report {
            R::Connected { state } | R::State(state) => self.hear_state(&state)?,
            R::Rebooted { state } => {
                self.becomes(cycle::Robot::Restarted);
                self.hear_state(&state)?;
            }
            R::LinkLost { why } => {
                self.robot_state = None;
                self.becomes(cycle::Robot::LinkLost);
                self.note("robot", vec![reason("link_lost", &why)])?;
            }
            R::EpochOpened { epoch } => {
                self.answer_if(|act| matches!(act, Act::OpenEpoch { .. }), Answer::Epoch(epoch.0))
            }
            R::EpochNotOpened { .. } => {
                self.answer_if(|act| matches!(act, Act::OpenEpoch { .. }), Answer::Failed(Trouble::Protocol));
            }
            R::Progress { done } => self.executed(done),
            // The state says that it stands there.
            R::PathDone { .. } => {}
            R::Standstill { done } => self.stood_still(done),
            R::Refused { refusal, id } => {
                let words = Reason::new("refused", format!("the controller refused command {id}: {refusal}"));
                self.trouble(Trouble::Refused, words)?;
            }
            R::EchoMismatch(mismatch) => self.trouble(Trouble::Protocol, reason("echo", &*mismatch))?,
            // The others come as a condition.
            R::Interrupted { cause: cause @ (StopCause::ByProgram | StopCause::Unattended) } => {
                self.trouble(Trouble::Starved, reason("interrupted", &cause))?;
            }
            R::Interrupted { .. } => {}
            R::SequenceError(error) => self.trouble(Trouble::Sequence, reason("sequence", &error))?,
            R::WatchdogExpired { channel, silence } => {
                let words = format!("the {channel} was silent for {} ms", silence.as_millis());
                self.trouble(Trouble::Late, Reason::new("watchdog", words))?;
            }
        }
        Ok(())
    }

    fn hear_state(&mut self, state: &eki::State) -> Result<(), DaemonError> {
        self.robot_state = Some(*state);
        self.becomes(condition(state));
        self.look(state)
    }

    fn becomes(&mut self, condition: cycle::Robot) {
        if condition != self.condition {
            self.condition = condition;
            self.events.push_back(Event::Told(Report::Robot(condition)));
        }
    }

    fn answer_if(&mut self, fits: impl Fn(Act) -> bool, answer: Answer) {
        let id: Option<Id> = self.pending.as_ref().filter(|pending| fits(pending.act)).map(|pending| pending.id);
        if let Some(id) = id {
            self.answer(id, answer);
        }
    }

    fn trouble(&mut self, trouble: Trouble, words: Reason) -> Result<(), DaemonError> {
        self.note("robot", vec![words])?;
        self.events.push_back(Event::Told(Report::Trouble(trouble)));
        Ok(())
    }
}

/// Longest times for an answer, s: a switch with its feedback, a computation, a way through air, and a film beyond
/// its observation.
const FEEDBACK_S: f64 = 5.0;
const COMPUTING_S: f64 = 60.0;
const MOVE_S: f64 = 120.0;
const FILM_SPARE_S: f64 = 10.0;
/// A contact path may take this many times what it takes at its feed: turns are slower.
const SLOWEST: f64 = 5.0;

fn condition(state: &eki::State) -> cycle::Robot {
    use cycle::Robot;
    match state {
        _ if state.emergency_stop => Robot::EmergencyStop,
        _ if !state.guard_closed => Robot::GuardOpen,
        _ if matches!(state.mode, Mode::T1 | Mode::T2) => Robot::NotAutomatic,
        _ if !(state.drives_on && state.motion_possible) => Robot::DrivesOff,
        _ => Robot::Ready,
    }
}
