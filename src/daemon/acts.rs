//! How an act begins, and what must come from the robot before it is answered.

use super::routes::{self, Gated};
use super::run::Running;
use super::sight::{self, Filming};
use super::wiring::{Setting, reads};
use super::{DaemonError, Finding, RecordError};
use crate::cycle::{Act, Answer, Event, Frames, Id, Motion, Path, Report, Switch, Trouble};
use crate::eki::{Command, CommandId, Epoch, MoveJ, QueueError, SetTcp, State, TcpKind};
use crate::geometry::{Base, Joints, KukaPose, Panel, Rigid, Tool};
use crate::path::judge_joints;
use crate::record::Kind;
use crate::verdict::{Judgement, Reason};

/// How far the arm may stand from where it was sent, mm and degrees.
const DEVIATION_MM: f64 = 1.0;
const DEVIATION_DEG: f64 = 0.5;

/// An act whose answer is still to come.
#[derive(Debug)]
pub(super) struct Pending {
    pub id: Id,
    pub act: Act,
    pub waits: Waits,
}

/// What is waited for.
#[derive(Debug)]
pub(super) enum Waits {
    /// A robot that stands.
    Standing,
    /// The epoch that was asked for.
    Epoch,
    /// The end of the epoch, and the tool proven off; waypoints executed, once it is told.
    EpochEnd { done: Option<u32> },
    /// Base and tool, executed and echoed.
    Frames(CommandId),
    /// An output that is set, and its feedback.
    Feedback { last: CommandId, feedback: Option<(u32, bool)> },
    /// The pose from which a line may begin.
    Ready(CommandId),
    /// The end of a path.
    PathEnd,
    /// The next picture.
    Film(Box<Filming>),
}

/// Where a path ends.
#[derive(Debug, Clone, Copy)]
pub(super) enum End {
    Joints(Joints),
    Tip(Rigid<Base, Tool>),
}

/// The path that was sent last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sent {
    id: Id,
    motion: Motion,
    first: CommandId,
    last: CommandId,
    end: End,
    told: u32,
}

impl Sent {
    /// Waypoints executed, where all commands up to this one are.
    fn waypoints(&self, done: CommandId) -> u32 {
        if self.motion.path == Path::Contact {
            (done.0 + 1).saturating_sub(self.first.0).min(self.motion.waypoints)
        } else {
            u32::from(done >= self.last) * self.motion.waypoints
        }
    }
}

impl Running<'_, '_> {
    /// Begins an act; what needs no waiting is answered at once.
    pub(super) fn begin(&mut self, id: Id, act: Act) -> Result<(), DaemonError> {
        self.pending = None;
        let pass = self.state.job.pass;
        let now = self.ports.robot.now();
        let (job, ports) = (self.job, &mut self.ports);
        let answer = match act {
            Act::Locate => {
                if pass == 0 {
                    (self.sight, self.abrasion) = Default::default();
                }
                self.sight.locate(job, ports.eyes, ports.record)?
            }
            Act::Refine { view } => match self.tip() {
                Some(tip) => self.sight.refine(job, (view, tip), self.ports.eyes, self.ports.record)?,
                None => Answer::Failed(Trouble::Unexpected),
            },
            Act::Verify => match self.tip() {
                Some(tip) => self.sight.verify(job, (pass, tip), self.ports.eyes, self.ports.record)?,
                None => Answer::Failed(Trouble::Unexpected),
            },
            Act::DryPicture => self.sight.dry_picture(now, ports.eyes, ports.record)?,
            Act::Plan { pass } => self.abrasion.make(job, (pass, &self.sight), ports.record)?,
            // Cameras and robot have answered by then or will be missed by the first act that needs them.
            Act::SelfTest => Answer::Done,
            Act::Film => match self.sight.film(job, (pass, now), ports.record)? {
                Ok(filming) => {
                    self.wait(id, act, Waits::Film(Box::new(filming)));
                    return Ok(());
                }
                Err(answer) => answer,
            },
            Act::Stand => {
                self.wait(id, act, Waits::Standing);
                return Ok(());
            }
            Act::OpenEpoch { above } => {
                let opened = self.ports.robot.open_epoch(Epoch(above));
                return self.waits_or_fails(id, act, opened.map(|_| Waits::Epoch));
            }
            Act::EndEpoch { .. } => {
                let asked = self.ports.robot.abort();
                return self.waits_or_fails(id, act, asked.map(|()| Waits::EpochEnd { done: None }));
            }
            Act::SetFrames(frames) => {
                let set = self.set_frames(frames);
                return self.waits_or_fails(id, act, set);
            }
            Act::Switch(switch) => {
                let set = self.switch(switch);
                return self.waits_or_fails(id, act, set);
            }
            Act::Move(motion) => return self.begin_move(id, motion),
        };
        self.answer(id, answer);
        Ok(())
    }

    /// Where the flange camera stands, while it is the tool and the base the robot's own.
    fn tip<Camera: crate::geometry::Frame>(&self) -> Option<Rigid<Base, Camera>> {
        self.robot_state.map(|state| state.base_from_tcp.to_rigid())
    }

    fn wait(&mut self, id: Id, act: Act, waits: Waits) {
        self.pending = Some(Pending { id, act, waits });
    }

    pub(super) fn answer(&mut self, id: Id, answer: Answer) {
        self.pending = None;
        self.events.push_back(Event::Told(Report::Answered { id, answer }));
    }

    fn waits_or_fails(&mut self, id: Id, act: Act, waits: Result<Waits, QueueError>) -> Result<(), DaemonError> {
        match waits {
            Ok(waits) => self.wait(id, act, waits),
            Err(error) => {
                self.note(Kind::Robot, vec![sight::reason("not_sent", &error)])?;
                self.answer(id, Answer::Failed(Trouble::Refused));
            }
        }
        Ok(())
    }

    /// A finding that is not a stage's: what went wrong, in words.
    pub(super) fn note(&mut self, kind: Kind, reasons: Vec<Reason>) -> Result<(), RecordError> {
        let judgement = Judgement::of(reasons, vec![]);
        self.ports.record.finding(&Finding::new(kind, self.state.job.pass, judgement))
    }

    fn set_frames(&mut self, frames: Frames) -> Result<Waits, QueueError> {
        let calibrations = &self.job.calibrations;
        let (base, flange_from_tool, kind) = match frames {
            Frames::Camera => {
                (KukaPose::default(), KukaPose::from_rigid(&calibrations.flange_from_camera), TcpKind::Other)
            }
            Frames::Pad => {
                let place = self.sight.place().ok_or(QueueError::FramesNotSet { missing: "the panel's place" })?;
                let pad = KukaPose::from_rigid(&calibrations.flange_from_tool);
                (KukaPose::from_rigid(&place), pad, TcpKind::Sanding)
            }
        };
        self.ports.robot.send(Command::SetBase(base))?;
        Ok(Waits::Frames(self.ports.robot.send(Command::SetTcp(SetTcp { flange_from_tool, kind }))?))
    }

    fn switch(&mut self, switch: Switch) -> Result<Waits, QueueError> {
        let Setting { signals, feedback } = self.job.wiring.setting(switch);
        let mut last = CommandId(0);
        for signal in signals {
            last = self.ports.robot.send(Command::SetDigout(signal))?;
        }
        Ok(Waits::Feedback { last, feedback })
    }

    fn begin_move(&mut self, id: Id, motion: Motion) -> Result<(), DaemonError> {
        if motion.path == Path::Park {
            let poses: Vec<Joints> = self.job.ready.into_iter().chain([self.job.park]).collect();
            return self.by_axes(id, motion, &poses);
        }
        // From outside of the box a line comes in by way of the ready pose.
        let tip: Option<Rigid<Base, Tool>> = self.tip();
        if let (Path::Corner { .. }, Some(ready), Some(tip)) = (motion.path, self.job.ready, tip)
            && self.job.limits.workspace().is_some_and(|workspace| !workspace.holds(tip.origin()))
        {
            if !self.joints_are_good(&[ready])? {
                {
                    self.answer(id, Answer::Failed(Trouble::Gate));
                    return Ok(());
                }
            }
            let sent = self.ports.robot.send(move_j(ready));
            return self.waits_or_fails(id, Act::Move(motion), sent.map(Waits::Ready));
        }
        self.by_lines(id, motion)
    }

    fn joints_are_good(&mut self, poses: &[Joints]) -> Result<bool, DaemonError> {
        let reasons: Vec<Reason> = poses.iter().flat_map(|pose| judge_joints(pose).reasons).collect();
        let good = reasons.is_empty();
        if !good {
            self.note(Kind::Gate, reasons)?;
        }
        Ok(good)
    }

    fn by_axes(&mut self, id: Id, motion: Motion, poses: &[Joints]) -> Result<(), DaemonError> {
        if !self.joints_are_good(poses)? {
            {
                self.answer(id, Answer::Failed(Trouble::Gate));
                return Ok(());
            }
        }
        let mut sent = Ok(CommandId(0));
        for pose in poses {
            sent = sent.and_then(|_| self.ports.robot.send(move_j(*pose)));
        }
        let end = poses.last().copied().map(End::Joints);
        self.under_way(id, motion, sent, (1, end))
    }

    fn by_lines(&mut self, id: Id, motion: Motion) -> Result<(), DaemonError> {
        let Some(gated) = self.route(motion) else {
            self.note(Kind::Gate, vec![Reason::new("no_route", "place, plan or pose of the arm is not known")])?;
            {
                self.answer(id, Answer::Failed(Trouble::Gate));
                return Ok(());
            }
        };
        if !gated.is_good() {
            self.note(Kind::Gate, gated.judgement.reasons)?;
            {
                self.answer(id, Answer::Failed(Trouble::Gate));
                return Ok(());
            }
        }
        let count = u32::try_from(gated.points.len()).unwrap_or(u32::MAX);
        let sent = self.ports.robot.send(Command::SetAccSpeed(gated.speed));
        let sent = sent.and_then(|_| self.ports.robot.send_path(gated.points));
        self.under_way(id, motion, sent, (count, gated.end.map(End::Tip)))
    }

    /// The path as it is sent; `None` where it is not known where from or where to.
    fn route(&self, motion: Motion) -> Option<Gated> {
        let (job, state) = (self.job, self.robot_state?);
        let place = self.sight.place();
        let pad: Rigid<Panel, Tool> = state.base_from_tcp.to_rigid();
        match motion.path {
            Path::Park => None,
            Path::Corner { .. } => {
                let from: Rigid<Base, Tool> = state.base_from_tcp.to_rigid();
                // The camera is the tool here.
                let to = Rigid::claim(*self.sight.corner_pose(job)?.isometry());
                Some(routes::air(job, Rigid::<Base, Base>::identity(), (from, to), None))
            }
            Path::Approach => {
                let to = routes::waypoints(self.abrasion.latest()?).first()?.pose.to_rigid();
                Some(routes::air(job, place?, (pad, to), None))
            }
            Path::Contact => Some(routes::contact(job, place?, pad, self.abrasion.plan(motion.plan)?)),
            Path::Retract => {
                let back = nalgebra::Vector3::z() * -job.recipe.path().approach_mm();
                let to = pad * Rigid::<Tool, Tool>::identity().displaced(crate::geometry::Vector::new(back));
                let axis = self.abrasion.latest().and_then(routes::taught_axis);
                Some(routes::air(job, place?, (pad, to), axis))
            }
        }
    }

    fn under_way(
        &mut self,
        id: Id,
        motion: Motion,
        sent: Result<CommandId, QueueError>,
        (count, end): (u32, Option<End>),
    ) -> Result<(), DaemonError> {
        if let (Ok(last), Some(end)) = (&sent, end) {
            let first = CommandId((last.0 + 1).saturating_sub(count));
            self.sent = Some(Sent { id, motion, first, last: *last, end, told: 0 });
        }
        self.waits_or_fails(id, Act::Move(motion), sent.map(|_| Waits::PathEnd))
    }

    /// Commands up to this one are executed.
    pub(super) fn executed(&mut self, done: CommandId) {
        let Some(sent) = &mut self.sent else { return };
        let waypoints = sent.waypoints(done);
        if waypoints > sent.told && self.pending.as_ref().is_some_and(|pending| pending.id == sent.id) {
            sent.told = waypoints;
            self.events.push_back(Event::Told(Report::Progress { id: sent.id, done: waypoints }));
        }
    }

    /// The epoch is over and the robot stands; in it these commands were executed.
    pub(super) fn stood_still(&mut self, done: CommandId) {
        let waypoints = self.sent.take().map_or(0, |sent| sent.waypoints(done).max(sent.told));
        if let Some(Pending { waits: Waits::EpochEnd { done }, .. }) = &mut self.pending {
            *done = Some(waypoints);
        }
    }

    /// Whether what is pending has come, as the robot's state says.
    pub(super) fn look(&mut self, state: &State) -> Result<(), DaemonError> {
        let Some(Pending { id, act, waits }) = self.pending.take() else { return Ok(()) };
        let stands = !state.moving;
        match waits {
            Waits::Standing if stands => self.answer(id, Answer::Stands { done: 0 }),
            Waits::EpochEnd { done: Some(done) } if stands && self.job.wiring.tool_is_off(state) => {
                self.answer(id, Answer::Stands { done });
            }
            Waits::Frames(last) if state.done >= last && state.base_set && state.tool_set => {
                self.answer(id, Answer::Done);
            }
            Waits::Feedback { last, feedback }
                if state.done >= last && feedback.is_none_or(|(bit, on)| reads(state, bit) == on) =>
            {
                self.answer(id, Answer::Done);
            }
            Waits::Ready(last) if state.done >= last && stands => {
                if let Act::Move(motion) = act {
                    self.by_lines(id, motion)?;
                }
            }
            Waits::PathEnd if stands => self.path_end(id, act, state)?,
            Waits::Film(filming) => {
                let at = (self.state.job.pass, self.ports.robot.now());
                match self.sight.watch(self.job, *filming, at, self.ports.eyes, self.ports.record)? {
                    Ok(filming) => self.wait(id, act, Waits::Film(Box::new(filming))),
                    Err(answer) => self.answer(id, answer),
                }
            }
            waits => self.wait(id, act, waits),
        }
        Ok(())
    }

    fn path_end(&mut self, id: Id, act: Act, state: &State) -> Result<(), DaemonError> {
        let Some(sent) = self.sent.filter(|sent| sent.id == id && state.done >= sent.last) else {
            {
                self.wait(id, act, Waits::PathEnd);
                return Ok(());
            }
        };
        self.executed(state.done);
        let off = self.deviation(sent, state);
        if off.is_empty() {
            self.answer(id, Answer::Stands { done: sent.motion.waypoints });
        } else {
            self.note(Kind::Robot, off)?;
            self.answer(id, Answer::Failed(Trouble::Deviation));
        }
        Ok(())
    }

    /// How the arm stands elsewhere than it was sent.
    fn deviation(&self, sent: Sent, state: &State) -> Vec<Reason> {
        let (off_mm, off_deg) = match sent.end {
            End::Joints(end) => {
                let pairs = axes(&end).into_iter().zip(axes(&state.joints));
                (0.0, pairs.map(|(wanted, found)| (wanted - found).abs()).fold(0.0, f64::max))
            }
            End::Tip(end) => {
                let camera = matches!(sent.motion.path, Path::Corner { .. });
                let base = if camera { Some(Rigid::identity()) } else { self.sight.place().map(as_base) };
                let Some(base_from_active) = base else { return vec![] };
                let tip = base_from_active * state.base_from_tcp.to_rigid::<Base, Tool>();
                (tip.origin().distance_mm(end.origin()), (tip.inverse() * end).turn().0)
            }
        };
        let message = || {
            format!(
                "the arm stands {off_mm:.3} mm and {off_deg:.3}° from where it was sent, allowed are {DEVIATION_MM} mm \
                 and {DEVIATION_DEG}°"
            )
        };
        let far = !(off_mm <= DEVIATION_MM && off_deg <= DEVIATION_DEG);
        if far { vec![Reason::new("deviation", message())] } else { vec![] }
    }
}

/// The panel's place as the base that was set, in which the tip is told.
fn as_base(place: Rigid<Base, Panel>) -> Rigid<Base, Base> {
    Rigid::claim(*place.isometry())
}

fn move_j(joints: Joints) -> Command {
    Command::MoveJ(MoveJ { joints, axis_speed_percent: f64::from(routes::AXIS_PERCENT) })
}

fn axes(joints: &Joints) -> [f64; 6] {
    [joints.a1_deg, joints.a2_deg, joints.a3_deg, joints.a4_deg, joints.a5_deg, joints.a6_deg]
}
