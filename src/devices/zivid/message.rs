//! Messages between daemon and worker: the heads of the frames.
//!
//! The daemon sends requests; the worker answers each once, in order. Settings are sent as the text of their YAML
//! file and named by its SHA-256 from then on, so that no shot uses other settings than those sent. Times are of
//! `CLOCK_MONOTONIC` in nanoseconds, which both processes read.

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Selects the camera to open.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The only camera found.
    Only,
    /// The camera with this serial number.
    Serial(String),
    /// A file camera, `.zfc`: the SDK computes from recorded raw pictures.
    File(PathBuf),
}

/// The purpose of settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Use {
    /// 3D shots with colour.
    Scan,
    /// Colour pictures.
    Picture,
}

impl Use {
    /// Returns the purpose of the settings, as text.
    pub fn word(self) -> &'static str {
        match self {
            Use::Scan => "3D shots",
            Use::Picture => "pictures",
        }
    }
}

/// SHA-256 of a settings file, hexadecimal.
pub type SettingsHash = String;

/// A request of the daemon.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Opens this camera; a camera that is already open is closed first.
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
    /// A 3D shot with colour.
    Scan {
        /// Hash of the settings.
        settings: SettingsHash,
    },
    /// A picture.
    Picture {
        /// Hash of the settings.
        settings: SettingsHash,
    },
    /// Takes pictures continuously from now on.
    BeginClip {
        /// Hash of the settings.
        settings: SettingsHash,
        /// The highest rate, 1/s.
        pictures_per_second: f64,
    },
    /// The next of these pictures. Pictures that were not fetched in time are lost.
    NextPicture,
    /// Stops taking pictures.
    EndClip,
    /// The camera's model of its lens at these settings.
    Intrinsics {
        /// The settings.
        settings: SettingsHash,
    },
    /// Its temperatures.
    State,
    /// Measures how the ambient light flickers at present.
    Light,
}

/// The worker's first message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hello {
    /// The program's version.
    pub program: String,
    /// The SDK's version, or why there is no SDK.
    pub sdk: Result<String, String>,
}

/// A reply of the worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Reply {
    /// The camera is open.
    Connected(Identity),
    /// The settings were read.
    Settings(Size),
    /// A 3D shot: its payload is x, y, z of each point as f32, mm; then red, green, blue; then the signal to noise
    /// ratio as f32.
    Scan(ShotInfo),
    /// A picture: its payload is red, green, blue.
    Picture(ShotInfo),
    /// The clip is running.
    ClipBegun,
    /// The clip is over.
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

/// Identity of a camera.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// Serial number.
    pub serial: String,
    /// Model.
    pub model: String,
}

/// Size of the pictures that settings deliver.
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

/// The metadata of a shot or picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShotInfo {
    /// Its size.
    pub size: Size,
    /// The settings with which the shot was taken.
    pub settings: SettingsHash,
    /// The camera's serial number.
    pub serial: String,
    /// Number of shots and pictures of this worker so far, including this one.
    pub number: u64,
    /// Time at which the camera received the request, ns of the monotonic clock.
    pub begun_ns: u64,
    /// Time at which the exposure ended.
    pub exposed_ns: u64,
    /// Time at which the data were available.
    pub ready_ns: u64,
    /// Pause before the shot because the camera was too hot, ms.
    pub throttled_ms: f64,
    /// Temperature of the lens at this shot, °C, if the camera reports it.
    pub lens_c: Option<f64>,
    /// For a clip: number of pictures that were taken but not fetched since the clip began.
    pub dropped: u64,
}

/// How a clip ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipEnd {
    /// Pictures taken.
    pub taken: u64,
    /// Of these, pictures that were not fetched in time.
    pub dropped: u64,
}

/// The camera's own model of its lens, in OpenCV's form; the vendor calls it an approximation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// fx, fy, cx, cy, px.
    pub matrix_px: [f64; 4],
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

/// The camera's temperatures, °C, each if the camera reports it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Temperatures {
    /// The projector's mirrors.
    pub dmd_c: Option<f64>,
    /// General temperature of the housing.
    pub general_c: Option<f64>,
    /// The projector's light.
    pub led_c: Option<f64>,
    /// The lens.
    pub lens_c: Option<f64>,
    /// The board.
    pub pcb_c: Option<f64>,
}

/// The camera's measurement of the ambient light.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Flicker of the light.
    pub flicker: Flicker,
    /// The frequency, in the SDK's words; empty if the SDK does not report it.
    pub frequency: String,
}

/// Kinds of flicker, by the SDK's names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Flicker {
    /// The light does not flicker.
    None,
    /// Flicker of lamps on 50 Hz mains.
    Grid50Hz,
    /// Flicker of lamps on 60 Hz mains.
    Grid60Hz,
    /// The light flickers at another frequency.
    Other,
    /// The light flickers, but the SDK does not know how, or this program does not know the SDK's name for it.
    Unknown,
}

impl Flicker {
    /// Returns the flicker with this SDK name.
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

/// The reason why a request cannot be carried out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Refusal {
    /// The kind of trouble.
    pub trouble: Trouble,
    /// The message of the worker or of the SDK.
    pub message: String,
}

/// The kind of trouble.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Trouble {
    /// There is no such camera.
    NotFound,
    /// The camera is present, but its firmware does not match the SDK.
    Firmware,
    /// The camera is present, but connected to another program or computer.
    InUse,
    /// The camera is detected, but its address cannot be reached.
    OutOfReach,
    /// The camera was open and is gone.
    Gone,
    /// The camera gave no shot; the next one may be good.
    NoShot,
    /// The settings differ from those that were announced, or the SDK does not accept them.
    Settings,
    /// The request does not fit the present state: a picture without a clip, a shot without a camera.
    OutOfOrder,
}

/// Returns the present time, ns.
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    // Neither number is negative on a clock that begins when the machine starts.
    now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
}
