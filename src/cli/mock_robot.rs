//! `panelprep mock-robot`: runs a mock controller that accepts clients, until the program is ended.

use super::args::{Common, MockRobot};
use super::disk;
use super::fault::{DeviceFault, Fault};
use super::output::Outcome;
use panelprep_base::number_text::fixed_decimals;
use panelprep_cell::cell::{Cell, RobotKind};
use panelprep_devices::mock::{ChannelFile, Clock, Controller, MockServer, Ports, Programs, Setup};
use panelprep_devices::world::SimulatedWorld;
use panelprep_kuka::eki::{CELLCMD, CELLSTAT};
use panelprep_service::check::is_krl;
use panelprep_service::requirements::Purpose;
use panelprep_service::setup::CellFiles;
use panelprep_sim as sim;
use std::fs::DirEntry;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Interval at which changes of the controller are reported.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Runs a mock controller on the ports of the EthernetKRL files, and reports what it does. Its inputs follow its
/// outputs as the cell file states.
///
/// # Errors
/// If a file is invalid, or a port is in use.
pub fn run(args: &MockRobot, common: &Common, tell: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    files.require(Purpose::Robot)?;
    let channel = |name: &str, shipped: &str| match &args.config {
        None => ChannelFile::parse(shipped).map_err(Fault::stage),
        Some(folder) => {
            let file = folder.join(name);
            ChannelFile::parse(&disk::read_controller_text(&file)?).map_err(|error| Fault::file_fault(&file, error))
        }
    };
    let (commands, states) = (channel("CELLCMD.xml", CELLCMD)?, channel("CELLSTAT.xml", CELLSTAT)?);
    let ports = ports(args, &files.cell, [commands.port(), states.port()])?;
    // Only water, light and tool of this world are used, because no camera captures it.
    let world = SimulatedWorld::new(sim::Cell::new(1, sim::Scene::Good, 8), &files.cell).map_err(Fault::stage)?;
    let faults = args.fault.clone().unwrap_or_default();
    let programs = match &args.programs {
        None => None,
        Some(None) => Some(Programs::shipped().map_err(Fault::stage)?),
        Some(Some(folder)) => Some(read_own_programs(folder)?),
    };
    let remarks = programs.iter().flat_map(|programs| &programs.remarks);
    remarks.for_each(|remark| tell(&format!("note: {remark}")));
    let setup = Setup { clock: Clock::Free, faults, programs, ..world.mock_setup(&files.cell, commands, states) };
    let mut controller = Controller::new(setup, world.terminals()).map_err(Fault::stage)?;
    controller.boot();
    let server = MockServer::start(controller, ports).map_err(Fault::stage)?;
    tell(&format!(
        "mock controller: command channel at {}, state channel at {}; press Ctrl+C to stop",
        server.command_address(),
        server.state_address()
    ));
    let mut reported_state = ReportedState::default();
    loop {
        server
            .handle()
            .with_controller(|controller| reported_state.state_changes(controller))
            .iter()
            .for_each(|line| tell(line));
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// Reads the programs in a folder. They replace the shipped programs with the same name, or are added to them.
fn read_own_programs(folder: &Path) -> Result<Programs, Fault> {
    let named = |error: std::io::Error| Fault::file_fault(folder, error);
    let entries: Vec<_> = std::fs::read_dir(folder).and_then(Iterator::collect).map_err(named)?;
    let mut files: Vec<PathBuf> = entries.iter().map(DirEntry::path).collect();
    files.retain(|file| file.file_name().is_some_and(|name| is_krl(&name.to_string_lossy())));
    files.sort();
    if files.is_empty() {
        return Err(Fault::file_fault(
            folder,
            "has no .src, .sub or .dat file: name the folder with your programs",
        ));
    }
    let read = |file: &PathBuf| Ok((file.display().to_string(), disk::read_controller_text(file)?));
    let texts = files.iter().map(read).collect::<Result<Vec<_>, Fault>>()?;
    let texts: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    Programs::with_user_files(&texts).map_err(Fault::stage)
}

/// Returns the ports of the cell. If the user gives EthernetKRL files, these are the ports in the files, which must
/// agree with the cell file.
fn ports(args: &MockRobot, cell: &Cell, files: [u16; 2]) -> Result<Ports, Fault> {
    let robot = cell.robot();
    let cells = [robot.command_port(), robot.state_port()];
    match &args.config {
        Some(folder) if robot.kind() == RobotKind::Eki && files != cells => {
            let (files, cells) = (files.map(|port| port.to_string()), cells.map(|port| port.to_string()));
            Err(DeviceFault::OtherPorts {
                folder: folder.clone(),
                files: files.join(" and "),
                cells: cells.join(" and "),
            }
            .into())
        }
        Some(_) => Ok(Ports { host: args.host, command: files[0], state: files[1] }),
        None => Ok(Ports { host: args.host, command: cells[0], state: cells[1] }),
    }
}

/// The last state of the controller that was reported.
#[derive(Default)]
struct ReportedState {
    epoch: i32,
    executed: usize,
    stops: usize,
    /// Number of interpreters that stopped because of an error in the programs.
    faults: usize,
    outputs: Vec<u16>,
}

impl ReportedState {
    fn state_changes(&mut self, controller: &Controller) -> Vec<String> {
        let at = |time_ms: u64| format!("{:9.3} s", time_ms as f64 / 1_000.0);
        let now = at(controller.time_ms());
        let mut lines = Vec::new();
        if controller.epoch() != self.epoch {
            self.epoch = controller.epoch();
            lines.push(format!("{now}  epoch {}", self.epoch));
        }
        for done in &controller.executed_motions()[self.executed..] {
            let joints = done.joints;
            let axes = joints.degrees();
            let axes = axes.map(|angle| fixed_decimals(angle, 2).to_string()).join(" ");
            let contact = if done.contact { ", in contact" } else { "" };
            lines.push(format!("{}  command {} executed, axes {axes}{contact}", at(done.time_ms), done.id));
        }
        for stop in &controller.program_stops()[self.stops..] {
            let detail = if stop.detail.is_empty() { String::new() } else { format!(": {}", stop.detail) };
            lines.push(format!(
                "{}  epoch {} stopped: {}{detail}",
                at(stop.time_ms),
                stop.epoch,
                stop.cause.describe()
            ));
        }
        let faults = controller.program_faults();
        lines.extend(faults[self.faults..].iter().map(|fault| format!("{now}  the KRL programs stopped: {fault}")));
        self.faults = faults.len();
        (self.executed, self.stops) = (controller.executed_motions().len(), controller.program_stops().len());
        let on: Vec<u16> = controller.outputs().iter().filter(|(_, on)| **on).map(|(number, _)| *number).collect();
        if on != self.outputs {
            let words = on.iter().map(u16::to_string).collect::<Vec<_>>().join(", ");
            lines.push(format!("{now}  outputs on: {}", if on.is_empty() { "none".to_owned() } else { words }));
            self.outputs = on;
        }
        lines
    }
}
