//! `[scanner]`, `[flange_camera]`, `[robot]`: the connected devices, and the keys for a GigE camera (`kind = "gige"`)
//! and for a Zivid camera (`kind = "zivid"`).

use super::proof_stage::{ProofStage, SignedPage, Unsigned, UnsignedCause};
use core::net::IpAddr;
use panelprep_base::config::{Choice, Section};
use std::path::{Path, PathBuf};

/// The source of a camera's pictures; `Device` contains the settings of a real camera. The default is a simulated
/// camera.
#[derive(Debug, Clone, PartialEq)]
pub enum Camera<Device> {
    /// `kind = "simulated"`: pictures are rendered.
    Simulated,
    /// `kind = "recorded"`: the files of a folder are replayed in the alphabetical order of their names.
    Recorded {
        /// The folder of the recorded files.
        folder: PathBuf,
    },
    /// A real camera with its settings.
    Device(Device),
}

impl<Device> Camera<Device> {
    /// Returns whether the camera's pictures are rendered.
    pub fn is_simulated(&self) -> bool {
        matches!(self, Camera::Simulated)
    }
}

/// A kind of real camera: its keyword, its required keys with a hint for each, the keys that no other kind has, and its
/// parser.
pub(super) struct DeviceKind<'k, Parse> {
    pub keyword: &'static str,
    pub required_keys: &'k [(&'static str, &'static str)],
    pub keys: &'k [&'static str],
    pub parse: Parse,
}

/// Parses the table of a camera: a device of this kind, a recorded or a simulated camera. A key without effect is
/// reported as a problem.
pub(super) fn parse_camera<Device>(
    cell_folder: &Path,
    section: &Section<'_, '_>,
    device: DeviceKind<'_, impl FnOnce(&Section<'_, '_>) -> Option<Device>>,
) -> Option<Camera<Device>> {
    let kind = section.parse::<&str>("kind", vec!["simulated", "recorded", device.keyword], Some("simulated"));
    let folder = section.parse::<Option<String>>("folder", (), Some(None));
    let taken = (device.parse)(section);
    section.finish();
    let (kind, folder) = (kind?, folder?);
    let needs = device.keys.iter().map(|key| (*key, device.keyword)).chain([("folder", "recorded")]);
    let mut right = true;
    for (key, needs) in needs.filter(|(key, needs)| section.has_key(key) && kind != *needs) {
        section.problem(
            key,
            format!("has no effect with kind = \"{kind}\"; this key is valid only with kind = \"{needs}\""),
        );
        right = false;
    }
    let missing = device.required_keys.iter().filter(|(key, _)| kind == device.keyword && !section.has_key(key));
    for (key, what_to_do) in missing {
        section.problem(key, format!("is missing; {what_to_do}"));
        right = false;
    }
    let camera = match (kind, folder) {
        ("simulated", _) => Camera::Simulated,
        ("recorded", Some(folder)) => Camera::Recorded { folder: cell_folder.join(folder) },
        ("recorded", None) => {
            section.problem("folder", "is missing; kind = \"recorded\" needs the folder of the recording");
            return None;
        }
        _ => Camera::Device(taken?),
    };
    right.then_some(camera)
}

/// The robot controller to which the robot link connects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotKind {
    /// A mock controller inside this program.
    Mock,
    /// A KUKA controller over EthernetKRL.
    Eki,
}

impl Choice for RobotKind {
    const KEYWORDS: &'static [(&'static str, Self)] = &[("mock", RobotKind::Mock), ("eki", RobotKind::Eki)];
}

/// How the mock controller is implemented.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MockController {
    /// Executes the real source text of the controller's programs.
    Programs,
    /// A handwritten model of the controller's programs.
    Model,
}

impl Choice for MockController {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("programs", MockController::Programs), ("model", MockController::Model)];
}

/// The robot controller: a TCP server with one port for commands and one for state messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Robot {
    kind: RobotKind,
    controller: MockController,
    host: String,
    command_port: u16,
    state_port: u16,
    programs_sum: Option<i32>,
    stated_stage: Option<ProofStage>,
    /// The newest signed page of the acceptance tests, from the store. The cell's file does not contain it.
    signed_page: Option<SignedPage>,
}

impl Robot {
    /// Returns the kind of the robot controller.
    pub fn kind(&self) -> RobotKind {
        self.kind
    }

    /// Returns the implementation of the mock controller.
    pub fn controller(&self) -> MockController {
        self.controller
    }

    /// Returns the host name or address of the controller; for the mock controller, this computer.
    pub fn host(&self) -> &str {
        &self.host
    }

    /// Returns the port of the command channel.
    pub fn command_port(&self) -> u16 {
        self.command_port
    }

    /// Returns the port of the state channel.
    pub fn state_port(&self) -> u16 {
        self.state_port
    }

    /// Returns the checksum of the controller's programs and of `cell_config.dat` with which the cell was accepted;
    /// `None` if the cell's file states none.
    pub fn programs_sum(&self) -> Option<i32> {
        self.programs_sum
    }

    /// Returns the last stage of the acceptance tests that is signed according to the cell's file.
    pub fn stated_stage(&self) -> Option<ProofStage> {
        self.stated_stage
    }

    /// Returns the last stage of the acceptance tests that is treated as signed. Both are required: the cell's file
    /// states the stage, and the newest signed page in the store confirms it for the accepted programs.
    pub fn signed_stage(&self) -> Option<ProofStage> {
        let page = self.signed_page.filter(|page| Some(page.programs_sum) == self.programs_sum)?;
        Some(self.stated_stage?.min(page.proven_stage()?))
    }

    /// Returns the settings with the newest signed page of the acceptance tests in the store; `None` if the store has
    /// none.
    #[must_use]
    pub fn with_signed_page(self, signed_page: Option<SignedPage>) -> Self {
        Robot { signed_page, ..self }
    }

    /// Checks that this stage of the acceptance tests is signed. The mock controller inside this program needs no
    /// tests. Any other controller is treated as a real one, even at a local address: only its state message shows
    /// whether it is a mock controller.
    ///
    /// # Errors
    /// If the stage is not signed; the error states the cause.
    pub fn check_stage_signed(&self, needed: ProofStage) -> Result<(), Unsigned> {
        let signed = self.signed_stage();
        if self.kind == RobotKind::Mock || signed >= Some(needed) {
            return Ok(());
        }
        Err(Unsigned { needed, signed, why: self.find_unsigned_cause(needed) })
    }

    fn find_unsigned_cause(&self, needed: ProofStage) -> UnsignedCause {
        let Some(stated) = self.stated_stage else { return UnsignedCause::NotStated };
        if stated < needed && self.signed_stage() == Some(stated) {
            return UnsignedCause::Lower(stated);
        }
        match (self.signed_page, self.programs_sum) {
            (Some(page), Some(accepted)) if page.programs_sum != accepted => {
                UnsignedCause::OtherPrograms { stated, page: page.programs_sum, accepted }
            }
            (Some(SignedPage { wrong_since: Some(wrong), .. }), Some(_)) if wrong <= needed => {
                UnsignedCause::WrongSince { stated, wrong }
            }
            (Some(page), Some(_)) => UnsignedCause::LowerPage { stated, page: page.stage },
            _ => UnsignedCause::NoPage(stated),
        }
    }

    /// Returns whether the controller's address belongs to this computer. There may be a mock controller for a
    /// rehearsal (`mock-robot`), or the end of a tunnel to a real controller: only the controller's state message
    /// distinguishes the two, and it is checked before any motion.
    pub fn is_local_controller(&self) -> bool {
        is_local_host(&self.host)
    }
}

/// Returns whether a host is this computer, so that no data pass over a network.
pub(super) fn is_local_host(host: &str) -> bool {
    host == "localhost" || host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Returns whether the text is an IP address or a host name (RFC 1123). Underscores are accepted, because some networks
/// use them.
pub(super) fn is_valid_host(host: &str) -> bool {
    let is_label = |label: &str| {
        (1..=63).contains(&label.len())
            && label.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
            && !label.starts_with('-')
            && !label.ends_with('-')
    };
    // A name whose last label is a number is intended as an IP address.
    let is_number = |label: &str| label.chars().all(|c| c.is_ascii_digit());
    let is_name = || {
        host.len() <= 253 && host.split('.').all(is_label) && !host.split('.').next_back().is_some_and(is_number)
    };
    host.parse::<IpAddr>().is_ok() || is_name()
}

/// The ports that the controller's firewall opens (`eki.md` 1.3).
const PORTS: std::ops::RangeInclusive<u16> = 54_600..=54_615;

/// Maximum checksum of the controller's programs: it is computed modulo 1000003.
const MAX_CHECKSUM: usize = 1_000_002;

const LOCAL_HOST: &str = "127.0.0.1";

pub(super) fn parse_robot(section: &Section<'_, '_>) -> Option<Robot> {
    let kind = section.parse("kind", (), Some(RobotKind::Mock));
    let controller = section.parse("controller", (), Some(MockController::Programs));
    let host = section.parse::<Option<String>>("host", (), Some(None));
    let command_port = section.parse("command_port", PORTS, Some(54_600));
    let state_port = section.parse("state_port", PORTS, Some(54_601));
    let programs_sum = section.parse::<Option<usize>>("programs_sum", 0..=MAX_CHECKSUM, Some(None));
    let stated_stage = section.parse::<Option<ProofStage>>("signed_stage", (), Some(None));
    section.finish();
    let (kind, controller, host, stated_stage) = (kind?, controller?, host?, stated_stage?);
    let (command_port, state_port, programs_sum) = (command_port?, state_port?, programs_sum?);
    if command_port == state_port {
        section.problem("state_port", format!("found {state_port}, valid: any port other than command_port's"));
        return None;
    }
    if stated_stage.is_some() && programs_sum.is_none() {
        let message = "needs programs_sum, the checksum of the tested programs; run `panelprep doctor --kuka DIR \
                       --accept` with the controller's files and add the line that it prints";
        section.problem("signed_stage", message);
        return None;
    }
    let host = match (kind, host) {
        (RobotKind::Eki, None) => {
            section.problem("host", "is missing; kind = \"eki\" needs the controller's address");
            return None;
        }
        (RobotKind::Mock, Some(host)) if !["localhost", LOCAL_HOST].contains(&host.as_str()) => {
            section
                .problem("host", format!("found \"{host}\"; kind = \"mock\" runs on this machine, {LOCAL_HOST}"));
            return None;
        }
        (_, Some(host))
            if host.parse::<IpAddr>().is_ok_and(|address| address.is_unspecified() || address.is_multicast()) =>
        {
            section.problem("host", format!("found \"{host}\", which is not the address of a single machine"));
            return None;
        }
        (_, Some(host)) if !is_valid_host(&host) => {
            let message = format!(
                "found \"{host}\", valid: an address such as 172.31.1.147, or a host name of letters, digits, - \
                 and dots"
            );
            section.problem("host", message);
            return None;
        }
        (_, host) => host.unwrap_or(LOCAL_HOST.to_owned()),
    };
    Some(Robot {
        kind,
        controller,
        host,
        command_port,
        state_port,
        programs_sum: programs_sum.and_then(|sum| i32::try_from(sum).ok()),
        stated_stage,
        signed_page: None,
    })
}

/// The pixel formats that a cell's file may name: monochrome, and the four Bayer patterns of a colour sensor, one byte
/// a pixel.
pub const PIXEL_FORMATS: [&str; 5] = ["BayerRG8", "BayerGR8", "BayerGB8", "BayerBG8", "Mono8"];

/// Settings of a GigE Vision camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Gige {
    /// The serial number. If neither serial number nor address is given, exactly one camera must be connected.
    pub serial: Option<String>,
    /// IP address or host name, as an alternative to the serial number; then no search for cameras is made.
    pub address: Option<String>,
    /// The user set that is loaded in the camera before the other settings. The image size and the position of the
    /// image on the sensor are not changed.
    pub user_set: String,
    /// The pixel format, one of [`PIXEL_FORMATS`].
    pub pixel_format: &'static str,
    /// Exposure time, µs.
    pub exposure_us: f64,
    /// Gain, dB; `None` for the gain of the user set.
    pub gain_db: Option<f64>,
    /// Size of a packet including its headers, bytes.
    pub packet_bytes: u16,
}

pub(super) const GIGE: DeviceKind<'_, fn(&Section<'_, '_>) -> Option<Gige>> = DeviceKind {
    keyword: "gige",
    required_keys: &[(
        "exposure_us",
        "kind = \"gige\" needs it, in µs: take a multiple of 10000 for lamps on mains of 50 Hz, of 8333 on 60 Hz, \
         such that the brightest parts are not saturated (`panelprep shoot corner` reports it)",
    )],
    keys: &["serial", "address", "user_set", "pixel_format", "exposure_us", "gain_db", "packet_bytes"],
    parse: parse_gige,
};

fn parse_gige(section: &Section<'_, '_>) -> Option<Gige> {
    let text = |key| section.parse::<Option<String>>(key, (), Some(None));
    let (serial, address) = (text("serial"), text("address"));
    let user_set = section.parse::<String>("user_set", (), Some("Default".to_owned()));
    let pixel_format = section.parse::<&str>("pixel_format", PIXEL_FORMATS.to_vec(), Some(PIXEL_FORMATS[0]));
    // No problem is reported here if the value is missing: `parse_camera` knows whether the kind of camera requires it.
    let exposure_us = section.parse::<Option<f64>>("exposure_us", 1.0..=10e6, Some(None));
    let gain_db = section.parse::<Option<f64>>("gain_db", 0.0..=60.0, Some(None));
    // From the minimum of GigE Vision to the usual maximum of a jumbo frame.
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

/// `kind = "zivid"`: settings of a Zivid 3D camera, which is used through the vendor's SDK.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ZividCamera {
    /// The camera's serial number. If neither serial number nor file camera is given, exactly one camera must be
    /// connected.
    pub serial: Option<String>,
    /// A file camera, `.zfc`, instead of a real camera: the SDK replays recorded raw pictures.
    pub file_camera: Option<PathBuf>,
    /// The settings file of 3D shots with colour, as saved by Zivid Studio; required for such a shot.
    pub settings: Option<PathBuf>,
    /// The settings file of colour pictures, as saved by Zivid Studio; required for such a picture.
    pub settings_2d: Option<PathBuf>,
    /// The path of `libpanelprep_zivid.so`; `None` to search for it in the system's library path.
    pub library: Option<PathBuf>,
}

/// Returns the description of the kind `zivid`. File paths are relative to the folder of the cell's file.
pub(super) fn zivid_kind(
    cell_folder: &Path,
) -> DeviceKind<'static, impl FnOnce(&Section<'_, '_>) -> Option<ZividCamera>> {
    let keys = &["serial", "file_camera", "settings", "settings_2d", "library"];
    DeviceKind {
        keyword: "zivid",
        required_keys: &[],
        keys,
        parse: |section: &Section<'_, '_>| parse_zivid(cell_folder, section),
    }
}

fn parse_zivid(cell_folder: &Path, section: &Section<'_, '_>) -> Option<ZividCamera> {
    let text = |key| section.parse::<Option<String>>(key, (), Some(None));
    let file = |key| Some(text(key)?.map(|name| cell_folder.join(name)));
    let (serial, file_camera) = (text("serial"), file("file_camera"));
    let (settings, settings_2d, library) = (file("settings"), file("settings_2d"), file("library"));
    let (serial, file_camera) = (serial?, file_camera?);
    if serial.is_some() && file_camera.is_some() {
        section.problem(
            "file_camera",
            "cannot be combined with serial: state serial for a real camera, or file_camera for a camera simulated \
             from a file",
        );
        return None;
    }
    Some(ZividCamera { serial, file_camera, settings: settings?, settings_2d: settings_2d?, library: library? })
}

#[cfg(test)]
mod tests {
    use super::super::{Camera, Cell};
    use super::*;

    #[test]
    fn paths_of_a_zivids_files_are_relative_to_the_cells_folder() {
        let text =
            "[scanner]\nkind = 'zivid'\nserial = '2127A0F3'\nsettings = 'scan.yml'\nsettings_2d = '/etc/film.yml'";
        let cell = Cell::check("cells/cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
        let zivid = ZividCamera {
            serial: Some("2127A0F3".to_owned()),
            settings: Some("cells/scan.yml".into()),
            settings_2d: Some("/etc/film.yml".into()),
            ..ZividCamera::default()
        };
        assert_eq!(cell.scanner(), &Camera::Device(zivid));
    }

    #[test]
    fn keys_that_cannot_be_combined_are_reported() {
        let says = |text: &str| Cell::check("f", text).expect_err("refused").to_string();
        let told = says("[scanner]\nsettings = 'scan.yml'\nlibrary = 'x.so'");
        assert!(told.contains(
            "f:2: scanner.settings: has no effect with kind = \"simulated\"; this key is valid only with kind = \
             \"zivid\""
        ));
        assert!(told.contains("f:3: scanner.library: has no effect"), "{told}");
        let told = says("[scanner]\nkind = 'zivid'\nserial = '1'\nfile_camera = 'a.zfc'");
        assert!(told.contains("f:4: scanner.file_camera: cannot be combined with serial"), "{told}");
        let told = says("[scanner]\nkind = 'zivid'\nsetings = 'scan.yml'");
        assert!(told.contains("setings") && told.contains("settings"), "{told}");
    }
}
