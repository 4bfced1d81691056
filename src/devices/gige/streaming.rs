//! The stream of a camera: frames from Aravis's buffers, either on demand or from a free-running camera.

use super::acceptance::{Delivery, FrameMetadata};
use super::error::GigeError;
use super::network::socket_buffer_bytes;
use super::settings::Settings;
use super::single_picture::TriggeredCamera;
use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{BufferPayloadType, BufferStatus, GvStream, GvStreamPacketResend, GvStreamSocketBuffer};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Number of buffers: the number of pictures that Aravis can receive before the first one is fetched.
const BUFFER_COUNT: usize = 8;
/// Time limits for the rest of a picture, and for a packet that was requested again, µs.
const FRAME_RETENTION_US: u32 = 200_000;
const PACKET_TIMEOUT_US: u32 = 20_000;
/// Interval at which the connection to the camera is checked while the program waits for a picture.
const CONNECTION_CHECK_INTERVAL: Duration = Duration::from_millis(50);
/// Interval at which the program checks whether the sensor is ready for its trigger.
const TRIGGER_POLL_INTERVAL: Duration = Duration::from_millis(2);
/// The node that reports whether the sensor is ready for a trigger; not every camera has it.
const ARMED_NODE: &str = "TriggerArmed";
/// Maximum number of triggers for which the program waits in vain for the ready signal: some models report it only
/// after the first trigger, and some never.
const MAX_UNARMED_WAITS: u64 = 3;
/// Size of the buffers, bytes per pixel. With two bytes, a picture arrives completely even if its format has more bits
/// than the format that was set, and its format can be reported.
const BUFFER_BYTES_PER_PIXEL: usize = 2;
/// The node with the camera's temperature; not every camera has it.
const TEMPERATURE_NODE: &str = "DeviceTemperature";

/// A configured camera and its stream.
pub(super) struct Streaming {
    // `stream` is declared before the camera because it must be dropped first.
    stream: Option<GvStream>,
    camera: aravis::Camera,
    payload: usize,
    socket_bytes: usize,
    picture_timeout: Duration,
    reports_armed: bool,
    reports_temperature: bool,
    /// Number of triggers that were sent although the camera did not report that it was ready.
    pub unarmed: u64,
    /// Whether the camera has reported the loss of its connection.
    pub lost: Arc<AtomicBool>,
    /// Whether the camera's link is ending, so that no more pictures are requested.
    is_ending: Arc<AtomicBool>,
    /// The packet counts of the streams that have ended.
    earlier_counts: PacketCounts,
}

/// Aravis's counters of one stream.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PacketCounts {
    pub received: u64,
    pub resent: u64,
    pub missing: u64,
    pub underruns: u64,
}

impl Streaming {
    /// Begins to stream.
    pub fn start_stream(
        camera: aravis::Camera,
        settings: &Settings,
        lost: Arc<AtomicBool>,
        is_ending: Arc<AtomicBool>,
    ) -> Result<Self, GigeError> {
        let payload = camera.payload().map_err(gone_error)? as usize;
        let has = |node| camera.is_feature_available(node).unwrap_or(false);
        let (tells_armed, tells_temperature) = (has(ARMED_NODE), has(TEMPERATURE_NODE));
        let (patience, ended) = (settings.picture_timeout(), PacketCounts::default());
        let socket_bytes = socket_buffer_bytes(settings.size_px, settings.packet_bytes);
        let mut streaming = Streaming {
            stream: None,
            camera,
            payload,
            socket_bytes,
            picture_timeout: patience,
            reports_armed: tells_armed,
            reports_temperature: tells_temperature,
            unarmed: 0,
            lost,
            is_ending,
            earlier_counts: ended,
        };
        streaming.start()?;
        Ok(streaming)
    }

    fn start(&mut self) -> Result<(), GigeError> {
        let stream = self.camera.create_stream().map_err(gone_error)?;
        let stream = stream
            .downcast::<GvStream>()
            .map_err(|_| GigeError::Lost { why: "the camera's stream is not a GigE Vision stream".to_owned() })?;
        stream.set_socket_buffer(GvStreamSocketBuffer::Fixed);
        stream.set_socket_buffer_size(i32::try_from(self.socket_bytes).unwrap_or(i32::MAX));
        stream.set_packet_resend(GvStreamPacketResend::Always);
        stream.set_frame_retention(FRAME_RETENTION_US);
        stream.set_packet_timeout(PACKET_TIMEOUT_US);
        for _ in 0..BUFFER_COUNT {
            stream.push_buffer(aravis::Buffer::new_allocate(BUFFER_BYTES_PER_PIXEL * self.payload));
        }
        self.stream = Some(stream);
        self.camera.start_acquisition().map_err(gone_error)
    }

    /// Checks that the camera is connected and that the link is not ending.
    pub fn check_streaming(&self) -> Result<(), GigeError> {
        let lost = |why: &str| Err(GigeError::Lost { why: why.to_owned() });
        match () {
            () if self.is_ending.load(Ordering::Relaxed) => lost("the program ends"),
            () if self.lost.load(Ordering::Relaxed) => lost("the camera does not respond to the heartbeat"),
            () => Ok(()),
        }
    }

    /// Returns the packet counts since the camera was opened.
    pub fn packet_counts(&self) -> PacketCounts {
        self.earlier_counts.plus(self.stream.as_ref().map(PacketCounts::from_stream).unwrap_or_default())
    }

    /// Returns the camera's temperature, °C, if the camera reports one.
    pub fn temperature_c(&self) -> Option<f64> {
        self.reports_temperature.then(|| self.camera.float(TEMPERATURE_NODE).ok()).flatten()
    }

    /// Waits until the camera is ready for a trigger, because most cameras ignore a trigger during sensor readout. If
    /// the camera does not report in time that it is ready, it is triggered anyway, and the trigger is counted. If the
    /// camera ignores the trigger, the picture is missing, which is detected.
    fn wait_until_armed(&mut self) -> Result<(), GigeError> {
        let begun = Instant::now();
        while self.reports_armed && !self.camera.boolean(ARMED_NODE).map_err(gone_error)? {
            self.check_streaming()?;
            if begun.elapsed() > self.picture_timeout {
                self.unarmed += 1;
                if self.unarmed >= MAX_UNARMED_WAITS {
                    tracing::warn!(
                        "the camera never reports that it is ready for its trigger ({ARMED_NODE}); the program triggers the \
                         camera without this report"
                    );
                    self.reports_armed = false;
                }
                break;
            }
            std::thread::sleep(TRIGGER_POLL_INTERVAL);
        }
        Ok(())
    }
}

impl TriggeredCamera for Streaming {
    type Gone = GigeError;

    fn trigger(&mut self) -> Result<(), GigeError> {
        self.check_streaming()?;
        if let Some(stream) = &self.stream {
            while let Some(old) = stream.try_pop_buffer() {
                stream.push_buffer(old);
            }
        }
        self.wait_until_armed()?;
        self.camera.software_trigger().map_err(gone_error)
    }

    fn wait(&mut self) -> Result<Option<(FrameMetadata, Vec<u8>)>, GigeError> {
        let begun = Instant::now();
        while begun.elapsed() < self.picture_timeout {
            self.check_streaming()?;
            let Some(stream) = &self.stream else { return Ok(None) };
            let Some(buffer) = stream.timeout_pop_buffer(CONNECTION_CHECK_INTERVAL.as_micros() as u64) else {
                continue;
            };
            let frame = read(&buffer);
            stream.push_buffer(buffer);
            return Ok(Some(frame));
        }
        Ok(None)
    }

    fn renew(&mut self) -> Result<(), GigeError> {
        self.check_streaming()?;
        self.camera.stop_acquisition().map_err(gone_error)?;
        if let Some(stream) = self.stream.take() {
            self.earlier_counts = self.earlier_counts.plus(PacketCounts::from_stream(&stream));
        }
        self.start()
    }
}

impl Drop for Streaming {
    fn drop(&mut self) {
        if !self.lost.load(Ordering::Relaxed) {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "best effort: a camera without a controlling client stops by itself"
            )]
            let _ = self.camera.stop_acquisition();
        }
    }
}

impl PacketCounts {
    fn from_stream(stream: &GvStream) -> Self {
        let count = |name| stream.info_uint64_by_name(name);
        PacketCounts {
            received: count("n_received_packets"),
            resent: count("n_resent_packets"),
            missing: count("n_missing_packets"),
            underruns: count("n_underruns"),
        }
    }

    fn plus(self, other: PacketCounts) -> Self {
        PacketCounts {
            received: self.received + other.received,
            resent: self.resent + other.resent,
            missing: self.missing + other.missing,
            underruns: self.underruns + other.underruns,
        }
    }
}

/// Returns the metadata of a frame, and its pixels if the frame is complete. For incomplete frames Aravis knows neither
/// size nor format.
fn read(buffer: &aravis::Buffer) -> (FrameMetadata, Vec<u8>) {
    let is_image = buffer.payload_type() == BufferPayloadType::Image;
    let delivery = match buffer.status() {
        BufferStatus::Success if is_image => Delivery::Complete,
        BufferStatus::MissingPackets | BufferStatus::WrongPacketId => Delivery::MissingPackets,
        BufferStatus::Timeout => Delivery::TimedOut,
        BufferStatus::SizeMismatch => Delivery::SizeMismatch,
        _ => Delivery::Broken,
    };
    let mut facts =
        FrameMetadata { delivery, id: buffer.frame_id(), camera_time_ns: 0, size_px: [0; 2], format: 0 };
    if delivery != Delivery::Complete {
        return (facts, Vec::new());
    }
    let length = |px: i32| usize::try_from(px).unwrap_or_default();
    facts.camera_time_ns = buffer.timestamp();
    facts.size_px = [length(buffer.image_width()), length(buffer.image_height())];
    facts.format = buffer.image_pixel_format().raw();
    (facts, buffer.image_data())
}

/// Returns the error for a camera that does not respond.
pub(super) fn gone_error(error: aravis::glib::Error) -> GigeError {
    GigeError::Lost { why: error.to_string() }
}
