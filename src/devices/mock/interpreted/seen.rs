//! The parts of the programs that can be read from outside.

use super::super::model::Controller;
use super::running::RunningPrograms;
use panelprep_kuka::krl::Cell;

impl Controller {
    /// Returns the errors that stopped an interpreter although no stop was intended: file, line, reason.
    pub fn program_faults(&self) -> &[String] {
        self.running.as_ref().map_or(&[], |running| &running.faults)
    }

    /// Returns the first cell of a variable of the data lists, for tests.
    pub fn shared(&self, name: &str) -> Option<Cell> {
        let running = self.running.as_ref()?;
        let cell = running.programs.program.cell(name)?;
        running.memory.cells.get(cell as usize).copied()
    }

    /// Sets an INT of the data lists, as a person does with the display of variables.
    pub fn set_shared(&mut self, name: &str, number: i32) {
        let Some(running) = &mut self.running else { return };
        let cell = running.programs.program.cell(name);
        if let Some(cell) = cell.and_then(|cell| running.memory.cells.get_mut(cell as usize)) {
            *cell = Cell::Int(number);
        }
    }

    /// Makes EthernetKRL fail until this time: it reads no configuration and opens no channel; open channels stay
    /// open.
    pub fn fail_channels(&mut self, until_ms: u64) {
        if let Some(running) = &mut self.running {
            running.values.channels_fail_until_ms = until_ms;
        }
    }

    /// Returns the present file and line of each interpreter, the robot's first.
    pub fn program_places(&self) -> Option<[String; 2]> {
        self.running.as_ref().map(|running| {
            [&running.robot, &running.submit].map(|it| it.current_location(&running.programs.program))
        })
    }

    /// Returns how often each statement of the programs was executed; empty for the hand-written model.
    pub fn statement_hits(&self) -> &[u32] {
        self.running.as_ref().map_or(&[], |running| &running.memory.hits)
    }

    /// Returns, for each step of the programs that is a condition, whether it was ever FALSE and ever TRUE.
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

    /// Returns whether the robot program has ended the present epoch.
    pub(super) fn robot_has_ended(&self) -> bool {
        let epoch = self.epoch();
        self.memory.shared_int(self.cells.dead_epoch) == epoch
            && self.memory.shared_int(self.cells.run_epoch) == epoch
    }

    /// Returns whether, as far as the robot program knows, the tool is on the panel or a planned motion ends there. In
    /// case of doubt the program retracts, since a trigger may be late.
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
        // The commands received before a start of the controller are forgotten at that start.
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

    /// Makes the controller abandon the next motion.
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
