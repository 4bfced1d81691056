//! `panelprep robot …`: executes one of the nine functions of thesis Table 3.1, after the same checks as in a cycle.

use super::args::{Common, OnOff, Robot, RobotFunction, TipName};
use super::fault::Fault;
use super::output::Outcome;
use super::{disk, live};
use panelprep_base::geometry::{Joints, KukaPose};
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::{Cell, InputsOutputs, RobotKind};
use panelprep_cell::files;
use panelprep_kuka::eki::{Command, SetTcp, Signal, State, TcpKind};
use panelprep_service::daemon::{SingleError, SingleLine, SingleRobot, speed_command};
use panelprep_service::requirements::Purpose;
use panelprep_service::setup::CellFiles;
use serde_json::{Map, Value, json};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// Executes one function of the robot, and prints the state of the controller afterwards.
///
/// # Errors
/// If a file or a number is invalid, another program uses the store, or the devices cannot be started.
pub fn run(args: &Robot, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    if let RobotFunction::Prove(prove) = &args.function {
        return super::prove::run(prove, &files, &|line| super::output::write_progress(line));
    }
    files.require(Purpose::Robot)?;
    let action = RobotAction::read(&args.function, &files)?;
    // Another program that uses the store may be moving the robot. Reading the state is always permitted, and a mock
    // robot belongs to this program.
    let is_shared = action != RobotAction::State && files.cell.robot().kind() == RobotKind::Eki;
    let _store = is_shared.then(|| files.settled_store()).transpose()?;
    let (mut robot, _simulated) = live::robot_alone(&files.cell)?;
    let mut single = match SingleRobot::connect(&mut robot, files.cell.arm()) {
        Ok(single) => single.with_mounted(files.flange_devices()?),
        Err(error) => return Ok(Outcome::from_judgement(&no_answer_reason(judgement(error)?, &files))),
    };
    let done = action.perform(&mut single, &files.cell);
    let judgement = match done {
        Ok(()) => Judgement::new(vec![], vec![]),
        Err(error) => judgement(error)?,
    };
    let mut outcome = Outcome::from_judgement(&judgement);
    let state = single.state();
    describe_robot_state(state, files.cell.inputs_outputs()).into_iter().for_each(|line| outcome.add_line(line));
    if let Some(reported) = single.reported_tcp() {
        outcome.add_value("reported_base_from_tcp", json!(reported));
        outcome.add_line(format!(
            "the arm's correction is applied; the tip's pose without the correction, as on the pendant: {reported}"
        ));
    }
    outcome.add_value("state", state_to_json(state, files.cell.inputs_outputs()));
    Ok(outcome)
}

/// Replaces the reason if the service of the cell runs: the controller does not respond because it serves one client,
/// and the service is this client.
fn no_answer_reason(judgement: Judgement, files: &CellFiles) -> Judgement {
    let is_served = files.cell.robot().kind() == RobotKind::Eki && UnixStream::connect(files.socket()).is_ok();
    if !is_served {
        return judgement;
    }
    let words = "the service is connected to the controller, which serves one client at a time; `panelprep ctl \
                 state` shows the state of the cell";
    Judgement { reasons: vec![Reason::new("no_controller", words)], ..judgement }
}

/// Converts an error: a command that did not pass the checks is a verdict, a command that cannot be sent is invalid
/// input, and every other error is a fault of the cell.
fn judgement(error: SingleError) -> Result<Judgement, Fault> {
    let code = match error {
        SingleError::Gate(judgement) => return Ok(judgement),
        SingleError::Queue(error) => return Err(Fault::stage(error)),
        SingleError::NoController(_) | SingleError::Silent => "no_controller",
        SingleError::Robot(_) => "robot",
        SingleError::LinkLost(_) => "link_lost",
        SingleError::Late(_) => "late",
    };
    Ok(Judgement { verdict: Verdict::Aborted, reasons: vec![Reason::new(code, error.to_string())] })
}

/// A function of the robot with its parameters.
#[derive(Debug, PartialEq)]
enum RobotAction {
    State,
    MoveJ(Joints, u8),
    MoveLin(SingleLine),
    Set(Command),
    Call(u16),
    SetOut { name: String, on: bool, keep: Duration },
}

impl RobotAction {
    fn read(function: &RobotFunction, files: &CellFiles) -> Result<Self, Fault> {
        Ok(match function {
            RobotFunction::State | RobotFunction::Prove(_) => RobotAction::State,
            RobotFunction::MoveJ { to, axis_speed_percent } => {
                RobotAction::MoveJ(parse_joints(to, &files.cell)?, *axis_speed_percent)
            }
            RobotFunction::MoveLin { to, base, tool, speed_mm_s } => RobotAction::MoveLin(SingleLine {
                target: pose(to)?,
                base: base.as_deref().map(pose).transpose()?.unwrap_or_default(),
                tool: tip(*tool, files)?,
                // The speed is compared with the limit of the cell in the motion checks.
                speed_mm_s: speed(*speed_mm_s, "--speed-mm-s", f64::MAX, &files.cell)?,
            }),
            RobotFunction::SetBase { base } => RobotAction::Set(Command::SetBase(pose(base)?)),
            RobotFunction::SetTcp { flange_from_tool } => {
                let flange_from_tool = pose(flange_from_tool)?;
                RobotAction::Set(Command::SetTcp(SetTcp { flange_from_tool, kind: TcpKind::Other }))
            }
            RobotFunction::SetSpeed { speed_mm_s, acceleration_m_s2, axis_percent } => {
                let max_speed = files.cell.limits().max_speed_mm_s();
                let speed_mm_s = speed(*speed_mm_s, "SPEED_MM_S", max_speed, &files.cell)?;
                RobotAction::Set(speed_command(speed_mm_s, *acceleration_m_s2, *axis_percent))
            }
            RobotFunction::SetOut { name, value, keep_s } => RobotAction::SetOut {
                name: name.clone(),
                on: *value == OnOff::On,
                keep: Duration::from_secs(u64::from(*keep_s)),
            },
            RobotFunction::SetIn { number, value } => {
                RobotAction::Set(Command::SetDigin(Signal { number: *number, on: *value == OnOff::On }))
            }
            RobotFunction::Call { index } => RobotAction::Call(*index),
        })
    }

    fn perform(&self, single: &mut SingleRobot<'_>, cell: &Cell) -> Result<(), SingleError> {
        match self {
            // While the arm moves, axis angles and TCP pose may be of different times.
            RobotAction::State if single.state().moving => Ok(()),
            // Before its program is started, the controller does not know the TCP pose and reports 0 for all its
            // values.
            RobotAction::State if single.state().tip_is_unknown() => Ok(()),
            RobotAction::State => single.check_arm_identity(cell).map_err(arm_mismatch_refusal),
            RobotAction::MoveJ(joints, percent) => single.move_joints(*joints, *percent, cell),
            RobotAction::MoveLin(line) => single.move_line(line, cell),
            RobotAction::Set(command) => single.set(*command, cell),
            RobotAction::Call(index) => single.call(*index, cell),
            RobotAction::SetOut { name, on, keep } => single.set_output(name, *on, cell, *keep),
        }
    }
}

/// Converts the reason why the connected arm is not the arm of the cell to a failed motion check. The state is printed
/// nevertheless, but no motion is permitted.
fn arm_mismatch_refusal(reason: Reason) -> SingleError {
    SingleError::Gate(Judgement::new(vec![reason], vec![]))
}

/// Minimum speed that can be commanded, mm/s.
const MIN_SPEED_MM_S: f64 = 1.0;

/// Checks a commanded speed of the TCP, mm/s. A speed above `most` is refused here, before anything is sent.
fn speed(found: f64, option: &'static str, most: f64, cell: &Cell) -> Result<f64, Fault> {
    if (MIN_SPEED_MM_S..=most).contains(&found) {
        return Ok(found);
    }
    let allowed = cell.limits().max_speed_mm_s();
    let problem =
        format!("the limits are {MIN_SPEED_MM_S} to {allowed} mm/s ([limits] max_speed_mm_s in the cell's file)");
    Err(Fault::BadAnswer { option, found: found.to_string(), problem })
}

fn tip(name: TipName, files: &CellFiles) -> Result<SetTcp, Fault> {
    let other = |flange_from_tool| SetTcp { flange_from_tool, kind: TcpKind::Other };
    Ok(match name {
        TipName::Flange => other(KukaPose::default()),
        TipName::Camera => other(KukaPose::from_rigid(&files.flange_from_camera()?.value)),
        TipName::Sanding => SetTcp {
            flange_from_tool: KukaPose::from_rigid(&files.flange_from_tool()?.value),
            kind: TcpKind::Sanding,
        },
    })
}

/// Parses the name of a pose of the cell, or six axis angles.
fn parse_joints(text: &str, cell: &Cell) -> Result<Joints, Fault> {
    if let Some(joints) = cell.pose(text) {
        return Ok(joints);
    }
    let names = cell.poses().keys().map(String::as_str).collect::<Vec<_>>().join(", ");
    let wrong = |problem: String| Fault::NotSixNumbers {
        found: text.to_owned(),
        what: "set of axis angles",
        problem: format!(
            "{problem}; valid: six angles A1,A2,A3,A4,A5,A6 in degrees, or a name of [poses]: {names}"
        ),
    };
    let [a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg] = parse_six_numbers(text).map_err(wrong)?;
    Ok(Joints { a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg })
}

/// Parses six numbers, or reads a file with a pose.
fn pose(text: &str) -> Result<KukaPose, Fault> {
    if text.ends_with(".json") {
        let file = Path::new(text);
        return files::read_located(&disk::read(file)?, None).map_err(|error| Fault::file_fault(file, error));
    }
    let wrong = |problem: String| Fault::NotSixNumbers {
        found: text.to_owned(),
        what: "pose",
        problem: format!("{problem}; valid: X,Y,Z,A,B,C in mm and degrees, or a POSE.json"),
    };
    let [x_mm, y_mm, z_mm, a_deg, b_deg, c_deg] = parse_six_numbers(text).map_err(wrong)?;
    Ok(KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg })
}

/// Parses a pose that a person typed: X,Y,Z,A,B,C in mm and degrees.
///
/// # Errors
/// If the text does not have six numbers; the error states the problem and the valid format.
pub(super) fn parse_pose_argument(text: &str) -> Result<KukaPose, String> {
    let [x_mm, y_mm, z_mm, a_deg, b_deg, c_deg] =
        parse_six_numbers(text).map_err(|problem| format!("{problem}; valid: X,Y,Z,A,B,C in mm and degrees"))?;
    Ok(KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg })
}

fn parse_six_numbers(text: &str) -> Result<[f64; 6], String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|part| match part.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!("\"{}\" is not a number", part.trim())),
        })
        .collect::<Result<_, _>>()?;
    <[f64; 6]>::try_from(numbers).map_err(|numbers| format!("found {} numbers, expected six", numbers.len()))
}

fn state_to_json(state: &State, io: &InputsOutputs) -> Value {
    let signals = |named: Vec<(&str, bool)>| -> Map<String, Value> {
        named.into_iter().map(|(name, on)| (name.to_owned(), json!(on))).collect()
    };
    json!({
        "mode": state.mode.name(), "override_percent": state.override_percent, "drives_on": state.drives_on, "emergency_stop": state.emergency_stop,
        "guard_closed": state.guard_closed, "moving": state.moving, "motion_possible": state.motion_possible,
        "epoch": state.epoch.0, "stopped": state.stopped, "boot": state.boot,
        "programs_checksum": state.programs_checksum, "time_ms": state.time_ms, "underruns": state.underruns,
        "joints": state.joints, "base_from_tcp": state.base_from_tcp,
        "base": {"set": state.base_set, "pose": state.active_base},
        "tool": {"set": state.tool_set, "pose": state.flange_from_tool},
        "inputs": signals(io.decode_feedbacks(state.inputs)), "outputs": signals(io.decode_outputs(state.outputs)),
    })
}

fn describe_robot_state(state: &State, io: &InputsOutputs) -> Vec<String> {
    let yes = |on: bool| if on { "yes" } else { "no" };
    let frame = |set: bool| if set { "set in this epoch" } else { "not set in this epoch" };
    let signals = |named: Vec<(&str, bool)>| {
        let on: Vec<_> = named.into_iter().filter(|(_, on)| *on).map(|(name, _)| name).collect();
        if on.is_empty() { "none".to_owned() } else { on.join(", ") }
    };
    let Joints { a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg } = state.joints;
    let [a1, a2, a3, a4, a5, a6] =
        [a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg].map(|angle| fixed_decimals(angle, 3));
    vec![
        format!(
            "mode {}, override {} %, drives on: {}, emergency stop: {}, guard closed: {}, motion possible: {}, moving: {}",
            state.mode.name(),
            state.override_percent,
            yes(state.drives_on),
            yes(state.emergency_stop),
            yes(state.guard_closed),
            yes(state.motion_possible),
            yes(state.moving)
        ),
        format!("axes A1 {a1}° A2 {a2}° A3 {a3}° A4 {a4}° A5 {a5}° A6 {a6}°"),
        format!("tip in the active base {}", state.base_from_tcp),
        format!("base {} ({})", state.active_base, frame(state.base_set)),
        format!("tool {} ({})", state.flange_from_tool, frame(state.tool_set)),
        format!(
            "inputs on: {}; outputs on: {}",
            signals(io.decode_feedbacks(state.inputs)),
            signals(io.decode_outputs(state.outputs))
        ),
        format!("epoch {}, boot {}, checksum of the programs {}", state.epoch, state.boot, state.programs_checksum),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_is_six_finite_numbers() {
        let read = pose("1,-2.5, 3,4,5,6").expect("six");
        assert_eq!(read, KukaPose { x_mm: 1.0, y_mm: -2.5, z_mm: 3.0, a_deg: 4.0, b_deg: 5.0, c_deg: 6.0 });
        for (text, expected) in [
            ("1,2,3", "found 3 numbers, expected six"),
            ("1,2,3,4,5,NaN", "\"NaN\" is not a number"),
            ("", "\"\" is not a number"),
        ] {
            let found = pose(text).expect_err("refused").to_string();
            assert!(found.contains(expected), "{found}");
        }
    }
}
