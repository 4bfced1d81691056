//! One tick of both interpreters: which one runs, for how many statements, and when interrupts and triggers occur. Also
//! lock step, in which the client's requests advance the time, and data reach a program at a defined time.
//!
//! In lock step received documents are held back outside of the channels' buffers. Requests are passed on in order, and
//! each request is given the cycles that its reply needs. A heartbeat first waits until every command has arrived that
//! it names; then 100 ms pass, in which only these commands are passed on. So the result does not depend on when bytes
//! arrive. A client receives the results of the granted period, and last the reply, before it sends anything more.

use super::super::framer::Framer;
use super::super::log::ExecutedMotion;
use super::super::model::{Controller, TICK_MS};
use super::super::mover::CompletedMove;
use super::super::options::Clock;
use super::super::wire::{self, Channel};
use super::running::{Document, RobotState, RunningPrograms, SchedulerBias};
use super::variables::InterpreterHost;
use panelprep_kuka::krl::StepPause;
use rand::RngExt;

/// Number of statements per tick: enough for a cycle of the submit interpreter, and for one iteration of the robot
/// program's loop.
const SUBMIT_STATEMENTS: u32 = 2_000;
/// Number of statements per tick if the submit interpreter starts each cycle immediately after the last one.
const BUSY_SUBMIT_STATEMENTS: u32 = 600;
const ROBOT_STATEMENTS: u32 = 60;

const IDLE_SHARE: StatementShare = StatementShare { remaining_steps: 0, done: true };

/// The period that a heartbeat grants, ms.
const HEARTBEAT_GRANT_MS: u64 = 100;
/// Time from the controller's start until its programs run, ms.
const BOOT_DURATION_MS: u64 = 600;
/// Maximum time until a reply, or until a channel is opened, ms.
const RESPONSE_TIMEOUT_MS: u64 = 10_000;

/// The number of statements that an interpreter may execute in one tick.
#[derive(Debug, Clone, Copy)]
struct StatementShare {
    remaining_steps: u32,
    done: bool,
}

fn submit_share(runs: bool, statements: u32) -> StatementShare {
    StatementShare { remaining_steps: statements, done: !runs }
}

impl Controller {
    /// Executes one tick of the programs and of the arm.
    pub(in super::super) fn tick_interpreted(&mut self) {
        self.with_running(|controller, running| running.tick(controller));
        if self.running.as_ref().is_some_and(|running| running.plc_starts(self.now_ms)) {
            self.start_interpreted();
        }
    }
}

impl RunningPrograms {
    fn tick(&mut self, controller: &mut Controller) {
        self.pass_states(controller);
        self.update_bias(controller.now_ms);
        controller.process_input();
        let [mut submit, mut robot] = self.statement_shares(controller);
        while !(submit.done && robot.done) {
            let submit_next = if submit.done || robot.done { robot.done } else { self.random.random_bool(0.5) };
            let burst = self.random_burst();
            for _ in 0..burst {
                let turn = if submit_next { &mut submit } else { &mut robot };
                if turn.done {
                    break;
                }
                turn.remaining_steps -= 1;
                turn.done = turn.remaining_steps == 0;
                if submit_next {
                    submit.done |= self.step_submit(controller);
                    self.note_stop(controller);
                    // The submit interpreter may have set a flag for which the robot interpreter is waiting.
                    robot.done &= robot.remaining_steps == 0 || !self.wake_interpreter(controller);
                } else {
                    robot.done |= self.step_robot(controller);
                    self.note_stop(controller);
                }
            }
        }
        self.step_arm(controller);
    }

    fn update_bias(&mut self, now_ms: u64) {
        if !self.programs.is_adverse_scheduling || now_ms < self.bias_until_ms {
            return;
        }
        self.bias_until_ms = now_ms + self.random.random_range(30..1_500);
        self.scheduler_bias = match self.random.random_range(0..8) {
            0 => SchedulerBias::StarvesSubmit,
            1 => SchedulerBias::StarvesRobot,
            _ => SchedulerBias::Fair,
        };
    }

    fn statement_shares(&mut self, controller: &Controller) -> [StatementShare; 2] {
        let submit_runs = controller.now_ms >= self.boots_at_ms && !controller.troubles.is_submit_stalled();
        let submit = match self.scheduler_bias {
            SchedulerBias::StarvesSubmit => self.random.random_range(40..200),
            _ if self.programs.busy_submit => BUSY_SUBMIT_STATEMENTS,
            _ => SUBMIT_STATEMENTS,
        };
        let robot = match self.scheduler_bias {
            SchedulerBias::StarvesRobot if self.random.random_bool(0.5) => {
                return [submit_share(submit_runs, submit), IDLE_SHARE];
            }
            SchedulerBias::StarvesRobot => self.random.random_range(10..ROBOT_STATEMENTS),
            _ => ROBOT_STATEMENTS,
        };
        let robot_runs = self.values.state == RobotState::Active && !self.robot.is_idle();
        [submit_share(submit_runs, submit), StatementShare { remaining_steps: robot, done: !robot_runs }]
    }

    fn random_burst(&mut self) -> u32 {
        if !self.programs.is_adverse_scheduling {
            return u32::MAX;
        }
        match self.random.random_range(0..8) {
            0..4 => 1,
            4 => 2,
            5 => self.random.random_range(3..9),
            6 => self.random.random_range(9..40),
            _ => 400,
        }
    }

    fn wake_interpreter(&mut self, controller: &mut Controller) -> bool {
        self.values.state == RobotState::Active && self.values.changed && self.check_interrupts(controller)
    }

    /// Evaluates the conditions of the interrupts. Returns true if an interrupt program begins.
    fn check_interrupts(&mut self, controller: &mut Controller) -> bool {
        if std::mem::take(&mut self.values.changed) {
            let RunningPrograms { robot, memory, values, sequences, next_sequence, programs, .. } = self;
            let meaning = programs.meaning;
            let mut around = InterpreterHost { controller, values, sequences, next_sequence, meaning };
            if let Err(message) = robot.evaluate_conditions(&programs.program, memory, &mut around) {
                self.faults.push(message);
                return false;
            }
        }
        self.robot.run_pending_interrupt()
    }

    /// Executes one statement of the submit interpreter. Returns true if its cycle has ended.
    fn step_submit(&mut self, controller: &mut Controller) -> bool {
        if self.submit.is_idle() {
            let name = if self.initialised { "CELL_CYCLE" } else { "CELL_INIT" };
            let Some(routine) = self.programs.program.routine(name) else { return true };
            self.submit.start_routine(&self.programs.program, routine);
        }
        let RunningPrograms { submit, memory, values, sequences, next_sequence, programs, .. } = self;
        let meaning = programs.meaning;
        let mut around = InterpreterHost { controller, values, sequences, next_sequence, meaning };
        match submit.step(&programs.program, memory, &mut around) {
            StepPause::Statement => false,
            StepPause::Waits => true,
            StepPause::Ended => {
                self.initialised = true;
                self.submit.clear();
                !self.programs.busy_submit
            }
            StepPause::Fault(message) => {
                self.faults.push(format!("submit interpreter: {message}"));
                self.submit.clear();
                // The submit interpreter remains stopped until the controller is restarted.
                self.boots_at_ms = u64::MAX;
                true
            }
        }
    }

    /// Executes one statement of the robot interpreter. Returns true if the interpreter waits.
    fn step_robot(&mut self, controller: &mut Controller) -> bool {
        self.check_interrupts(controller);
        self.fire_due_triggers(controller.now_ms);
        let RunningPrograms { robot, memory, values, sequences, next_sequence, programs, .. } = self;
        let meaning = programs.meaning;
        let mut around = InterpreterHost { controller, values, sequences, next_sequence, meaning };
        match robot.step(&programs.program, memory, &mut around) {
            StepPause::Statement => false,
            StepPause::Waits => true,
            StepPause::Ended => {
                self.values.state = RobotState::Ended;
                true
            }
            StepPause::Fault(message) => {
                if self.values.abandon_reason.take().is_none() {
                    self.faults.push(format!("robot interpreter: {message}"));
                }
                self.stop_program(controller);
                true
            }
        }
    }

    /// Stops the program because of an error, as the controller does with a message.
    fn stop_program(&mut self, controller: &mut Controller) {
        self.values.state = RobotState::Stopped;
        self.values.stop_message = true;
        controller.safety.started = false;
    }

    fn fire_due_triggers(&mut self, now_ms: u64) {
        if let Some((sequence, due_ms)) = self.due_triggers.front().copied()
            && now_ms >= due_ms
            && self.robot.fire_triggers(sequence)
        {
            self.due_triggers.pop_front();
        }
    }

    /// Executes one interpolation step of the arm.
    fn step_arm(&mut self, controller: &mut Controller) {
        if controller.mover.is_idle() {
            self.values.released = false;
        }
        let waits = self.programs.meaning.lone_approximation_waits && !self.values.released;
        if waits && controller.mover.is_waiting_for_blend() {
            controller.sample();
            return;
        }
        let (done, blocked) = controller.mover.step(controller.speed_limits(), TICK_MS as f64 / 1000.0);
        for step in &done {
            self.on_move_done(controller, step);
        }
        if let Some(blocked) = blocked {
            self.values.abandon_reason = Some(super::super::log::path_stop_message(&blocked));
            self.stop_program(controller);
        }
        if controller.mover.is_idle() {
            self.sequences.clear();
        }
        controller.contact.on_move_started(controller.mover.current_move());
        controller.sample();
        self.note_stop(controller);
    }

    fn on_move_done(&mut self, controller: &mut Controller, done: &CompletedMove) {
        controller.contact.on_point_reached(&done.step);
        if let Some(sequence) = self.sequences.pop_front() {
            let late_ms = match self.programs.meaning.late_triggers && self.random.random_bool(0.3) {
                true => self.random.random_range(0..3) * TICK_MS,
                false => 0,
            };
            let lost = self.programs.meaning.triggers_get_lost && controller.mover.is_idle();
            if lost && self.random.random_bool(0.3) {
                self.robot.forget_triggers(sequence);
            } else if self.robot.has_trigger(sequence) {
                self.due_triggers.push_back((sequence, controller.now_ms + late_ms));
            }
        }
        let Some(key) = done.step.key() else { return };
        controller.executed.push(ExecutedMotion {
            epoch: key.epoch,
            id: key.id,
            joints: done.joints,
            base_from_flange: controller.setup.arm.base_from_flange(&done.joints),
            time_ms: controller.now_ms,
            contact: done.step.contact(),
        });
    }
}

impl Controller {
    /// Returns whether arriving bytes are held back.
    pub(in super::super) fn is_holding_back(&self) -> bool {
        self.setup.clock == Clock::LockStep
            && self.running.as_ref().is_some_and(|running| !running.held_documents.is_serving)
    }

    /// Advances the time until the programs have started, so that they run when a client connects. Has no effect for
    /// the hand-written model.
    pub fn boot(&mut self) {
        if self.running.is_some() {
            self.advance_ms(BOOT_DURATION_MS);
        }
    }

    /// Holds back received bytes until the programs are permitted to read them.
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

    /// Discards all held documents of a client that was lost.
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

    /// Advances the time until the programs have opened this channel, because a client wants to connect.
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

    /// Advances by at least one tick, until this condition is true.
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
            // A heartbeat waits for its commands only if no other document follows it: a subsequent document, such as
            // an abort, must not wait for the heartbeat.
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
