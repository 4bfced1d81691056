//! Errors of a GigE Vision camera.

use super::acceptance::FrameRefusal;
use super::format::PixelFormat;
use super::settings::PlanError;

/// An error of a GigE Vision camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GigeError {
    /// No camera responds to the search.
    #[error("{wanted} was not found: {found}")]
    NotFound {
        /// Description of the camera that was searched.
        wanted: String,
        /// Description of the cameras that were found instead.
        found: String,
    },
    /// The camera responds, but cannot be opened.
    #[error("{wanted} cannot be opened: {why}")]
    NotOpened {
        /// Description of the camera that was searched.
        wanted: String,
        /// The message from Aravis.
        why: String,
    },
    /// Another program controls the camera.
    #[error(
        "{wanted} is controlled by another program; close that program, or wait until its heartbeat has timed out"
    )]
    Controlled {
        /// Description of the camera that was searched.
        wanted: String,
    },
    /// The camera does not have a node for a required setting.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The camera does not accept the value of a setting.
    #[error("the camera does not accept {node} = {value}: {why}")]
    NotTaken {
        /// The node.
        node: &'static str,
        /// The value.
        value: String,
        /// The valid values, or the message of the camera.
        why: String,
    },
    /// The serial number of the camera is not that of the calibrated camera.
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
        /// Width and height of the camera's pictures, px.
        found_px: [usize; 2],
        /// Width and height in the camera's calibration, px.
        expected_px: [usize; 2],
    },
    /// No complete picture arrived while the camera was being opened.
    #[error(
        "no complete picture was received in {tries} tries. Check that each network port accepts packets of \
         {packet_bytes} bytes, that net.core.rmem_max (now {rmem_max}) is at least {wanted_bytes}, and that no \
         firewall of this computer drops UDP from the camera. Last: {last}"
    )]
    NoCompletePicture {
        /// The number of pictures that were requested.
        tries: u32,
        /// The configured packet size, bytes.
        packet_bytes: u16,
        /// The maximum receive buffer that the operating system permits, bytes, or a text if it is not known.
        rmem_max: String,
        /// The receive buffer that was requested, bytes.
        wanted_bytes: usize,
        /// The result of the last attempt.
        last: String,
    },
    /// The camera sends its pictures in another pixel format than the one that was set.
    #[error(
        "the camera accepted pixel format {} but sends {found}: {last}; set [flange_camera] pixel_format to another \
         format, or install other firmware", expected.name()
    )]
    OtherFormat {
        /// The pixel format in which the camera sends.
        found: String,
        /// The pixel format that was set.
        expected: PixelFormat,
        /// The reason why the last frame was refused.
        last: FrameRefusal,
    },
    /// The connection to the camera is lost.
    #[error("the connection to the camera is lost: {why}")]
    Lost {
        /// The symptom of the loss.
        why: String,
    },
    /// The camera delivers no picture in time.
    #[error("no picture from the camera within {waited_ms} ms: check its power and cable")]
    Timeout {
        /// Waiting time, ms.
        waited_ms: u64,
    },
    /// None of the received frames can be used.
    #[error("no usable picture was received in {tries} attempts; last: {last}; check the network to the camera")]
    Refused {
        /// Number of attempts.
        tries: u32,
        /// The reason why the last frame was refused.
        last: FrameRefusal,
    },
    /// The camera repeats pictures of an earlier scene.
    #[error(
        "the camera delivered an old picture in two attempts: {last}; restart the camera, and check its clock (PTP)"
    )]
    Frozen {
        /// The reason why the last frame was refused.
        last: FrameRefusal,
    },
}

/// Returns the time in whole milliseconds, for messages.
#[cfg(feature = "gige")]
pub(super) fn round_to_ms(time: std::time::Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}
