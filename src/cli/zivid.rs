//! The Zivid camera of the cell, and its worker process, which is this program in another role.

use super::args::ZividWorker;
use super::disk;
use super::fault::{DeviceFault, Fault};
use super::load::calibrated_serial;
use panelprep_base::geometry::PinholeCamera;
use panelprep_cell::cell::{Camera, Cell, ZividCamera, ZividSettings, ZividUse};
use panelprep_devices::zivid::library::Sdk;
use panelprep_devices::zivid::{
    AnswerTimeouts, CameraSetup, Restarts, Size, Source, ZividScanner, command_launcher, process, worker,
};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// File name of the camera library.
pub const LIBRARY: &str = "libpanelprep_zivid.so";
/// The hidden command with which the worker process is started.
pub const ROLE: &str = "zivid-worker";

/// The path of the running program, which the kernel keeps even after an upgrade has replaced the file. So a worker
/// that a running service restarts has the same protocol version as the service.
pub const OWN_EXECUTABLE: &str = "/proc/self/exe";

/// Starts the camera that the cell file names, without waiting until it is ready; `camera` is its calibration.
///
/// # Errors
/// If the cell file does not name the camera's settings, a file cannot be read or is invalid, or the worker cannot be
/// started.
pub fn scanner(cell: &Cell, zivid: &ZividCamera, camera: &PinholeCamera) -> Result<ZividScanner, Fault> {
    let [(_, scan_yaml), (_, picture_yaml)] = texts(zivid)?;
    let source = match (&zivid.serial, &zivid.file_camera) {
        (_, Some(file)) => Source::File(file.clone()),
        (Some(serial), None) => Source::Serial(serial.clone()),
        (None, None) => Source::Only,
    };
    let setup = CameraSetup {
        source,
        // A file camera may have another serial number than the calibrated camera, so it is not compared.
        serial: calibrated_serial(cell.calibration().scanner.as_deref())?.filter(|_| zivid.file_camera.is_none()),
        size: Size { width: camera.width_px, height: camera.height_px },
        scan_yaml,
        picture_yaml,
        restarts: Restarts::default(),
        timeouts: AnswerTimeouts::default(),
    };
    let library = zivid.library.clone().unwrap_or_else(|| PathBuf::from(LIBRARY));
    let arguments = [ROLE.into(), "--library".into(), library.into()];
    ZividScanner::start(setup, command_launcher(OWN_EXECUTABLE.into(), arguments.into())).map_err(Fault::stage)
}

/// Returns the settings of the camera as they are stored with a cycle: for each purpose the text of its file. Empty if
/// the scanner is not a Zivid, or the cell file names no settings.
///
/// # Errors
/// The errors of [`checked_settings`].
pub fn settings(cell: &Cell) -> Result<Vec<(&'static str, String)>, Fault> {
    match cell.scanner() {
        Camera::Device(zivid) => Ok(texts(zivid)?.into()),
        _ => Ok(Vec::new()),
    }
}

fn texts(zivid: &ZividCamera) -> Result<[(&'static str, String); 2], Fault> {
    let [(scan, _), (film, _)] = read(zivid)?;
    Ok([("zivid_settings", scan), ("zivid_settings_2d", film)])
}

/// Reads and checks the settings of the camera, for 3D scans and for the film.
///
/// # Errors
/// If a settings file is not named, cannot be read, or is invalid.
pub fn checked_settings(zivid: &ZividCamera) -> Result<[ZividSettings; 2], Fault> {
    Ok(read(zivid)?.map(|(_, settings)| settings))
}

fn read(zivid: &ZividCamera) -> Result<[(String, ZividSettings); 2], Fault> {
    let read = |key, file: &Option<PathBuf>, usage| {
        let file = file.as_deref().ok_or(DeviceFault::NoCameraSettings { key })?;
        let text = disk::read_text(file)?;
        let settings = ZividSettings::check(&file.display().to_string(), &text, usage)?;
        Ok::<_, Fault>((text, settings))
    };
    let scan = read("settings", &zivid.settings, ZividUse::Scan)?;
    Ok([scan, read("settings_2d", &zivid.settings_2d, ZividUse::Film)?])
}

/// Runs the worker process, whose standard input is the socket to the daemon, until the daemon closes the connection.
pub fn worker(args: &ZividWorker) -> ExitCode {
    match serve_worker(&args.library) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("the worker process of the 3D camera stopped: {error}");
            ExitCode::FAILURE
        }
    }
}

fn serve_worker(library: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let mut daemon =
        process::daemon().map_err(|error| format!("only the panelprep service may start this command: {error}"))?;
    match Sdk::open(library) {
        Ok(sdk) => Ok(worker::serve(daemon, Box::new(sdk))?),
        Err(error) => {
            worker::send_hello(&mut daemon, Err(error.to_string()))?;
            Err(error.into())
        }
    }
}
