//! The checks of `panelprep doctor` for the connected devices: cameras, robot ports, service, compliant tool. Nothing
//! is moved.
//!
//! For a Zivid camera they report whether it delivers scans, whether the light is suitable for its exposure times,
//! whether it is warm, and on which GPU its SDK computes. A camera that the service uses is judged by the service's
//! reply. For the tool they report whether it responds without a fault; the tool stays retracted, and nothing is
//! pressed.

use super::check::{self, ExaminedItem};
use crate::daemon::camera_lease::RemoteScanner;
use crate::daemon::client::service_state;
use crate::daemon::ports::LinkedRobot;
use crate::daemon::single::{SingleError, SingleRobot};
use crate::setup::{CellFiles, LoadedCalibration, SetupFault, cameras as opening};
use panelprep_base::geometry::{ColorPicture, PinholeCamera};
use panelprep_base::number_text::fixed_decimals;
use panelprep_cell::cell::{Camera, Cell, CompliantTool, Gige, RobotKind, ZividCamera};
use panelprep_cell::force::{LinkLossCause, ToolReading, not_ready_reason};
use panelprep_devices::acf::{AcfLink, ConnectedTool as _, ToolReport};
use panelprep_devices::cameras::{CameraError, RecordedFlangeCamera, RecordedScanner, Scanner as _};
use panelprep_devices::zivid::{AnswerTimeouts, ZividFault, ZividScanner};
use panelprep_kuka::eki::LinkLoss;
use std::time::{Duration, Instant};

/// Judges a camera that the service uses, from the result of a request for a shot; a cell that is at work is not
/// disturbed.
fn judge_shot_reply(name: &str, state: &str, taken: Result<ColorPicture, CameraError>) -> ExaminedItem {
    let holder = format!("in use by the service, state {state}");
    match taken {
        Ok(picture) => {
            ExaminedItem::passed(name, format!("{holder}: delivers {}×{}", picture.width, picture.height))
        }
        Err(CameraError::AtWork) => {
            ExaminedItem::passed(name, format!("{holder}; no test picture was taken, because the cell is working"))
        }
        Err(error) => ExaminedItem::failed(
            name,
            format!("{holder}: {error}"),
            "check the camera's power, cable and address; read the service's log",
        ),
    }
}

/// Checks both cameras, and the sockets that a network camera needs.
pub(super) fn cameras(files: &CellFiles, warm_up: bool) -> Vec<ExaminedItem> {
    let scanner = match files.cell.scanner() {
        Camera::Simulated => vec![simulated_check("scanner")],
        Camera::Recorded { folder } => {
            vec![recorded_check("scanner", files.scanner(), |lens| RecordedScanner::open(folder, lens).map(drop))]
        }
        Camera::Device(camera) => zivid_checks(files, camera, warm_up),
    };
    let flange_camera = match files.cell.flange_camera() {
        Camera::Simulated => vec![simulated_check("flange camera")],
        Camera::Recorded { folder } => {
            let open = |lens| RecordedFlangeCamera::open(folder, lens).map(drop);
            vec![recorded_check("flange camera", files.flange_camera(), open)]
        }
        Camera::Device(gige) => {
            let (camera, size_px) = gige_camera(files, gige);
            vec![check::receive_buffer(size_px, gige.packet_bytes), camera]
        }
    };
    scanner.into_iter().chain(flange_camera).collect()
}

/// Opens the camera and waits for its first complete picture; if the service uses the camera, the service captures the
/// picture. Also returns the picture size if it is known, from the calibration or from the camera itself.
#[cfg(feature = "gige")]
fn gige_camera(files: &CellFiles, gige: &Gige) -> (ExaminedItem, Option<[usize; 2]>) {
    use crate::daemon::camera_lease::BorrowedFlangeCamera;
    use panelprep_devices::cameras::FlangeCamera as _;
    let name = "flange camera";
    let calibrated = || files.flange_camera().ok().map(|lens| [lens.value.width_px, lens.value.height_px]);
    if let Some(state) = service_state(&files.socket()) {
        let taken = BorrowedFlangeCamera::new(files.socket()).capture();
        return (judge_shot_reply(name, &state, taken.map(|taken| taken.picture)), calibrated());
    }
    let opened = opening::lens(files.flange_camera()).and_then(|lens| {
        let open = |lens: &PinholeCamera| opening::gige_camera(&files.cell, gige, lens);
        opening::open_with_size(lens, open, |camera| camera.check_ready())
    });
    let whole =
        opened.and_then(|(mut camera, size_px)| camera.check_ready().map(|()| size_px).map_err(SetupFault::stage));
    match whole {
        Ok([width, height]) => {
            let bytes = gige.packet_bytes;
            let found = format!("delivers {width}×{height} in packets of {bytes} bytes");
            (ExaminedItem::passed(name, found), Some([width, height]))
        }
        Err(error) => {
            let advice = "check the camera's power, cable and address; end other camera programs; compare [flange_camera] with the camera";
            (ExaminedItem::failed(name, error.to_string(), advice), calibrated())
        }
    }
}

#[cfg(not(feature = "gige"))]
fn gige_camera(_: &CellFiles, gige: &Gige) -> (ExaminedItem, Option<[usize; 2]>) {
    let which = gige.serial.as_ref().map_or("the only one found".to_owned(), |serial| format!("serial {serial}"));
    let found = format!("a GigE Vision camera, {which}: this program was built without the cargo feature gige");
    (
        ExaminedItem::failed("flange camera", found, "use a program with this feature, or set kind = \"recorded\""),
        None,
    )
}

fn simulated_check(name: &str) -> ExaminedItem {
    ExaminedItem::passed(name, "simulated: the pictures are rendered")
}

fn recorded_check(
    name: &str,
    lens: Result<LoadedCalibration<PinholeCamera>, SetupFault>,
    open: impl Fn(PinholeCamera) -> Result<(), CameraError>,
) -> ExaminedItem {
    let lens = opening::lens(lens).map(|lens| lens.unwrap_or_else(|| opening::camera_of_size([2, 2])));
    match lens.and_then(|lens| open(lens).map_err(SetupFault::stage)) {
        Ok(()) => ExaminedItem::passed(name, "recorded: the shots are read from a recording"),
        Err(error) => {
            ExaminedItem::failed(name, error.to_string(), "name the folder of a recording in the cell's file")
        }
    }
}

/// Checks whether the service runs and whether the robot responds. If the service uses the robot's ports, the service
/// is queried instead of the robot.
///
/// Also returns the checksum of the programs that a real controller reports.
pub(super) fn robot_and_service(files: &CellFiles, sum: Option<i32>) -> (Vec<ExaminedItem>, Option<i32>) {
    match service_state(&files.socket()) {
        Some(state) => {
            let robot = format!("in use by the service, which is {state}");
            (
                vec![
                    ExaminedItem::passed("service", format!("runs: {state}")),
                    ExaminedItem::passed("robot", robot),
                ],
                None,
            )
        }
        None => {
            let (robot, reported) = robot(&files.cell, sum);
            (vec![robot, ExaminedItem::passed("service", "does not run")], reported)
        }
    }
}

fn robot(cell: &Cell, sum: Option<i32>) -> (ExaminedItem, Option<i32>) {
    if cell.robot().kind() == RobotKind::Mock {
        return (ExaminedItem::passed("robot", "a mock controller inside the program"), None);
    }
    let (host, ports) = (cell.robot().host(), (cell.robot().command_port(), cell.robot().state_port()));
    let place = format!("{host}, ports {} and {}", ports.0, ports.1);
    let mut link = match LinkedRobot::start(cell) {
        Ok(link) => link,
        Err(fault) => {
            return (ExaminedItem::failed("robot", fault.to_string(), "correct [robot] in the cell's file"), None);
        }
    };
    match SingleRobot::connect(&mut link, cell.arm()) {
        Ok(single) => {
            let state = single.state();
            if state.is_simulated() {
                let check = ExaminedItem::failed(
                    "robot",
                    format!(
                        "{place}: a MOCK controller responds, which is no evidence about a real controller; mode {}",
                        state.mode.name()
                    ),
                    "expected in a rehearsal; for the real cell, connect the real controller and run `panelprep doctor` again",
                );
                return (check, None);
            }
            let check = match sum.filter(|sum| *sum != state.programs_checksum) {
                Some(sum) => ExaminedItem::failed(
                    "robot",
                    format!(
                        "{place}: the controller answers, but runs other programs: checksum {}, the files have {sum}",
                        state.programs_checksum
                    ),
                    "the controller executes other files than those in the folder of --kuka: cold-start the controller, or copy its files again",
                ),
                None => ExaminedItem::passed(
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
            (ExaminedItem::failed("robot", format!("{place}: {error}"), advice), None)
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
            "the program that answers is not this cell's controller program: compare its EthernetKRL files with --kuka"
        }
    }
}

/// Starts the camera's worker, opens the camera and takes a shot to warm it up. If requested, takes shots for ten
/// minutes and follows the camera's temperature.
fn zivid_checks(files: &CellFiles, camera: &ZividCamera, warm_up: bool) -> Vec<ExaminedItem> {
    let graphics = check::graphics_processor();
    if let Some(state) = service_state(&files.socket()) {
        let taken = RemoteScanner::new(files.socket()).capture_3d();
        return vec![graphics, judge_shot_reply("scanner", &state, taken.map(|taken| taken.cloud.picture()))];
    }
    let lens = opening::lens(files.scanner());
    let calibrated_px = lens.as_ref().ok().copied().flatten().map(|lens| lens.fx_px);
    let opened = lens.and_then(|lens| {
        let open = |lens: &PinholeCamera| opening::zivid_scanner(&files.cell, camera, lens);
        opening::open_with_size(lens, open, opening::zivid_ready)
    });
    let mut scanner = match opened {
        Ok((scanner, _)) => scanner,
        Err(fault) => {
            let wrong = ExaminedItem::failed("scanner", fault.to_string(), "correct [scanner] in the cell's file");
            return vec![graphics, wrong];
        }
    };
    let ready = scanner.wait_ready(AnswerTimeouts::default().start());
    let (found, own) = match ready.and_then(|()| Ok((scanner.temperatures()?, scanner.intrinsics()?))) {
        Ok(both) => both,
        Err(fault) => {
            let wrong = ExaminedItem::failed(
                "scanner",
                fault.to_string(),
                "see the requirements of the Zivid camera in src/devices/README.md",
            );
            return vec![graphics, wrong];
        }
    };
    let light = match (scanner.measure_ambient_light(), opening::checked_zivid_settings(camera)) {
        (Ok(light), Ok(settings)) => check::judge_light(&light, &settings),
        (Err(fault), _) => check::unknown_light(&fault.to_string()),
        (_, Err(fault)) => check::unknown_light(&fault.to_string()),
    };
    let warm = found.lens_c.map_or("unknown".to_owned(), |celsius| format!("{celsius:.0} °C"));
    let calibrated =
        calibrated_px.map_or("not calibrated yet".to_owned(), |px| format!("{px:.1} px in its calibration file"));
    let reported = format!(
        "Zivid camera ready; lens temperature {warm}; focal length {:.1} px as the camera reports, {calibrated}",
        own.matrix_px[0]
    );
    let followed = if warm_up { warm_up_camera(&mut scanner, WARM_UP_TIME_AND_INTERVAL) } else { Ok(()) };
    let warm_up = match followed {
        Ok(()) => check::check_warm_up(scanner.temperature_state()),
        Err(fault) => ExaminedItem::failed(
            "scanner's warmth",
            fault.to_string(),
            "repair the 3D camera, then run `panelprep doctor --warm-up` again",
        ),
    };
    vec![graphics, ExaminedItem::passed("scanner", reported), light, warm_up]
}

/// Duration of a camera's warm-up (ten minutes, as the manufacturer states), and interval between two scans.
const WARM_UP_TIME_AND_INTERVAL: [Duration; 2] = [Duration::from_secs(605), Duration::from_secs(10)];

/// Captures 3D scans, which warm up the camera, and reports its temperature at each scan.
fn warm_up_camera(scanner: &mut ZividScanner, [long, every]: [Duration; 2]) -> Result<(), ZividFault> {
    let begun = Instant::now();
    while begun.elapsed() < long {
        let lens = scanner
            .take_scan()?
            .metadata
            .lens_c
            .map_or(String::new(), |celsius| format!(", lens temperature {celsius:.1} °C"));
        let left_s = long.saturating_sub(begun.elapsed()).as_secs();
        tracing::info!("the 3D camera is warming up, {left_s} s left{lens}");
        std::thread::sleep(every.min(long.saturating_sub(begun.elapsed())));
    }
    Ok(())
}

const NAME: &str = "compliant tool";
/// Maximum time in which the tool responds and retracts.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(3);

/// Checks the tool of a cell; `None` if it is a spring. `served` states that the service runs and holds the tool.
pub(super) fn check_tool(cell: &Cell, served: bool) -> Option<ExaminedItem> {
    let tool = cell.tool().compliant()?;
    Some(match &tool.address {
        None => ExaminedItem::passed(NAME, "simulated: the tool presses on the simulated panel"),
        Some(_) if served => {
            ExaminedItem::passed(NAME, "in use by the service, which reports at a reset whether the tool is ready")
        }
        Some(address) => match AcfLink::start(tool, address) {
            Ok(link) => wait_until_ready(tool, link),
            Err(error) => {
                ExaminedItem::failed(NAME, error.to_string(), "end the programs that use up the computer's threads")
            }
        },
    })
}

/// Waits until the tool is ready, up to the time limit.
fn wait_until_ready(tool: &CompliantTool, mut link: AcfLink) -> ExaminedItem {
    let began = Instant::now();
    let (mut last, mut lost): (Option<ToolReading>, Option<LinkLossCause>) = (None, None);
    while began.elapsed() < RESPONSE_TIMEOUT {
        match link.next_report() {
            Some(ToolReport::Reading { reading, .. }) => (last, lost) = (Some(reading), None),
            Some(ToolReport::Lost(loss)) => lost = Some(loss),
            None => std::thread::sleep(Duration::from_millis(5)),
        }
        if last.is_some_and(|reading| not_ready_reason(&reading, tool.stroke_mm).is_none()) {
            break;
        }
    }
    describe_tool_state(tool, last, lost)
}

/// Describes the tool's state in words.
fn describe_tool_state(
    tool: &CompliantTool,
    last: Option<ToolReading>,
    lost: Option<LinkLossCause>,
) -> ExaminedItem {
    let place =
        tool.address.as_ref().map_or(String::new(), |address| format!("{}, port {}", address.host, address.port));
    let Some(reading) = last.filter(|_| lost.is_none()) else {
        let why = lost.map_or("the tool does not respond".to_owned(), |loss| loss.to_string());
        let advice = "check the tool's power, cable and address (`ping`), end other programs that are connected to the \
                      tool, and compare [tool] with the tool's settings";
        return ExaminedItem::failed(NAME, format!("{place}: {why}"), advice);
    };
    let says = format!(
        "{place}: responds; force {} N, extended {} mm of {} mm",
        fixed_decimals(reading.force_n, 1),
        fixed_decimals(reading.position_mm, 1),
        fixed_decimals(tool.stroke_mm, 1)
    );
    match not_ready_reason(&reading, tool.stroke_mm) {
        None => ExaminedItem::passed(NAME, says),
        Some(why) => ExaminedItem::failed(
            NAME,
            format!("{says}; {}", why.message),
            "correct the reported problem; until then, no cycle starts",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_devices::acf::{MockAcfServer, ToolFault};

    fn cell(port: u16) -> Cell {
        let text = format!(
            "[tool]\nkind = 'acf'\nhost = '127.0.0.1'\ntcp_port = {port}\nstroke_mm = 30\nmin_force_n = -60\nmax_force_n = 100\n\
             payload_kg = 1.5\n"
        );
        Cell::check("f", &text).unwrap_or_else(|problems| panic!("{problems}"))
    }

    /// A spring is not checked. A tool that responds passes. A tool with a fault, or a missing tool, is reported with
    /// advice.
    #[test]
    fn doctor_checks_the_compliant_tool() {
        let spring = Cell::check("f", "").unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!(check_tool(&spring, false), None);
        let tool = cell(1);
        let server = MockAcfServer::start(tool.tool().compliant().expect("one"), 15.0).expect("a port");
        let there = cell(server.address().port());
        let right = check_tool(&there, false).expect("looked at");
        assert!(
            right.is_passed() && right.found.contains("responds; force") && right.found.contains("of 30.0 mm"),
            "{right:?}"
        );
        assert!(
            check_tool(&there, true)
                .is_some_and(|check| check.is_passed() && check.found.contains("in use by the service"))
        );
        server.set_fault(Some(ToolFault::Errors(2)));
        let wrong = check_tool(&there, false).expect("looked at");
        assert!(!wrong.is_passed() && wrong.found.contains("the sensor has an error"), "{wrong:?}");
        drop(server);
        let away = check_tool(&there, false).expect("looked at");
        assert!(
            !away.is_passed() && away.found.contains("the connection failed") && away.advice.contains("ping"),
            "{away:?}"
        );
    }
}
