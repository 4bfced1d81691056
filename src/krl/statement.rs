//! Reads the statements of a routine: one line each, blocks from their first word to their last.

use super::expression::Reader;
use super::lex::Token;
use super::parse::Parser;
use super::syntax::{Action, Approximation, Call, Case, Expression, Motion, Statement};

/// First words of statements and declarations that this reader leaves out; a controller reads them.
const OUTSIDE: [&str; 33] = [
    "GOTO",
    "CIRC",
    "CIRC_REL",
    "PTP_REL",
    "LIN_REL",
    "SPLINE",
    "ENDSPLINE",
    "SPTP",
    "SLIN",
    "SCIRC",
    "SPL",
    "PTP_SPLINE",
    "PULSE",
    "ANIN",
    "ANOUT",
    "SIGNAL",
    "CHANNEL",
    "CREAD",
    "COPEN",
    "CCLOSE",
    "CWAIT",
    "CONST_VEL",
    "TIME_BLOCK",
    "STOP",
    "IMPORT",
    "CONFIRM",
    "SPTP_REL",
    "SLIN_REL",
    "SCIRC_REL",
    "ASYPTP",
    "ASYCONT",
    "ASYSTOP",
    "ASYCANCEL",
];

impl Parser {
    /// Statements up to a line that begins with one of these words, which is left where it is.
    pub(super) fn block(&mut self, ends: &[&str]) -> Vec<Statement> {
        let mut found = Vec::new();
        while let Some((line, first)) = self.first_word() {
            if ends.contains(&first.as_str()) {
                return found;
            }
            if self.closes_a_routine(&first) {
                self.problem(line, &first, format!("{} is missing before this line", ends.join(" or ")));
                return found;
            }
            match self.statement(line, &first) {
                Ok(statement) => found.push(statement),
                Err(message) => self.problem(line, &first, message),
            }
        }
        let line = self.last_line();
        self.problem(line, "", format!("the file ends before {}", ends.join(" or ")));
        found
    }

    fn statement(&mut self, line: usize, first: &str) -> Result<Statement, String> {
        let tokens = self.take_line();
        let mut reader = Reader::new(&tokens);
        let opens = matches!(first, "IF" | "SWITCH" | "FOR" | "WHILE" | "REPEAT" | "LOOP");
        let action = match first {
            "IF" => self.if_block(&mut reader),
            "SWITCH" => self.switch_block(&mut reader),
            "FOR" => self.for_block(&mut reader),
            "WHILE" => self.while_block(&mut reader),
            "REPEAT" => self.repeat_block(&mut reader),
            "LOOP" => self.loop_block(&mut reader),
            _ => simple(&mut reader, line, first),
        }?;
        if !opens {
            reader.end()?;
        }
        Ok(Statement { line, action })
    }

    fn if_block(&mut self, reader: &mut Reader<'_>) -> Result<Action, String> {
        reader.next();
        let condition = reader.expression().and_then(|condition| {
            reader.word("THEN")?;
            reader.end().map(|()| condition)
        });
        let then = self.block(&["ELSE", "ENDIF"]);
        let mut otherwise = Vec::new();
        if self.next_line_is("ELSE") {
            otherwise = self.block(&["ENDIF"]);
        }
        self.next_line_is("ENDIF");
        Ok(Action::If { condition: condition?, then, otherwise })
    }

    fn switch_block(&mut self, reader: &mut Reader<'_>) -> Result<Action, String> {
        const ENDS: [&str; 3] = ["CASE", "DEFAULT", "ENDSWITCH"];
        reader.next();
        let on = reader.expression().and_then(|on| reader.end().map(|()| on));
        let (mut cases, mut default) = (Vec::new(), None);
        let mut wrong = None;
        if let Some((line, first)) = self.first_word()
            && !ENDS.contains(&first.as_str())
        {
            self.problem(line, &first, "behind SWITCH the next line must be CASE".to_owned());
            self.block(&ENDS);
        }
        while let Some((line, first)) = self.first_word() {
            match first.as_str() {
                "CASE" => {
                    let tokens = self.take_line();
                    let mut reader = Reader::new(&tokens);
                    reader.next();
                    let values = values(&mut reader);
                    let body = self.block(&ENDS);
                    match values {
                        Ok(values) => cases.push(Case { line, values, body }),
                        Err(message) => self.problem(line, "CASE", message),
                    }
                }
                "DEFAULT" => {
                    self.take_line();
                    if default.replace(self.block(&ENDS)).is_some() {
                        wrong = Some((line, "DEFAULT stands twice in one SWITCH"));
                    }
                }
                _ => {
                    self.next_line_is("ENDSWITCH");
                    break;
                }
            }
        }
        if let Some((line, message)) = wrong {
            self.problem(line, "DEFAULT", message.to_owned());
        }
        if cases.is_empty() {
            return Err("SWITCH has no CASE".to_owned());
        }
        Ok(Action::Switch { on: on?, cases, default })
    }

    fn for_block(&mut self, reader: &mut Reader<'_>) -> Result<Action, String> {
        reader.next();
        let head = for_head(reader);
        let body = self.block(&["ENDFOR"]);
        self.next_line_is("ENDFOR");
        let (variable, from, to, step) = head?;
        Ok(Action::For { variable, from, to, step, body })
    }

    fn while_block(&mut self, reader: &mut Reader<'_>) -> Result<Action, String> {
        reader.next();
        let condition = reader.expression().and_then(|condition| reader.end().map(|()| condition));
        let body = self.block(&["ENDWHILE"]);
        self.next_line_is("ENDWHILE");
        Ok(Action::While { condition: condition?, body })
    }

    fn repeat_block(&mut self, reader: &mut Reader<'_>) -> Result<Action, String> {
        reader.next();
        let head = reader.end();
        let body = self.block(&["UNTIL"]);
        let Some((until_line, _)) = self.first_word() else { return Err("UNTIL is missing".to_owned()) };
        let tokens = self.take_line();
        let mut reader = Reader::new(&tokens);
        reader.word("UNTIL")?;
        let until = reader.expression()?;
        reader.end()?;
        head.map(|()| Action::Repeat { body, until, until_line })
    }

    fn loop_block(&mut self, reader: &mut Reader<'_>) -> Result<Action, String> {
        reader.next();
        let head = reader.end();
        let body = self.block(&["ENDLOOP"]);
        self.next_line_is("ENDLOOP");
        head.map(|()| Action::Loop { body })
    }
}

fn values(reader: &mut Reader<'_>) -> Result<Vec<Expression>, String> {
    let mut values = vec![reader.expression()?];
    while reader.takes_sign(",") {
        values.push(reader.expression()?);
    }
    reader.end().map(|()| values)
}

type ForHead = (super::syntax::VariableRef, Expression, Expression, Option<Expression>);

fn for_head(reader: &mut Reader<'_>) -> Result<ForHead, String> {
    let variable = reader.place()?;
    reader.sign("=")?;
    let from = reader.expression()?;
    reader.word("TO")?;
    let to = reader.expression()?;
    let step = if reader.takes_word("STEP") { Some(reader.expression()?) } else { None };
    reader.end()?;
    Ok((variable, from, to, step))
}

fn simple(reader: &mut Reader<'_>, line: usize, first: &str) -> Result<Action, String> {
    let is_assignment = matches!(reader.peek_behind(1), Some(Token::Sign("=" | "[" | ".")));
    if is_assignment {
        let to = reader.place()?;
        reader.sign("=")?;
        return Ok(Action::Assign { to, value: reader.expression()? });
    }
    if matches!(reader.peek_behind(1), Some(Token::Sign("("))) && !matches!(first, "RETURN") {
        return Ok(Action::Call(reader.call()?));
    }
    reader.next();
    match first {
        "RETURN" => Ok(Action::Return(if reader.peek().is_some() { Some(reader.expression()?) } else { None })),
        "EXIT" => Ok(Action::Exit),
        "HALT" => Ok(Action::Halt),
        "ON_ERROR_PROCEED" => Ok(Action::Call(Call { name: first.to_owned(), arguments: Vec::new() })),
        "CONTINUE" => Ok(Action::Continue),
        "RESUME" => Ok(Action::Resume),
        "BRAKE" => Ok(Action::Brake { fast: reader.takes_word("F") }),
        "GLOBAL" => {
            reader.word("INTERRUPT")?;
            interrupt(reader, true)
        }
        "INTERRUPT" => interrupt(reader, false),
        "TRIGGER" => trigger(reader, line),
        "PTP" => motion(reader, Motion::Ptp),
        "LIN" => motion(reader, Motion::Lin),
        "WAIT" if reader.takes_word("SEC") => Ok(Action::WaitSeconds(reader.expression()?)),
        "WAIT" if reader.takes_word("FOR") => Ok(Action::WaitFor(reader.expression()?)),
        "WAIT" => Err(format!("SEC or FOR is expected behind WAIT instead of {}", reader.found())),
        "ELSE" | "ENDIF" | "CASE" | "DEFAULT" | "ENDSWITCH" | "ENDFOR" | "ENDWHILE" | "UNTIL" | "ENDLOOP" => {
            Err("no block is open that this line could belong to".to_owned())
        }
        "DECL" | "INT" | "REAL" | "BOOL" | "CHAR" | "STRUC" | "ENUM" | "EXT" | "EXTFCT" => {
            Err("a declaration stands behind a statement; all declarations come first".to_owned())
        }
        _ if OUTSIDE.contains(&first) => Err(format!(
            "{first} is KRL, but it is outside of what this program reads; write it with the statements of the \
             shipped files, or keep it out of the files that are checked"
        )),
        _ => {
            Err("this is no statement: neither an assignment, nor a call with brackets, nor a known word"
                .to_owned())
        }
    }
}

fn interrupt(reader: &mut Reader<'_>, global: bool) -> Result<Action, String> {
    if reader.takes_word("DECL") {
        let number = reader.expression()?;
        reader.word("WHEN")?;
        let condition = reader.expression()?;
        reader.word("DO")?;
        return Ok(Action::InterruptDeclaration { global, number, condition, call: reader.call()? });
    }
    if global {
        return Err(format!("DECL is expected behind GLOBAL INTERRUPT instead of {}", reader.found()));
    }
    let on = if reader.takes_word("ON") {
        true
    } else if reader.takes_word("OFF") {
        false
    } else {
        return Err(format!("DECL, ON or OFF is expected behind INTERRUPT instead of {}", reader.found()));
    };
    let number = if reader.peek().is_some() { Some(reader.expression()?) } else { None };
    Ok(Action::InterruptSwitch { on, number })
}

/// `TRIGGER WHEN DISTANCE=1 DELAY=0 DO NAME( ) PRIO=-1`, or with an assignment behind DO.
fn trigger(reader: &mut Reader<'_>, line: usize) -> Result<Action, String> {
    reader.word("WHEN")?;
    reader.word("DISTANCE")?;
    reader.sign("=")?;
    let distance = reader.expression()?;
    reader.word("DELAY")?;
    reader.sign("=")?;
    let delay = reader.expression()?;
    reader.word("DO")?;
    let action = if matches!(reader.peek_behind(1), Some(Token::Sign("("))) {
        Action::Call(Call { ..reader.call()? })
    } else {
        let to = reader.place()?;
        reader.sign("=")?;
        Action::Assign { to, value: reader.expression()? }
    };
    let mut priority = None;
    if reader.takes_word("PRIO") {
        reader.sign("=")?;
        priority = Some(reader.expression()?);
    } else if matches!(action, Action::Call(_)) {
        return Err("a TRIGGER that calls a routine needs PRIO".to_owned());
    }
    Ok(Action::Trigger { distance, delay, action: Box::new(Statement { line, action }), priority })
}

fn motion(reader: &mut Reader<'_>, motion: Motion) -> Result<Action, String> {
    let target = reader.expression()?;
    let approximations = [
        ("C_PTP", Approximation::Ptp),
        ("C_DIS", Approximation::Distance),
        ("C_VEL", Approximation::Velocity),
        ("C_ORI", Approximation::Orientation),
    ];
    let approximates = approximations.iter().find(|(word, _)| reader.takes_word(word)).map(|(_, how)| *how);
    if motion == Motion::Lin && approximates == Some(Approximation::Ptp) {
        return Err("LIN is approximated with C_DIS, C_VEL or C_ORI; C_PTP belongs to PTP".to_owned());
    }
    Ok(Action::Motion { motion, target, approximates })
}
