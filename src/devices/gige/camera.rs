//! A camera that is connected: Aravis's objects, which one thread owns.
//!
//! Aravis's packet socket is never used: it needs root, and delivers nothing on the loopback interface. Packet size and
//! socket buffer are set outright: what is negotiated may be more than the way lets through, and the default buffer holds a
//! tenth of a picture.

use super::acceptance::{Acceptance, Delivery, Expected, Facts, Gaps};
use super::error::GigeError;
use super::settings::{Exposing, Settings, Step, Which, plan};
use super::statistics::Statistics;
use super::still::{self, NoStill, Shutter, TRIES};
use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{
    BufferPayloadType, BufferStatus, GvDevice, GvInterface, GvPacketSizeAdjustment, GvStream, GvStreamOption,
    GvStreamPacketResend, GvStreamSocketBuffer,
};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// What the kernel keeps of packets that were not fetched yet: at least two pictures. Granted up to `net.core.rmem_max`.
pub const SOCKET_BUFFER_BYTES: usize = 8 << 20;
/// Pictures that Aravis may fill before the first is fetched.
const BUFFERS: usize = 8;
/// Pictures that may be torn before the first whole one: the socket is sized when the first packet comes.
const WARM_UP: u32 = 5;
/// From trigger to picture, besides the exposure.
const PATIENCE: Duration = Duration::from_millis(1_000);
/// How long the rest of a picture is waited for, and a packet that was asked for once more, µs.
const FRAME_RETENTION_US: u32 = 200_000;
const PACKET_TIMEOUT_US: u32 = 20_000;
/// The wait for a picture looks this often whether the camera is still there.
const GLANCE: Duration = Duration::from_millis(50);

/// Aravis's list of interfaces and cameras is one for the whole program and not guarded.
static LIBRARY: Mutex<()> = Mutex::new(());

/// A frame that was taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// What is known of it.
    pub facts: Facts,
    /// Its pixels, one byte each, row by row.
    pub pixels: Vec<u8>,
}

/// A connected camera.
pub(super) struct Connected {
    // Dropped in this order.
    stream: Option<GvStream>,
    camera: aravis::Camera,
    settings: Settings,
    payload: usize,
    lost: Arc<AtomicBool>,
    acceptance: Acceptance,
    statistics: Statistics,
    /// What streams that have ended counted.
    ended: Packets,
}

/// Aravis's counters of one stream.
#[derive(Debug, Clone, Copy, Default)]
struct Packets {
    received: u64,
    resent: u64,
    missing: u64,
    underruns: u64,
}

impl Connected {
    /// Finds the camera, sets it, and waits for its first whole picture.
    pub fn open(settings: &Settings) -> Result<Self, GigeError> {
        let wanted = settings.which.to_string();
        let device = {
            let _guard = LIBRARY.lock().unwrap_or_else(PoisonError::into_inner);
            found(&settings.which)?
        };
        if !device.is_controller() {
            return Err(GigeError::Controlled { wanted });
        }
        let lost = Arc::new(AtomicBool::new(false));
        let tells = lost.clone();
        device.connect_control_lost(move |_| tells.store(true, Ordering::Relaxed));
        device.set_stream_options(GvStreamOption::PACKET_SOCKET_DISABLED);
        let not_opened =
            |error: aravis::glib::Error| GigeError::NotOpened { wanted: wanted.clone(), why: error.to_string() };
        let camera = aravis::Camera::with_device(&device).map_err(not_opened)?;
        configure(&camera, settings)?;
        let payload = camera.payload().map_err(not_opened)? as usize;
        let gaps = match settings.exposing {
            Exposing::OnTrigger => Gaps::Refused,
            Exposing::Freely { .. } => Gaps::Counted,
        };
        let Settings { size_px, format, may_repeat, .. } = *settings;
        let acceptance = Acceptance::new(Expected { size_px, format, gaps, may_repeat });
        let (settings, statistics) = (settings.clone(), Statistics::default());
        let ended = Packets::default();
        let mut connected =
            Connected { stream: None, camera, settings, payload, lost, acceptance, statistics, ended };
        connected.start().map_err(|gone| GigeError::NotOpened { wanted, why: gone.to_string() })?;
        connected.warm_up()?;
        Ok(connected)
    }

    /// Until the first whole picture; what comes before is not counted.
    fn warm_up(&mut self) -> Result<(), GigeError> {
        let mut last = "nothing came".to_owned();
        for _ in 0..WARM_UP {
            if self.settings.exposing == Exposing::OnTrigger {
                self.trigger()?;
            }
            match self.wait()? {
                Some((facts, pixels)) => match self.acceptance.judge(&facts, &pixels) {
                    Ok(()) => return Ok(()),
                    Err(refused) => last = refused.to_string(),
                },
                None => last = "nothing came".to_owned(),
            }
        }
        Err(GigeError::NothingWhole {
            tries: WARM_UP,
            packet_bytes: self.settings.packet_bytes,
            rmem_max: rmem_max().map_or("unknown".to_owned(), |bytes| bytes.to_string()),
            wanted_bytes: SOCKET_BUFFER_BYTES,
            last,
        })
    }

    /// A picture that is exposed now.
    pub fn still(&mut self) -> Result<Frame, GigeError> {
        // Both are moved out, since the rest of the camera is the shutter.
        let mut acceptance = self.acceptance.clone();
        let mut statistics = self.statistics;
        let taken = still::take(self, &mut acceptance, &mut statistics);
        (self.acceptance, self.statistics) = (acceptance, statistics);
        taken.map(|(facts, pixels)| Frame { facts, pixels }).map_err(|none| match none {
            NoStill::Gone(gone) => gone,
            NoStill::Timeout => {
                let each = self.patience().as_millis();
                GigeError::Timeout { waited_ms: u64::try_from(each).unwrap_or(u64::MAX) * u64::from(TRIES) }
            }
            NoStill::Refused(last) => GigeError::Refused { tries: TRIES, last },
            NoStill::Frozen(last) => GigeError::Frozen { last },
        })
    }

    /// The next picture of a free running camera that may be taken.
    pub fn next(&mut self) -> Result<Frame, GigeError> {
        let begun = Instant::now();
        while begun.elapsed() < self.patience() * TRIES {
            let Some((facts, pixels)) = self.wait()? else { break };
            match self.acceptance.judge(&facts, &pixels) {
                Ok(()) => {
                    self.statistics.accepted += 1;
                    return Ok(Frame { facts, pixels });
                }
                Err(refused) => {
                    tracing::debug!("{refused}");
                    self.statistics.refused += 1;
                }
            }
        }
        self.statistics.timeouts += 1;
        let waited_ms = u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX);
        Err(GigeError::Timeout { waited_ms })
    }

    /// Whether the camera has told that it is gone.
    pub fn check(&self) -> Result<(), GigeError> {
        match self.lost.load(Ordering::Relaxed) {
            true => Err(GigeError::Lost { why: "it does not answer its heartbeat".to_owned() }),
            false => Ok(()),
        }
    }

    /// What was counted since it was connected.
    pub fn statistics(&self) -> Statistics {
        let now = self.stream.as_ref().map(Packets::of).unwrap_or_default();
        let both = |of: fn(&Packets) -> u64| of(&self.ended) + of(&now);
        Statistics {
            lost: self.acceptance.lost(),
            packets: both(|packets| packets.received),
            resent_packets: both(|packets| packets.resent),
            missing_packets: both(|packets| packets.missing),
            underruns: both(|packets| packets.underruns),
            ..self.statistics
        }
    }

    fn patience(&self) -> Duration {
        PATIENCE + Duration::from_micros(self.settings.exposure_us.unwrap_or_default() as u64)
    }

    fn start(&mut self) -> Result<(), GigeError> {
        let stream = self.camera.create_stream().map_err(gone)?;
        let stream =
            stream.downcast::<GvStream>().map_err(|_| GigeError::Lost { why: "its stream is none".to_owned() })?;
        stream.set_socket_buffer(GvStreamSocketBuffer::Fixed);
        stream.set_socket_buffer_size(SOCKET_BUFFER_BYTES as i32);
        stream.set_packet_resend(GvStreamPacketResend::Always);
        stream.set_frame_retention(FRAME_RETENTION_US);
        stream.set_packet_timeout(PACKET_TIMEOUT_US);
        for _ in 0..BUFFERS {
            stream.push_buffer(aravis::Buffer::new_allocate(self.payload));
        }
        self.stream = Some(stream);
        self.camera.start_acquisition().map_err(gone)
    }
}

impl Shutter for Connected {
    type Gone = GigeError;

    fn trigger(&mut self) -> Result<(), GigeError> {
        self.check()?;
        if let Some(stream) = &self.stream {
            while let Some(old) = stream.try_pop_buffer() {
                stream.push_buffer(old);
            }
        }
        self.camera.software_trigger().map_err(gone)
    }

    fn wait(&mut self) -> Result<Option<(Facts, Vec<u8>)>, GigeError> {
        let begun = Instant::now();
        while begun.elapsed() < self.patience() {
            self.check()?;
            let Some(stream) = &self.stream else { return Ok(None) };
            let Some(buffer) = stream.timeout_pop_buffer(GLANCE.as_micros() as u64) else { continue };
            let frame = read(&buffer);
            stream.push_buffer(buffer);
            return Ok(Some(frame));
        }
        Ok(None)
    }

    fn renew(&mut self) -> Result<(), GigeError> {
        self.check()?;
        self.camera.stop_acquisition().map_err(gone)?;
        if let Some(stream) = self.stream.take() {
            self.ended = self.ended.and(Packets::of(&stream));
        }
        self.start()
    }
}

impl Drop for Connected {
    fn drop(&mut self) {
        if self.check().is_ok() {
            // Best effort: a camera that nobody controls stops by itself.
            let _ = self.camera.stop_acquisition();
        }
    }
}

impl Packets {
    fn of(stream: &GvStream) -> Self {
        let count = |name| stream.info_uint64_by_name(name);
        Packets {
            received: count("n_received_packets"),
            resent: count("n_resent_packets"),
            missing: count("n_missing_packets"),
            underruns: count("n_underruns"),
        }
    }

    fn and(self, other: Packets) -> Self {
        Packets {
            received: self.received + other.received,
            resent: self.resent + other.resent,
            missing: self.missing + other.missing,
            underruns: self.underruns + other.underruns,
        }
    }
}

/// What a socket's receive buffer must be for a picture that comes in one burst, bytes: the kernel counts each packet with its
/// own overhead, and grants twice what it is asked for.
pub fn burst_bytes(size_px: [usize; 2], packet_bytes: u16) -> usize {
    // IP, UDP and GVSP headers of a packet; what the kernel counts for one of these sizes, by powers of two.
    const HEADERS: usize = 36;
    const OVERHEAD: usize = 600;
    let each = (usize::from(packet_bytes) + OVERHEAD).next_power_of_two() + 256;
    let packets = (size_px[0] * size_px[1]).div_ceil(usize::from(packet_bytes).saturating_sub(HEADERS).max(1)) + 2;
    packets * each / 2
}

/// The largest receive buffer that the system gives, bytes, where it says so.
pub fn rmem_max() -> Option<usize> {
    std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok()?.trim().parse().ok()
}

/// A frame's facts, and where it is whole its pixels: of others Aravis knows neither size nor format.
fn read(buffer: &aravis::Buffer) -> (Facts, Vec<u8>) {
    let is_image = buffer.payload_type() == BufferPayloadType::Image;
    let delivery = match buffer.status() {
        BufferStatus::Success if is_image => Delivery::Complete,
        BufferStatus::MissingPackets | BufferStatus::WrongPacketId => Delivery::MissingPackets,
        BufferStatus::Timeout => Delivery::TimedOut,
        BufferStatus::SizeMismatch => Delivery::SizeMismatch,
        _ => Delivery::Broken,
    };
    let mut facts = Facts { delivery, id: buffer.frame_id(), camera_time_ns: 0, size_px: [0; 2], format: 0 };
    if delivery != Delivery::Complete {
        return (facts, Vec::new());
    }
    let length = |px: i32| usize::try_from(px).unwrap_or_default();
    facts.camera_time_ns = buffer.timestamp();
    facts.size_px = [length(buffer.image_width()), length(buffer.image_height())];
    facts.format = buffer.image_pixel_format().raw();
    (facts, buffer.image_data())
}

fn gone(error: aravis::glib::Error) -> GigeError {
    GigeError::Lost { why: error.to_string() }
}

fn found(which: &Which) -> Result<GvDevice, GigeError> {
    let wanted = which.to_string();
    let not_found = |found: String| GigeError::NotFound { wanted: wanted.clone(), found };
    let interface = GvInterface::instance().ok_or_else(|| not_found("Aravis has no GigE Vision".to_owned()))?;
    let id = match which {
        Which::Address(address) => address.clone(),
        Which::Only | Which::Serial(_) => {
            interface.update_device_list();
            let text = |text: Option<aravis::glib::GString>| text.map_or(String::new(), String::from);
            let all: Vec<[String; 3]> = (0..interface.n_devices())
                .map(|at| {
                    [interface.device_id(at), interface.device_serial_nbr(at), interface.device_address(at)]
                        .map(text)
                })
                .collect();
            let told =
                all.iter().map(|[_, serial, address]| format!("serial {serial} at {address}")).collect::<Vec<_>>();
            let told =
                if all.is_empty() { "none answered".to_owned() } else { format!("there is {}", told.join(", ")) };
            let right = all.iter().filter(|[_, serial, _]| match which {
                Which::Serial(wanted) => serial == wanted,
                _ => true,
            });
            match right.collect::<Vec<_>>().as_slice() {
                [[id, ..]] => id.clone(),
                [] => return Err(not_found(told)),
                _ => return Err(not_found(format!("{told}: name one by its serial"))),
            }
        }
    };
    let device = interface.open_device(Some(&id)).map_err(|error| not_found(error.to_string()))?;
    device.downcast::<GvDevice>().map_err(|_| not_found("it is no GigE Vision camera".to_owned()))
}

/// Sets the camera and reads back what a picture's meaning depends on.
fn configure(camera: &aravis::Camera, settings: &Settings) -> Result<(), GigeError> {
    let has = |node: &str| camera.is_feature_available(node).unwrap_or(false);
    for step in plan(settings, &has)? {
        set(camera, &step)?;
    }
    let refused = |node, value: String| {
        move |why: aravis::glib::Error| GigeError::NotTaken { node, value, why: why.to_string() }
    };
    let (bytes, node) = (settings.packet_bytes, "GevSCPSPacketSize");
    camera.gv_set_packet_size_adjustment(GvPacketSizeAdjustment::Never);
    camera.gv_set_packet_size(i32::from(bytes)).map_err(refused(node, bytes.to_string()))?;
    let taken = camera.gv_get_packet_size().map_err(refused(node, bytes.to_string()))?;
    if taken != u32::from(bytes) {
        let why = format!("it made {taken} of it");
        return Err(GigeError::NotTaken { node, value: bytes.to_string(), why });
    }
    let (_, _, width, height) = camera.region().map_err(gone)?;
    let found_px = [width, height].map(|px| usize::try_from(px).unwrap_or_default());
    if found_px != settings.size_px {
        return Err(GigeError::WrongSize { found_px, expected_px: settings.size_px });
    }
    Ok(())
}

/// One step; what was set is read back.
fn set(camera: &aravis::Camera, step: &Step) -> Result<(), GigeError> {
    let (node, value) = match step {
        Step::Command(node) => (*node, "()".to_owned()),
        Step::Choose(node, entry) => (*node, entry.clone()),
        Step::Number(node, number) => (*node, number.to_string()),
        Step::Switch(node, on) => (*node, on.to_string()),
    };
    let not_taken = |why: String| GigeError::NotTaken { node, value: value.clone(), why };
    let refused = |error: aravis::glib::Error| not_taken(error.to_string());
    match step {
        Step::Command(node) => camera.execute_command(node).map_err(refused),
        Step::Switch(node, on) => camera.set_boolean(node, *on).map_err(refused),
        Step::Choose(node, entry) => {
            camera.set_string(node, entry).map_err(|error| {
                let entries = camera.dup_available_enumerations_as_strings(node).unwrap_or_default();
                let entries = entries.iter().map(|entry| entry.as_str()).collect::<Vec<_>>().join(", ");
                not_taken(format!("{error}; it has {entries}"))
            })?;
            let taken = camera.string(node).map_err(refused)?;
            if taken == *entry { Ok(()) } else { Err(not_taken(format!("it made {taken} of it"))) }
        }
        Step::Number(node, number) => {
            let (least, most) = camera.float_bounds(node).map_err(refused)?;
            if !(least..=most).contains(number) {
                return Err(not_taken(format!("it allows {least} to {most}")));
            }
            camera.set_float(node, *number).map_err(refused)?;
            let taken = camera.float(node).map_err(refused)?;
            // A sensor exposes whole rows, an amplifier has steps.
            let near = (taken - number).abs() <= 0.02 * number.abs() + 0.1;
            if near { Ok(()) } else { Err(not_taken(format!("it made {taken} of it"))) }
        }
    }
}
