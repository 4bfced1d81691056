//! System variables as programs read and write them.

use super::super::model::Controller;
use super::super::options::Mode;
use super::robot_state::RobotState;
use super::values::{ControllerValues, PoseInputs, frame};
use panelprep_base::geometry::{Base, Flange, KukaPose, Panel, Rigid, Tool};
use panelprep_kuka::krl::{Cell, SYSTEM_VARIABLES};
use std::sync::LazyLock;

/// Highest $VEL.CP, m/s, and $ACC.CP, m/s²; a larger value stops the program.
const MAX_VEL_ACC: [f32; 2] = [2.0, 10.0];

/// A system variable that is modelled.
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
    /// Another system variable: it stores the value that a program writes.
    Other,
}

/// The variable for each entry of [`SYSTEM_VARIABLES`], so that names are not compared while a program runs.
static VARIABLES_BY_ENTRY: LazyLock<Vec<ModelledVariable>> =
    LazyLock::new(|| SYSTEM_VARIABLES.iter().map(|variable| modelled_variable(variable.name)).collect());

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

/// Returns $POS_ACT. Programs read its components one by one while neither arm nor frames change.
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

pub(super) fn read(
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
        // The value overflows like a 32-bit INT.
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

/// Returns CSEC, SEC, MIN, HOUR, DAY, MONTH, YEAR: one second later at each start, on a date that no real clock shows.
/// So a mock controller's log cannot be mistaken for that of a real controller.
fn date(boot: i64, component: usize) -> i64 {
    match component {
        1 => boot.rem_euclid(60),
        2 => boot.div_euclid(60).rem_euclid(60),
        3 => boot.div_euclid(3600).rem_euclid(24),
        6 => 2000,
        _ => 0,
    }
}

pub(super) fn write(
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
                // Setting a frame again to the same value must not consume a fault: the client sets the frame only
                // once, and the controller reports it back.
                if frame.now != Some(whole) {
                    frame.now = controller.troubles.spoil_frame(is_base, whole).or(frame.now);
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

/// Calculates $POS_ACT: the tool in the active base.
fn tcp(controller: &Controller, values: &ControllerValues) -> [f64; 6] {
    let base = frame(values.base.now.unwrap_or_default()).to_rigid::<Base, Panel>();
    let tool: Rigid<Flange, Tool> = frame(values.tool.now.unwrap_or_default()).to_rigid();
    let found: Rigid<Panel, Tool> = base.inverse() * controller.mover.base_from_flange() * tool;
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&found);
    [x_mm, y_mm, z_mm, a_deg, b_deg, c_deg]
}
