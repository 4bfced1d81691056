//! The settings of a camera, as a sequence of steps on the nodes that the camera has.
//!
//! Cameras have different features, and the names of some nodes have changed over the years (GenICam's Standard
//! Features Naming Convention). The plan selects, for each required setting, the node name that the camera has. Steps
//! that only switch off a feature are omitted if the camera does not have the feature. Size and position of the picture
//! on the sensor come from the user set and are never changed, because they are part of the calibration.

use super::format::PixelFormat;
use std::time::Duration;

/// Selects a camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CameraSelector {
    /// The only camera that responds to a search.
    Only,
    /// The camera with this serial number.
    Serial(String),
    /// The camera with this IP address or host name; no search is needed.
    Address(String),
}

impl std::fmt::Display for CameraSelector {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            CameraSelector::Only => f.write_str("the only GigE Vision camera"),
            CameraSelector::Serial(serial) => write!(f, "the GigE Vision camera with serial {serial}"),
            CameraSelector::Address(address) => write!(f, "the GigE Vision camera at {address}"),
        }
    }
}

/// The event that starts an exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ExposureMode {
    /// The camera exposes once for each software trigger.
    Triggered,
    /// The camera exposes continuously.
    FreeRunning {
        /// Pictures per second.
        frames_per_s: f64,
    },
}

/// The required settings of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Selects the camera.
    pub selector: CameraSelector,
    /// The serial number of the calibrated camera, if known.
    pub serial: Option<String>,
    /// The user set (settings stored in the camera) that is loaded before the other settings are made.
    pub user_set: String,
    /// Width and height of the calibrated camera, px.
    pub size_px: [usize; 2],
    /// The pixel format; it has one byte per pixel.
    pub format: PixelFormat,
    /// Exposure time, µs; `None` keeps the value of the user set.
    pub exposure_us: Option<f64>,
    /// Gain, dB; `None` keeps the value of the user set.
    pub gain_db: Option<f64>,
    /// When it exposes.
    pub exposure_mode: ExposureMode,
    /// Size of a packet with its headers, bytes; at most the limit of every network port between camera and computer.
    pub packet_bytes: u16,
    /// Whether two consecutive pictures may be equal, as those of a simulated sensor may be.
    pub may_repeat: bool,
}

/// Time limit from the trigger to the picture, in addition to the exposure time.
const PICTURE_TIMEOUT: Duration = Duration::from_millis(1_000);

impl Settings {
    /// Returns the time limit for one picture.
    pub fn picture_timeout(&self) -> Duration {
        PICTURE_TIMEOUT + Duration::from_micros(self.exposure_us.unwrap_or_default() as u64)
    }
}

/// The packet size that every network permits, bytes: the 1500 bytes of Ethernet minus room for tunnels and VLAN tags.
pub const PACKET_BYTES: u16 = 1_400;

/// One step of the configuration: a node and its value.
#[derive(Debug, Clone, PartialEq)]
pub enum SettingStep {
    /// Execute a command.
    Command(&'static str),
    /// Selects an entry of an enumeration.
    SetEnum(&'static str, String),
    /// Set a number.
    Number(&'static str, f64),
    /// Set a switch.
    Switch(&'static str, bool),
    /// Sets a limit to this number, or to the camera's own maximum if the maximum is smaller.
    Limit(&'static str, f64),
}

/// A required setting for which the camera has no node.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the camera has no setting for {wanted} (searched for {}); {advice}", nodes.join(", "))]
pub struct MissingNode {
    /// The function that the camera does not have.
    pub wanted: &'static str,
    /// The nodes that were searched; one of them would be sufficient.
    pub nodes: Vec<&'static str>,
    /// Remedy.
    pub advice: &'static str,
}

/// The reason why the settings cannot be planned.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A required setting has no node on the camera.
    #[error(transparent)]
    NoNode(#[from] MissingNode),
    /// The exposure is too long for the frame rate.
    #[error(
        "an exposure of {exposure_us} µs is too long for {frames_per_s} pictures per second (limit {} µs); reduce \
         exposure_us", (1e6 / frames_per_s).floor()
    )]
    TooLong {
        /// The exposure, µs.
        exposure_us: f64,
        /// Pictures per second.
        frames_per_s: f64,
    },
}

/// Maximum exposure time as a fraction of the frame period; the camera needs the rest between two pictures.
const MAX_EXPOSURE_FRACTION: f64 = 0.9;

/// Returns the settings in the order in which they are made; `has` returns whether the camera has a node.
///
/// The frame rate limits the exposure time, even in triggered mode. So the rate is first reduced to a value at which
/// the exposure is possible, and then the exposure is set. The rate is limited again afterwards, because a long
/// exposure that was set before limits the rate as well. Chunk data are switched off, so that the stream contains only
/// pictures. PTP is switched off, because it may set the camera's clock back, and this clock distinguishes new pictures
/// from old ones.
///
/// # Errors
/// If a required setting has no node on the camera, or the exposure is longer than the frame period permits.
pub fn plan(settings: &Settings, has: &dyn Fn(&str) -> bool) -> Result<Vec<SettingStep>, PlanError> {
    let mut steps = Vec::new();
    let choose = |node: &'static str, entry: &str| SettingStep::SetEnum(node, entry.to_owned());
    let one_of = |wanted, nodes: &[&'static str], advice| {
        let found = nodes.iter().copied().find(|node| has(node));
        found.ok_or_else(|| MissingNode { wanted, nodes: nodes.to_vec(), advice })
    };
    if has("UserSetSelector") && has("UserSetLoad") {
        steps.extend([choose("UserSetSelector", &settings.user_set), SettingStep::Command("UserSetLoad")]);
    }
    steps.push(choose(
        one_of("pixel format", &["PixelFormat"], "this program does not support this camera")?,
        settings.format.name(),
    ));
    let switches = ["ChunkModeActive", "PtpEnable"].into_iter().filter(|node| has(node));
    steps.extend(switches.map(|node| SettingStep::Switch(node, false)));
    let off = ["ExposureAuto", "GainAuto", "BalanceWhiteAuto"].into_iter().filter(|node| has(node));
    steps.extend(off.map(|node| choose(node, "Off")));
    const RATES: [&str; 2] = ["AcquisitionFrameRate", "AcquisitionFrameRateAbs"];
    let enable =
        has("AcquisitionFrameRateEnable").then_some(SettingStep::Switch("AcquisitionFrameRateEnable", true));
    let rate = match settings.exposure_mode {
        ExposureMode::Triggered => {
            let limit = |exposure_us| MAX_EXPOSURE_FRACTION * 1e6 / exposure_us;
            let node = RATES.into_iter().find(|node| has(node));
            settings.exposure_us.and_then(|exposure_us| Some(SettingStep::Limit(node?, limit(exposure_us))))
        }
        ExposureMode::FreeRunning { frames_per_s } => {
            if let Some(exposure_us) = settings.exposure_us.filter(|exposure_us| exposure_us * frames_per_s > 1e6) {
                return Err(PlanError::TooLong { exposure_us, frames_per_s });
            }
            Some(SettingStep::Number(one_of("frame rate", &RATES, "trigger it instead")?, frames_per_s))
        }
    };
    let rate: Vec<SettingStep> =
        rate.into_iter().flat_map(|rate| enable.clone().into_iter().chain([rate])).collect();
    if let Some(exposure_us) = settings.exposure_us {
        let nodes = ["ExposureTime", "ExposureTimeAbs"];
        let node = one_of("exposure time in µs", &nodes, "this program does not support this camera")?;
        let before = rate.iter().map(|step| match step {
            SettingStep::Number(node, number) => SettingStep::Limit(node, *number),
            other => other.clone(),
        });
        steps.extend(before.chain([SettingStep::Number(node, exposure_us)]));
    }
    steps.extend(rate);
    if let Some(gain_db) = settings.gain_db {
        let advice = "remove gain_db to use the gain of the user set";
        steps.push(SettingStep::Number(one_of("gain in dB", &["Gain"], advice)?, gain_db));
    }
    if has("AcquisitionMode") {
        steps.push(choose("AcquisitionMode", "Continuous"));
    }
    if has("TriggerSelector") {
        steps.push(choose("TriggerSelector", "FrameStart"));
    }
    match settings.exposure_mode {
        ExposureMode::Triggered => {
            let advice = "this camera cannot take single pictures";
            let mode = one_of("trigger", &["TriggerMode"], advice)?;
            let source = one_of("trigger source", &["TriggerSource"], advice)?;
            one_of("software trigger", &["TriggerSoftware"], advice)?;
            steps.extend([choose(mode, "On"), choose(source, "Software")]);
        }
        ExposureMode::FreeRunning { .. } => steps.extend(has("TriggerMode").then(|| choose("TriggerMode", "Off"))),
    }
    Ok(steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        Settings {
            selector: CameraSelector::Only,
            serial: None,
            user_set: "Default".to_owned(),
            size_px: [2048, 1536],
            format: PixelFormat::BayerRG8,
            exposure_us: Some(8_000.0),
            gain_db: Some(3.0),
            exposure_mode: ExposureMode::Triggered,
            packet_bytes: PACKET_BYTES,
            may_repeat: false,
        }
    }

    fn planned_steps(settings: &Settings, nodes: &[&str]) -> Vec<String> {
        let steps = plan(settings, &|node| nodes.contains(&node)).expect("all nodes are there");
        let describe = |step: SettingStep| match step {
            SettingStep::Command(node) => format!("{node}()"),
            SettingStep::SetEnum(node, entry) => format!("{node}={entry}"),
            SettingStep::Number(node, number) => format!("{node}={number}"),
            SettingStep::Switch(node, on) => format!("{node}={on}"),
            SettingStep::Limit(node, number) => format!("{node}<={number}"),
        };
        steps.into_iter().map(describe).collect()
    }

    /// The nodes are those in LUCID's own driver. Expected value, calculated by hand: an exposure of 8 ms is nine
    /// tenths of 8.889 ms, the period at 112.5 pictures per second.
    #[test]
    fn a_triton_is_set_starting_from_its_user_set() {
        let nodes = [
            "UserSetSelector",
            "UserSetLoad",
            "PixelFormat",
            "ChunkModeActive",
            "PtpEnable",
            "AcquisitionFrameRate",
            "AcquisitionFrameRateEnable",
            "ExposureAuto",
            "ExposureTime",
            "GainAuto",
            "Gain",
            "BalanceWhiteAuto",
            "AcquisitionMode",
            "TriggerSelector",
            "TriggerMode",
            "TriggerSource",
            "TriggerSoftware",
        ];
        assert_eq!(
            planned_steps(&settings(), &nodes),
            [
                "UserSetSelector=Default",
                "UserSetLoad()",
                "PixelFormat=BayerRG8",
                "ChunkModeActive=false",
                "PtpEnable=false",
                "ExposureAuto=Off",
                "GainAuto=Off",
                "BalanceWhiteAuto=Off",
                "AcquisitionFrameRateEnable=true",
                "AcquisitionFrameRate<=112.5",
                "ExposureTime=8000",
                "AcquisitionFrameRateEnable=true",
                "AcquisitionFrameRate<=112.5",
                "Gain=3",
                "AcquisitionMode=Continuous",
                "TriggerSelector=FrameStart",
                "TriggerMode=On",
                "TriggerSource=Software",
            ]
        );
    }

    /// A camera that has neither user sets nor automatic functions, and that has an older name of one node.
    #[test]
    fn settings_of_missing_features_are_omitted() {
        let nodes = ["PixelFormat", "ExposureTimeAbs", "TriggerMode", "AcquisitionFrameRate"];
        let free = Settings {
            gain_db: None,
            exposure_mode: ExposureMode::FreeRunning { frames_per_s: 10.0 },
            ..settings()
        };
        assert_eq!(
            planned_steps(&free, &nodes),
            [
                "PixelFormat=BayerRG8",
                "AcquisitionFrameRate<=10",
                "ExposureTimeAbs=8000",
                "AcquisitionFrameRate=10",
                "TriggerMode=Off"
            ]
        );
    }

    #[test]
    fn a_requested_setting_without_a_node_is_refused() {
        let nodes = ["PixelFormat", "ExposureTime", "TriggerMode", "TriggerSource", "TriggerSoftware", "GainRaw"];
        let refused = plan(&settings(), &|node| nodes.contains(&node)).expect_err("no gain in dB").to_string();
        assert_eq!(
            refused,
            "the camera has no setting for gain in dB (searched for Gain); remove gain_db to use the gain of the user \
             set"
        );
        for missing in ["PixelFormat", "ExposureTime", "TriggerMode", "TriggerSource", "TriggerSoftware"] {
            let rest = Settings { gain_db: None, ..settings() };
            let refused = plan(&rest, &|node| node != missing && nodes.contains(&node)).expect_err(missing);
            assert!(matches!(&refused, PlanError::NoNode(no) if no.nodes.contains(&missing)), "{refused}");
        }
        let exposing = ExposureMode::FreeRunning { frames_per_s: 30.0 };
        let long = Settings { exposure_us: Some(40_000.0), gain_db: None, exposure_mode: exposing, ..settings() };
        let refused = plan(&long, &|_| true).expect_err("33 ms a picture").to_string();
        assert!(
            refused.starts_with("an exposure of 40000 µs is too long for 30 pictures per second (limit 33333 µs)")
        );
    }
}
