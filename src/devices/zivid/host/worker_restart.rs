//! Handles lost workers: a lost worker is ended, its fault is recorded, and it is restarted if the budget allows.

use super::outcome::WorkerLoss;
use super::{CameraStage, EXIT_TIMEOUT, Host, RunningWorker};
use crate::zivid::budget::{RestartDecision, Restarts};
use crate::zivid::fault::{NextStep, ZividFault};
use std::sync::atomic::Ordering;
use std::time::Instant;

impl Host {
    /// Ends a lost worker, and starts it again if the budget allows.
    pub(super) fn on_worker_lost(&mut self, during: &'static str, loss: WorkerLoss) -> ZividFault {
        if self.shared.is_ending.load(Ordering::Relaxed) {
            // No more requests come, and nothing is reported.
            self.end_worker();
            return ZividFault::Ended { how: "the program ends".to_owned(), during, next: NextStep::StaysDown };
        }
        let verdict = self.budget.on_worker_ended(self.began.elapsed());
        let allowed = self.budget.allowed_restarts();
        let next = match verdict {
            RestartDecision::Restart { number } => {
                NextStep::Restart { number, of: allowed.max_restarts, within: allowed.within }
            }
            RestartDecision::StayDown => NextStep::StaysDown,
        };
        let fault = match (loss, self.end_worker()) {
            (WorkerLoss::Ended(how), _) => ZividFault::Ended { how, during, next },
            (WorkerLoss::HungUp, how) => {
                let how = how.unwrap_or_else(|| "it hung up".to_owned());
                ZividFault::Ended { how, during, next }
            }
            (WorkerLoss::Stalled(waited), _) => ZividFault::Timeout { during, waited, next },
            (WorkerLoss::Damaged(cause), _) => ZividFault::Damaged { during, cause, next },
        };
        self.shared.status().lost += 1;
        self.shared.record_fault(&fault);
        match verdict {
            RestartDecision::Restart { .. } => self.shared.set_stage(CameraStage::Starting(Instant::now())),
            RestartDecision::StayDown => {
                let down = self.stays_down_fault(&fault);
                self.stop_worker(down);
            }
        }
        fault
    }

    fn stays_down_fault(&self, last: &ZividFault) -> ZividFault {
        let Restarts { max_restarts: most, within } = self.budget.allowed_restarts();
        let wait = self.budget.wait(self.began.elapsed());
        ZividFault::Down { ended: most + 1, allowed: most, within, last: last.to_string(), wait }
    }

    /// Ends the worker; no other worker is started until a person requests one.
    pub(super) fn stop_worker(&mut self, fault: ZividFault) {
        self.end_worker();
        self.shared.record_fault(&fault);
        self.shared.set_stage(CameraStage::Down(fault));
    }

    /// Ends the worker. Returns how it had ended, if it had already ended by itself.
    pub(super) fn end_worker(&mut self) -> Option<String> {
        (self.camera, self.takes_clip) = (None, false);
        // The first shot of another worker must not count as a repetition of a shot of this worker.
        (self.last_number, self.scan.last_sum, self.picture.last_sum) = (0, None, None);
        let RunningWorker { link, mut peer } = self.worker.take()?;
        drop(link);
        let how = peer.wait_ended(EXIT_TIMEOUT);
        peer.kill();
        self.shared.status().worker = None;
        how
    }
}
