//! Parses the expressions and the declarations of a line: variables, structures, enumerations, signals, and
//! declarations of items in other files. Comparisons have the lowest precedence in KRL: `A>0 AND B` means `A>(0 AND
//! B)`.

use super::lex::{RESERVED_WORDS, Token};
use super::syntax::{
    Binary, Call, Declaration, DeclarationContent, Expression, Item, MAX_EXPRESSION_DEPTH, MAX_OPERATORS,
    ReturnType, Step, Unary, VariableRef,
};

/// The reason why a line was not parsed.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum NotRead {
    /// The line is not valid KRL: a controller refuses it.
    Wrong(String),
    /// The line may be valid KRL, but this parser does not support it.
    NotChecked(String),
}

impl From<String> for NotRead {
    fn from(message: String) -> Self {
        NotRead::Wrong(message)
    }
}

impl From<&str> for NotRead {
    fn from(message: &str) -> Self {
        NotRead::Wrong(message.to_owned())
    }
}

pub(super) type ReadResult<T> = Result<T, NotRead>;

/// The tokens of one line, read from left to right.
pub(super) struct TokenReader<'a> {
    tokens: &'a [Token],
    at: usize,
    depth: usize,
    operators: usize,
}

impl<'a> TokenReader<'a> {
    pub(super) fn new(tokens: &'a [Token]) -> Self {
        TokenReader { tokens, at: 0, depth: 0, operators: 0 }
    }

    pub(super) fn peek_token(&self) -> Option<&'a Token> {
        self.tokens.get(self.at)
    }

    pub(super) fn peek_ahead(&self, count: usize) -> Option<&'a Token> {
        self.tokens.get(self.at + count)
    }

    /// Returns a description of the next token, for messages.
    pub(super) fn describe_next(&self) -> String {
        self.peek_token().map_or("the end of the line".to_owned(), |token| format!("'{token}'"))
    }

    pub(super) fn next(&mut self) -> Option<&'a Token> {
        let token = self.tokens.get(self.at);
        self.at += usize::from(token.is_some());
        token
    }

    pub(super) fn is_sign(&self, sign: &str) -> bool {
        matches!(self.peek_token(), Some(Token::Sign(found)) if *found == sign)
    }

    pub(super) fn accept_sign(&mut self, sign: &str) -> bool {
        let is_it = self.is_sign(sign);
        self.at += usize::from(is_it);
        is_it
    }

    fn is_word(&self, word: &str) -> bool {
        matches!(self.peek_token(), Some(Token::Name(found)) if found == word)
    }

    pub(super) fn accept_word(&mut self, word: &str) -> bool {
        let is_it = self.is_word(word);
        self.at += usize::from(is_it);
        is_it
    }

    pub(super) fn sign(&mut self, sign: &str) -> ReadResult<()> {
        if self.accept_sign(sign) {
            Ok(())
        } else {
            Err(format!("expected '{sign}', found {}", self.describe_next()).into())
        }
    }

    pub(super) fn expect_word(&mut self, word: &str) -> ReadResult<()> {
        if self.accept_word(word) {
            Ok(())
        } else {
            Err(format!("expected {word}, found {}", self.describe_next()).into())
        }
    }

    pub(super) fn name(&mut self) -> ReadResult<String> {
        let found = self.describe_next();
        match self.next() {
            Some(Token::Name(name)) => Ok(name.clone()),
            _ => Err(format!("expected a name, found {found}").into()),
        }
    }

    /// Skips all tokens up to and including this word; returns false if the line ends or `=` comes first.
    fn skip_past_word(&mut self, word: &str) -> bool {
        while !self.is_word(word) && self.peek_token().is_some() && !self.is_sign("=") {
            self.at += 1;
        }
        self.accept_word(word)
    }

    /// Skips the rest of the line without parsing it.
    pub(super) fn skip_line(&mut self) {
        self.at = self.tokens.len();
    }

    /// Checks that the line has no further tokens.
    pub(super) fn end(&self) -> ReadResult<()> {
        match self.peek_token() {
            None => Ok(()),
            Some(_) => Err(format!("expected the end of the line, found {}", self.describe_next()).into()),
        }
    }

    pub(super) fn expression(&mut self) -> ReadResult<Expression> {
        self.binary(0)
    }

    /// Parses an operand and all following operators whose precedence is at least `weakest`.
    fn binary(&mut self, weakest: usize) -> ReadResult<Expression> {
        let mut left = self.parse_unary()?;
        while let Some((operator, level)) = self.peek_operator().filter(|(_, level)| *level >= weakest) {
            self.at += 1;
            self.operators += 1;
            if self.operators > MAX_OPERATORS {
                return Err(NotRead::NotChecked(format!("the line has more than {MAX_OPERATORS} operators")));
            }
            let right = self.binary(level + 1)?;
            left = Expression::Binary(operator, Box::new(left), Box::new(right));
        }
        Ok(left)
    }

    fn peek_operator(&self) -> Option<(Binary, usize)> {
        let next = match self.peek_token()? {
            Token::Sign(sign) => *sign,
            Token::Name(name) => name.as_str(),
            _ => return None,
        };
        OPERATOR_PRECEDENCES.iter().find(|(sign, ..)| *sign == next).map(|(_, operator, level)| (*operator, *level))
    }

    /// Calls `read` one nesting level deeper, unless the maximum depth is exceeded.
    fn read_nested<T>(&mut self, read: impl FnOnce(&mut Self) -> ReadResult<T>) -> ReadResult<T> {
        if self.depth >= MAX_EXPRESSION_DEPTH {
            let message =
                format!("brackets, braces or signs are nested more than {MAX_EXPRESSION_DEPTH} levels deep");
            return Err(NotRead::NotChecked(message));
        }
        self.depth += 1;
        let found = read(self);
        self.depth -= 1;
        found
    }

    fn parse_unary(&mut self) -> ReadResult<Expression> {
        for (word, operator) in [("NOT", Unary::Not), ("B_NOT", Unary::BitNot)] {
            if self.accept_word(word) {
                return Ok(Expression::Unary(operator, Box::new(self.read_nested(Self::parse_unary)?)));
            }
        }
        if self.accept_sign("-") {
            if let Some(Token::Int(number)) = self.peek_token() {
                self.at += 1;
                return Ok(Expression::Int(i32::try_from(-number).unwrap_or(i32::MIN)));
            }
            return Ok(match self.read_nested(Self::parse_unary)? {
                Expression::Int(number) => Expression::Int(number.wrapping_neg()),
                Expression::Real(number) => Expression::Real(-number),
                other => Expression::Unary(Unary::Minus, Box::new(other)),
            });
        }
        if self.accept_sign("+") {
            return self.read_nested(Self::parse_unary);
        }
        self.primary()
    }

    fn primary(&mut self) -> ReadResult<Expression> {
        let Some(token) = self.peek_token() else { return Err("a value is missing at the end of the line".into()) };
        match token {
            Token::Sign("(") => {
                self.at += 1;
                let inside = self.read_nested(Self::expression)?;
                self.sign(")")?;
                return Ok(inside);
            }
            Token::Sign("{") => return self.read_nested(Self::aggregate),
            Token::Sign(":") if matches!(self.peek_ahead(1), Some(Token::Name(_))) => {
                self.at += 2;
                return Ok(Expression::Channel);
            }
            Token::Name(name) if !matches!(name.as_str(), "TRUE" | "FALSE") => {
                if matches!(self.peek_ahead(1), Some(Token::Sign("("))) {
                    return Ok(Expression::Call(self.call()?));
                }
                return Ok(Expression::Variable(self.parse_variable()?));
            }
            _ => {}
        }
        let value = match token {
            Token::Name(name) => Expression::Bool(name == "TRUE"),
            Token::Int(number) => match i32::try_from(*number) {
                Ok(number) => Expression::Int(number),
                Err(_) => return Err(format!("the number {number} does not fit into 32 bits").into()),
            },
            Token::Real(number) => Expression::Real(*number),
            Token::Text(text) => Expression::Text(text.clone()),
            Token::Word(word) => Expression::Word(word.clone()),
            Token::Sign(_) | Token::Unreadable => {
                return Err(format!("expected a value, found {}", self.describe_next()).into());
            }
        };
        self.at += 1;
        Ok(value)
    }

    /// Parses a variable: its name with indices and components.
    pub(super) fn parse_variable(&mut self) -> ReadResult<VariableRef> {
        let name = self.name()?;
        let mut steps = Vec::new();
        loop {
            if self.accept_sign("[") {
                steps.push(Step::Index(self.read_nested(Self::indices)?));
            } else if self.accept_sign(".") {
                steps.push(Step::Component(self.name()?));
            } else {
                return Ok(VariableRef { name, steps });
            }
        }
    }

    /// Parses indices up to the bracket, for example `1,2]`, `]`, `,]` or `3,]`.
    fn indices(&mut self) -> ReadResult<Vec<Option<Expression>>> {
        self.parse_list_until("]")
    }

    /// Parses a comma-separated list of expressions up to the end sign; each expression may be omitted.
    fn parse_list_until(&mut self, end: &str) -> ReadResult<Vec<Option<Expression>>> {
        let mut list = Vec::new();
        loop {
            let is_left_out = self.is_sign(",") || self.is_sign(end);
            list.push(if is_left_out { None } else { Some(self.expression()?) });
            if self.accept_sign(end) {
                return Ok(list);
            }
            self.sign(",")?;
        }
    }

    /// Parses a call: the routine's name and its arguments in brackets; each argument may be omitted.
    pub(super) fn call(&mut self) -> ReadResult<Call> {
        let name = self.name()?;
        self.sign("(")?;
        let arguments = self.read_nested(Self::arguments)?;
        Ok(Call { name, arguments })
    }

    fn arguments(&mut self) -> ReadResult<Vec<Option<Expression>>> {
        if self.accept_sign(")") { Ok(Vec::new()) } else { self.parse_list_until(")") }
    }

    /// Parses an aggregate with or without its type: `{X 1.0,Y 2.0}` or `{FRAME: X 1.0}`.
    fn aggregate(&mut self) -> ReadResult<Expression> {
        self.sign("{")?;
        let type_name = match (self.peek_token(), self.peek_ahead(1)) {
            (Some(Token::Name(name)), Some(Token::Sign(":"))) => {
                self.at += 2;
                Some(name.clone())
            }
            _ => None,
        };
        let mut parts = Vec::new();
        while !self.accept_sign("}") {
            if !parts.is_empty() {
                self.sign(",")?;
            }
            let component = self.parse_variable()?;
            parts.push((component, self.expression()?));
        }
        Ok(Expression::Aggregate { type_name, parts })
    }
}

/// The binary operators with their precedence; 0 is the lowest.
const OPERATOR_PRECEDENCES: [(&str, Binary, usize); 17] = [
    ("==", Binary::Equal, 0),
    ("<>", Binary::Unequal, 0),
    ("<=", Binary::AtMost, 0),
    (">=", Binary::AtLeast, 0),
    ("<", Binary::Less, 0),
    (">", Binary::Greater, 0),
    ("OR", Binary::Or, 1),
    ("B_OR", Binary::BitOr, 1),
    ("EXOR", Binary::Exor, 2),
    ("B_EXOR", Binary::BitExor, 2),
    ("AND", Binary::And, 3),
    ("B_AND", Binary::BitAnd, 3),
    ("+", Binary::Plus, 4),
    ("-", Binary::Minus, 4),
    ("*", Binary::Multiply, 5),
    ("/", Binary::Divide, 5),
    (":", Binary::Geometric, 6),
];

/// The types whose declaration does not need the keyword DECL.
const SIMPLE_TYPES: [&str; 11] =
    ["INT", "REAL", "BOOL", "CHAR", "FRAME", "POS", "E3POS", "E6POS", "AXIS", "E3AXIS", "E6AXIS"];
/// Keywords that declare routines of other files. The two that end with P occur only in KUKA's own data lists.
const EXTERNAL_KEYWORDS: [&str; 4] = ["EXT", "EXTFCT", "EXTP", "EXTFCTP"];

/// Returns whether a line is a declaration.
pub(super) fn is_declaration(tokens: &[Token]) -> bool {
    let word = |at: usize| match tokens.get(at) {
        Some(Token::Name(name)) => name.as_str(),
        _ => "",
    };
    let has_name = !word(1).is_empty();
    match word(0) {
        "DECL" | "STRUC" | "ENUM" => true,
        "GLOBAL" => !matches!(word(1), "INTERRUPT" | "DEF" | "DEFFCT"),
        "CONST" | "SIGNAL" | "IMPORT" => has_name,
        "CHANNEL" => matches!(tokens.get(1), Some(Token::Sign(":"))),
        first if EXTERNAL_KEYWORDS.contains(&first) => has_name,
        first => SIMPLE_TYPES.contains(&first) && has_name,
    }
}

/// Returns whether a line is a declaration without the required DECL: a type and a variable, `NAME NAME`.
pub(super) fn is_declaration_without_decl(tokens: &[Token]) -> bool {
    let is_name =
        |token: &Token| matches!(token, Token::Name(name) if RESERVED_WORDS.binary_search(&name.as_str()).is_err());
    let goes_on = |token: &Token| matches!(token, Token::Sign("=" | "[" | ","));
    tokens.len() > 1 && tokens[..2].iter().all(is_name) && tokens.get(2).is_none_or(goes_on)
}

pub(super) fn parse_declaration(reader: &mut TokenReader<'_>, line: usize) -> ReadResult<Declaration> {
    let (mut global, mut constant) = (false, false);
    loop {
        if reader.accept_word("GLOBAL") {
            global = true;
        } else if reader.accept_word("CONST") {
            constant = true;
        } else if !reader.accept_word("DECL") {
            break;
        }
    }
    let kind = if reader.accept_word("STRUC") {
        parse_struc(reader)?
    } else if reader.accept_word("ENUM") {
        enumeration(reader)?
    } else if reader.accept_word("SIGNAL") {
        signal(reader)?
    } else if reader.accept_word("IMPORT") {
        import(reader)?
    } else if reader.accept_word("CHANNEL") || EXTERNAL_KEYWORDS.iter().any(|word| reader.accept_word(word)) {
        reader.skip_line();
        DeclarationContent::Foreign
    } else {
        let type_name = reader.name()?;
        let mut items = vec![item(reader)?];
        while reader.accept_sign(",") {
            items.push(item(reader)?);
        }
        DeclarationContent::Variables { constant, type_name, items }
    };
    reader.end()?;
    Ok(Declaration { line, global, kind })
}

/// Parses the return type of a DEFFCT: a type such as `INT`, or `CHAR[20]` for a string.
pub(super) fn parse_return_type(reader: &mut TokenReader<'_>) -> ReadResult<ReturnType> {
    Ok(ReturnType { type_name: reader.name()?, dimensions: dimensions(reader)? })
}

fn enumeration(reader: &mut TokenReader<'_>) -> ReadResult<DeclarationContent> {
    let name = reader.name()?;
    let mut words = vec![reader.name()?];
    while reader.accept_sign(",") {
        words.push(reader.name()?);
    }
    Ok(DeclarationContent::Enumeration { name, words })
}

/// Parses a structure, `STRUC NAME INT A,B,REAL C`. The type of a component is the last type before it.
fn parse_struc(reader: &mut TokenReader<'_>) -> ReadResult<DeclarationContent> {
    let name = reader.name()?;
    let mut type_name = String::new();
    let mut components = Vec::new();
    loop {
        if matches!(reader.peek_ahead(1), Some(Token::Name(_))) {
            type_name = reader.name()?;
        }
        if type_name.is_empty() {
            return Err(format!("expected a type, found {}", reader.describe_next()).into());
        }
        components.push((type_name.clone(), item(reader)?));
        if !reader.accept_sign(",") {
            return Ok(DeclarationContent::Struc { name, components });
        }
    }
}

/// Parses a signal: `SIGNAL NAME $OUT[3]`, `SIGNAL NAME $IN[1] TO $IN[8]` or `SIGNAL NAME FALSE`.
fn signal(reader: &mut TokenReader<'_>) -> ReadResult<DeclarationContent> {
    let name = reader.name()?;
    if reader.accept_word("FALSE") || reader.accept_word("TRUE") {
        return Ok(DeclarationContent::Signal { name, from: None, to: None });
    }
    let from = reader.parse_variable()?;
    let to = if reader.accept_word("TO") { Some(reader.parse_variable()?) } else { None };
    Ok(DeclarationContent::Signal { name, from: Some(from), to })
}

/// Parses an import: `IMPORT INT NAME IS /R1/OTHER..NAME`.
fn import(reader: &mut TokenReader<'_>) -> ReadResult<DeclarationContent> {
    let type_name = reader.name()?;
    let name = reader.name()?;
    if !reader.skip_past_word("IS") {
        return Err(format!("expected IS, found {}", reader.describe_next()).into());
    }
    reader.skip_line();
    Ok(DeclarationContent::Import { type_name, name })
}

fn item(reader: &mut TokenReader<'_>) -> ReadResult<Item> {
    if matches!(reader.peek_token(), Some(Token::Sign("!"))) {
        return Err(NotRead::NotChecked("a name is not filled in yet ('!')".to_owned()));
    }
    let name = reader.name()?;
    let dimensions = dimensions(reader)?;
    let value = if reader.accept_sign("=") { Some(reader.expression()?) } else { None };
    Ok(Item { name, dimensions, value })
}

/// Parses the dimensions of an array: `[3,4]`, `[]`, or nothing.
fn dimensions(reader: &mut TokenReader<'_>) -> ReadResult<Vec<Option<Expression>>> {
    let dimensions = if reader.accept_sign("[") { reader.parse_list_until("]")? } else { Vec::new() };
    match dimensions.len() {
        0..=3 => Ok(dimensions),
        _ => Err("an array has at most three dimensions".into()),
    }
}
