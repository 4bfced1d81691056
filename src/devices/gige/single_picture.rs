//! A single picture on demand: trigger, wait for the frame, check it, with a limited number of attempts. Also the
//! statistics of a camera's link since the program was started.
//!
//! A frame that did not arrive in time may still be in transit, and could be mistaken for the frame of the next
//! trigger. So after each failed attempt a new stream is started, in which no frame of an older exposure can arrive. If
//! a camera delivers an old scene in two consecutive attempts, it is frozen; no third attempt is made.

use super::acceptance::{Acceptance, FrameMetadata, FrameRefusal};

/// Maximum number of triggers for one single picture.
pub const MAX_ATTEMPTS: u32 = 3;

/// Counters of frames, packets and losses, summed over all connections of the camera.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Number of accepted frames.
    pub accepted: u64,
    /// Number of frames that were received and refused.
    pub refused: u64,
    /// Number of missing frames of a free-running camera, from the gaps in the frame numbers.
    pub lost: u64,
    /// Number of triggers after which no frame arrived in time.
    pub timeouts: u64,
    /// Number of triggers that repeated a failed attempt.
    pub retries: u64,
    /// Number of triggers that were sent although the camera did not report that it was ready.
    pub unarmed: u64,
    /// Number of times the camera's clock was set back.
    pub clock_steps: u64,
    /// Number of received packets.
    pub packets: u64,
    /// Number of packets that arrived only after they were requested again.
    pub resent_packets: u64,
    /// Number of packets that never arrived.
    pub missing_packets: u64,
    /// Number of frames for which no buffer was free.
    pub underruns: u64,
    /// Number of times the connection to the camera was lost.
    pub losses: u64,
    /// Number of times the camera was connected.
    pub connections: u64,
}

impl Statistics {
    /// Returns the sums of these statistics and `other`.
    pub fn plus(self, other: Statistics) -> Self {
        Statistics {
            accepted: self.accepted + other.accepted,
            refused: self.refused + other.refused,
            lost: self.lost + other.lost,
            timeouts: self.timeouts + other.timeouts,
            retries: self.retries + other.retries,
            unarmed: self.unarmed + other.unarmed,
            clock_steps: self.clock_steps + other.clock_steps,
            packets: self.packets + other.packets,
            resent_packets: self.resent_packets + other.resent_packets,
            missing_packets: self.missing_packets + other.missing_packets,
            underruns: self.underruns + other.underruns,
            losses: self.losses + other.losses,
            connections: self.connections + other.connections,
        }
    }
}

impl std::fmt::Display for Statistics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Statistics { accepted, refused, lost, timeouts, retries, .. } = self;
        let Statistics { unarmed, clock_steps, .. } = self;
        let Statistics { packets, resent_packets, missing_packets, underruns, losses, connections, .. } = self;
        write!(
            f,
            "{accepted} frames accepted, {refused} refused, {lost} lost, {timeouts} timeouts, {retries} retries, \
             {unarmed} triggered before ready, {clock_steps} backward steps of its clock; {packets} packets, \
             {resent_packets} requested again, {missing_packets} missing, {underruns} without a buffer; connected \
             {connections} times, lost {losses} times"
        )
    }
}

/// A camera that exposes on demand.
pub trait TriggeredCamera {
    /// The error if the connection to the camera is lost.
    type Gone;

    /// Triggers one exposure; frames that were received before are discarded.
    ///
    /// # Errors
    /// If the connection to the camera is lost.
    fn trigger(&mut self) -> Result<(), Self::Gone>;

    /// Waits for the next frame; returns `None` if no frame arrives in time.
    ///
    /// # Errors
    /// If the connection to the camera is lost.
    fn wait(&mut self) -> Result<Option<(FrameMetadata, Vec<u8>)>, Self::Gone>;

    /// Starts a new stream, in which no frame of an earlier exposure can arrive.
    ///
    /// # Errors
    /// If the connection to the camera is lost.
    fn renew(&mut self) -> Result<(), Self::Gone>;
}

/// The reason why no single picture was captured.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SinglePictureError<G> {
    /// The connection to the camera is lost.
    Gone(G),
    /// In the last attempt, no frame arrived in time.
    Timeout,
    /// In the last attempt, the frame could not be used.
    Refused(FrameRefusal),
    /// The camera delivered an old scene in two consecutive attempts.
    Frozen(FrameRefusal),
}

/// Captures a single picture, with up to [`MAX_ATTEMPTS`] attempts.
///
/// # Errors
/// If no attempt delivers a usable frame.
pub fn capture<S: TriggeredCamera>(
    shutter: &mut S,
    acceptance: &mut Acceptance,
    statistics: &mut Statistics,
) -> Result<(FrameMetadata, Vec<u8>), SinglePictureError<S::Gone>> {
    let mut last: Option<SinglePictureError<S::Gone>> = None;
    for attempt in 0..MAX_ATTEMPTS {
        statistics.retries += u64::from(attempt > 0);
        shutter.trigger().map_err(SinglePictureError::Gone)?;
        let failed = match shutter.wait().map_err(SinglePictureError::Gone)? {
            Some((facts, pixels)) => match acceptance.judge(&facts, &pixels) {
                Ok(()) => {
                    statistics.accepted += 1;
                    return Ok((facts, pixels));
                }
                Err(refused) => {
                    statistics.refused += 1;
                    SinglePictureError::Refused(refused)
                }
            },
            None => {
                statistics.timeouts += 1;
                SinglePictureError::Timeout
            }
        };
        shutter.renew().map_err(SinglePictureError::Gone)?;
        acceptance.new_stream();
        last = match (failed, last) {
            (SinglePictureError::Refused(now), Some(SinglePictureError::Refused(before)))
                if now.is_old_scene() && before.is_old_scene() =>
            {
                return Err(SinglePictureError::Frozen(now));
            }
            (failed, _) => Some(failed),
        };
    }
    Err(last.unwrap_or(SinglePictureError::Timeout))
}

#[cfg(test)]
mod tests {
    use super::super::acceptance::{Delivery, FrameRequirements, GapPolicy};
    use super::super::format::PixelFormat;
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    /// The simulated result of one exposure.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum ExposureResult {
        Good,
        Torn,
        Late,
        Nothing,
        /// The frame repeats the pixels of the first exposure.
        Old,
        Gone,
    }

    /// A camera whose result for each exposure is scripted; the pixels contain the number of the exposure.
    struct ScriptedCamera {
        fates: VecDeque<ExposureResult>,
        exposures: u64,
        id: u64,
        coming: VecDeque<(FrameMetadata, Vec<u8>)>,
        renewed: u32,
    }

    impl ScriptedCamera {
        fn new(fates: &[ExposureResult]) -> Self {
            let (fates, coming) = (fates.iter().copied().collect(), VecDeque::new());
            ScriptedCamera { fates, exposures: 0, id: 0, coming, renewed: 0 }
        }

        fn frame(&mut self, delivery: Delivery, shows: u64) -> (FrameMetadata, Vec<u8>) {
            self.id += 1;
            let format = PixelFormat::Mono8.code();
            let facts = FrameMetadata { delivery, id: self.id, camera_time_ns: shows, size_px: [4, 2], format };
            (facts, (0..8).map(|pixel| (shows * 16 + pixel) as u8).collect())
        }
    }

    impl TriggeredCamera for ScriptedCamera {
        type Gone = ();

        fn trigger(&mut self) -> Result<(), ()> {
            // As in Aravis, frames in the buffers are discarded, but frames in transit are not.
            self.exposures += 1;
            let shows = self.exposures;
            match self.fates.front() {
                Some(ExposureResult::Gone) => return Err(()),
                Some(ExposureResult::Good) | None => {
                    let frame = self.frame(Delivery::Complete, shows);
                    self.coming.push_back(frame);
                }
                Some(ExposureResult::Torn) => {
                    let frame = self.frame(Delivery::MissingPackets, shows);
                    self.coming.push_back(frame);
                }
                Some(ExposureResult::Old) => {
                    let frame = self.frame(Delivery::Complete, 1);
                    self.coming.push_back(frame);
                }
                Some(ExposureResult::Late | ExposureResult::Nothing) => {}
            }
            Ok(())
        }

        fn wait(&mut self) -> Result<Option<(FrameMetadata, Vec<u8>)>, ()> {
            let fate = self.fates.pop_front();
            if fate == Some(ExposureResult::Late) {
                let shows = self.exposures;
                let frame = self.frame(Delivery::Complete, shows);
                self.coming.push_back(frame);
                return Ok(None);
            }
            Ok(self.coming.pop_front())
        }

        fn renew(&mut self) -> Result<(), ()> {
            self.renewed += 1;
            self.coming.clear();
            self.id = 0;
            Ok(())
        }
    }

    fn acceptance() -> Acceptance {
        let (size_px, format) = ([4, 2], PixelFormat::Mono8);
        Acceptance::new(FrameRequirements { size_px, format, gaps: GapPolicy::Refused, may_repeat: false })
    }

    fn take_of(fates: &[ExposureResult]) -> (Result<u8, SinglePictureError<()>>, Statistics) {
        let (mut camera, mut statistics) = (ScriptedCamera::new(fates), Statistics::default());
        let taken = capture(&mut camera, &mut acceptance(), &mut statistics);
        (taken.map(|(_, pixels)| pixels[0] / 16), statistics)
    }

    #[test]
    fn a_single_picture_is_attempted_three_times() {
        use ExposureResult::{Gone, Good, Late, Nothing, Torn};
        assert_eq!(take_of(&[Good]).0, Ok(1));
        let (taken, statistics) = take_of(&[Torn, Nothing, Good]);
        assert_eq!((taken, statistics.retries, statistics.refused, statistics.timeouts), (Ok(3), 2, 1, 1));
        assert_eq!(take_of(&[Nothing, Torn, Nothing, Good]).0, Err(SinglePictureError::Timeout));
        assert!(matches!(take_of(&[Torn; 4]).0, Err(SinglePictureError::Refused(FrameRefusal::Incomplete { .. }))));
        assert_eq!(take_of(&[Torn, Gone]).0, Err(SinglePictureError::Gone(())));
        // The frame of the first exposure arrives while the program waits for the second one, and is not mistaken for
        // it.
        assert_eq!(take_of(&[Late, Good]).0, Ok(2));
    }

    /// Expected result, derived by hand: exposure 1 is accepted, then the camera repeats exposure 1 twice, and no third
    /// attempt is made.
    #[test]
    fn a_frozen_camera_is_reported_at_its_second_old_frame() {
        let mut camera = ScriptedCamera::new(&[ExposureResult::Good]);
        let (mut acceptance, mut statistics) = (acceptance(), Statistics::default());
        capture(&mut camera, &mut acceptance, &mut statistics).expect("good");
        camera.fates = VecDeque::from([ExposureResult::Old, ExposureResult::Old, ExposureResult::Good]);
        let frozen = capture(&mut camera, &mut acceptance, &mut statistics).expect_err("frozen");
        assert!(matches!(frozen, SinglePictureError::Frozen(FrameRefusal::NotNewer { .. })), "{frozen:?}");
        assert_eq!((statistics.accepted, statistics.refused), (1, 2));
    }

    proptest! {
        /// In every case a single picture shows its own exposure, and at most three triggers are sent.
        #[test]
        fn a_single_picture_shows_its_own_exposure(fates in prop::collection::vec(prop::sample::select(vec![
            ExposureResult::Good, ExposureResult::Torn, ExposureResult::Late, ExposureResult::Nothing]), 1..40)) {
            let (mut camera, mut acceptance, mut statistics) = (ScriptedCamera::new(&fates), acceptance(), Statistics::default());
            for _ in 0..fates.len() {
                let before = camera.exposures;
                let taken = capture(&mut camera, &mut acceptance, &mut statistics);
                prop_assert!(camera.exposures - before <= u64::from(MAX_ATTEMPTS));
                if let Ok((facts, pixels)) = taken {
                    prop_assert_eq!(facts.camera_time_ns, camera.exposures);
                    prop_assert_eq!(pixels[0], (camera.exposures * 16) as u8);
                }
            }
        }
    }
}
