//! Parses the statements of a routine: simple statements of one line, blocks, motions, the parts of a spline, triggers
//! and interrupts.

use super::expression::{NotRead, ReadResult, TokenReader};
use super::lex::Token;
use super::parse::Parser;
use super::syntax::{
    Action, Approximation, Call, Case, Expression, InterruptSwitch, MAX_BLOCK_DEPTH, MotionStatement, PathKind,
    Statement, TriggerPlace, VariableRef,
};

/// First keywords of valid KRL statements that this parser does not support.
const UNSUPPORTED_KEYWORDS: [&str; 8] =
    ["ANIN", "ANOUT", "DIGIN", "ASYPTP", "ASYCONT", "ASYSTOP", "ASYCANCEL", "CANCEL"];

/// The keywords that begin and end each kind of block.
const BLOCK_KEYWORDS: [(&str, &str); 8] = [
    ("IF", "ENDIF"),
    ("SWITCH", "ENDSWITCH"),
    ("FOR", "ENDFOR"),
    ("WHILE", "ENDWHILE"),
    ("REPEAT", "UNTIL"),
    ("LOOP", "ENDLOOP"),
    ("SPLINE", "ENDSPLINE"),
    ("PTP_SPLINE", "ENDSPLINE"),
];

/// Keywords of other languages, each with a message that states the correct KRL.
const FOREIGN_KEYWORDS: [(&str, &str); 5] = [
    ("ELSEIF", "KRL has no ELSEIF: write ELSE, then an IF with its own ENDIF"),
    ("ELSIF", "KRL has no ELSIF: write ELSE, then an IF with its own ENDIF"),
    ("ENDFUNCTION", "KRL has no ENDFUNCTION: end a function with ENDFCT"),
    ("FUNCTION", "KRL has no FUNCTION: begin a function with DEFFCT"),
    ("BREAK", "KRL has no BREAK: leave a loop with EXIT"),
];

/// The motion keywords, each with the path that it selects.
const MOTION_KEYWORDS: [(&str, PathKind); 14] = [
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

const APPROXIMATION_KEYWORDS: [(&str, Approximation); 5] = [
    ("C_PTP", Approximation::Ptp),
    ("C_DIS", Approximation::Distance),
    ("C_VEL", Approximation::Velocity),
    ("C_ORI", Approximation::Orientation),
    ("C_SPL", Approximation::Spline),
];

impl Parser {
    /// Parses statements up to a line that begins with one of these words; that line is not consumed.
    pub(super) fn block(&mut self, ends: &[&str]) -> Vec<Statement> {
        self.depth += 1;
        let mut found = Vec::new();
        let mut is_closed = false;
        while let Some((line, first)) = self.peek_first_word() {
            is_closed = ends.contains(&first.as_str()) && !is_label(self.next_tokens());
            if is_closed {
                break;
            }
            if self.closes_a_routine() {
                self.problem(line, &first, format!("{} is missing before this line", ends.join(" or ")));
                is_closed = true;
                break;
            }
            let action = self.statement(line, &first);
            found.push(Statement { line, action });
        }
        if !is_closed {
            let line = self.last_line_number();
            self.problem(line, "", format!("the file ends, but {} is missing", ends.join(" or ")));
        }
        self.depth -= 1;
        found
    }

    fn statement(&mut self, line: usize, first: &str) -> Action {
        let tokens = self.next_line();
        if let Some((_, last)) =
            BLOCK_KEYWORDS.iter().find(|(word, _)| *word == first).filter(|_| !is_assignment(&tokens))
        {
            if self.depth > MAX_BLOCK_DEPTH {
                let unread =
                    NotRead::NotChecked(format!("blocks are nested more than {MAX_BLOCK_DEPTH} levels deep"));
                self.report(line, &tokens, first, unread);
                self.skip_block(last);
                return Action::NotRead;
            }
            return match first {
                "IF" => self.parse_if(line, &tokens),
                "SWITCH" => self.parse_switch(line, &tokens),
                "FOR" => self.parse_for(line, &tokens),
                "WHILE" => self.parse_while(line, &tokens),
                "REPEAT" => self.parse_repeat(line, &tokens),
                "LOOP" => self.parse_loop(line, &tokens),
                _ => self.parse_spline_block(line, &tokens),
            };
        }
        let mut reader = TokenReader::new(&tokens);
        let action =
            parse_simple_statement(&mut reader, line, first).and_then(|action| reader.end().map(|()| action));
        action.unwrap_or_else(|unread| {
            self.report(line, &tokens, first, unread);
            Action::NotRead
        })
    }

    /// Skips the rest of a block, including all nested blocks.
    fn skip_block(&mut self, last: &str) {
        let mut open = 1;
        while let Some((_, first)) = self.peek_first_word() {
            if self.closes_a_routine() {
                return;
            }
            open += usize::from(BLOCK_KEYWORDS.iter().any(|(word, _)| *word == first));
            if first == last || BLOCK_KEYWORDS.iter().any(|(_, word)| *word == first) {
                open -= 1;
            }
            self.next_line();
            if open == 0 {
                return;
            }
        }
    }

    /// Parses the first line of a block, and reports a problem if it is not valid. The statements of the block are
    /// checked in any case.
    fn head<T>(
        &mut self,
        line: usize,
        tokens: &[Token],
        instead: T,
        read: impl FnOnce(&mut TokenReader<'_>) -> ReadResult<T>,
    ) -> T {
        let mut reader = TokenReader::new(tokens);
        reader.next();
        let found = read(&mut reader).and_then(|found| reader.end().map(|()| found));
        found.unwrap_or_else(|unread| {
            let key = tokens.first().map(ToString::to_string).unwrap_or_default();
            self.report(line, tokens, &key, unread);
            instead
        })
    }

    fn parse_if(&mut self, line: usize, tokens: &[Token]) -> Action {
        let condition = self.head(line, tokens, Expression::NotRead, |reader| {
            let condition = reader.expression()?;
            reader.expect_word("THEN")?;
            Ok(condition)
        });
        let then = self.block(&["ELSE", "ENDIF"]);
        let mut otherwise = Vec::new();
        if self.accept_line("ELSE") {
            otherwise = self.block(&["ENDIF"]);
        }
        self.accept_line("ENDIF");
        Action::If { condition, then, otherwise }
    }

    fn parse_switch(&mut self, line: usize, tokens: &[Token]) -> Action {
        const BLOCK_END_KEYWORDS: [&str; 3] = ["CASE", "DEFAULT", "ENDSWITCH"];
        let on = self.head(line, tokens, Expression::NotRead, |reader| reader.expression());
        let (mut cases, mut default) = (Vec::new(), None);
        if let Some((line, first)) = self.peek_first_word()
            && !BLOCK_END_KEYWORDS.contains(&first.as_str())
        {
            self.problem(line, &first, "the line after SWITCH must be CASE");
            self.block(&BLOCK_END_KEYWORDS);
        }
        while let Some((line, first)) = self.peek_first_word() {
            match first.as_str() {
                "CASE" => {
                    let tokens = self.next_line();
                    let values = self.head(line, &tokens, Vec::new(), values);
                    let body = self.block(&BLOCK_END_KEYWORDS);
                    cases.push(Case { line, values, body });
                }
                "DEFAULT" => {
                    self.accept_line("DEFAULT");
                    if default.replace(self.block(&BLOCK_END_KEYWORDS)).is_some() {
                        self.problem(line, "DEFAULT", "the SWITCH has more than one DEFAULT");
                    }
                }
                _ => {
                    self.accept_line("ENDSWITCH");
                    break;
                }
            }
        }
        Action::Switch { on, cases, default }
    }

    fn parse_for(&mut self, line: usize, tokens: &[Token]) -> Action {
        let head = self.head(line, tokens, None, |reader| parse_for_head(reader).map(Some));
        let body = self.block(&["ENDFOR"]);
        self.accept_line("ENDFOR");
        match head {
            Some(ForHead { variable, from, to, step }) => Action::For { variable, from, to, step, body },
            None => Action::While { condition: Expression::NotRead, body },
        }
    }

    fn parse_while(&mut self, line: usize, tokens: &[Token]) -> Action {
        let condition = self.head(line, tokens, Expression::NotRead, |reader| reader.expression());
        let body = self.block(&["ENDWHILE"]);
        self.accept_line("ENDWHILE");
        Action::While { condition, body }
    }

    fn parse_repeat(&mut self, line: usize, tokens: &[Token]) -> Action {
        self.head(line, tokens, (), |_| Ok(()));
        let body = self.block(&["UNTIL"]);
        let Some((until_line, _)) = self.peek_first_word().filter(|(_, first)| first == "UNTIL") else {
            return Action::Repeat { body, until: Expression::NotRead, until_line: self.last_line_number() };
        };
        let tokens = self.next_line();
        let until = self.head(until_line, &tokens, Expression::NotRead, |reader| reader.expression());
        Action::Repeat { body, until, until_line }
    }

    fn parse_loop(&mut self, line: usize, tokens: &[Token]) -> Action {
        self.head(line, tokens, (), |_| Ok(()));
        let body = self.block(&["ENDLOOP"]);
        self.accept_line("ENDLOOP");
        Action::Loop { body }
    }

    fn parse_spline_block(&mut self, line: usize, tokens: &[Token]) -> Action {
        let mut with = self.head(line, tokens, Vec::new(), parse_spline_head);
        let body = self.block(&["ENDSPLINE"]);
        if let Some((line, _)) = self.peek_first_word().filter(|(_, first)| first == "ENDSPLINE") {
            let tokens = self.next_line();
            with.extend(self.head(line, &tokens, Vec::new(), parse_spline_head));
        }
        Action::Spline { with, body }
    }
}

/// Returns whether a line is a label: only `NAME:`.
fn is_label(tokens: &[Token]) -> bool {
    matches!(tokens, [Token::Name(_), Token::Sign(":")])
}

/// Returns whether a line is an assignment: it begins with `NAME=`, `NAME[` or `NAME.`.
fn is_assignment(tokens: &[Token]) -> bool {
    matches!(tokens, [Token::Name(_), Token::Sign("=" | "[" | "."), ..])
}

fn values(reader: &mut TokenReader<'_>) -> ReadResult<Vec<Expression>> {
    let mut values = vec![reader.expression()?];
    while reader.accept_sign(",") {
        values.push(reader.expression()?);
    }
    Ok(values)
}

struct ForHead {
    variable: VariableRef,
    from: Expression,
    to: Expression,
    step: Option<Expression>,
}

fn parse_for_head(reader: &mut TokenReader<'_>) -> ReadResult<ForHead> {
    let variable = reader.parse_variable()?;
    reader.sign("=")?;
    let from = reader.expression()?;
    reader.expect_word("TO")?;
    let to = reader.expression()?;
    let step = if reader.accept_word("STEP") { Some(reader.expression()?) } else { None };
    Ok(ForHead { variable, from, to, step })
}

fn parse_simple_statement(reader: &mut TokenReader<'_>, line: usize, first: &str) -> ReadResult<Action> {
    match reader.peek_ahead(1) {
        Some(Token::Sign("=" | "[" | ".")) => {
            let to = reader.parse_variable()?;
            reader.sign("=")?;
            return Ok(Action::Assign { to, value: reader.expression()? });
        }
        Some(Token::Sign("(")) if !matches!(first, "RETURN" | "CONFIRM") => {
            return Ok(Action::Call(reader.call()?));
        }
        Some(Token::Sign(":")) if reader.peek_ahead(2).is_none() => {
            let name = reader.name()?;
            reader.next();
            return Ok(Action::Label(name));
        }
        Some(Token::Sign(":")) if matches!(reader.peek_ahead(2), Some(Token::Sign("="))) => {
            return Err("KRL assigns with '=', not with ':='".into());
        }
        _ => {}
    }
    let Some(Token::Name(_)) = reader.next() else {
        return Err(format!("a statement cannot begin with '{first}'").into());
    };
    match first {
        "RETURN" => {
            Ok(Action::Return(if reader.peek_token().is_some() { Some(reader.expression()?) } else { None }))
        }
        "EXIT" => Ok(Action::Exit),
        "HALT" => Ok(Action::Halt),
        "ON_ERROR_PROCEED" => Ok(Action::Call(Call { name: first.to_owned(), arguments: Vec::new() })),
        "CONTINUE" => Ok(Action::Continue),
        "RESUME" => Ok(Action::Resume),
        "BRAKE" => Ok(Action::Brake { fast: reader.accept_word("F") }),
        "GOTO" => Ok(Action::Goto(reader.name()?)),
        "CONFIRM" => Ok(Action::Checked { word: "CONFIRM", values: vec![(reader.expression()?, "INT")] }),
        "GLOBAL" => {
            reader.expect_word("INTERRUPT")?;
            interrupt(reader, true)
        }
        "INTERRUPT" => interrupt(reader, false),
        "TRIGGER" => trigger(reader, line),
        "WAIT" if reader.accept_word("SEC") => Ok(Action::WaitSeconds(reader.expression()?)),
        "WAIT" if reader.accept_word("FOR") => Ok(Action::WaitFor(reader.expression()?)),
        "WAIT" => Err(format!("expected SEC or FOR after WAIT, found {}", reader.describe_next()).into()),
        "CASE" | "DEFAULT" => Err("CASE and DEFAULT are valid only inside a SWITCH".into()),
        "DECL" | "INT" | "REAL" | "BOOL" | "CHAR" | "STRUC" | "ENUM" | "EXT" | "EXTFCT" | "SIGNAL" => {
            Err("a declaration follows a statement; move all declarations before the first statement".into())
        }
        _ => parse_motion_or_spline(reader, first),
    }
}

/// Parses a motion or a part of a spline; any other line is reported as not valid.
fn parse_motion_or_spline(reader: &mut TokenReader<'_>, first: &str) -> ReadResult<Action> {
    if let Some(found) = motion(reader, first).or_else(|| parse_spline_part(reader, first)) {
        return found;
    }
    if first == "ELSE" || BLOCK_KEYWORDS.iter().any(|(_, last)| *last == first) {
        return Err("the line ends or continues a block, but no such block is open".into());
    }
    if let Some((_, instead)) = FOREIGN_KEYWORDS.iter().find(|(word, _)| *word == first) {
        return Err((*instead).into());
    }
    let message = match reader.peek_token() {
        _ if UNSUPPORTED_KEYWORDS.contains(&first) => {
            format!("{first} is a KRL statement that this parser does not support")
        }
        None => {
            return Err(format!("the line is not a KRL statement; to call a routine, write {first}( )").into());
        }
        Some(_) => format!("this parser supports no statement that begins with {first}"),
    };
    reader.skip_line();
    Err(NotRead::NotChecked(message))
}

/// Parses the rest of a motion after its first keyword; `None` if the keyword does not begin a motion.
fn motion(reader: &mut TokenReader<'_>, first: &str) -> Option<ReadResult<Action>> {
    let (word, path) = MOTION_KEYWORDS.iter().find(|(word, _)| *word == first)?;
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

/// Parses one option after the target of a motion; returns false if the next token is not an option.
fn parse_motion_options(reader: &mut TokenReader<'_>, motion: &mut MotionStatement) -> ReadResult<bool> {
    if let Some((_, approximation)) = APPROXIMATION_KEYWORDS.iter().find(|(word, _)| reader.accept_word(word)) {
        motion.approximates.push(*approximation);
    } else if reader.accept_word("WITH") {
        motion.with.extend(settings(reader)?);
    } else if reader.is_sign(",") && matches!(reader.peek_ahead(1), Some(Token::Name(name)) if name == "CA") {
        reader.next();
        reader.next();
        reader.accept_sign("=");
        motion.angle = Some(reader.expression()?);
    } else if matches!(reader.peek_token(), Some(Token::Word(_))) {
        // `#BASE` or `#TOOL` selects the reference frame of a relative motion.
        reader.next();
    } else {
        return Ok(false);
    }
    Ok(true)
}

/// Reads `$VEL.CP=0.2,$TOOL=TOOL_DATA[1]`.
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

/// Parses the settings that may follow SPLINE and ENDSPLINE.
fn parse_spline_head(reader: &mut TokenReader<'_>) -> ReadResult<Vec<(VariableRef, Expression)>> {
    let mut with = Vec::new();
    loop {
        if reader.accept_word("WITH") {
            with.extend(settings(reader)?);
        } else if !reader.accept_word("C_SPL") && !reader.accept_word("C_PTP") && !reader.accept_word("C_DIS") {
            return Ok(with);
        }
    }
}

/// Parses a line of a spline block that is not a segment, after its first word; `None` if the word begins another
/// statement.
fn parse_spline_part(reader: &mut TokenReader<'_>, first: &str) -> Option<ReadResult<Action>> {
    match first {
        "TIME_BLOCK" => Some(parse_bounded_part(reader, "TIME_BLOCK", &["START", "PART", "END"])),
        "CONST_VEL" => Some(parse_bounded_part(reader, "CONST_VEL", &["START", "END"])),
        "STOP" => Some(parse_conditional_stop(reader)),
        _ => None,
    }
}

/// Parses a line such as `TIME_BLOCK PART=40` or `CONST_VEL START=5 ONSTART`.
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

/// Parses a conditional stop, such as `STOP WHEN PATH=50 ONSTART IF $IN[3]`.
fn parse_conditional_stop(reader: &mut TokenReader<'_>) -> ReadResult<Action> {
    reader.expect_word("WHEN")?;
    reader.expect_word("PATH")?;
    reader.sign("=")?;
    let path = reader.expression()?;
    reader.accept_word("ONSTART");
    reader.expect_word("IF")?;
    Ok(Action::Checked { word: "STOP WHEN", values: vec![(path, "REAL"), (reader.expression()?, "BOOL")] })
}

/// Parses an interrupt statement after its first keyword: `INTERRUPT DECL 20 WHEN $FLAG[1] DO NAME( )`, `INTERRUPT WITH
/// BRAKE DECL …` or `INTERRUPT ON 20`.
fn interrupt(reader: &mut TokenReader<'_>, global: bool) -> ReadResult<Action> {
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

/// Parses a trigger after its first keyword: `TRIGGER WHEN DISTANCE=1 DELAY=0 DO NAME( ) PRIO=-1`, or with `PATH=`, or
/// with an assignment after DO.
fn trigger(reader: &mut TokenReader<'_>, line: usize) -> ReadResult<Action> {
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
