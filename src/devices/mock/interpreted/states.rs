//! The states of the robot program; the effects of people, of the safety controller and of the cell's PLC on these
//! states; and the data of the programs that can be read from outside.

use super::super::log::{ProgramStop, StopCause};
use super::super::model::{ContactState, Controller, TICK_MS};
use super::super::options::Mode;
use super::super::wire::Channel;
use super::running::{RobotState, RunningPrograms};
use panelprep_kuka::krl::Cell;
use rand::RngExt;

/// Time between the reset of the program and its start by the cell's PLC, ms.
const RESTART_MS: u64 = 300;
/// Time between a stop without a reset and the start of the program by the PLC, ms.
const PLC_RESTART_MS: u64 = 1_500;

/// Time after a stop within which the controller decides whether and how the arm retracts, ms.
const RETRACT_DECISION_MS: u64 = 500;
/// Maximum time between a person's action and a stop that is attributed to this action, ms.
const PERSON_STOP_WINDOW_MS: u64 = 1_000;
/// Time that a person needs to select another program, ms.
const PROGRAM_SELECTION_MS: u64 = 1_000;

impl Controller {
    /// Simulates a person who deselects the cell's program and then selects and starts another program.
    pub fn select_foreign_program(&mut self) {
        self.with_running(|controller, running| {
            running.robot.clear();
            controller.stop_arm_for_good();
            running.sequences.clear();
            running.values.state = RobotState::Free;
            running.values.stop_message = false;
            running.foreign_at_ms = Some(controller.now_ms + PROGRAM_SELECTION_MS);
            controller.safety.foreign = true;
            controller.safety.started = false;
        });
    }

    /// Returns whether drives, guard, mode and keys permit the start of a program.
    pub fn can_start(&self) -> bool {
        self.safety.may_start()
    }

    /// Returns how many times a program that does not belong to the cell was reset.
    pub fn foreign_program_resets(&self) -> u32 {
        self.safety.foreign_program_resets
    }

    /// Returns the state of the robot program; `None` for the hand-written model.
    pub fn robot_state(&self) -> Option<RobotState> {
        self.running.as_ref().map(|running| running.values.state)
    }

    fn stop_arm_for_good(&mut self) {
        self.contact.stop(self.mover.current_move(), false);
        self.mover.stop_immediately();
    }

    pub(in super::super) fn with_running(&mut self, act: impl FnOnce(&mut Controller, &mut RunningPrograms)) {
        if let Some(mut running) = self.running.take() {
            act(self, &mut running);
            self.running = Some(running);
        }
    }

    /// Starts the program. The start may come from the Start key, the PLC, or a person who corrected a fault.
    pub(in super::super) fn start_interpreted(&mut self) {
        self.with_running(|controller, running| {
            if !controller.safety.selected || !controller.safety.may_start() {
                return;
            }
            match running.values.state {
                RobotState::Reset | RobotState::Ended if controller.safety.foreign => {
                    running.values.state = RobotState::Active;
                }
                RobotState::Reset | RobotState::Ended => {
                    if let Some(routine) = running.programs.program.routine("CELL_MOTION") {
                        running.robot.start_routine(&running.programs.program, routine);
                    }
                    controller.stop_arm_for_good();
                    running.sequences.clear();
                    running.due_triggers.clear();
                    running.values.base.now = None;
                    running.values.tool.now = None;
                    running.values.state = RobotState::Active;
                }
                RobotState::Stopped => {
                    // The start also acknowledges the message of a previous stop.
                    running.values.stop_message = false;
                    running.values.state = RobotState::Active;
                }
                RobotState::Free | RobotState::Active => {}
            }
            running.values.changed = true;
            controller.safety.started = running.values.state == RobotState::Active && !controller.safety.foreign;
        });
    }

    /// Stops the arm, or deselects the program, because of an event outside of the programs.
    pub(in super::super) fn stop_interpreted(&mut self, cause: StopCause) {
        let now_ms = self.now_ms;
        self.with_running(|controller, running| {
            running.last_stop = Some((now_ms, cause));
            running.values.changed = true;
            match cause {
                StopCause::Deselected => {
                    running.robot.clear();
                    controller.stop_arm_for_good();
                    running.sequences.clear();
                    running.values.state = RobotState::Free;
                    running.values.stop_message = false;
                }
                StopCause::Rebooted => controller.stop_arm_for_good(),
                _ if running.values.state == RobotState::Active => {
                    running.stops_at_ms = Some(now_ms + running.draw_stop_ms());
                    running.values.stop_message |= cause != StopCause::Mode;
                    running.stop_when_due(now_ms);
                }
                _ => {}
            }
            controller.safety.started = running.values.state == RobotState::Active && !controller.safety.foreign;
        });
    }

    /// Selects the program and places it at its first line.
    pub(in super::super) fn select_interpreted(&mut self) {
        self.safety.foreign = false;
        self.with_running(|_, running| {
            if running.values.state == RobotState::Free {
                running.values.state = RobotState::Reset;
            }
        });
    }

    pub(in super::super) fn reboot_interpreted(&mut self, down_ms: u64) {
        let at_ms = self.now_ms + down_ms;
        for channel in [Channel::Command, Channel::State] {
            self.close_by_program(channel);
            self.link(channel).memory.clear();
        }
        self.setup.boot = self.setup.boot.wrapping_add(1);
        self.started_ms = self.now_ms;
        self.flags.clear();
        self.stop_arm_for_good();
        self.contact = ContactState::default();
        let on: Vec<u16> = self.outputs.iter().filter(|(_, on)| **on).map(|(number, _)| *number).collect();
        on.iter().for_each(|&number| self.set_output(number, false));
        self.safety.started = false;
        self.with_running(|controller, running| {
            running.reboot(at_ms, &controller.setup);
            running.values.state = if controller.safety.selected { RobotState::Reset } else { RobotState::Free };
        });
    }
}

impl RunningPrograms {
    /// Returns a random delay between the cause of a stop and the report that the program has stopped, ms.
    fn draw_stop_ms(&mut self) -> u64 {
        if self.programs.meaning.stops_late { self.random.random_range(0..5) * TICK_MS } else { 0 }
    }

    fn stop_when_due(&mut self, now_ms: u64) {
        if self.stops_at_ms.is_none_or(|at_ms| now_ms < at_ms) {
            return;
        }
        self.stops_at_ms = None;
        if self.values.state == RobotState::Active {
            self.values.state = RobotState::Stopped;
        }
    }

    /// At the start of a tick, applies the effects of drives, guard, mode and keys on a running program, and the
    /// actions of the PLC.
    pub(super) fn pass_states(&mut self, controller: &mut Controller) {
        let safety = &controller.safety;
        let may_run = safety.may_start();
        let values = &mut self.values;
        if self.foreign_at_ms.is_some_and(|at_ms| controller.now_ms >= at_ms) {
            self.foreign_at_ms = None;
            if safety.foreign && values.state == RobotState::Free {
                values.state = RobotState::Active;
            }
        }
        if values.state == RobotState::Active && !may_run {
            self.stops_at_ms.get_or_insert(controller.now_ms);
        }
        self.stop_when_due(controller.now_ms);
        let values = &mut self.values;
        if std::mem::take(&mut values.reset_asked) && values.state == RobotState::Stopped {
            values.state = RobotState::Reset;
            values.stop_message = false;
            controller.safety.foreign_program_resets += u32::from(controller.safety.foreign);
            self.robot.clear();
            self.sequences.clear();
            controller.stop_arm_for_good();
        }
        if values.state == RobotState::Active && !controller.safety.foreign && self.robot.is_idle() {
            values.state = RobotState::Ended;
        }
        let automatic = matches!(controller.safety.mode, Mode::Aut | Mode::Ext);
        let waits = matches!(values.state, RobotState::Reset | RobotState::Ended | RobotState::Stopped);
        let since_ms = self.reset_since_ms.filter(|_| waits && automatic && may_run);
        self.reset_since_ms = (waits && automatic && may_run).then_some(since_ms.unwrap_or(controller.now_ms));
        controller.safety.started = self.values.state == RobotState::Active && !controller.safety.foreign;
        self.values.changed = true;
    }

    /// Returns whether the PLC starts the program at this time.
    pub(super) fn plc_starts(&self, now_ms: u64) -> bool {
        let wait_ms = if self.values.state == RobotState::Stopped { PLC_RESTART_MS } else { RESTART_MS };
        self.initialised && self.reset_since_ms.is_some_and(|since_ms| now_ms >= since_ms + wait_ms)
    }

    /// Records a stop if the programs have ended an epoch.
    pub(super) fn note_stop(&mut self, controller: &mut Controller) {
        // If the submit interpreter does not run, the robot program itself ends the epoch.
        let is_open = self.memory.bool(self.cells.open) && !self.robot_has_ended();
        if is_open == self.was_open {
            self.set_last_stop_cause(controller);
            return;
        }
        if !is_open {
            let cause = match (self.is_halted(controller), self.recent_stop_cause(controller)) {
                (true, Some(cause)) => cause,
                (true, None) => StopCause::Halted,
                _ => StopCause::Program,
            };
            let near = controller.mover.has_contact_ahead() || self.is_contact_possible();
            let contact = controller.contact.touches(controller.mover.current_move()) || near;
            let epoch = self.memory.shared_int(self.cells.epoch);
            let (time_ms, detail) = (controller.now_ms, self.values.abandon_reason.clone().unwrap_or_default());
            controller.stops.push(ProgramStop { time_ms, epoch, cause, contact, detail });
        }
        self.was_open = is_open;
    }

    /// Completes the cause of a stop while the program decides on its retract. `CELL_STOP` closes the epoch a few
    /// statements before it halts the robot program; if a person stops the arm at that moment, the person is the cause.
    /// Only the retract shows that a motion to the panel was already planned when the stop began.
    fn set_last_stop_cause(&self, controller: &mut Controller) {
        let pressed = self.recent_stop_cause(controller).filter(|_| self.is_halted(controller));
        let now_ms = controller.now_ms;
        let is_recent = |stop: &&mut ProgramStop| !self.was_open && now_ms < stop.time_ms + RETRACT_DECISION_MS;
        let Some(last) = controller.stops.last_mut().filter(is_recent) else { return };
        last.contact |= self.memory.bool(self.cells.retract) && self.is_contact_possible();
        if let (StopCause::Program, Some(cause)) = (last.cause, pressed) {
            last.cause = cause;
        }
    }

    /// Returns whether the robot program is stopped, or a stop is commanded.
    fn is_halted(&self, controller: &Controller) -> bool {
        self.values.state != RobotState::Active || controller.flags.get(&855) == Some(&true)
    }

    /// Returns the last action of a person that stops the arm, if it occurred within the last second.
    fn recent_stop_cause(&self, controller: &Controller) -> Option<StopCause> {
        self.last_stop
            .filter(|(at_ms, _)| controller.now_ms < at_ms + PERSON_STOP_WINDOW_MS)
            .map(|(_, cause)| cause)
    }
}

impl Controller {
    /// Returns the messages of interpreters that stopped unexpectedly: file, line and reason.
    pub fn program_faults(&self) -> &[String] {
        self.running.as_ref().map_or(&[], |running| &running.faults)
    }

    /// Returns the first cell of a variable of the data lists, for tests.
    pub fn shared(&self, name: &str) -> Option<Cell> {
        let running = self.running.as_ref()?;
        let cell = running.programs.program.cell(name)?;
        running.memory.cells.get(cell as usize).copied()
    }

    /// Sets an INT variable of the data lists, as a person does on the pendant's variable display.
    pub fn set_shared(&mut self, name: &str, number: i32) {
        let Some(running) = &mut self.running else { return };
        let cell = running.programs.program.cell(name);
        if let Some(cell) = cell.and_then(|cell| running.memory.cells.get_mut(cell as usize)) {
            *cell = Cell::Int(number);
        }
    }

    /// Makes the EthernetKRL functions EKI_Init and EKI_Open fail until this time; open channels stay open.
    pub fn fail_channels(&mut self, until_ms: u64) {
        if let Some(running) = &mut self.running {
            running.values.channels_fail_until_ms = until_ms;
        }
    }

    /// Returns the current file and line of each interpreter, the robot interpreter first.
    pub fn program_places(&self) -> Option<[String; 2]> {
        self.running.as_ref().map(|running| {
            [&running.robot, &running.submit].map(|it| it.current_location(&running.programs.program))
        })
    }

    /// Returns how many times each statement of the programs was executed; empty for the hand-written model.
    pub fn statement_hits(&self) -> &[u32] {
        self.running.as_ref().map_or(&[], |running| &running.memory.hits)
    }

    /// Returns, for each step that ends a condition, whether the condition was ever FALSE and ever TRUE.
    pub fn branches(&self) -> &[[bool; 2]] {
        self.running.as_ref().map_or(&[], |running| &running.memory.branches)
    }
}

impl RunningPrograms {
    pub(in super::super) fn epoch(&self) -> i32 {
        self.memory.shared_int(self.cells.epoch)
    }

    pub(in super::super) fn is_stopped(&self) -> bool {
        self.memory.bool(self.cells.stopped) || self.robot_has_ended()
    }

    /// Returns whether the robot program has ended the current epoch.
    pub(super) fn robot_has_ended(&self) -> bool {
        let epoch = self.epoch();
        self.memory.shared_int(self.cells.dead_epoch) == epoch
            && self.memory.shared_int(self.cells.run_epoch) == epoch
    }

    /// Returns whether, according to the variables of the robot program, the tool is on the panel or a planned motion
    /// ends there. In case of doubt the program retracts, because a trigger may be late.
    pub(super) fn is_contact_possible(&self) -> bool {
        let [read, write, places] = [self.cells.queue_read, self.cells.queue_write, self.cells.queue_places]
            .map(|it| self.memory.shared_int(it));
        let touches = |motion: i32| {
            let place = u32::try_from(motion.checked_rem(places).unwrap_or(0)).unwrap_or(0);
            self.memory.bool(self.cells.queue_touch.map(|first| first + place))
        };
        self.memory.bool(self.cells.behind) || (read..write).any(touches)
    }

    /// Returns the numbers of the last command received and of the last command executed.
    pub(in super::super) fn counts(&self) -> (i32, i32) {
        // The variables are not valid before the programs have run their initialisation.
        if !self.initialised {
            return (0, 0);
        }
        let of_this_epoch = self.memory.shared_int(self.cells.run_epoch) == self.epoch();
        let done = if of_this_epoch { self.memory.shared_int(self.cells.done) } else { 0 };
        (self.memory.shared_int(self.cells.received), done)
    }

    pub(in super::super) fn underruns(&self) -> i32 {
        self.memory.shared_int(self.cells.under_air) + self.memory.shared_int(self.cells.under_touch)
    }

    /// Makes the controller abandon the next motion (an injected fault).
    pub(in super::super) fn refuse_motion(&mut self) {
        self.values.abandons_next_motion = true;
    }

    /// Skips the sequence number of the next state message.
    pub(in super::super) fn skip_state(&mut self) {
        let cell = self.cells.sequence.and_then(|cell| self.memory.cells.get_mut(cell as usize));
        if let Some(Cell::Int(number)) = cell {
            *number = number.wrapping_add(1) & i32::MAX;
        }
    }
}
