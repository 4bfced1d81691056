//! Reads the statements of a routine: one line each; blocks from their first keyword to their last.

use super::expression::{Read, Reader, Unread};
use super::lex::Token;
use super::limits::BLOCK_DEPTH;
use super::motion::{interrupt, motion, spline_head, spline_part, trigger};
use super::parse::Parser;
use super::syntax::{Action, Call, Case, Expression, Statement, VariableRef};

/// First keywords of statements that are not read here, although a controller reads them.
const NOT_READ: [&str; 8] = ["ANIN", "ANOUT", "DIGIN", "ASYPTP", "ASYCONT", "ASYSTOP", "ASYCANCEL", "CANCEL"];

/// The first and last keywords of blocks.
const BLOCKS: [(&str, &str); 8] = [
    ("IF", "ENDIF"),
    ("SWITCH", "ENDSWITCH"),
    ("FOR", "ENDFOR"),
    ("WHILE", "ENDWHILE"),
    ("REPEAT", "UNTIL"),
    ("LOOP", "ENDLOOP"),
    ("SPLINE", "ENDSPLINE"),
    ("PTP_SPLINE", "ENDSPLINE"),
];

/// Keywords of other languages, each with the corresponding KRL keyword.
const OF_OTHER_LANGUAGES: [(&str, &str); 5] = [
    ("ELSEIF", "KRL has no ELSEIF: write ELSE, then an IF with its own ENDIF"),
    ("ELSIF", "KRL has no ELSIF: write ELSE, then an IF with its own ENDIF"),
    ("ENDFUNCTION", "KRL has no ENDFUNCTION: end a function with ENDFCT"),
    ("FUNCTION", "KRL has no FUNCTION: begin a function with DEFFCT"),
    ("BREAK", "KRL has no BREAK: leave a loop with EXIT"),
];

impl Parser {
    /// Statements up to a line that begins with one of these words; that line is not consumed.
    pub(super) fn block(&mut self, ends: &[&str]) -> Vec<Statement> {
        self.depth += 1;
        let mut found = Vec::new();
        let mut is_closed = false;
        while let Some((line, first)) = self.first_word() {
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
            let line = self.last_line();
            self.problem(line, "", format!("the file ends, but {} is missing", ends.join(" or ")));
        }
        self.depth -= 1;
        found
    }

    fn statement(&mut self, line: usize, first: &str) -> Action {
        let tokens = self.take_line();
        if let Some((_, last)) = BLOCKS.iter().find(|(word, _)| *word == first).filter(|_| !is_assignment(&tokens))
        {
            if self.depth > BLOCK_DEPTH {
                let unread = Unread::NotChecked(format!("blocks are nested more than {BLOCK_DEPTH} levels deep"));
                self.report(line, &tokens, first, unread);
                self.skip_block(last);
                return Action::NotRead;
            }
            return match first {
                "IF" => self.if_block(line, &tokens),
                "SWITCH" => self.switch_block(line, &tokens),
                "FOR" => self.for_block(line, &tokens),
                "WHILE" => self.while_block(line, &tokens),
                "REPEAT" => self.repeat_block(line, &tokens),
                "LOOP" => self.loop_block(line, &tokens),
                _ => self.spline_block(line, &tokens),
            };
        }
        let mut reader = Reader::new(&tokens);
        let action = simple(&mut reader, line, first).and_then(|action| reader.end().map(|()| action));
        action.unwrap_or_else(|unread| {
            self.report(line, &tokens, first, unread);
            Action::NotRead
        })
    }

    /// Skips the rest of a block, including all blocks in it.
    fn skip_block(&mut self, last: &str) {
        let mut open = 1;
        while let Some((_, first)) = self.first_word() {
            if self.closes_a_routine() {
                return;
            }
            open += usize::from(BLOCKS.iter().any(|(word, _)| *word == first));
            if first == last || BLOCKS.iter().any(|(_, word)| *word == first) {
                open -= 1;
            }
            self.take_line();
            if open == 0 {
                return;
            }
        }
    }

    /// Reads the head of a block and reports it if it cannot be read: the statements of the block are checked in
    /// any case.
    fn head<T>(
        &mut self,
        line: usize,
        tokens: &[Token],
        instead: T,
        read: impl FnOnce(&mut Reader<'_>) -> Read<T>,
    ) -> T {
        let mut reader = Reader::new(tokens);
        reader.next();
        let found = read(&mut reader).and_then(|found| reader.end().map(|()| found));
        found.unwrap_or_else(|unread| {
            let key = tokens.first().map(ToString::to_string).unwrap_or_default();
            self.report(line, tokens, &key, unread);
            instead
        })
    }

    fn if_block(&mut self, line: usize, tokens: &[Token]) -> Action {
        let condition = self.head(line, tokens, Expression::NotRead, |reader| {
            let condition = reader.expression()?;
            reader.word("THEN")?;
            Ok(condition)
        });
        let then = self.block(&["ELSE", "ENDIF"]);
        let mut otherwise = Vec::new();
        if self.next_line_is("ELSE") {
            otherwise = self.block(&["ENDIF"]);
        }
        self.next_line_is("ENDIF");
        Action::If { condition, then, otherwise }
    }

    fn switch_block(&mut self, line: usize, tokens: &[Token]) -> Action {
        const ENDS: [&str; 3] = ["CASE", "DEFAULT", "ENDSWITCH"];
        let on = self.head(line, tokens, Expression::NotRead, |reader| reader.expression());
        let (mut cases, mut default) = (Vec::new(), None);
        if let Some((line, first)) = self.first_word()
            && !ENDS.contains(&first.as_str())
        {
            self.problem(line, &first, "the line after SWITCH must be CASE");
            self.block(&ENDS);
        }
        while let Some((line, first)) = self.first_word() {
            match first.as_str() {
                "CASE" => {
                    let tokens = self.take_line();
                    let values = self.head(line, &tokens, Vec::new(), values);
                    let body = self.block(&ENDS);
                    cases.push(Case { line, values, body });
                }
                "DEFAULT" => {
                    self.next_line_is("DEFAULT");
                    if default.replace(self.block(&ENDS)).is_some() {
                        self.problem(line, "DEFAULT", "the SWITCH has more than one DEFAULT");
                    }
                }
                _ => {
                    self.next_line_is("ENDSWITCH");
                    break;
                }
            }
        }
        Action::Switch { on, cases, default }
    }

    fn for_block(&mut self, line: usize, tokens: &[Token]) -> Action {
        let head = self.head(line, tokens, None, |reader| for_head(reader).map(Some));
        let body = self.block(&["ENDFOR"]);
        self.next_line_is("ENDFOR");
        match head {
            Some(ForHead { variable, from, to, step }) => Action::For { variable, from, to, step, body },
            None => Action::While { condition: Expression::NotRead, body },
        }
    }

    fn while_block(&mut self, line: usize, tokens: &[Token]) -> Action {
        let condition = self.head(line, tokens, Expression::NotRead, |reader| reader.expression());
        let body = self.block(&["ENDWHILE"]);
        self.next_line_is("ENDWHILE");
        Action::While { condition, body }
    }

    fn repeat_block(&mut self, line: usize, tokens: &[Token]) -> Action {
        self.head(line, tokens, (), |_| Ok(()));
        let body = self.block(&["UNTIL"]);
        let Some((until_line, _)) = self.first_word().filter(|(_, first)| first == "UNTIL") else {
            return Action::Repeat { body, until: Expression::NotRead, until_line: self.last_line() };
        };
        let tokens = self.take_line();
        let until = self.head(until_line, &tokens, Expression::NotRead, |reader| reader.expression());
        Action::Repeat { body, until, until_line }
    }

    fn loop_block(&mut self, line: usize, tokens: &[Token]) -> Action {
        self.head(line, tokens, (), |_| Ok(()));
        let body = self.block(&["ENDLOOP"]);
        self.next_line_is("ENDLOOP");
        Action::Loop { body }
    }

    fn spline_block(&mut self, line: usize, tokens: &[Token]) -> Action {
        let mut with = self.head(line, tokens, Vec::new(), spline_head);
        let body = self.block(&["ENDSPLINE"]);
        if let Some((line, _)) = self.first_word().filter(|(_, first)| first == "ENDSPLINE") {
            let tokens = self.take_line();
            with.extend(self.head(line, &tokens, Vec::new(), spline_head));
        }
        Action::Spline { with, body }
    }
}

/// Returns whether a line consists only of `NAME:`.
fn is_label(tokens: &[Token]) -> bool {
    matches!(tokens, [Token::Name(_), Token::Sign(":")])
}

/// `NAME=`, `NAME[`, `NAME.`
fn is_assignment(tokens: &[Token]) -> bool {
    matches!(tokens, [Token::Name(_), Token::Sign("=" | "[" | "."), ..])
}

fn values(reader: &mut Reader<'_>) -> Read<Vec<Expression>> {
    let mut values = vec![reader.expression()?];
    while reader.takes_sign(",") {
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

fn for_head(reader: &mut Reader<'_>) -> Read<ForHead> {
    let variable = reader.place()?;
    reader.sign("=")?;
    let from = reader.expression()?;
    reader.word("TO")?;
    let to = reader.expression()?;
    let step = if reader.takes_word("STEP") { Some(reader.expression()?) } else { None };
    Ok(ForHead { variable, from, to, step })
}

fn simple(reader: &mut Reader<'_>, line: usize, first: &str) -> Read<Action> {
    match reader.peek_behind(1) {
        Some(Token::Sign("=" | "[" | ".")) => {
            let to = reader.place()?;
            reader.sign("=")?;
            return Ok(Action::Assign { to, value: reader.expression()? });
        }
        Some(Token::Sign("(")) if !matches!(first, "RETURN" | "CONFIRM") => {
            return Ok(Action::Call(reader.call()?));
        }
        Some(Token::Sign(":")) if reader.peek_behind(2).is_none() => {
            let name = reader.name()?;
            reader.next();
            return Ok(Action::Label(name));
        }
        Some(Token::Sign(":")) if matches!(reader.peek_behind(2), Some(Token::Sign("="))) => {
            return Err("KRL assigns with '=', not with ':='".into());
        }
        _ => {}
    }
    let Some(Token::Name(_)) = reader.next() else {
        return Err(format!("a statement cannot begin with '{first}'").into());
    };
    match first {
        "RETURN" => Ok(Action::Return(if reader.peek().is_some() { Some(reader.expression()?) } else { None })),
        "EXIT" => Ok(Action::Exit),
        "HALT" => Ok(Action::Halt),
        "ON_ERROR_PROCEED" => Ok(Action::Call(Call { name: first.to_owned(), arguments: Vec::new() })),
        "CONTINUE" => Ok(Action::Continue),
        "RESUME" => Ok(Action::Resume),
        "BRAKE" => Ok(Action::Brake { fast: reader.takes_word("F") }),
        "GOTO" => Ok(Action::Goto(reader.name()?)),
        "CONFIRM" => Ok(Action::Checked { word: "CONFIRM", values: vec![(reader.expression()?, "INT")] }),
        "GLOBAL" => {
            reader.word("INTERRUPT")?;
            interrupt(reader, true)
        }
        "INTERRUPT" => interrupt(reader, false),
        "TRIGGER" => trigger(reader, line),
        "WAIT" if reader.takes_word("SEC") => Ok(Action::WaitSeconds(reader.expression()?)),
        "WAIT" if reader.takes_word("FOR") => Ok(Action::WaitFor(reader.expression()?)),
        "WAIT" => Err(format!("expected SEC or FOR after WAIT, found {}", reader.found()).into()),
        "CASE" | "DEFAULT" => Err("CASE and DEFAULT are valid only inside a SWITCH".into()),
        "DECL" | "INT" | "REAL" | "BOOL" | "CHAR" | "STRUC" | "ENUM" | "EXT" | "EXTFCT" | "SIGNAL" => {
            Err("a declaration follows a statement; move all declarations before the first statement".into())
        }
        _ => other(reader, first),
    }
}

/// Reads a motion or a part of a spline; anything else is not a statement of KRL.
fn other(reader: &mut Reader<'_>, first: &str) -> Read<Action> {
    if let Some(found) = motion(reader, first).or_else(|| spline_part(reader, first)) {
        return found;
    }
    if first == "ELSE" || BLOCKS.iter().any(|(_, last)| *last == first) {
        return Err("the line ends or continues a block, but no such block is open".into());
    }
    if let Some((_, instead)) = OF_OTHER_LANGUAGES.iter().find(|(word, _)| *word == first) {
        return Err((*instead).into());
    }
    let message = match reader.peek() {
        _ if NOT_READ.contains(&first) => format!("{first} is a KRL statement that this parser does not support"),
        None => {
            return Err(format!("the line is not a KRL statement; to call a routine, write {first}( )").into());
        }
        Some(_) => format!("this parser supports no statement that begins with {first}"),
    };
    reader.skip_line();
    Err(Unread::NotChecked(message))
}
