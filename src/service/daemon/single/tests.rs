use super::*;
use crate::daemon::ports::{Port, RobotAnswer, RobotCommand};
use crate::daemon::tests::standing_state;
use panelprep_kuka::eki::TcpKind;

const AT: Joints = Joints { a1_deg: 20.0, a2_deg: -90.0, a3_deg: 90.0, a4_deg: 0.0, a5_deg: 60.0, a6_deg: 0.0 };

/// A controller that always reports this state, and must never receive a command.
struct FixedStateRobot(State);

impl Port<RobotCommand> for FixedStateRobot {
    fn perform(&mut self, command: RobotCommand) -> RobotAnswer {
        match command {
            RobotCommand::Next => RobotAnswer::Report(Ok(Some(Report::State(Box::new(self.0))))),
            RobotCommand::Now => RobotAnswer::Time(Time::from_ms(0)),
            other => panic!("{other:?} is sent"),
        }
    }
}

/// Three states that do not belong to the arm in the cell's file: a TCP that is 205 mm farther away, another position
/// of the robot root, and axes in radians. In none of them is a motion of the axes or a subroutine started.
#[test]
fn an_arm_other_than_the_cells_does_not_move() {
    let cell = Cell::check("cell.toml", "").expect("good");
    let tip = KukaPose::from_rigid(&Kinematics::new(cell.arm()).base_from_flange(&AT).expect("finite"));
    let state = State { joints: AT, base_from_tcp: tip, ..standing_state() };
    let single = |state: State| FixedStateRobot(state);
    let mut right = single(state);
    assert_eq!(SingleRobot::connect(&mut right, cell.arm()).expect("it answers").check_arm_identity(&cell), Ok(()));
    let farther = KukaPose { x_mm: tip.x_mm + 205.0, ..tip };
    let radians = Joints::from(AT.degrees().map(f64::to_radians));
    let root = KukaPose { z_mm: 300.0, ..KukaPose::default() };
    for state in [
        State { base_from_tcp: farther, ..state },
        State { joints: radians, ..state },
        State { active_base: root, ..state },
    ] {
        let mut robot = single(state);
        let mut single = SingleRobot::connect(&mut robot, cell.arm()).expect("it answers");
        for refused in [single.move_joints(AT, 10, &cell), single.call(1, &cell)] {
            let Err(SingleError::Gate(judgement)) = refused else { panic!("{refused:?}") };
            assert_eq!(judgement.reasons[0].code, "arm_model");
        }
    }
}

/// Without a signed stage, a real controller moves only in T1, even at an address of this computer.
#[test]
fn a_motion_in_automatic_mode_needs_stage_a() {
    use panelprep_cell::cell::SignedPage;
    let unsigned = |host: &str| {
        Cell::check(
            "cell.toml",
            &format!("[robot]\nkind = 'eki'\nhost = '{host}'\nprograms_sum = 1\n[io.outputs]\nspray = 3\n"),
        )
        .unwrap_or_else(|problems| panic!("{problems}"))
    };
    let text =
        "[robot]\nkind = 'eki'\nhost = 'krc'\nprograms_sum = 1\nsigned_stage = 'A'\n[io.outputs]\nspray = 3\n";
    let signed = Cell::check("cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
    let signed =
        signed.with_signed_page(Some(SignedPage { stage: ProofStage::A, programs_sum: 1, wrong_since: None }));
    let (real_boot, mock_boot) = (820_000_000, 1);
    for (mode, boot, cell, permitted) in [
        (Mode::T1, real_boot, unsigned("krc"), true),
        (Mode::Automatic, real_boot, unsigned("krc"), false),
        (Mode::External, real_boot, unsigned("krc"), false),
        (Mode::External, real_boot, unsigned("127.0.0.1"), false),
        (Mode::External, mock_boot, unsigned("127.0.0.1"), true),
        (Mode::Automatic, real_boot, signed, true),
    ] {
        let mut robot = FixedStateRobot(State { joints: AT, mode, boot, ..standing_state() });
        let mut single = SingleRobot::connect(&mut robot, cell.arm()).expect("it answers");
        let mut acts = vec![single.move_joints(AT, 10, &cell), single.call(0, &cell)];
        // If water is permitted, the next step is the epoch, which this robot does not open.
        if !permitted {
            acts.push(single.set_output("spray", true, &cell, Duration::ZERO));
        }
        for moved in acts {
            let Err(SingleError::Gate(judgement)) = moved else { panic!("another gate refuses: {moved:?}") };
            let is_unsigned = judgement.reasons.iter().any(|reason| reason.code == "stage_not_signed");
            assert_eq!(!is_unsigned, permitted, "{mode:?} {boot}: {judgement:?}");
        }
        assert_eq!(single.check_proofs(&cell).is_ok(), permitted, "{mode:?} {boot}");
    }
}

/// With another checksum than the accepted one, every function that sends a command is refused, and nothing is sent.
/// With the accepted checksum, the next check decides.
#[test]
fn nothing_is_sent_to_programs_that_were_not_accepted() {
    let text = |sum: i32| {
        format!(
            "[robot]\nkind = \"eki\"\nhost = \"krc\"\nprograms_sum = {sum}\n[io.outputs]\nlight = 1\ntool = 5\n"
        )
    };
    let cell_of = |sum| Cell::check("cell.toml", &text(sum)).unwrap_or_else(|problems| panic!("{problems}"));
    let state = State { joints: AT, programs_checksum: 5, ..standing_state() };
    let refused = |act: &dyn Fn(&mut SingleRobot<'_>) -> Result<(), SingleError>, cell: &Cell| {
        let mut robot = FixedStateRobot(state);
        let mut single = SingleRobot::connect(&mut robot, cell.arm()).expect("it answers");
        let Err(SingleError::Gate(judgement)) = act(&mut single) else { panic!("not refused") };
        judgement.reasons.into_iter().map(|reason| reason.code.into_owned()).collect::<Vec<_>>()
    };
    let line = SingleLine {
        target: KukaPose::default(),
        base: KukaPose::default(),
        tool: SetTcp { flange_from_tool: KukaPose::default(), kind: TcpKind::Other },
        speed_mm_s: 10.0,
    };
    let other = cell_of(6);
    let acts: [&dyn Fn(&mut SingleRobot<'_>) -> Result<(), SingleError>; 9] = [
        &|single| single.move_joints(AT, 10, &other),
        &|single| single.move_line(&line, &other),
        &|single| single.call(0, &other),
        &|single| single.set_output("light", true, &other, Duration::ZERO),
        &|single| single.set_output("tool", false, &other, Duration::ZERO),
        &|single| single.set(Command::SetBase(KukaPose::default()), &other),
        &|single| single.set(Command::SetTcp(line.tool), &other),
        &|single| single.set(speed_command(10.0, 1.0, 10), &other),
        &|single| single.set(Command::SetDigin(Signal { number: 33, on: true }), &other),
    ];
    for (place, act) in acts.iter().enumerate() {
        assert_eq!(refused(act, &other), ["other_programs"], "{place}");
    }
    let same = cell_of(5);
    assert_eq!(refused(&|single| single.move_joints(AT, 10, &same), &same), ["arm_model"]);
}
