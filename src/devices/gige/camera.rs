//! A connected camera: Aravis's objects, which one thread owns, and the data of the camera's frames.
//!
//! Aravis's packet socket is never used: it needs root, and delivers nothing on the loopback interface. Packet size
//! and socket buffer are set to fixed values: the negotiated size may be more than the network permits, and the
//! default buffer has room for only a tenth of a picture.

use super::acceptance::{Acceptance, FrameMetadata, FrameRefusal, FrameRequirements, GapPolicy};
use super::configure::{configure, open_selected};
use super::error::{GigeError, round_to_ms};
use super::format::PixelFormat;
use super::settings::{ExposureMode, Settings};
use super::single_picture::{self, MAX_ATTEMPTS, StillError, TriggeredCamera};
use super::sockets::{rmem_max, socket_buffer_bytes};
use super::statistics::Statistics;
use super::streaming::Streaming;
use aravis::GvStreamOption;
use aravis::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Number of pictures within which the first complete one must arrive; the first pictures may be incomplete, because
/// the socket's buffer is set when the first packet arrives.
pub const MAX_FIRST_PICTURES: u32 = 5;

/// Guards Aravis's list of interfaces and cameras, which the whole program shares and which has no lock of its own.
static LIBRARY: Mutex<()> = Mutex::new(());

/// A frame that was accepted.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The frame's facts.
    pub facts: FrameMetadata,
    /// The pixels of the frame, one byte each, row by row.
    pub pixels: Vec<u8>,
    /// The camera's temperature at that time, °C, if the camera reports one.
    pub camera_c: Option<f64>,
}

/// A connected camera.
pub(super) struct ConnectedCamera {
    sensor: Streaming,
    settings: Settings,
    acceptance: Acceptance,
    statistics: Statistics,
}

impl ConnectedCamera {
    /// Finds the camera, configures it, and waits for its first complete picture. Gives up if `is_ending` becomes
    /// true.
    pub fn open(settings: &Settings, is_ending: Arc<AtomicBool>) -> Result<Self, GigeError> {
        let wanted = settings.selector.to_string();
        let device = {
            let _guard = LIBRARY.lock().unwrap_or_else(PoisonError::into_inner);
            open_selected(&settings.selector)?
        };
        if !device.is_controller() {
            return Err(GigeError::Controlled { wanted });
        }
        let lost = Arc::new(AtomicBool::new(false));
        let tells = lost.clone();
        device.connect_control_lost(move |_| tells.store(true, Ordering::Relaxed));
        device.set_stream_options(GvStreamOption::PACKET_SOCKET_DISABLED);
        let not_opened = |why: String| GigeError::NotOpened { wanted: wanted.clone(), why };
        let camera = aravis::Camera::with_device(&device).map_err(|error| not_opened(error.to_string()))?;
        configure(&camera, settings)?;
        let gaps = match settings.exposure_mode {
            ExposureMode::Triggered => GapPolicy::Refused,
            ExposureMode::FreeRunning { .. } => GapPolicy::Counted,
        };
        let Settings { size_px, format, may_repeat, .. } = *settings;
        let acceptance = Acceptance::new(FrameRequirements { size_px, format, gaps, may_repeat });
        let sensor = Streaming::start_stream(camera, settings, lost, is_ending);
        let sensor = sensor.map_err(|gone| not_opened(gone.to_string()))?;
        let (settings, statistics) = (settings.clone(), Statistics::default());
        let mut connected = ConnectedCamera { sensor, settings, acceptance, statistics };
        connected.take_first_complete()?;
        Ok(connected)
    }

    /// Takes pictures until the first complete one; the pictures before it are not counted.
    fn take_first_complete(&mut self) -> Result<(), GigeError> {
        let mut last = "nothing came".to_owned();
        for _ in 0..MAX_FIRST_PICTURES {
            if self.settings.exposure_mode == ExposureMode::Triggered {
                self.sensor.trigger()?;
            }
            match self.sensor.wait()? {
                Some((facts, pixels)) => match self.acceptance.judge(&facts, &pixels) {
                    Ok(()) => return Ok(()),
                    Err(last @ FrameRefusal::WrongForm { format, expected, .. }) if format != expected.code() => {
                        return Err(GigeError::OtherFormat {
                            found: PixelFormat::name_of_code(format),
                            expected,
                            last,
                        });
                    }
                    Err(refused) => last = refused.to_string(),
                },
                None => last = "nothing came".to_owned(),
            }
        }
        Err(GigeError::NoCompletePicture {
            tries: MAX_FIRST_PICTURES,
            packet_bytes: self.settings.packet_bytes,
            rmem_max: rmem_max().map_or("unknown".to_owned(), |bytes| bytes.to_string()),
            wanted_bytes: socket_buffer_bytes(self.settings.size_px, self.settings.packet_bytes),
            last,
        })
    }

    /// Takes a picture that is exposed now.
    pub fn take_still(&mut self) -> Result<Frame, GigeError> {
        let taken = single_picture::capture(&mut self.sensor, &mut self.acceptance, &mut self.statistics);
        let camera_c = if taken.is_ok() { self.sensor.temperature_c() } else { None };
        taken.map(|(facts, pixels)| Frame { facts, pixels, camera_c }).map_err(|none| match none {
            StillError::Gone(gone) => gone,
            StillError::Timeout => {
                GigeError::Timeout { waited_ms: round_to_ms(MAX_ATTEMPTS * self.settings.picture_timeout()) }
            }
            StillError::Refused(last) => GigeError::Refused { tries: MAX_ATTEMPTS, last },
            StillError::Frozen(last) => GigeError::Frozen { last },
        })
    }

    /// Returns the next acceptable picture of a free running camera.
    pub fn next(&mut self) -> Result<Frame, GigeError> {
        let begun = Instant::now();
        while begun.elapsed() < self.settings.picture_timeout() * MAX_ATTEMPTS {
            let Some((facts, pixels)) = self.sensor.wait()? else { break };
            match self.acceptance.judge(&facts, &pixels) {
                Ok(()) => {
                    self.statistics.accepted += 1;
                    return Ok(Frame { facts, pixels, camera_c: self.sensor.temperature_c() });
                }
                Err(refused) => {
                    tracing::debug!("{refused}");
                    self.statistics.refused += 1;
                }
            }
        }
        self.statistics.timeouts += 1;
        Err(GigeError::Timeout { waited_ms: round_to_ms(begun.elapsed()) })
    }

    /// Checks whether the camera has reported that it is gone.
    pub fn check_connected(&self) -> Result<(), GigeError> {
        self.sensor.check_streaming()
    }

    /// Returns what was counted since the camera was connected.
    pub fn statistics(&self) -> Statistics {
        let packets = self.sensor.packet_counts();
        Statistics {
            lost: self.acceptance.missing_frames(),
            clock_steps: self.acceptance.clock_steps(),
            unarmed: self.sensor.unarmed,
            packets: packets.received,
            resent_packets: packets.resent,
            missing_packets: packets.missing,
            underruns: packets.underruns,
            ..self.statistics
        }
    }
}
