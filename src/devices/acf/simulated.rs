//! The tool of the simulated cell: session and mock in the world's time, which passes only while the loop waits.

use super::mock::{MockAcf, PlannedToolFault, ToolFault, ToolSurroundings};
use super::tool::{ConnectedTool, ToolReport, session_limits};
use crate::cameras::Arm;
use crate::world::SimulatedWorld;
use panelprep_base::geometry::{Flange, Rigid, Tool};
use panelprep_cell::cell::CompliantTool;
use panelprep_cell::force::{ForceSetPoint, LinkLossCause, Session, State, down_cosine};
use panelprep_kuka::eki::Time;

/// Time step of session and mock between two calls, ms.
const STEP_MS: u64 = 5;
/// Time after which a lost link is tried again, ms.
const RECONNECT_DELAY_MS: u64 = 500;
/// Distance outside the panel's outline, mm, beyond which nothing is in front of the disc.
const OUTLINE_MARGIN_MM: f64 = 15.0;

/// The source of the tool's surroundings.
pub trait Surroundings: Send {
    /// Returns the tool's present surroundings; `None` if they are not known yet.
    fn now(&mut self) -> Option<ToolSurroundings>;
    /// Returns the fault that the tool has now.
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
    /// Creates a tool as the cell's file describes it, in these surroundings.
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

    /// Advances session and mock to the present time.
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

/// The true panel in front of the arm of the simulated world.
pub struct SimulatedPanel {
    world: SimulatedWorld,
    arm: Arm,
    flange_from_tool: Rigid<Flange, Tool>,
    stroke_mm: f64,
    planned: Option<PlannedToolFault>,
}

impl SimulatedPanel {
    /// Creates the panel for a tool of this stroke that is mounted on this arm.
    pub fn new((world, arm): (SimulatedWorld, Arm), flange_from_tool: Rigid<Flange, Tool>, stroke_mm: f64) -> Self {
        SimulatedPanel { world, arm, flange_from_tool, stroke_mm, planned: None }
    }

    /// Returns the same panel with a planned fault of the tool. A controller in another process does not report its
    /// progress on the path; the tool then has no fault.
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
        // The disc is flat on the panel: the distance along the tool's axis equals the distance along the normal.
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
