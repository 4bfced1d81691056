//! The controller as a state machine over virtual time: bytes and milliseconds in, bytes out.
//!
//! Its time is whole ticks of 12 ms. In each the submit interpreter reads at most 8 commands and every request, the
//! robot interpreter plans up to $ADVANCE motions ahead, the arm moves one step, and what has changed is told. In lock
//! step requests are answered as they arrive, and a heartbeat grants 100 ms: only commands up to the one it names are
//! read in that time, so that the result does not depend on when bytes arrive.

use super::answer::Answers;
use super::channel_file::{ChannelFile, Environment};
use super::contact::Contact;
use super::epoch::Epoch;
use super::error::{EkiFault, FileProblem, MockError};
use super::fault::Troubles;
use super::log::{Executed, Sample, Stop};
use super::memory::{Memory, Raised};
use super::mover::Mover;
use super::setup::{Clock, Mode, Setup};
use super::submit::REOPEN_MS;
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
    /// The robot program is selected and runs.
    pub(super) selected: bool,
}

impl Safety {
    /// Whether the arm may move now.
    pub(super) fn motion_possible(&self) -> bool {
        let manual = matches!(self.mode, Mode::T1 | Mode::T2);
        self.selected && self.drives_on && !self.e_stop && if manual { self.start_key } else { self.guard_closed }
    }
}

/// One channel: what came, what is to go.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) memory: Memory,
    pub(super) out: Vec<u8>,
    pub(super) connected: bool,
    pub(super) fault: Option<EkiFault>,
    /// The program opens the channel again at this time.
    pub(super) listens_at_ms: u64,
    pub(super) environment: Environment,
    /// $FLAG and $OUT that are true while connected.
    alive: (Option<u16>, Option<u16>),
    /// Flags and outputs that its elements set.
    raises: Vec<Raised>,
}

impl Link {
    fn new(memory: Memory, file: &ChannelFile) -> Self {
        let flags = file.received.iter().filter_map(|element| element.set_flag.map(Raised::Flag));
        let outputs = file.received.iter().filter_map(|element| element.set_out.map(Raised::Output));
        Link {
            memory,
            out: Vec::new(),
            connected: false,
            fault: None,
            listens_at_ms: 0,
            environment: file.environment,
            alive: file.alive,
            raises: flags.chain(outputs).collect(),
        }
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
    /// Every $FLAG that was ever set.
    pub(super) flags: BTreeMap<u16, bool>,
    pub(super) troubles: Troubles,
    /// When the controller was last started.
    pub(super) started_ms: u64,
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
            commands: Link::new(commands, &setup.commands),
            states: Link::new(states, &setup.states),
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
                selected: true,
            },
            flags: BTreeMap::new(),
            inputs: BTreeMap::new(),
            outputs: BTreeMap::new(),
            troubles: Troubles::new(setup.faults.planned.clone()),
            started_ms: 0,
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

    /// A client wants to connect: the channel is opened afresh. False where it has a client already, or does not listen.
    pub fn connect(&mut self, channel: Channel) -> bool {
        let (now_ms, unplugged) = (self.now_ms, self.troubles.unplugged());
        let link = self.link(channel);
        if link.connected || unplugged || now_ms < link.listens_at_ms {
            return false;
        }
        link.memory.clear();
        link.out.clear();
        (link.connected, link.fault) = (true, None);
        if channel == Channel::Command {
            self.answers.forget_ack();
        }
        self.last_frame_ms = now_ms;
        self.awaits_commands = true;
        self.show_alive(channel);
        true
    }

    /// The client is gone, or the controller closed the channel. What is queued is not executed; the program clears and
    /// opens the channel again.
    pub fn disconnect(&mut self, channel: Channel) {
        if self.troubles.unplugged() {
            self.troubles.hung_up[channel as usize] = true;
            return;
        }
        self.drop_client(channel, EkiFault::Disrupted);
    }

    /// The program closes the channel, whatever the cable does.
    pub(super) fn drop_client(&mut self, channel: Channel, fault: EkiFault) {
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
        self.serve_in_lock_step();
    }

    /// Bytes that arrived on the command channel.
    pub fn command_bytes(&mut self, bytes: &[u8]) {
        let Some(documents) = self.receive(Channel::Command, bytes) else { return };
        if documents > 0 {
            match self.command_places.newest_order(&self.commands.memory) {
                Some(newest) => self.arrived = self.arrived.max(newest),
                None => self.awaits_commands = false,
            }
            self.last_frame_ms = self.now_ms;
            self.count_arrived(u64::from(documents));
            self.serve_in_lock_step();
        }
    }

    /// Bytes that arrived on the state channel.
    pub fn state_bytes(&mut self, bytes: &[u8]) {
        if self.receive(Channel::State, bytes).is_some_and(|documents| documents > 0) {
            self.serve_in_lock_step();
        }
    }

    /// How many documents these bytes completed; `None` where the channel is or was closed.
    fn receive(&mut self, channel: Channel, bytes: &[u8]) -> Option<u32> {
        if self.troubles.unplugged() {
            self.troubles.behind_cable[channel as usize].extend_from_slice(bytes);
            return None;
        }
        let link = self.link(channel);
        if !link.connected {
            return None;
        }
        let received = link.memory.receive(bytes);
        let raised = link.memory.take_raised();
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

    /// Before the program drains a channel's memories, so that no edge is lost.
    pub(super) fn reset_flags(&mut self, channel: Channel) {
        for index in 0..self.link(channel).raises.len() {
            let raised = self.link(channel).raises[index];
            self.raise(raised, false);
        }
    }

    fn show_alive(&mut self, channel: Channel) {
        let Link { connected, alive: (flag, output), .. } = *self.link(channel);
        flag.map(Raised::Flag).into_iter().for_each(|flag| self.raise(flag, connected));
        output.map(Raised::Output).into_iter().for_each(|output| self.raise(output, connected));
    }

    /// The controller closes a channel: see [`Controller::fault`].
    pub(super) fn close(&mut self, channel: Channel, fault: EkiFault) {
        self.drop_client(channel, fault);
    }

    /// Why this channel was last closed; `None` while it is open, or never was.
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
        if self.troubles.unplugged() {
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
        self.pass_faults();
        let submit_runs = !self.troubles.stalled();
        if submit_runs {
            if self.setup.clock == Clock::Free {
                self.serve_requests();
            }
            self.read_inputs();
            self.read_commands();
            self.watch();
        }
        self.interpret();
        self.step_arm();
        if submit_runs {
            self.tell();
        }
    }

    fn read_inputs(&mut self) {
        for &number in &self.setup.inputs {
            if let Some(value) = self.world.input(number, self.now_ms) {
                self.inputs.insert(number, value);
            }
        }
    }

    pub(super) fn lives_with_program(&mut self, channel: Channel) -> bool {
        self.link(channel).environment == Environment::Program
    }

    /// Bytes that are no document, on this channel.
    pub(super) fn write_garbage(&mut self, channel: Channel) {
        let link = self.link(channel);
        if link.connected {
            link.out.extend_from_slice(b"<St T=\"<!\"");
        }
    }

    /// A start: counts, epochs, flags and what was in motion are gone; the boot number is another.
    pub(super) fn forget_all(&mut self) {
        self.mover.freeze();
        self.contact = Contact::default();
        self.epoch = Epoch::ended(0);
        (self.stopped, self.underruns, self.stale) = (false, 0, 0);
        (self.arrived, self.read_up_to, self.started_ms) = ((0, 0), None, self.now_ms);
        self.setup.boot = self.setup.boot.wrapping_add(1);
        self.answers = Answers::new(&self.setup);
        self.flags.clear();
        let on: Vec<u16> = self.outputs.iter().filter(|(_, on)| **on).map(|(number, _)| *number).collect();
        on.iter().for_each(|&number| self.set_output(number, false));
    }

    pub(super) fn set_output(&mut self, number: u16, value: bool) {
        if self.outputs.insert(number, value).unwrap_or(false) != value {
            self.world.on_output(number, value, self.now_ms);
        }
    }
}

/// What can be seen of it.
impl Controller {
    /// How late bytes arrive, whether they come in pieces, and the seed of both.
    pub(super) fn wire_faults(&self) -> (Option<(u64, u64)>, bool, u64) {
        let faults = &self.setup.faults;
        (faults.delay_ms, faults.fragment, faults.seed)
    }

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

    /// Whether mode, keys, drives, guard and program let the arm move.
    pub fn can_move(&self) -> bool {
        self.safety.motion_possible()
    }

    /// Every `$FLAG` that was ever set.
    pub fn flags(&self) -> &BTreeMap<u16, bool> {
        &self.flags
    }

    /// The last command received in the present epoch, and the last executed.
    pub fn counts(&self) -> (i32, i32) {
        (self.epoch.received, self.epoch.done)
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
