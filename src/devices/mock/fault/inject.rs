//! Injects faults into the mock controller, and ends them.

use super::super::model::Controller;
use super::super::options::Mode;
use super::super::wire::{Channel, Refusal, SET_BASE, SET_TCP};
use super::spec::{ConnectionSide, Fault, FaultTime};

const REBOOT_DURATION_MS: u64 = 3_000;

impl Controller {
    /// Injects this fault now.
    pub fn apply_fault(&mut self, fault: Fault) {
        let for_ms = self.set(fault, true);
        let for_ms = if let Fault::Reboot { for_ms: None } = fault { Some(REBOOT_DURATION_MS) } else { for_ms };
        if let Some(for_ms) = for_ms {
            self.troubles.ends.push((self.now_ms + for_ms, fault));
        }
    }

    /// Begins and ends faults at the start of a tick.
    pub(in super::super) fn update_faults(&mut self) {
        let now_ms = self.now_ms;
        let arrived = self.troubles.commands_arrived;
        let is_due = |when: FaultTime| match when {
            FaultTime::AtMs(at_ms) => at_ms <= now_ms,
            FaultTime::AtCommand(number) => number <= arrived,
        };
        if self.troubles.planned.iter().any(|planned| is_due(planned.when)) {
            let all = std::mem::take(&mut self.troubles.planned);
            let (due, later): (Vec<_>, Vec<_>) = all.into_iter().partition(|planned| is_due(planned.when));
            self.troubles.planned = later;
            due.iter().for_each(|planned| self.apply_fault(planned.fault));
        }
        while let Some(at) = self.troubles.ends.iter().position(|(end_ms, _)| *end_ms <= now_ms) {
            let (_, fault) = self.troubles.ends.swap_remove(at);
            self.set(fault, false);
        }
    }

    /// Counts commands that have arrived, for faults that are planned for a command number.
    pub(in super::super) fn count_arrived(&mut self, commands: u64) {
        self.troubles.commands_arrived += commands;
        if !self.troubles.planned.is_empty() {
            self.update_faults();
        }
    }

    /// Begins or ends a fault; returns the duration of the fault, if it is limited.
    fn set(&mut self, fault: Fault, begins: bool) -> Option<u64> {
        let troubles = &mut self.troubles;
        match fault {
            Fault::Cut(side) => {
                channels(side).iter().for_each(|&channel| self.disconnect(channel));
                None
            }
            Fault::Garbage(side) => {
                channels(side).iter().for_each(|&channel| self.write_garbage(channel));
                None
            }
            Fault::Unplug { for_ms } => {
                troubles.unplugged = begins;
                if !begins {
                    self.reconnect_cable();
                }
                for_ms
            }
            Fault::Mute { for_ms } => {
                troubles.mute = begins;
                for_ms
            }
            Fault::NoAcks { for_ms } => {
                troubles.no_acks = begins;
                for_ms
            }
            Fault::Stall { for_ms } => {
                troubles.stalled = begins;
                for_ms
            }
            Fault::SkipState => {
                troubles.skips_state = true;
                if let Some(running) = &mut self.running {
                    running.skip_state();
                }
                None
            }
            Fault::LoseBase | Fault::LoseTool => {
                troubles.lost_operation = Some(if fault == Fault::LoseBase { SET_BASE } else { SET_TCP });
                None
            }
            Fault::WrongBase => {
                troubles.wrong_base = true;
                None
            }
            Fault::Refuse(number) => {
                troubles.refusal = Refusal::from_number(number);
                if let Some(running) = &mut self.running {
                    running.refuse_motion();
                }
                None
            }
            Fault::Override { percent, for_ms } => {
                troubles.override_percent = begins.then_some(percent);
                for_ms
            }
            Fault::Measured { deviation_mm: off_mm, for_ms } => {
                troubles.pose_deviation_mm = begins.then_some(off_mm);
                for_ms
            }
            Fault::Slow { percent, for_ms } => {
                troubles.slow_share = begins.then_some(f64::from(percent) / 100.0);
                for_ms
            }
            _ => self.perform_person_action(fault, begins),
        }
    }

    /// Simulates an action of a person, of the safety controller or of the mains supply.
    fn perform_person_action(&mut self, fault: Fault, begins: bool) -> Option<u64> {
        let for_ms = self.perform_single_action(fault, begins);
        if !begins {
            // The person who has corrected the fault starts the program again.
            self.start_program();
        }
        for_ms
    }

    fn perform_single_action(&mut self, fault: Fault, begins: bool) -> Option<u64> {
        match fault {
            Fault::EStop { for_ms } => {
                if begins {
                    self.press_e_stop();
                } else {
                    self.release_e_stop();
                    self.switch_drives(true);
                }
                for_ms
            }
            Fault::Guard { for_ms } => {
                self.set_guard(!begins);
                for_ms
            }
            Fault::Drives { for_ms } => {
                self.switch_drives(!begins);
                for_ms
            }
            Fault::Mode { to, for_ms } => {
                self.select_mode(if begins { to } else { Mode::Ext });
                for_ms
            }
            Fault::Deselect { for_ms } => {
                if begins {
                    self.deselect_program();
                } else {
                    self.select();
                }
                for_ms
            }
            Fault::Reboot { for_ms } => {
                if begins {
                    self.reboot(for_ms.unwrap_or(REBOOT_DURATION_MS));
                }
                for_ms
            }
            _ => None,
        }
    }

    /// Reconnects the cable: first the bytes arrive that were held back, then the end of each closed connection.
    fn reconnect_cable(&mut self) {
        for (index, channel) in [Channel::Command, Channel::State].into_iter().enumerate() {
            let bytes = std::mem::take(&mut self.troubles.cable_buffer[index]);
            match channel {
                Channel::Command => self.command_bytes(&bytes),
                Channel::State => self.state_bytes(&bytes),
            }
            if std::mem::take(&mut self.troubles.hung_up[index]) {
                self.disconnect(channel);
            }
        }
    }
}

fn channels(side: ConnectionSide) -> &'static [Channel] {
    match side {
        ConnectionSide::Command => &[Channel::Command],
        ConnectionSide::State => &[Channel::State],
        ConnectionSide::Both => &[Channel::Command, Channel::State],
    }
}
