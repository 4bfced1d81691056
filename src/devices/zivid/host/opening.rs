//! Starts the worker process, opens the camera and warms up the SDK. A lost worker is ended, its fault is recorded, and
//! it is restarted if the budget permits.

use super::{
    CameraStage, EXIT_TIMEOUT, Host, MAX_SEARCH_INTERVAL, RequestFailure, RunningWorker, WorkerLoss, answer_name,
};
use crate::zivid::budget::{RestartDecision, Restarts};
use crate::zivid::fault::{NextStep, ZividFault};
use crate::zivid::message::{Identity, Refusal, Reply, Request, Size, Source, Trouble, Use};
use crate::zivid::process::{Answer, Link};
use crate::zivid::wire::{VERSION, WireError};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

impl Host {
    /// Starts a worker and opens the camera.
    pub(super) fn start(&mut self) {
        self.shared.set_stage(CameraStage::Starting(Instant::now()));
        let (stream, peer) = match (self.launch)() {
            Ok(started) => started,
            Err(error) => {
                return self
                    .stop_worker(ZividFault::NoWorker(format!("the worker's process cannot be started: {error}")));
            }
        };
        self.shared.status().worker = peer.id();
        let mut link = Link::new(stream, self.shared.is_ending.clone());
        let hello = link.receive_hello(self.setup.timeouts.hello);
        self.worker = Some(RunningWorker { link, peer });
        let during = "its start";
        match hello {
            Err(WireError::Version { found }) => {
                let expected = VERSION.to_string();
                self.stop_worker(ZividFault::WrongVersion { found: format!("protocol {found}"), expected });
            }
            Err(error) => {
                drop(self.on_worker_lost(during, WorkerLoss::from_wire_error(error, self.setup.timeouts.hello)))
            }
            Ok(hello) if hello.program != env!("CARGO_PKG_VERSION") => {
                let expected = env!("CARGO_PKG_VERSION").to_owned();
                self.stop_worker(ZividFault::WrongVersion { found: hello.program, expected });
            }
            Ok(hello) => match hello.sdk {
                Err(why) => self.stop_worker(ZividFault::NoWorker(why)),
                Ok(sdk) => {
                    tracing::info!("the 3D camera's worker runs; Zivid SDK: {sdk}");
                    self.open();
                }
            },
        }
    }

    /// Opens the camera; if it cannot be opened, the reason is reported once.
    pub(super) fn open(&mut self) {
        match self.open_camera() {
            Ok(identity) => {
                tracing::info!("the 3D camera is ready: {} {}", identity.model, identity.serial);
                self.camera = Some(identity.clone());
                self.search_pause = Duration::ZERO;
                self.shared.set_stage(CameraStage::Ready(identity));
            }
            Err(OpenFailure::Lost(during, loss)) => drop(self.on_worker_lost(during, loss)),
            Err(OpenFailure::NoCamera(fault)) => {
                self.search_pause = search_delay(&fault, self.search_pause, self.setup.timeouts.search);
                self.search = Instant::now() + self.search_pause;
                self.on_camera_missing(fault);
            }
        }
    }

    fn open_camera(&mut self) -> Result<Identity, OpenFailure> {
        let (setup, patience) = (self.setup.clone(), self.setup.timeouts);
        let connect = Request::Connect { source: setup.source.clone() };
        let refused = |Refusal { trouble, message }: Refusal| {
            OpenFailure::NoCamera(match trouble {
                Trouble::Firmware => ZividFault::Firmware(message),
                Trouble::InUse => ZividFault::InUse(message),
                Trouble::OutOfReach => ZividFault::OutOfReach(message),
                _ => ZividFault::NotFound(message),
            })
        };
        let identity = match self.step(&connect, ("its opening", patience.connect), refused)? {
            Answer::Words(Reply::Connected(identity)) => identity,
            other => return Err(unexpected_answer("its opening", &other)),
        };
        let by_source = match &setup.source {
            Source::Serial(serial) => Some(serial),
            _ => None,
        };
        if let Some(expected) = setup.serial.iter().chain(by_source).find(|serial| **serial != identity.serial) {
            let (found, expected) = (identity.serial, expected.clone());
            return Err(OpenFailure::NoCamera(ZividFault::WrongCamera { found, expected }));
        }
        let uses = [
            (Use::Scan, "the settings for 3D shots", setup.scan_yaml, self.scan.hash.clone()),
            (Use::Picture, "the settings for pictures", setup.picture_yaml, self.picture.hash.clone()),
        ];
        for (usage, what, yaml, hash) in uses {
            let refused =
                |refusal: Refusal| OpenFailure::NoCamera(ZividFault::Settings { what, message: refusal.message });
            let request = Request::Settings { usage, yaml, hash };
            match self.step(&request, ("its settings", patience.settings_and_temperatures), refused)? {
                Answer::Words(Reply::Settings(size)) if size == setup.size => {}
                Answer::Words(Reply::Settings(size)) => {
                    let px = |size: Size| [size.width, size.height];
                    let (found_px, expected_px) = (px(size), px(setup.size));
                    return Err(OpenFailure::NoCamera(ZividFault::WrongSize { what, found_px, expected_px }));
                }
                other => return Err(unexpected_answer("its settings", &other)),
            }
        }
        // The data of this scan are not used; it only warms up the SDK.
        let request = Request::Scan { settings: self.scan.hash.clone() };
        let during = "its first shot";
        let refused = |refusal: Refusal| {
            let message = refusal.message;
            OpenFailure::NoCamera(ZividFault::NoShot { during, tries: 1, message })
        };
        match self.step(&request, (during, patience.warm_up), refused)? {
            Answer::Scan(came, _) => {
                self.shared.record_temperature(came.metadata.exposed_ns, came.metadata.lens_c);
                self.last_number = came.metadata.number;
                Ok(identity)
            }
            other => Err(unexpected_answer(during, &other)),
        }
    }

    /// Sends one request of the opening sequence, and returns the reply.
    fn step(
        &mut self,
        request: &Request,
        (during, within): (&'static str, Duration),
        refused: impl FnOnce(Refusal) -> OpenFailure,
    ) -> Result<Answer, OpenFailure> {
        self.send_request(request, within).map_err(|failed| match failed {
            RequestFailure::Lost(error) => OpenFailure::Lost(during, WorkerLoss::from_wire_error(error, within)),
            RequestFailure::Refused(refusal) => refused(refusal),
        })
    }

    /// Sets the state for a running worker whose camera cannot be used because of this fault, and plans the next
    /// search.
    pub(super) fn on_camera_missing(&mut self, fault: ZividFault) {
        self.camera = None;
        let is_known = matches!(&self.shared.status().stage, CameraStage::NoCamera(known) if *known == fault);
        if !is_known {
            self.shared.record_fault(&fault);
            self.shared.set_stage(CameraStage::NoCamera(fault));
        }
    }
}

/// The reason why the camera is not open.
enum OpenFailure {
    Lost(&'static str, WorkerLoss),
    NoCamera(ZividFault),
}

fn unexpected_answer(during: &'static str, answer: &Answer) -> OpenFailure {
    OpenFailure::Lost(during, WorkerLoss::Damaged(answer_name(answer)))
}

/// Returns the delay until the next search. It is short for an absent camera, which may be connected at any time. For a
/// faulty camera it increases each time, because each attempt may expose and heat the camera.
fn search_delay(fault: &ZividFault, last: Duration, shortest: Duration) -> Duration {
    match fault {
        ZividFault::NotFound(_) | ZividFault::InUse(_) | ZividFault::OutOfReach(_) => shortest,
        _ => (2 * last).clamp(shortest, MAX_SEARCH_INTERVAL.max(shortest)),
    }
}

impl Host {
    /// Ends a lost worker, and restarts it if the budget permits.
    pub(super) fn on_worker_lost(&mut self, during: &'static str, loss: WorkerLoss) -> ZividFault {
        if self.shared.is_ending.load(Ordering::Relaxed) {
            // The supervisor is ending, so no fault is reported.
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

    /// Ends the worker; it is not restarted until a person requests it.
    pub(super) fn stop_worker(&mut self, fault: ZividFault) {
        self.end_worker();
        self.shared.record_fault(&fault);
        self.shared.set_stage(CameraStage::Down(fault));
    }

    /// Ends the worker process. If it had already ended by itself, returns how.
    pub(super) fn end_worker(&mut self) -> Option<String> {
        (self.camera, self.takes_clip) = (None, false);
        // The first data of the next worker must not be treated as a repetition of this worker's data.
        (self.last_number, self.scan.last_sum, self.picture.last_sum) = (0, None, None);
        let RunningWorker { link, mut peer } = self.worker.take()?;
        drop(link);
        let how = peer.wait_ended(EXIT_TIMEOUT);
        peer.kill();
        self.shared.status().worker = None;
        how
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_faulty_camera_is_opened_at_increasing_intervals() {
        let wrong = ZividFault::WrongCamera { found: "1".to_owned(), expected: "2".to_owned() };
        let shortest = Duration::from_secs(3);
        let pauses =
            std::iter::successors(Some(Duration::ZERO), |last| Some(search_delay(&wrong, *last, shortest)));
        let pauses_s: Vec<u64> = pauses.skip(1).take(7).map(|pause| pause.as_secs()).collect();
        assert_eq!(pauses_s, [3, 6, 12, 24, 48, 60, 60]);
        let absent = ZividFault::NotFound("none".to_owned());
        assert_eq!(search_delay(&absent, Duration::from_secs(60), shortest), shortest);
    }
}
