//! Reads a file: its routines or its data list, with their declarations. A line that is wrong is told and passed over,
//! so that one reading finds all problems of a file.

use super::expression::Reader;
use super::lex::{Token, tokens};
use super::syntax::{Action, Data, Declaration, Declared, File, Item, Parameter, Routine, Statement};
use crate::config::Problem;

/// Reads one file; `name` is its name in messages, and its ending says whether it holds programs or data.
/// What could be read comes back beside the problems, in the order of their lines.
pub fn parse(name: &str, text: &str) -> (File, Vec<Problem>) {
    let mut parser =
        Parser { lines: Vec::new(), at: 0, ends_at: text.lines().count().max(1), problems: Vec::new() };
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        match tokens(line) {
            Ok(tokens) if tokens.is_empty() => {}
            Ok(tokens) => parser.lines.push((index + 1, tokens)),
            Err(message) => parser.problem(index + 1, "", message),
        }
    }
    let base = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let module = base.split('.').next().unwrap_or(base).to_uppercase();
    let mut file = File { name: name.to_owned(), module, routines: Vec::new(), data: None };
    if parser.first_word().is_some_and(|(_, first)| first == "DEFDAT") {
        file.data = Some(parser.data());
    } else {
        while parser.first_word().is_some() {
            if let Some(routine) = parser.routine() {
                file.routines.push(routine);
            }
        }
        if file.routines.is_empty() {
            parser.problem(1, "", "the file has neither DEF nor DEFFCT nor DEFDAT".to_owned());
        }
    }
    parser.problems.sort_by_key(|problem| problem.line);
    (file, parser.problems)
}

pub(super) struct Parser {
    lines: Vec<(usize, Vec<Token>)>,
    at: usize,
    ends_at: usize,
    problems: Vec<Problem>,
}

const SIMPLE_TYPES: [&str; 9] = ["INT", "REAL", "BOOL", "CHAR", "FRAME", "POS", "E6POS", "AXIS", "E6AXIS"];

impl Parser {
    pub(super) fn problem(&mut self, line: usize, key: &str, message: String) {
        self.problems.push(Problem { line, key: key.to_owned(), message });
    }

    pub(super) fn last_line(&self) -> usize {
        self.ends_at
    }

    /// The line that is to be read next, and its first word.
    pub(super) fn first_word(&self) -> Option<(usize, String)> {
        let (line, tokens) = self.lines.get(self.at)?;
        Some((*line, tokens.first().map(ToString::to_string).unwrap_or_default()))
    }

    pub(super) fn take_line(&mut self) -> Vec<Token> {
        let tokens = self.lines.get_mut(self.at).map(|(_, tokens)| std::mem::take(tokens)).unwrap_or_default();
        self.at += 1;
        tokens
    }

    /// Takes the next line where it is this word alone.
    pub(super) fn next_line_is(&mut self, word: &str) -> bool {
        let is_it = self.first_word().is_some_and(|(_, first)| first == word);
        if is_it {
            let line = self.first_word().map_or(1, |(line, _)| line);
            if self.take_line().len() > 1 {
                self.problem(line, word, format!("{word} stands alone on its line"));
            }
        }
        is_it
    }

    /// A line that begins or ends a routine stands in no block.
    pub(super) fn closes_a_routine(&self, first: &str) -> bool {
        let second = self.lines.get(self.at).and_then(|(_, tokens)| tokens.get(1));
        let opens = matches!(second, Some(Token::Name(second)) if matches!(second.as_str(), "DEF" | "DEFFCT"));
        matches!(first, "END" | "ENDFCT" | "DEF" | "DEFFCT" | "DEFDAT" | "ENDDAT") || (first == "GLOBAL" && opens)
    }

    fn routine(&mut self) -> Option<Routine> {
        let (line, first) = self.first_word()?;
        let tokens = self.take_line();
        let mut reader = Reader::new(&tokens);
        let head = routine_head(&mut reader);
        let (global, returns, name, parameters) = match head {
            Ok(head) => head,
            Err(message) => {
                self.problem(line, &first, message);
                return None;
            }
        };
        let declarations = self.declarations();
        let end = if returns.is_some() { "ENDFCT" } else { "END" };
        let body = self.block(&[end]);
        let end_line = self.first_word().map_or(self.ends_at, |(line, _)| line);
        if !self.next_line_is(end)
            && matches!(self.first_word(), Some((_, word)) if word == "END" || word == "ENDFCT")
        {
            self.take_line();
        }
        Some(Routine { name, line, end_line, global, returns, parameters, declarations, body })
    }

    /// The declarations that stand here.
    fn declarations(&mut self) -> Vec<Declaration> {
        let mut found = Vec::new();
        while let Some((line, first)) = self.first_word() {
            let tokens = match self.lines.get(self.at) {
                Some((_, tokens)) if is_declaration(tokens) => tokens.clone(),
                _ => return found,
            };
            self.at += 1;
            match declaration(&mut Reader::new(&tokens), line) {
                Ok(declaration) => found.push(declaration),
                Err(message) => self.problem(line, &first, message),
            }
        }
        found
    }

    /// DEFDAT … ENDDAT, declarations and first values mixed.
    fn data(&mut self) -> Data {
        let tokens = self.take_line();
        let public = tokens.iter().any(|token| matches!(token, Token::Name(name) if name == "PUBLIC"));
        let mut data = Data { public, declarations: Vec::new(), values: Vec::new() };
        loop {
            data.declarations.extend(self.declarations());
            let Some((line, first)) = self.first_word() else {
                let line = self.ends_at;
                self.problem(line, "", "the file ends before ENDDAT".to_owned());
                return data;
            };
            let tokens = self.take_line();
            if first == "ENDDAT" {
                break;
            }
            let mut reader = Reader::new(&tokens);
            let value = reader.place().and_then(|to| {
                reader.sign("=")?;
                let value = reader.expression()?;
                reader.end().map(|()| Statement { line, action: Action::Assign { to, value } })
            });
            match value {
                Ok(value) => data.values.push(value),
                Err(message) => self.problem(line, &first, message),
            }
        }
        if let Some((line, first)) = self.first_word() {
            self.problem(line, &first, "nothing may stand behind ENDDAT".to_owned());
        }
        data
    }
}

type Head = (bool, Option<String>, String, Vec<Parameter>);

fn routine_head(reader: &mut Reader<'_>) -> Result<Head, String> {
    let global = reader.takes_word("GLOBAL");
    let returns = if reader.takes_word("DEFFCT") {
        Some(reader.name()?)
    } else if reader.takes_word("DEF") {
        None
    } else {
        return Err(format!("DEF or DEFFCT is expected instead of {}", reader.found()));
    };
    let name = reader.name()?;
    reader.sign("(")?;
    let mut parameters = Vec::new();
    while !reader.takes_sign(")") {
        if !parameters.is_empty() {
            reader.sign(",")?;
        }
        let name = reader.name()?;
        if reader.takes_sign("[") {
            while reader.takes_sign(",") {}
            reader.sign("]")?;
        }
        let mut by_value = false;
        if reader.takes_sign(":") {
            by_value = reader.takes_word("IN");
            if !by_value {
                reader.word("OUT")?;
            }
        }
        parameters.push(Parameter { name, by_value });
    }
    reader.end()?;
    Ok((global, returns, name, parameters))
}

fn is_declaration(tokens: &[Token]) -> bool {
    let word = |at: usize| match tokens.get(at) {
        Some(Token::Name(name)) => name.as_str(),
        _ => "",
    };
    match word(0) {
        "DECL" | "STRUC" | "ENUM" | "EXT" | "EXTFCT" => true,
        "GLOBAL" => !matches!(word(1), "INTERRUPT" | "DEF" | "DEFFCT"),
        first => SIMPLE_TYPES.contains(&first) && !word(1).is_empty(),
    }
}

fn declaration(reader: &mut Reader<'_>, line: usize) -> Result<Declaration, String> {
    let (mut global, mut constant) = (false, false);
    loop {
        if reader.takes_word("GLOBAL") {
            global = true;
        } else if reader.takes_word("CONST") {
            constant = true;
        } else if !reader.takes_word("DECL") {
            break;
        }
    }
    let kind = if reader.takes_word("STRUC") {
        struc(reader)?
    } else if reader.takes_word("ENUM") {
        let name = reader.name()?;
        let mut words = vec![reader.name()?];
        while reader.takes_sign(",") {
            words.push(reader.name()?);
        }
        Declared::Enumeration { name, words }
    } else if reader.takes_word("EXT") || reader.takes_word("EXTFCT") {
        return Ok(Declaration { line, global, kind: Declared::Foreign });
    } else {
        let type_name = reader.name()?;
        let mut items = vec![item(reader)?];
        while reader.takes_sign(",") {
            items.push(item(reader)?);
        }
        Declared::Variables { constant, type_name, items }
    };
    reader.end()?;
    Ok(Declaration { line, global, kind })
}

/// `STRUC NAME INT A,B,REAL C`: a component keeps the type before it.
fn struc(reader: &mut Reader<'_>) -> Result<Declared, String> {
    let name = reader.name()?;
    let mut type_name = String::new();
    let mut components = Vec::new();
    loop {
        if matches!(reader.peek_behind(1), Some(Token::Name(_))) {
            type_name = reader.name()?;
        }
        if type_name.is_empty() {
            return Err(format!("a type is expected instead of {}", reader.found()));
        }
        components.push((type_name.clone(), item(reader)?));
        if !reader.takes_sign(",") {
            return Ok(Declared::Struc { name, components });
        }
    }
}

fn item(reader: &mut Reader<'_>) -> Result<Item, String> {
    let name = reader.name()?;
    let mut dimensions = Vec::new();
    if reader.takes_sign("[") {
        loop {
            let is_open = matches!(reader.peek(), Some(Token::Sign("," | "]")));
            dimensions.push(if is_open { None } else { Some(reader.expression()?) });
            if reader.takes_sign("]") {
                break;
            }
            reader.sign(",")?;
        }
    }
    let value = if reader.takes_sign("=") { Some(reader.expression()?) } else { None };
    Ok(Item { name, dimensions, value })
}
