//! The acceptance check of frames. An accepted frame is complete, has the expected size and format, is newer than the
//! last frame, and has the next frame number.
//!
//! A camera numbers its frames. Numbers of 16 bits count from 1 to 65535 and then from 1 again; numbers of 64 bits do
//! not wrap. 0 is not a valid number. The program treats the numbers as 16 bits wide until the first number above 65535
//! arrives. A frame that was lost completely leaves a gap in the numbers. For a free-running camera the gap is counted.
//! For a single picture the frame is refused, because it is not known to which trigger it belongs.

use super::format::PixelFormat;

/// The result of receiving a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// Every packet arrived.
    Complete,
    /// Packets are missing: they did not arrive in time, even after they were requested again.
    MissingPackets,
    /// The rest of the frame's packets did not arrive in time.
    TimedOut,
    /// The frame is larger than its header states.
    SizeMismatch,
    /// The frame cannot be used for another reason.
    Broken,
}

impl Delivery {
    fn describe(self) -> &'static str {
        match self {
            Delivery::Complete => "complete",
            Delivery::MissingPackets => "packets are missing",
            Delivery::TimedOut => "some packets of the frame did not arrive in time",
            Delivery::SizeMismatch => "the frame is larger than its header states",
            Delivery::Broken => "the packets do not form a picture",
        }
    }
}

/// The data of a frame besides its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameMetadata {
    /// The result of receiving the frame. If the frame is not complete, only its number is valid, and only if its first
    /// packet has arrived. Otherwise the number is that of an earlier frame, or 0.
    pub delivery: Delivery,
    /// The number of the frame.
    pub id: u64,
    /// Time of the exposure on the camera's clock, ns.
    pub camera_time_ns: u64,
    /// Width and height of the frame, px.
    pub size_px: [usize; 2],
    /// The code of the frame's pixel format.
    pub format: u32,
}

/// The requirements for an accepted frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRequirements {
    /// Width and height of the calibrated camera, px.
    pub size_px: [usize; 2],
    /// The pixel format.
    pub format: PixelFormat,
    /// How a gap in the frame numbers is treated.
    pub gaps: GapPolicy,
    /// Whether two consecutive frames may have equal pixels. Frames of a real sensor never do, because of its noise.
    pub may_repeat: bool,
}

/// How a gap in the frame numbers is treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GapPolicy {
    /// Each trigger has one frame: a frame whose number is not the next one is refused.
    Refused,
    /// The camera is free-running: missing frames are counted.
    Counted,
}

/// The reason why a frame is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FrameRefusal {
    /// The frame is incomplete.
    #[error("frame {id} is incomplete: {}", delivery.describe())]
    Incomplete {
        /// The number of the frame.
        id: u64,
        /// The result of receiving the frame.
        delivery: Delivery,
    },
    /// The frame has another size or pixel format.
    #[error(
        "frame {id} is {}×{} with pixel format {format:#010x}, expected {}×{} and {}", found_px[0], found_px[1],
        expected_px[0], expected_px[1], expected.name()
    )]
    WrongForm {
        /// The number of the frame.
        id: u64,
        /// Width and height of the frame, px.
        found_px: [usize; 2],
        /// The code of the frame's pixel format.
        format: u32,
        /// Width and height of the calibrated camera, px.
        expected_px: [usize; 2],
        /// The pixel format that was set.
        expected: PixelFormat,
    },
    /// The number of the frame's bytes does not match its size and format.
    #[error("frame {id} has {found} bytes, but its size needs {expected} bytes")]
    WrongLength {
        /// The number of the frame.
        id: u64,
        /// Number of bytes in the frame.
        found: usize,
        /// Number of bytes that the frame's size and format require.
        expected: usize,
    },
    /// The timestamp of the frame is not later than that of the last accepted frame.
    #[error("frame {id} has the timestamp {found_ns} ns, not later than that of the last frame, {last_ns} ns")]
    NotNewer {
        /// The number of the frame.
        id: u64,
        /// Timestamp of the frame on the camera's clock, ns.
        found_ns: u64,
        /// Timestamp of the last accepted frame, ns.
        last_ns: u64,
    },
    /// The number of the frame is not the next one.
    #[error("frame {id} was received after frame {last}: it does not have the next frame number")]
    OutOfSequence {
        /// The number of the frame.
        id: u64,
        /// Number of the last frame.
        last: u64,
    },
    /// The pixels of the frame are equal to those of the last frame.
    #[error("frame {id} has exactly the same pixels as the last frame")]
    Repeated {
        /// The number of the frame.
        id: u64,
    },
}

impl FrameRefusal {
    /// Returns whether the refused frame shows an earlier scene, because it repeats an earlier frame.
    pub fn is_old_scene(&self) -> bool {
        matches!(
            self,
            FrameRefusal::NotNewer { .. } | FrameRefusal::OutOfSequence { .. } | FrameRefusal::Repeated { .. }
        )
    }
}

/// Returns the number of frames from the last frame to this one: 1 for the next frame. `None` if the frame is earlier
/// or the same, or has no number.
pub fn frames_ahead(last: u64, id: u64) -> Option<u64> {
    const CYCLE: u64 = 65_535;
    match (last, id) {
        (_, 0) => None,
        (last, id) if last > CYCLE || id > CYCLE => id.checked_sub(last).filter(|&ahead| ahead > 0),
        // The numbers wrap, so a difference of half the cycle is ambiguous; the shorter way around determines the
        // direction.
        (last, id) => Some((id + CYCLE - last) % CYCLE).filter(|ahead| (1..=CYCLE / 2).contains(ahead)),
    }
}

/// Checks the frames of a stream in sequence.
#[derive(Debug, Clone)]
pub struct Acceptance {
    expected: FrameRequirements,
    /// The number of the last received frame, accepted or refused.
    last_id: Option<u64>,
    /// The timestamp of the last accepted frame.
    last_time_ns: Option<u64>,
    /// The timestamp of the previous frame, if it was refused because its timestamp was not later than that of the last
    /// accepted frame.
    older_time_ns: Option<u64>,
    clock_steps: u64,
    last_pixels: Vec<u8>,
    lost: u64,
    /// Number of incomplete frames without a number since the last frame that had a number.
    unnumbered: u64,
}

impl Acceptance {
    /// Creates the check for a stream of which no frame was received yet.
    pub fn new(expected: FrameRequirements) -> Self {
        Acceptance {
            expected,
            last_id: None,
            last_time_ns: None,
            older_time_ns: None,
            clock_steps: 0,
            last_pixels: Vec::new(),
            lost: 0,
            unnumbered: 0,
        }
    }

    /// Prepares for a new stream: its frame numbers may start anywhere, while the camera's clock continues.
    pub fn new_stream(&mut self) {
        (self.last_id, self.unnumbered) = (None, 0);
    }

    /// Returns the requirements for a frame.
    pub fn expected(&self) -> FrameRequirements {
        self.expected
    }

    /// Returns the number of missing frames of a free-running camera, from the gaps in the frame numbers.
    pub fn missing_frames(&self) -> u64 {
        self.lost
    }

    /// Returns how many times the camera's clock was set back.
    pub fn clock_steps(&self) -> u64 {
        self.clock_steps
    }

    /// Returns whether the camera's clock was set back, for example by PTP after a change of the master. This is the
    /// case if the previous frame was refused because of its timestamp, and this frame is newer than the previous one.
    /// A camera that repeats one old frame never satisfies this condition.
    fn is_clock_set_back(&self, camera_time_ns: u64) -> bool {
        self.older_time_ns.is_some_and(|older_ns| camera_time_ns > older_ns)
    }

    /// Checks one frame.
    ///
    /// # Errors
    /// If the frame must not be used; the error is the reason.
    pub fn judge(&mut self, facts: &FrameMetadata, pixels: &[u8]) -> Result<(), FrameRefusal> {
        let FrameMetadata { id, delivery, camera_time_ns, size_px, format } = *facts;
        let before = self.last_id;
        let step = before.map_or((id > 0).then_some(1), |last| frames_ahead(last, id));
        if let Some(step) = step {
            self.last_id = Some(id);
            if self.expected.gaps == GapPolicy::Counted {
                self.lost += (step - 1).saturating_sub(self.unnumbered);
            }
            self.unnumbered = 0;
        }
        if delivery != Delivery::Complete {
            self.unnumbered += u64::from(step.is_none());
            return Err(FrameRefusal::Incomplete { id, delivery });
        }
        let FrameRequirements { size_px: expected_px, format: expected, gaps, may_repeat } = self.expected;
        if size_px != expected_px || format != expected.code() {
            return Err(FrameRefusal::WrongForm { id, found_px: size_px, format, expected_px, expected });
        }
        if pixels.len() != size_px[0] * size_px[1] {
            return Err(FrameRefusal::WrongLength { id, found: pixels.len(), expected: size_px[0] * size_px[1] });
        }
        match step {
            Some(1) => {}
            Some(_) if gaps == GapPolicy::Counted => {}
            _ => return Err(FrameRefusal::OutOfSequence { id, last: before.unwrap_or_default() }),
        }
        let not_newer = self.last_time_ns.filter(|&last_ns| camera_time_ns <= last_ns);
        let is_clock_step = not_newer.is_some() && self.is_clock_set_back(camera_time_ns);
        if let Some(last_ns) = not_newer.filter(|_| !is_clock_step) {
            self.older_time_ns = Some(camera_time_ns);
            return Err(FrameRefusal::NotNewer { id, found_ns: camera_time_ns, last_ns });
        }
        // Pictures of uniform brightness, for example with a covered lens, may be equal.
        let plain = pixels.iter().all(|level| Some(level) == pixels.first());
        if !may_repeat && !plain && pixels == self.last_pixels {
            return Err(FrameRefusal::Repeated { id });
        }
        self.clock_steps += u64::from(is_clock_step);
        (self.last_time_ns, self.older_time_ns) = (Some(camera_time_ns), None);
        if !may_repeat {
            self.last_pixels.clear();
            self.last_pixels.extend_from_slice(pixels);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const EXPECTED: FrameRequirements = FrameRequirements {
        size_px: [4, 2],
        format: PixelFormat::BayerRG8,
        gaps: GapPolicy::Refused,
        may_repeat: false,
    };

    fn frame(id: u64) -> FrameMetadata {
        let (size_px, format) = ([4, 2], PixelFormat::BayerRG8.code());
        FrameMetadata { delivery: Delivery::Complete, id, camera_time_ns: 1_000 * id, size_px, format }
    }

    fn pixels(id: u64) -> Vec<u8> {
        (0..8).map(|pixel| (id + 7 * pixel) as u8).collect()
    }

    #[test]
    fn frame_numbers_wrap_at_16_bits_and_continue_at_64() {
        assert_eq!(frames_ahead(65_535, 1), Some(1));
        assert_eq!(frames_ahead(65_535, 65_536), Some(1));
        assert_eq!(frames_ahead(65_530, 3), Some(8));
        assert_eq!(frames_ahead(1 << 40, (1 << 40) + 3), Some(3));
        assert_eq!(
            [
                frames_ahead(7, 7),
                frames_ahead(7, 6),
                frames_ahead(1, 65_535),
                frames_ahead(70_000, 69_999),
                frames_ahead(9, 0)
            ],
            [None; 5]
        );
    }

    #[test]
    fn each_fault_of_a_frame_is_named() {
        let good = frame(8);
        let cases: [(FrameMetadata, Vec<u8>, &str); 7] = [
            (
                FrameMetadata { delivery: Delivery::MissingPackets, ..good },
                vec![],
                "incomplete: packets are missing",
            ),
            (
                FrameMetadata { size_px: [2, 4], ..good },
                pixels(8),
                "is 2×4 with pixel format 0x01080009, expected 4×2",
            ),
            (
                FrameMetadata { format: PixelFormat::Mono8.code(), ..good },
                pixels(8),
                "0x01080001, expected 4×2 and Bayer",
            ),
            (good, vec![1; 7], "has 7 bytes, but its size needs 8"),
            (
                FrameMetadata { camera_time_ns: 7_000, ..good },
                pixels(8),
                "not later than that of the last frame, 7000 ns",
            ),
            (FrameMetadata { id: 10, ..good }, pixels(8), "frame 10 was received after frame 7"),
            (good, pixels(7), "has exactly the same pixels as the last frame"),
        ];
        for (facts, bytes, says) in cases {
            let mut acceptance = Acceptance::new(EXPECTED);
            assert_eq!(acceptance.judge(&frame(7), &pixels(7)), Ok(()));
            let refused = acceptance.judge(&facts, &bytes).expect_err(says).to_string();
            assert!(refused.contains(says), "{refused}");
        }
    }

    /// A covered lens gives equal black pictures, which are accepted. A new stream may start with any number.
    #[test]
    fn equal_black_frames_are_accepted_and_streams_begin_anywhere() {
        let mut acceptance = Acceptance::new(EXPECTED);
        for id in [7, 8] {
            assert_eq!(acceptance.judge(&frame(id), &[0; 8]), Ok(()));
        }
        assert!(acceptance.judge(&frame(5), &pixels(5)).is_err());
        acceptance.new_stream();
        let restarted = FrameMetadata { id: 1, camera_time_ns: 9_000, ..frame(1) };
        assert_eq!(acceptance.judge(&restarted, &pixels(1)), Ok(()));
    }

    /// Expected results, derived by hand: after 8 µs the clock is set back to 1 µs. The first frame with the new time
    /// is refused, the next one is accepted, and then the new time is valid. A repetition of the old frame is never
    /// accepted.
    #[test]
    fn one_picture_is_refused_when_the_clock_is_set_back() {
        let at = |id: u64, camera_time_ns: u64| FrameMetadata { camera_time_ns, ..frame(id) };
        let mut acceptance = Acceptance::new(EXPECTED);
        assert_eq!(acceptance.judge(&at(7, 8_000), &pixels(7)), Ok(()));
        let back = acceptance.judge(&at(8, 1_000), &pixels(8)).expect_err("older");
        assert!(matches!(back, FrameRefusal::NotNewer { .. }), "{back}");
        acceptance.new_stream();
        let same = acceptance.judge(&at(1, 1_000), &pixels(8)).expect_err("the same once more");
        assert!(matches!(same, FrameRefusal::NotNewer { .. }), "{same}");
        acceptance.new_stream();
        assert_eq!(acceptance.judge(&at(1, 1_100), &pixels(9)), Ok(()));
        assert_eq!((acceptance.judge(&at(2, 1_200), &pixels(10)), acceptance.clock_steps()), (Ok(()), 1));
    }

    proptest! {
        /// For any first number and any losses, across both wrap-arounds: an accepted frame is always newer than the
        /// last one, no frame is accepted twice, and for a free-running camera every missing number is counted.
        #[test]
        fn missing_frames_of_a_stream_are_counted(start in prop::sample::select(vec![1u64, 60_000, 65_400, 1 << 33]), wide in any::<bool>(),
            fates in prop::collection::vec(0u8..8, 1..400)) {
            let number = |index: u64| {
                let id = start + index;
                if wide || start > 65_535 { id } else { (id - 1) % 65_535 + 1 }
            };
            let mut acceptance = Acceptance::new(FrameRequirements { gaps: GapPolicy::Counted, may_repeat: true, ..EXPECTED });
            let (mut taken, mut broken, mut numbered) = (0, 0, 0);
            // The first and the last frame are complete, so that the number of frames between them is known.
            let fates: Vec<u8> = [vec![9], fates, vec![9]].concat();
            for (index, fate) in fates.iter().enumerate() {
                let index = index as u64;
                let facts = FrameMetadata { id: number(index), camera_time_ns: 1 + index, ..frame(1) };
                let (facts, expect) = match fate {
                    0 => continue, // lost whole
                    1 => (FrameMetadata { delivery: Delivery::TimedOut, ..facts }, false),
                    // If the first packet is lost, the number is that of the frame that used the buffer before, or 0.
                    2 => (FrameMetadata { delivery: Delivery::TimedOut, id: numbered, ..facts }, false),
                    3 => (FrameMetadata { delivery: Delivery::MissingPackets, id: 0, ..facts }, false),
                    _ => (facts, true),
                };
                numbered = if facts.id > 0 { facts.id } else { numbered };
                prop_assert_eq!(acceptance.judge(&facts, &pixels(index)).is_ok(), expect);
                if expect {
                    taken += 1;
                    // A repetition of the frame is refused.
                    prop_assert!(acceptance.judge(&facts, &pixels(index)).is_err());
                } else {
                    broken += 1;
                }
            }
            prop_assert_eq!(taken + broken + acceptance.missing_frames(), fates.len() as u64);
        }
    }
}
