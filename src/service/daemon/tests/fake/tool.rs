//! The compliant tool of the scripted cell on the true panel, and a cell that is just before its contact path.

use super::super::super::*;
use super::{Asks, Cell, FakeCameras, FakeRobot, Memory, Shared, World};
use crate::daemon;
use crate::daemon::running::{LoopMemory, OtherPorts};
use crate::setup::CycleSetup;
use panelprep_base::geometry::{Flange, KukaPose, Rigid, Tool};
use panelprep_cell::cycle::{Action, At, Event, Phase, State, Switch};
use panelprep_cell::force::down_cosine;
use panelprep_devices::acf::{ConnectedTool as _, SimulatedAcf, Surroundings, ToolFault, ToolSurroundings};
use panelprep_store::tape::ArmedDeadline;
use std::sync::Arc;

/// The simulated panel in front of the tool.
struct FakePanel {
    world: Shared,
    stroke_mm: f64,
}

impl Surroundings for FakePanel {
    fn now(&mut self) -> Option<ToolSurroundings> {
        let world = self.world.borrow();
        let flange_from_tool: Rigid<Flange, Tool> = KukaPose { z_mm: 160.0, ..KukaPose::default() }.to_rigid();
        let base_from_tool = world.base_from_flange * flange_from_tool;
        let truth = world.sim.truth();
        let height_mm = truth.distance_mm((truth.base_from_panel.inverse() * base_from_tool).origin());
        Some(ToolSurroundings {
            time_ms: world.time_ms,
            contact_extension_mm: self.stroke_mm / 2.0 + height_mm,
            downwards: down_cosine(&base_from_tool),
        })
    }

    fn current_fault(&mut self) -> Option<ToolFault> {
        let mut world = self.world.borrow_mut();
        let (from, fault) = world.tool_fault?;
        if world.in_contact < from {
            return None;
        }
        // The mock tool assumes this state for the whole time since the last call.
        let since_ms = world.time_ms - 100;
        // After the disc has left the panel, the contact time begins again at the next contact.
        let rubs = world.rubs && world.outputs.get(&5) == Some(&true);
        if world.tool_off_ms.is_none() {
            world.rubs_since_ms = rubs.then(|| world.rubs_since_ms.unwrap_or(since_ms));
        }
        Some(fault)
    }
}

impl Cell {
    /// Returns the tool of this cell, as configured in its file.
    pub(super) fn tool(&self) -> LinkedTool {
        linked(&self.files().0, &self.world)
    }

    /// Returns the cell with a robot that executes one waypoint in 100 ms.
    pub fn step_by_step(self) -> Self {
        self.world.borrow_mut().pace = 1;
        self
    }
}

fn simulated(cell: &panelprep_cell::cell::Cell, world: &Shared) -> Option<SimulatedAcf<FakePanel>> {
    let tool = cell.tool().compliant()?;
    Some(SimulatedAcf::new(tool, FakePanel { world: world.clone(), stroke_mm: tool.stroke_mm }))
}

fn linked(cell: &panelprep_cell::cell::Cell, world: &Shared) -> LinkedTool {
    simulated(cell, world).map(LinkedTool::new).unwrap_or_default()
}

/// A cycle whose tool is being switched on before contact; it can be continued from here any number of times.
pub struct AtContact {
    cell: panelprep_cell::cell::Cell,
    setup: Arc<CycleSetup>,
    world: World,
    state: State,
    perception: daemon::perception::Perception,
    abrasion: daemon::abrasion::AbrasionWork,
    pending: daemon::running::PendingAction,
    armed: Vec<ArmedDeadline>,
    robot_state: Option<panelprep_kuka::eki::State>,
}

/// The result of a contact path.
pub struct Ended {
    pub state: State,
    pub findings: Vec<Finding>,
    /// Time from the injected fault, or from the first contact after it, until the tool was off, ms; `None` if there
    /// was no contact after the fault.
    pub took_ms: Option<u64>,
    /// Number of executed waypoints at the end of the motion.
    pub done: Option<u32>,
}

impl AtContact {
    /// Runs a cycle up to the beginning of its contact path.
    pub fn new(cell: Cell) -> Self {
        let setup = Arc::new(cell.setup());
        let mut record = Memory { fails_at: usize::MAX, ..Memory::default_of(&cell.world) };
        let (mut robot, mut tool) = (FakeRobot { world: cell.world.clone(), by_the_wall: false }, cell.tool());
        let mut asks = Asks::one_cycle();
        let computing = Computing::inline(Box::new(FakeCameras::new(cell.world.clone())), true);
        let robot = daemon::corrected::CalibratedRobot::new(&mut robot, &setup.cell.arm);
        let ports = OtherPorts { robot, tool: &mut tool, record: &mut record, requests: &mut asks };
        let mut running =
            LoopMemory::new((setup.cell(), Some(setup.clone())), computing, ports, (State::INITIAL, true));
        while let Some(event) = running.next_event().expect("no fault") {
            running.process_event(event).expect("no fault");
            let switches = running.state.due.is_some_and(|due| due.act == Action::Switch(Switch::ToolOn));
            if running.state.at == At::Execute(Phase::Abrade) && switches {
                break;
            }
        }
        let LoopMemory { state, perception, abrasion, pending_action: pending, deadlines, robot_state, .. } =
            running;
        let pending = pending.unwrap_or_else(|| panic!("no contact: {:?}", state.at));
        let armed = deadlines.to_recording();
        let world = cell.world.borrow().clone();
        AtContact { cell: cell.files().0, setup, world, state, perception, abrasion, pending, armed, robot_state }
    }

    /// Returns the number of waypoints of the path.
    pub fn waypoints(&self) -> u32 {
        self.state.job.waypoints
    }

    /// Runs the path with a tool into which this fault is injected after `from` lines of the path are executed.
    pub fn run(&self, from: u32, fault: Option<ToolFault>) -> Ended {
        let mut world = World { tool_fault: fault.map(|fault| (from, fault)), ..self.world.clone() };
        world.time_ms += 100;
        let world = Shared::new(world);
        let mut record = Memory { fails_at: usize::MAX, ..Memory::default_of(&world) };
        let (mut robot, mut asks) = (FakeRobot { world: world.clone(), by_the_wall: false }, Asks::one_cycle());
        // Some measured values are sent first, as if the tool had been connected for a long time.
        let mut tool = simulated(&self.cell, &world).expect("a compliant tool");
        for _ in 0..3 {
            tool.next_report();
            world.borrow_mut().time_ms += 10;
        }
        let mut tool = LinkedTool::new(tool);
        let computing = Computing::inline(Box::new(FakeCameras::new(world.clone())), true);
        let robot = daemon::corrected::CalibratedRobot::new(&mut robot, &self.setup.cell.arm);
        let ports = OtherPorts { robot, tool: &mut tool, record: &mut record, requests: &mut asks };
        let cycle = (self.setup.cell(), Some(self.setup.clone()));
        let mut running = LoopMemory::new(cycle, computing, ports, (self.state, true));
        let robot = self.robot_state.map(Box::new);
        running.restore_memory(panelprep_store::tape::LoopMemoryStart::Cycle {
            robot,
            armed: self.armed.clone(),
            place: None,
        });
        (running.perception, running.abrasion) = (self.perception.clone(), self.abrasion.clone());
        running.pending_action = Some(self.pending);
        let goes_on = |state: &State| {
            let last = state.due.is_some_and(
                |due| matches!(due.act, Action::Move(motion) if motion.path == panelprep_cell::cycle::Path::Retract),
            );
            !state.at.is_at_rest() && !last
        };
        while goes_on(&running.state)
            && let Some(event) = running.next_event().expect("no fault")
        {
            let is_done = matches!(event, Event::Reported(panelprep_cell::cycle::Report::Boot));
            assert!(!is_done, "it continues");
            running.process_event(event).expect("no fault");
        }
        let state = running.state;
        drop(running);
        let world = world.borrow();
        let took_ms = world.rubs_since_ms.zip(world.tool_off_ms).map(|(from_ms, off_ms)| off_ms - from_ms);
        let done = record.intents.iter().find_map(|(_, end)| end.map(|(_, done)| done));
        Ended { state, took_ms, done, findings: record.findings }
    }
}
