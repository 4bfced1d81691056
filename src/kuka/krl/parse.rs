//! Parses a file: its routines or its data list. A line with an error is reported, and its block continues. So one pass
//! finds all problems of a file, and no problem causes another one.

use super::expression::{
    NotRead, ReadResult, TokenReader, is_declaration, is_declaration_without_decl, parse_declaration,
    parse_return_type,
};
use super::lex::{RESERVED_WORDS, Token, tokens};
use super::routines::is_ethernet_krl_6_only;
use super::syntax::{
    Action, Data, Declaration, File, MAX_FILE_BYTES, MAX_REPORTS, Parameter, ReturnType, Routine, Statement,
};
use panelprep_base::config::Problem;

/// The DOS end-of-file character; the characters after it do not belong to the text.
const END_OF_TEXT: char = '\u{1a}';

/// Parses one file. `name` is the file's name for messages; without folder and extension it is the name of the module.
pub fn parse(name: &str, text: &str) -> File {
    let base = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let module = base.rsplit_once('.').map_or(base, |(stem, _)| stem).to_uppercase();
    let mut file = File {
        name: name.to_owned(),
        problems: Vec::new(),
        warnings: Vec::new(),
        of_ethernet_krl_6: false,
        module,
        routines: Vec::new(),
        data: None,
    };
    let mut parser = Parser::default();
    if text.len() > MAX_FILE_BYTES {
        let (found, limit) = (text.len() >> 20, MAX_FILE_BYTES >> 20);
        parser.warn(1, "", format!("not checked: the file has {found} MB; limit {limit} MB"));
    } else {
        parser.read_lines(text);
        let mut names = parser.lines.iter().flat_map(|line| &line.tokens);
        file.of_ethernet_krl_6 =
            names.any(|token| matches!(token, Token::Name(name) if is_ethernet_krl_6_only(name)));
        parser.parse_file(&mut file);
    }
    (file.problems, file.warnings) = (sort_reports(parser.problems), sort_reports(parser.warnings));
    file
}

/// Sorts the problems by line and removes duplicates.
fn sort_reports(mut reports: Vec<Problem>) -> Vec<Problem> {
    reports.sort_by_key(|report| report.line);
    reports.dedup();
    reports
}

/// A line of the file that is not empty.
#[derive(Debug, Default)]
struct SourceLine {
    number: usize,
    tokens: Vec<Token>,
}

#[derive(Debug, Default)]
pub(super) struct Parser {
    lines: Vec<SourceLine>,
    at: usize,
    ends_at: usize,
    problems: Vec<Problem>,
    warnings: Vec<Problem>,
    /// The number of open blocks.
    pub(super) depth: usize,
}

impl Parser {
    fn read_lines(&mut self, text: &str) {
        let text = text.trim_start_matches('\u{feff}');
        // Old editors leave meaningless characters after the DOS end-of-file character; a controller ignores them as
        // well.
        let text = text.split(END_OF_TEXT).next().unwrap_or_default();
        // A file without line feeds uses carriage returns as line ends.
        let end = if text.contains('\n') { '\n' } else { '\r' };
        for (index, line) in text.split(end).enumerate() {
            let number = index + 1;
            let (tokens, problem) = tokens(line);
            if let Some(message) = problem {
                self.problem(number, "", message);
            }
            if !tokens.is_empty() {
                self.lines.push(SourceLine { number, tokens });
            }
            if !line.is_empty() {
                self.ends_at = number;
            }
        }
        self.ends_at = self.ends_at.max(1);
    }

    fn parse_file(&mut self, file: &mut File) {
        if self.is_next_word("DEFDAT") {
            file.data = Some(self.data());
            return;
        }
        if !self.lines.iter().any(opens_a_routine) {
            // The file is not a KRL file. This single message is useful; messages about its lines would only hide it.
            self.problems.clear();
            self.problem(1, "", "the file contains no DEF, DEFFCT or DEFDAT: it is not a KRL file");
            return;
        }
        while let Some(routine) = self.parse_routine() {
            file.routines.push(routine);
        }
        self.check_first_routine_name(file);
    }

    /// Checks that the first routine has the name of the file: a controller finds a module by its file name and selects
    /// the routine with the same name.
    fn check_first_routine_name(&mut self, file: &File) {
        let Some(first) = file.routines.first().filter(|first| !first.name.is_empty()) else { return };
        if first.name == file.module {
            return;
        }
        let (line, name, module) = (first.line, first.name.clone(), &file.module);
        if !is_routine_name(module) {
            // On the controller the file must have the name of its routine.
            let message = format!(
                "the file name {module} is not a valid KRL name: on a controller, the file must be named {name}"
            );
            return self.warn(line, &name, message);
        }
        let message = match file.routines.iter().find(|routine| routine.name == *module) {
            Some(other) => format!(
                "the first routine of a file must have the file's name: move {module} (line {}) before this routine",
                other.line
            ),
            None => {
                format!(
                    "the first routine of a file must have the file's name: name the routine {module}, or rename the \
                     file"
                )
            }
        };
        self.problem(line, &name, message);
    }

    pub(super) fn problem(&mut self, line: usize, key: &str, message: impl Into<String>) {
        if self.problems.len() < MAX_REPORTS {
            self.problems.push(Problem { line, key: key.to_owned(), message: message.into() });
        }
    }

    fn warn(&mut self, line: usize, key: &str, message: String) {
        if self.warnings.len() < MAX_REPORTS {
            self.warnings.push(Problem { line, key: key.to_owned(), message });
        }
    }

    /// Reports why a line was not parsed, unless an unreadable character in the line was already reported.
    pub(super) fn report(&mut self, line: usize, tokens: &[Token], key: &str, unread: NotRead) {
        match unread {
            // The unreadable character was already reported, and it is the reason why the statement is incomplete.
            NotRead::Wrong(_) if tokens.contains(&Token::Unreadable) => {}
            NotRead::Wrong(message) => self.problem(line, key, message),
            NotRead::NotChecked(message) => self.warn(line, key, format!("not checked: {message}")),
        }
    }

    pub(super) fn last_line_number(&self) -> usize {
        self.ends_at
    }

    /// Returns the index of the next line, and its first keyword.
    pub(super) fn peek_first_word(&self) -> Option<(usize, String)> {
        let line = self.lines.get(self.at)?;
        Some((line.number, line.tokens.first().map(ToString::to_string).unwrap_or_default()))
    }

    fn is_next_word(&self, word: &str) -> bool {
        matches!(self.next_tokens().first(), Some(Token::Name(first)) if first == word)
    }

    pub(super) fn next_tokens(&self) -> &[Token] {
        self.lines.get(self.at).map_or(&[], |line| &line.tokens)
    }

    pub(super) fn next_line(&mut self) -> Vec<Token> {
        let tokens = self.lines.get_mut(self.at).map(|line| std::mem::take(&mut line.tokens)).unwrap_or_default();
        self.at += 1;
        tokens
    }

    /// Consumes the next line if it begins with this word; reports a problem if other tokens follow.
    pub(super) fn accept_line(&mut self, word: &str) -> bool {
        let Some((line, first)) = self.peek_first_word() else { return false };
        if first != word {
            return false;
        }
        if self.next_line().len() > 1 {
            self.problem(line, word, format!("{word} must be alone on its line"));
        }
        true
    }

    /// Returns whether the next line begins or ends a routine or a data list. Such a line cannot be inside a block.
    pub(super) fn closes_a_routine(&self) -> bool {
        match self.lines.get(self.at) {
            Some(line) if opens_a_routine(line) => true,
            Some(line) => {
                matches!(line.tokens.first(), Some(Token::Name(first)) if matches!(first.as_str(), "END" | "ENDFCT" | "DEFDAT" | "ENDDAT"))
            }
            None => false,
        }
    }

    /// Parses the next routine of the file. Lines before its first line belong to no routine.
    fn parse_routine(&mut self) -> Option<Routine> {
        if let Some((line, first)) =
            self.peek_first_word().filter(|_| !self.lines.get(self.at).is_some_and(opens_a_routine))
        {
            self.problem(line, &first, format!("DEF or DEFFCT is expected instead of '{first}'"));
            // One message is reported for all lines up to the next routine, instead of one for each line.
            while self.lines.get(self.at).is_some_and(|line| !opens_a_routine(line)) {
                self.at += 1;
            }
        }
        let (line, first) = self.peek_first_word()?;
        let tokens = self.next_line();
        let is_function = tokens.iter().take(2).any(|token| *token == Token::Name("DEFFCT".to_owned()));
        let head = parse_routine_head(&mut TokenReader::new(&tokens)).unwrap_or_else(|unread| {
            self.report(line, &tokens, &first, unread);
            RoutineHead::default()
        });
        let declarations = self.parse_declarations(false);
        let end = if is_function { "ENDFCT" } else { "END" };
        self.depth = 0;
        let body = self.block(&[end]);
        let end_line = self.peek_first_word().map_or(self.ends_at, |(line, _)| line);
        if !self.accept_line(end)
            && matches!(self.peek_first_word(), Some((_, word)) if word == "END" || word == "ENDFCT")
        {
            self.next_line();
        }
        let RoutineHead { global, returns, name, parameters } = head;
        Some(Routine { name, line, end_line, global, returns, parameters, declarations, body })
    }

    /// Parses the declarations that follow. A line that may be a declaration without DECL is accepted as a declaration
    /// in a data list, or if another declaration follows.
    fn parse_declarations(&mut self, in_data: bool) -> Vec<Declaration> {
        let mut found = Vec::new();
        loop {
            let lacks =
                |line: &&SourceLine| !is_declaration(&line.tokens) && is_declaration_without_decl(&line.tokens);
            let lacking = self.lines.iter().skip(self.at).take_while(lacks).count();
            let goes_on = self.lines.get(self.at + lacking).is_some_and(|line| is_declaration(&line.tokens));
            for _ in 0..lacking * usize::from(in_data || goes_on) {
                let message = "DECL is missing: by KUKA's manual, DECL is optional only before simple types";
                if let Some((line, first)) = self.peek_first_word() {
                    self.warn(line, &first, message.to_owned());
                }
                found.extend(self.parse_declaration());
            }
            if !goes_on {
                return found;
            }
            found.extend(self.parse_declaration());
        }
    }

    fn parse_declaration(&mut self) -> Option<Declaration> {
        let (line, first) = self.peek_first_word()?;
        let tokens = self.next_line();
        let read = parse_declaration(&mut TokenReader::new(&tokens), line);
        read.map_err(|unread| self.report(line, &tokens, &first, unread)).ok()
    }

    /// Parses a data list, DEFDAT … ENDDAT, in which declarations and initial values may be mixed.
    fn data(&mut self) -> Data {
        let line = self.peek_first_word().map_or(1, |(line, _)| line);
        let tokens = self.next_line();
        let name = match tokens.get(1) {
            Some(Token::Name(name)) => name.clone(),
            _ => String::new(),
        };
        let public = tokens.contains(&Token::Name("PUBLIC".to_owned()));
        let mut data = Data { line, name, public, declarations: Vec::new(), values: Vec::new() };
        loop {
            data.declarations.extend(self.parse_declarations(true));
            let Some((line, first)) = self.peek_first_word() else {
                let line = self.ends_at;
                self.problem(line, "", "the file ends, but ENDDAT is missing");
                return data;
            };
            let tokens = self.next_line();
            if first == "ENDDAT" {
                break;
            }
            match parse_initial_value(&mut TokenReader::new(&tokens), line) {
                Ok(value) => data.values.push(value),
                Err(unread) => self.report(line, &tokens, &first, unread),
            }
        }
        if let Some((line, first)) = self.peek_first_word() {
            self.problem(line, &first, "ENDDAT must be the last line of the file");
        }
        data
    }
}

/// Returns whether a text is a valid name for a routine.
fn is_routine_name(text: &str) -> bool {
    let is_inside = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '$');
    let begins = text.starts_with(|c: char| is_inside(c) && !c.is_ascii_digit());
    begins && text.chars().all(is_inside) && RESERVED_WORDS.binary_search(&text).is_err()
}

/// Returns whether a line is DEF, DEFFCT, GLOBAL DEF or GLOBAL DEFFCT.
fn opens_a_routine(line: &SourceLine) -> bool {
    let word = |at: usize| match line.tokens.get(at) {
        Some(Token::Name(name)) => name.as_str(),
        _ => "",
    };
    let is_head = |word: &str| matches!(word, "DEF" | "DEFFCT");
    is_head(word(0)) || (word(0) == "GLOBAL" && is_head(word(1)))
}

/// Parses an initial value in a data list, such as `NAME[1]=17`.
fn parse_initial_value(reader: &mut TokenReader<'_>, line: usize) -> ReadResult<Statement> {
    let to = reader.parse_variable()?;
    reader.sign("=")?;
    let value = reader.expression()?;
    reader.end()?;
    Ok(Statement { line, action: Action::Assign { to, value } })
}

#[derive(Debug, Default)]
struct RoutineHead {
    global: bool,
    returns: Option<ReturnType>,
    name: String,
    parameters: Vec<Parameter>,
}

fn parse_routine_head(reader: &mut TokenReader<'_>) -> ReadResult<RoutineHead> {
    let global = reader.accept_word("GLOBAL");
    let returns = if reader.accept_word("DEFFCT") {
        Some(parse_return_type(reader)?)
    } else {
        reader.expect_word("DEF")?;
        None
    };
    let name = reader.name()?;
    reader.sign("(")?;
    let mut parameters = Vec::new();
    while !reader.accept_sign(")") {
        if !parameters.is_empty() {
            reader.sign(",")?;
        }
        parameters.push(parse_parameter(reader)?);
    }
    reader.end()?;
    Ok(RoutineHead { global, returns, name, parameters })
}

/// Parses a parameter of a routine: `NAME`, `NAME:IN` or `NAME[,]:OUT`.
fn parse_parameter(reader: &mut TokenReader<'_>) -> ReadResult<Parameter> {
    let name = reader.name()?;
    if reader.accept_sign("[") {
        while reader.accept_sign(",") {}
        reader.sign("]")?;
    }
    let mut by_value = false;
    if reader.accept_sign(":") {
        by_value = reader.accept_word("IN");
        if !by_value {
            reader.expect_word("OUT")?;
        }
    }
    Ok(Parameter { name, by_value })
}
