//! Motions: each path is checked as a whole. The path is then sent, and monitored until the robot is stationary at its
//! end.

use super::error::DaemonError;
use super::ports::RobotPort;
use super::running::{Condition, LoopMemory, PathEndPose, PendingAction, SentPath, seconds};
use crate::setup::{CycleSetup, proof_gate};
use panelprep_base::geometry::{Base, Flange, Joints, Panel, Rigid, Tool};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Action, Answer, Event, Id, Motion, Path, Report, Trouble};
use panelprep_cell::record::{Finding, Kind};
use panelprep_kuka::eki::{Command, CommandId, MoveJ, MoveLin, QueueError, SetAccSpeed, Signal, State, Time};
use panelprep_toolpath::path::reach::{Infeasibility, Obstacles};
use panelprep_toolpath::path::routes::{GatedPath, LinearMotion, PathSpeed, StartState};
use panelprep_toolpath::path::trace::Trace;
use panelprep_toolpath::path::{Kinematics, PanelPoses, judge_joints, reach, routes, taught_axis};
use std::sync::Arc;

/// Maximum deviation of the TCP from the commanded pose, mm and degrees.
const MAX_DEVIATION_MM: f64 = 1.0;
const MAX_DEVIATION_DEG: f64 = 0.5;
/// Maximum deviation of each axis from a commanded named pose, degrees: ten times the resolution that a controller
/// reports. `single_interlocks` uses the same limit, so that both treat the arm as parked in the same cases.
const MAX_AXIS_DEVIATION_DEG: f64 = 0.1;

/// Speed and acceleration of the axes between named poses, % of their maximum.
const AXIS_SPEED_PERCENT: u8 = 20;

/// The place at which a motion of the axes begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AxisMotionStart {
    /// Any place: the configured distances from obstacles are required.
    Anywhere,
    /// The end of a checked path, which may be nearer to the panel.
    PathEnd,
}

impl LoopMemory<'_> {
    pub(super) fn begin_move(&mut self, id: Id, motion: Motion) -> Result<(), DaemonError> {
        // A motion that is refused before it is sent has executed no waypoint; the count of the previous path is reset.
        (self.sent_path, self.executed_at_stop) = (None, 0);
        let on_foam = self.cycle_setup().is_some_and(|setup| setup.on_foam);
        let needed = proof_gate::stage_of_motion(motion.path, on_foam);
        if let Some(why) = self.cell.proofs.refusal(needed, self.robot_state.as_ref()) {
            self.record_problem(Kind::Gate, vec![why])?;
            self.answer_action(id, Answer::Failed(Trouble::Gate));
            return Ok(());
        }
        if !self.tool_permits_motion(id, motion.path)? {
            return Ok(());
        }
        // Each zero alone is a valid value; only a pose of all zeros indicates that the robot program was not started.
        if self.robot_state.is_some_and(|state| state.tip_is_unknown()) {
            let message = "the controller reports a pose of all zeros, so the arm's pose is not known; start the \
                           robot program";
            self.record_problem(Kind::Gate, vec![Reason::new("no_route", message)])?;
            self.answer_action(id, Answer::Failed(Trouble::Gate));
            return Ok(());
        }
        if self.begin_warning(id, motion)? {
            return Ok(());
        }
        // The park pose is reached by a motion of the axes, which must be possible from any pose, even if no straight
        // line inside the box leads there.
        if motion.path == Path::Park {
            let poses: Vec<Joints> = self.cell.ready_pose.into_iter().chain([self.cell.park_pose]).collect();
            return self.move_by_axes(id, motion, &poses);
        }
        // If the TCP is outside the box, a linear motion goes through the ready pose.
        let tip: Option<Rigid<Base, Tool>> = self.robot_state.map(|state| state.base_from_tcp.to_rigid());
        if let (Path::Corner { .. }, Some(ready), Some(tip)) = (motion.path, self.cell.ready_pose, tip)
            && self.cell.limits.workspace().is_some_and(|workspace| !workspace.contains(tip.origin()))
        {
            let obstacles = self.cycle.clone().map(|cycle| self.obstacles_at_rest(&cycle));
            let refusals = self.axis_motion_refusals(&[ready], AxisMotionStart::Anywhere, obstacles);
            if !self.is_permitted(refusals)? {
                self.answer_action(id, Answer::Failed(Trouble::Gate));
                return Ok(());
            }
            let sent = self.ports.robot.send(move_j(ready));
            self.axes_at_path_end = None;
            return self.wait_or_fail(id, Action::Move(motion), sent.map(Condition::Ready));
        }
        self.move_by_lines(id, motion)
    }

    /// Begins the warning before this motion, if one is required: the warning output is switched on some time before
    /// the first motion after a rest. Returns whether a warning is required.
    fn begin_warning(&mut self, id: Id, motion: Motion) -> Result<bool, DaemonError> {
        let Some((number, _)) = self.cell.warning_output.filter(|_| !self.has_warned) else { return Ok(false) };
        let sent = self.ports.robot.send(Command::SetDigout(Signal { number, on: true }));
        self.wait_or_fail(id, Action::Move(motion), sent.map(|last| Condition::Warned { last, until: None }))?;
        Ok(true)
    }

    /// Continues the warning. Its time begins with the first state that reports the output as on; after this time, the
    /// motion begins.
    pub(super) fn warning(
        &mut self,
        (id, motion): (Id, Motion),
        (last, until): (CommandId, Option<Time>),
        state: &State,
    ) -> Result<(), DaemonError> {
        let Some((number, bit)) = self.cell.warning_output else { return self.begin_move(id, motion) };
        let now = self.ports.robot.now();
        let is_on = state.done >= last && state.outputs >> bit & 1 == 1;
        if until.is_none_or(|until| now < until) {
            // If the time began with the command, it could be over before the horn sounds.
            let until = until.or_else(|| is_on.then(|| now + seconds(self.cell.limits.warning_s())));
            self.wait(id, Action::Move(motion), Condition::Warned { last, until });
            return Ok(());
        }
        self.has_warned = true;
        match self.ports.robot.send(Command::SetDigout(Signal { number, on: false })) {
            Ok(_) => self.begin_move(id, motion),
            failed => self.wait_or_fail(id, Action::Move(motion), failed.map(Condition::Ready)),
        }
    }

    /// Returns the reasons why the axes cannot move from their present position through these poses without a collision
    /// with an obstacle; empty if they can.
    fn axis_motion_refusals(
        &self,
        poses: &[Joints],
        start: AxisMotionStart,
        obstacles: Option<Arc<Obstacles>>,
    ) -> Vec<Reason> {
        let Some(state) = self.robot_state else {
            return vec![Reason::new(
                "no_route",
                "the arm's pose is not known; check the connection to the controller",
            )];
        };
        let reasons: Vec<Reason> = poses.iter().flat_map(|pose| judge_joints(pose).reasons).collect();
        if !reasons.is_empty() {
            return reasons;
        }
        let met = self.first_infeasibility(&state, poses, start, obstacles);
        let reason = |met| Reason::new("out_of_reach", format!("the motion to the target is not possible: {met}"));
        met.map(reason).into_iter().collect()
    }

    /// Records the refusals of a motion; returns whether there are none.
    fn is_permitted(&mut self, refusals: Vec<Reason>) -> Result<bool, DaemonError> {
        let is_permitted = refusals.is_empty();
        if !is_permitted {
            self.record_problem(Kind::Gate, refusals)?;
        }
        Ok(is_permitted)
    }

    /// Returns the first reason why the axes cannot move from the reported positions through these poses.
    fn first_infeasibility(
        &self,
        state: &State,
        poses: &[Joints],
        start: AxisMotionStart,
        obstacles: Option<Arc<Obstacles>>,
    ) -> Option<Infeasibility> {
        let arm = Kinematics::new(&self.cell.arm);
        let arm = match obstacles {
            Some(obstacles) => arm.with_obstacles(obstacles),
            None => arm,
        };
        self.mounted_tools(state).into_iter().find_map(|flange_from_tip| {
            let departing = match start {
                AxisMotionStart::PathEnd => reach::arm_for_departure(&arm, &state.joints, flange_from_tip),
                AxisMotionStart::Anywhere => Some(arm.clone()),
            };
            let Some(departing) = departing else { return Some(Infeasibility::NotFinite) };
            let ways = std::iter::once((&departing, &state.joints)).chain(poses.iter().map(|pose| (&arm, pose)));
            ways.zip(poses).find_map(|((arm, from), to)| reach::joint_motion(arm, flange_from_tip, from, to).err())
        })
    }

    /// Returns the points on the flange whose distances from obstacles are checked: those of the sander and the camera
    /// of the cell. The active tool is not used, because after a start any tool may be active in the controller.
    /// Without a cycle only the active tool is known.
    fn mounted_tools(&self, state: &State) -> Vec<Rigid<Flange, Tool>> {
        let Some(cycle) = &self.cycle else { return vec![state.flange_from_tool.to_rigid()] };
        let camera = Rigid::from_isometry_unchecked(*cycle.calibrations.flange_from_camera.isometry());
        cycle.sander().tips().into_iter().chain([camera]).collect()
    }

    fn move_by_axes(&mut self, id: Id, motion: Motion, poses: &[Joints]) -> Result<(), DaemonError> {
        if !self.park_motion_is_permitted(poses)? {
            self.answer_action(id, Answer::Failed(Trouble::Gate));
            return Ok(());
        }
        let mut sent = Ok(CommandId(0));
        for pose in poses {
            // All poses were checked before the first one is sent, because the arm would not wait if a later pose were
            // refused.
            sent = sent.and_then(|_| self.ports.robot.send(move_j(*pose)));
        }
        let end = poses.last().copied().map(PathEndPose::Joints);
        self.start_motion(id, motion, sent, (1, end))
    }

    /// Checks the motion to the park pose, with the panel as an obstacle. At the end of a path of this program the tool
    /// may be as near to the panel as [`reach::departing`] permits. After a stop, an abort or a start of the program,
    /// the arm may be anywhere, and the tool may touch the panel. In this case the axes move only if the whole motion
    /// keeps the configured distances; otherwise a person must move the arm away.
    fn park_motion_is_permitted(&mut self, poses: &[Joints]) -> Result<bool, DaemonError> {
        let state = self.robot_state;
        // A person may have jogged the arm after the end of the path; the axis positions show whether the arm is still
        // at this end.
        let is_there = |pose: &Joints| {
            state.is_some_and(|state| state.joints.max_difference_deg(pose) <= MAX_AXIS_DEVIATION_DEG)
        };
        let is_at_path_end = self.axes_at_path_end.iter().any(is_there) && !poses.iter().any(is_there);
        let is_known = self.axes_at_path_end.iter().chain(poses).any(is_there);
        let cycle = self.cycle.clone();
        if state.is_none() || (cycle.is_none() && !is_known) {
            let message = "the arm's pose or the panel's position is not known; move the arm to the park pose \
                           with `panelprep robot move-j park` while a person watches the motion";
            return self.is_permitted(vec![Reason::new("unknown_place", message)]);
        }
        // Before the first cycle, no path of this program has led to a panel.
        let obstacles = cycle.map(|cycle| self.obstacles_at_rest(&cycle));
        let start = if is_at_path_end { AxisMotionStart::PathEnd } else { AxisMotionStart::Anywhere };
        let refusals = self.axis_motion_refusals(poses, start, obstacles);
        let of_an_unknown_place = |refusal: Reason| {
            let message = format!(
                "the arm is not at a pose of this program's last path, and {}. Jog the tool off the panel in T1, or \
                 move the arm with `panelprep robot move-j park` and watch the motion",
                refusal.message
            );
            Reason::new("unknown_place", message)
        };
        self.is_permitted(match is_known {
            true => refusals,
            false => refusals.into_iter().map(of_an_unknown_place).collect(),
        })
    }

    /// Returns the obstacles from the last scan; without a scan in this cycle, the panel at its last known pose.
    fn obstacles_at_rest(&self, cycle: &CycleSetup) -> Arc<Obstacles> {
        self.perception.obstacles().cloned().unwrap_or_else(|| self.last_known_panel(cycle))
    }

    /// Returns the panel at the displacement that the last localized cycle found; if there is none, at its nominal
    /// pose.
    fn last_known_panel(&self, cycle: &CycleSetup) -> Arc<Obstacles> {
        let moved: Rigid<Base, Base> =
            self.last_panel_motion.map_or_else(Rigid::identity, |motion| motion.to_rigid());
        let base_from_panel = moved * cycle.panel.nominal_pose;
        Arc::new(
            Obstacles::default()
                .with_points_of("panel", cycle.panel.points().map(|(_, point)| base_from_panel * point)),
        )
    }

    /// Chooses the route of a motion. For the first view of a corner, this is the route to the first taught corner
    /// whose route passes the path checks. For the next view, it is the first such route to one of the other corners;
    /// if there is none, the chosen corners are viewed again in turn. Verify uses only the corners by which the pose
    /// was corrected.
    fn choose_route(&mut self, motion: Motion) -> Option<GatedPath> {
        let Path::Corner { view } = motion.path else { return self.gate_current_path(motion) };
        self.perception.corners.begin_selection(view);
        let candidates = self.perception.corners.candidates(view, self.cycle_setup()?);
        for &corner in &candidates {
            self.perception.corners.choose(view, corner);
            let gated = self.gate_current_path(motion)?;
            if gated.is_sendable() {
                return Some(gated);
            }
            let why = gated
                .judgement()
                .reasons
                .iter()
                .map(|reason| reason.message.as_str())
                .collect::<Vec<_>>()
                .join("; ");
            tracing::warn!("the arm cannot move to the view of corner {}: {why}", corner + 1);
            self.perception.corners.exclude_corner(corner, &why);
        }
        match candidates.first() {
            // No route passes the path checks: the first corner is chosen, so that the reason is reported.
            Some(&first) if view == 0 => self.perception.corners.choose(view, first),
            Some(_) => self.perception.corners.end_selection(view),
            None => {}
        }
        self.perception.corners.advance_to_view(view);
        self.gate_current_path(motion)
    }

    pub(super) fn move_by_lines(&mut self, id: Id, motion: Motion) -> Result<(), DaemonError> {
        let Some(gated) = self.choose_route(motion) else {
            self.record_problem(
                Kind::Gate,
                vec![Reason::new(
                    "no_route",
                    "the path cannot be checked, because the panel's pose, the plan or the \
                                              arm's pose is not known; check the connection to the controller and \
                                              locate the panel again",
                )],
            )?;
            self.answer_action(id, Answer::Failed(Trouble::Gate));
            return Ok(());
        };
        if !gated.is_sendable() {
            let finding = Finding::new(Kind::Gate, self.state.job.pass, gated.judgement());
            self.record(finding.with_checks(gated.violations))?;
            self.answer_action(id, Answer::Failed(Trouble::Gate));
            return Ok(());
        }
        let count = u32::try_from(gated.points.len()).unwrap_or(u32::MAX);
        let sent = self.ports.robot.send(Command::SetAccSpeed(speed_command(gated.speed)));
        // Only contact paths need permissions. Each permission is recorded before it is sent, so that after a crash no
        // more is sanded than the record states.
        let permitted =
            Some(self.path_progress.permitted).filter(|few| motion.path == Path::Contact && *few < count);
        let sent = sent.and_then(|_| self.ports.robot.send_path(move_lin(&gated.points), permitted));
        self.start_motion(id, motion, sent, (count, gated.end_pose.map(PathEndPose::Tip)))
    }

    /// Returns the path as it is sent, with the result of the path checks; `None` if its start or its end is not known.
    fn gate_current_path(&self, motion: Motion) -> Option<GatedPath> {
        let (cycle, state) = (self.cycle_setup()?, self.robot_state?);
        let place = self.perception.panel_pose();
        let poses = place.map(|now| PanelPoses { now, nominal: cycle.panel.nominal_pose });
        let pad: Rigid<Panel, Tool> = state.base_from_tcp.to_rigid();
        // The panel is an obstacle for a motion to a camera view, but not for a path that leads to the panel's surface.
        let obstacles = matches!(motion.path, Path::Corner { .. }).then(|| self.obstacles_at_rest(cycle));
        let standing = &StartState {
            limits: &cycle.cell.limits,
            arm: &cycle.cell.arm,
            flange_from_tool: state.flange_from_tool.to_rigid(),
            joints: state.joints,
            obstacles: obstacles.as_ref(),
        };
        let settings = cycle.recipe.path();
        match motion.path {
            Path::Park => None,
            Path::Corner { .. } => {
                let from: Rigid<Base, Tool> = state.base_from_tcp.to_rigid();
                // For this motion the camera is the tool.
                let to = Rigid::from_isometry_unchecked(*self.perception.corner_pose(cycle)?.isometry());
                Some(routes::gate_view(standing, (from, to), cycle.sander()))
            }
            Path::Approach => {
                let to = routes::waypoints(self.abrasion.latest_plan()?).first()?.as_sent();
                Some(routes::gate_air_motion(standing, place?, (pad, to), None))
            }
            Path::Contact => {
                Some(routes::gate_contact_path(standing, poses?, (pad, self.abrasion.plan(motion.plan)?), settings))
            }
            Path::Air => {
                let lifted = routes::lift_contact_points(self.abrasion.plan(motion.plan)?, settings.approach_mm());
                Some(routes::gate_contact_path(standing, poses?, (pad, &lifted), settings))
            }
            Path::Retract => {
                let back = nalgebra::Vector3::z() * -settings.approach_mm();
                // The path begins at the reported pose and not at the planned end: after a stop the pad may be anywhere
                // on the path.
                let to = pad
                    * Rigid::<Tool, Tool>::identity()
                        .followed_by_displacement(panelprep_base::geometry::Vector::new(back));
                let plan = self.abrasion.latest_plan();
                let axis = plan.and_then(|plan| taught_axis(plan, cycle.panel.nominal_pose));
                Some(routes::gate_air_motion(standing, place?, (pad, to), axis))
            }
        }
    }

    fn start_motion(
        &mut self,
        id: Id,
        motion: Motion,
        sent: Result<CommandId, QueueError>,
        (count, end): (u32, Option<PathEndPose>),
    ) -> Result<(), DaemonError> {
        self.axes_at_path_end = None;
        if let (Ok(last), Some(end)) = (&sent, end) {
            self.trace = Trace::default();
            let first = CommandId((last.0 + 1).saturating_sub(count));
            self.sent_path = Some(SentPath { id, motion, first, last: *last, end, reported: 0 });
            self.begin_pressing(motion);
        }
        self.wait_or_fail(id, Action::Move(motion), sent.map(|_| Condition::PathEnd))
    }

    /// Handles the robot's report that all commands up to `done` are executed.
    pub(super) fn on_executed(&mut self, done: CommandId) -> Result<(), DaemonError> {
        let Some(sent) = &mut self.sent_path else { return Ok(()) };
        let waypoints = sent.waypoints(done);
        if waypoints > sent.reported && self.pending_action.as_ref().is_some_and(|pending| pending.id == sent.id) {
            sent.reported = waypoints;
            self.events.push_back(Event::Reported(Report::Progress { id: sent.id, done: waypoints }));
            let sent = *sent;
            self.permit_more(sent, waypoints)?;
        }
        Ok(())
    }

    /// Handles the end of an epoch with the robot stationary; the commands of the epoch up to `done` were executed.
    pub(super) fn on_standstill(&mut self, done: CommandId) {
        if let Some(sent) = self.sent_path.take() {
            self.executed_at_stop = sent.waypoints(done).max(sent.reported);
        }
        let waypoints = self.executed_at_stop;
        if let Some(PendingAction { waits: Condition::EpochEnd { done }, .. }) = &mut self.pending_action {
            *done = Some(waypoints);
        }
    }

    pub(super) fn end_path(&mut self, id: Id, act: Action, state: &State) -> Result<(), DaemonError> {
        let Some(sent) = self.sent_path.filter(|sent| sent.id == id && state.done >= sent.last) else {
            self.wait(id, act, Condition::PathEnd);
            return Ok(());
        };
        self.on_executed(state.done)?;
        let off = self.deviation(sent, state);
        if off.is_empty() {
            self.axes_at_path_end = Some(state.joints);
            self.answer_action(id, Answer::Standstill { done: sent.motion.waypoints });
        } else {
            self.record_problem(Kind::Robot, off)?;
            self.answer_action(id, Answer::Failed(Trouble::Deviation));
        }
        Ok(())
    }

    /// Returns the reasons why the arm is not at its commanded end pose; empty if it is.
    fn deviation(&self, sent: SentPath, state: &State) -> Vec<Reason> {
        let (off_mm, off_deg, allowed_deg) = match sent.end {
            PathEndPose::Joints(end) => (0.0, state.joints.max_difference_deg(&end), MAX_AXIS_DEVIATION_DEG),
            PathEndPose::Tip(end) => {
                let camera = matches!(sent.motion.path, Path::Corner { .. });
                let base = if camera { Some(Rigid::identity()) } else { self.perception.panel_pose().map(as_base) };
                let Some(base_from_active) = base else {
                    let message = "the arm's deviation from its path cannot be checked, because the panel's pose is \
                                   not known; locate the panel again";
                    return vec![Reason::new("deviation", message)];
                };
                let tip = base_from_active * state.base_from_tcp.to_rigid::<Base, Tool>();
                (
                    tip.origin().distance_mm(end.origin()),
                    (tip.inverse() * end).rotation_angle().0,
                    MAX_DEVIATION_DEG,
                )
            }
        };
        let message = || {
            let [deg, allowed] = distinguishable_texts(off_deg, allowed_deg, 3);
            if let PathEndPose::Joints(_) = sent.end {
                return format!("an axis is {deg}° from its commanded angle (limit {allowed}°)");
            }
            let [mm, allowed_mm] = distinguishable_texts(off_mm, MAX_DEVIATION_MM, 3);
            format!("the arm is {mm} mm and {deg}° from its commanded pose (limits {allowed_mm} mm and {allowed}°)")
        };
        let far = !(off_mm <= MAX_DEVIATION_MM && off_deg <= allowed_deg);
        if far { vec![Reason::new("deviation", message())] } else { vec![] }
    }
}

/// Converts the panel's pose to the type of a base pose: the panel's frame was set as the base, and the TCP is reported
/// in this frame.
fn as_base(place: Rigid<Base, Panel>) -> Rigid<Base, Base> {
    Rigid::from_isometry_unchecked(*place.isometry())
}

fn move_j(joints: Joints) -> Command {
    Command::MoveJ(MoveJ { joints, axis_speed_percent: f64::from(AXIS_SPEED_PERCENT) })
}

/// Converts the motions of a path to commands.
pub(super) fn move_lin(motions: &[LinearMotion]) -> Vec<MoveLin> {
    let command = |motion: &LinearMotion| {
        let LinearMotion { pose, blend_mm, contact, speed_m_s } = *motion;
        MoveLin { pose, blend_mm, contact, speed_m_s }
    };
    motions.iter().map(command).collect()
}

/// Converts the speeds of a path to a command.
pub(super) fn speed_command(PathSpeed { speed_m_s, acceleration_m_s2 }: PathSpeed) -> SetAccSpeed {
    let (axis_speed_percent, axis_acceleration_percent) = (AXIS_SPEED_PERCENT, AXIS_SPEED_PERCENT);
    SetAccSpeed { speed_m_s, acceleration_m_s2, axis_speed_percent, axis_acceleration_percent }
}
