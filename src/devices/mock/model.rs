//! The controller as a state machine in virtual time: its inputs are bytes and milliseconds, its outputs are bytes.
//!
//! Time advances in ticks of 12 ms. In each tick the submit interpreter reads at most 8 commands and all requests. The
//! robot interpreter plans up to $ADVANCE motions ahead, the arm moves one step, and changes are reported. In lock step
//! requests are answered when they arrive, and a heartbeat grants 100 ms. In this period only the commands up to the
//! one that the heartbeat names are read, so that the result does not depend on when bytes arrive.
//!
//! The state of an epoch consists of the ring buffer of commands, base and tool, and the speeds. It is discarded at the
//! end of the epoch.
//!
//! From the commands the programs derive whether the sanding tool is on the panel: it is in contact from the start of
//! the motion to the first contact point until a point without contact is reached. So approach and departure belong to
//! the contact, and so does the retract from the panel.

use super::channel_file::{FileProblem, MockError};
use super::codec::Template;
use super::fault::FaultState;
use super::interpreted::RunningPrograms;
use super::log::{ContactSample, ExecutedMotion, ProgramStop};
use super::memory::{Link, Memory};
use super::mover::Mover;
use super::moves::{Lin, Move, Pose};
use super::options::{Clock, SafetyState};
use super::setup::{Setup, World};
use super::wire::{Command, CommandPositions, LastAnswers, Refusal, RequestPositions, UNCONNECTED_LINE_OUTPUTS};
use panelprep_base::geometry::{Flange, KukaPose, Rigid, Tool, Vector};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Period of one interpolation cycle and one submit cycle, ms.
pub(super) const TICK_MS: u64 = 12;

/// Number of entries in the ring buffer of commands.
pub(super) const RING_ENTRIES: usize = 100;

/// Distance of a retract along the tool's −Z axis, mm.
const RETRACT_MM: f64 = 50.0;
const RETRACT_MM_S: f64 = 200.0;
const RETRACT_MM_S2: f64 = 2000.0;

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
    /// The rest of the granted time that is less than a tick, ms.
    carried_ms: u64,
    pub(super) safety: SafetyState,
    pub(super) inputs: BTreeMap<u16, bool>,
    pub(super) outputs: BTreeMap<u16, bool>,
    /// The value of every $FLAG that was ever set.
    pub(super) flags: BTreeMap<u16, bool>,
    pub(super) troubles: FaultState,
    /// The time at which the controller was last started.
    pub(super) started_ms: u64,
    pub(super) epoch: Epoch,
    /// Whether the program has stopped the epoch; only a new epoch continues.
    pub(super) stopped: bool,
    /// The time at which the last epoch ended, and the outputs that are to be switched off after it.
    pub(super) ended_ms: u64,
    pub(super) pending_off_outputs: BTreeSet<u16>,
    pub(super) mover: Mover,
    pub(super) contact: ContactState,
    pub(super) underruns: i32,
    pub(super) stale_messages: u64,
    /// The times of the client's last message and of its last request.
    pub(super) last_frame_ms: u64,
    pub(super) last_request_ms: u64,
    /// The time at which the submit interpreter last ran.
    pub(super) submit_ran_ms: u64,
    /// The epoch and the id of the last command that arrived.
    pub(super) arrived: (i32, i32),
    /// Whether commands that a heartbeat names may still arrive; false if a command was not readable or the channel was
    /// lost.
    pub(super) awaits_commands: bool,
    /// The last command that may be read in the granted period.
    pub(super) read_up_to: Option<(i32, i32)>,
    pub(super) executed: Vec<ExecutedMotion>,
    pub(super) trace: Vec<ContactSample>,
    pub(super) stops: Vec<ProgramStop>,
    /// The executed programs, if they replace the hand-written model.
    pub(super) running: Option<Box<RunningPrograms>>,
    /// The templates of the documents that each channel sends, built once.
    pub(super) templates: [Option<Template>; 2],
}

impl Controller {
    /// Creates a controller at rest: mode EXT, drives on, no client connected, no epoch open.
    ///
    /// # Errors
    /// If a channel's file does not define a value that the programs read.
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
        // In lock step the time that the programs need to start must be advanced here.
        if controller.setup.clock == Clock::LockStep {
            controller.boot();
        }
        Ok(controller)
    }

    /// Advances the time in whole ticks; the rest is kept for the next call.
    pub fn advance_ms(&mut self, granted_ms: u64) {
        self.carried_ms += granted_ms;
        while self.carried_ms >= TICK_MS {
            self.carried_ms -= TICK_MS;
            self.tick();
        }
    }

    fn tick(&mut self) {
        self.now_ms += TICK_MS;
        self.update_faults();
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
            self.stop_without_submit();
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

    /// Restarts the controller: sequence numbers, epochs, flags and motions are reset, and the boot id changes.
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

#[derive(Debug, Clone)]
pub(super) struct Epoch {
    pub(super) number: i32,
    /// Whether commands are accepted; false once the epoch has ended.
    pub(super) open: bool,
    pub(super) last_received: i32,
    pub(super) last_executed: i32,
    /// The first refusal in the epoch, and the id of the refused command.
    pub(super) refusal: Option<(Refusal, i32)>,
    /// The commands that were received and are not planned yet.
    pub(super) ring: VecDeque<Command>,
    pub(super) base: Option<KukaPose>,
    pub(super) tool: Option<ActiveTool>,
    pub(super) speed_mm_s: f64,
    pub(super) acceleration_mm_s2: f64,
    /// Acceleration as a fraction of each axis's maximum acceleration, 0 to 1.
    pub(super) axis_acceleration_share: f64,
    /// The time at which the subroutine at the front of the ring buffer ends.
    pub(super) subroutine_until_ms: Option<u64>,
}

/// $TOOL.
#[derive(Debug, Clone, Copy)]
pub(super) struct ActiveTool {
    pub(super) pose: KukaPose,
    pub(super) sanding: bool,
}

impl ActiveTool {
    pub(super) fn flange_from_tool(&self) -> Rigid<Flange, Tool> {
        self.pose.to_rigid()
    }
}

impl Epoch {
    /// Creates a closed epoch, which accepts no commands.
    pub(super) fn closed(number: i32) -> Self {
        Epoch {
            number,
            open: false,
            last_received: 0,
            last_executed: 0,
            refusal: None,
            ring: VecDeque::new(),
            base: None,
            tool: None,
            speed_mm_s: 100.0,
            acceleration_mm_s2: 1000.0,
            axis_acceleration_share: 0.5,
            subroutine_until_ms: None,
        }
    }

    /// Creates a new epoch, without base and tool.
    pub(super) fn new_open(number: i32) -> Self {
        Epoch { open: true, ..Epoch::closed(number) }
    }

    pub(super) fn free_entries(&self) -> usize {
        RING_ENTRIES.saturating_sub(self.ring.len())
    }
}

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ContactState {
    /// Whether the last point that was reached is in contact.
    was_last_point_in_contact: bool,
    /// The tool that is in contact.
    tool: Option<Rigid<Flange, Tool>>,
    retract: RetractState,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum RetractState {
    #[default]
    No,
    /// The retract begins as soon as the arm has stopped.
    Due,
    Runs,
}

impl ContactState {
    /// Returns whether the tool is in contact, or moves to a contact point.
    pub(super) fn touches(&self, front: Option<&Move>) -> bool {
        self.was_last_point_in_contact || front.is_some_and(Move::contact)
    }

    /// Returns whether both ends of the current motion are in contact.
    pub(super) fn is_in_contact(&self, front: Option<&Move>) -> bool {
        self.was_last_point_in_contact && front.is_none_or(Move::contact)
    }

    /// Returns the tool that is in contact.
    pub(super) fn tool(&self) -> Option<Rigid<Flange, Tool>> {
        self.tool
    }

    /// Records that the execution of this motion has begun.
    pub(super) fn on_move_started(&mut self, front: Option<&Move>) {
        if let Some(Move::Lin(lin)) = front
            && lin.contact
        {
            self.tool = Some(lin.flange_from_tool);
        }
    }

    /// Records that the end of this motion was reached or passed.
    pub(super) fn on_point_reached(&mut self, step: &Move) {
        self.was_last_point_in_contact = step.contact();
        if step.key().is_none() {
            self.retract = RetractState::No;
        }
    }

    /// Records a stop. If the tool is in contact and `may_retract` is true, the tool retracts from the panel as soon as
    /// the arm has stopped.
    pub(super) fn stop(&mut self, front: Option<&Move>, may_retract: bool) {
        self.was_last_point_in_contact = self.touches(front);
        self.retract =
            if may_retract && self.was_last_point_in_contact { RetractState::Due } else { RetractState::No };
    }

    /// Resets the contact for a new epoch. If an emergency stop left the tool on the panel, a person must jog it away
    /// before. A retract in progress continues.
    pub(super) fn forget(&mut self) {
        if !self.is_retract_due() {
            *self = ContactState::default();
        }
    }

    /// Abandons the retract because it cannot be executed.
    pub(super) fn abandon_retract(&mut self) {
        self.retract = RetractState::No;
    }

    pub(super) fn is_retract_due(&self) -> bool {
        self.retract != RetractState::No
    }

    pub(super) fn is_retracting(&self) -> bool {
        self.retract == RetractState::Runs
    }

    /// Returns the motion of the retract that is due, from the current pose of the tool.
    pub(super) fn take_retract(&mut self, tool_at: impl Fn(&Rigid<Flange, Tool>) -> Pose) -> Option<Move> {
        if self.retract != RetractState::Due {
            return None;
        }
        let Some(flange_from_tool) = self.tool else {
            self.retract = RetractState::No;
            return None;
        };
        self.retract = RetractState::Runs;
        let from = tool_at(&flange_from_tool);
        let away = from * Vector::<Tool>::new(nalgebra::Vector3::z() * -RETRACT_MM);
        Some(Move::Lin(Lin {
            key: None,
            target: from.followed_by_displacement(away),
            flange_from_tool,
            blend_mm: 0.0,
            contact: false,
            switched_output: None,
            remaining_points: 0,
            speed_mm_s: RETRACT_MM_S,
            acceleration_mm_s2: RETRACT_MM_S2,
        }))
    }
}
