//! The messages between daemon and worker: the JSON heads of the frames.
//!
//! The daemon sends requests, and the worker replies to each once, in order. Settings are sent as the text of their
//! YAML file, and are identified by their SHA-256 hash in all requests, so that no other settings can be used. Times
//! are in nanoseconds of `CLOCK_MONOTONIC`, which both processes read.

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Selects the camera to open.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The only camera that is found.
    Only,
    /// The camera with this serial number.
    Serial(String),
    /// A file camera (`.zfc`): the SDK computes its data from recorded raw pictures.
    File(PathBuf),
}

/// The purpose of settings: 3D scans or colour pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Use {
    /// Settings for 3D scans with colour.
    Scan,
    /// Colour pictures.
    Picture,
}

impl Use {
    /// Returns the purpose of the settings as a text, for messages.
    pub fn word(self) -> &'static str {
        match self {
            Use::Scan => "3D shots",
            Use::Picture => "pictures",
        }
    }
}

/// The SHA-256 hash of a settings file, hexadecimal.
pub type SettingsHash = String;

/// A request of the daemon to the worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Opens this camera. If a camera is already open, it is closed first.
    Connect {
        /// Selects the camera.
        source: Source,
    },
    /// Read these settings.
    Settings {
        /// The purpose of the settings.
        usage: Use,
        /// The file's text.
        yaml: String,
        /// Its hash.
        hash: SettingsHash,
    },
    /// Captures a 3D scan with colour.
    Scan {
        /// The hash of the settings for the scan.
        settings: SettingsHash,
    },
    /// A picture.
    Picture {
        /// The hash of the settings for the picture.
        settings: SettingsHash,
    },
    /// Starts a clip: pictures are captured continuously.
    BeginClip {
        /// The hash of the settings for the pictures.
        settings: SettingsHash,
        /// The maximum rate, pictures per second.
        pictures_per_second: f64,
    },
    /// Requests the next picture of the clip. Pictures that are not fetched in time are dropped.
    NextPicture,
    /// Stops taking pictures.
    EndClip,
    /// Requests the camera's own lens model for these settings.
    Intrinsics {
        /// The settings.
        settings: SettingsHash,
    },
    /// Its temperatures.
    State,
    /// Measures the flicker of the ambient light.
    Light,
}

/// The first message of the worker.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hello {
    /// The program's version.
    pub program: String,
    /// The version of the SDK, or the reason why the SDK is not available.
    pub sdk: Result<String, String>,
}

/// A reply of the worker to a request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Reply {
    /// The camera is open.
    Connected(Identity),
    /// The settings were loaded; contains the size of the pictures.
    Settings(Size),
    /// A 3D scan. Its payload contains x, y, z of each point as f32 in mm, then red, green, blue, then the signal to
    /// noise ratio as f32.
    Scan(ShotInfo),
    /// A picture. Its payload contains red, green and blue of each pixel.
    Picture(ShotInfo),
    /// The clip has been started.
    ClipBegun,
    /// The clip has ended.
    ClipEnded(ClipEnd),
    /// The lens.
    Intrinsics(Lens),
    /// The temperatures.
    State(Temperatures),
    /// The light.
    Light(Light),
    /// The request cannot be carried out.
    Refused(Refusal),
}

/// The identity of a camera.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// Serial number.
    pub serial: String,
    /// Model.
    pub model: String,
}

/// The size of the pictures that the camera delivers with the settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Size {
    /// Columns, px.
    pub width: usize,
    /// Rows, px.
    pub height: usize,
}

impl Size {
    /// Pixels.
    pub fn pixels(self) -> usize {
        self.width.saturating_mul(self.height)
    }
}

/// The metadata of a scan or picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShotInfo {
    /// Its size.
    pub size: Size,
    /// The hash of the settings with which it was captured.
    pub settings: SettingsHash,
    /// The camera's serial number.
    pub serial: String,
    /// Number of scans and pictures of this worker so far, including this one.
    pub number: u64,
    /// Time at which the camera received the request, ns of the monotonic clock.
    pub begun_ns: u64,
    /// Time at which the exposure ended, ns of the monotonic clock.
    pub exposed_ns: u64,
    /// Time at which the data were available, ns of the monotonic clock.
    pub ready_ns: u64,
    /// The pause before the exposure because the camera was too hot, ms.
    pub throttled_ms: f64,
    /// Temperature of the lens at the exposure, °C, if the camera reports it.
    pub lens_c: Option<f64>,
    /// For a clip: number of pictures since its start that were captured but not fetched in time.
    pub dropped: u64,
}

/// The statistics of a clip that has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipEnd {
    /// Pictures taken.
    pub taken: u64,
    /// Number of these pictures that were not fetched in time.
    pub dropped: u64,
}

/// The camera's own lens model, with the parameters of OpenCV; according to the vendor it is an approximation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// The focal lengths and the principal point fx, fy, cx, cy, px.
    pub matrix_px: [f64; 4],
    /// The distortion coefficients k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

/// The camera's temperatures, °C; `None` for a temperature that the camera does not report.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Temperatures {
    /// The projector's mirrors.
    pub dmd_c: Option<f64>,
    /// The general temperature of the housing, °C.
    pub general_c: Option<f64>,
    /// The projector's light.
    pub led_c: Option<f64>,
    /// The lens.
    pub lens_c: Option<f64>,
    /// The board.
    pub pcb_c: Option<f64>,
}

/// The ambient light, as the camera has measured it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// The flicker of the ambient light.
    pub flicker: Flicker,
    /// The frequency of the flicker, as a text of the SDK; empty if the SDK does not report it.
    pub frequency: String,
}

/// The kinds of flicker that the SDK distinguishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Flicker {
    /// The light does not flicker.
    None,
    /// The light flickers like lamps on 50 Hz mains.
    Grid50Hz,
    /// The light flickers like lamps on 60 Hz mains.
    Grid60Hz,
    /// The light flickers at another frequency.
    Other,
    /// The light flickers, but the kind of flicker is not known to the SDK or to this program.
    Unknown,
}

impl Flicker {
    /// Returns the kind of flicker for a name of the SDK.
    pub fn from_sdk_name(classification: &str) -> Self {
        match classification {
            "noFlicker" => Flicker::None,
            "grid50hz" => Flicker::Grid50Hz,
            "grid60hz" => Flicker::Grid60Hz,
            "otherFlicker" => Flicker::Other,
            _ => Flicker::Unknown,
        }
    }
}

/// The reason why the worker refuses a request.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Refusal {
    /// The category of the reason.
    pub trouble: Trouble,
    /// The message of the worker or of the SDK.
    pub message: String,
}

/// The category of the reason why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Trouble {
    /// The requested camera was not found.
    NotFound,
    /// The camera was found, but its firmware does not match the SDK.
    Firmware,
    /// The camera was found, but is connected to another program or computer.
    InUse,
    /// The camera was detected, but its address cannot be reached.
    OutOfReach,
    /// The connection to the open camera was lost.
    Gone,
    /// The camera delivered no data; another attempt may succeed.
    NoShot,
    /// The settings do not match their hash, or the SDK does not accept them.
    Settings,
    /// The request is not valid in the current state, for example a picture of a clip without a clip, or a scan without
    /// a camera.
    OutOfOrder,
}

/// Returns the current time of `CLOCK_MONOTONIC`, ns.
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    // Neither number is negative, because the clock starts at the boot of the computer.
    now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
}
