//! The settings of a camera, as steps on the nodes that the camera has.
//!
//! Cameras differ in their features, and the names of some nodes have changed over the years (GenICam's Standard
//! Features Naming Convention). For each needed setting, a plan uses the node name that the camera has. It omits steps
//! that only switch off a feature that this camera does not have. Size and position of the picture on the sensor come
//! from the user set and are never changed: they are part of the calibration.

use super::format::PixelFormat;
use std::time::Duration;

/// Selects a camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CameraSelector {
    /// The only camera that is found.
    Only,
    /// The camera with this serial number.
    Serial(String),
    /// The camera with this IP address or host name, without a search.
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

/// When the camera exposes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ExposureMode {
    /// Once for each software trigger.
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
    /// The set of values stored in the camera from which all other settings start.
    pub user_set: String,
    /// Width and height of the calibrated camera, px.
    pub size_px: [usize; 2],
    /// The pixel format, with one byte a pixel.
    pub format: PixelFormat,
    /// Exposure time, µs; with `None` the user set's value stays.
    pub exposure_us: Option<f64>,
    /// Gain, dB; with `None` the user set's value stays.
    pub gain_db: Option<f64>,
    /// When it exposes.
    pub exposure_mode: ExposureMode,
    /// Size of a packet with its headers, bytes: at most the size that every port on the way permits.
    pub packet_bytes: u16,
    /// Whether two consecutive pictures may be equal, as from a simulated sensor.
    pub may_repeat: bool,
}

/// Time limit from trigger to picture, in addition to the exposure.
const PICTURE_TIMEOUT: Duration = Duration::from_millis(1_000);

impl Settings {
    /// Returns how long the program waits for one picture.
    pub fn picture_timeout(&self) -> Duration {
        PICTURE_TIMEOUT + Duration::from_micros(self.exposure_us.unwrap_or_default() as u64)
    }
}

/// The packet size that every network permits: Ethernet's 1500 less what tunnels and tags may need.
pub const PACKET_BYTES: u16 = 1_400;

/// One setting of the camera.
#[derive(Debug, Clone, PartialEq)]
pub enum SettingStep {
    /// Execute a command.
    Command(&'static str),
    /// Select an entry of an enumeration.
    SetEnum(&'static str, String),
    /// Set a number.
    Number(&'static str, f64),
    /// Set a switch.
    Switch(&'static str, bool),
    /// Set a limit: this number, or the camera's own maximum if that is smaller.
    Limit(&'static str, f64),
}

/// A setting for which this camera has no node.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the camera has no setting for {wanted} (searched for {}); {advice}", nodes.join(", "))]
pub struct MissingNode {
    /// The function that the camera lacks.
    pub wanted: &'static str,
    /// The nodes that were looked for; one of them is sufficient.
    pub nodes: Vec<&'static str>,
    /// Remedy.
    pub advice: &'static str,
}

/// Errors of a plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A setting has no node.
    #[error(transparent)]
    NoNode(#[from] MissingNode),
    /// The pictures would overlap.
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

/// Largest exposure as a fraction of one picture's time: the camera needs the rest between two pictures.
const MAX_EXPOSED_SHARE: f64 = 0.9;

/// Returns the settings, in the order in which they are set, for a camera that has the nodes for which `has` returns
/// true.
///
/// A camera's longest exposure is the time of one picture at its frame rate, also in triggered mode. Therefore the rate
/// is limited to the value that the exposure allows before the exposure is set. It is limited again afterwards, since a
/// previous long exposure limits the rate in turn. Data with the picture (chunks) are switched off: the data stream
/// then has pictures only. PTP is also switched off, because it sets the camera's clock while it runs, and that clock
/// distinguishes newer pictures from older ones.
///
/// # Errors
/// If a requested setting has no node on the camera, or an exposure is longer than one picture's time.
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
            let limit = |exposure_us| MAX_EXPOSED_SHARE * 1e6 / exposure_us;
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

    /// The nodes that LUCID's own driver names. Calculated by hand: 8 ms are nine tenths of 8.889 ms, 112.5
    /// pictures a second.
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

    /// A camera without user sets and without automatic functions, and with an older name of a node.
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
