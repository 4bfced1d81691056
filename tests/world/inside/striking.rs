//! Injects the faults at their places: in the connection, at the controller, among people, at cameras, disk and clock.

use super::super::disk;
use super::super::link_cell::Side;
use super::super::script::{DiskHarm, Entry, Fault, Harm, Power};
use super::Inside;
use super::places::Jog;
use panelprep::eki::Channel;
use std::sync::PoisonError;

/// Time after which the cell's own program is selected again after a person worked with another program, ms.
const HOME_MS: u64 = 3_000;
/// Time after which an abort that was not executed is sent again, ms.
const ABORT_RETRY_MS: u64 = 300;

impl Inside {
    pub(super) fn strike_due(&mut self) {
        let now_ms = self.now_ms();
        let due: Vec<Entry> = self
            .script
            .extract_if(.., |pending| pending.due_ms.is_some_and(|due_ms| due_ms <= now_ms))
            .map(|pending| pending.entry)
            .collect();
        for entry in due {
            self.strike(entry.fault);
        }
    }

    pub(super) fn mark_reports_unreliable(&mut self) {
        // A message or change by another client may have increased the count of epochs by one.
        let known =
            self.cell.controller.epoch().max(self.cell.session.epoch().map_or(0, |epoch| epoch.0.cast_signed()));
        self.oracles.strange_epoch = self.oracles.strange_epoch.max(known.saturating_add(2));
    }

    fn strike(&mut self, fault: Fault) {
        *self.counts.faults.entry((fault.kind(), self.place)).or_default() += 1;
        let now_ms = self.now_ms();
        let until_ms = now_ms + fault.lasts_ms();
        self.lasts_until_ms = self.lasts_until_ms.max(until_ms);
        let is_measured = matches!(&fault, Fault::Controller(text) if text.starts_with("measured"));
        if !matches!(fault, Fault::Feedback { .. }) && !is_measured {
            self.others_last_until_ms = self.others_last_until_ms.max(until_ms);
        }
        self.struck_ms = now_ms;
        self.lingers |= matches!(fault, Fault::Bytes { .. } | Fault::Lie { .. } | Fault::Controller(_));
        self.places_lie |= may_displace_the_arm(&fault);
        let mut tampering = self.tampering.lock().unwrap_or_else(PoisonError::into_inner);
        match fault {
            Fault::Bytes { to_robot, channel, harm } => {
                self.truth.is_garbled |= to_robot;
                tampering.harms.push((to_robot, channel, harm));
            }
            Fault::Lie { channel, name, value, times } => tampering.lies.push((channel, name, value, times)),
            // An intact controller drops these messages, so its reports remain reliable.
            Fault::Replay(count) => {
                tampering.replays = count;
                return;
            }
            // The controller treats the abort only as a heartbeat.
            Fault::Unheeded(count) => {
                tampering.unheeded = count;
                self.oracles.unheeded_ms = u64::from(count) * ABORT_RETRY_MS;
                return;
            }
            _ => {
                drop(tampering);
                return self.strike_cell(fault, now_ms);
            }
        }
        drop(tampering);
        self.mark_reports_unreliable();
    }

    fn strike_cell(&mut self, fault: Fault, now_ms: u64) {
        match fault {
            Fault::Cut { channel, by_robot, loses } => {
                let side = if by_robot { Side::Robot } else { Side::Client };
                self.cell.cut([Channel::Command, Channel::State][channel.min(1)], side, loses);
            }
            Fault::Deaf(ms) => {
                if now_ms >= self.cell.deaf_until_ms {
                    self.deaf_since_ms = now_ms;
                }
                self.cell.deaf_until_ms = now_ms + ms;
            }
            Fault::Stall(ms) => self.cell.client_stalls_until_ms = now_ms + ms,
            Fault::Controller(text) => {
                if let Some(fault) = self.fault_of(&text) {
                    self.expects_of(&fault);
                    self.cell.controller.apply_fault(fault);
                }
            }
            Fault::Foreign { operation, number } => {
                self.expects_of_foreign(operation);
                self.cell.foreign_request(operation, number);
                self.mark_reports_unreliable();
            }
            Fault::ForeignProgram(ms) => {
                self.home_at_ms = Some(now_ms + ms + HOME_MS);
                self.truth.faulty_until_ms = self.truth.faulty_until_ms.max(now_ms + ms + 2 * HOME_MS);
                self.cell.controller.deselect_program();
            }
            Fault::Feedback { input, on, for_ms } => {
                self.lock_around().stuck = Some((input, on, now_ms + for_ms));
            }
            Fault::Press(press) => self.pressed.push_back(press),
            Fault::Camera { flange, harm, for_ms } => {
                self.cameras[usize::from(flange)] = Some((harm, now_ms + for_ms))
            }
            Fault::Clock(jump_s) => super::super::clock::jump(jump_s),
            Fault::Power { writing, power } => {
                self.power = Some(power);
                disk::at_writing(writing, disk::Event::End);
            }
            Fault::Disk { writing, harm, times } => {
                disk::at_writing(
                    writing,
                    match harm {
                        DiskHarm::Full => disk::Event::Full(times),
                        DiskHarm::Io => disk::Event::Io(times),
                    },
                );
            }
            Fault::SlowDisk { late_ms, for_ms } => self.slow_disk = Some((late_ms, now_ms + for_ms)),
            Fault::Away(ms) => self.away_until_ms = now_ms + ms,
            Fault::Jog { percent, height_mm, for_ms } => {
                self.places.jog = Some(Jog { percent, height_mm, for_ms });
            }
            Fault::Stale { press, back } => self.screens.push_back((press, back)),
            Fault::Backup => self.backs_up = true,
            Fault::Restore => {
                self.restores = self.backup.is_some();
                if self.restores {
                    self.power = Some(Power::Kill);
                    disk::at_writing(0, disk::Event::End);
                }
            }
            Fault::Bytes { .. } | Fault::Lie { .. } | Fault::Replay(_) | Fault::Unheeded(_) => {}
        }
    }

    /// A person has finished work with another program, and selects the cell's own program again.
    pub(super) fn work_with_another_program(&mut self) {
        if self.home_at_ms.is_some_and(|home_at_ms| self.now_ms() >= home_at_ms) {
            self.home_at_ms = None;
            self.cell.controller.deselect_program();
            self.cell.controller.select();
        }
    }
}

/// Returns whether the arm's pose, as the client receives it, may be wrong: because of a wrong value, or an inverted
/// bit in a state.
fn may_displace_the_arm(fault: &Fault) -> bool {
    match fault {
        Fault::Lie { channel: 1, name, .. } => matches!(&**name, "X" | "A1"),
        Fault::Controller(text) => text.starts_with("measured"),
        Fault::Bytes { to_robot: false, channel: 1, harm: Harm::Damage { .. } } => true,
        _ => false,
    }
}
