//! Lock step: the client's requests let time pass, and no data reach a program before their time.
//!
//! Received documents wait here, outside of the channels' memories. Requests are passed on in order, and each gets the
//! cycles that its answer needs. A heartbeat first lets 100 ms pass, as soon as every command up to the one that it
//! names has arrived, and only these commands are passed on. So the result does not depend on when bytes arrive: a
//! client receives the results of a grant before it sends anything more, and the answer last.

use super::super::framer::Framer;
use super::super::model::{Controller, TICK_MS};
use super::super::options::Clock;
use super::super::wire::{self, Channel};
use super::held::Document;

/// Time that a heartbeat grants.
const HEARTBEAT_GRANT_MS: u64 = 100;
/// Time from the controller's start until its programs run, ms.
const BOOT_MS: u64 = 600;
/// Time limit for an answer, or for a channel that must be opened, ms.
const RESPONSE_TIMEOUT_MS: u64 = 10_000;

impl Controller {
    /// Returns whether arriving bytes are held back.
    pub(in super::super) fn is_holding_back(&self) -> bool {
        self.setup.clock == Clock::LockStep
            && self.running.as_ref().is_some_and(|running| !running.held_documents.is_serving)
    }

    /// Lets the time pass that the programs need to start, so that a client that connects finds them running. No
    /// effect for the hand-written model.
    pub fn boot(&mut self) {
        if self.running.is_some() {
            self.advance_ms(BOOT_MS);
        }
    }

    /// Holds back bytes that have arrived until they are due.
    pub(in super::super) fn hold(&mut self, channel: Channel, bytes: &[u8]) {
        let file = match channel {
            Channel::Command => &self.setup.commands,
            Channel::State => &self.setup.states,
        };
        let Some(running) = &mut self.running else { return };
        let mut read = Vec::new();
        let held = &mut running.held_documents;
        held.framers[channel as usize].push(bytes);
        let broken = loop {
            match held.framers[channel as usize].next() {
                Ok(Some(bytes)) => read.push(Document::new(bytes, &file.received)),
                Ok(None) => break None,
                Err(fault) => break Some(fault),
            }
        };
        let arrived = read.len() as u64;
        if channel == Channel::Command {
            let newest = read.iter().filter_map(|command| command.epoch.zip(command.id)).max();
            held.arrived = held.arrived.max(newest.unwrap_or_default());
        }
        held.queue_mut(channel).extend(read);
        if channel == Channel::Command && arrived > 0 {
            self.count_arrived(arrived);
        }
        match broken {
            Some(fault) => self.close(channel, fault),
            None => self.process_held(),
        }
    }

    /// Forgets all documents of a client that is gone.
    pub(super) fn clear_held(&mut self, channel: Channel) {
        let limit_bytes = match channel {
            Channel::Command => self.setup.commands.limit_bytes,
            Channel::State => self.setup.states.limit_bytes,
        };
        let Some(running) = &mut self.running else { return };
        running.held_documents.framers[channel as usize] = Framer::new(limit_bytes);
        running.held_documents.queue_mut(channel).clear();
        running.held_documents.awaits_commands &= channel != Channel::Command;
    }

    /// Gives the programs the time to open their channel, because a client wants to connect.
    pub(super) fn wait_for_channel_open(&mut self, channel: Channel) {
        if !self.is_holding_back() || self.is_connected(channel) {
            return;
        }
        self.clear_held(channel);
        let listens = |controller: &Controller| {
            controller.running.as_ref().is_some_and(|running| running.values.channels[channel as usize].listens)
        };
        if !listens(self) {
            self.run_until(listens);
        }
        if let Some(running) = &mut self.running {
            running.held_documents.awaits_commands = true;
        }
    }

    /// Lets ticks pass until this condition is satisfied, at least one tick.
    fn run_until(&mut self, holds: impl Fn(&Controller) -> bool) {
        for _ in 0..RESPONSE_TIMEOUT_MS / TICK_MS {
            self.advance_ms(TICK_MS);
            if holds(self) {
                return;
            }
        }
    }

    fn process_held(&mut self) {
        loop {
            let epoch = self.epoch();
            let Some(held) = self.running.as_mut().map(|running| &mut running.held_documents) else { return };
            let Some(next) = held.requests.front() else { return };
            let is_delivered = held.is_delivered(next, epoch);
            let is_heartbeat = next.operation == Some(wire::HEARTBEAT);
            // A heartbeat whose commands have not arrived waits only if no document follows it: a later document, such
            // as an abort, must not wait for the heartbeat.
            if held.is_serving || (is_heartbeat && !is_delivered && held.requests.len() == 1) {
                return;
            }
            let Some(request) = held.requests.pop_front() else { return };
            held.is_serving = true;
            if is_heartbeat && is_delivered {
                let commands = held.take_up_to(&request);
                commands.iter().for_each(|command| self.command_bytes(&command.bytes));
                self.advance_ms(HEARTBEAT_GRANT_MS - TICK_MS);
            }
            self.state_bytes(&request.bytes);
            self.run_until(|controller| {
                let answered = controller.shared("CELL_RE");
                !controller.is_connected(Channel::State)
                    || answered == request.id.map(panelprep_kuka::krl::Cell::Int)
            });
            if let Some(running) = &mut self.running {
                running.held_documents.is_serving = false;
            }
        }
    }
}
