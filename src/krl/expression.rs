//! Reads the expressions of a line. Comparisons bind weakest in KRL: `A>0 AND B` is `A>(0 AND B)`.

use super::lex::Token;
use super::syntax::{Binary, Call, Expression, Step, Unary, VariableRef};

/// The tokens of one line, read from left to right.
pub(super) struct Reader<'a> {
    tokens: &'a [Token],
    at: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(tokens: &'a [Token]) -> Self {
        Reader { tokens, at: 0 }
    }

    pub(super) fn peek(&self) -> Option<&'a Token> {
        self.tokens.get(self.at)
    }

    pub(super) fn peek_behind(&self, count: usize) -> Option<&'a Token> {
        self.tokens.get(self.at + count)
    }

    /// What stands next, for a message.
    pub(super) fn found(&self) -> String {
        self.peek().map_or("the end of the line".to_owned(), |token| format!("'{token}'"))
    }

    pub(super) fn next(&mut self) -> Option<&'a Token> {
        let token = self.tokens.get(self.at);
        self.at += usize::from(token.is_some());
        token
    }

    pub(super) fn takes_sign(&mut self, sign: &str) -> bool {
        let is_it = matches!(self.peek(), Some(Token::Sign(found)) if *found == sign);
        self.at += usize::from(is_it);
        is_it
    }

    pub(super) fn is_word(&self, word: &str) -> bool {
        matches!(self.peek(), Some(Token::Name(found)) if found == word)
    }

    pub(super) fn takes_word(&mut self, word: &str) -> bool {
        let is_it = self.is_word(word);
        self.at += usize::from(is_it);
        is_it
    }

    pub(super) fn sign(&mut self, sign: &str) -> Result<(), String> {
        if self.takes_sign(sign) {
            Ok(())
        } else {
            Err(format!("'{sign}' is expected instead of {}", self.found()))
        }
    }

    pub(super) fn word(&mut self, word: &str) -> Result<(), String> {
        if self.takes_word(word) { Ok(()) } else { Err(format!("{word} is expected instead of {}", self.found())) }
    }

    pub(super) fn name(&mut self) -> Result<String, String> {
        let found = self.found();
        match self.next() {
            Some(Token::Name(name)) => Ok(name.clone()),
            _ => Err(format!("a name is expected instead of {found}")),
        }
    }

    /// Nothing may be left on the line.
    pub(super) fn end(&self) -> Result<(), String> {
        match self.peek() {
            None => Ok(()),
            Some(_) => Err(format!("{} is left over at the end of the line", self.found())),
        }
    }

    pub(super) fn expression(&mut self) -> Result<Expression, String> {
        self.level(0)
    }

    fn level(&mut self, level: usize) -> Result<Expression, String> {
        let Some(operators) = LEVELS.get(level) else { return self.unary() };
        let mut left = self.level(level + 1)?;
        while let Some(operator) = self.operator(operators) {
            let right = self.level(level + 1)?;
            left = Expression::Binary(operator, Box::new(left), Box::new(right));
        }
        Ok(left)
    }

    fn operator(&mut self, operators: &[(&str, Binary)]) -> Option<Binary> {
        let (_, operator) = operators.iter().find(|(sign, _)| match self.peek() {
            Some(Token::Sign(found)) => found == sign,
            Some(Token::Name(found)) => found == sign,
            _ => false,
        })?;
        self.at += 1;
        Some(*operator)
    }

    fn unary(&mut self) -> Result<Expression, String> {
        for (word, operator) in [("NOT", Unary::Not), ("B_NOT", Unary::BitNot)] {
            if self.takes_word(word) {
                return Ok(Expression::Unary(operator, Box::new(self.unary()?)));
            }
        }
        if self.takes_sign("-") {
            return Ok(match self.unary()? {
                Expression::Int(number) => Expression::Int(number.wrapping_neg()),
                Expression::Real(number) => Expression::Real(-number),
                other => Expression::Unary(Unary::Minus, Box::new(other)),
            });
        }
        if self.takes_sign("+") {
            return self.unary();
        }
        self.primary()
    }

    fn primary(&mut self) -> Result<Expression, String> {
        let found = self.found();
        match self.peek() {
            Some(Token::Sign("(")) => {
                self.at += 1;
                let inside = self.expression()?;
                self.sign(")")?;
                Ok(inside)
            }
            Some(Token::Sign("{")) => self.aggregate(),
            Some(Token::Name(name)) => match name.as_str() {
                "TRUE" | "FALSE" => {
                    self.at += 1;
                    Ok(Expression::Bool(name == "TRUE"))
                }
                _ if matches!(self.peek_behind(1), Some(Token::Sign("("))) => Ok(Expression::Call(self.call()?)),
                _ => Ok(Expression::Variable(self.place()?)),
            },
            Some(token) => {
                let value = match token {
                    Token::Int(number) => Expression::Int(*number),
                    Token::Real(number) => Expression::Real(*number),
                    Token::Text(text) => Expression::Text(text.clone()),
                    Token::Word(word) => Expression::Word(word.clone()),
                    Token::Sign(_) | Token::Name(_) => {
                        return Err(format!("a value is expected instead of {found}"));
                    }
                };
                self.at += 1;
                Ok(value)
            }
            None => Err("a value is missing at the end of the line".to_owned()),
        }
    }

    /// A name with its indices and components.
    pub(super) fn place(&mut self) -> Result<VariableRef, String> {
        let name = self.name()?;
        let mut steps = Vec::new();
        loop {
            if self.takes_sign("[") {
                if self.takes_sign("]") {
                    steps.push(Step::Whole);
                    continue;
                }
                let mut indices = vec![self.expression()?];
                while self.takes_sign(",") {
                    indices.push(self.expression()?);
                }
                self.sign("]")?;
                steps.push(Step::Index(indices));
            } else if self.takes_sign(".") {
                steps.push(Step::Component(self.name()?));
            } else {
                return Ok(VariableRef { name, steps });
            }
        }
    }

    /// A routine's name and its arguments in brackets.
    pub(super) fn call(&mut self) -> Result<Call, String> {
        let name = self.name()?;
        self.sign("(")?;
        let mut arguments = Vec::new();
        if !self.takes_sign(")") {
            loop {
                arguments.push(self.expression()?);
                if self.takes_sign(")") {
                    break;
                }
                self.sign(",")?;
            }
        }
        Ok(Call { name, arguments })
    }

    /// `{X 1.0,Y 2.0}`, with or without its type: `{FRAME: X 1.0}`.
    fn aggregate(&mut self) -> Result<Expression, String> {
        self.sign("{")?;
        let type_name = match (self.peek(), self.peek_behind(1)) {
            (Some(Token::Name(name)), Some(Token::Sign(":"))) => {
                self.at += 2;
                Some(name.clone())
            }
            _ => None,
        };
        let mut parts = Vec::new();
        while !self.takes_sign("}") {
            if !parts.is_empty() {
                self.sign(",")?;
            }
            let component = self.place()?;
            parts.push((component, self.expression()?));
        }
        Ok(Expression::Aggregate { type_name, parts })
    }
}

/// From the weakest operators to the strongest.
const LEVELS: [&[(&str, Binary)]; 7] = [
    &[
        ("==", Binary::Equal),
        ("<>", Binary::Unequal),
        ("<=", Binary::AtMost),
        (">=", Binary::AtLeast),
        ("<", Binary::Less),
        (">", Binary::Greater),
    ],
    &[("OR", Binary::Or), ("B_OR", Binary::BitOr)],
    &[("EXOR", Binary::Exor), ("B_EXOR", Binary::BitExor)],
    &[("AND", Binary::And), ("B_AND", Binary::BitAnd)],
    &[("+", Binary::Plus), ("-", Binary::Minus)],
    &[("*", Binary::Times), ("/", Binary::By)],
    &[(":", Binary::Geometric)],
];
