//! Checks of the connected devices: cameras, the robot's ports, the service. Nothing is moved.

use super::check::Check;
use super::{machine, zivid};
use crate::cli::fault::Fault;
use crate::cli::load::{CellFiles, LoadedCalibration};
use crate::cli::shoot::opening;
use crate::cli::{live, service_request};
use panelprep_base::geometry::PinholeCamera;
use panelprep_cell::cell::{Camera, Cell, Gige, RobotKind};
use panelprep_devices::cameras::{CameraError, RecordedFlangeCamera, RecordedScanner};
use panelprep_kuka::eki::LinkLoss;
use panelprep_service::daemon::{SingleError, SingleRobot};

/// Checks both cameras, and the sockets that a network camera needs.
pub(super) fn cameras(files: &CellFiles, warm_up: bool) -> Vec<Check> {
    let scanner = match files.cell.scanner() {
        Camera::Simulated => vec![simulated_check("scanner")],
        Camera::Recorded { folder } => {
            vec![recorded_check("scanner", files.scanner(), |lens| RecordedScanner::open(folder, lens).map(drop))]
        }
        Camera::Device(camera) => zivid::checks(files, camera, warm_up),
    };
    let flange_camera = match files.cell.flange_camera() {
        Camera::Simulated => vec![simulated_check("flange camera")],
        Camera::Recorded { folder } => {
            let open = |lens| RecordedFlangeCamera::open(folder, lens).map(drop);
            vec![recorded_check("flange camera", files.flange_camera(), open)]
        }
        Camera::Device(gige) => {
            let (camera, size_px) = gige_camera(files, gige);
            vec![machine::receive_buffer(size_px, gige.packet_bytes), camera]
        }
    };
    scanner.into_iter().chain(flange_camera).collect()
}

/// Opens the camera and waits for its first complete picture; if the service uses the camera, the service takes this
/// picture. Also returns the size if it is known: from its calibration, else from the camera itself.
#[cfg(feature = "gige")]
fn gige_camera(files: &CellFiles, gige: &Gige) -> (Check, Option<[usize; 2]>) {
    use super::leased_camera::judge_shot_reply;
    use panelprep_devices::cameras::FlangeCamera as _;
    use panelprep_service::daemon::BorrowedFlangeCamera;
    let name = "flange camera";
    let calibrated = || files.flange_camera().ok().map(|lens| [lens.value.width_px, lens.value.height_px]);
    if let Some(state) = service_request::service_state(&files.socket()) {
        let taken = BorrowedFlangeCamera::new(files.socket()).capture();
        return (judge_shot_reply(name, &state, taken.map(|taken| taken.picture)), calibrated());
    }
    let opened = opening::lens(files.flange_camera()).and_then(|lens| {
        let open = |lens: &PinholeCamera| live::gige_camera(&files.cell, gige, lens);
        opening::open_with_size(lens, open, |camera| camera.check_ready())
    });
    let whole =
        opened.and_then(|(mut camera, size_px)| camera.check_ready().map(|()| size_px).map_err(Fault::stage));
    match whole {
        Ok([width, height]) => {
            let bytes = gige.packet_bytes;
            let found = format!("delivers {width}×{height} in packets of {bytes} bytes");
            (Check::passed(name, found), Some([width, height]))
        }
        Err(error) => {
            let advice = "check the camera's power, cable and address; end other camera programs; compare [flange_camera] with the camera";
            (Check::failed(name, error.to_string(), advice), calibrated())
        }
    }
}

#[cfg(not(feature = "gige"))]
fn gige_camera(_: &CellFiles, gige: &Gige) -> (Check, Option<[usize; 2]>) {
    let which = gige.serial.as_ref().map_or("the only one found".to_owned(), |serial| format!("serial {serial}"));
    let found = format!("a GigE Vision camera, {which}: this program was built without the cargo feature gige");
    (Check::failed("flange camera", found, "use a program with this feature, or set kind = \"recorded\""), None)
}

fn simulated_check(name: &str) -> Check {
    Check::passed(name, "simulated: the pictures are rendered")
}

fn recorded_check(
    name: &str,
    lens: Result<LoadedCalibration<PinholeCamera>, Fault>,
    open: impl Fn(PinholeCamera) -> Result<(), CameraError>,
) -> Check {
    let lens = opening::lens(lens).map(|lens| lens.unwrap_or_else(|| opening::camera_of_size([2, 2])));
    match lens.and_then(|lens| open(lens).map_err(Fault::stage)) {
        Ok(()) => Check::passed(name, "recorded: the shots are read from a recording"),
        Err(error) => Check::failed(name, error.to_string(), "name the folder of a recording in the cell's file"),
    }
}

/// Checks whether the service runs and whether the robot answers. If the service holds the robot's ports, the
/// service is queried.
///
/// Also returns the sum of the programs that a real controller reports.
pub(super) fn robot_and_service(files: &CellFiles, sum: Option<i32>) -> (Vec<Check>, Option<i32>) {
    match service_request::service_state(&files.socket()) {
        Some(state) => {
            let robot = format!("in use by the service, which is {state}");
            (vec![Check::passed("service", format!("runs: {state}")), Check::passed("robot", robot)], None)
        }
        None => {
            let (robot, reported) = robot(&files.cell, sum);
            (vec![robot, Check::passed("service", "does not run")], reported)
        }
    }
}

fn robot(cell: &Cell, sum: Option<i32>) -> (Check, Option<i32>) {
    if cell.robot().kind() == RobotKind::Mock {
        return (Check::passed("robot", "a mock controller inside the program"), None);
    }
    let (host, ports) = (cell.robot().host(), (cell.robot().command_port(), cell.robot().state_port()));
    let place = format!("{host}, ports {} and {}", ports.0, ports.1);
    let (mut link, _) = match live::robot_alone(cell) {
        Ok(alone) => alone,
        Err(fault) => {
            return (Check::failed("robot", fault.to_string(), "correct [robot] in the cell's file"), None);
        }
    };
    match SingleRobot::connect(&mut link, cell.arm()) {
        Ok(single) => {
            let state = single.state();
            if state.is_simulated() {
                let check = Check::failed(
                    "robot",
                    format!(
                        "{place}: a MOCK controller answers, which proves nothing about a real controller; mode {}",
                        state.mode.name()
                    ),
                    "expected in a rehearsal; for the real cell, connect the real controller and run `panelprep doctor` again",
                );
                return (check, None);
            }
            let check = match sum.filter(|sum| *sum != state.programs_checksum) {
                Some(sum) => Check::failed(
                    "robot",
                    format!(
                        "{place}: the controller answers, but runs other programs: checksum {}, the files have {sum}",
                        state.programs_checksum
                    ),
                    "the controller executes other files than those in the folder of --kuka: cold-start the controller, or copy its files again",
                ),
                None => Check::passed(
                    "robot",
                    format!(
                        "{place}: the controller answers, mode {}, checksum of the programs {}",
                        state.mode.name(),
                        state.programs_checksum
                    ),
                ),
            };
            (check, Some(state.programs_checksum))
        }
        Err(error) => {
            let advice = advice(&error);
            (Check::failed("robot", format!("{place}: {error}"), advice), None)
        }
    }
}

fn advice(error: &SingleError) -> &'static str {
    match error {
        SingleError::NoController(LinkLoss::Refused { .. }) => {
            "the controller is reachable, but nothing listens: is the submit interpreter's icon green, are \
             CELL_INIT( ) and CELL_CYCLE( ) in sps.sub, and are the ports those of the EthernetKRL files and \
             within 54600 to 54615? No robot program is needed for this"
        }
        SingleError::NoController(LinkLoss::NoAnswer { .. }) => {
            "no device answers at this address: is the controller on, is the KLI cable plugged in, are address and netmask of both sides right (`ping`)?"
        }
        SingleError::NoController(LinkLoss::Occupied { .. }) => {
            "end the other client: the service, a second `panelprep`, another PC on this network"
        }
        SingleError::NoController(LinkLoss::Silent { .. }) => {
            "another client occupies the channel, or CELL_CYCLE( ) is not called: close other clients; check the fold \
             USER PLC in sps.sub"
        }
        SingleError::NoController(LinkLoss::PortsExchanged { .. }) => {
            "exchange command_port and state_port in [robot] of the cell's file"
        }
        SingleError::Silent => {
            "the controller accepts connections but does not answer: is cell_submit running (the state channel then \
             sends), or does another program listen on these ports?"
        }
        _ => {
            "the program that answers is not this cell's controller program: compare its EthernetKRL files with \
              --kuka"
        }
    }
}
