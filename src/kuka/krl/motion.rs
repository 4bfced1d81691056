//! Reads motions, the parts of a spline, triggers and interrupts.

use super::expression::{NotRead, ReadResult, TokenReader};
use super::lex::Token;
use super::syntax::{
    Action, Approximation, Expression, InterruptSwitch, MotionStatement, PathKind, Statement, TriggerPlace,
    VariableRef,
};

/// Motions: the first keyword, and the path.
const MOTIONS: [(&str, PathKind); 14] = [
    ("PTP", PathKind::Joint),
    ("LIN", PathKind::Line),
    ("CIRC", PathKind::Circle),
    ("PTP_REL", PathKind::Joint),
    ("LIN_REL", PathKind::Line),
    ("CIRC_REL", PathKind::Circle),
    ("SPTP", PathKind::Joint),
    ("SLIN", PathKind::Line),
    ("SCIRC", PathKind::Circle),
    ("SPL", PathKind::Curve),
    ("SPTP_REL", PathKind::Joint),
    ("SLIN_REL", PathKind::Line),
    ("SCIRC_REL", PathKind::Circle),
    ("SPL_REL", PathKind::Curve),
];

const APPROXIMATIONS: [(&str, Approximation); 5] = [
    ("C_PTP", Approximation::Ptp),
    ("C_DIS", Approximation::Distance),
    ("C_VEL", Approximation::Velocity),
    ("C_ORI", Approximation::Orientation),
    ("C_SPL", Approximation::Spline),
];

/// Reads a motion after its first keyword; `None` if the keyword does not begin a motion.
pub(super) fn motion(reader: &mut TokenReader<'_>, first: &str) -> Option<ReadResult<Action>> {
    let (word, path) = MOTIONS.iter().find(|(word, _)| *word == first)?;
    Some(parse_motion(reader, word, *path))
}

fn parse_motion(reader: &mut TokenReader<'_>, word: &'static str, path: PathKind) -> ReadResult<Action> {
    if reader.is_sign("!") {
        reader.skip_line();
        return Err(NotRead::NotChecked("the target of the motion is not taught yet ('!')".to_owned()));
    }
    let mut target = reader.expression()?;
    let mut auxiliary = None;
    if path == PathKind::Circle {
        reader.sign(",")?;
        auxiliary = Some(target);
        target = reader.expression()?;
    }
    let mut motion =
        MotionStatement { word, path, auxiliary, target, angle: None, approximates: Vec::new(), with: Vec::new() };
    while reader.peek_token().is_some() && parse_motion_options(reader, &mut motion)? {}
    if word == "LIN" && motion.approximates.contains(&Approximation::Ptp) {
        return Err(NotRead::NotChecked(
            "approximate a LIN motion with C_DIS, C_VEL or C_ORI; C_PTP is valid only for PTP".to_owned(),
        ));
    }
    Ok(Action::Motion(Box::new(motion)))
}

/// Reads the parts that may follow the target; false if the next token is none of them.
fn parse_motion_options(reader: &mut TokenReader<'_>, motion: &mut MotionStatement) -> ReadResult<bool> {
    if let Some((_, approximation)) = APPROXIMATIONS.iter().find(|(word, _)| reader.accept_word(word)) {
        motion.approximates.push(*approximation);
    } else if reader.accept_word("WITH") {
        motion.with.extend(settings(reader)?);
    } else if reader.is_sign(",") && matches!(reader.peek_ahead(1), Some(Token::Name(name)) if name == "CA") {
        reader.next();
        reader.next();
        reader.accept_sign("=");
        motion.angle = Some(reader.expression()?);
    } else if matches!(reader.peek_token(), Some(Token::Word(_))) {
        // `#BASE` or `#TOOL`: the reference of a relative motion.
        reader.next();
    } else {
        return Ok(false);
    }
    Ok(true)
}

/// `$VEL.CP=0.2,$TOOL=TOOL_DATA[1]`
fn settings(reader: &mut TokenReader<'_>) -> ReadResult<Vec<(VariableRef, Expression)>> {
    let mut settings = Vec::new();
    loop {
        let to = reader.parse_variable()?;
        reader.sign("=")?;
        settings.push((to, reader.expression()?));
        if !reader.accept_sign(",") {
            return Ok(settings);
        }
    }
}

/// Reads what may follow SPLINE and ENDSPLINE.
pub(super) fn parse_spline_head(reader: &mut TokenReader<'_>) -> ReadResult<Vec<(VariableRef, Expression)>> {
    let mut with = Vec::new();
    loop {
        if reader.accept_word("WITH") {
            with.extend(settings(reader)?);
        } else if !reader.accept_word("C_SPL") && !reader.accept_word("C_PTP") && !reader.accept_word("C_DIS") {
            return Ok(with);
        }
    }
}

/// Reads a part of a spline other than its motions, after its first word; `None` if it is not such a part.
pub(super) fn spline_part(reader: &mut TokenReader<'_>, first: &str) -> Option<ReadResult<Action>> {
    match first {
        "TIME_BLOCK" => Some(parse_bounded_part(reader, "TIME_BLOCK", &["START", "PART", "END"])),
        "CONST_VEL" => Some(parse_bounded_part(reader, "CONST_VEL", &["START", "END"])),
        "STOP" => Some(conditional_stop(reader)),
        _ => None,
    }
}

/// Reads `TIME_BLOCK PART=40`, `CONST_VEL START=5 ONSTART`.
fn parse_bounded_part(reader: &mut TokenReader<'_>, word: &'static str, kinds: &[&str]) -> ReadResult<Action> {
    if !kinds.iter().any(|kind| reader.accept_word(kind)) {
        return Err(
            format!("expected {} after {word}, found {}", kinds.join(" or "), reader.describe_next()).into()
        );
    }
    let mut values = Vec::new();
    if reader.accept_sign("=") {
        values.push((reader.expression()?, "REAL"));
        reader.accept_word("ONSTART");
    }
    Ok(Action::Checked { word, values })
}

/// Reads `STOP WHEN PATH=50 ONSTART IF $IN[3]`.
fn conditional_stop(reader: &mut TokenReader<'_>) -> ReadResult<Action> {
    reader.expect_word("WHEN")?;
    reader.expect_word("PATH")?;
    reader.sign("=")?;
    let path = reader.expression()?;
    reader.accept_word("ONSTART");
    reader.expect_word("IF")?;
    Ok(Action::Checked { word: "STOP WHEN", values: vec![(path, "REAL"), (reader.expression()?, "BOOL")] })
}

/// Reads `INTERRUPT DECL 20 WHEN $FLAG[1] DO NAME( )`, `INTERRUPT WITH BRAKE DECL …`, `INTERRUPT ON 20`, after the
/// first keyword.
pub(super) fn interrupt(reader: &mut TokenReader<'_>, global: bool) -> ReadResult<Action> {
    let with_brake = reader.accept_word("WITH");
    if with_brake {
        reader.expect_word("BRAKE")?;
    }
    if reader.accept_word("DECL") {
        let number = reader.expression()?;
        reader.expect_word("WHEN")?;
        let condition = reader.expression()?;
        reader.expect_word("DO")?;
        let call = reader.call()?;
        return Ok(Action::InterruptDeclaration { global, with_brake, number, condition, call });
    }
    if global || with_brake {
        return Err(format!("expected DECL after INTERRUPT, found {}", reader.describe_next()).into());
    }
    let switches = [
        ("ON", InterruptSwitch::On),
        ("OFF", InterruptSwitch::Off),
        ("ENABLE", InterruptSwitch::Enable),
        ("DISABLE", InterruptSwitch::Disable),
    ];
    let Some((_, how)) = switches.into_iter().find(|(word, _)| reader.accept_word(word)) else {
        let found = reader.describe_next();
        return Err(format!("expected DECL, ON, OFF, ENABLE or DISABLE after INTERRUPT, found {found}").into());
    };
    let number = if reader.peek_token().is_some() { Some(reader.expression()?) } else { None };
    Ok(Action::InterruptSwitch { how, number })
}

/// Reads `TRIGGER WHEN DISTANCE=1 DELAY=0 DO NAME( ) PRIO=-1`, or with `PATH=` and an assignment behind DO, after
/// the first keyword.
pub(super) fn trigger(reader: &mut TokenReader<'_>, line: usize) -> ReadResult<Action> {
    reader.expect_word("WHEN")?;
    let at = if reader.accept_word("PATH") {
        reader.sign("=")?;
        let path = TriggerPlace::Path(reader.expression()?);
        reader.accept_word("ONSTART");
        path
    } else {
        if !reader.accept_word("DISTANCE") {
            let found = reader.describe_next();
            return Err(format!("expected DISTANCE or PATH after TRIGGER WHEN, found {found}").into());
        }
        reader.sign("=")?;
        TriggerPlace::Distance(reader.expression()?)
    };
    let mut delay = None;
    if reader.accept_word("DELAY") {
        reader.sign("=")?;
        delay = Some(reader.expression()?);
    }
    reader.expect_word("DO")?;
    let is_call = matches!(reader.peek_ahead(1), Some(Token::Sign("(")));
    let action = if is_call {
        Action::Call(reader.call()?)
    } else {
        let to = reader.parse_variable()?;
        reader.sign("=")?;
        Action::Assign { to, value: reader.expression()? }
    };
    let mut priority = None;
    if reader.accept_word("PRIO") {
        reader.sign("=")?;
        priority = Some(reader.expression()?);
    } else if matches!(&action, Action::Call(call) if call.name != "PULSE") {
        return Err("a TRIGGER that calls a routine needs PRIO".into());
    }
    Ok(Action::Trigger { at, delay, action: Box::new(Statement { line, action }), priority })
}
