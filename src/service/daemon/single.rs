//! Single functions of the robot, one at a time, for commissioning: `panelprep robot …`.
//!
//! Each function runs in its own epoch, which ends with the function: the controller then switches the tool off, and
//! base and tool are unknown again. A linear motion must pass the same path checks as the paths of a cycle. Motions and
//! outputs must satisfy the interlocks of a cycle (`single_interlocks`). Unlike the motions of a cycle, these motions
//! may run in T1, with a person at the enabling switch. These functions are not in the journal, because no later action
//! depends on them, and a controller that loses its client stops automatically.

use super::corrected::CalibratedRobot;
use super::moves::{self, move_lin};
use super::ports::RobotPort;
use super::single_interlocks;
use crate::setup::{Mounted, is_input_on, proof_gate};
use panelprep_base::geometry::{Base, Joints, KukaPose, Rigid, Tool};
use panelprep_base::supervision::ThreadFault;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::{Arm, Cell, InputsOutputs, LOCAL_CONTROL, ProofStage};
use panelprep_cell::cycle::{Action, Path, Switch};
use panelprep_kuka::eki::{
    Command, CommandId, Epoch, LinkLoss, Mode, MoveJ, QueueError, Report, SetAccSpeed, SetTcp, Signal, State, Time,
};
use panelprep_toolpath::path::routes::{self, StartState};
use panelprep_toolpath::path::{Kinematics, judge_joints, reach};
use std::time::{Duration, Instant};

/// Time limit for the first answer of a controller, by the wall clock: the controller may still be closing the
/// connection of its previous client.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(4);
/// Time limits by the robot's clock: for a switch, a frame or a subroutine, and below it for a motion through the air.
const COMMAND_TIMEOUT: Duration = Duration::from_secs(30);
const MOTION_TIMEOUT: Duration = Duration::from_secs(300);
/// Time limit for the robot's next state, by the robot's clock.
const STATE_TIMEOUT: Duration = Duration::from_secs(1);
/// Maximum number of waiting reports that are read to find the report that states why the connection was lost.
const MAX_REPORTS: usize = 32;
/// Time limit for the arm to stop before a function begins, by the robot's clock.
const STANDSTILL_TIMEOUT: Duration = Duration::from_secs(5);

/// The reason why a function was not executed.
#[derive(Debug, thiserror::Error)]
pub enum SingleError {
    /// No controller answers.
    #[error("no controller answers: {0}; check the cable, the address and the robot program")]
    NoController(LinkLoss),
    /// No controller answered, and no reason was reported.
    #[error("no controller answered within {} s; check the cable, the address and the robot program", CONNECT_TIMEOUT.as_secs())]
    Silent,
    /// The command cannot be sent.
    #[error(transparent)]
    Queue(#[from] QueueError),
    /// A check rejects the function.
    #[error("a check rejects the command: {}", describe_judgement(.0))]
    Gate(Judgement),
    /// The robot did not execute the function.
    #[error("the robot did not execute the command: {0}")]
    Robot(String),
    /// The connection was lost during the function.
    #[error("the connection to the controller was lost: {0}; the controller stops the robot automatically")]
    LinkLost(LinkLoss),
    /// The function exceeded its time limit.
    #[error("the command was not complete after {} s of the robot's time; the robot was commanded to stop", .0.as_secs())]
    Late(Duration),
}

fn describe_judgement(judgement: &Judgement) -> String {
    judgement.reasons.iter().map(|reason| reason.message.as_str()).collect::<Vec<_>>().join("; ")
}

/// A linear motion with its base and tool frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingleLine {
    /// The target pose of the TCP, in `base`.
    pub target: KukaPose,
    /// The base frame (`$BASE`), given in the robot's world frame.
    pub base: KukaPose,
    /// The tool.
    pub tool: SetTcp,
    /// Speed of the TCP, mm/s.
    pub speed_mm_s: f64,
}

/// A connected robot that executes single functions.
pub struct SingleRobot<'r> {
    robot: CalibratedRobot<'r>,
    state: State,
    mounted: Vec<Mounted>,
}

impl<'r> SingleRobot<'r> {
    /// Waits until the controller has answered. Nothing moves.
    ///
    /// # Errors
    /// If no controller answers.
    pub fn connect(robot: &'r mut dyn RobotPort, arm: &Arm) -> Result<Self, SingleError> {
        let mut robot = CalibratedRobot::new(robot, arm);
        let (begun, mut why) = (Instant::now(), None);
        while begun.elapsed() < CONNECT_TIMEOUT {
            match robot.next().map_err(thread_error)? {
                Some(Report::Connected { state } | Report::State(state)) => {
                    return Ok(SingleRobot { robot, state: *state, mounted: Vec::new() });
                }
                Some(Report::LinkLost { why: lost }) => why = Some(lost),
                _ => {}
            }
        }
        Err(why.map_or(SingleError::Silent, SingleError::NoController))
    }

    /// Adds the devices mounted on the flange. Every motion keeps them away from the objects in the cell, whatever tool
    /// is active in the controller.
    #[must_use]
    pub fn with_mounted(self, mounted: Vec<Mounted>) -> Self {
        SingleRobot { mounted, ..self }
    }

    /// Checks whether the arm is the one in the cell's file: the reported TCP pose must agree with the TCP pose that is
    /// computed from the axis positions.
    ///
    /// # Errors
    /// If the poses do not agree; the error contains the distance between them.
    pub fn check_arm_identity(&self, cell: &Cell) -> Result<(), Reason> {
        let state = &self.state;
        let tip = state.active_base.to_rigid::<Base, Base>() * state.base_from_tcp.to_rigid::<Base, Tool>();
        routes::check_arm_identity(
            &Kinematics::new(cell.arm()),
            &state.joints,
            state.flange_from_tool.to_rigid(),
            tip,
        )
    }

    /// Returns the last state that the controller reported. If the arm has a correction, the state contains the true
    /// TCP pose.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Returns the TCP pose in the active base as the controller reports it, if the arm has a correction; this pose
    /// differs from the true one.
    pub fn reported_tcp(&self) -> Option<KukaPose> {
        self.robot.reported_tcp()
    }

    /// Executes any function except a motion, an output or a subroutine, which have their own checks below.
    ///
    /// # Errors
    /// If the controller's programs are not the accepted ones, or if the function cannot be sent, is refused, or is not
    /// complete within its time limit.
    pub fn set(&mut self, command: Command, cell: &Cell) -> Result<(), SingleError> {
        require_accept(Judgement::new(self.changed_programs_reason(cell).into_iter().collect(), vec![]))?;
        match command {
            Command::MoveLin(_) | Command::MoveJ(_) | Command::SetDigout(_) | Command::CallSubroutine { .. } => {
                let message = format!(
                    "{} cannot be sent by this function, because it needs further checks: use its own \
                             command",
                    command.name()
                );
                return Err(gate(Reason::new("not_single", message)));
            }
            _ => self.open_epoch()?,
        }
        let id = self.send(command)?;
        self.wait_executed(id, COMMAND_TIMEOUT)
    }

    /// Calls a subroutine of the controller. The subroutine may move the arm, therefore the checks of a motion apply.
    ///
    /// # Errors
    /// The errors of [`SingleRobot::set`], and if a check rejects the function.
    pub fn call(&mut self, index: u16, cell: &Cell) -> Result<(), SingleError> {
        self.check_motion(cell)?;
        self.check_arm_identity(cell).map_err(gate)?;
        self.open_epoch()?;
        self.check_interlocks("a subroutine", single_interlocks::motion(Path::Park), cell)?;
        let id = self.send(Command::CallSubroutine { index })?;
        self.wait_executed(id, MOTION_TIMEOUT)
    }

    /// Moves the axes to these positions.
    ///
    /// # Errors
    /// The errors of [`SingleRobot::set`], and if a check rejects the motion.
    pub fn move_joints(&mut self, joints: Joints, axis_speed_percent: u8, cell: &Cell) -> Result<(), SingleError> {
        self.check_motion(cell)?;
        require_accept(judge_joints(&joints))?;
        self.check_arm_identity(cell).map_err(gate)?;
        let (arm, tool) = (Kinematics::new(cell.arm()), self.state.flange_from_tool.to_rigid());
        reach::joint_motion(&arm, tool, &self.state.joints, &joints)
            .map_err(|obstacle| gate(Reason::new("out_of_reach", obstacle.to_string())))?;
        for Mounted { name, flange_from_tip } in &self.mounted {
            reach::joint_motion(&arm, *flange_from_tip, &self.state.joints, &joints)
                .map_err(|obstacle| gate(Reason::new("out_of_reach", format!("with {name}: {obstacle}"))))?;
        }
        self.open_epoch()?;
        self.check_interlocks("an axis motion", single_interlocks::motion(Path::Park), cell)?;
        let id = self.send(Command::MoveJ(MoveJ { joints, axis_speed_percent: f64::from(axis_speed_percent) }))?;
        self.wait_executed(id, MOTION_TIMEOUT)
    }

    /// Moves the TCP along a straight line.
    ///
    /// # Errors
    /// The errors of [`SingleRobot::move_joints`].
    pub fn move_line(&mut self, line: &SingleLine, cell: &Cell) -> Result<(), SingleError> {
        self.check_motion(cell)?;
        let limits = cell.limits();
        let fastest_mm_s = limits.max_speed_mm_s();
        if line.speed_mm_s.is_nan() || line.speed_mm_s > fastest_mm_s {
            let found_mm_s = line.speed_mm_s;
            let message = format!("the speed is {found_mm_s} mm/s (limit {fastest_mm_s} mm/s, max_speed_mm_s)");
            return Err(gate(Reason::new("speed", message)));
        }
        self.open_epoch()?;
        self.send(Command::SetBase(line.base))?;
        // The frames are set before the check, because the controller reports the TCP pose in these frames. This moves
        // nothing.
        let id = self.send(Command::SetTcp(line.tool))?;
        self.wait_executed(id, COMMAND_TIMEOUT)?;
        // The motion begins at the TCP pose that the controller reports in these frames.
        let from: Rigid<Base, Tool> = self.state.base_from_tcp.to_rigid();
        let standing = StartState {
            limits,
            arm: cell.arm(),
            flange_from_tool: line.tool.flange_from_tool.to_rigid(),
            joints: self.state.joints,
            obstacles: None,
        };
        let gated = routes::gate_air_motion_at(
            &standing,
            line.base.to_rigid::<Base, Base>(),
            (from, line.target.to_rigid()),
            None,
            line.speed_mm_s,
        );
        require_accept(gated.judgement())?;
        for Mounted { name, flange_from_tip } in &self.mounted {
            routes::check_mounted_object(&standing, line.base.to_rigid(), &gated.points, *flange_from_tip)
                .map_err(|infeasible| {
                    gate(Reason { message: format!("with {name}: {}", infeasible.message), ..infeasible })
                })?;
        }
        // The interlocks of the motion to the first corner apply to all linear motions through the air.
        self.check_interlocks("a straight motion", single_interlocks::motion(Path::Corner { view: 0 }), cell)?;
        self.send(Command::SetAccSpeed(moves::speed_command(gated.speed)))?;
        let sent = self.robot.send_path(move_lin(&gated.points), None);
        let id = sent.map_err(|error| self.not_sent_error(error))?;
        self.wait_executed(id, MOTION_TIMEOUT)
    }

    /// Sets an output, and keeps this epoch open for the given time, so that the output stays set.
    ///
    /// # Errors
    /// The errors of [`SingleRobot::set`], and if an interlock is not satisfied.
    pub fn set_output(&mut self, name: &str, on: bool, cell: &Cell, keep: Duration) -> Result<(), SingleError> {
        // Also checked before an output is switched off: with other programs, its number may belong to another output.
        require_accept(Judgement::new(self.changed_programs_reason(cell).into_iter().collect(), vec![]))?;
        let number = output_number(name, cell.inputs_outputs())?;
        let act = single_interlocks::switch_of_output(name).filter(|_| on).map(Action::Switch);
        if act.is_some_and(requires_proofs) {
            self.check_proofs(cell)?;
        }
        self.open_epoch()?;
        if let Some(act) = act {
            self.check_interlocks(name, act, cell)?;
        }
        let id = self.send(Command::SetDigout(Signal { number, on }))?;
        self.wait_executed(id, COMMAND_TIMEOUT)?;
        let until = self.robot.now() + keep;
        while self.robot.now() < until {
            self.receive()?;
        }
        Ok(())
    }

    /// Checks the cycle's interlocks for this action with a new state of the robot, not with the state at the start of
    /// the epoch.
    fn check_interlocks(&mut self, name: &str, act: Action, cell: &Cell) -> Result<(), SingleError> {
        // A new state is read, because the stored state may be from before a guard was opened.
        let last_sequence = self.state.sequence;
        while self.state.sequence == last_sequence {
            self.receive()?;
        }
        let judged = single_interlocks::judge(name, act, &self.state, cell);
        // A person may have changed the operating mode since the first check of the action.
        let unproven = self.missing_proof_reason(cell).filter(|_| requires_proofs(act));
        match unproven {
            Some(why) => Err(SingleError::Gate(Judgement::new(vec![why], vec![]))),
            None => require_accept(judged),
        }
    }

    /// Checks that the acceptance tests of the controller permit motions in its present mode.
    ///
    /// # Errors
    /// If the required stage is not signed.
    pub fn check_proofs(&self, cell: &Cell) -> Result<(), SingleError> {
        self.missing_proof_reason(cell).map_or(Ok(()), |why| Err(gate(why)))
    }

    /// Returns the reason why the acceptance tests do not permit a motion in automatic mode. In T1 a person holds the
    /// enabling switch; T2 is refused by a separate rule.
    fn missing_proof_reason(&self, cell: &Cell) -> Option<Reason> {
        let is_by_hand = matches!(self.state.mode, Mode::T1 | Mode::T2);
        proof_gate::refusal(cell.robot(), ProofStage::A, Some(&self.state)).filter(|_| !is_by_hand)
    }

    /// Checks that the state of the controller and its switches permit a motion, in T1 or in automatic mode.
    fn check_motion(&self, cell: &Cell) -> Result<(), SingleError> {
        let state = &self.state;
        let is_local = cell.inputs_outputs().input_bit(LOCAL_CONTROL).is_none_or(|bit| is_input_on(state, bit));
        // In T1 a person holds the enabling switch beside the arm, and the controller limits the speed; therefore the
        // guard may be open.
        let by_hand = matches!(state.mode, Mode::T1 | Mode::T2);
        let checks = [
            (
                !is_local,
                "local_control",
                "the selector switch is set to remote, but the request comes from a person at the cell; set the \
                 switch to local",
            ),
            (state.mode == Mode::T2, "mode", "the mode is T2; use T1, AUT or EXT"),
            (state.emergency_stop, "emergency_stop", "an emergency stop is pressed; release and acknowledge it"),
            (!by_hand && !state.guard_closed, "guard", "the guard is open; close it, or work in T1"),
            (!state.drives_on, "drives", "the drives are off; switch them on (in T1: hold the enabling switch)"),
            (
                state.drives_on && !state.motion_possible,
                "motion",
                "the controller reports that no motion is possible; start the robot program, hold the start key in \
                 T1, and acknowledge every message",
            ),
        ];
        let open = checks.into_iter().filter(|(wrong, ..)| *wrong);
        let others = open.map(|(_, code, message)| Reason::new(code, message));
        let reasons = self
            .changed_programs_reason(cell)
            .into_iter()
            .chain(self.missing_proof_reason(cell))
            .chain(others)
            .collect();
        require_accept(Judgement::new(reasons, vec![]))
    }

    /// Returns a reason if the controller's programs are not those with which the cell was accepted: the numbers of
    /// signals, flags and operations may then have another meaning.
    fn changed_programs_reason(&self, cell: &Cell) -> Option<Reason> {
        let accepted = cell.robot().programs_sum()?;
        (accepted != self.state.programs_checksum).then(|| {
            Reason::new(
                "other_programs",
                "the controller's programs are not those with which the cell was accepted ([robot] programs_sum); \
                 find out who changed them, then run `panelprep doctor --kuka DIR`",
            )
        })
    }

    fn open_epoch(&mut self) -> Result<(), SingleError> {
        // If its last client has just disconnected, a controller may still be stopping the arm.
        let rests_until = self.robot.now() + STANDSTILL_TIMEOUT;
        while self.state.moving && self.robot.now() < rests_until {
            self.receive()?;
        }
        let asked = self.robot.open_epoch(Epoch(0)).map_err(|error| self.not_sent_error(error))?;
        let until = self.robot.now() + COMMAND_TIMEOUT;
        while self.state.epoch != asked {
            if let Some(Report::EpochNotOpened { asked, found }) = self.receive()? {
                return Err(SingleError::Robot(format!(
                    "the controller is in epoch {found}, but epoch {asked} was requested; repeat the command"
                )));
            }
            self.check_deadline(until, COMMAND_TIMEOUT)?;
        }
        Ok(())
    }

    /// Waits until a command is executed and the arm is stationary.
    fn wait_executed(&mut self, id: CommandId, allowed: Duration) -> Result<(), SingleError> {
        let until = self.robot.now() + allowed;
        // A command can be executed before the arm is stationary: with blending, the last command is complete while the
        // arm still brakes.
        while self.state.done < id || self.state.moving {
            match self.receive()? {
                Some(Report::Refused { refusal, .. }) => return Err(self.stopped_error(refusal.to_string())),
                Some(Report::EchoMismatch(mismatch)) => return Err(self.stopped_error(mismatch.to_string())),
                Some(Report::Interrupted { cause }) => return Err(self.stopped_error(cause.to_string())),
                Some(Report::SequenceError(error)) => return Err(self.stopped_error(error.to_string())),
                Some(Report::WatchdogExpired { channel, silence }) => {
                    let words = format!(
                        "no message was received on the {channel} for {} ms; check the cable and the \
                                         robot program",
                        silence.as_millis()
                    );
                    return Err(self.stopped_error(words));
                }
                _ => {}
            }
            self.check_deadline(until, allowed)?;
        }
        Ok(())
    }

    fn send(&mut self, command: Command) -> Result<CommandId, SingleError> {
        let sent = self.robot.send(command);
        sent.map_err(|error| self.not_sent_error(error))
    }

    /// Returns the error for a command that was not sent: if the connection is lost, the reason for the loss.
    fn not_sent_error(&mut self, error: QueueError) -> SingleError {
        if error == QueueError::NotConnected {
            for _ in 0..MAX_REPORTS {
                if let Err(lost @ SingleError::LinkLost(_)) = self.receive() {
                    return lost;
                }
            }
        }
        SingleError::Queue(error)
    }

    /// Returns the error for a function that the robot did not execute for this reason. The robot's next state is read
    /// first, so that the error is displayed with this state.
    fn stopped_error(&mut self, why: String) -> SingleError {
        let (before, until) = (self.state.sequence, self.robot.now() + STATE_TIMEOUT);
        while self.state.sequence == before && self.robot.now() < until {
            if self.receive().is_err() {
                break;
            }
        }
        SingleError::Robot(why)
    }

    fn receive(&mut self) -> Result<Option<Report>, SingleError> {
        let report = self.robot.next().map_err(thread_error)?;
        match &report {
            Some(Report::Connected { state } | Report::State(state)) => self.state = **state,
            Some(Report::Rebooted { .. }) => {
                return Err(SingleError::Robot(
                    "the controller was restarted; wait until it is ready, then repeat the \
                                               command"
                        .to_owned(),
                ));
            }
            Some(Report::LinkLost { why }) => return Err(SingleError::LinkLost(why.clone())),
            _ => {}
        }
        Ok(report)
    }

    fn check_deadline(&mut self, until: Time, allowed: Duration) -> Result<(), SingleError> {
        if self.robot.now() <= until {
            return Ok(());
        }
        #[expect(
            clippy::let_underscore_must_use,
            reason = "the robot was commanded to stop; its reply is not needed"
        )]
        let _ = self.robot.abort();
        Err(SingleError::Late(allowed))
    }
}

/// Returns the error for a failed thread of the connection.
fn thread_error(fault: ThreadFault) -> SingleError {
    SingleError::Robot(fault.to_string())
}

fn gate(reason: Reason) -> SingleError {
    SingleError::Gate(Judgement::new(vec![reason], vec![]))
}

fn require_accept(judgement: Judgement) -> Result<(), SingleError> {
    if judgement.verdict == Verdict::Accept { Ok(()) } else { Err(SingleError::Gate(judgement)) }
}

fn output_number(name: &str, io: &InputsOutputs) -> Result<u16, SingleError> {
    io.outputs().get(name).copied().ok_or_else(|| {
        let names = io.outputs().keys().map(String::as_str).collect::<Vec<_>>().join(", ");
        let message = format!("\"{name}\" is not an output in [io.outputs]; valid: {names}");
        gate(Reason::new("no_such_output", message))
    })
}

/// Returns the command that sets these speeds.
pub fn speed_command(speed_mm_s: f64, acceleration_m_s2: f64, axis_percent: u8) -> Command {
    Command::SetAccSpeed(SetAccSpeed {
        speed_m_s: speed_mm_s / 1_000.0,
        acceleration_m_s2,
        axis_speed_percent: axis_percent,
        axis_acceleration_percent: axis_percent,
    })
}

/// Returns whether an action requires stage A of the acceptance tests in automatic mode, in which no person holds an
/// enabling switch: each motion, and water.
fn requires_proofs(act: Action) -> bool {
    matches!(act, Action::Move(_) | Action::Switch(Switch::Spray | Switch::Rinse))
}

#[cfg(test)]
mod tests;
