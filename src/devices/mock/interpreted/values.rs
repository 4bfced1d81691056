//! System variables: what they hold, and what writing one does.

use super::super::model::Controller;
use super::super::setup::{Mode, Setup};
use super::states::RobotState;
use crate::krl::{Cell, SYSTEM_VARIABLES};

/// Highest $VEL.CP, m/s, and $ACC.CP, m/s²; a larger value stops the program.
const MOST: [f32; 2] = [2.0, 10.0];

/// A timer that counts ms.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Timer {
    value: i64,
    set_ms: u64,
    runs: bool,
}

impl Timer {
    fn value(&self, now_ms: u64) -> i64 {
        if self.runs { self.value + (now_ms - self.set_ms) as i64 } else { self.value }
    }
}

/// A frame that is written component by component.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct WrittenFrame {
    pub(super) now: Option<[f32; 6]>,
    parts: [f32; 6],
}

/// A channel as the program sees it.
#[derive(Debug, Clone, Default)]
pub(super) struct ChannelState {
    pub(super) initialised: bool,
    pub(super) listens: bool,
    pub(super) cleared_ms: u64,
    pub(super) set: Vec<super::super::codec::Value>,
}

/// What the controller holds beside the data lists.
#[derive(Debug, Clone)]
pub(in super::super) struct Values {
    pub(super) state: RobotState,
    pub(super) stop_message: bool,
    pub(super) advance: i32,
    pub(super) base: WrittenFrame,
    pub(super) tool: WrittenFrame,
    /// $VEL.CP, $ACC.CP, $APO.CDIS.
    pub(super) velocity: f32,
    pub(super) acceleration: f32,
    pub(super) distance: f32,
    pub(super) axis_velocity: [i32; 6],
    pub(super) axis_acceleration: [i32; 6],
    timers: [Timer; 65],
    words: [u16; 2],
    /// What a program writes and nothing here acts on.
    others: std::collections::BTreeMap<(u16, u32), Cell>,
    pub(super) channels: [ChannelState; 2],
    /// Until then EKI_Init and EKI_Open fail.
    pub(super) channels_fail_until_ms: u64,
    /// An interrupt's condition may have changed.
    pub(super) changed: bool,
    /// An approximated motion from standstill need not wait for a next one.
    pub(super) released: bool,
    /// The arm gave up a motion; the reason.
    pub(super) gave_up: Option<String>,
    /// The next motion is given up.
    pub(super) refuses: bool,
    pub(super) reset_asked: bool,
    /// What `$ROB_TIMER` counted at the start.
    pub(super) uptime_ms: u64,
}

impl Values {
    pub(super) fn new(setup: &Setup) -> Self {
        let channel = |elements: usize| ChannelState {
            set: vec![super::super::codec::Value::Unset; elements],
            ..ChannelState::default()
        };
        Values {
            state: RobotState::Reset,
            stop_message: false,
            advance: 3,
            base: WrittenFrame::default(),
            tool: WrittenFrame::default(),
            velocity: 0.1,
            acceleration: 1.0,
            distance: 0.0,
            axis_velocity: [100; 6],
            axis_acceleration: [100; 6],
            timers: [Timer::default(); 65],
            words: [0; 2],
            others: std::collections::BTreeMap::new(),
            channels: [channel(setup.commands.sent.len()), channel(setup.states.sent.len())],
            channels_fail_until_ms: 0,
            changed: true,
            released: false,
            gave_up: None,
            refuses: false,
            reset_asked: false,
            uptime_ms: setup.programs.as_ref().map_or(0, |programs| programs.uptime_ms),
        }
    }

    pub(super) fn init_motion(&mut self) {
        (self.velocity, self.acceleration, self.advance) = (0.1, 1.0, 3);
        (self.axis_velocity, self.axis_acceleration) = ([100; 6], [100; 6]);
    }

    /// The TCP can be told: a program has set base and tool.
    pub(super) fn knows_tcp(&self) -> bool {
        let has_program = matches!(self.state, RobotState::Active | RobotState::Stopped | RobotState::Ended);
        has_program && self.base.now.is_some() && self.tool.now.is_some()
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

pub(super) fn read(controller: &Controller, values: &Values, variable: u16, offset: u32) -> Result<Cell, String> {
    let name = SYSTEM_VARIABLES[variable as usize].name;
    let at = offset as usize;
    let number = u16::try_from(offset + 1).unwrap_or(u16::MAX);
    let safety = &controller.safety;
    match name {
        "$FLAG" => bool(controller.flags.get(&number).copied().unwrap_or(false)),
        "$OUT" => bool(controller.outputs.get(&number).copied().unwrap_or(false)),
        "$IN" => bool(controller.inputs.get(&number).copied().unwrap_or(number == 1025)),
        "$TIMER" => int(values.timers[at].value(controller.now_ms)),
        "$TIMER_FLAG" => bool(values.timers[at].value(controller.now_ms) > 0),
        "$TIMER_STOP" => bool(!values.timers[at].runs),
        "$PERI_RDY" => bool(safety.drives_on),
        "$ALARM_STOP" | "$ALARM_STOP_INTERN" => bool(!safety.e_stop),
        "$USER_SAF" => bool(safety.guard_closed),
        "$MODE_OP" => Ok(Cell::Word(match safety.mode {
            Mode::T1 => 0,
            Mode::T2 => 1,
            Mode::Aut => 2,
            Mode::Ext => 3,
        })),
        "$PRO_STATE1" | "$PRO_STATE" => Ok(Cell::Word(values.state as u16)),
        "$PRO_ACT" => bool(values.state == RobotState::Active),
        "$COULD_START_MOTION" => bool(safety.may_start()),
        "$PRO_MOVE" => bool(controller.mover.is_in_motion()),
        "$STOPMESS" => bool(values.stop_message),
        // Turns over as an INT of 32 bits does.
        "$ROB_TIMER" => Ok(Cell::Int((controller.now_ms - controller.started_ms + values.uptime_ms) as i32)),
        "$ADVANCE" => int(i64::from(values.advance)),
        "$NULLFRAME" | "$WORLD" | "$ROBROOT" => real(0.0),
        "$BASE" => values.base.now.map_or(Ok(Cell::Unset), |frame| Ok(Cell::Real(frame[at]))),
        "$TOOL" => values.tool.now.map_or(Ok(Cell::Unset), |frame| Ok(Cell::Real(frame[at]))),
        "$AXIS_ACT_MEAS" | "$AXIS_ACT" => {
            real(super::super::kinematics::angles_deg(&controller.mover.joints()).get(at).copied().unwrap_or(0.0))
        }
        "$POS_ACT" | "$POS_ACT_MES" => {
            if !values.knows_tcp() {
                return Err(format!("{name} has no value: no program has set $BASE and $TOOL"));
            }
            let pose = super::around::tcp(controller, values);
            match at {
                0..6 => real(pose[at]),
                6..8 => int(0),
                _ => real(0.0),
            }
        }
        "$VEL" | "$ACC" | "$APO" => {
            let [first, own] = match name {
                "$VEL" => [values.velocity, values.velocity],
                "$ACC" => [values.acceleration, values.acceleration],
                _ => [values.distance, values.distance],
            };
            Ok(if at == 0 { Cell::Real(first) } else { Cell::Real(own) })
        }
        "$VEL_AXIS" => int(values.axis_velocity.get(at).copied().map_or(100, i64::from)),
        "$ACC_AXIS" => int(values.axis_acceleration.get(at).copied().map_or(100, i64::from)),
        "$DATE" => int(date(i64::from(controller.setup.boot), at)),
        "$CMD" => int(1),
        "$IPO_MODE" => Ok(Cell::Word(values.words[0])),
        "$ORI_TYPE" => Ok(Cell::Word(values.words[1])),
        "$OV_PRO" => int(100),
        _ => {
            let written = values.others.get(&(variable, offset)).copied();
            written.ok_or_else(|| format!("{name} is not modelled"))
        }
    }
}

/// CSEC, SEC, MIN, HOUR, DAY, MONTH, YEAR: a second later at each start.
fn date(boot: i64, component: usize) -> i64 {
    match component {
        1 => boot.rem_euclid(60),
        2 => boot.div_euclid(60).rem_euclid(60),
        3 => boot.div_euclid(3600).rem_euclid(24),
        4 | 5 => 1,
        6 => 2030,
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
    match (name, value) {
        (_, Cell::Unset) => return Err(format!("an invalid value cannot be written to {name}")),
        ("$FLAG", Cell::Bool(value)) => drop(controller.flags.insert(number, value)),
        ("$OUT", Cell::Bool(value)) => controller.set_output(number, value),
        ("$TIMER", Cell::Int(value)) => {
            let timer = &mut values.timers[at];
            (timer.value, timer.set_ms) = (i64::from(value), now_ms);
        }
        ("$TIMER_STOP", Cell::Bool(stops)) => {
            let timer = &mut values.timers[at];
            (timer.value, timer.set_ms, timer.runs) = (timer.value(now_ms), now_ms, !stops);
        }
        ("$ADVANCE", Cell::Int(count)) if (0..=5).contains(&count) => values.advance = count,
        ("$ADVANCE", _) => return Err("$ADVANCE is 0 to 5".to_owned()),
        ("$BASE" | "$TOOL", Cell::Real(part)) => {
            let is_base = name == "$BASE";
            let frame = if is_base { &mut values.base } else { &mut values.tool };
            frame.parts[at] = part;
            if at == 5 {
                let whole = frame.parts;
                // A frame that is set again as it is takes no fault: the client sets it once, and hears it back.
                if frame.now != Some(whole) {
                    frame.now = controller.troubles.spoil_frame(is_base, whole).or(frame.now);
                }
            }
        }
        ("$VEL", Cell::Real(speed)) if at == 0 => values.velocity = in_range(name, speed, MOST[0])?,
        ("$ACC", Cell::Real(rate)) if at == 0 => values.acceleration = in_range(name, rate, MOST[1])?,
        ("$APO", Cell::Real(distance)) if at == 0 => values.distance = distance,
        ("$VEL_AXIS" | "$ACC_AXIS", Cell::Int(percent)) => {
            if !(1..=100).contains(&percent) {
                return Err(format!("{name} is 1 to 100 percent, not {percent}"));
            }
            let list = if name == "$VEL_AXIS" { &mut values.axis_velocity } else { &mut values.axis_acceleration };
            if let Some(axis) = list.get_mut(at) {
                *axis = percent;
            }
        }
        ("$IPO_MODE", Cell::Word(word)) => values.words[0] = word,
        ("$ORI_TYPE", Cell::Word(word)) => values.words[1] = word,
        _ => drop(values.others.insert((variable, offset), value)),
    }
    Ok(())
}

fn in_range(name: &str, value: f32, most: f32) -> Result<f32, String> {
    if value > 0.0 && value <= most {
        Ok(value)
    } else {
        Err(format!("{name}.CP is above 0 and at most {most}, not {value}"))
    }
}
