//! What the controller tells: acknowledgements where something changed, states on request and every 100 ms.

use super::codec::{Template, Value};
use super::kinematics::angles_deg;
use super::model::{Controller, TICK_MS};
use super::setup::Setup;
use super::wire::Channel;
use crate::geometry::KukaPose;
use std::collections::BTreeMap;

const STATE_EVERY_MS: u64 = 100;
const ACK_EVERY_MS: u64 = 500;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Ack {
    received: i32,
    done: i32,
    free: i32,
    refusal: (i32, i32),
    epoch: i32,
}

/// What was told last.
#[derive(Debug)]
pub(super) struct Answers {
    ack: Template,
    state: Template,
    last_ack: Option<(Ack, u64)>,
    last_state_ms: u64,
    sequence: i32,
    answered: i32,
}

impl Answers {
    pub(super) fn new(setup: &Setup) -> Self {
        Answers {
            ack: Template::new(&setup.commands.sent),
            state: Template::new(&setup.states.sent),
            last_ack: None,
            last_state_ms: 0,
            sequence: setup.first_state,
            answered: 0,
        }
    }

    /// A new client has been told nothing.
    pub(super) fn forget_ack(&mut self) {
        self.last_ack = None;
    }
}

impl Controller {
    /// At the end of a tick: what has changed, or is due.
    pub(super) fn tell(&mut self) {
        let ack = self.ack();
        let due =
            self.answers.last_ack.is_none_or(|(told, at_ms)| told != ack || self.now_ms >= at_ms + ACK_EVERY_MS);
        if due && self.commands.connected && !self.troubles.silences(Channel::Command) {
            self.answers.last_ack = Some((ack, self.now_ms));
            self.answers.ack.write(&mut self.commands.out, |tag| match tag {
                "Ack/@Rx" => Value::Int(ack.received),
                "Ack/@Done" => Value::Int(ack.done),
                "Ack/@Free" => Value::Int(ack.free),
                "Ack/@Err" => Value::Int(ack.refusal.0),
                "Ack/@ErrId" => Value::Int(ack.refusal.1),
                "Ack/@Ep" => Value::Int(ack.epoch),
                _ => Value::Unset,
            });
        }
        // In a granted time the heartbeat's answer is that state.
        let next_ms = self.now_ms + TICK_MS;
        if self.read_up_to.is_none() && next_ms > self.answers.last_state_ms + STATE_EVERY_MS {
            self.tell_state(self.answers.answered);
        }
    }

    fn ack(&self) -> Ack {
        let epoch = &self.epoch;
        Ack {
            received: epoch.received,
            done: epoch.done,
            free: epoch.free() as i32,
            refusal: epoch.refusal.map_or((0, 0), |(refusal, id)| (refusal as i32, id)),
            epoch: epoch.number,
        }
    }

    /// Sends the state, as the answer to this request.
    pub(super) fn tell_state(&mut self, request: i32) {
        if !self.states.connected || self.troubles.silences(Channel::State) {
            return;
        }
        self.answers.answered = request;
        self.answers.last_state_ms = self.now_ms;
        // Counts on from 0 behind the highest number of 32 bits.
        self.answers.sequence = self.answers.sequence.wrapping_add(1 + self.troubles.take_skip()) & i32::MAX;
        let mut out = std::mem::take(&mut self.states.out);
        let axes = angles_deg(&self.mover.joints());
        let base = self.epoch.base.unwrap_or_default();
        let tool = self.epoch.tool.map_or_else(KukaPose::default, |tool| tool.pose);
        let tcp = self.tcp();
        self.answers.state.write(&mut out, |tag| match tag.rsplit_once("/@") {
            Some(("St", name)) => self.state_number(name).map_or(Value::Unset, Value::Int),
            Some(("St/J", name)) => number(name, ["A1", "A2", "A3", "A4", "A5", "A6"], axes),
            Some(("St/Tcp", name)) => frame_number(name, &tcp),
            Some(("St/Base", name)) => frame_number(name, &base),
            Some(("St/Tool", name)) => frame_number(name, &tool),
            _ => Value::Unset,
        });
        self.states.out = out;
    }

    fn state_number(&self, name: &str) -> Option<i32> {
        Some(match name {
            "T" => ((self.now_ms - self.started_ms) % (1 << 31)) as i32,
            "Seq" => self.answers.sequence,
            "Re" => self.answers.answered,
            "Ep" => self.epoch.number,
            "Boot" => self.setup.boot,
            "Sum" => self.setup.checksum,
            "Mode" => self.safety.mode as i32,
            "Flags" => self.flag_bits(),
            "In" => bits(&self.setup.inputs, &self.inputs),
            "Out" => bits(&self.setup.outputs, &self.outputs),
            "Done" => self.epoch.done,
            "Under" => self.underruns,
            _ => return None,
        })
    }

    fn flag_bits(&self) -> i32 {
        let flags = [
            self.safety.drives_on,
            !self.safety.e_stop,
            self.safety.guard_closed,
            self.is_moving(),
            self.safety.motion_possible(),
            self.epoch.base.is_some(),
            self.epoch.tool.is_some(),
            self.stopped,
        ];
        flags.iter().enumerate().fold(0, |sum, (bit, &set)| sum | (i32::from(set) << bit))
    }
}

fn bits(numbers: &[u16], values: &BTreeMap<u16, bool>) -> i32 {
    let set = |number: &u16| i32::from(values.get(number).copied().unwrap_or(false));
    numbers.iter().take(31).enumerate().fold(0, |sum, (bit, number)| sum | (set(number) << bit))
}

fn number(name: &str, names: [&str; 6], numbers: [f64; 6]) -> Value {
    let place = names.iter().position(|known| *known == name);
    place.map_or(Value::Unset, |place| Value::Real(numbers[place] as f32))
}

fn frame_number(name: &str, pose: &KukaPose) -> Value {
    let numbers = [pose.x_mm, pose.y_mm, pose.z_mm, pose.a_deg, pose.b_deg, pose.c_deg];
    number(name, ["X", "Y", "Z", "A", "B", "C"], numbers)
}
