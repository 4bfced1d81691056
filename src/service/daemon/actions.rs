//! Begins the actions that the state table commands. Handles the reports of the robot and the computed results that
//! complete an action. The actions that move the arm are in `moves`.

use super::answers::reason;
use super::computing::{WorkInput, WorkOutcome, WorkResult};
use super::error::DaemonError;
use super::operator_texts;
use super::ports::{Finding, LoopEvent, Note, RecordCommand, RecordError, RobotPort};
use super::running::{Condition, LoopMemory, PendingAction};
use panelprep_base::geometry::KukaPose;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle;
use panelprep_cell::cycle::{Action, Answer, Event, Frames, Id, Report, Switch, Trouble};
use panelprep_cell::record::Kind;
use panelprep_kuka::eki::{Command, CommandId, Epoch, QueueError, SetTcp, State, TcpKind};

/// Maximum number of robot states until a stop in the queue is processed: the loop processes at least one request for
/// every two robot states.
const MAX_STATES_BEFORE_STOP: u8 = 3;

impl LoopMemory<'_> {
    /// Begins an action; an action that does not have to wait is answered at once.
    pub(super) fn begin_action(&mut self, id: Id, act: Action) -> Result<(), DaemonError> {
        self.pending_action = None;
        self.computing.abandon();
        match act {
            Action::Locate
            | Action::Refine { .. }
            | Action::Verify { .. }
            | Action::DryPicture
            | Action::Plan { .. }
            | Action::Film
            | Action::SelfTest => self.compute(id, act),
            Action::Assess => {
                // If it is not known whether the tool was running, the cycle does not continue.
                let unknown = Answer::Failed(Trouble::Unexpected);
                self.answer_action(id, self.abrasion.executed_grade.map_or(unknown, Answer::Graded));
                Ok(())
            }
            Action::CheckStandstill => {
                self.wait(id, act, Condition::Standing);
                Ok(())
            }
            Action::OpenEpoch { above } => {
                let opened = self.ports.robot.open_epoch(Epoch(above));
                self.wait_or_fail(id, act, opened.map(|_| Condition::Epoch))
            }
            Action::EndEpoch { .. } => {
                let asked = self.ports.robot.abort();
                self.wait_or_fail(id, act, asked.map(|()| Condition::EpochEnd { done: None }))
            }
            Action::SetFrames(frames) => {
                let set = self.set_frames(frames);
                self.wait_or_fail(id, act, set)
            }
            Action::Switch(switch) => {
                let set = self.switch(switch);
                self.wait_or_fail(id, act, set)
            }
            Action::Move(motion) => self.begin_move(id, motion),
        }
    }

    /// Starts the computation that an action needs.
    fn compute(&mut self, id: Id, act: Action) -> Result<(), DaemonError> {
        // The wear is read from the store for each action, because the disc may have been changed during a hold.
        self.abrasion.worn_mm2 = self.ports.record.disc_worn_mm2()?;
        self.abrasion.is_air = self.state.job.air;
        if matches!(act, Action::Plan { .. }) {
            self.abrasion.earlier = self.ports.record.earlier_abrasions()?;
        }
        let (perception, abrasion) = (self.perception.clone(), self.abrasion.clone());
        let tip = self.robot_state.map(|state| state.base_from_tcp);
        let (pass, setup) = (self.state.job.pass, self.cycle.clone());
        self.computing.submit(WorkInput {
            id,
            action: act,
            is_next_picture: false,
            perception,
            abrasion,
            tip,
            pass,
            setup,
        });
        self.wait(id, act, Condition::Computing);
        Ok(())
    }

    /// Requests the evaluation of the next picture of the film.
    fn request_next_picture(&mut self, id: Id, act: Action) {
        self.computing.submit(WorkInput::next_picture_step(id, act, self.state.job.pass, self.cycle.clone()));
        self.wait(id, act, Condition::Computing);
    }

    /// Accepts a computed result if an action still waits for this result.
    pub(super) fn accept_result(&mut self, worked: WorkResult) -> Result<(), DaemonError> {
        let WorkResult { id, outcome: found, artifacts, notes, .. } = worked;
        let is_due =
            |pending: &mut PendingAction| pending.id == id && matches!(pending.waits, Condition::Computing);
        let Some(PendingAction { act, .. }) = self.pending_action.take_if(is_due) else {
            tracing::debug!(id = id.0, "a computed result was discarded, because no action waits for it any more");
            return Ok(());
        };
        self.record_notes(notes)?;
        match (found?, artifacts) {
            (WorkOutcome::Watching { seen_s }, _) => {
                self.ports.requests.publish(LoopEvent::Filmed(seen_s));
                self.wait(id, act, if self.lock_step { Condition::Film } else { Condition::Computing });
            }
            (WorkOutcome::Wrong(wrong), _) => self.end_self_test(id, wrong)?,
            (WorkOutcome::Answer(answer), artifacts) => {
                match (act, artifacts) {
                    (_, None) => {}
                    // Of the data of the computing thread, only the evaluation of the film is accepted: its other data
                    // are older than those of the loop.
                    (Action::Film, Some((film, _))) => self.perception.add_film(film),
                    (_, Some((perception, abrasion))) => (self.perception, self.abrasion) = (perception, abrasion),
                }
                self.answer_action(id, answer);
            }
        }
        Ok(())
    }

    /// Records the notes.
    pub(super) fn record_notes(&mut self, notes: Vec<Note>) -> Result<(), RecordError> {
        for note in notes {
            match note {
                Note::Finding(finding) => self.record(finding)?,
                note => self.ports.record.perform_and_forget(RecordCommand::Note(note))?,
            }
        }
        Ok(())
    }

    /// Ends the self-test: combines the faults that the computing thread found with those that the loop found.
    fn end_self_test(&mut self, id: Id, found: Vec<(Trouble, Reason)>) -> Result<(), DaemonError> {
        let robot = self.state.facts.robot;
        let unready =
            (robot != cycle::Robot::Ready).then(|| (Trouble::Refused, operator_texts::robot_reason(robot)));
        let full = self.ports.record.disk_space_problems().into_iter().map(|reason| (Trouble::Store, reason));
        let wrong: Vec<(Trouble, Reason)> =
            unready.into_iter().chain(found).chain(full).chain(self.tool_problem()).collect();
        // The first reason determines the answer, but all reasons are recorded, so that the operator can correct all of
        // them at once.
        let answer = wrong.first().map_or(Answer::Done, |(trouble, _)| Answer::Failed(*trouble));
        if !wrong.is_empty() {
            self.record_problem(Kind::SelfTest, wrong.into_iter().map(|(_, reason)| reason).collect())?;
        }
        self.answer_action(id, answer);
        Ok(())
    }

    pub(super) fn wait(&mut self, id: Id, act: Action, waits: Condition) {
        self.pending_action = Some(PendingAction { id, act, waits });
    }

    pub(super) fn answer_action(&mut self, id: Id, answer: Answer) {
        self.pending_action = None;
        self.events.push_back(Event::Reported(Report::Answered { id, answer }));
    }

    pub(super) fn wait_or_fail(
        &mut self,
        id: Id,
        act: Action,
        waits: Result<Condition, QueueError>,
    ) -> Result<(), DaemonError> {
        match waits {
            Ok(waits) => self.wait(id, act, waits),
            // A stop is sent to the robot before the state table processes it. In this case the epoch has ended without
            // a fault, and the state table then stops the cycle.
            Err(QueueError::NoEpoch) => self.wait(id, act, Condition::NoEpoch { states: MAX_STATES_BEFORE_STOP }),
            Err(error) => self.fail_unsent(id, &error)?,
        }
        Ok(())
    }

    fn fail_unsent(&mut self, id: Id, error: &QueueError) -> Result<(), DaemonError> {
        self.record_problem(Kind::Robot, vec![reason("not_sent", error)])?;
        self.answer_action(id, Answer::Failed(Trouble::Refused));
        Ok(())
    }

    /// Records a finding about a problem of the cell, described for a person. The finding is not a result of a stage,
    /// and not a verdict on the panel.
    pub(super) fn record_problem(&mut self, kind: Kind, reasons: Vec<Reason>) -> Result<(), RecordError> {
        let judgement = Judgement::new(vec![], reasons);
        self.record(Finding::new(kind, self.state.job.pass, judgement))
    }

    /// Records a finding and reports it to the clients.
    pub(super) fn record(&mut self, finding: Finding) -> Result<(), RecordError> {
        let Finding { pass, judgement, .. } = &finding;
        let stage = finding.kind.keyword();
        let words: Vec<&str> = judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
        let (verdict, words) = (judgement.verdict.keyword(), words.join("; "));
        let is_trouble = matches!(finding.kind, Kind::Gate | Kind::Robot | Kind::SelfTest | Kind::Tool);
        if is_trouble || matches!(judgement.verdict, Verdict::Reject | Verdict::Invalid) {
            tracing::warn!(stage, pass, verdict, "{words}");
        } else {
            tracing::info!(stage, pass, verdict, "{words}");
        }
        self.ports.requests.publish(LoopEvent::Noted(judgement.reasons.clone()));
        self.ports.record.perform_and_forget(RecordCommand::Note(Note::Finding(finding)))
    }

    fn set_frames(&mut self, frames: Frames) -> Result<Condition, QueueError> {
        let nothing = QueueError::FramesNotSet { missing: "a recipe" };
        let calibrations = self.cycle_setup().ok_or(nothing)?.calibrations;
        let (base, flange_from_tool, kind) = match frames {
            Frames::Camera => {
                (KukaPose::default(), KukaPose::from_rigid(&calibrations.flange_from_camera), TcpKind::Other)
            }
            Frames::Pad => {
                let place = self
                    .perception
                    .panel_pose()
                    .ok_or(QueueError::FramesNotSet { missing: "the panel's place" })?;
                let pad = KukaPose::from_rigid(&calibrations.flange_from_tool);
                (KukaPose::from_rigid(&place), pad, TcpKind::Sanding)
            }
        };
        self.ports.robot.send(Command::SetBase(base))?;
        Ok(Condition::Frames(self.ports.robot.send(Command::SetTcp(SetTcp { flange_from_tool, kind }))?))
    }

    fn switch(&mut self, switch: Switch) -> Result<Condition, QueueError> {
        let (signals, proof) = (self.cell.wiring.signals(switch), self.cell.wiring.switch_proof(switch));
        let mut last = CommandId(0);
        for signal in signals {
            last = self.ports.robot.send(Command::SetDigout(signal))?;
        }
        Ok(Condition::Feedback { last, proof })
    }

    /// Checks whether this state of the robot completes the pending action.
    pub(super) fn check_pending(&mut self, state: &State) -> Result<(), DaemonError> {
        let Some(PendingAction { id, act, waits }) = self.pending_action.take() else { return Ok(()) };
        let is_still = !state.moving;
        match waits {
            Condition::Standing if is_still => self.answer_action(id, Answer::Standstill { done: 0 }),
            Condition::EpochEnd { done: Some(done) }
                if is_still && self.cell.wiring.tool_is_off(state) && self.cell.wiring.water_is_off(state) =>
            {
                self.answer_action(id, Answer::Standstill { done });
            }
            Condition::Frames(last) if state.done >= last && state.base_set && state.tool_set => {
                self.answer_action(id, Answer::Done);
            }
            Condition::Feedback { last, proof } if state.done >= last && proof.is_satisfied(state) => {
                self.answer_action(id, Answer::Done);
            }
            Condition::Warned { last, until } => {
                if let Action::Move(motion) = act {
                    self.warning((id, motion), (last, until), state)?;
                }
            }
            Condition::NoEpoch { states: 0 } => self.fail_unsent(id, &QueueError::NoEpoch)?,
            Condition::NoEpoch { states } => self.wait(id, act, Condition::NoEpoch { states: states - 1 }),
            Condition::Ready(last) if state.done >= last && is_still => {
                if let Action::Move(motion) = act {
                    self.move_by_lines(id, motion)?;
                }
            }
            Condition::PathEnd if is_still => self.end_path(id, act, state)?,
            Condition::Film => self.request_next_picture(id, act),
            waits => self.wait(id, act, waits),
        }
        Ok(())
    }
}
