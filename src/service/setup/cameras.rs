//! Opens a camera of the cell for the size in its calibration or, without one, for its own size.
//!
//! A driver checks every picture against one size. A camera without a calibration is first opened for [`UNKNOWN_PX`];
//! it refuses and reports its real size, and is then opened for that size.

use super::cell_files::LoadedCalibration;
#[cfg(feature = "gige")]
use super::cell_files::calibrated_serial;
use super::fault::SetupFault;
use panelprep_base::geometry::PinholeCamera;
use panelprep_cell::cell::{self, Cell};
use panelprep_devices::UNKNOWN_PX;
#[cfg(feature = "gige")]
use panelprep_devices::cameras::GigeFlangeCamera;
use panelprep_devices::cameras::{CameraError, CameraRole, FlangeCamera};
use panelprep_devices::zivid::{AnswerTimeouts, ZividFault, ZividScanner};

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
