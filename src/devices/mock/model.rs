//! The controller as a state machine over virtual time: bytes and milliseconds in, bytes out.
//!
//! Its time advances in whole ticks of 12 ms. In each tick the submit interpreter reads at most 8 commands and every
//! request. The robot interpreter plans up to $ADVANCE motions ahead, the arm moves one step, and changes are
//! reported. In lock step requests are answered as they arrive, and a heartbeat grants 100 ms. In that time, only the
//! commands up to the one that the heartbeat names are read, so that the result does not depend on when bytes arrive.

use super::answer::LastAnswers;
use super::channel_link::Link;
use super::codec::Template;
use super::contact::ContactState;
use super::epoch::Epoch;
use super::error::{FileProblem, MockError};
use super::fault::FaultState;
use super::interpreted::RunningPrograms;
use super::log::{ContactSample, ExecutedMotion, ProgramStop};
use super::memory::Memory;
use super::mover::Mover;
use super::options::Clock;
use super::safety::SafetyState;
use super::setup::Setup;
use super::wire::{CommandPositions, RequestPositions, UNCONNECTED_LINE_OUTPUTS};
use super::world::World;
use std::collections::{BTreeMap, BTreeSet};

/// One interpolation and submit cycle.
pub(super) const TICK_MS: u64 = 12;

/// The mock controller.
pub struct Controller {
    pub(super) setup: Setup,
    pub(super) world: Box<dyn World>,
    pub(super) commands: Link,
    pub(super) states: Link,
    pub(super) command_places: CommandPositions,
    pub(super) request_places: RequestPositions,
    pub(super) answers: LastAnswers,
    pub(super) now_ms: u64,
    /// Granted time that is left over because it is less than a tick, ms.
    carried_ms: u64,
    pub(super) safety: SafetyState,
    pub(super) inputs: BTreeMap<u16, bool>,
    pub(super) outputs: BTreeMap<u16, bool>,
    /// Every $FLAG that was ever set.
    pub(super) flags: BTreeMap<u16, bool>,
    pub(super) troubles: FaultState,
    /// The time at which the controller was last started.
    pub(super) started_ms: u64,
    pub(super) epoch: Epoch,
    /// Stopped by the program; only a new epoch continues.
    pub(super) stopped: bool,
    /// The time at which the last epoch ended; the next field has the outputs that are still to be switched off after
    /// the epoch.
    pub(super) ended_ms: u64,
    pub(super) pending_off_outputs: BTreeSet<u16>,
    pub(super) mover: Mover,
    pub(super) contact: ContactState,
    pub(super) underruns: i32,
    pub(super) stale_messages: u64,
    /// The time of the last frame from the client; the next field has the time of its last request.
    pub(super) last_frame_ms: u64,
    pub(super) last_request_ms: u64,
    /// The time at which the submit interpreter last ran.
    pub(super) submit_ran_ms: u64,
    /// Epoch and id of the newest command that arrived.
    pub(super) arrived: (i32, i32),
    /// Whether commands that a heartbeat names may still arrive, because all were readable and their channel was not
    /// lost.
    pub(super) awaits_commands: bool,
    /// The last command that is read in a granted time.
    pub(super) read_up_to: Option<(i32, i32)>,
    pub(super) executed: Vec<ExecutedMotion>,
    pub(super) trace: Vec<ContactSample>,
    pub(super) stops: Vec<ProgramStop>,
    /// The programs that are executed in place of the model.
    pub(super) running: Option<Box<RunningPrograms>>,
    /// The templates of the documents that each channel sends, built once.
    pub(super) templates: [Option<Template>; 2],
}

impl Controller {
    /// Returns a controller at rest, in EXT, drives on, no client connected, no epoch open.
    ///
    /// # Errors
    /// If a channel's file lacks values that the programs read.
    pub fn new(setup: Setup, world: Box<dyn World>) -> Result<Self, MockError> {
        let (commands, states) = (Memory::new(setup.commands.clone()), Memory::new(setup.states.clone()));
        let file_error = |channel: &'static str| move |problem: FileProblem| MockError::File { channel, problem };
        let mut controller = Controller {
            command_places: CommandPositions::new(&commands).map_err(file_error("CELLCMD"))?,
            request_places: RequestPositions::new(&states).map_err(file_error("CELLSTAT"))?,
            commands: Link::new(commands, &setup.commands),
            states: Link::new(states, &setup.states),
            answers: LastAnswers::new(&setup),
            world,
            now_ms: 0,
            carried_ms: 0,
            safety: SafetyState::initial(),
            flags: BTreeMap::new(),
            inputs: BTreeMap::new(),
            outputs: BTreeMap::new(),
            troubles: FaultState::new(setup.faults.planned.clone()),
            started_ms: 0,
            epoch: Epoch::closed(0),
            stopped: false,
            ended_ms: 0,
            pending_off_outputs: BTreeSet::new(),
            mover: Mover::new(setup.arm, setup.start),
            contact: ContactState::default(),
            underruns: 0,
            stale_messages: 0,
            last_frame_ms: 0,
            last_request_ms: 0,
            submit_ran_ms: 0,
            arrived: (0, 0),
            awaits_commands: true,
            read_up_to: None,
            executed: Vec::new(),
            trace: Vec::new(),
            stops: Vec::new(),
            running: setup.programs.clone().map(|programs| Box::new(RunningPrograms::new(programs, &setup))),
            templates: [None, None],
            setup,
        };
        // In lock step, nothing else lets the time pass that the programs need to start.
        if controller.setup.clock == Clock::LockStep {
            controller.boot();
        }
        Ok(controller)
    }

    /// Lets time pass in whole ticks; the remaining time is kept for the next call.
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
        if self.running.is_some() {
            return self.tick_interpreted();
        }
        let submit_runs = !self.troubles.is_submit_stalled();
        if submit_runs {
            self.submit_ran_ms = self.now_ms;
            self.check_program_running();
            if !self.states.connected {
                self.set_line_outputs(UNCONNECTED_LINE_OUTPUTS);
            }
            if self.setup.clock == Clock::Free {
                self.serve_requests();
            }
            self.process_input();
            self.read_commands();
            self.check_watchdog();
            self.switch_off_due_outputs();
        } else {
            self.miss_submit();
        }
        self.interpret();
        self.step_arm();
        if submit_runs {
            self.publish_changes();
        }
    }

    pub(super) fn process_input(&mut self) {
        for &number in &self.setup.inputs {
            if let Some(value) = self.world.input(number, self.now_ms) {
                self.inputs.insert(number, value);
            }
        }
    }

    /// Starts the controller: sequence numbers, epochs, flags and motions are reset; the boot number changes.
    pub(super) fn reset_controller(&mut self) {
        self.mover.stop_immediately();
        self.contact = ContactState::default();
        self.epoch = Epoch::closed(0);
        (self.stopped, self.underruns, self.stale_messages) = (false, 0, 0);
        (self.arrived, self.read_up_to) = ((0, 0), None);
        (self.started_ms, self.submit_ran_ms) = (self.now_ms, self.now_ms);
        self.setup.boot = self.setup.boot.wrapping_add(1);
        self.answers = LastAnswers::new(&self.setup);
        self.flags.clear();
        let on: Vec<u16> = self.outputs.iter().filter(|(_, on)| **on).map(|(number, _)| *number).collect();
        on.iter().for_each(|&number| self.set_output(number, false));
    }
}
