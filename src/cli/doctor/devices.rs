//! Facts of what is connected: cameras, the robot's ports, the service. Nothing is moved.

use super::{Check, machine};
use crate::cell::{Camera, Cell, Gige, RobotKind, ZividCamera};
use crate::cli::fault::Fault;
#[cfg(feature = "gige")]
use crate::cli::load::calibrated_serial;
use crate::cli::load::{Calibrated, CellFiles};
use crate::cli::{ctl, live};
use crate::daemon::{Single, SingleError};
use crate::devices::cameras::{CameraError, RecordedFlangeCamera, RecordedScanner};
#[cfg(feature = "gige")]
use crate::devices::cameras::{FlangeCamera, GigeFlangeCamera};
use crate::devices::zivid::Patience;
use crate::eki::LinkLoss;
use crate::geometry::PinholeCamera;

/// Both cameras, and the sockets that a network camera needs.
pub(super) fn cameras(files: &CellFiles) -> Vec<Check> {
    let scanner = match files.cell.scanner() {
        Camera::Simulated => simulated("scanner"),
        Camera::Recorded { folder } => {
            recorded("scanner", files.scanner(), |lens| RecordedScanner::open(folder, lens).map(drop))
        }
        Camera::Device(camera) => zivid(files, camera),
    };
    let flange_camera = match files.cell.flange_camera() {
        Camera::Simulated => vec![simulated("flange camera")],
        Camera::Recorded { folder } => {
            let open = |lens| RecordedFlangeCamera::open(folder, lens).map(drop);
            vec![recorded("flange camera", files.flange_camera(), open)]
        }
        Camera::Device(gige) => vec![machine::receive_buffer(), gige_camera(files, gige)],
    };
    std::iter::once(scanner).chain(flange_camera).collect()
}

/// Opens the camera and waits for its first whole picture; where the service has it, the service is asked.
#[cfg(feature = "gige")]
fn gige_camera(files: &CellFiles, gige: &Gige) -> Check {
    let name = "flange camera";
    if let Some(state) = ctl::state_of(&files.socket()) {
        return Check::right(name, format!("held by the service, which is {state}"));
    }
    let Ok(lens) = files.flange_camera() else {
        return Check::wrong(
            name,
            "not looked at: its size is held against the lens's calibration",
            "calibrate first",
        );
    };
    let serial = match calibrated_serial(files.cell.calibration().flange_camera.as_deref()) {
        Ok(serial) => serial,
        Err(fault) => return Check::wrong(name, fault.to_string(), "calibrate first"),
    };
    let opened = GigeFlangeCamera::open(gige, &lens.value, serial);
    let whole = opened.and_then(|mut camera| camera.check());
    match whole {
        Ok(()) => {
            let (bytes, size) = (gige.packet_bytes, [lens.value.width_px, lens.value.height_px]);
            Check::right(name, format!("delivers {}×{} in packets of {bytes} bytes", size[0], size[1]))
        }
        Err(error) => Check::wrong(
            name,
            error.to_string(),
            "look at its power, cable and address; end other camera programs; hold [flange_camera] against it",
        ),
    }
}

#[cfg(not(feature = "gige"))]
fn gige_camera(_: &CellFiles, gige: &Gige) -> Check {
    let which = gige.serial.as_ref().map_or("the only one found".to_owned(), |serial| format!("serial {serial}"));
    let found = format!("a GigE Vision camera, {which}: this program was built without its driver");
    Check::wrong("flange camera", found, "use a program that was built with it, or kind = \"recorded\"")
}

fn simulated(name: &str) -> Check {
    Check::right(name, "simulated: its pictures are rendered")
}

fn recorded(
    name: &str,
    lens: Result<Calibrated<PinholeCamera>, Fault>,
    open: impl Fn(PinholeCamera) -> Result<(), CameraError>,
) -> Check {
    match lens.map(|lens| open(lens.value)) {
        Ok(Ok(())) => Check::right(name, "recorded shots are played"),
        Ok(Err(error)) => {
            Check::wrong(name, error.to_string(), "name the folder of a recording in the cell's file")
        }
        Err(_) => Check::wrong(
            name,
            "not looked at: a recording is held against the lens's calibration",
            "calibrate first",
        ),
    }
}

/// Starts the camera's worker, opens the camera and takes a shot to warm it up.
fn zivid(files: &CellFiles, camera: &ZividCamera) -> Check {
    if ctl::state_of(&files.socket()).is_some() {
        return Check::right("scanner", "a Zivid, held by the service that runs");
    }
    let Ok(lens) = files.scanner() else {
        let found = "not looked at: its shots are held against the lens's calibration";
        return Check::wrong("scanner", found, "calibrate first");
    };
    let mut scanner = match crate::cli::zivid::scanner(&files.cell, camera, &lens.value) {
        Ok(scanner) => scanner,
        Err(fault) => return Check::wrong("scanner", fault.to_string(), "mend [scanner] in the cell's file"),
    };
    let ready = scanner.ready(Patience::default().start());
    match ready.and_then(|()| Ok((scanner.temperatures()?, scanner.intrinsics()?))) {
        Ok((found, own)) => {
            let warm = found.lens_c.map_or("unknown".to_owned(), |celsius| format!("{celsius:.0} °C"));
            let (own_px, calibrated_px) = (own.matrix_px[0], lens.value.fx_px);
            let told = format!(
                "a Zivid, ready; temperature of its lens {warm}; focal length by itself {own_px:.1} px, by its calibration \
                 {calibrated_px:.1} px"
            );
            Check::right("scanner", told)
        }
        Err(fault) => Check::wrong("scanner", fault.to_string(), "src/devices/README.md says what it needs"),
    }
}

/// Whether the service runs, and whether the robot answers: where the service holds its ports, the service is asked.
pub(super) fn robot_and_service(files: &CellFiles, sum: Option<i32>) -> Vec<Check> {
    match ctl::state_of(&files.socket()) {
        Some(state) => {
            let robot = format!("held by the service, which is {state}");
            vec![Check::right("service", format!("runs: {state}")), Check::right("robot", robot)]
        }
        None => vec![robot(&files.cell, sum), Check::right("service", "does not run")],
    }
}

fn robot(cell: &Cell, sum: Option<i32>) -> Check {
    if cell.robot().kind() == RobotKind::Mock {
        return Check::right("robot", "a mock controller inside the program");
    }
    let (host, ports) = (cell.robot().host(), (cell.robot().command_port(), cell.robot().state_port()));
    let place = format!("{host}, ports {} and {}", ports.0, ports.1);
    let (mut link, _) = match live::robot_alone(cell) {
        Ok(alone) => alone,
        Err(fault) => return Check::wrong("robot", fault.to_string(), "mend [robot] in the cell's file"),
    };
    match Single::connect(&mut link, cell.arm()) {
        Ok(single) => {
            let state = single.state();
            match sum.filter(|sum| *sum != state.programs_checksum) {
                Some(sum) => Check::wrong(
                    "robot",
                    format!(
                        "{place}: speaks, but runs other programs: checksum {}, the files say {sum}",
                        state.programs_checksum
                    ),
                    "copy the KRL programs of config/kuka to the controller and select the program anew",
                ),
                None => Check::right(
                    "robot",
                    format!("{place}: speaks, mode {}, programs {}", state.mode.name(), state.programs_checksum),
                ),
            }
        }
        Err(error) => {
            let advice = advice(&error);
            Check::wrong("robot", format!("{place}: {error}"), advice)
        }
    }
}

fn advice(error: &SingleError) -> &'static str {
    match error {
        SingleError::NoController(LinkLoss::Refused { .. }) => {
            "the controller is there and nothing listens: start cell_submit, select and start the cell's program, and \
             see that the ports are those of the EthernetKRL files and within 54600 to 54615"
        }
        SingleError::NoController(LinkLoss::NoAnswer { .. }) => {
            "no such address answers: controller on, cable of the KLI in, address and netmask of both right (`ping`)?"
        }
        SingleError::Silent => {
            "it takes connections and says nothing: does cell_submit run (its state channel speaks), or does another \
             program listen on these ports?"
        }
        _ => "what answers there is not this cell's controller program: compare its EthernetKRL files by --kuka",
    }
}
