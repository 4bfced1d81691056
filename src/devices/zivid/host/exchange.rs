//! Sends one request to a ready camera and checks its answer.

use super::{CameraAnswer, CameraRequest, Host, MAX_ATTEMPTS, RequestFailure, WorkerLoss, answer_name};
use crate::zivid::accept::{self, ExpectedShot};
use crate::zivid::fault::ZividFault;
use crate::zivid::message::{Refusal, Reply, Request, Source, Trouble, now_ns};
use crate::zivid::process::{Answer, ShotDelivery};
use crate::zivid::wire::WireError;
use std::time::{Duration, Instant};

impl Host {
    pub(super) fn send_request(&mut self, request: &Request, within: Duration) -> Result<Answer, RequestFailure> {
        let worker = self.worker.as_mut().ok_or(WireError::Ended)?;
        match worker.link.send_and_receive(request, within)? {
            Answer::Words(Reply::Refused(refusal)) => Err(RequestFailure::Refused(refusal)),
            answer => Ok(answer),
        }
    }

    /// Sends a request to a camera that is ready.
    pub(super) fn request_from_ready(&mut self, ask: CameraRequest) -> Result<CameraAnswer, ZividFault> {
        let (scan, picture) = (self.scan.hash.clone(), self.picture.hash.clone());
        let within = self.setup.timeouts.timeout(ask);
        let request = match ask {
            CameraRequest::Scan => Request::Scan { settings: scan },
            CameraRequest::Picture => Request::Picture { settings: picture },
            CameraRequest::BeginClip(pictures_per_second) => {
                self.clip_from_ns = now_ns();
                Request::BeginClip { settings: picture, pictures_per_second }
            }
            CameraRequest::NextPicture => Request::NextPicture,
            CameraRequest::EndClip => Request::EndClip,
            CameraRequest::Intrinsics => Request::Intrinsics { settings: scan },
            CameraRequest::Check => Request::State,
            CameraRequest::Light => Request::Light,
        };
        // Every request except the one for the next picture ends a clip.
        self.takes_clip =
            matches!(ask, CameraRequest::BeginClip(_)) || self.takes_clip && ask == CameraRequest::NextPicture;
        let during = ask.describe();
        let mut tries = 0;
        loop {
            tries += 1;
            let from_ns = if ask == CameraRequest::NextPicture { self.clip_from_ns } else { now_ns() };
            let message = match self.send_request(&request, within) {
                Ok(answer) => match self.check_answer(ask, from_ns, answer) {
                    // The camera's own buffer may have delivered the previous shot once more.
                    Err(ZividFault::Frozen(_)) if tries < 2 => continue,
                    other => return other.inspect_err(|fault| self.shared.record_fault(fault)),
                },
                Err(RequestFailure::Lost(error)) => {
                    return Err(self.on_worker_lost(during, WorkerLoss::from_wire_error(error, within)));
                }
                Err(RequestFailure::Refused(refusal)) => {
                    if let Some(fault) = self.refused(ask, &refusal) {
                        return Err(fault);
                    }
                    refusal.message
                }
            };
            if tries >= MAX_ATTEMPTS {
                let fault = ZividFault::NoShot { during, tries, message };
                self.shared.record_fault(&fault);
                return Err(fault);
            }
        }
    }

    /// Returns the fault of a refusal; none if another attempt may help.
    fn refused(&mut self, ask: CameraRequest, refusal: &Refusal) -> Option<ZividFault> {
        let (during, message) = (ask.describe(), refusal.message.clone());
        let is_shot = matches!(ask, CameraRequest::Scan | CameraRequest::Picture);
        match refusal.trouble {
            Trouble::Gone | Trouble::NotFound | Trouble::Firmware | Trouble::InUse | Trouble::OutOfReach => {
                let fault = ZividFault::Lost { during, message };
                self.search = Instant::now();
                self.on_camera_missing(fault.clone());
                Some(fault)
            }
            Trouble::NoShot if is_shot => None,
            Trouble::NoShot => Some(ZividFault::NoShot { during, tries: 1, message }),
            Trouble::Settings | Trouble::OutOfOrder => Some(ZividFault::OutOfOrder { during, message }),
        }
        .inspect(|fault| {
            if !matches!(fault, ZividFault::Lost { .. }) {
                self.shared.record_fault(fault);
            }
        })
    }

    /// Checks an answer against the request.
    fn check_answer(
        &mut self,
        ask: CameraRequest,
        from_ns: u64,
        answer: Answer,
    ) -> Result<CameraAnswer, ZividFault> {
        match (ask, answer) {
            (CameraRequest::Scan, Answer::Scan(came, planes)) => {
                self.accept_shot(ask, from_ns, &came, false)?;
                accept::accept_points(&planes)?;
                if came.metadata.throttled_ms > 0.0 {
                    tracing::warn!("the 3D camera paused for {:.0} ms to cool", came.metadata.throttled_ms);
                }
                Ok(CameraAnswer::Scan(came, planes))
            }
            (CameraRequest::Picture | CameraRequest::NextPicture, Answer::Picture(came, rgb)) => {
                // If a scene is black or white, all its pictures are the same; the evaluation of the pictures
                // reports that.
                let is_plain = rgb.windows(2).all(|two| two[0] == two[1]);
                self.accept_shot(ask, from_ns, &came, is_plain)?;
                accept::accept_pause(&came.metadata, ask.describe())?;
                Ok(CameraAnswer::Picture(came, rgb))
            }
            (CameraRequest::BeginClip(_), Answer::Words(Reply::ClipBegun)) => Ok(CameraAnswer::Done),
            (CameraRequest::EndClip, Answer::Words(Reply::ClipEnded(end))) => Ok(CameraAnswer::Clip(end)),
            (CameraRequest::Intrinsics, Answer::Words(Reply::Intrinsics(lens))) => Ok(CameraAnswer::Lens(lens)),
            (CameraRequest::Check, Answer::Words(Reply::State(temperatures))) => {
                self.shared.record_temperature(now_ns(), temperatures.lens_c);
                Ok(CameraAnswer::State(temperatures))
            }
            (CameraRequest::Light, Answer::Words(Reply::Light(light))) => Ok(CameraAnswer::Light(light)),
            (_, other) => Err(self.on_worker_lost(ask.describe(), WorkerLoss::Damaged(answer_name(&other)))),
        }
    }

    fn accept_shot(
        &mut self,
        ask: CameraRequest,
        from_ns: u64,
        came: &ShotDelivery,
        may_repeat: bool,
    ) -> Result<(), ZividFault> {
        let is_file = matches!(self.setup.source, Source::File(_));
        let (size, last_number) = (self.setup.size, self.last_number);
        let serial = self.camera.as_ref().map(|camera| camera.serial.clone()).unwrap_or_default();
        let taking = if ask == CameraRequest::Scan { &mut self.scan } else { &mut self.picture };
        let last_sum = taking.last_sum.filter(|_| !is_file && !may_repeat);
        let settings = taking.hash.clone();
        let until_ns = came.arrived_ns;
        let asked =
            ExpectedShot { what: ask.describe(), settings, serial, size, from_ns, until_ns, last_number, last_sum };
        accept::accept(&came.metadata, came.sum, &asked)?;
        taking.last_sum = Some(came.sum);
        self.last_number = came.metadata.number;
        self.shared.record_temperature(came.metadata.exposed_ns, came.metadata.lens_c);
        Ok(())
    }
}
