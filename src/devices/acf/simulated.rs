//! The compliant tool of the simulated cell. Session and mock run in the world's time, which advances only while the
//! control loop waits.

use super::mock::{MockAcf, PlannedToolFault, ToolFault, ToolSurroundings};
use super::tool::{ConnectedTool, ToolReport, session_limits};
use crate::cameras::Arm;
use crate::world::SimulatedWorld;
use panelprep_base::geometry::{Flange, Rigid, Tool};
use panelprep_cell::cell::CompliantTool;
use panelprep_cell::force::{ForceSetPoint, LinkLossCause, Session, State, down_cosine};
use panelprep_kuka::eki::Time;

/// Time step of the simulation, ms.
const STEP_MS: u64 = 5;
/// Delay before a lost connection is opened again, ms.
const RECONNECT_DELAY_MS: u64 = 500;
/// Maximum distance outside the panel's outline at which the disc still touches the panel, mm.
const OUTLINE_MARGIN_MM: f64 = 15.0;

/// A source of the tool's surroundings: the panel in front of the tool and the tool's attitude.
pub trait Surroundings: Send {
    /// Returns the current surroundings of the tool; `None` if they are not known yet.
    fn now(&mut self) -> Option<ToolSurroundings>;
    /// Returns the fault that is injected at present.
    fn current_fault(&mut self) -> Option<ToolFault> {
        None
    }
}

/// Session and mock.
pub struct SimulatedAcf<S> {
    surroundings: S,
    session: Session,
    mock: MockAcf,
    last: Option<ToolSurroundings>,
    set_point: Option<ForceSetPoint>,
    last_report: Option<Time>,
    is_lost: bool,
    reconnect_ms: u64,
}

impl<S: Surroundings> SimulatedAcf<S> {
    /// Creates a tool with the parameters of the cell file, in these surroundings.
    pub fn new(tool: &CompliantTool, around: S) -> Self {
        SimulatedAcf {
            surroundings: around,
            session: Session::new(session_limits(tool)),
            mock: MockAcf::new(tool),
            last: None,
            set_point: None,
            last_report: None,
            is_lost: false,
            reconnect_ms: 0,
        }
    }

    /// Advances session and mock to the current time of the world.
    fn advance_to_now(&mut self, now: ToolSurroundings) {
        let from = self.last.replace(now).unwrap_or(ToolSurroundings { time_ms: now.time_ms, ..now });
        let span_ms = now.time_ms.saturating_sub(from.time_ms);
        let steps = span_ms.div_ceil(STEP_MS).max(1);
        for step in 1..=steps {
            let share = step as f64 / steps as f64;
            let between = |from: f64, to: f64| {
                if from.is_finite() && to.is_finite() { from + (to - from) * share } else { to }
            };
            self.step(ToolSurroundings {
                time_ms: from.time_ms + span_ms * step / steps,
                contact_extension_mm: between(from.contact_extension_mm, now.contact_extension_mm),
                downwards: between(from.downwards, now.downwards),
            });
        }
    }

    fn step(&mut self, around: ToolSurroundings) {
        let (now, now_ms) = (Time::from_ms(around.time_ms), around.time_ms);
        self.mock.advance(around);
        if matches!(self.session.state(), State::Offline | State::Lost(_)) && now_ms >= self.reconnect_ms {
            self.reconnect_ms = now_ms + RECONNECT_DELAY_MS;
            if !self.mock.is_reachable() {
                return self
                    .session
                    .end_session(LinkLossCause::Unreachable { problem: "the connection was refused".to_owned() });
            }
            self.mock.connect();
            let login = self.session.connected(now);
            self.mock.receive(&login, now_ms);
        }
        if let Some(press) = self.set_point.take_if(|_| self.session.is_receiving()) {
            self.session.set_point_now(press, now);
        }
        match self.mock.sent_bytes(now_ms) {
            Some(bytes) => self.session.received(&bytes, now),
            None => self.session.end_session(LinkLossCause::Closed),
        }
        if let Some(bytes) = self.session.tick(now) {
            self.mock.receive(&bytes, now_ms);
        }
    }
}

impl<S: Surroundings> ConnectedTool for SimulatedAcf<S> {
    fn set_force(&mut self, press: ForceSetPoint) {
        self.set_point = Some(press);
    }

    fn next_report(&mut self) -> Option<ToolReport> {
        let now = self.surroundings.now()?;
        let fault = self.surroundings.current_fault();
        self.mock.set_fault(fault);
        if self.last.is_none_or(|last| now.time_ms > last.time_ms) {
            self.advance_to_now(now);
        }
        if let State::Lost(loss) = self.session.state() {
            let is_new = !std::mem::replace(&mut self.is_lost, true);
            return is_new.then(|| ToolReport::Lost(loss.clone()));
        }
        let (at, reading) = self.session.last_reading().filter(|(at, _)| self.last_report != Some(*at))?;
        (self.last_report, self.is_lost) = (Some(at), false);
        let age_ms = u32::try_from(Time::from_ms(now.time_ms).since(at).as_millis()).unwrap_or(u32::MAX);
        Some(ToolReport::Reading { reading, age_ms })
    }
}

/// The true panel of the simulated world, relative to the tool on the arm.
pub struct SimulatedPanel {
    world: SimulatedWorld,
    arm: Arm,
    flange_from_tool: Rigid<Flange, Tool>,
    stroke_mm: f64,
    planned: Option<PlannedToolFault>,
}

impl SimulatedPanel {
    /// Creates the surroundings of a tool with this stroke on this arm.
    pub fn new((world, arm): (SimulatedWorld, Arm), flange_from_tool: Rigid<Flange, Tool>, stroke_mm: f64) -> Self {
        SimulatedPanel { world, arm, flange_from_tool, stroke_mm, planned: None }
    }

    /// Adds an injected fault that begins at a waypoint. A controller in another process does not report its progress
    /// on the path; in this case the fault never begins.
    #[must_use]
    pub fn with_fault(self, planned: Option<PlannedToolFault>) -> Self {
        SimulatedPanel { planned, ..self }
    }
}

impl Surroundings for SimulatedPanel {
    fn now(&mut self) -> Option<ToolSurroundings> {
        let moment = self.arm.moment_now()?;
        let truth = self.world.truth();
        let base_from_tool = moment.base_from_flange() * self.flange_from_tool;
        let tip = (truth.base_from_panel.inverse() * base_from_tool).origin();
        let is_beside = truth.outline_distance_mm(tip) > OUTLINE_MARGIN_MM;
        // The disc is parallel to the panel, so the distance along the tool's axis equals the distance along the
        // normal.
        let height_mm = if is_beside { f64::INFINITY } else { truth.distance_mm(tip) };
        Some(ToolSurroundings {
            time_ms: moment.time_ms(),
            contact_extension_mm: self.stroke_mm / 2.0 + height_mm,
            downwards: down_cosine(&base_from_tool),
        })
    }

    fn current_fault(&mut self) -> Option<ToolFault> {
        let Arm::Mock(robot) = &self.arm else { return None };
        let done = || {
            robot.with_controller(|controller| {
                controller.executed_motions().iter().filter(|command| command.contact).count()
            })
        };
        self.planned.filter(|planned| done() >= planned.from as usize).map(|planned| planned.fault)
    }
}
