//! A connected GigE Vision camera: Aravis's objects, which belong to one thread, and the frames. A camera is searched,
//! opened and configured, and its settings are read back.
//!
//! Aravis's packet socket is never used: it requires root, and it receives nothing on the loopback interface. Packet
//! size and socket buffer are set to fixed values: a negotiated packet size may exceed the network's limit, and the
//! default buffer has room for only a tenth of a picture.

use super::acceptance::{Acceptance, FrameMetadata, FrameRefusal, FrameRequirements, GapPolicy};
use super::error::{GigeError, round_to_ms};
use super::format::PixelFormat;
use super::network::{describe_subnets, local_subnets, rmem_max, search, socket_buffer_bytes, unreachable_reason};
use super::settings::{CameraSelector, ExposureMode, SettingStep, Settings, plan};
use super::single_picture::{self, MAX_ATTEMPTS, SinglePictureError, Statistics, TriggeredCamera};
use super::streaming::{Streaming, gone_error};
use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{GvDevice, GvInterface, GvPacketSizeAdjustment, GvStreamOption};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Maximum number of pictures until the first complete one. The first pictures may be incomplete, because the socket's
/// buffer is enlarged only when the first packet arrives.
pub const MAX_FIRST_PICTURES: u32 = 5;

/// Protects Aravis's global list of interfaces and cameras, which has no lock of its own.
static LIBRARY: Mutex<()> = Mutex::new(());

/// An accepted frame with its pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The frame's facts.
    pub facts: FrameMetadata,
    /// The pixels of the frame, one byte each, row by row.
    pub pixels: Vec<u8>,
    /// The camera's temperature after the exposure, °C, if the camera reports one.
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
    /// Finds the camera, configures it, and waits for its first complete picture. Returns an error early if `is_ending`
    /// becomes true.
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

    /// Captures pictures until the first complete one; the incomplete pictures are not counted in the statistics.
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

    /// Captures a single picture, whose exposure begins after this call.
    pub fn capture_single_picture(&mut self) -> Result<Frame, GigeError> {
        let taken = single_picture::capture(&mut self.sensor, &mut self.acceptance, &mut self.statistics);
        let camera_c = if taken.is_ok() { self.sensor.temperature_c() } else { None };
        taken.map(|(facts, pixels)| Frame { facts, pixels, camera_c }).map_err(|none| match none {
            SinglePictureError::Gone(gone) => gone,
            SinglePictureError::Timeout => {
                GigeError::Timeout { waited_ms: round_to_ms(MAX_ATTEMPTS * self.settings.picture_timeout()) }
            }
            SinglePictureError::Refused(last) => GigeError::Refused { tries: MAX_ATTEMPTS, last },
            SinglePictureError::Frozen(last) => GigeError::Frozen { last },
        })
    }

    /// Returns the next accepted picture of a free-running camera.
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

    /// Checks that the camera has not reported the loss of its connection.
    pub fn check_connected(&self) -> Result<(), GigeError> {
        self.sensor.check_streaming()
    }

    /// Returns the statistics since the camera was connected.
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

/// Finds and opens the selected camera.
fn open_selected(which: &CameraSelector) -> Result<GvDevice, GigeError> {
    let wanted = which.to_string();
    let not_found = |found: String| GigeError::NotFound { wanted: wanted.clone(), found };
    let interface = GvInterface::instance()
        .ok_or_else(|| not_found("the Aravis library has no GigE Vision support".to_owned()))?;
    let far = |address: &str| unreachable_reason(address, &local_subnets());
    let id = match which {
        CameraSelector::Address(address) => address.clone(),
        CameraSelector::Only | CameraSelector::Serial(_) => {
            let all = search().map_err(not_found)?;
            let reported: Vec<String> =
                all.iter().map(|found| format!("serial {} at {}", found.serial, found.address)).collect();
            let reported = match all.is_empty() {
                true => format!(
                    "no camera responded; cameras respond in this computer's subnets ({}), but a camera with an \
                     address outside of them may not respond",
                    describe_subnets(&local_subnets())
                ),
                false => format!("found {}", reported.join(", ")),
            };
            let right = all.iter().filter(|found| match which {
                CameraSelector::Serial(wanted) => found.serial == *wanted,
                _ => true,
            });
            match right.collect::<Vec<_>>().as_slice() {
                [only] if far(&only.address).is_some() => {
                    return Err(not_found(far(&only.address).unwrap_or_default()));
                }
                [only] => only.id.clone(),
                [] => return Err(not_found(reported)),
                _ => return Err(not_found(format!("{reported}: select one by its serial"))),
            }
        }
    };
    let why = |error: aravis::glib::Error| far(&id).unwrap_or_else(|| error.to_string());
    let device = interface.open_device(Some(&id)).map_err(|error| not_found(why(error)))?;
    device.downcast::<GvDevice>().map_err(|_| not_found("the device is not a GigE Vision camera".to_owned()))
}

/// Configures the camera and reads back the settings on which the meaning of a picture depends.
pub(super) fn configure(camera: &aravis::Camera, settings: &Settings) -> Result<(), GigeError> {
    let has = |node: &str| camera.is_feature_available(node).unwrap_or(false);
    if let Some(expected) = &settings.serial {
        let found = camera.device_serial_number().map_err(gone_error)?.to_string();
        if found != *expected {
            return Err(GigeError::WrongCamera { found, expected: expected.clone() });
        }
    }
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
        let why = format!("the camera set {taken} instead");
        return Err(GigeError::NotTaken { node, value: bytes.to_string(), why });
    }
    let (_, _, width, height) = camera.region().map_err(gone_error)?;
    let found_px = [width, height].map(|px| usize::try_from(px).unwrap_or_default());
    if found_px != settings.size_px {
        return Err(GigeError::WrongSize { found_px, expected_px: settings.size_px });
    }
    Ok(())
}

/// Sets one value of the camera and reads it back.
fn set(camera: &aravis::Camera, step: &SettingStep) -> Result<(), GigeError> {
    let (node, value) = match step {
        SettingStep::Command(node) => (*node, "()".to_owned()),
        SettingStep::SetEnum(node, entry) => (*node, entry.clone()),
        SettingStep::Number(node, number) | SettingStep::Limit(node, number) => (*node, number.to_string()),
        SettingStep::Switch(node, on) => (*node, on.to_string()),
    };
    let not_taken = |why: String| GigeError::NotTaken { node, value: value.clone(), why };
    let refused = |error: aravis::glib::Error| not_taken(error.to_string());
    match step {
        SettingStep::Command(node) => camera.execute_command(node).map_err(refused),
        SettingStep::Switch(node, on) => camera.set_boolean(node, *on).map_err(refused),
        SettingStep::SetEnum(node, entry) => {
            camera.set_string(node, entry).map_err(|error| {
                let entries = camera.dup_available_enumerations_as_strings(node).unwrap_or_default();
                let entries = entries.iter().map(|entry| entry.as_str()).collect::<Vec<_>>().join(", ");
                not_taken(format!("{error}; valid: {entries}"))
            })?;
            let taken = camera.string(node).map_err(refused)?;
            if taken == *entry { Ok(()) } else { Err(not_taken(format!("the camera set {taken} instead"))) }
        }
        SettingStep::Limit(node, number) => {
            let (_, upper) = camera.float_bounds(node).map_err(refused)?;
            set(camera, &SettingStep::Number(node, number.min(upper)))
        }
        SettingStep::Number(node, number) => {
            let (lower, upper) = camera.float_bounds(node).map_err(refused)?;
            if !(lower..=upper).contains(number) {
                return Err(not_taken(format!("valid: {lower} to {upper}{}", describe_frame_rate(camera, node))));
            }
            camera.set_float(node, *number).map_err(refused)?;
            let taken = camera.float(node).map_err(refused)?;
            // The exposure is a multiple of the sensor's row time, and the gain has steps. So the value that the camera
            // sets may differ slightly.
            let near = (taken - number).abs() <= 0.02 * number.abs() + 0.1;
            if near { Ok(()) } else { Err(not_taken(format!("the camera set {taken} instead"))) }
        }
    }
}

/// Returns a text with the frame rate that limits the exposure, if the camera reports one.
fn describe_frame_rate(camera: &aravis::Camera, node: &str) -> String {
    let rate = node.starts_with("Exposure").then(|| camera.float("AcquisitionFrameRate").ok()).flatten();
    rate.map_or(String::new(), |rate| format!(" at the camera's lowest rate, {rate:.3} pictures per second"))
}
