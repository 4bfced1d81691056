//! The two channels of the controller: connections, received and sent bytes, the flags that they set, and the messages
//! that the controller sends. It sends an acknowledgement after each change, and its state on request and every 100 ms.

use super::channel_file::{EkiFault, Environment};
use super::codec::Value;
use super::kinematics::angles_deg;
use super::memory::{Link, Raised};
use super::model::{Controller, TICK_MS};
use super::options::Clock;
use super::submit::REOPEN_MS;
use super::wire::{Ack, Channel};
use panelprep_base::geometry::KukaPose;
use std::collections::BTreeMap;

const STATE_INTERVAL_MS: u64 = 100;
const ACK_INTERVAL_MS: u64 = 500;

impl Controller {
    /// Connects a client, which resets the channel. Returns false if the channel already has a client or does not
    /// listen.
    pub fn connect(&mut self, channel: Channel) -> bool {
        let (now_ms, unplugged) = (self.now_ms, self.troubles.is_unplugged());
        if self.running.is_some() {
            return !unplugged && self.connect_interpreted(channel);
        }
        let link = self.link(channel);
        if link.connected || unplugged || now_ms < link.listens_at_ms {
            return false;
        }
        if link.listens_for_ms.is_some_and(|ms| now_ms - link.listens_at_ms > ms) {
            link.fault = Some(EkiFault::TimeLimit);
            return false;
        }
        link.memory.clear();
        link.out.clear();
        (link.connected, link.fault) = (true, None);
        if channel == Channel::Command {
            self.answers.forget_ack();
        }
        self.last_frame_ms = now_ms;
        // If the old client was lost without notice, the connection attempts of a new client must not reset the time of
        // the old client's last request.
        if !self.is_connected(channel.opposite()) {
            self.last_request_ms = now_ms;
        }
        self.awaits_commands = true;
        self.show_alive(channel);
        true
    }

    /// Processes the loss of the client, or the closing of the channel by the controller. Queued commands are not
    /// executed. Afterwards the program clears the channel and opens it again.
    pub fn disconnect(&mut self, channel: Channel) {
        if self.troubles.is_unplugged() {
            self.troubles.hung_up[channel as usize] = true;
            return;
        }
        self.drop_client(channel, EkiFault::Disrupted);
    }

    /// Closes the channel by the robot program, even if the cable is unplugged.
    pub(super) fn drop_client(&mut self, channel: Channel, fault: EkiFault) {
        if self.running.is_some() {
            return self.lose_interpreted(channel, fault);
        }
        let reopens_ms = if self.setup.clock == Clock::Free { self.now_ms + REOPEN_MS } else { self.now_ms };
        let link = self.link(channel);
        if !link.connected {
            return;
        }
        (link.connected, link.listens_at_ms) = (false, reopens_ms);
        link.fault = Some(fault);
        link.out.clear();
        self.show_alive(channel);
        self.awaits_commands &= channel != Channel::Command;
        self.link_lost();
        self.serve_lock_step();
    }

    /// Processes bytes that arrived on the command channel.
    pub fn command_bytes(&mut self, bytes: &[u8]) {
        let Some(documents) = self.receive(Channel::Command, bytes) else { return };
        if documents > 0 && self.running.is_some() {
            // In lock step the commands were already counted when they arrived.
            if self.setup.clock == Clock::Free {
                self.count_arrived(u64::from(documents));
            }
        } else if documents > 0 {
            match self.command_places.newest_epoch_and_id(&self.commands.memory) {
                Some(newest) => self.arrived = self.arrived.max(newest),
                None => self.awaits_commands = false,
            }
            self.count_arrived(u64::from(documents));
            self.serve_lock_step();
        }
    }

    /// Processes bytes that arrived on the state channel.
    pub fn state_bytes(&mut self, bytes: &[u8]) {
        if self.receive(Channel::State, bytes).is_some_and(|documents| documents > 0) {
            self.serve_lock_step();
        }
    }

    /// Returns the number of documents that these bytes complete; `None` if the channel is closed.
    fn receive(&mut self, channel: Channel, bytes: &[u8]) -> Option<u32> {
        if self.troubles.is_unplugged() {
            self.troubles.cable_buffer[channel as usize].extend_from_slice(bytes);
            return None;
        }
        if !self.is_connected(channel) {
            return None;
        }
        if self.is_holding_back() {
            self.hold(channel, bytes);
            return None;
        }
        let link = self.link(channel);
        let received = link.memory.receive(bytes);
        let raised = link.memory.remove_raised_signals();
        self.note_change();
        raised.iter().for_each(|&raised| self.raise(raised, true));
        match received {
            Ok(documents) => Some(documents),
            Err(fault) => {
                self.close(channel, fault);
                None
            }
        }
    }

    fn raise(&mut self, raised: Raised, value: bool) {
        match raised {
            Raised::Flag(number) => drop(self.flags.insert(number, value)),
            Raised::Output(number) => self.set_output(number, value),
        }
    }

    /// Resets the flags of the channel. This is done before the program clears the channel's buffers, so that no rising
    /// edge is lost.
    pub(super) fn reset_flags(&mut self, channel: Channel) {
        for index in 0..self.link(channel).raises.len() {
            let raised = self.link(channel).raises[index];
            self.raise(raised, false);
        }
    }

    pub(super) fn show_alive(&mut self, channel: Channel) {
        let Link { connected, alive: (flag, output), .. } = *self.link(channel);
        flag.map(Raised::Flag).into_iter().for_each(|flag| self.raise(flag, connected));
        output.map(Raised::Output).into_iter().for_each(|output| self.raise(output, connected));
    }

    /// Closes a channel by the controller; [`Controller::close_reason`] returns the reason.
    pub(super) fn close(&mut self, channel: Channel, fault: EkiFault) {
        self.drop_client(channel, fault);
    }

    /// Returns why this channel was last closed; `None` while the channel is open, or if it was never closed.
    pub fn close_reason(&self, channel: Channel) -> Option<EkiFault> {
        match channel {
            Channel::Command => self.commands.fault,
            Channel::State => self.states.fault,
        }
    }

    /// Returns whether a client is connected to this channel.
    pub fn is_connected(&self, channel: Channel) -> bool {
        match channel {
            Channel::Command => self.commands.connected,
            Channel::State => self.states.connected,
        }
    }

    /// Removes and returns the bytes that are to be sent on this channel.
    pub fn take_output_bytes(&mut self, channel: Channel) -> Vec<u8> {
        if self.troubles.is_unplugged() {
            return Vec::new();
        }
        std::mem::take(&mut self.link(channel).out)
    }

    pub(super) fn link(&mut self, channel: Channel) -> &mut Link {
        match channel {
            Channel::Command => &mut self.commands,
            Channel::State => &mut self.states,
        }
    }

    fn serve_lock_step(&mut self) {
        // Bytes that arrive during a granted period are processed after the end of the period.
        if self.setup.clock == Clock::LockStep && self.read_up_to.is_none() {
            self.serve_requests();
        }
    }

    pub(super) fn closes_with_program(&mut self, channel: Channel) -> bool {
        self.link(channel).environment == Environment::Program
    }

    /// Sends bytes that are not a document on this channel.
    pub(super) fn write_garbage(&mut self, channel: Channel) {
        let link = self.link(channel);
        if link.connected {
            link.out.extend_from_slice(b"<St T=\"<!\"");
        }
    }
}

impl Controller {
    /// At the end of a tick, sends acknowledgements of changes, and the state if it is due.
    pub(super) fn publish_changes(&mut self) {
        let ack = self.make_ack();
        let due =
            self.answers.last_ack.is_none_or(|(told, at_ms)| told != ack || self.now_ms >= at_ms + ACK_INTERVAL_MS);
        if due && self.commands.connected && !self.troubles.is_channel_silenced(Channel::Command) {
            self.answers.last_ack = Some((ack, self.now_ms));
            let numbers = [ack.received, ack.done, ack.free, ack.refusal.0, ack.refusal.1, ack.epoch];
            self.answers.ack.write(&mut self.commands.out, &numbers.map(Value::Int));
        }
        // If a heartbeat has granted this period, the reply to the heartbeat replaces this state message.
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

    /// Sends the state as the reply to this request.
    pub(super) fn send_state(&mut self, request: i32) {
        if !self.states.connected || self.troubles.is_channel_silenced(Channel::State) {
            return;
        }
        self.answers.answered = request;
        self.answers.last_state_ms = self.now_ms;
        // After the maximum 32-bit number, the count continues from 0.
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

    /// Returns the integer values of the state message in the order of [`STATE_TAGS`].
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
