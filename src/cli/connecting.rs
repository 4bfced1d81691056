//! Finds what responds: a program at an address, and the cameras and the controller of a cell. No data is sent to a
//! program, nothing is set, and nothing moves.

use panelprep_devices::gige;
use panelprep_devices::zivid::{
    AnswerTimeouts, CameraSetup, Restarts, Size, Source, ZividFault, ZividScanner, command_launcher,
};
use panelprep_service::daemon::accept_connection;
use panelprep_service::setup::cameras::{OWN_EXECUTABLE, ZIVID_LIBRARY, ZIVID_ROLE};
use std::time::Duration;

/// Time limit for the controller's answer.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(2);

/// The devices of one kind that were found: serial numbers, and a text for a person.
pub(super) struct FoundDevices {
    pub serials: Vec<String>,
    pub description: String,
}

/// Finds the GigE Vision cameras on all networks of this computer.
pub(super) fn find_gige_cameras() -> FoundDevices {
    match gige::search() {
        Ok(cameras) if cameras.is_empty() => FoundDevices {
            serials: vec![],
            description: "no GigE Vision camera responds on the networks of this computer".to_owned(),
        },
        Ok(cameras) => {
            let each: Vec<String> =
                cameras.iter().map(|camera| format!("serial {} at {}", camera.serial, camera.address)).collect();
            let words = format!("GigE Vision cameras that respond: {}", each.join("; "));
            FoundDevices { serials: cameras.into_iter().map(|camera| camera.serial).collect(), description: words }
        }
        Err(words) => FoundDevices { serials: vec![], description: words },
    }
}

/// Finds the connected Zivid camera, if there is only one.
pub(super) fn find_zivid_camera() -> FoundDevices {
    match find_single_zivid_serial() {
        Ok(serial) => {
            FoundDevices { description: format!("a Zivid camera responds: serial {serial}"), serials: vec![serial] }
        }
        Err(words) => FoundDevices { serials: vec![], description: format!("no Zivid camera was found: {words}") },
    }
}

/// Returns the serial number of the connected camera, if there is only one. Afterwards the worker releases the camera.
fn find_single_zivid_serial() -> Result<String, String> {
    let setup = CameraSetup {
        source: Source::Only,
        // No camera has an empty serial number, so the worker reports the camera that it finds and changes none of its
        // settings.
        serial: Some(String::new()),
        size: Size { width: 0, height: 0 },
        scan_yaml: String::new(),
        picture_yaml: String::new(),
        restarts: Restarts::default(),
        timeouts: AnswerTimeouts::default(),
    };
    let arguments = [ZIVID_ROLE.into(), "--library".into(), ZIVID_LIBRARY.into()];
    let camera = ZividScanner::start(setup, command_launcher(OWN_EXECUTABLE.into(), arguments.into()))
        .map_err(|error| error.to_string())?;
    match camera.wait_ready(AnswerTimeouts::default().start()) {
        Err(ZividFault::WrongCamera { found, .. }) => Ok(found),
        Err(fault) => Err(fault.to_string()),
        Ok(()) => Err("the camera reports no serial number".to_owned()),
    }
}

/// Returns a text that states whether a program listens at the controller's address.
pub(super) fn controller(host: &str, port: u16) -> String {
    let place = format!("{host}, port {port}");
    match accept_connection((host.to_owned(), port), RESPONSE_TIMEOUT) {
        Ok(()) => format!("{place}: the controller accepts connections; `panelprep doctor` checks more"),
        Err(problem) => format!("{place}: no response yet: {problem}"),
    }
}
