//! The tasks of the robot interpreter: the advance run, the main run, and their results.
//!
//! Commands are planned in order. Speeds apply to the commands that follow. Commands for base, tool, outputs and
//! subroutines wait until the arm has stopped, like KRL statements that stop the advance run.

use super::kinematics;
use super::log::{ContactSample, ExecutedMotion, StopCause, path_stop_message};
use super::model::{ActiveTool, Controller, TICK_MS};
use super::mover::{CompletedMove, MoveBlocked};
use super::moves::{Lin, Move, MoveKey, Override, Ptp};
use super::options::Mode;
use super::wire::{self, Command, Refusal};
use panelprep_base::geometry::{Base, KukaPose, Panel, Rigid, Tool};

/// $ADVANCE: number of motions that are planned in addition to the current one.
const ADVANCE_MOTIONS: usize = 3;

impl Controller {
    /// Executes or plans the commands in the ring buffer, as far as the advance run permits.
    pub(super) fn interpret(&mut self) {
        if !self.safety.motion_possible() {
            return;
        }
        if self.mover.is_idle() && self.contact.is_retract_due() {
            let mover = &self.mover;
            if let Some(away) =
                self.contact.take_retract(|flange_from_tool| mover.base_from_flange() * *flange_from_tool)
            {
                self.mover.plan(away);
            }
        }
        while !self.contact.is_retract_due() && !self.mover.is_braking() {
            let Some(&command) = self.epoch.ring.front() else { return };
            match self.execute(&command) {
                Ok(true) => {
                    self.epoch.ring.pop_front();
                }
                Ok(false) => return,
                Err((refusal, detail)) => return self.refuse(command.id, refusal, detail),
            }
        }
    }

    /// Plans or executes a command; returns false if it must wait.
    fn execute(&mut self, command: &Command) -> Result<bool, (Refusal, String)> {
        let Command { n: [n1, n2], r: [r1, r2], p, .. } = *command;
        match command.operation {
            wire::MOVE_J | wire::MOVE_LIN if self.mover.planned_count() > ADVANCE_MOTIONS => return Ok(false),
            wire::MOVE_J => {
                let key = MoveKey { epoch: command.epoch, id: command.id };
                let (target, acceleration_share) = (kinematics::to_joints(p), self.epoch.axis_acceleration_share);
                let speed_share = r1 / 100.0;
                self.mover.plan(Move::Ptp(Ptp {
                    key: Some(key),
                    target,
                    speed_share,
                    acceleration_share,
                    switched_output: None,
                }));
            }
            wire::MOVE_LIN => {
                if r2 > 0.0 {
                    self.epoch.speed_mm_s = r2 * 1000.0;
                }
                let lin = self.linear_motion(command)?;
                self.mover.plan(Move::Lin(lin));
            }
            wire::SET_ACC_SPEED => {
                self.epoch.speed_mm_s = r1 * 1000.0;
                self.epoch.acceleration_mm_s2 = r2 * 1000.0;
                self.epoch.axis_acceleration_share = f64::from(n2) / 100.0;
            }
            wire::SET_DIGOUT if r1 == 1.0 && self.mover.switch_at_end((number(n1), n2 == 1)) => {}
            // These commands stop the advance run.
            _ if !self.mover.is_idle() => return Ok(false),
            wire::SET_BASE => {
                self.epoch.base = self.troubles.faulty_frame(command).map(kuka_pose).or(self.epoch.base);
            }
            wire::SET_TCP => {
                let set = self.troubles.faulty_frame(command).map(kuka_pose);
                self.epoch.tool = set.map(|pose| ActiveTool { pose, sanding: n1 == 1 }).or(self.epoch.tool);
            }
            wire::SET_DIGOUT => self.set_output(number(n1), n2 == 1),
            wire::SET_DIGIN => {
                self.flags.extend(self.mapped_flag(n1).map(|flag| (flag, n2 == 1)));
            }
            _ => return Ok(self.run_subroutine(n1)),
        }
        Ok(true)
    }

    fn linear_motion(&self, command: &Command) -> Result<Lin, (Refusal, String)> {
        let (Some(base), Some(tool)) = (self.epoch.base, self.epoch.tool) else {
            return Err((Refusal::NoBaseOrTool, String::new()));
        };
        let contact = command.n[1] == 1;
        if contact && !tool.sanding {
            return Err((Refusal::OutOfRange, "contact without the sanding tool".to_owned()));
        }
        let target = base.to_rigid::<Base, Panel>() * kuka_pose(command.p).to_rigid::<Panel, Tool>();
        let flange_from_tool = tool.flange_from_tool();
        let base_from_flange = target * flange_from_tool.inverse();
        let reached = self.setup.arm.nearest(&base_from_flange, &self.mover.joints());
        reached.map_err(|why| (Refusal::Unreachable, why.to_string()))?;
        Ok(Lin {
            key: Some(MoveKey { epoch: command.epoch, id: command.id }),
            target,
            flange_from_tool,
            blend_mm: command.r[0],
            contact,
            switched_output: None,
            remaining_points: command.n[0],
            speed_mm_s: self.epoch.speed_mm_s,
            acceleration_mm_s2: self.epoch.acceleration_mm_s2,
        })
    }

    fn run_subroutine(&mut self, index: i32) -> bool {
        let takes_ms = usize::try_from(index).ok().and_then(|index| self.setup.subroutines_ms.get(index));
        let until_ms = self.now_ms + takes_ms.copied().unwrap_or_default();
        let ended = *self.epoch.subroutine_until_ms.get_or_insert(until_ms) <= self.now_ms;
        if ended {
            self.epoch.subroutine_until_ms = None;
        }
        ended
    }

    /// Executes one interpolation step of the arm.
    pub(super) fn step_arm(&mut self) {
        let (done, blocked) = self.mover.step(self.speed_limits(), TICK_MS as f64 / 1000.0);
        for step in &done {
            self.on_move_done(step);
        }
        if let Some(blocked) = blocked {
            self.on_blocked(&blocked);
        }
        self.contact.on_move_started(self.mover.current_move());
        self.update_executed_count();
        let dwells = self.epoch.open && self.mover.is_idle() && self.epoch.ring.is_empty();
        if dwells && self.contact.touches(None) {
            self.underruns += 1;
            self.stop(StopCause::Underrun, String::new());
        }
        self.sample();
    }

    pub(super) fn speed_limits(&self) -> Override {
        if !self.safety.motion_possible() {
            return Override { tool_mm_s: 0.0, axis_share: 0.0, share: 1.0 };
        }
        let share = self.troubles.speed_share();
        match self.safety.mode {
            Mode::T1 => Override { tool_mm_s: 250.0, axis_share: 0.1, share },
            Mode::T2 | Mode::Aut | Mode::Ext => Override { tool_mm_s: f64::INFINITY, axis_share: 1.0, share },
        }
    }

    fn on_move_done(&mut self, done: &CompletedMove) {
        self.contact.on_point_reached(&done.step);
        let Some(key) = done.step.key() else { return };
        if key.epoch == self.epoch.number {
            self.epoch.last_executed = self.epoch.last_executed.max(key.id);
        }
        // While the arm brakes after the end of an epoch, no output is switched.
        if let Some((number, on)) = done.step.switched_output()
            && key.epoch == self.epoch.number
            && self.epoch.open
        {
            self.set_output(number, on);
        }
        self.executed.push(ExecutedMotion {
            epoch: key.epoch,
            id: key.id,
            joints: done.joints,
            base_from_flange: self.setup.arm.base_from_flange(&done.joints),
            time_ms: self.now_ms,
            contact: done.step.contact(),
        });
        if let Move::Lin(lin) = done.step
            && self.epoch.open
            && done.was_starved
            && lin.remaining_points > 0
        {
            let next = self.epoch.ring.front();
            let waits = next.is_some_and(|next| ![wire::MOVE_J, wire::MOVE_LIN].contains(&next.operation));
            // A standstill in contact is counted at the point where it is detected, so not here.
            let in_contact = lin.contact && next.is_none() && self.mover.is_idle();
            if !waits && !in_contact {
                self.underruns += 1;
            }
        }
    }

    fn on_blocked(&mut self, blocked: &MoveBlocked) {
        if let Some(key) = self.mover.oldest_move()
            && !self.mover.is_braking()
        {
            return self.refuse(key.id, Refusal::Unreachable, path_stop_message(blocked));
        }
        self.mover.stop_immediately();
        if self.contact.is_retracting() {
            self.contact.abandon_retract();
        }
    }

    /// Sets the number of the last executed command: the one before the oldest command that is not executed.
    pub(super) fn update_executed_count(&mut self) {
        if !self.epoch.open {
            return;
        }
        let moving = self.mover.oldest_move().filter(|key| key.epoch == self.epoch.number).map(|key| key.id);
        let oldest = moving.or(self.epoch.ring.front().map(|command| command.id));
        self.epoch.last_executed = oldest.map_or(self.epoch.last_received, |id| id - 1);
    }

    pub(super) fn sample(&mut self) {
        let front = self.mover.current_move();
        let Some(flange_from_tool) = self.contact.tool().filter(|_| self.contact.touches(front)) else { return };
        if self.contact.is_retracting() {
            return;
        }
        let base_from_flange = self.flange_pose();
        // The real arm carries the real tool; $TOOL is only the calibrated estimate of it.
        let joints = self.mover.joints();
        let real_arm = self.setup.real_arm.as_ref();
        let base_from_tool =
            real_arm.map_or_else(|| base_from_flange * flange_from_tool, |arm| arm.base_from_tool(&joints));
        let tool_on = self.setup.tool_output.and_then(|number| self.outputs.get(&number)).copied();
        self.trace.push(ContactSample {
            time_ms: self.now_ms,
            base_from_flange,
            base_from_tool,
            sanding: self.contact.is_in_contact(front),
            tool_on: tool_on.unwrap_or(false),
        });
    }

    /// Returns the pose of the tool in the active base; if no base was set, the pose of the flange in the robot's base.
    pub(super) fn tcp(&self) -> KukaPose {
        // If no program is selected, the controller cannot report the pose.
        if !self.safety.has_program() {
            return KukaPose::default();
        }
        let base = self.epoch.base.unwrap_or_default().to_rigid::<Base, Panel>();
        let tool = self.epoch.tool.map_or_else(KukaPose::default, |tool| tool.pose);
        let tcp: Rigid<Panel, Tool> = base.inverse() * self.mover.base_from_flange() * tool.to_rigid();
        KukaPose::from_rigid(&tcp)
    }
}

fn number(n: i32) -> u16 {
    u16::try_from(n).unwrap_or_default()
}

fn kuka_pose(numbers: [f64; 6]) -> KukaPose {
    let [x_mm, y_mm, z_mm, a_deg, b_deg, c_deg] = numbers;
    KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg }
}
