//! Opens a single camera of the cell with the picture size of its calibration or, without a calibration, with its own
//! size. If the service uses the camera, the pictures are requested from the service.
//!
//! A driver compares every picture with a known size. A camera without a calibration is first opened with
//! [`UNKNOWN_PX`]: it refuses and reports its actual size, and is then opened with this size.

use super::super::args::{Shot, Simulation};
use super::super::fault::{CalibrationFault, DeviceFault, Fault};
use super::super::live::{self, SimulatedController};
use super::super::load::{CellFiles, LoadedCalibration};
use super::super::{ctl, zivid};
use panelprep_base::geometry::PinholeCamera;
use panelprep_cell::cell::{self, RobotKind};
use panelprep_devices::UNKNOWN_PX;
use panelprep_devices::cameras::{
    CameraError, CameraRole, FlangeCamera, RecordedFlangeCamera, RecordedScanner, Scanner,
};
use panelprep_devices::zivid::{AnswerTimeouts, ZividFault, ZividScanner};
use panelprep_service::daemon::{BorrowedFlangeCamera, RemoteScanner};
use panelprep_sim as sim;
use std::path::PathBuf;

/// An opened camera, with the simulated world if the cell is simulated.
pub struct OpenedCamera<C> {
    /// The camera.
    pub camera: C,
    /// The simulated world that the camera views, if there is one.
    pub simulated: Option<SimulatedController>,
}

impl<C> OpenedCamera<C> {
    fn new(camera: C) -> Self {
        OpenedCamera { camera, simulated: None }
    }
}

/// The requested shot.
pub struct RequestedShot {
    /// The kind of capture, which determines the camera.
    pub shot: Shot,
    /// Settings of the simulated cell.
    pub simulation: Simulation,
}

/// Returns the calibrated lens; `None` if the camera is not calibrated yet.
///
/// # Errors
/// If the calibration file cannot be read or has problems.
pub fn lens(found: Result<LoadedCalibration<PinholeCamera>, Fault>) -> Result<Option<PinholeCamera>, Fault> {
    match found {
        Ok(found) => Ok(Some(found.value)),
        Err(Fault::Calibration(
            CalibrationFault::NotCalibrated { .. } | CalibrationFault::CalibrationAway { .. },
        )) => Ok(None),
        Err(fault) => Err(fault),
    }
}

/// Returns a lens with this picture size; a driver uses no other value of the lens.
pub fn camera_of_size([width_px, height_px]: [usize; 2]) -> PinholeCamera {
    let (fx_px, fy_px) = (width_px as f64, width_px as f64);
    let (cx_px, cy_px) = (width_px as f64 / 2.0, height_px as f64 / 2.0);
    PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 }
}

/// Waits until a Zivid camera is ready.
///
/// # Errors
/// If the camera does not become ready; if its size was not known, the error contains the size.
pub fn zivid_ready(scanner: &mut ZividScanner) -> Result<(), CameraError> {
    scanner.wait_ready(AnswerTimeouts::default().start()).map_err(|fault| match fault {
        ZividFault::WrongSize { found_px, expected_px: UNKNOWN_PX, .. } => {
            CameraError::WrongSize { which: CameraRole::Scanner, found_px, expected_px: UNKNOWN_PX }
        }
        fault => fault.into(),
    })
}

/// Opens a camera with its calibrated size, or else with its own size; also returns the size.
///
/// # Errors
/// If the camera cannot be opened or delivers no picture.
pub fn open_with_size<C>(
    lens: Option<PinholeCamera>,
    open: impl Fn(&PinholeCamera) -> Result<C, Fault>,
    look: impl Fn(&mut C) -> Result<(), CameraError>,
) -> Result<(C, [usize; 2]), Fault> {
    if let Some(lens) = lens {
        return Ok((open(&lens)?, [lens.width_px, lens.height_px]));
    }
    let mut camera = open(&camera_of_size(UNKNOWN_PX))?;
    match look(&mut camera) {
        Ok(()) => Ok((camera, UNKNOWN_PX)),
        Err(CameraError::WrongSize { found_px, .. }) => {
            // The camera must be released before it is opened again.
            drop(camera);
            Ok((open(&camera_of_size(found_px))?, found_px))
        }
        Err(error) => Err(Fault::stage(error)),
    }
}

/// Starts a simulated world with its own mock controller.
fn start_simulated_world(
    files: &CellFiles,
    wanted: &RequestedShot,
    scanner: Option<PinholeCamera>,
) -> Result<SimulatedController, Fault> {
    if files.cell.robot().kind() != RobotKind::Mock {
        return Err(DeviceFault::NoWorld.into());
    }
    let full = *sim::Cell::new(wanted.simulation.seed, sim::Scene::Good, 1).scanner();
    let cell = live::simulated_cell(&scanner.unwrap_or(full), wanted.simulation)?;
    SimulatedController::start_parked(&files.cell, cell, wanted.shot.needs_light())
}

/// Returns the socket of the service, if the service runs and uses this camera. A recorded camera is not used through
/// the service, because each program can read the recording itself.
fn service_socket(files: &CellFiles, is_recorded: bool, progress: &dyn Fn(&str)) -> Option<PathBuf> {
    let socket = files.socket();
    let state = if is_recorded { None } else { ctl::service_state(&socket) }?;
    progress(&format!("the service (state {state}) takes the pictures"));
    Some(socket)
}

/// Opens the fixed 3D camera.
///
/// # Errors
/// If the camera cannot be opened.
pub fn scanner(
    files: &CellFiles,
    wanted: &RequestedShot,
    progress: &dyn Fn(&str),
) -> Result<OpenedCamera<Box<dyn Scanner>>, Fault> {
    let is_recorded = matches!(files.cell.scanner(), cell::Camera::Recorded { .. });
    if let Some(socket) = service_socket(files, is_recorded, progress) {
        return Ok(OpenedCamera::new(Box::new(RemoteScanner::new(socket))));
    }
    let lens = lens(files.scanner())?;
    match files.cell.scanner() {
        cell::Camera::Simulated => {
            let simulated = start_simulated_world(files, wanted, lens)?;
            let camera: Box<dyn Scanner> = Box::new(simulated.cameras().0);
            Ok(OpenedCamera { simulated: Some(simulated), camera })
        }
        cell::Camera::Recorded { folder } => {
            let open = |lens: &PinholeCamera| RecordedScanner::open(folder, *lens).map_err(Fault::stage);
            let look = |camera: &mut RecordedScanner| match wanted.shot.is_scan() {
                true => camera.capture_3d().map(drop),
                false => camera.capture_2d().map(drop),
            };
            Ok(OpenedCamera::new(Box::new(open_with_size(lens, open, look)?.0)))
        }
        cell::Camera::Device(camera) => {
            progress("starting the 3D camera, which may take minutes");
            let open = |lens: &PinholeCamera| zivid::scanner(&files.cell, camera, lens);
            let (mut scanner, _) = open_with_size(lens, open, zivid_ready)?;
            zivid_ready(&mut scanner).map_err(Fault::stage)?;
            Ok(OpenedCamera::new(Box::new(scanner)))
        }
    }
}

/// Opens the camera on the flange.
///
/// # Errors
/// If the camera cannot be opened.
pub fn flange_camera(
    files: &CellFiles,
    wanted: &RequestedShot,
    progress: &dyn Fn(&str),
) -> Result<OpenedCamera<Box<dyn FlangeCamera>>, Fault> {
    let is_recorded = matches!(files.cell.flange_camera(), cell::Camera::Recorded { .. });
    if let Some(socket) = service_socket(files, is_recorded, progress) {
        return Ok(OpenedCamera::new(Box::new(BorrowedFlangeCamera::new(socket))));
    }
    let own = lens(files.flange_camera())?;
    match files.cell.flange_camera() {
        cell::Camera::Simulated => {
            let simulated = start_simulated_world(files, wanted, lens(files.scanner())?)?;
            let camera: Box<dyn FlangeCamera> = Box::new(simulated.cameras().1);
            Ok(OpenedCamera { simulated: Some(simulated), camera })
        }
        cell::Camera::Recorded { folder } => {
            let open = |lens: &PinholeCamera| RecordedFlangeCamera::open(folder, *lens).map_err(Fault::stage);
            let look = |camera: &mut RecordedFlangeCamera| camera.capture().map(drop);
            Ok(OpenedCamera::new(Box::new(open_with_size(own, open, look)?.0)))
        }
        cell::Camera::Device(gige) => {
            progress("searching for the flange camera");
            let open = |lens: &PinholeCamera| live::gige_camera(&files.cell, gige, lens);
            Ok(OpenedCamera::new(open_with_size(own, open, |camera| camera.check_ready())?.0))
        }
    }
}
