//! The controller as a state machine over virtual time: bytes and milliseconds in, bytes out.
//!
//! Its time is whole ticks of 12 ms. In each the submit interpreter reads at most 8 commands and every request, the
//! robot interpreter plans up to $ADVANCE motions ahead, the arm moves one step, and what has changed is told. In lock
//! step requests are answered as they arrive, and a heartbeat grants 100 ms: only commands up to the one it names are
//! read in that time, so that the result does not depend on when bytes arrive.

use super::answer::Answers;
use super::contact::Contact;
use super::epoch::Epoch;
use super::fault::{EkiFault, FileProblem, MockError};
use super::log::{Executed, Sample, Stop};
use super::memory::Memory;
use super::mover::Mover;
use super::setup::{Clock, Mode, Setup};
use super::wire::{Channel, CommandPlaces, RequestPlaces};
use super::world::World;
use crate::geometry::{Base, Flange, Joints, Rigid};
use std::collections::BTreeMap;

/// One interpolation and submit cycle.
pub(super) const TICK_MS: u64 = 12;

/// What the safety controller and the pendant say.
#[derive(Debug, Clone, Copy)]
pub(super) struct Safety {
    pub(super) mode: Mode,
    pub(super) drives_on: bool,
    pub(super) e_stop: bool,
    pub(super) guard_closed: bool,
    pub(super) start_key: bool,
}

impl Safety {
    /// Whether the arm may move now.
    pub(super) fn motion_possible(&self) -> bool {
        let manual = matches!(self.mode, Mode::T1 | Mode::T2);
        self.drives_on && !self.e_stop && if manual { self.start_key } else { self.guard_closed }
    }
}

/// One channel: what came, what is to go.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) memory: Memory,
    pub(super) out: Vec<u8>,
    pub(super) connected: bool,
    pub(super) fault: Option<EkiFault>,
}

impl Link {
    fn new(memory: Memory) -> Self {
        Link { memory, out: Vec::new(), connected: false, fault: None }
    }
}

/// The mock controller.
pub struct Controller {
    pub(super) setup: Setup,
    pub(super) world: Box<dyn World>,
    pub(super) commands: Link,
    pub(super) states: Link,
    pub(super) command_places: CommandPlaces,
    pub(super) request_places: RequestPlaces,
    pub(super) answers: Answers,
    pub(super) now_ms: u64,
    /// Granted and not yet a whole tick.
    carried_ms: u64,
    pub(super) safety: Safety,
    pub(super) inputs: BTreeMap<u16, bool>,
    pub(super) outputs: BTreeMap<u16, bool>,
    pub(super) epoch: Epoch,
    /// Stopped by the program; only a new epoch goes on.
    pub(super) stopped: bool,
    pub(super) mover: Mover,
    pub(super) contact: Contact,
    pub(super) underruns: i32,
    pub(super) stale: u64,
    pub(super) last_frame_ms: u64,
    /// Epoch and id of the newest command that arrived.
    pub(super) arrived: (i32, i32),
    /// Commands that a heartbeat names may still arrive: none was unreadable and their channel was not lost.
    pub(super) awaits_commands: bool,
    /// In a granted time, the last command to be read.
    pub(super) read_up_to: Option<(i32, i32)>,
    pub(super) executed: Vec<Executed>,
    pub(super) trace: Vec<Sample>,
    pub(super) stops: Vec<Stop>,
}

impl Controller {
    /// A controller at rest, in EXT, drives on, nothing connected, no epoch open.
    ///
    /// # Errors
    /// Where a channel's file lacks what the programs read.
    pub fn new(setup: Setup, world: Box<dyn World>) -> Result<Self, MockError> {
        let (commands, states) = (Memory::new(setup.commands.clone()), Memory::new(setup.states.clone()));
        let of = |channel: &'static str| move |problem: FileProblem| MockError::File { channel, problem };
        Ok(Controller {
            command_places: CommandPlaces::new(&commands).map_err(of("CELLCMD"))?,
            request_places: RequestPlaces::new(&states).map_err(of("CELLSTAT"))?,
            commands: Link::new(commands),
            states: Link::new(states),
            answers: Answers::new(&setup),
            world,
            now_ms: 0,
            carried_ms: 0,
            safety: Safety {
                mode: Mode::Ext,
                drives_on: true,
                e_stop: false,
                guard_closed: true,
                start_key: false,
            },
            inputs: BTreeMap::new(),
            outputs: BTreeMap::new(),
            epoch: Epoch::ended(0),
            stopped: false,
            mover: Mover::new(setup.arm, setup.start),
            contact: Contact::default(),
            underruns: 0,
            stale: 0,
            last_frame_ms: 0,
            arrived: (0, 0),
            awaits_commands: true,
            read_up_to: None,
            executed: Vec::new(),
            trace: Vec::new(),
            stops: Vec::new(),
            setup,
        })
    }

    /// A client connected: the channel is opened afresh.
    pub fn connect(&mut self, channel: Channel) {
        let link = self.link(channel);
        link.memory.clear();
        link.out.clear();
        (link.connected, link.fault) = (true, None);
        if channel == Channel::Command {
            self.answers.forget_ack();
        }
        self.awaits_commands = true;
    }

    /// The client is gone, or the controller closed the channel. What is queued is not executed.
    pub fn disconnect(&mut self, channel: Channel) {
        let link = self.link(channel);
        if !link.connected {
            return;
        }
        link.connected = false;
        link.memory.clear();
        link.out.clear();
        self.awaits_commands &= channel != Channel::Command;
        self.link_lost();
        self.serve_in_lock_step();
    }

    /// Bytes that arrived on the command channel.
    pub fn command_bytes(&mut self, bytes: &[u8]) {
        if self.receive(Channel::Command, bytes) {
            let newest = self.commands.memory.records().next_back().map(|record| self.command_places.order(record));
            match newest {
                Some(Ok(newest)) => self.arrived = self.arrived.max(newest),
                Some(Err(_)) => self.awaits_commands = false,
                None => {}
            }
            self.last_frame_ms = self.now_ms;
            self.serve_in_lock_step();
        }
    }

    /// Bytes that arrived on the state channel.
    pub fn state_bytes(&mut self, bytes: &[u8]) {
        if self.receive(Channel::State, bytes) {
            self.serve_in_lock_step();
        }
    }

    fn receive(&mut self, channel: Channel, bytes: &[u8]) -> bool {
        let link = self.link(channel);
        if !link.connected {
            return false;
        }
        let received = link.memory.receive(bytes);
        if let Err(fault) = received {
            self.close(channel, fault);
        }
        received.is_ok()
    }

    /// The controller closes a channel: see [`Controller::fault`].
    pub(super) fn close(&mut self, channel: Channel, fault: EkiFault) {
        self.disconnect(channel);
        self.link(channel).fault = Some(fault);
    }

    /// Why the controller closed this channel; `None` while it is open or was closed by the client.
    pub fn fault(&self, channel: Channel) -> Option<EkiFault> {
        match channel {
            Channel::Command => self.commands.fault,
            Channel::State => self.states.fault,
        }
    }

    /// Whether a client is connected.
    pub fn is_connected(&self, channel: Channel) -> bool {
        match channel {
            Channel::Command => self.commands.connected,
            Channel::State => self.states.connected,
        }
    }

    /// What is to be sent on this channel, taken away.
    pub fn take_output(&mut self, channel: Channel) -> Vec<u8> {
        std::mem::take(&mut self.link(channel).out)
    }

    fn link(&mut self, channel: Channel) -> &mut Link {
        match channel {
            Channel::Command => &mut self.commands,
            Channel::State => &mut self.states,
        }
    }

    fn serve_in_lock_step(&mut self) {
        // What arrives in a granted time waits for its end.
        if self.setup.clock == Clock::LockStep && self.read_up_to.is_none() {
            self.serve_requests();
        }
    }

    /// Lets time pass: as many ticks as are whole, the rest is kept for the next time.
    pub fn advance_ms(&mut self, granted_ms: u64) {
        self.carried_ms += granted_ms;
        while self.carried_ms >= TICK_MS {
            self.carried_ms -= TICK_MS;
            self.tick();
        }
    }

    fn tick(&mut self) {
        self.now_ms += TICK_MS;
        if self.setup.clock == Clock::Free {
            self.serve_requests();
        }
        self.read_inputs();
        self.read_commands();
        self.watch();
        self.interpret();
        self.step_arm();
        self.tell();
    }

    fn read_inputs(&mut self) {
        for &number in &self.setup.inputs {
            if let Some(value) = self.world.input(number, self.now_ms) {
                self.inputs.insert(number, value);
            }
        }
    }

    pub(super) fn set_output(&mut self, number: u16, value: bool) {
        if self.outputs.insert(number, value).unwrap_or(false) != value {
            self.world.on_output(number, value, self.now_ms);
        }
    }
}

/// What can be seen of it.
impl Controller {
    /// What makes its time pass.
    pub fn clock(&self) -> Clock {
        self.setup.clock
    }

    /// ms since the start.
    pub fn time_ms(&self) -> u64 {
        self.now_ms
    }

    /// Where the axes stand.
    pub fn joints(&self) -> Joints {
        self.mover.joints()
    }

    /// Where the flange is.
    pub fn flange_pose(&self) -> Rigid<Base, Flange> {
        self.mover.base_from_flange()
    }

    /// Whether the arm moves, or has something planned.
    pub fn is_moving(&self) -> bool {
        !self.mover.stands() || self.contact.wants_retract()
    }

    /// Every `$OUT` that was ever set.
    pub fn outputs(&self) -> &BTreeMap<u16, bool> {
        &self.outputs
    }

    /// The present epoch.
    pub fn epoch(&self) -> i32 {
        self.epoch.number
    }

    /// Whether the program has stopped the epoch.
    pub fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// How often the next point was missing.
    pub fn underruns(&self) -> i32 {
        self.underruns
    }

    /// How many commands of ended epochs arrived and were dropped.
    pub fn stale_commands(&self) -> u64 {
        self.stale
    }

    /// Every motion that was executed, in order.
    pub fn executed(&self) -> &[Executed] {
        &self.executed
    }

    /// The tool at each tick of every contact.
    pub fn trace(&self) -> &[Sample] {
        &self.trace
    }

    /// Every stop by the program.
    pub fn stops(&self) -> &[Stop] {
        &self.stops
    }
}
