//! The robot for the loop of a world: the client's session in the virtual time of the world. Time passes while the loop
//! waits for a report.

use super::inside::{Inside, Shared};
use super::sabotage::Sabotage;
use panelprep::daemon::{Port, RobotAnswer, RobotCommand};
use panelprep::eki::{Command, LinkLoss, Report, Time};
use std::mem::discriminant;

/// Maximum time that the loop waits for a report before it does other work, ms.
const POLL_TIMEOUT_MS: u64 = 20;
/// Maximum number of reports at one time; more reports mean that the loop does not let time pass.
const MAX_SIMULTANEOUS_REPORTS: u32 = 10_000;

/// The robot's port.
pub struct Robot {
    world: Shared,
    /// The reported loss of the connection, until a controller answers, as in the product's own thread.
    told_loss: Option<LinkLoss>,
    /// Speed of the next paths, m/s.
    speed_m_s: f64,
    /// Time of the last report, and number of reports at this time.
    told: (u64, u32),
}

impl Robot {
    /// Returns the robot of this world.
    pub fn new(world: Shared) -> Self {
        Robot { world, told_loss: None, speed_m_s: 0.1, told: (0, 0) }
    }

    fn judge_time(&mut self) {
        let mut world = self.world.lock();
        let (now_ms, (told_ms, count)) = (world.now_ms(), self.told);
        self.told = (now_ms, if told_ms == now_ms { count + 1 } else { 0 });
        if self.told.1 == MAX_SIMULTANEOUS_REPORTS {
            world.wrong("time continues", format!("{MAX_SIMULTANEOUS_REPORTS} reports in one moment"));
        }
    }

    fn next(&mut self) -> Option<Report> {
        let mut world = self.world.lock();
        let end_ms = world.now_ms() + POLL_TIMEOUT_MS;
        loop {
            while let Some(mut report) = world.cell.next_report() {
                if world.sabotage == Some(Sabotage::HidesJogs) {
                    hides_jog(&world, &mut report);
                }
                match &report {
                    Report::LinkLost { why } => {
                        let is_told = self.told_loss.as_ref().map(discriminant) == Some(discriminant(why));
                        if is_told {
                            continue;
                        }
                        self.told_loss = Some(why.clone());
                    }
                    Report::Connected { .. } => self.told_loss = None,
                    _ => {}
                }
                return Some(report);
            }
            if world.now_ms() >= end_ms {
                return None;
            }
            world.step(end_ms);
        }
    }
}

/// Changes a report so that it contains the axis positions before a person jogged the arm.
fn hides_jog(world: &Inside, report: &mut Report) {
    if let Report::Connected { state } | Report::Rebooted { state } | Report::State(state) = report
        && let Some(before) = world.places.joints_before_jog(&world.cell.controller.joints())
    {
        state.joints = before;
    }
}

impl Port<RobotCommand> for Robot {
    fn perform(&mut self, command: RobotCommand) -> RobotAnswer {
        if matches!(command, RobotCommand::Next) {
            let report = self.next();
            self.judge_time();
            return RobotAnswer::Report(Ok(report));
        }
        let mut world = self.world.lock();
        let command = match world.sabotage {
            Some(sabotage) => sabotage.command(command),
            None => Some(command),
        };
        let Some(command) = command else { return RobotAnswer::Done(Ok(())) };
        let now = Time::from_ms(world.now_ms());
        match command {
            RobotCommand::Send(command) => {
                match &command {
                    Command::SetAccSpeed(speeds) => self.speed_m_s = speeds.speed_m_s,
                    Command::SetBase(base) => world.aims.base = Some(*base),
                    Command::SetTcp(tool) => world.aims.tool = Some(tool.flange_from_tool),
                    _ => {}
                }
                let is_by_axes = matches!(command, Command::MoveJ(_));
                let sets_frame = matches!(command, Command::SetBase(_) | Command::SetTcp(_));
                let queued = world.cell.session.queue(command);
                if let (true, Ok(id), Some(epoch)) = (sets_frame, &queued, world.open_epoch()) {
                    world.truth.sets_frame(epoch, *id);
                }
                if let (true, Ok(id), Some(epoch)) = (is_by_axes, &queued, world.open_epoch()) {
                    world.places.by_axes(epoch, *id);
                }
                RobotAnswer::Queued(queued)
            }
            RobotCommand::Path { points, permitted } => {
                let queued = match permitted {
                    None => world.cell.session.queue_path(&points),
                    Some(permitted) => world.cell.session.queue_path_within(&points, permitted),
                };
                if let Ok(last) = &queued {
                    world.queued(&points, *last, self.speed_m_s);
                }
                RobotAnswer::Queued(queued)
            }
            RobotCommand::Permit(last) => RobotAnswer::Done(world.cell.session.permit_commands(last)),
            RobotCommand::OpenEpoch(above) => RobotAnswer::Epoch(world.cell.session.open_epoch_above(above)),
            RobotCommand::Abort => RobotAnswer::Done(world.cell.session.abort()),
            RobotCommand::Next | RobotCommand::Now => RobotAnswer::Time(now),
        }
    }
}
