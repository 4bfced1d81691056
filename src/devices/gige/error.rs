//! Errors of a GigE Vision camera.

use super::acceptance::FrameRefusal;
use super::format::PixelFormat;
use super::settings::PlanError;

/// Errors of a GigE Vision camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GigeError {
    /// No camera answers.
    #[error("{wanted} was not found: {found}")]
    NotFound {
        /// Description of the requested camera.
        wanted: String,
        /// Description of the cameras found instead.
        found: String,
    },
    /// The camera answers, but cannot be opened.
    #[error("{wanted} cannot be opened: {why}")]
    NotOpened {
        /// Description of the requested camera.
        wanted: String,
        /// The message from Aravis.
        why: String,
    },
    /// Another program controls the camera.
    #[error(
        "{wanted} is controlled by another program; close that program, or wait until its heartbeat has timed out"
    )]
    Controlled {
        /// Description of the requested camera.
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
        "found the camera with serial {found}, but the calibration is for serial {expected}; calibrate the found \
         camera, or connect the calibrated camera"
    )]
    WrongCamera {
        /// Its serial number.
        found: String,
        /// Serial number in the calibration.
        expected: String,
    },
    /// The camera's pictures have another size than those of the calibrated camera.
    #[error("the camera's picture is {}×{} px, but its calibration is for {}×{} px", found_px[0], found_px[1], expected_px[0], expected_px[1])]
    WrongSize {
        /// Width and height, px.
        found_px: [usize; 2],
        /// Width and height in the calibration, px.
        expected_px: [usize; 2],
    },
    /// No complete picture came when the camera was opened.
    #[error(
        "no complete picture was received in {tries} tries. Check that each network port accepts packets of \
         {packet_bytes} bytes, that net.core.rmem_max (now {rmem_max}) is at least {wanted_bytes}, and that no \
         firewall of this computer drops UDP from the camera. Last: {last}"
    )]
    NoCompletePicture {
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
        "the camera accepted pixel format {} but sends {found}: {last}; set [flange_camera] pixel_format to another \
         format, or install other firmware", expected.name()
    )]
    OtherFormat {
        /// The format that the camera sends.
        found: String,
        /// The pixel format that was set.
        expected: PixelFormat,
        /// The reason why the last frame was refused.
        last: FrameRefusal,
    },
    /// The camera was connected and is lost.
    #[error("the connection to the camera is lost: {why}")]
    Lost {
        /// Symptom of the loss.
        why: String,
    },
    /// The camera does not answer in time.
    #[error("no picture from the camera within {waited_ms} ms")]
    Timeout {
        /// Waiting time, ms.
        waited_ms: u64,
    },
    /// The frames that came cannot be used.
    #[error("no usable picture was received in {tries} tries; last: {last}")]
    Refused {
        /// Number of frames that were tried.
        tries: u32,
        /// The reason why the last frame was refused.
        last: FrameRefusal,
    },
    /// The camera delivers an old scene.
    #[error("the camera delivers old pictures: {last}; the second try had the same result")]
    Frozen {
        /// The reason why the last frame was refused.
        last: FrameRefusal,
    },
}

/// Rounds a time for messages.
#[cfg(feature = "gige")]
pub(super) fn round_to_ms(time: std::time::Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}
