//! The configured cell in operation: its robot and its cameras, each by its `kind`.
//!
//! A mock robot runs inside this program, in lock step, with the simulated world around it; a controller over
//! EthernetKRL runs in real time. Simulated cameras look at that world. In a rehearsal the mock controller is another
//! process on this machine, `panelprep mock-robot`. The world around it is in this program and follows the controller's
//! reports.
//!
//! The kind of the controller that answers is determined by what it reports, never by its address, since a tunnel to a
//! real controller ends at an address of this computer.

use super::args::{Simulation, real_arm};
use super::fault::{DeviceFault, Fault};
use panelprep_base::geometry::{Joints, PinholeCamera};
use panelprep_base::supervision::WatchedThread;
use panelprep_cell::cell::{self, Cell, MockController, ProofStage, RobotKind};
use panelprep_devices::acf::{AcfLink, PlannedToolFault, SimulatedAcf, SimulatedPanel};
#[cfg(feature = "gige")]
use panelprep_devices::cameras::LoopbackFlangeCamera;
use panelprep_devices::cameras::{
    Arm, BayerFlangeCamera, FlangeCamera, RecordedFlangeCamera, RecordedScanner, Scanner, SimulatedFlangeCamera,
    SimulatedScanner, simulated_cameras,
};
use panelprep_devices::mock::{self, ChannelFile, Controller, MockServer, Programs, Setup};
use panelprep_devices::robot::{Address, BlockingLink, link_limits};
use panelprep_devices::world::{Follower, SimulatedWorld};
use panelprep_kuka::eki::{CELLCMD, CELLSTAT, ClockMode, Mode};
use panelprep_service::daemon::{AllCameras, Cameras, LinkedRobot, LinkedTool, SingleRobot};
use panelprep_service::setup::{self, Calibrations};
use panelprep_sim as sim;
use serde_json::{Value, json};
use std::time::Duration;

/// The cell's devices.
pub struct CellDevices {
    // The fields are dropped in this order: the link disconnects before its controller ends.
    /// The robot.
    pub robot: LinkedRobot,
    /// The compliant tool; none if the tool is a spring.
    pub tool: LinkedTool,
    /// The thread of the tool's link, if it has one.
    pub tool_watched: Option<WatchedThread>,
    /// The cameras.
    pub cameras: AllCameras,
    /// The mock robot in this program.
    pub simulated: Option<SimulatedController>,
    /// The simulated world, if a camera looks at one.
    pub world: Option<SimulatedWorld>,
    /// The world that follows a controller in another process.
    pub follower: Option<Follower>,
    /// How pictures of the flange camera were transferred, if this is to be reported.
    pub flange_link: Option<FlangeLink>,
}

/// How the pictures of the demo's flange camera are transferred.
#[derive(Debug, Clone)]
pub enum FlangeLink {
    /// Over GigE Vision through the loopback interface.
    #[cfg(feature = "gige")]
    Loopback(panelprep_devices::gige::LinkMonitor),
    /// From the renderer without a network, for this reason.
    Direct(String),
}

/// A mock controller and its world.
pub struct SimulatedController {
    /// The world.
    pub world: SimulatedWorld,
    /// The controller.
    pub server: MockServer,
}

/// Width of the simulated scanner's picture at full size, px.
pub const FULL_WIDTH_PX: usize = 1944;
/// Time after which the simulated lamp has its full light, with a margin.
const LAMP_RISE_TIME_MS: u64 = 500;
/// Largest factor by which the renderer reduces its pictures.
const MAX_REDUCTION: usize = 8;

impl CellDevices {
    /// Starts the devices that the cell's file names. The robot's link begins to connect; nothing moves.
    ///
    /// # Errors
    /// If the kinds of the devices cannot be combined, this program has no such camera, a recording cannot be opened,
    /// or a thread or port is not available.
    pub fn start(cell: &Cell, calibrations: &Calibrations, simulation: Simulation) -> Result<Self, Fault> {
        let fails_here = cell.robot().kind() == RobotKind::Mock
            && cell.tool().compliant().is_some_and(|it| it.address.is_none());
        if simulation.tool_fault.is_some() && !fails_here {
            return Err(DeviceFault::NoFailingTool.into());
        }
        let world = || simulated_cell(&calibrations.scanner, simulation);
        if cell.robot().kind() == RobotKind::Mock {
            let simulated = SimulatedController::start(cell, world()?)?;
            if simulation.line_parts > 0 {
                simulated.world.bring_parts(simulation.line_parts, cell).map_err(Fault::stage)?;
            }
            let arm = Arm::Mock(simulated.server.handle());
            let cameras = cameras(cell, calibrations, Some((&simulated.world, &arm)))?;
            let looks_at = Some((&simulated.world, &arm));
            let (tool, tool_watched) = tool(cell, calibrations, looks_at, simulation.tool_fault)?;
            let (robot, world) = (link_robot(cell, Some(&simulated))?, Some(simulated.world.clone()));
            return Ok(CellDevices {
                robot,
                tool,
                tool_watched,
                cameras,
                simulated: Some(simulated),
                world,
                follower: None,
                flange_link: None,
            });
        }
        let robot = link_robot(cell, None)?;
        let looks = matches!(cell.scanner(), cell::Camera::Simulated)
            || matches!(cell.flange_camera(), cell::Camera::Simulated);
        if !looks {
            let cameras = cameras(cell, calibrations, None)?;
            let (tool, tool_watched) = tool(cell, calibrations, None, None)?;
            return Ok(CellDevices {
                robot,
                tool,
                tool_watched,
                cameras,
                simulated: None,
                world: None,
                follower: None,
                flange_link: None,
            });
        }
        if simulation.arm_error_mm > 0.0 {
            return Err(DeviceFault::ArmErrorInRehearsal.into());
        }
        let world = SimulatedWorld::new(world()?, cell).map_err(Fault::stage)?;
        let follower = Follower::new(world.clone(), cell);
        let arm = Arm::Followed(follower.clone());
        let cameras = cameras(cell, calibrations, Some((&world, &arm)))?;
        let (tool, tool_watched) = tool(cell, calibrations, Some((&world, &arm)), None)?;
        Ok(CellDevices {
            robot,
            tool,
            tool_watched,
            cameras,
            simulated: None,
            world: Some(world),
            follower: Some(follower),
            flange_link: None,
        })
    }

    /// Starts the devices as [`CellDevices::start`] does, with a colour sensor's filters in front of the simulated flange
    /// camera. If available, GigE Vision over the loopback interface transfers its pictures. The pictures are the same
    /// either way.
    ///
    /// # Errors
    /// As [`CellDevices::start`].
    pub fn start_demo(cell: &Cell, calibrations: &Calibrations, simulation: Simulation) -> Result<Self, Fault> {
        let mut live = CellDevices::start(cell, calibrations, simulation)?;
        if let Some(simulated) = &live.simulated {
            let (camera, link) = flange_sensor(simulated, calibrations);
            (live.cameras.flange, live.flange_link) = (camera, Some(link));
        }
        Ok(live)
    }
}

impl FlangeLink {
    /// Returns the kind of the transfer as JSON, for scripts.
    pub fn json(&self) -> Value {
        match self {
            #[cfg(feature = "gige")]
            FlangeLink::Loopback(gauge) => {
                let counted = gauge.statistics();
                json!({
                    "over": "gige", "frames": counted.accepted, "refused": counted.refused, "retries": counted.retries,
                    "packets": counted.packets, "packets_missing": counted.missing_packets, "lost": counted.losses,
                })
            }
            FlangeLink::Direct(why) => json!({"over": "memory", "why": why}),
        }
    }

    /// Describes the transfer in a line for a person.
    pub fn describe_link(&self) -> String {
        match self {
            #[cfg(feature = "gige")]
            FlangeLink::Loopback(gauge) => {
                format!("flange camera, over GigE Vision loopback: {}", gauge.statistics())
            }
            FlangeLink::Direct(why) => format!("flange camera, without GigE Vision: {why}"),
        }
    }
}

#[cfg(feature = "gige")]
fn flange_sensor(
    simulated: &SimulatedController,
    calibrations: &Calibrations,
) -> (Box<dyn FlangeCamera>, FlangeLink) {
    let camera = || simulated.cameras().1;
    match LoopbackFlangeCamera::start(camera(), &calibrations.flange_camera) {
        Ok(loopback) => {
            let link = FlangeLink::Loopback(loopback.gauge());
            (Box::new(loopback), link)
        }
        Err(error) => (Box::new(BayerFlangeCamera::new(camera())), FlangeLink::Direct(error.to_string())),
    }
}

#[cfg(not(feature = "gige"))]
fn flange_sensor(simulated: &SimulatedController, _: &Calibrations) -> (Box<dyn FlangeCamera>, FlangeLink) {
    let why = "this program was built without the feature gige".to_owned();
    (Box::new(BayerFlangeCamera::new(simulated.cameras().1)), FlangeLink::Direct(why))
}

/// Starts only the robot that the cell's file names; a mock robot has the simulated world around it.
///
/// # Errors
/// As [`CellDevices::start`].
pub fn robot_alone(cell: &Cell) -> Result<(LinkedRobot, Option<SimulatedController>), Fault> {
    start_robot_at(cell, None)
}

/// Starts only the robot that the cell's file names; a mock arm starts at these joint positions.
///
/// # Errors
/// As [`CellDevices::start`].
pub fn start_robot_at(
    cell: &Cell,
    stands: Option<Joints>,
) -> Result<(LinkedRobot, Option<SimulatedController>), Fault> {
    let world = || sim::Cell::new(1, sim::Scene::Good, MAX_REDUCTION);
    let simulated = match cell.robot().kind() {
        RobotKind::Mock => Some(SimulatedController::started(cell, world(), stands)?),
        RobotKind::Eki => None,
    };
    Ok((link_robot(cell, simulated.as_ref())?, simulated))
}

fn link_robot(cell: &Cell, simulated: Option<&SimulatedController>) -> Result<LinkedRobot, Fault> {
    let Some(simulated) = simulated else { return LinkedRobot::start(cell).map_err(Fault::stage) };
    let pace = ClockMode::LockStep;
    let link = BlockingLink::start(simulated.address(), link_limits(cell), pace).map_err(Fault::stage)?;
    Ok(LinkedRobot::new(link, pace))
}

/// Returns the simulated cell with the calibrated scanner.
pub fn simulated_cell(found: &PinholeCamera, simulation: Simulation) -> Result<sim::Cell, Fault> {
    let reduction = (FULL_WIDTH_PX / found.width_px.max(1)).clamp(1, MAX_REDUCTION);
    let simulated_cell =
        sim::Cell::new(simulation.seed, simulation.scene.into(), reduction).with_pose(simulation.place);
    let simulated_cell = simulated_cell.with_arm(real_arm(simulation.seed, simulation.arm_error_mm));
    let delivers = simulated_cell.scanner();
    if (delivers.width_px, delivers.height_px) == (found.width_px, found.height_px) {
        return Ok(simulated_cell);
    }
    Err(DeviceFault::NoSuchSimulatedSize {
        found_px: [found.width_px, found.height_px],
        nearest_px: [delivers.width_px, delivers.height_px],
    }
    .into())
}

/// Returns the programs that the cell's mock controller executes; `None` if it executes a model of them.
///
/// # Errors
/// Never for programs that this program was built with.
fn programs(cell: &Cell) -> Result<Option<Programs>, Fault> {
    match cell.robot().controller() {
        MockController::Programs => Programs::shipped().map(Some).map_err(Fault::stage),
        MockController::Model => Ok(None),
    }
}

impl SimulatedController {
    /// Starts a mock controller and its world.
    ///
    /// # Errors
    /// If a port or thread is not available.
    pub fn start(cell: &Cell, simulated_cell: sim::Cell) -> Result<Self, Fault> {
        Self::started(cell, simulated_cell, None)
    }

    /// Starts a mock controller and its world with the arm parked, if the cell has a park pose, and with the cell's
    /// light on if requested.
    ///
    /// # Errors
    /// As [`SimulatedController::start`].
    pub fn start_parked(cell: &Cell, simulated_cell: sim::Cell, with_light: bool) -> Result<Self, Fault> {
        let simulated = Self::started(cell, simulated_cell, cell.park_pose())?;
        if let Some(light) = cell.inputs_outputs().output(cell::Output::Light).filter(|_| with_light) {
            simulated.server.handle().with_controller(|controller| {
                controller.switch_output(light, true);
                controller.advance_ms(LAMP_RISE_TIME_MS);
            });
        }
        Ok(simulated)
    }

    fn started(cell: &Cell, simulated_cell: sim::Cell, stands: Option<Joints>) -> Result<Self, Fault> {
        let world = SimulatedWorld::new(simulated_cell, cell).map_err(Fault::stage)?;
        let channel = |text| ChannelFile::parse(text).map_err(Fault::stage);
        let setup = world.mock_setup(cell, channel(CELLCMD)?, channel(CELLSTAT)?);
        let setup = Setup { programs: programs(cell)?, start: stands.unwrap_or(setup.start), ..setup };
        let controller = Controller::new(setup, world.terminals()).map_err(Fault::stage)?;
        let server = MockServer::start(controller, mock::Ports::free_ports()).map_err(Fault::stage)?;
        Ok(SimulatedController { world, server })
    }

    fn address(&self) -> Address {
        Address {
            host: self.server.command_address().ip().to_string(),
            command_port: self.server.command_address().port(),
            state_port: self.server.state_address().port(),
        }
    }

    /// Returns both cameras of the simulated world.
    pub fn cameras(&self) -> (SimulatedScanner, SimulatedFlangeCamera) {
        simulated_cameras(&self.world, &Arm::Mock(self.server.handle()))
    }
}

/// Starts the compliant tool that the cell's file names, and the thread of its link.
fn tool(
    cell: &Cell,
    calibrations: &Calibrations,
    looks_at: Option<(&SimulatedWorld, &Arm)>,
    planned: Option<PlannedToolFault>,
) -> Result<(LinkedTool, Option<WatchedThread>), Fault> {
    let Some(tool) = cell.tool().compliant() else { return Ok((LinkedTool::default(), None)) };
    if let Some(address) = &tool.address {
        let link = AcfLink::start(tool, address).map_err(Fault::stage)?;
        let watched = link.supervision_handle();
        return Ok((LinkedTool::new(link), Some(watched)));
    }
    let (world, arm) = looks_at.ok_or(DeviceFault::NoWorldForTool)?;
    let panel = SimulatedPanel::new((world.clone(), arm.clone()), calibrations.flange_from_tool, tool.stroke_mm);
    Ok((LinkedTool::new(SimulatedAcf::new(tool, panel.with_fault(planned))), None))
}

fn cameras(
    cell: &Cell,
    calibrations: &Calibrations,
    looks_at: Option<(&SimulatedWorld, &Arm)>,
) -> Result<AllCameras, Fault> {
    let simulated =
        || looks_at.map(|(world, arm)| simulated_cameras(world, arm)).ok_or(Fault::from(DeviceFault::NoWorld));
    let scanner: Box<dyn Scanner> = match cell.scanner() {
        cell::Camera::Simulated => Box::new(simulated()?.0),
        cell::Camera::Recorded { folder } => {
            Box::new(RecordedScanner::open(folder, calibrations.scanner).map_err(Fault::stage)?)
        }
        cell::Camera::Device(camera) => {
            Box::new(setup::cameras::zivid_scanner(cell, camera, &calibrations.scanner)?)
        }
    };
    let flange: Box<dyn FlangeCamera> = match cell.flange_camera() {
        cell::Camera::Simulated => Box::new(simulated()?.1),
        cell::Camera::Recorded { folder } => {
            Box::new(RecordedFlangeCamera::open(folder, calibrations.flange_camera).map_err(Fault::stage)?)
        }
        cell::Camera::Device(gige) => setup::cameras::gige_camera(cell, gige, &calibrations.flange_camera)?,
    };
    Ok(Cameras { scanner, flange })
}

/// Time in which a controller makes its channels available again after a client has left: a path that begins sooner
/// would find them occupied.
const RELEASE_PAUSE: Duration = Duration::from_millis(500);

/// The kind of controller that answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControllerKind {
    /// A real controller, by its boot id.
    Real,
    /// A mock controller: it proves nothing, and moves no arm.
    Mock,
    /// Nothing answers, so that the kind is not known.
    Unknown,
}

/// The controller that answers, as it reports itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReportedController {
    /// The kind.
    pub kind: ControllerKind,
    /// The checksum of its programs; `None` if nothing answers.
    pub programs_sum: Option<i32>,
    /// Its operating mode; `None` if nothing answers.
    pub mode: Option<Mode>,
}

impl ReportedController {
    /// Nothing answers.
    pub const UNKNOWN: ReportedController =
        ReportedController { kind: ControllerKind::Unknown, programs_sum: None, mode: None };
}

/// Connects to the cell's controller and reads its state once. Nothing moves.
///
/// # Errors
/// If the link cannot be started.
pub fn identify(cell: &Cell) -> Result<ReportedController, Fault> {
    let (mut robot, _simulated) = robot_alone(cell)?;
    let Ok(single) = SingleRobot::connect(&mut robot, cell.arm()) else { return Ok(ReportedController::UNKNOWN) };
    let state = single.state();
    let kind = if state.is_simulated() { ControllerKind::Mock } else { ControllerKind::Real };
    Ok(ReportedController { kind, programs_sum: Some(state.programs_checksum), mode: Some(state.mode) })
}

/// Refuses a path that needs this stage of the proofs, before anything is read or written for it. Only a controller
/// that reports itself as a mock needs none.
///
/// # Errors
/// If the stage is not signed, or the link cannot be started.
pub fn require_signed(cell: &Cell, needed: ProofStage) -> Result<(), Fault> {
    let Err(unsigned) = cell.robot().check_stage_signed(needed) else { return Ok(()) };
    if identify(cell)?.kind == ControllerKind::Mock {
        std::thread::sleep(RELEASE_PAUSE);
        return Ok(());
    }
    Err(DeviceFault::from(unsigned).into())
}
