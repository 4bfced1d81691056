//! Reads motions, the parts of a spline, triggers and interrupts.

use super::expression::{Read, Reader, Unread};
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
pub(super) fn motion(reader: &mut Reader<'_>, first: &str) -> Option<Read<Action>> {
    let (word, path) = MOTIONS.iter().find(|(word, _)| *word == first)?;
    Some(motion_of(reader, word, *path))
}

fn motion_of(reader: &mut Reader<'_>, word: &'static str, path: PathKind) -> Read<Action> {
    if reader.is_sign("!") {
        reader.skip_line();
        return Err(Unread::NotChecked("the target of the motion is not taught yet ('!')".to_owned()));
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
    while reader.peek().is_some() && more(reader, &mut motion)? {}
    if word == "LIN" && motion.approximates.contains(&Approximation::Ptp) {
        return Err(Unread::NotChecked(
            "approximate a LIN motion with C_DIS, C_VEL or C_ORI; C_PTP is valid only for PTP".to_owned(),
        ));
    }
    Ok(Action::Motion(Box::new(motion)))
}

/// Reads the parts that may follow the target; false if the next token is none of them.
fn more(reader: &mut Reader<'_>, motion: &mut MotionStatement) -> Read<bool> {
    if let Some((_, approximation)) = APPROXIMATIONS.iter().find(|(word, _)| reader.takes_word(word)) {
        motion.approximates.push(*approximation);
    } else if reader.takes_word("WITH") {
        motion.with.extend(settings(reader)?);
    } else if reader.is_sign(",") && matches!(reader.peek_behind(1), Some(Token::Name(name)) if name == "CA") {
        reader.next();
        reader.next();
        reader.takes_sign("=");
        motion.angle = Some(reader.expression()?);
    } else if matches!(reader.peek(), Some(Token::Word(_))) {
        // `#BASE` or `#TOOL`: the reference of a relative motion.
        reader.next();
    } else {
        return Ok(false);
    }
    Ok(true)
}

/// `$VEL.CP=0.2,$TOOL=TOOL_DATA[1]`
fn settings(reader: &mut Reader<'_>) -> Read<Vec<(VariableRef, Expression)>> {
    let mut settings = Vec::new();
    loop {
        let to = reader.place()?;
        reader.sign("=")?;
        settings.push((to, reader.expression()?));
        if !reader.takes_sign(",") {
            return Ok(settings);
        }
    }
}

/// Reads what may follow SPLINE and ENDSPLINE.
pub(super) fn spline_head(reader: &mut Reader<'_>) -> Read<Vec<(VariableRef, Expression)>> {
    let mut with = Vec::new();
    loop {
        if reader.takes_word("WITH") {
            with.extend(settings(reader)?);
        } else if !reader.takes_word("C_SPL") && !reader.takes_word("C_PTP") && !reader.takes_word("C_DIS") {
            return Ok(with);
        }
    }
}

/// Reads a part of a spline other than its motions, after its first word; `None` if it is no such part.
pub(super) fn spline_part(reader: &mut Reader<'_>, first: &str) -> Option<Read<Action>> {
    match first {
        "TIME_BLOCK" => Some(bounded(reader, "TIME_BLOCK", &["START", "PART", "END"])),
        "CONST_VEL" => Some(bounded(reader, "CONST_VEL", &["START", "END"])),
        "STOP" => Some(conditional_stop(reader)),
        _ => None,
    }
}

/// Reads `TIME_BLOCK PART=40`, `CONST_VEL START=5 ONSTART`.
fn bounded(reader: &mut Reader<'_>, word: &'static str, kinds: &[&str]) -> Read<Action> {
    if !kinds.iter().any(|kind| reader.takes_word(kind)) {
        return Err(format!("expected {} after {word}, found {}", kinds.join(" or "), reader.found()).into());
    }
    let mut values = Vec::new();
    if reader.takes_sign("=") {
        values.push((reader.expression()?, "REAL"));
        reader.takes_word("ONSTART");
    }
    Ok(Action::Checked { word, values })
}

/// Reads `STOP WHEN PATH=50 ONSTART IF $IN[3]`.
fn conditional_stop(reader: &mut Reader<'_>) -> Read<Action> {
    reader.word("WHEN")?;
    reader.word("PATH")?;
    reader.sign("=")?;
    let path = reader.expression()?;
    reader.takes_word("ONSTART");
    reader.word("IF")?;
    Ok(Action::Checked { word: "STOP WHEN", values: vec![(path, "REAL"), (reader.expression()?, "BOOL")] })
}

/// Reads `INTERRUPT DECL 20 WHEN $FLAG[1] DO NAME( )`, `INTERRUPT WITH BRAKE DECL …`, `INTERRUPT ON 20`, after the
/// first keyword.
pub(super) fn interrupt(reader: &mut Reader<'_>, global: bool) -> Read<Action> {
    let with_brake = reader.takes_word("WITH");
    if with_brake {
        reader.word("BRAKE")?;
    }
    if reader.takes_word("DECL") {
        let number = reader.expression()?;
        reader.word("WHEN")?;
        let condition = reader.expression()?;
        reader.word("DO")?;
        let call = reader.call()?;
        return Ok(Action::InterruptDeclaration { global, with_brake, number, condition, call });
    }
    if global || with_brake {
        return Err(format!("expected DECL after INTERRUPT, found {}", reader.found()).into());
    }
    let switches = [
        ("ON", InterruptSwitch::On),
        ("OFF", InterruptSwitch::Off),
        ("ENABLE", InterruptSwitch::Enable),
        ("DISABLE", InterruptSwitch::Disable),
    ];
    let Some((_, how)) = switches.into_iter().find(|(word, _)| reader.takes_word(word)) else {
        let found = reader.found();
        return Err(format!("expected DECL, ON, OFF, ENABLE or DISABLE after INTERRUPT, found {found}").into());
    };
    let number = if reader.peek().is_some() { Some(reader.expression()?) } else { None };
    Ok(Action::InterruptSwitch { how, number })
}

/// Reads `TRIGGER WHEN DISTANCE=1 DELAY=0 DO NAME( ) PRIO=-1`, or with `PATH=` and an assignment behind DO, after
/// the first keyword.
pub(super) fn trigger(reader: &mut Reader<'_>, line: usize) -> Read<Action> {
    reader.word("WHEN")?;
    let at = if reader.takes_word("PATH") {
        reader.sign("=")?;
        let path = TriggerPlace::Path(reader.expression()?);
        reader.takes_word("ONSTART");
        path
    } else {
        if !reader.takes_word("DISTANCE") {
            let found = reader.found();
            return Err(format!("expected DISTANCE or PATH after TRIGGER WHEN, found {found}").into());
        }
        reader.sign("=")?;
        TriggerPlace::Distance(reader.expression()?)
    };
    let mut delay = None;
    if reader.takes_word("DELAY") {
        reader.sign("=")?;
        delay = Some(reader.expression()?);
    }
    reader.word("DO")?;
    let is_call = matches!(reader.peek_behind(1), Some(Token::Sign("(")));
    let action = if is_call {
        Action::Call(reader.call()?)
    } else {
        let to = reader.place()?;
        reader.sign("=")?;
        Action::Assign { to, value: reader.expression()? }
    };
    let mut priority = None;
    if reader.takes_word("PRIO") {
        reader.sign("=")?;
        priority = Some(reader.expression()?);
    } else if matches!(&action, Action::Call(call) if call.name != "PULSE") {
        return Err("a TRIGGER that calls a routine needs PRIO".into());
    }
    Ok(Action::Trigger { at, delay, action: Box::new(Statement { line, action }), priority })
}
