//! Why a GigE Vision camera gives no picture.

use super::acceptance::Refused;
use super::format::PixelFormat;
use super::settings::PlanError;

/// Why a GigE Vision camera gives no picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GigeError {
    /// No camera answers.
    #[error("{wanted} is not found; {found}")]
    NotFound {
        /// Which one.
        wanted: String,
        /// What was found instead.
        found: String,
    },
    /// The camera answers, but cannot be opened.
    #[error("{wanted} does not open: {why}")]
    NotOpened {
        /// Which one.
        wanted: String,
        /// The message from Aravis.
        why: String,
    },
    /// Another program controls the camera.
    #[error("{wanted} is controlled by another program; end that one, or wait until its heartbeat is over")]
    Controlled {
        /// Which one.
        wanted: String,
    },
    /// The camera does not support the settings.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A value that the camera does not accept.
    #[error("the camera does not accept {node} = {value}: {why}")]
    NotTaken {
        /// The node.
        node: &'static str,
        /// The value.
        value: String,
        /// The allowed values, or the camera's message.
        why: String,
    },
    /// The camera is not the calibrated one.
    #[error(
        "the camera found is {found}, expected is {expected}: its calibration is for that one; calibrate this one, or put the \
         other back"
    )]
    WrongCamera {
        /// Its serial number.
        found: String,
        /// The calibration's.
        expected: String,
    },
    /// The camera has another size than the calibrated one.
    #[error("the camera's picture is {}×{}, its calibration is for {}×{}", found_px[0], found_px[1], expected_px[0], expected_px[1])]
    WrongSize {
        /// Width and height, px.
        found_px: [usize; 2],
        /// Width and height in the calibration, px.
        expected_px: [usize; 2],
    },
    /// No complete picture came when the camera was opened.
    #[error(
        "no whole picture came in {tries} tries; are packets of {packet_bytes} bytes too large for a port on the way, is \
         net.core.rmem_max (now {rmem_max}) below {wanted_bytes}, does a firewall of this computer drop UDP from the camera? \
         Last: {last}"
    )]
    NothingWhole {
        /// The number of pictures requested.
        tries: u32,
        /// Size of a packet, bytes.
        packet_bytes: u16,
        /// The largest receive buffer that the system grants, bytes, if the system reports it.
        rmem_max: String,
        /// The requested receive buffer, bytes.
        wanted_bytes: usize,
        /// The result of the last try.
        last: String,
    },
    /// The camera sends another format than configured, and reports the format that it sends.
    #[error(
        "the camera accepted pixel format {} but sends {found}: {last}; set [flange_camera] pixel_format to one \
         that it sends as it is named, or install other firmware", expected.name()
    )]
    OtherFormat {
        /// What it sends.
        found: String,
        /// The pixel format that was set.
        expected: PixelFormat,
        /// Why the last frame was refused.
        last: Refused,
    },
    /// The camera was connected and is lost.
    #[error("the camera is lost: {why}")]
    Lost {
        /// How that shows.
        why: String,
    },
    /// The camera does not answer in time.
    #[error("no picture within {waited_ms} ms")]
    Timeout {
        /// How long the program waited, ms.
        waited_ms: u64,
    },
    /// The frames that came cannot be used.
    #[error("no picture that may be used came in {tries} tries; the last: {last}")]
    Refused {
        /// Number of frames that were tried.
        tries: u32,
        /// Why the last frame was refused.
        last: Refused,
    },
    /// The camera delivers an old scene.
    #[error("the camera is frozen: {last}, at the second try too")]
    Frozen {
        /// Why the last frame was refused.
        last: Refused,
    },
}

/// For messages.
#[cfg(feature = "gige")]
pub(super) fn whole_ms(time: std::time::Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}
