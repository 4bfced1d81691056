//! A robot port that works with true poses: it corrects commands and reports by the measured errors of the arm.
//!
//! The controller computes with the nominal geometry of its arm. If the cell's file names a correction, every pose on
//! this side of the port is the true pose of the arm. The connection to the controller and its recording contain the
//! controller's own values. Without a correction all values pass unchanged, bit for bit. Axis angles are the same on
//! both sides.

use super::ports::{Port, RobotAnswer, RobotCommand, RobotPort};
use panelprep_base::geometry::{Base, Flange, Joints, KukaPose, Panel, Rigid, Tool};
use panelprep_cell::cell;
use panelprep_kuka::eki::{Command, CommandId, MoveLin, QueueError, Report, State};
use panelprep_toolpath::path::Kinematics;

/// A robot port that corrects poses by the measured errors of the robot's arm.
pub(super) struct CalibratedRobot<'r> {
    robot: &'r mut dyn RobotPort,
    /// The kinematics of the arm; `None` if it has no correction.
    arm: Option<Kinematics>,
    base: Rigid<Base, Panel>,
    flange_from_tool: Rigid<Flange, Tool>,
    /// The present axis positions, and below them the axis positions after the last sent command.
    joints: Option<Joints>,
    ahead: Option<(CommandId, Joints)>,
    reported_tcp: Option<KukaPose>,
}

impl<'r> CalibratedRobot<'r> {
    /// Creates the port with the correction of this arm.
    pub fn new(robot: &'r mut dyn RobotPort, arm: &cell::Arm) -> Self {
        CalibratedRobot {
            robot,
            arm: arm.correction().map(|_| Kinematics::new(arm)),
            base: Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity()),
            flange_from_tool: Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity()),
            joints: None,
            ahead: None,
            reported_tcp: None,
        }
    }

    /// Returns the TCP pose in the active base as last reported by the controller; `None` for an arm without a
    /// correction.
    pub fn reported_tcp(&self) -> Option<KukaPose> {
        self.reported_tcp
    }

    /// Sets the axis positions before the first report.
    pub fn set_initial_axes(&mut self, joints: Joints) {
        self.joints = Some(joints);
    }

    /// Returns the corrected points for the controller, and the axis positions at the last point.
    fn correct_path(&self, points: Vec<MoveLin>) -> Result<(Vec<MoveLin>, Option<Joints>), QueueError> {
        let Some(arm) = &self.arm else { return Ok((points, None)) };
        // The correction depends on the arm's posture, and several paths may wait in the queue. Therefore it starts
        // from the axis positions after the last sent command, not from the reported positions.
        let stands = self.ahead.map(|(_, joints)| joints).or(self.joints);
        let mut at = stands.ok_or(QueueError::Uncorrected { point: 1 })?;
        let mut sent = Vec::with_capacity(points.len());
        for (index, point) in points.into_iter().enumerate() {
            let wanted = self.base * point.pose.to_rigid::<Panel, Tool>() * self.flange_from_tool.inverse();
            // If one point cannot be corrected, the whole path is refused; otherwise the disc would be at a wrong place
            // at this point.
            let (flange, joints) =
                arm.sent_flange(&wanted, &at).ok_or(QueueError::Uncorrected { point: index + 1 })?;
            at = joints;
            let pose = KukaPose::from_rigid(&(self.base.inverse() * flange * self.flange_from_tool));
            sent.push(MoveLin { pose, ..point });
        }
        Ok((sent, Some(at)))
    }

    /// Sends a path, or one linear motion, with corrected poses for the controller.
    fn path(&mut self, points: Vec<MoveLin>, send: impl FnOnce(Vec<MoveLin>) -> RobotCommand) -> RobotAnswer {
        let (points, end) = match self.correct_path(points) {
            Ok(sent) => sent,
            Err(error) => return RobotAnswer::Queued(Err(error)),
        };
        let answer = self.robot.perform(send(points));
        if let RobotAnswer::Queued(Ok(last)) = answer {
            self.ahead = end.map(|joints| (last, joints)).or(self.ahead);
        }
        answer
    }

    fn correct_state(&mut self, mut state: State) -> State {
        let Some(arm) = &self.arm else { return state };
        self.reported_tcp = Some(state.base_from_tcp);
        state.base_from_tcp = tip(arm, &state);
        self.joints = Some(state.joints);
        self.ahead.take_if(|(last, _)| state.done >= *last && !state.moving);
        state
    }
}

/// Returns the true TCP pose in the active base.
fn tip(arm: &Kinematics, state: &State) -> KukaPose {
    let (base, tool) =
        (state.active_base.to_rigid::<Base, Base>(), state.flange_from_tool.to_rigid::<Flange, Tool>());
    let reported = base * state.base_from_tcp.to_rigid::<Base, Tool>() * tool.inverse();
    KukaPose::from_rigid(&(base.inverse() * arm.true_flange(reported, &state.joints) * tool))
}

impl Port<RobotCommand> for CalibratedRobot<'_> {
    fn perform(&mut self, command: RobotCommand) -> RobotAnswer {
        match command {
            _ if self.arm.is_none() => self.robot.perform(command),
            RobotCommand::Send(Command::MoveLin(point)) => self.path(vec![point], |points| match points[..] {
                [point] => RobotCommand::Send(Command::MoveLin(point)),
                _ => RobotCommand::Path { points, permitted: None },
            }),
            RobotCommand::Path { points, permitted } => {
                self.path(points, |points| RobotCommand::Path { points, permitted })
            }
            RobotCommand::Send(sent) => {
                let answer = self.robot.perform(command);
                match (sent, &answer) {
                    (Command::SetBase(base), _) => self.base = base.to_rigid(),
                    (Command::SetTcp(tool), _) => self.flange_from_tool = tool.flange_from_tool.to_rigid(),
                    (Command::MoveJ(to), RobotAnswer::Queued(Ok(id))) => self.ahead = Some((*id, to.joints)),
                    _ => {}
                }
                answer
            }
            RobotCommand::OpenEpoch(_) | RobotCommand::Abort => {
                self.ahead = None;
                self.robot.perform(command)
            }
            RobotCommand::Next => RobotAnswer::Report(self.robot.next().map(|report| {
                Some(match report? {
                    Report::Connected { state } => {
                        Report::Connected { state: Box::new(self.correct_state(*state)) }
                    }
                    Report::State(state) => Report::State(Box::new(self.correct_state(*state))),
                    Report::Rebooted { state } => Report::Rebooted { state: Box::new(self.correct_state(*state)) },
                    other => other,
                })
            })),
            RobotCommand::Permit(_) | RobotCommand::Now => self.robot.perform(command),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::standing_state;
    use super::*;
    use panelprep_cell::cell::{Cell, CorrectionNumbers};
    use panelprep_kuka::eki::{MoveJ, SetTcp, TcpKind};
    use std::collections::VecDeque;

    /// The data that are sent over the connection to the robot, in both directions.
    #[derive(Default)]
    struct Wire {
        sent: Vec<Command>,
        reports: VecDeque<Report>,
    }

    impl Port<RobotCommand> for Wire {
        fn perform(&mut self, command: RobotCommand) -> RobotAnswer {
            match command {
                RobotCommand::Send(command) => self.sent.push(command),
                RobotCommand::Path { points, .. } => self.sent.extend(points.into_iter().map(Command::MoveLin)),
                RobotCommand::Next => return RobotAnswer::Report(Ok(self.reports.pop_front())),
                other => panic!("{other:?}"),
            }
            RobotAnswer::Queued(Ok(CommandId(self.sent.len() as u32)))
        }
    }

    const HOME: [f64; 6] = [0.0, -90.0, 90.0, 0.0, -30.0, 0.0];

    /// Returns an arm whose axis 1 is 0.001 rad beyond its reported position.
    fn arm_with_rotated_axis() -> cell::Arm {
        let mut errors = [0.0; 32];
        errors[2] = 0.001;
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|problems| panic!("{problems}"));
        cell.with_arm_correction(CorrectionNumbers::Geometry(errors)).arm().clone()
    }

    fn pose(y_mm: f64) -> KukaPose {
        KukaPose { x_mm: 480.0, y_mm, z_mm: 700.0, b_deg: 60.0, ..KukaPose::default() }
    }

    fn point(y_mm: f64) -> MoveLin {
        MoveLin { pose: pose(y_mm), blend_mm: 0.0, contact: false, speed_m_s: None }
    }

    fn lines(wire: &Wire) -> Vec<KukaPose> {
        let line = |command: &Command| match command {
            Command::MoveLin(line) => Some(line.pose),
            _ => None,
        };
        wire.sent.iter().filter_map(line).collect()
    }

    /// Expected values, calculated by hand: the arm is rotated 0.001 rad too far about the Z axis of the base. At x =
    /// 480 mm, the y of the commanded point is therefore 0.48 mm smaller, and its rotation is 0.0573° less. A reported
    /// pose at this point is converted back to the requested pose.
    #[test]
    fn a_line_is_sent_with_the_correction_of_the_arm() {
        let mut wire = Wire::default();
        let standing = eki_state(HOME, KukaPose::default());
        wire.reports.push_back(Report::State(Box::new(standing)));
        let arm = arm_with_rotated_axis();
        let mut robot = CalibratedRobot::new(&mut wire, &arm);
        assert!(robot.next().expect("a link").is_some());
        robot.send(Command::SetBase(KukaPose::default())).expect("sent");
        let tool = SetTcp { flange_from_tool: KukaPose::default(), kind: TcpKind::Other };
        robot.send(Command::SetTcp(tool)).expect("sent");
        robot.send_path(vec![point(0.0), point(50.0)], None).expect("sent");
        let sent = lines(&wire);
        assert!((sent[0].y_mm + 0.48).abs() < 1e-3 && (sent[1].y_mm - 49.52).abs() < 1e-3, "{sent:?}");
        assert!((sent[0].a_deg + 0.057_296).abs() < 1e-4, "{sent:?}");
        // The axis positions at the first point, as the controller computes them from the received command.
        let drawn = Kinematics::new(Cell::check("cell.toml", "").unwrap_or_else(|p| panic!("{p}")).arm());
        let (_, joints) = drawn.sent_flange(&sent[0].to_rigid(), &Joints::from(HOME)).expect("in reach");
        wire.reports.push_back(Report::State(Box::new(eki_state(joints.degrees(), sent[0]))));
        let mut robot = CalibratedRobot::new(&mut wire, &arm);
        let Ok(Some(Report::State(state))) = robot.next() else { panic!("a state") };
        let off = (state.base_from_tcp.to_rigid::<Base, Tool>())
            .origin()
            .distance_mm(pose(0.0).to_rigid::<Base, Tool>().origin());
        assert!(off < 1e-6, "{off} mm");
        assert_eq!(robot.reported_tcp(), Some(sent[0]));
    }

    fn eki_state(joints: [f64; 6], base_from_tcp: KukaPose) -> State {
        State { joints: Joints::from(joints), base_from_tcp, ..standing_state() }
    }

    #[test]
    fn a_line_from_an_unknown_start_is_not_sent() {
        let (mut wire, arm) = (Wire::default(), arm_with_rotated_axis());
        let refused = CalibratedRobot::new(&mut wire, &arm).send_path(vec![point(0.0)], None);
        assert_eq!(refused, Err(QueueError::Uncorrected { point: 1 }));
        let far = MoveLin { pose: KukaPose { x_mm: 2_000.0, ..pose(0.0) }, ..point(0.0) };
        let mut robot = CalibratedRobot::new(&mut wire, &arm);
        robot.send(Command::MoveJ(MoveJ { joints: Joints::from(HOME), axis_speed_percent: 10.0 })).expect("sent");
        assert_eq!(robot.send_path(vec![point(0.0), far], None), Err(QueueError::Uncorrected { point: 2 }));
        assert_eq!(lines(&wire), []);
    }

    #[test]
    fn without_a_correction_all_poses_pass_unchanged() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|problems| panic!("{problems}"));
        let mut wire = Wire::default();
        let told = eki_state(HOME, KukaPose { x_mm: 1.0 / 3.0, ..pose(7.0) });
        wire.reports.push_back(Report::State(Box::new(told)));
        let mut robot = CalibratedRobot::new(&mut wire, cell.arm());
        assert_eq!(robot.next(), Ok(Some(Report::State(Box::new(told)))));
        robot.send_path(vec![point(0.1)], None).expect("sent");
        assert_eq!(lines(&wire), [pose(0.1)]);
    }
}
