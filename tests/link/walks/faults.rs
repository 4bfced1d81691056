//! The faults of a walk: one after the other, each with random details.

use super::super::cell::Side;
use super::super::damage;
use super::Walk;
use panelprep::devices::mock::{self, ConnectionSide as End, Fault, Mode};
use panelprep::eki::Channel;
use rand::RngExt;

impl Walk {
    pub(super) fn inject_fault(&mut self) {
        let draw = &mut self.draw;
        self.faults += 1;
        self.next_fault_ms = self.cell.now_ms
            + if self.is_program { draw.random_range(300..3_500) } else { draw.random_range(500..8_000) };
        let lasts_ms = draw.random_range(20..2_000);
        let for_ms = Some(lasts_ms);
        let side = [Side::Client, Side::Robot][draw.random_range(0..2)];
        let channel = [Channel::Command, Channel::State][draw.random_range(0..2)];
        let end = [End::Command, End::State, End::Both][draw.random_range(0..3)];
        let until_ms = self.cell.now_ms + lasts_ms;
        let is_program = self.is_program;
        let kinds = if is_program { 34 } else { 24 };
        let fault = match draw.random_range(0..kinds) {
            0..3 => return self.cell.cut(channel, side, draw.random_bool(0.5)),
            3 => return self.cell.client_stalls_until_ms = until_ms,
            4 => return self.cell.deaf_until_ms = until_ms,
            5 => {
                let _ = self.cell.session.abort();
                return;
            }
            6 => Fault::Garbage(end),
            7..9 => Fault::Unplug { for_ms },
            9 => Fault::Mute { for_ms },
            10 => Fault::NoAcks { for_ms },
            11 => Fault::Stall { for_ms },
            12 => Fault::SkipState,
            13 => Fault::LoseBase,
            14 => Fault::LoseTool,
            15 => Fault::WrongBase,
            16 => Fault::Refuse(8),
            17 => {
                let percent = draw.random_range(20..100);
                (self.oracles.slowed_until_ms, self.oracles.slowed_to_percent) = (until_ms, percent);
                if is_program && percent % 2 == 0 {
                    Fault::Override { percent, for_ms }
                } else {
                    Fault::Slow { percent, for_ms }
                }
            }
            18 => Fault::EStop { for_ms },
            19 => Fault::Guard { for_ms },
            23 if !is_program => {
                // A request of another client, or a damaged request: any operation, any number.
                let operation = draw.random_range(9..13);
                let number = [i32::MIN, -1, 0, 1_000_000, i32::MAX - 1, i32::MAX][draw.random_range(0..6)];
                return self.cell.foreign_request(operation, number);
            }
            20 if is_program => {
                Fault::Mode { to: [Mode::T1, Mode::T2, Mode::Aut][draw.random_range(0..3)], for_ms }
            }
            20 => Fault::Mode { to: Mode::T1, for_ms },
            21 => Fault::Deselect { for_ms },
            22 => Fault::Reboot { for_ms },
            // A person works with another program, while the drives are switched off and on.
            23 => {
                self.home_at_ms = Some(until_ms + 3_000);
                return self.cell.controller.select_foreign_program();
            }
            // A client that disconnects before the programs have detected it.
            24 => {
                let channel = [mock::Channel::Command, mock::Channel::State][draw.random_range(0..2)];
                if self.cell.controller.connect(channel) {
                    self.cell.controller.disconnect(channel);
                }
                return;
            }
            // A person holds or releases the start key, whatever the program does.
            25 => return self.cell.controller.set_start_key(draw.random_bool(0.5)),
            26..30 => return self.damage(),
            30 => return self.set_state_number_near_end(),
            31 => return self.cell.controller.set_input(draw.random_range(1..9), draw.random_bool(0.7)),
            32 => return self.cell.controller.fail_channels(until_ms),
            _ => Fault::Stall { for_ms: Some(draw.random_range(100..380)) },
        };
        self.cell.controller.apply_fault(fault);
    }

    /// Sends messages that a correct client never sends.
    fn damage(&mut self) {
        let (epoch, (received, _)) = (self.cell.controller.epoch(), self.cell.controller.counts());
        self.oracles.strange_epoch = epoch.saturating_add(2);
        let documents = damage::documents(&mut self.draw, epoch, received);
        if documents.len() > 100 {
            // Otherwise the client would end the epoch before the ring buffer is full.
            self.cell.deaf_until_ms = self.cell.now_ms + 350;
        }
        for document in documents {
            match document {
                Ok(command) => self.cell.controller.command_bytes(command.as_bytes()),
                Err(request) => self.cell.controller.state_bytes(request.as_bytes()),
            }
        }
    }

    /// Sets the number of the states close to the end of its range.
    fn set_state_number_near_end(&mut self) {
        // One less than the last number: the program may be between the check of the number and its increment.
        self.cell.controller.set_shared("CELL_SEQ", i32::MAX - 1 - self.draw.random_range(0..4));
    }

    /// Switches the drives off and on while the foreign program runs; then the cell's program is selected again.
    pub(super) fn work_with_another_program(&mut self) {
        let Some(home_at_ms) = self.home_at_ms else { return };
        if self.cell.now_ms >= home_at_ms {
            self.home_at_ms = None;
            self.cell.controller.deselect_program();
            self.cell.controller.select();
        } else if self.cell.now_ms >= home_at_ms - 1_000 && self.cell.controller.can_start() {
            self.cell.controller.apply_fault(Fault::Drives { for_ms: Some(2_000) });
        }
    }
}
