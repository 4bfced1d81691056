//! The parts of the controller that a running program uses: the environment of an interpreter.

use super::super::log::path_stop_message;
use super::super::model::Controller;
use super::super::mover::MoveBlocked;
use super::super::moves::{Lin, Move, MoveKey, Ptp};
use super::super::{kinematics, wire};
use super::values::{ControllerValues, frame};
use super::variables;
use panelprep_base::geometry::{Base, Flange, Panel, Rigid, Tool};
use panelprep_kuka::krl::{
    Approximation, Builtin, Caller, Cell, EkiAnswer, Host, Motion, MotionRequest, UndocumentedBehaviour,
};
use std::collections::VecDeque;

/// The host of both interpreters.
pub(super) struct InterpreterHost<'a> {
    pub(super) controller: &'a mut Controller,
    pub(super) values: &'a mut ControllerValues,
    pub(super) sequences: &'a mut VecDeque<u64>,
    pub(super) next_sequence: &'a mut u64,
    pub(super) meaning: UndocumentedBehaviour,
}

impl Host for InterpreterHost<'_> {
    fn read(&mut self, variable: u16, offset: u32) -> Result<Cell, String> {
        variables::read(self.controller, self.values, variable, offset)
    }

    fn write(&mut self, variable: u16, offset: u32, value: Cell) -> Result<(), String> {
        variables::write(self.controller, self.values, variable, offset, value)
    }

    fn now_ms(&self) -> u64 {
        self.controller.now_ms
    }

    fn is_arm_at_rest(&self) -> bool {
        self.controller.mover.is_idle()
    }

    fn planned_motions(&self) -> usize {
        self.controller.mover.planned_count()
    }

    fn advance(&self) -> usize {
        usize::try_from(self.values.advance).unwrap_or(0)
    }

    fn plan(&mut self, request: &MotionRequest, caller: &Caller<'_>) -> Result<u64, String> {
        let command = Command::from_caller(caller);
        // Only a motion that belongs to a command can be refused; a retract belongs to none.
        if command.is_some() && std::mem::take(&mut self.values.abandons_next_motion) {
            return self.abandon_motion("the mock controller was configured to refuse this motion".to_owned());
        }
        let planned = match (request.motion, request.axes) {
            (Motion::Ptp, true) => self.plan_ptp(request, command.as_ref()),
            (Motion::Ptp, false) => {
                Err("the mock controller does not support PTP to a pose; use axis angles".to_owned())
            }
            (Motion::Lin, _) => self.plan_lin(request, command.as_ref()),
        };
        let step = match planned {
            Ok(step) => step,
            Err(why) => return self.abandon_motion(why),
        };
        self.controller.mover.plan(step);
        let sequence = *self.next_sequence;
        *self.next_sequence += 1;
        self.sequences.push_back(sequence);
        Ok(sequence)
    }

    fn finish_motions(&mut self) {
        self.values.released = true;
    }

    fn start_braking(&mut self, _fast: bool) {
        let mover = &self.controller.mover;
        self.controller.contact.stop(mover.current_move(), false);
        self.controller.mover.start_braking();
        if self.controller.mover.is_idle() {
            self.sequences.clear();
        }
    }

    fn discard(&mut self) {
        let mover = &self.controller.mover;
        self.controller.contact.stop(mover.current_move(), false);
        self.controller.mover.stop_immediately();
        self.sequences.clear();
    }

    fn eki(&mut self, what: Builtin, channel: &str, tag: &str, value: &[Cell]) -> Result<EkiAnswer, String> {
        super::ethernet::call(self.controller, self.values, self.meaning, what, (channel, tag), value)
    }

    fn command(&mut self, text: &str) -> Result<(), String> {
        if text == "RESET 1" {
            self.values.reset_asked = true;
            return Ok(());
        }
        Err(format!("the mock controller does not support CWRITE of \"{text}\""))
    }

    fn init_motion(&mut self) {
        self.values.init_motion();
    }

    fn is_initialized(&mut self, name: &str) -> bool {
        !matches!(name, "$POS_ACT" | "$POS_ACT_MES") || self.values.knows_tcp()
    }
}

/// The command that the program executes: the content of its local variable CMD.
struct Command {
    key: MoveKey,
    operation: i32,
    remaining_points: i32,
    contact: bool,
}

impl Command {
    fn from_caller(caller: &Caller<'_>) -> Option<Self> {
        let cells = caller.local_cells("CMD", 5)?;
        let numbers: Vec<i32> =
            cells.iter().map(|cell| if let Cell::Int(number) = cell { *number } else { 0 }).collect();
        let [id, epoch, operation, n1, n2] = numbers.try_into().ok()?;
        Some(Command { key: MoveKey { epoch, id }, operation, remaining_points: n1, contact: n2 == 1 })
    }
}

impl InterpreterHost<'_> {
    fn abandon_motion(&mut self, why: String) -> Result<u64, String> {
        self.values.abandon_reason = Some(why.clone());
        Err(why)
    }

    fn plan_ptp(&self, request: &MotionRequest, command: Option<&Command>) -> Result<Move, String> {
        let target = kinematics::to_joints(request.target.map(f64::from));
        self.controller.setup.arm.within_limits(&target).map_err(|why| why.to_string())?;
        let least = |list: &[i32; 6]| f64::from(list.iter().copied().min().unwrap_or(1)) / 100.0;
        Ok(Move::Ptp(Ptp {
            key: command.filter(|command| command.operation == wire::MOVE_J).map(|command| command.key),
            target,
            speed_share: least(&self.values.axis_velocity),
            acceleration_share: least(&self.values.axis_acceleration),
            switched_output: None,
        }))
    }

    fn plan_lin(&self, request: &MotionRequest, command: Option<&Command>) -> Result<Move, String> {
        let (Some(base), Some(tool)) = (self.values.base.now, self.values.tool.now) else {
            return Err("a LIN motion was started before $BASE and $TOOL were set".to_owned());
        };
        let command = command.filter(|command| command.operation == wire::MOVE_LIN);
        let flange_from_tool: Rigid<Flange, Tool> = frame(tool).to_rigid();
        let target = frame(base).to_rigid::<Base, Panel>() * frame(request.target).to_rigid::<Panel, Tool>();
        let mover = &self.controller.mover;
        let reached = self.controller.setup.arm.nearest(&(target * flange_from_tool.inverse()), &mover.joints());
        reached.map_err(|why| path_stop_message(&MoveBlocked::Unreachable(why)))?;
        Ok(Move::Lin(Lin {
            key: command.map(|command| command.key),
            target,
            flange_from_tool,
            blend_mm: match request.approximates {
                Some(Approximation::Distance) => f64::from(self.values.distance),
                _ => 0.0,
            },
            contact: command.is_some_and(|command| command.contact),
            switched_output: None,
            remaining_points: command.map_or(0, |command| command.remaining_points),
            speed_mm_s: f64::from(self.values.velocity) * 1000.0,
            acceleration_mm_s2: f64::from(self.values.acceleration) * 1000.0,
        }))
    }
}
