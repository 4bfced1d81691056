//! A simulated robot that executes a fixed number of its commands every 100 ms.

use super::super::super::*;
use super::{Shared, World, standing_state};
use panelprep_base::geometry::{Base, Flange, KukaPose, Panel, Tool};
use panelprep_cell::cycle::Path;
use panelprep_kuka::eki::{self, Command, CommandId, Epoch, MoveLin, QueueError, Report, Time};

impl World {
    fn queue(&mut self, command: Command) -> Result<CommandId, QueueError> {
        if !self.open || std::mem::take(&mut self.is_overtaken) {
            self.unsent += 1;
            return Err(QueueError::NoEpoch);
        }
        let id = self.next_id;
        self.next_id += 1;
        self.queue.push_back((id, command));
        Ok(CommandId(id))
    }

    fn execute(&mut self, command: Command) {
        let moves = matches!(command, Command::MoveJ(_) | Command::MoveLin(_));
        self.moved_without_intent += usize::from(moves && self.intent.is_none());
        if moves {
            self.first_move_ms.get_or_insert(self.time_ms);
        }
        match command {
            Command::SetBase(base) => {
                self.base = Some(base);
                self.bases.push(base);
            }
            Command::SetTcp(tool) => self.tool = Some(tool),
            Command::SetDigout(signal) => {
                if signal.number == 2 && !signal.on && self.outputs.get(&2) == Some(&true) {
                    self.water_off_ms = self.time_ms;
                    self.healed = self.rubbed > 0;
                }
                self.outputs.insert(signal.number, signal.on);
                if signal.number == 6 {
                    self.warning_ms.push((self.time_ms, signal.on));
                }
            }
            Command::MoveJ(target) => {
                self.joints = target.joints;
                self.base_from_flange = self.arm.base_from_flange(&target.joints);
            }
            Command::MoveLin(MoveLin { pose, contact, speed_m_s, blend_mm }) => {
                let (base, tool) = (self.base.expect("set"), self.tool.expect("set"));
                let base_from_tool = base.to_rigid::<Base, Panel>() * pose.to_rigid::<Panel, Tool>();
                self.base_from_flange = base_from_tool * tool.flange_from_tool.to_rigid::<Flange, Tool>().inverse();
                self.joints = self.arm.nearest(&self.base_from_flange, &self.joints).expect("within reach");
                self.lines += 1;
                if self.intent.is_some_and(|motion| motion.path == Path::Contact) {
                    self.in_contact += 1;
                    self.beyond += u32::from(self.in_contact > self.permitted);
                }
                self.feeds_m_s.extend(speed_m_s);
                self.blends_mm.extend(speed_m_s.map(|_| blend_mm));
                if contact {
                    let truth = self.sim.truth();
                    let tip = base_from_tool.origin();
                    self.contact_off_mm.push(truth.distance_mm(truth.base_from_panel.inverse() * tip));
                }
                self.rubs = contact;
                if self.outputs.get(&5) == Some(&true) {
                    self.waypoints += 1;
                    self.rubbed += usize::from(contact);
                }
            }
            _ => {}
        }
    }

    fn state(&self) -> eki::State {
        let is_on = |output: u16| u32::from(self.outputs.get(&output) == Some(&true));
        let base = self.base.unwrap_or_default();
        let flange_from_tool = self.tool.map_or(KukaPose::default(), |tool| tool.flange_from_tool);
        let tip = base.to_rigid::<Base, Panel>().inverse()
            * (self.base_from_flange * flange_from_tool.to_rigid::<Flange, Tool>());
        let in_contact = self.intent.is_some_and(|motion| motion.path == Path::Contact);
        let off = self.off_plan.filter(|(_, [from, to])| in_contact && (*from..*to).contains(&self.in_contact));
        let off = panelprep_base::geometry::Vector::new(nalgebra::Vector3::x() * off.map_or(0.0, |(mm, _)| mm));
        let tip: panelprep_base::geometry::Rigid<Panel, Tool> =
            tip * panelprep_base::geometry::Rigid::<Tool, Tool>::identity().followed_by_displacement(off);
        eki::State {
            time_ms: self.time_ms as u32,
            epoch: Epoch(self.epoch),
            moving: !self.queue.is_empty() || self.time_ms < self.brakes_until_ms,
            base_set: self.base.is_some(),
            tool_set: self.tool.is_some(),
            inputs: ((1 - is_on(2))
                | is_on(3) << 1
                | is_on(4) << 2
                | is_on(5) << 3
                | is_on(1) << 4
                | u32::from(self.is_local) << 5)
                & !self.dead_feedbacks(),
            outputs: (1..=6).fold(0, |bits, output| bits | is_on(output) << (output - 1)),
            done: CommandId(self.done),
            joints: self.joints,
            base_from_tcp: KukaPose::from_rigid(&tip),
            active_base: base,
            flange_from_tool,
            boot: self.boot,
            ..standing_state()
        }
    }

    /// Returns the bits of `In` that are off, whatever the true states are.
    fn dead_feedbacks(&self) -> u32 {
        self.dead_feedback.filter(|(_, from)| self.in_contact >= *from).map_or(0, |(bit, _)| 1 << bit)
    }

    fn end_epoch(&mut self) -> u32 {
        let done = self.done;
        (self.open, self.done, self.next_id) = (false, 0, 1);
        (self.base, self.tool) = (None, None);
        self.queue.clear();
        self.let_go = None;
        if self.outputs.insert(5, false) == Some(true) {
            self.tool_off_ms = Some(self.time_ms);
        }
        self.epoch += 1;
        done
    }
}

pub struct FakeRobot {
    pub(super) world: Shared,
    pub(super) by_the_wall: bool,
}

impl Port<RobotCommand> for FakeRobot {
    fn perform(&mut self, command: RobotCommand) -> RobotAnswer {
        if let (RobotCommand::Next, true) = (&command, self.by_the_wall) {
            // Ten times as fast as the robot's clock: a background computation lasts for some of these iterations, and
            // is not late on a busy machine.
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        let mut world = self.world.borrow_mut();
        match command {
            RobotCommand::Send(command) => RobotAnswer::Queued(world.queue(command)),
            RobotCommand::Path { points, permitted } => RobotAnswer::Queued(world.queue_path(points, permitted)),
            RobotCommand::Permit(last) => RobotAnswer::Done(world.permit(last)),
            RobotCommand::OpenEpoch(above) => RobotAnswer::Epoch(Ok(world.open_epoch(above))),
            RobotCommand::Abort => RobotAnswer::Done(world.abort()),
            RobotCommand::Next => RobotAnswer::Report(Ok(world.next_report())),
            RobotCommand::Now => RobotAnswer::Time(Time::from_ms(world.time_ms)),
        }
    }
}

impl World {
    fn queue_path(&mut self, points: Vec<MoveLin>, permitted: Option<u32>) -> Result<CommandId, QueueError> {
        let count = points.len() as u32;
        let last = points.into_iter().try_fold(CommandId(0), |_, point| self.queue(Command::MoveLin(point)))?;
        if let Some(permitted) = permitted {
            self.permit(Some(CommandId(last.0 - count + permitted)))?;
        }
        Ok(last)
    }

    fn permit(&mut self, last: Option<CommandId>) -> Result<(), QueueError> {
        if !self.open {
            return Err(QueueError::NoEpoch);
        }
        self.let_go = last.map(|last| last.0);
        Ok(())
    }

    fn open_epoch(&mut self, above: Epoch) -> Epoch {
        self.end_epoch();
        self.epoch = self.epoch.max(above.0 + 1);
        self.open = true;
        let epoch = Epoch(self.epoch);
        self.reports.push_back(Report::EpochOpened { epoch });
        epoch
    }

    fn abort(&mut self) -> Result<(), QueueError> {
        if self.is_lost {
            return Err(QueueError::NotConnected);
        }
        let done = CommandId(self.end_epoch());
        self.brakes_until_ms = self.time_ms + self.brakes_ms;
        // The end of an epoch switches the water off.
        if self.outputs.insert(2, false) == Some(true) {
            self.water_off_ms = self.time_ms;
        }
        self.reports.push_back(Report::Standstill { done });
        Ok(())
    }

    fn next_report(&mut self) -> Option<Report> {
        if let Some(report) = self.reports.pop_front() {
            self.is_lost &= !matches!(report, Report::State(_));
            return Some(report);
        }
        let in_contact = self.intent.is_some_and(|motion| motion.path == Path::Contact) && self.open;
        self.time_ms += if in_contact { self.contact_round_ms } else { 100 };
        let before = self.done;
        for _ in 0..self.pace {
            let let_go = self.let_go;
            let is_free = |(id, _): &mut (u32, Command)| let_go.is_none_or(|last| *id <= last);
            let Some((id, command)) = self.queue.pop_front_if(is_free) else { break };
            self.execute(command);
            self.done = id;
        }
        if self.done > before {
            let done = CommandId(self.done);
            self.reports.push_back(Report::Progress { done });
        }
        if self.loses_link && self.in_contact > 12 {
            (self.loses_link, self.is_lost) = (false, true);
            self.end_epoch();
            let why = eki::LinkLoss::Closed { channel: eki::Channel::State };
            self.reports.push_back(Report::LinkLost { why });
        }
        let state = Report::State(Box::new(self.state()));
        self.reports.push_back(state);
        self.reports.pop_front()
    }
}
