//! The settings of the Zivid camera, whose worker is this program in another role; and how a camera of the cell is
//! opened for the size in its calibration or, without one, for its own size.
//!
//! A driver checks every picture against one size. A camera without a calibration is first opened for [`UNKNOWN_PX`];
//! it refuses and reports its real size, and is then opened for that size.

use super::cell_files::{LoadedCalibration, calibrated_serial};
use super::disk;
use super::fault::SetupFault;
use panelprep_base::geometry::PinholeCamera;
use panelprep_cell::cell::{self, Camera, Cell, ZividCamera, ZividSettings, ZividUse};
use panelprep_devices::UNKNOWN_PX;
#[cfg(feature = "gige")]
use panelprep_devices::cameras::GigeFlangeCamera;
use panelprep_devices::cameras::{CameraError, CameraRole, FlangeCamera};
use panelprep_devices::zivid::{
    AnswerTimeouts, CameraSetup, Restarts, Size, Source, ZividFault, ZividScanner, command_launcher,
};
use std::path::PathBuf;

/// Name of the library for the loader.
pub const ZIVID_LIBRARY: &str = "libpanelprep_zivid.so";
/// The worker's role on the command line.
pub const ZIVID_ROLE: &str = "zivid-worker";

/// This program's file as the kernel keeps it open. After an upgrade has replaced the file, this is still the old
/// program. So a worker that a running service starts again uses the same version of the protocol as the service.
pub const OWN_EXECUTABLE: &str = "/proc/self/exe";

/// Starts the camera that the cell's file names, and does not wait until it is ready; `camera` is its calibration.
///
/// # Errors
/// If the cell does not name the camera's settings, a file cannot be read or is invalid, or there is no thread or
/// program.
pub fn zivid_scanner(cell: &Cell, zivid: &ZividCamera, camera: &PinholeCamera) -> Result<ZividScanner, SetupFault> {
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
    let library = zivid.library.clone().unwrap_or_else(|| PathBuf::from(ZIVID_LIBRARY));
    let arguments = [ZIVID_ROLE.into(), "--library".into(), library.into()];
    ZividScanner::start(setup, command_launcher(OWN_EXECUTABLE.into(), arguments.into())).map_err(SetupFault::stage)
}

/// Returns the camera's settings in the form that a cycle stores: the purpose of each and its text. Empty for another
/// camera, or if the cell's file names none.
///
/// # Errors
/// As [`checked_zivid_settings`].
pub fn zivid_settings(cell: &Cell) -> Result<Vec<(&'static str, String)>, SetupFault> {
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
pub fn checked_zivid_settings(zivid: &ZividCamera) -> Result<[ZividSettings; 2], SetupFault> {
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

/// Returns the lens's calibration; `None` if there is none yet.
///
/// # Errors
/// If its file cannot be read or has problems.
pub fn lens(
    found: Result<LoadedCalibration<PinholeCamera>, SetupFault>,
) -> Result<Option<PinholeCamera>, SetupFault> {
    match found {
        Ok(found) => Ok(Some(found.value)),
        Err(SetupFault::NotCalibrated { .. } | SetupFault::CalibrationAway { .. }) => Ok(None),
        Err(fault) => Err(fault),
    }
}

/// Returns a camera of this size, which is all that a driver needs from a calibration.
pub fn camera_of_size([width_px, height_px]: [usize; 2]) -> PinholeCamera {
    let (fx_px, fy_px) = (width_px as f64, width_px as f64);
    let (cx_px, cy_px) = (width_px as f64 / 2.0, height_px as f64 / 2.0);
    PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 }
}

/// Waits until a Zivid camera is ready.
///
/// # Errors
/// If it does not become ready; if no size was known, the error states the camera's size.
pub fn zivid_ready(scanner: &mut ZividScanner) -> Result<(), CameraError> {
    scanner.wait_ready(AnswerTimeouts::default().start()).map_err(|fault| match fault {
        ZividFault::WrongSize { found_px, expected_px: UNKNOWN_PX, .. } => {
            CameraError::WrongSize { which: CameraRole::Scanner, found_px, expected_px: UNKNOWN_PX }
        }
        fault => fault.into(),
    })
}

/// Opens a camera for its calibrated size or for its own; also returns that size.
///
/// # Errors
/// If it cannot be opened, or does not deliver.
pub fn open_with_size<C>(
    lens: Option<PinholeCamera>,
    open: impl Fn(&PinholeCamera) -> Result<C, SetupFault>,
    look: impl Fn(&mut C) -> Result<(), CameraError>,
) -> Result<(C, [usize; 2]), SetupFault> {
    if let Some(lens) = lens {
        return Ok((open(&lens)?, [lens.width_px, lens.height_px]));
    }
    let mut camera = open(&camera_of_size(UNKNOWN_PX))?;
    match look(&mut camera) {
        Ok(()) => Ok((camera, UNKNOWN_PX)),
        Err(CameraError::WrongSize { found_px, .. }) => {
            // A camera is released before it is opened again.
            drop(camera);
            Ok((open(&camera_of_size(found_px))?, found_px))
        }
        Err(error) => Err(SetupFault::stage(error)),
    }
}

/// Opens the GigE Vision camera that the cell's file names.
///
/// # Errors
/// If a file cannot be read, or there is no thread or driver.
#[cfg(feature = "gige")]
pub fn gige_camera(
    cell: &Cell,
    gige: &cell::Gige,
    lens: &PinholeCamera,
) -> Result<Box<dyn FlangeCamera>, SetupFault> {
    let serial = calibrated_serial(cell.calibration().flange_camera.as_deref())?;
    Ok(Box::new(GigeFlangeCamera::open(gige, lens, serial).map_err(SetupFault::stage)?))
}

/// Refuses the GigE Vision camera that the cell's file names.
///
/// # Errors
/// Always.
#[cfg(not(feature = "gige"))]
pub fn gige_camera(_: &Cell, _: &cell::Gige, _: &PinholeCamera) -> Result<Box<dyn FlangeCamera>, SetupFault> {
    Err(SetupFault::BuiltWithoutGige)
}
