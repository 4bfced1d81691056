//! The messages that the controller sends: acknowledgements when something changed, states on request and every 100
//! ms.

use super::answer::Ack;
use super::codec::Value;
use super::kinematics::angles_deg;
use super::model::{Controller, TICK_MS};
use super::wire::Channel;
use panelprep_base::geometry::KukaPose;
use std::collections::BTreeMap;

const STATE_INTERVAL_MS: u64 = 100;
const ACK_INTERVAL_MS: u64 = 500;

impl Controller {
    /// Sends at the end of a tick what has changed or is due.
    pub(super) fn publish_changes(&mut self) {
        let ack = self.make_ack();
        let due =
            self.answers.last_ack.is_none_or(|(told, at_ms)| told != ack || self.now_ms >= at_ms + ACK_INTERVAL_MS);
        if due && self.commands.connected && !self.troubles.is_channel_silenced(Channel::Command) {
            self.answers.last_ack = Some((ack, self.now_ms));
            let numbers = [ack.received, ack.done, ack.free, ack.refusal.0, ack.refusal.1, ack.epoch];
            self.answers.ack.write(&mut self.commands.out, &numbers.map(Value::Int));
        }
        // If a heartbeat has granted this time, the answer to the heartbeat replaces this state.
        let next_ms = self.now_ms + TICK_MS;
        if self.read_up_to.is_none() && next_ms > self.answers.last_state_ms + STATE_INTERVAL_MS {
            self.send_state(self.answers.answered);
        }
    }

    fn make_ack(&self) -> Ack {
        let epoch = &self.epoch;
        Ack {
            received: epoch.last_received,
            done: epoch.last_executed,
            free: epoch.free_entries() as i32,
            refusal: epoch.refusal.map_or((0, 0), |(refusal, id)| (refusal as i32, id)),
            epoch: epoch.number,
        }
    }

    /// Sends the state, as the answer to this request.
    pub(super) fn send_state(&mut self, request: i32) {
        if !self.states.connected || self.troubles.is_channel_silenced(Channel::State) {
            return;
        }
        self.answers.answered = request;
        self.answers.last_state_ms = self.now_ms;
        // After the highest 32-bit number, the count continues from 0.
        self.answers.sequence =
            self.answers.sequence.wrapping_add(1 + self.troubles.take_sequence_skip()) & i32::MAX;
        let whole = self.state_numbers().map(Value::Int);
        let tool = self.epoch.tool.map_or_else(KukaPose::default, |tool| tool.pose);
        let tcp = self.tcp();
        let measured = KukaPose { z_mm: tcp.z_mm + self.troubles.pose_deviation_mm(), ..tcp };
        let frames = [measured, self.epoch.base.unwrap_or_default(), tool].map(numbers);
        let real = angles_deg(&self.mover.joints()).into_iter().chain(frames.into_iter().flatten());
        let values: Vec<Value> = whole.into_iter().chain(real.map(|number| Value::Real(number as f32))).collect();
        self.answers.state.write(&mut self.states.out, &values);
    }

    /// Returns the numbers of the state in the order of [`STATE_TAGS`].
    fn state_numbers(&self) -> [i32; 13] {
        [
            ((self.now_ms - self.started_ms) % (1 << 31)) as i32,
            self.answers.sequence,
            self.answers.answered,
            self.epoch.number,
            self.setup.boot,
            self.setup.checksum,
            self.safety.mode as i32,
            self.flag_bits(),
            bits(&self.setup.inputs, &self.inputs),
            bits(&self.setup.outputs, &self.outputs),
            self.epoch.last_executed,
            self.underruns,
            i32::from(self.troubles.override_percent()),
        ]
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

fn numbers(pose: KukaPose) -> [f64; 6] {
    [pose.x_mm, pose.y_mm, pose.z_mm, pose.a_deg, pose.b_deg, pose.c_deg]
}
