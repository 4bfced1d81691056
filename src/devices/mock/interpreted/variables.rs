//! The interpreter's interface to the mock controller: system variables as programs read and write them, and the other
//! parts of the controller that a running program uses.

use super::super::log::path_stop_message;
use super::super::model::Controller;
use super::super::mover::MoveBlocked;
use super::super::moves::{Lin, Move, MoveKey, Ptp};
use super::super::options::Mode;
use super::super::{kinematics, wire};
use super::running::{ControllerValues, PoseInputs, RobotState, frame};
use panelprep_base::geometry::{Base, Flange, KukaPose, Panel, Rigid, Tool};
use panelprep_kuka::krl::{
    Approximation, Builtin, Caller, Cell, EkiAnswer, Host, Motion, MotionRequest, SYSTEM_VARIABLES,
    UndocumentedBehaviour,
};
use std::collections::VecDeque;
use std::sync::LazyLock;

/// Maximum $VEL.CP, m/s, and $ACC.CP, m/s²; a larger value stops the program.
const MAX_VEL_ACC: [f32; 2] = [2.0, 10.0];

/// The modelled variable for each entry of [`SYSTEM_VARIABLES`], so that no names are compared while a program runs.
static VARIABLES_BY_ENTRY: LazyLock<Vec<ModelledVariable>> =
    LazyLock::new(|| SYSTEM_VARIABLES.iter().map(|variable| modelled_variable(variable.name)).collect());

/// A system variable whose behaviour is modelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ModelledVariable {
    Flag,
    Output,
    Input,
    Timer,
    TimerFlag,
    TimerStop,
    DrivesReady,
    NoAlarm,
    GuardClosed,
    Mode,
    RobotState,
    Active,
    CouldStart,
    Moves,
    StopMessage,
    Uptime,
    Advance,
    NullFrame,
    Base,
    Tool,
    MeasuredAxes,
    Pose,
    MeasuredPose,
    Velocity,
    Acceleration,
    Approximation,
    AxisVelocity,
    AxisAcceleration,
    Date,
    Command,
    Interpolation,
    Orientation,
    Override,
    /// Any other system variable; it only stores the value that a program writes.
    Other,
}

fn modelled_variable(name: &str) -> ModelledVariable {
    match name {
        "$FLAG" => ModelledVariable::Flag,
        "$OUT" => ModelledVariable::Output,
        "$IN" => ModelledVariable::Input,
        "$TIMER" => ModelledVariable::Timer,
        "$TIMER_FLAG" => ModelledVariable::TimerFlag,
        "$TIMER_STOP" => ModelledVariable::TimerStop,
        "$PERI_RDY" => ModelledVariable::DrivesReady,
        "$ALARM_STOP" | "$ALARM_STOP_INTERN" => ModelledVariable::NoAlarm,
        "$USER_SAF" => ModelledVariable::GuardClosed,
        "$MODE_OP" => ModelledVariable::Mode,
        "$PRO_STATE1" | "$PRO_STATE" => ModelledVariable::RobotState,
        "$PRO_ACT" => ModelledVariable::Active,
        "$COULD_START_MOTION" => ModelledVariable::CouldStart,
        "$PRO_MOVE" => ModelledVariable::Moves,
        "$STOPMESS" => ModelledVariable::StopMessage,
        "$ROB_TIMER" => ModelledVariable::Uptime,
        "$ADVANCE" => ModelledVariable::Advance,
        "$NULLFRAME" | "$WORLD" | "$ROBROOT" => ModelledVariable::NullFrame,
        "$BASE" => ModelledVariable::Base,
        "$TOOL" => ModelledVariable::Tool,
        "$AXIS_ACT_MEAS" | "$AXIS_ACT" => ModelledVariable::MeasuredAxes,
        "$POS_ACT" => ModelledVariable::Pose,
        "$POS_ACT_MES" => ModelledVariable::MeasuredPose,
        "$VEL" => ModelledVariable::Velocity,
        "$ACC" => ModelledVariable::Acceleration,
        "$APO" => ModelledVariable::Approximation,
        "$VEL_AXIS" => ModelledVariable::AxisVelocity,
        "$ACC_AXIS" => ModelledVariable::AxisAcceleration,
        "$DATE" => ModelledVariable::Date,
        "$CMD" => ModelledVariable::Command,
        "$IPO_MODE" => ModelledVariable::Interpolation,
        "$ORI_TYPE" => ModelledVariable::Orientation,
        "$OV_PRO" => ModelledVariable::Override,
        _ => ModelledVariable::Other,
    }
}

fn bool(value: bool) -> Result<Cell, String> {
    Ok(Cell::Bool(value))
}

fn to_int_cell(value: i64) -> Result<Cell, String> {
    Ok(Cell::Int(value.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32))
}

fn to_real_cell(value: f64) -> Result<Cell, String> {
    Ok(Cell::Real(value as f32))
}

/// Returns $POS_ACT. The value is cached, because programs read its components one by one.
fn pose(controller: &Controller, values: &mut ControllerValues) -> [f64; 6] {
    let of = PoseInputs { joints: controller.mover.joints(), base: values.base.now, tool: values.tool.now };
    match values.pose {
        Some((known, pose)) if known == of => pose,
        _ => {
            let pose = tcp(controller, values);
            values.pose = Some((of, pose));
            pose
        }
    }
}

fn read_variable(
    controller: &Controller,
    values: &mut ControllerValues,
    variable: u16,
    offset: u32,
) -> Result<Cell, String> {
    let at = offset as usize;
    let number = u16::try_from(offset + 1).unwrap_or(u16::MAX);
    let safety = &controller.safety;
    let name = || SYSTEM_VARIABLES[variable as usize].name;
    let known = VARIABLES_BY_ENTRY[variable as usize];
    match known {
        ModelledVariable::Flag => bool(controller.flags.get(&number).copied().unwrap_or(false)),
        ModelledVariable::Output => bool(controller.outputs.get(&number).copied().unwrap_or(false)),
        ModelledVariable::Input => bool(controller.inputs.get(&number).copied().unwrap_or(number == 1025)),
        ModelledVariable::Timer => to_int_cell(values.timers[at].value(controller.now_ms)),
        ModelledVariable::TimerFlag => bool(values.timers[at].value(controller.now_ms) > 0),
        ModelledVariable::TimerStop => bool(!values.timers[at].runs),
        ModelledVariable::DrivesReady => bool(safety.drives_on),
        ModelledVariable::NoAlarm => bool(!safety.e_stop),
        ModelledVariable::GuardClosed => bool(safety.guard_closed),
        ModelledVariable::Mode => Ok(Cell::Word(match safety.mode {
            Mode::T1 => 0,
            Mode::T2 => 1,
            Mode::Aut => 2,
            Mode::Ext => 3,
        })),
        ModelledVariable::RobotState => Ok(Cell::Word(values.state as u16)),
        ModelledVariable::Active => bool(values.state == RobotState::Active),
        ModelledVariable::CouldStart => bool(safety.may_start()),
        ModelledVariable::Moves => bool(controller.mover.is_in_motion()),
        ModelledVariable::StopMessage => bool(values.stop_message),
        // The timer overflows like a 32-bit INT.
        ModelledVariable::Uptime => {
            Ok(Cell::Int((controller.now_ms - controller.started_ms + values.uptime_ms) as i32))
        }
        ModelledVariable::Advance => to_int_cell(i64::from(values.advance)),
        ModelledVariable::NullFrame => to_real_cell(0.0),
        ModelledVariable::Base => values.base.now.map_or(Ok(Cell::Unset), |frame| Ok(Cell::Real(frame[at]))),
        ModelledVariable::Tool => values.tool.now.map_or(Ok(Cell::Unset), |frame| Ok(Cell::Real(frame[at]))),
        ModelledVariable::MeasuredAxes => to_real_cell(
            super::super::kinematics::angles_deg(&controller.mover.joints()).get(at).copied().unwrap_or(0.0),
        ),
        ModelledVariable::Pose | ModelledVariable::MeasuredPose => {
            if !values.knows_tcp() {
                return Err(format!("{} has no value: no program has set $BASE and $TOOL", name()));
            }
            match at {
                2 if matches!(known, ModelledVariable::MeasuredPose) => {
                    to_real_cell(pose(controller, values)[at] + controller.troubles.pose_deviation_mm())
                }
                0..6 => to_real_cell(pose(controller, values)[at]),
                6..8 => to_int_cell(0),
                _ => to_real_cell(0.0),
            }
        }
        ModelledVariable::Velocity => Ok(Cell::Real(values.velocity)),
        ModelledVariable::Acceleration => Ok(Cell::Real(values.acceleration)),
        ModelledVariable::Approximation => Ok(Cell::Real(values.distance)),
        ModelledVariable::AxisVelocity => to_int_cell(values.axis_velocity.get(at).copied().map_or(100, i64::from)),
        ModelledVariable::AxisAcceleration => {
            to_int_cell(values.axis_acceleration.get(at).copied().map_or(100, i64::from))
        }
        ModelledVariable::Date => to_int_cell(date(i64::from(controller.setup.boot), at)),
        ModelledVariable::Command => to_int_cell(1),
        ModelledVariable::Interpolation => Ok(Cell::Word(values.words[0])),
        ModelledVariable::Orientation => Ok(Cell::Word(values.words[1])),
        ModelledVariable::Override => to_int_cell(i64::from(controller.troubles.override_percent())),
        ModelledVariable::Other => {
            let written = values.others.get(&(variable, offset)).copied();
            written.ok_or_else(|| format!("the mock controller does not support {}", name()))
        }
    }
}

/// Returns a component of the date: CSEC, SEC, MIN, HOUR, DAY, MONTH or YEAR. The date is one second later at each
/// start of the controller, and it is a date that no real clock shows. So the log of a mock controller cannot be
/// mistaken for that of a real controller.
fn date(boot: i64, component: usize) -> i64 {
    match component {
        1 => boot.rem_euclid(60),
        2 => boot.div_euclid(60).rem_euclid(60),
        3 => boot.div_euclid(3600).rem_euclid(24),
        6 => 2000,
        _ => 0,
    }
}

fn write_variable(
    controller: &mut Controller,
    values: &mut ControllerValues,
    variable: u16,
    offset: u32,
    value: Cell,
) -> Result<(), String> {
    let name = SYSTEM_VARIABLES[variable as usize].name;
    let at = offset as usize;
    let number = u16::try_from(offset + 1).unwrap_or(u16::MAX);
    values.changed = true;
    let now_ms = controller.now_ms;
    match (VARIABLES_BY_ENTRY[variable as usize], value) {
        (_, Cell::Unset) => return Err(format!("a value that was never assigned cannot be written to {name}")),
        (ModelledVariable::Flag, Cell::Bool(value)) => drop(controller.flags.insert(number, value)),
        (ModelledVariable::Output, Cell::Bool(value)) => controller.set_output(number, value),
        (ModelledVariable::Timer, Cell::Int(value)) => {
            let timer = &mut values.timers[at];
            (timer.value, timer.set_ms) = (i64::from(value), now_ms);
        }
        (ModelledVariable::TimerStop, Cell::Bool(stops)) => {
            let timer = &mut values.timers[at];
            (timer.value, timer.set_ms, timer.runs) = (timer.value(now_ms), now_ms, !stops);
        }
        (ModelledVariable::Advance, Cell::Int(count)) if (0..=5).contains(&count) => values.advance = count,
        (ModelledVariable::Advance, _) => return Err("$ADVANCE is 0 to 5".to_owned()),
        (ModelledVariable::Base | ModelledVariable::Tool, Cell::Real(part)) => {
            let is_base = name == "$BASE";
            let frame = if is_base { &mut values.base } else { &mut values.tool };
            frame.parts[at] = part;
            if at == 5 {
                let whole = frame.parts;
                // A fault must not be used up when a frame is set to the same value again: the client sets the frame
                // only once, and the program assigns it again.
                if frame.now != Some(whole) {
                    frame.now = controller.troubles.apply_frame_faults(is_base, whole).or(frame.now);
                }
            }
        }
        (ModelledVariable::Velocity, Cell::Real(speed)) if at == 0 => {
            values.velocity = check_range(name, speed, MAX_VEL_ACC[0])?
        }
        (ModelledVariable::Acceleration, Cell::Real(rate)) if at == 0 => {
            values.acceleration = check_range(name, rate, MAX_VEL_ACC[1])?
        }
        (ModelledVariable::Approximation, Cell::Real(distance)) if at == 0 => values.distance = distance,
        (ModelledVariable::AxisVelocity | ModelledVariable::AxisAcceleration, Cell::Int(percent)) => {
            if !(1..=100).contains(&percent) {
                return Err(format!("{name} must be 1 to 100 percent, found {percent}"));
            }
            let list = if name == "$VEL_AXIS" { &mut values.axis_velocity } else { &mut values.axis_acceleration };
            if let Some(axis) = list.get_mut(at) {
                *axis = percent;
            }
        }
        (ModelledVariable::Interpolation, Cell::Word(word)) => values.words[0] = word,
        (ModelledVariable::Orientation, Cell::Word(word)) => values.words[1] = word,
        _ => drop(values.others.insert((variable, offset), value)),
    }
    Ok(())
}

fn check_range(name: &str, value: f32, most: f32) -> Result<f32, String> {
    if value > 0.0 && value <= most {
        Ok(value)
    } else {
        Err(format!("{name}.CP must be above 0 and at most {most}, found {value}"))
    }
}

/// Calculates $POS_ACT: the pose of the tool in the active base.
fn tcp(controller: &Controller, values: &ControllerValues) -> [f64; 6] {
    let base = frame(values.base.now.unwrap_or_default()).to_rigid::<Base, Panel>();
    let tool: Rigid<Flange, Tool> = frame(values.tool.now.unwrap_or_default()).to_rigid();
    let found: Rigid<Panel, Tool> = base.inverse() * controller.mover.base_from_flange() * tool;
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&found);
    [x_mm, y_mm, z_mm, a_deg, b_deg, c_deg]
}

/// The mock controller as the host of an interpreter.
pub(super) struct InterpreterHost<'a> {
    pub(super) controller: &'a mut Controller,
    pub(super) values: &'a mut ControllerValues,
    pub(super) sequences: &'a mut VecDeque<u64>,
    pub(super) next_sequence: &'a mut u64,
    pub(super) meaning: UndocumentedBehaviour,
}

impl Host for InterpreterHost<'_> {
    fn read(&mut self, variable: u16, offset: u32) -> Result<Cell, String> {
        read_variable(self.controller, self.values, variable, offset)
    }

    fn write(&mut self, variable: u16, offset: u32, value: Cell) -> Result<(), String> {
        write_variable(self.controller, self.values, variable, offset, value)
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
        // Only a motion that belongs to a command can be refused; a retract belongs to no command.
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

/// The command that the program executes: the value of its local variable CMD.
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
