//! `[flange_camera]` with `kind = "gige"`: the camera and its settings.

use super::devices::DeviceKind;
use panelprep_base::config::Section;

/// The pixel formats that a cell may name: monochrome, and the four Bayer orders of a colour sensor, one byte a pixel.
pub const PIXEL_FORMATS: [&str; 5] = ["BayerRG8", "BayerGR8", "BayerGB8", "BayerBG8", "Mono8"];

/// A GigE Vision camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Gige {
    /// The serial number; without serial number and address, the only camera that is found is used.
    pub serial: Option<String>,
    /// IP address or host name, instead of the serial number: then no camera is searched for.
    pub address: Option<String>,
    /// The user set in the camera from which all other settings start; image size and position on the sensor are
    /// never changed.
    pub user_set: String,
    /// One of [`PIXEL_FORMATS`].
    pub pixel_format: &'static str,
    /// Exposure time, µs.
    pub exposure_us: f64,
    /// Gain, dB; `None` for that of the user set.
    pub gain_db: Option<f64>,
    /// Size of a packet with its headers, bytes.
    pub packet_bytes: u16,
}

pub(super) const KIND: DeviceKind<'_, fn(&Section<'_, '_>) -> Option<Gige>> = DeviceKind {
    keyword: "gige",
    required_keys: &[(
        "exposure_us",
        "kind = \"gige\" needs it, in µs: take a multiple of 10000 for lamps on mains of 50 Hz, of 8333 on 60 Hz, \
         such that the brightest parts are not saturated (`panelprep shoot corner` reports it)",
    )],
    keys: &["serial", "address", "user_set", "pixel_format", "exposure_us", "gain_db", "packet_bytes"],
    parse,
};

fn parse(section: &Section<'_, '_>) -> Option<Gige> {
    let text = |key| section.parse::<Option<String>>(key, (), Some(None));
    let (serial, address) = (text("serial"), text("address"));
    let user_set = section.parse::<String>("user_set", (), Some("Default".to_owned()));
    let pixel_format = section.parse::<&str>("pixel_format", PIXEL_FORMATS.to_vec(), Some(PIXEL_FORMATS[0]));
    // A missing value is reported by the code that knows the kind.
    let exposure_us = section.parse::<Option<f64>>("exposure_us", 1.0..=10e6, Some(None));
    let gain_db = section.parse::<Option<f64>>("gain_db", 0.0..=60.0, Some(None));
    // From the minimum of GigE Vision to the largest usual jumbo frame.
    let packet_bytes = section.parse("packet_bytes", 576..=9_000, Some(1_400));
    let (serial, address) = (serial?, address?);
    if serial.is_some() && address.is_some() {
        section.problem("address", "cannot be combined with serial; state only one of the two keys");
        return None;
    }
    Some(Gige {
        serial,
        address,
        user_set: user_set?,
        pixel_format: pixel_format?,
        exposure_us: exposure_us??,
        gain_db: gain_db?,
        packet_bytes: packet_bytes?,
    })
}
