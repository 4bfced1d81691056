//! The robot in true poses: what it reports is corrected by the arm's measured errors, and so is what it is sent.
//!
//! The controller computes with the drawing of its arm. With the correction that the cell's file names, everything on this
//! side of the link is where the arm truly is; on the wire and in a recording stand the controller's own numbers. An arm
//! without a correction passes unchanged, to the last bit. Axis angles are the same on both sides.

use super::ports::Robot;
use crate::cell;
use crate::eki::{Command, CommandId, Epoch, MoveLin, QueueError, Report, State, Time};
use crate::geometry::{Base, Flange, Joints, KukaPose, Panel, Rigid, Tool};
use crate::path::Kinematics;
use crate::supervision::ThreadFault;

/// The robot behind the correction of its arm.
pub(super) struct Corrected<'r> {
    robot: &'r mut dyn Robot,
    /// The arm, where it has a correction.
    arm: Option<Kinematics>,
    base: Rigid<Base, Panel>,
    flange_from_tool: Rigid<Flange, Tool>,
    /// Where the axes stand, and where they will stand after the command that was sent last.
    joints: Option<Joints>,
    ahead: Option<(CommandId, Joints)>,
    reported_tcp: Option<KukaPose>,
}

impl<'r> Corrected<'r> {
    /// Behind the correction of this arm.
    pub fn new(robot: &'r mut dyn Robot, arm: &cell::Arm) -> Self {
        Corrected {
            robot,
            arm: arm.correction().map(|_| Kinematics::new(arm)),
            base: Rigid::claim(nalgebra::Isometry3::identity()),
            flange_from_tool: Rigid::claim(nalgebra::Isometry3::identity()),
            joints: None,
            ahead: None,
            reported_tcp: None,
        }
    }

    /// The tip in the active base as the controller reported it last; `None` for an arm without a correction.
    pub fn reported_tcp(&self) -> Option<KukaPose> {
        self.reported_tcp
    }

    /// Where the axes stand before the first report.
    pub fn stands_at(&mut self, joints: Joints) {
        self.joints = Some(joints);
    }

    /// The points as the controller has to be sent them, and the axes at the last of them.
    fn sent(&self, points: Vec<MoveLin>) -> Result<(Vec<MoveLin>, Option<Joints>), QueueError> {
        let Some(arm) = &self.arm else { return Ok((points, None)) };
        let stands = self.ahead.map(|(_, joints)| joints).or(self.joints);
        let mut at = stands.ok_or(QueueError::Uncorrected { point: 1 })?;
        let mut sent = Vec::with_capacity(points.len());
        for (index, point) in points.into_iter().enumerate() {
            let wanted = self.base * point.pose.to_rigid::<Panel, Tool>() * self.flange_from_tool.inverse();
            let (flange, joints) =
                arm.sent_flange(&wanted, &at).ok_or(QueueError::Uncorrected { point: index + 1 })?;
            at = joints;
            let pose = KukaPose::from_rigid(&(self.base.inverse() * flange * self.flange_from_tool));
            sent.push(MoveLin { pose, ..point });
        }
        Ok((sent, Some(at)))
    }

    fn path(
        &mut self,
        points: Vec<MoveLin>,
        send: impl FnOnce(&mut dyn Robot, Vec<MoveLin>) -> Result<CommandId, QueueError>,
    ) -> Result<CommandId, QueueError> {
        let (points, end) = self.sent(points)?;
        let last = send(self.robot, points)?;
        self.ahead = end.map(|joints| (last, joints)).or(self.ahead);
        Ok(last)
    }

    fn corrected(&mut self, mut state: State) -> State {
        let Some(arm) = &self.arm else { return state };
        self.reported_tcp = Some(state.base_from_tcp);
        state.base_from_tcp = tip(arm, &state);
        self.joints = Some(state.joints);
        self.ahead.take_if(|(last, _)| state.done >= *last && !state.moving);
        state
    }
}

/// Where the tip truly is in the active base.
fn tip(arm: &Kinematics, state: &State) -> KukaPose {
    let (base, tool) =
        (state.active_base.to_rigid::<Base, Base>(), state.flange_from_tool.to_rigid::<Flange, Tool>());
    let reported = base * state.base_from_tcp.to_rigid::<Base, Tool>() * tool.inverse();
    KukaPose::from_rigid(&(base.inverse() * arm.true_flange(reported, &state.joints) * tool))
}

impl Robot for Corrected<'_> {
    fn send(&mut self, command: Command) -> Result<CommandId, QueueError> {
        if self.arm.is_none() {
            return self.robot.send(command);
        }
        match command {
            Command::MoveLin(point) => {
                let single = |robot: &mut dyn Robot, mut points: Vec<MoveLin>| match points.pop() {
                    Some(point) => robot.send(Command::MoveLin(point)),
                    None => Err(QueueError::EmptyPath),
                };
                return self.path(vec![point], single);
            }
            Command::SetBase(base) => self.base = base.to_rigid(),
            Command::SetTcp(tool) => self.flange_from_tool = tool.flange_from_tool.to_rigid(),
            Command::MoveJ(to) => {
                let id = self.robot.send(command)?;
                self.ahead = Some((id, to.joints));
                return Ok(id);
            }
            _ => {}
        }
        self.robot.send(command)
    }

    fn send_path(&mut self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        self.path(points, |robot, points| robot.send_path(points))
    }

    fn send_path_within(&mut self, points: Vec<MoveLin>, permitted: u32) -> Result<CommandId, QueueError> {
        self.path(points, |robot, points| robot.send_path_within(points, permitted))
    }

    fn permit(&mut self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.robot.permit(last)
    }

    fn open_epoch(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
        self.ahead = None;
        self.robot.open_epoch(above)
    }

    fn abort(&mut self) -> Result<(), QueueError> {
        self.ahead = None;
        self.robot.abort()
    }

    fn next(&mut self) -> Option<Report> {
        Some(match self.robot.next()? {
            Report::Connected { state } => Report::Connected { state: Box::new(self.corrected(*state)) },
            Report::State(state) => Report::State(Box::new(self.corrected(*state))),
            Report::Rebooted { state } => Report::Rebooted { state: Box::new(self.corrected(*state)) },
            other => other,
        })
    }

    fn now(&self) -> Time {
        self.robot.now()
    }

    fn is_lock_step(&self) -> bool {
        self.robot.is_lock_step()
    }

    fn works(&self) -> Result<(), ThreadFault> {
        self.robot.works()
    }
}
