//! Handles lost workers: a lost worker is ended, its fault is recorded, and it is restarted if the budget allows.

use super::outcome::Loss;
use super::{EXIT_TIMEOUT, Host, Stage, Worker};
use crate::devices::zivid::budget::{Restarts, Verdict};
use crate::devices::zivid::fault::{Next, ZividFault};
use std::sync::atomic::Ordering;
use std::time::Instant;

impl Host {
    /// Ends a lost worker, and starts it again if the budget allows.
    pub(super) fn lost(&mut self, during: &'static str, loss: Loss) -> ZividFault {
        if self.shared.is_ending.load(Ordering::Relaxed) {
            // No more requests come, and nothing is reported.
            self.end_worker();
            return ZividFault::Ended { how: "the program ends".to_owned(), during, next: Next::StaysDown };
        }
        let verdict = self.budget.ended(self.began.elapsed());
        let allowed = self.budget.allowed();
        let next = match verdict {
            Verdict::Restart { number } => Next::Restart { number, of: allowed.most, within: allowed.within },
            Verdict::StayDown => Next::StaysDown,
        };
        let fault = match (loss, self.end_worker()) {
            (Loss::Ended(how), _) => ZividFault::Ended { how, during, next },
            (Loss::HungUp, how) => {
                let how = how.unwrap_or_else(|| "it hung up".to_owned());
                ZividFault::Ended { how, during, next }
            }
            (Loss::Stalled(waited), _) => ZividFault::Timeout { during, waited, next },
            (Loss::Damaged(cause), _) => ZividFault::Damaged { during, cause, next },
        };
        self.shared.status().lost += 1;
        self.shared.note(&fault);
        match verdict {
            Verdict::Restart { .. } => self.shared.becomes(Stage::Starting(Instant::now())),
            Verdict::StayDown => {
                let down = self.stays_down(&fault);
                self.down(down);
            }
        }
        fault
    }

    fn stays_down(&self, last: &ZividFault) -> ZividFault {
        let Restarts { most, within } = self.budget.allowed();
        let wait = self.budget.wait(self.began.elapsed());
        ZividFault::Down { ended: most + 1, allowed: most, within, last: last.to_string(), wait }
    }

    /// Ends the worker; no other worker is started until a person requests one.
    pub(super) fn down(&mut self, fault: ZividFault) {
        self.end_worker();
        self.shared.note(&fault);
        self.shared.becomes(Stage::Down(fault));
    }

    /// Ends the worker. Returns how it had ended, if it had already ended by itself.
    pub(super) fn end_worker(&mut self) -> Option<String> {
        (self.camera, self.takes_clip) = (None, false);
        // The first shot of another worker must not count as a repetition of a shot of this worker.
        (self.last_number, self.scan.last_sum, self.picture.last_sum) = (0, None, None);
        let Worker { link, mut peer } = self.worker.take()?;
        drop(link);
        let how = peer.ended(EXIT_TIMEOUT);
        peer.kill();
        self.shared.status().worker = None;
        how
    }
}
