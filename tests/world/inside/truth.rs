//! Checks the true actions of the controller, whatever it and the client report: a cause that must end an epoch ends
//! it, the client is informed of the end, and neither of them keeps a dead connection open.

use super::super::link_cell::TICK_MS;
use super::Inside;
use panelprep::devices::mock::Fault;
use panelprep::eki::{CommandId, Epoch};

/// The operation of the request by which a client ends an epoch.
const ABORT: i32 = 11;
/// Maximum time until an epoch ends, ms: for the model, and below it for the programs, which an overloaded scheduler
/// may delay.
const MAX_MODEL_END_MS: u64 = 50;
const MAX_PROGRAMS_END_MS: u64 = 250;
/// Minimum duration for which a condition is always detected by the programs, ms.
const MIN_DETECTED_MS: u64 = 100;
/// Maximum delay of a state, ms: a state is sent every 100 ms, and the programs may be late.
const MAX_STATE_DELAY_MS: u64 = 250;
/// Maximum time until the client knows that its epoch has ended, ms.
const MAX_KNOWLEDGE_DELAY_MS: u64 = 700;
/// Maximum time until the client closes a silent connection, ms: after a second of silence.
const MAX_CLIENT_SILENCE_MS: u64 = 1_000 + 50;
/// Maximum time until the controller closes a silent connection, ms: after three seconds of silence.
const MAX_CONTROLLER_SILENCE_MS: u64 = 3_000 + 400;
/// Maximum duration of a controller's fault with its restart, ms.
const MAX_FAULTY_MS: u64 = 6_000;

/// The events at the controller, and the required reactions.
#[derive(Debug, Default)]
pub struct Truth {
    must_end: Vec<MustEnd>,
    /// Time since which the client treats an ended epoch as open, ms.
    unnoticed_since_ms: Option<u64>,
    /// Time until which all actions of the controller may be late, ms.
    pub faulty_until_ms: u64,
    /// The last command that sets base or tool.
    frames: Option<(Epoch, CommandId)>,
    /// The first line of a path that waits to be sent, and the command that sets its base or tool. A restarted
    /// controller counts from zero.
    lines: Option<(Epoch, CommandId, CommandId)>,
    /// Whether bytes to the controller were changed: the following bytes may be treated as a part of the same message.
    pub is_garbled: bool,
    /// Number of restarts of the controller.
    pub reboots: u32,
}

/// An epoch that must end, with the time limit and the reason.
#[derive(Debug)]
struct MustEnd {
    epoch: i32,
    since_ms: u64,
    by_ms: u64,
    why: String,
}

impl Truth {
    /// Records that the client accepts a command to send that sets base or tool.
    pub fn sets_frame(&mut self, epoch: Epoch, id: CommandId) {
        self.frames = Some((epoch, id));
    }

    /// Records that the client accepts a path to send whose first line has this ID.
    pub fn lines(&mut self, epoch: Epoch, first: CommandId) {
        let set = self.frames.filter(|(of, _)| *of == epoch).map(|(_, id)| id);
        self.lines = set.map(|id| (epoch, first, id));
    }
}

impl Inside {
    /// Records the required reactions to a fault that the controller is about to have.
    pub(super) fn expects_of(&mut self, fault: &Fault) {
        let since_ms = self.now_ms().saturating_sub(TICK_MS);
        match fault {
            Fault::EStop { for_ms } | Fault::Guard { for_ms } | Fault::Drives { for_ms }
                if self.is_seen(*for_ms) =>
            {
                self.must_end(format!("{fault:?}"));
            }
            Fault::Reboot { .. } => {
                self.truth.reboots += 1;
                self.truth.lines = None;
                if self.counts.lives > 1 {
                    // The present process may have opened none of the earlier epochs, and the count begins again.
                    self.oracles.epochs_begin_anew();
                }
            }
            Fault::Stall { for_ms } => {
                let for_ms = for_ms.unwrap_or_default();
                self.truth.faulty_until_ms = self.truth.faulty_until_ms.max(self.now_ms() + for_ms + MAX_FAULTY_MS);
            }
            _ => {}
        }
        if !matches!(fault, Fault::EStop { .. } | Fault::Guard { .. } | Fault::Drives { .. }) {
            // The controller may have been stopped before it could react to a condition that had to end the epoch.
            self.truth.must_end.retain(|must| must.by_ms < since_ms);
        }
        self.truth.faulty_until_ms = self.truth.faulty_until_ms.max(self.now_ms() + MAX_FAULTY_MS);
    }

    /// Returns whether a condition of this duration is detected: the programs check it in each cycle of an interpreter,
    /// which may be delayed.
    fn is_seen(&self, for_ms: Option<u64>) -> bool {
        self.cell.controller.robot_state().is_none() || for_ms.is_none_or(|for_ms| for_ms >= MIN_DETECTED_MS)
    }

    /// Records the required reactions to a request of another client to the controller.
    pub(super) fn expects_of_foreign(&mut self, operation: i32) {
        if operation == ABORT && self.now_ms() > self.truth.faulty_until_ms && !self.truth.is_garbled {
            self.must_end("an abort".to_owned());
        }
    }

    /// Records that the open epoch of client and controller must end.
    fn must_end(&mut self, why: String) {
        // The controller's clock advances in ticks.
        let (controller, since_ms) = (&self.cell.controller, self.now_ms().saturating_sub(TICK_MS));
        let epoch = controller.epoch();
        let is_open = self.open_epoch().is_some_and(|open| open.0.cast_signed() == epoch);
        if is_open && !controller.is_stopped() {
            let ends_ms = if controller.robot_state().is_some() { MAX_PROGRAMS_END_MS } else { MAX_MODEL_END_MS };
            self.truth.must_end.push(MustEnd { epoch, since_ms, by_ms: since_ms + ends_ms, why });
        }
    }

    pub(super) fn judge_truth(&mut self) {
        self.judge_ends();
        self.judge_knowledge();
        self.judge_silence();
        self.judge_places();
        self.judge_frames();
    }

    fn judge_ends(&mut self) {
        let now_ms = self.now_ms();
        for MustEnd { epoch, since_ms, by_ms, why } in
            self.truth.must_end.extract_if(.., |must| must.by_ms < now_ms).collect::<Vec<_>>()
        {
            self.counts.judged("what ends an epoch");
            let is_it = |stop: &&panelprep::devices::mock::ProgramStop| {
                stop.epoch == epoch && (since_ms..=by_ms).contains(&stop.time_ms)
            };
            if !self.cell.controller.program_stops().iter().rev().any(|stop| is_it(&stop)) {
                self.wrong("what ends an epoch", format!("epoch {epoch} went on after {why} at {since_ms} ms"));
            }
        }
    }

    /// Checks that a client that receives the controller's states does not treat an epoch as open that the controller
    /// has ended.
    fn judge_knowledge(&mut self) {
        let controller = &self.cell.controller;
        let is_open = self.open_epoch().is_some_and(|open| open.0.cast_signed() == controller.epoch());
        let hears = self.cell.silence_ms().is_some_and(|silence_ms| silence_ms < MAX_STATE_DELAY_MS);
        if !(is_open && controller.is_stopped() && hears) || self.is_strange() {
            self.truth.unnoticed_since_ms = None;
            return;
        }
        let now_ms = self.now_ms();
        let since_ms = *self.truth.unnoticed_since_ms.get_or_insert(now_ms);
        self.counts.judged("an ended epoch is known");
        if now_ms > since_ms + MAX_KNOWLEDGE_DELAY_MS {
            let what = format!("the controller ended the epoch at {since_ms} ms, and the client has it open");
            self.wrong("an ended epoch is known", what);
        }
    }

    /// Checks that a client that receives nothing does not treat itself as connected.
    fn judge_silence(&mut self) {
        if let Some(silence_ms) = self.cell.silence_ms() {
            self.counts.judged("a silent link");
            if silence_ms > MAX_CLIENT_SILENCE_MS {
                self.wrong("a silent link", format!("the client has heard nothing for {silence_ms} ms and stays"));
            }
        }
    }

    /// Checks that a controller without messages from its client does not keep the connection reserved for this client.
    pub(super) fn judge_places(&mut self) {
        let Some(unreached_ms) = self.cell.unreached_ms() else { return };
        self.counts.judged("the place of a client");
        if unreached_ms > MAX_CONTROLLER_SILENCE_MS && self.now_ms() > self.truth.faulty_until_ms {
            let what = format!("no person has reached the controller for {unreached_ms} ms, and a place is taken");
            self.wrong("the place of a client", what);
        }
    }

    /// Checks that no line is sent before the controller has executed the commands that set its base and tool.
    fn judge_frames(&mut self) {
        let Some((epoch, first, set)) = self.truth.lines else { return };
        if self.oracles.last_sent(epoch) < first.0 {
            return;
        }
        self.truth.lines = None;
        let controller = &self.cell.controller;
        let done = controller.counts().1.cast_unsigned();
        self.counts.judged("base and tool before lines");
        if controller.epoch() == epoch.0.cast_signed() && done < set.0 {
            let what = format!("line {first} was sent, {set} sets its base or tool, {done} is executed");
            self.wrong("base and tool before lines", what);
        }
    }
}
