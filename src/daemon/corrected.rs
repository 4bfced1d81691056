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

#[cfg(test)]
mod tests {
    use super::super::tests::standing_state;
    use super::*;
    use crate::cell::{Cell, CorrectionNumbers};
    use crate::eki::{MoveJ, SetTcp, TcpKind};
    use std::collections::VecDeque;

    /// What crosses the wire.
    #[derive(Default)]
    struct Wire {
        sent: Vec<Command>,
        reports: VecDeque<Report>,
    }

    impl Robot for Wire {
        fn send(&mut self, command: Command) -> Result<CommandId, QueueError> {
            self.sent.push(command);
            Ok(CommandId(self.sent.len() as u32))
        }

        fn send_path(&mut self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
            self.sent.extend(points.into_iter().map(Command::MoveLin));
            Ok(CommandId(self.sent.len() as u32))
        }

        fn send_path_within(&mut self, points: Vec<MoveLin>, _: u32) -> Result<CommandId, QueueError> {
            self.send_path(points)
        }

        fn permit(&mut self, _: Option<CommandId>) -> Result<(), QueueError> {
            Ok(())
        }

        fn open_epoch(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
            Ok(above)
        }

        fn abort(&mut self) -> Result<(), QueueError> {
            Ok(())
        }

        fn next(&mut self) -> Option<Report> {
            self.reports.pop_front()
        }

        fn now(&self) -> Time {
            Time::at_ms(0)
        }

        fn is_lock_step(&self) -> bool {
            true
        }
    }

    const HOME: [f64; 6] = [0.0, -90.0, 90.0, 0.0, -30.0, 0.0];

    /// An arm whose axis 1 stands 0.001 rad on from where it says.
    fn turned() -> cell::Arm {
        let mut errors = [0.0; 32];
        errors[2] = 0.001;
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|problems| panic!("{problems}"));
        cell.corrected(CorrectionNumbers::Geometry(errors)).arm().clone()
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

    /// By hand: the arm stands 0.001 rad too far about base Z, so at x = 480 mm it is sent 0.48 mm less along y, and turned back
    /// by 0.0573 degrees. A report from there comes back as the place that was wanted.
    #[test]
    fn a_line_is_sent_so_that_the_real_arm_comes_where_it_should() {
        let mut wire = Wire::default();
        let standing = eki_state(HOME, KukaPose::default());
        wire.reports.push_back(Report::State(Box::new(standing)));
        let arm = turned();
        let mut robot = Corrected::new(&mut wire, &arm);
        assert!(robot.next().is_some());
        robot.send(Command::SetBase(KukaPose::default())).expect("sent");
        let tool = SetTcp { flange_from_tool: KukaPose::default(), kind: TcpKind::Other };
        robot.send(Command::SetTcp(tool)).expect("sent");
        robot.send_path(vec![point(0.0), point(50.0)]).expect("sent");
        let sent = lines(&wire);
        assert!((sent[0].y_mm + 0.48).abs() < 1e-3 && (sent[1].y_mm - 49.52).abs() < 1e-3, "{sent:?}");
        assert!((sent[0].a_deg + 0.057_296).abs() < 1e-4, "{sent:?}");
        // The axes at the first place, as the controller computes them for what it was sent.
        let drawn = Kinematics::new(Cell::check("cell.toml", "").unwrap_or_else(|p| panic!("{p}")).arm());
        let (_, joints) = drawn.sent_flange(&sent[0].to_rigid(), &Joints::from(HOME)).expect("in reach");
        wire.reports.push_back(Report::State(Box::new(eki_state(joints.degrees(), sent[0]))));
        let mut robot = Corrected::new(&mut wire, &arm);
        let Some(Report::State(state)) = robot.next() else { panic!("a state") };
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
    fn a_line_from_nobody_knows_where_is_not_sent() {
        let (mut wire, arm) = (Wire::default(), turned());
        let refused = Corrected::new(&mut wire, &arm).send_path(vec![point(0.0)]);
        assert_eq!(refused, Err(QueueError::Uncorrected { point: 1 }));
        let far = MoveLin { pose: KukaPose { x_mm: 2_000.0, ..pose(0.0) }, ..point(0.0) };
        let mut robot = Corrected::new(&mut wire, &arm);
        robot.send(Command::MoveJ(MoveJ { joints: Joints::from(HOME), axis_speed_percent: 10.0 })).expect("sent");
        assert_eq!(robot.send_path(vec![point(0.0), far]), Err(QueueError::Uncorrected { point: 2 }));
        assert_eq!(lines(&wire), []);
    }

    #[test]
    fn an_arm_as_it_is_drawn_is_sent_and_believed_to_the_bit() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|problems| panic!("{problems}"));
        let mut wire = Wire::default();
        let told = eki_state(HOME, KukaPose { x_mm: 1.0 / 3.0, ..pose(7.0) });
        wire.reports.push_back(Report::State(Box::new(told)));
        let mut robot = Corrected::new(&mut wire, cell.arm());
        assert_eq!(robot.next(), Some(Report::State(Box::new(told))));
        robot.send_path(vec![point(0.1)]).expect("sent");
        assert_eq!(lines(&wire), [pose(0.1)]);
    }
}
