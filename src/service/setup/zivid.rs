//! The Zivid camera of the configured cell. Its worker is this program in another role.

use super::cell_files::calibrated_serial;
use super::disk;
use super::fault::SetupFault;
use panelprep_base::geometry::PinholeCamera;
use panelprep_cell::cell::{Camera, Cell, ZividCamera, ZividSettings, ZividUse};
use panelprep_devices::zivid::{
    AnswerTimeouts, CameraSetup, Restarts, Size, Source, ZividScanner, command_launcher,
};
use std::path::PathBuf;

/// Name of the library for the loader.
pub const LIBRARY: &str = "libpanelprep_zivid.so";
/// The worker's role on the command line.
pub const ROLE: &str = "zivid-worker";

/// This program's file as the kernel keeps it open. After an upgrade has replaced the file, this is still the old
/// program. So a worker that a running service starts again uses the same version of the protocol as the service.
pub const OWN_EXECUTABLE: &str = "/proc/self/exe";

/// Starts the camera that the cell's file names, and does not wait until it is ready; `camera` is its calibration.
///
/// # Errors
/// If the cell does not name the camera's settings, a file cannot be read or is invalid, or there is no thread or
/// program.
pub fn scanner(cell: &Cell, zivid: &ZividCamera, camera: &PinholeCamera) -> Result<ZividScanner, SetupFault> {
    let [(_, scan_yaml), (_, picture_yaml)] = texts(zivid)?;
    let source = match (&zivid.serial, &zivid.file_camera) {
        (_, Some(file)) => Source::File(file.clone()),
        (Some(serial), None) => Source::Serial(serial.clone()),
        (None, None) => Source::Only,
    };
    let setup = CameraSetup {
        source,
        // A file camera, which reads its shots from a file, may have another serial number.
        serial: calibrated_serial(cell.calibration().scanner.as_deref())?.filter(|_| zivid.file_camera.is_none()),
        size: Size { width: camera.width_px, height: camera.height_px },
        scan_yaml,
        picture_yaml,
        restarts: Restarts::default(),
        timeouts: AnswerTimeouts::default(),
    };
    let library = zivid.library.clone().unwrap_or_else(|| PathBuf::from(LIBRARY));
    let arguments = [ROLE.into(), "--library".into(), library.into()];
    ZividScanner::start(setup, command_launcher(OWN_EXECUTABLE.into(), arguments.into())).map_err(SetupFault::stage)
}

/// Returns the camera's settings in the form that a cycle stores: the purpose of each and its text. Empty for another
/// camera, or if the cell's file names none.
///
/// # Errors
/// As [`checked_settings`].
pub fn settings(cell: &Cell) -> Result<Vec<(&'static str, String)>, SetupFault> {
    match cell.scanner() {
        Camera::Device(zivid) => Ok(texts(zivid)?.into()),
        _ => Ok(Vec::new()),
    }
}

fn texts(zivid: &ZividCamera) -> Result<[(&'static str, String); 2], SetupFault> {
    let [(scan, _), (film, _)] = read(zivid)?;
    Ok([("zivid_settings", scan), ("zivid_settings_2d", film)])
}

/// Reads the camera's settings: those for 3D shots, and those for the film.
///
/// # Errors
/// If a file is not named, cannot be read, or is invalid.
pub fn checked_settings(zivid: &ZividCamera) -> Result<[ZividSettings; 2], SetupFault> {
    Ok(read(zivid)?.map(|(_, settings)| settings))
}

fn read(zivid: &ZividCamera) -> Result<[(String, ZividSettings); 2], SetupFault> {
    let read = |key, file: &Option<PathBuf>, usage| {
        let file = file.as_deref().ok_or(SetupFault::NoCameraSettings { key })?;
        let text = disk::read_text(file)?;
        let settings = ZividSettings::check(&file.display().to_string(), &text, usage)?;
        Ok::<_, SetupFault>((text, settings))
    };
    let scan = read("settings", &zivid.settings, ZividUse::Scan)?;
    Ok([scan, read("settings_2d", &zivid.settings_2d, ZividUse::Film)?])
}
