//! Opens only one camera of the cell. If the service uses the camera, it is borrowed from the service.

use super::super::args::{Shot, Simulation};
use super::super::fault::{DeviceFault, Fault};
use super::super::live::{self, SimulatedController};
use panelprep_base::geometry::PinholeCamera;
use panelprep_cell::cell::{self, RobotKind};
use panelprep_devices::cameras::{FlangeCamera, RecordedFlangeCamera, RecordedScanner, Scanner};
use panelprep_service::daemon::{BorrowedFlangeCamera, RemoteScanner, service_state};
use panelprep_service::setup::{CellFiles, SetupFault, cameras};
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

/// Starts the simulated world, with its own mock controller.
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
    let state = if is_recorded { None } else { service_state(&socket) }?;
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
    let lens = cameras::lens(files.scanner())?;
    match files.cell.scanner() {
        cell::Camera::Simulated => {
            let simulated = start_simulated_world(files, wanted, lens)?;
            let camera: Box<dyn Scanner> = Box::new(simulated.cameras().0);
            Ok(OpenedCamera { simulated: Some(simulated), camera })
        }
        cell::Camera::Recorded { folder } => {
            let open = |lens: &PinholeCamera| RecordedScanner::open(folder, *lens).map_err(SetupFault::stage);
            let look = |camera: &mut RecordedScanner| match wanted.shot.is_scan() {
                true => camera.capture_3d().map(drop),
                false => camera.capture_2d().map(drop),
            };
            Ok(OpenedCamera::new(Box::new(cameras::open_with_size(lens, open, look)?.0)))
        }
        cell::Camera::Device(camera) => {
            progress("starting the 3D camera, which may take minutes");
            let open = |lens: &PinholeCamera| cameras::zivid_scanner(&files.cell, camera, lens);
            let (mut scanner, _) = cameras::open_with_size(lens, open, cameras::zivid_ready)?;
            cameras::zivid_ready(&mut scanner).map_err(Fault::stage)?;
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
    let own = cameras::lens(files.flange_camera())?;
    match files.cell.flange_camera() {
        cell::Camera::Simulated => {
            let simulated = start_simulated_world(files, wanted, cameras::lens(files.scanner())?)?;
            let camera: Box<dyn FlangeCamera> = Box::new(simulated.cameras().1);
            Ok(OpenedCamera { simulated: Some(simulated), camera })
        }
        cell::Camera::Recorded { folder } => {
            let open = |lens: &PinholeCamera| RecordedFlangeCamera::open(folder, *lens).map_err(SetupFault::stage);
            let look = |camera: &mut RecordedFlangeCamera| camera.capture().map(drop);
            Ok(OpenedCamera::new(Box::new(cameras::open_with_size(own, open, look)?.0)))
        }
        cell::Camera::Device(gige) => {
            progress("searching for the flange camera");
            let open = |lens: &PinholeCamera| cameras::gige_camera(&files.cell, gige, lens);
            Ok(OpenedCamera::new(cameras::open_with_size(own, open, |camera| camera.check_ready())?.0))
        }
    }
}
