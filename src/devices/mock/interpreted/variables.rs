//! System variables as programs read and write them.

use super::super::model::Controller;
use super::super::options::Mode;
use super::robot_state::RobotState;
use super::values::{PoseOf, Values, frame};
use crate::geometry::{Base, Flange, KukaPose, Panel, Rigid, Tool};
use crate::krl::{Cell, SYSTEM_VARIABLES};
use std::sync::LazyLock;

/// Highest $VEL.CP, m/s, and $ACC.CP, m/s²; a larger value stops the program.
const MAX_VEL_ACC: [f32; 2] = [2.0, 10.0];

/// A system variable that is modelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Known {
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
static KNOWN: LazyLock<Vec<Known>> =
    LazyLock::new(|| SYSTEM_VARIABLES.iter().map(|variable| known(variable.name)).collect());

fn known(name: &str) -> Known {
    match name {
        "$FLAG" => Known::Flag,
        "$OUT" => Known::Output,
        "$IN" => Known::Input,
        "$TIMER" => Known::Timer,
        "$TIMER_FLAG" => Known::TimerFlag,
        "$TIMER_STOP" => Known::TimerStop,
        "$PERI_RDY" => Known::DrivesReady,
        "$ALARM_STOP" | "$ALARM_STOP_INTERN" => Known::NoAlarm,
        "$USER_SAF" => Known::GuardClosed,
        "$MODE_OP" => Known::Mode,
        "$PRO_STATE1" | "$PRO_STATE" => Known::RobotState,
        "$PRO_ACT" => Known::Active,
        "$COULD_START_MOTION" => Known::CouldStart,
        "$PRO_MOVE" => Known::Moves,
        "$STOPMESS" => Known::StopMessage,
        "$ROB_TIMER" => Known::Uptime,
        "$ADVANCE" => Known::Advance,
        "$NULLFRAME" | "$WORLD" | "$ROBROOT" => Known::NullFrame,
        "$BASE" => Known::Base,
        "$TOOL" => Known::Tool,
        "$AXIS_ACT_MEAS" | "$AXIS_ACT" => Known::MeasuredAxes,
        "$POS_ACT" => Known::Pose,
        "$POS_ACT_MES" => Known::MeasuredPose,
        "$VEL" => Known::Velocity,
        "$ACC" => Known::Acceleration,
        "$APO" => Known::Approximation,
        "$VEL_AXIS" => Known::AxisVelocity,
        "$ACC_AXIS" => Known::AxisAcceleration,
        "$DATE" => Known::Date,
        "$CMD" => Known::Command,
        "$IPO_MODE" => Known::Interpolation,
        "$ORI_TYPE" => Known::Orientation,
        "$OV_PRO" => Known::Override,
        _ => Known::Other,
    }
}

fn bool(value: bool) -> Result<Cell, String> {
    Ok(Cell::Bool(value))
}

fn int(value: i64) -> Result<Cell, String> {
    Ok(Cell::Int(value.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32))
}

fn real(value: f64) -> Result<Cell, String> {
    Ok(Cell::Real(value as f32))
}

/// Returns $POS_ACT. Programs read its components one by one while neither arm nor frames change.
fn pose(controller: &Controller, values: &mut Values) -> [f64; 6] {
    let of = PoseOf { joints: controller.mover.joints(), base: values.base.now, tool: values.tool.now };
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
    values: &mut Values,
    variable: u16,
    offset: u32,
) -> Result<Cell, String> {
    let at = offset as usize;
    let number = u16::try_from(offset + 1).unwrap_or(u16::MAX);
    let safety = &controller.safety;
    let name = || SYSTEM_VARIABLES[variable as usize].name;
    let known = KNOWN[variable as usize];
    match known {
        Known::Flag => bool(controller.flags.get(&number).copied().unwrap_or(false)),
        Known::Output => bool(controller.outputs.get(&number).copied().unwrap_or(false)),
        Known::Input => bool(controller.inputs.get(&number).copied().unwrap_or(number == 1025)),
        Known::Timer => int(values.timers[at].value(controller.now_ms)),
        Known::TimerFlag => bool(values.timers[at].value(controller.now_ms) > 0),
        Known::TimerStop => bool(!values.timers[at].runs),
        Known::DrivesReady => bool(safety.drives_on),
        Known::NoAlarm => bool(!safety.e_stop),
        Known::GuardClosed => bool(safety.guard_closed),
        Known::Mode => Ok(Cell::Word(match safety.mode {
            Mode::T1 => 0,
            Mode::T2 => 1,
            Mode::Aut => 2,
            Mode::Ext => 3,
        })),
        Known::RobotState => Ok(Cell::Word(values.state as u16)),
        Known::Active => bool(values.state == RobotState::Active),
        Known::CouldStart => bool(safety.may_start()),
        Known::Moves => bool(controller.mover.is_in_motion()),
        Known::StopMessage => bool(values.stop_message),
        // The value overflows like a 32-bit INT.
        Known::Uptime => Ok(Cell::Int((controller.now_ms - controller.started_ms + values.uptime_ms) as i32)),
        Known::Advance => int(i64::from(values.advance)),
        Known::NullFrame => real(0.0),
        Known::Base => values.base.now.map_or(Ok(Cell::Unset), |frame| Ok(Cell::Real(frame[at]))),
        Known::Tool => values.tool.now.map_or(Ok(Cell::Unset), |frame| Ok(Cell::Real(frame[at]))),
        Known::MeasuredAxes => {
            real(super::super::kinematics::angles_deg(&controller.mover.joints()).get(at).copied().unwrap_or(0.0))
        }
        Known::Pose | Known::MeasuredPose => {
            if !values.knows_tcp() {
                return Err(format!("{} has no value: no program has set $BASE and $TOOL", name()));
            }
            match at {
                2 if matches!(known, Known::MeasuredPose) => {
                    real(pose(controller, values)[at] + controller.troubles.measured_off_mm())
                }
                0..6 => real(pose(controller, values)[at]),
                6..8 => int(0),
                _ => real(0.0),
            }
        }
        Known::Velocity => Ok(Cell::Real(values.velocity)),
        Known::Acceleration => Ok(Cell::Real(values.acceleration)),
        Known::Approximation => Ok(Cell::Real(values.distance)),
        Known::AxisVelocity => int(values.axis_velocity.get(at).copied().map_or(100, i64::from)),
        Known::AxisAcceleration => int(values.axis_acceleration.get(at).copied().map_or(100, i64::from)),
        Known::Date => int(date(i64::from(controller.setup.boot), at)),
        Known::Command => int(1),
        Known::Interpolation => Ok(Cell::Word(values.words[0])),
        Known::Orientation => Ok(Cell::Word(values.words[1])),
        Known::Override => int(i64::from(controller.troubles.override_percent())),
        Known::Other => {
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
    values: &mut Values,
    variable: u16,
    offset: u32,
    value: Cell,
) -> Result<(), String> {
    let name = SYSTEM_VARIABLES[variable as usize].name;
    let at = offset as usize;
    let number = u16::try_from(offset + 1).unwrap_or(u16::MAX);
    values.changed = true;
    let now_ms = controller.now_ms;
    match (KNOWN[variable as usize], value) {
        (_, Cell::Unset) => return Err(format!("a value that was never assigned cannot be written to {name}")),
        (Known::Flag, Cell::Bool(value)) => drop(controller.flags.insert(number, value)),
        (Known::Output, Cell::Bool(value)) => controller.set_output(number, value),
        (Known::Timer, Cell::Int(value)) => {
            let timer = &mut values.timers[at];
            (timer.value, timer.set_ms) = (i64::from(value), now_ms);
        }
        (Known::TimerStop, Cell::Bool(stops)) => {
            let timer = &mut values.timers[at];
            (timer.value, timer.set_ms, timer.runs) = (timer.value(now_ms), now_ms, !stops);
        }
        (Known::Advance, Cell::Int(count)) if (0..=5).contains(&count) => values.advance = count,
        (Known::Advance, _) => return Err("$ADVANCE is 0 to 5".to_owned()),
        (Known::Base | Known::Tool, Cell::Real(part)) => {
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
        (Known::Velocity, Cell::Real(speed)) if at == 0 => values.velocity = in_range(name, speed, MAX_VEL_ACC[0])?,
        (Known::Acceleration, Cell::Real(rate)) if at == 0 => {
            values.acceleration = in_range(name, rate, MAX_VEL_ACC[1])?
        }
        (Known::Approximation, Cell::Real(distance)) if at == 0 => values.distance = distance,
        (Known::AxisVelocity | Known::AxisAcceleration, Cell::Int(percent)) => {
            if !(1..=100).contains(&percent) {
                return Err(format!("{name} must be 1 to 100 percent, found {percent}"));
            }
            let list = if name == "$VEL_AXIS" { &mut values.axis_velocity } else { &mut values.axis_acceleration };
            if let Some(axis) = list.get_mut(at) {
                *axis = percent;
            }
        }
        (Known::Interpolation, Cell::Word(word)) => values.words[0] = word,
        (Known::Orientation, Cell::Word(word)) => values.words[1] = word,
        _ => drop(values.others.insert((variable, offset), value)),
    }
    Ok(())
}

fn in_range(name: &str, value: f32, most: f32) -> Result<f32, String> {
    if value > 0.0 && value <= most {
        Ok(value)
    } else {
        Err(format!("{name}.CP must be above 0 and at most {most}, found {value}"))
    }
}

/// Calculates $POS_ACT: the tool in the active base.
fn tcp(controller: &Controller, values: &Values) -> [f64; 6] {
    let base = frame(values.base.now.unwrap_or_default()).to_rigid::<Base, Panel>();
    let tool: Rigid<Flange, Tool> = frame(values.tool.now.unwrap_or_default()).to_rigid();
    let found: Rigid<Panel, Tool> = base.inverse() * controller.mover.base_from_flange() * tool;
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&found);
    [x_mm, y_mm, z_mm, a_deg, b_deg, c_deg]
}
