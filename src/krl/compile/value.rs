//! Values: expressions that put something on the stack.

use super::super::code::{Cell, Op};
use super::super::syntax::{Expression, Unary, VariableRef};
use super::super::types::Type;
use super::compiler::{Compiler, cells_u32};

impl Compiler<'_> {
    /// Puts the value of an expression on the stack and says its type. `wanted` tells which enumeration a word is of,
    /// and which structure an aggregate.
    pub(super) fn value(&mut self, expression: &Expression, wanted: Type) -> Type {
        match expression {
            Expression::Int(number) => self.push(Cell::Int(*number), Type::Int),
            Expression::Real(number) => self.push(Cell::Real(*number), Type::Real),
            Expression::Bool(value) => self.push(Cell::Bool(*value), Type::Bool),
            Expression::Text(text) => {
                let index = self.text(text);
                self.push(Cell::Text(index), Type::Text)
            }
            Expression::Word(word) => self.word(word, wanted),
            Expression::Variable(place) => self.variable_value(place),
            Expression::Call(call) => match self.call(call) {
                Some(kind) => kind,
                None => {
                    self.problem(&call.name, "this routine gives back no value");
                    Type::Unknown
                }
            },
            Expression::Aggregate { type_name, parts } => self.aggregate(type_name.as_deref(), parts, wanted),
            Expression::Unary(operator, inner) => self.unary(*operator, inner),
            Expression::Binary(operator, left, right) => self.binary(*operator, left, right),
        }
    }

    fn push(&mut self, cell: Cell, kind: Type) -> Type {
        self.emit(Op::Push(cell));
        kind
    }

    pub(super) fn text(&mut self, text: &str) -> u32 {
        let texts = &mut self.program.texts;
        let index = texts.iter().position(|known| known == text).unwrap_or_else(|| {
            texts.push(text.to_owned());
            texts.len() - 1
        });
        cells_u32(index)
    }

    fn word(&mut self, word: &str, wanted: Type) -> Type {
        if wanted == Type::Unknown {
            return self.push(Cell::Word(u16::MAX), Type::Unknown);
        }
        match self.types.word(wanted, word).and_then(|place| u16::try_from(place).ok()) {
            Some(place) => self.push(Cell::Word(place), wanted),
            None => {
                let name = self.types.name(wanted);
                let known = match wanted {
                    Type::Enumeration(index) => {
                        format!("; its words are #{}", self.types.enumerations[index].words.join(", #"))
                    }
                    _ => String::new(),
                };
                self.problem(&format!("#{word}"), format!("this is no word of {name}{known}"));
                Type::Unknown
            }
        }
    }

    fn variable_value(&mut self, place: &VariableRef) -> Type {
        let Some(found) = self.address(place) else { return Type::Unknown };
        if found.dimensions.is_empty() {
            self.load(found.kind);
            return found.kind;
        }
        if found.kind != Type::Char {
            self.problem(&place.name, "an array as a whole is no value; an index is missing");
        }
        Type::Text
    }

    fn aggregate(&mut self, type_name: Option<&str>, parts: &[(VariableRef, Expression)], wanted: Type) -> Type {
        let kind = type_name.map_or(wanted, |name| self.type_named(name));
        let Some(struc) = self.types.struc(kind).cloned() else {
            if kind != Type::Unknown {
                let name = self.types.name(kind);
                self.problem("{", format!("components are given where {name} is wanted"));
            }
            return Type::Unknown;
        };
        for (place, _) in parts {
            let known = struc.components.iter().any(|component| component.name == place.name);
            if !known || !place.steps.is_empty() {
                self.problem(&place.name, format!("{} has no such component", struc.name));
            }
        }
        for component in &struc.components {
            let given = parts.iter().find(|(place, _)| place.name == component.name);
            match given {
                Some((_, value)) => self.typed_value(value, component.kind, &component.name),
                None => {
                    for _ in 0..self.types.cells(component.kind, &component.dimensions) {
                        self.emit(Op::Push(Cell::Unset));
                    }
                }
            }
        }
        kind
    }

    fn unary(&mut self, operator: Unary, inner: &Expression) -> Type {
        let kind = self.value(inner, Type::Unknown);
        let (op, allowed): (Op, &[Type]) = match operator {
            Unary::Minus => (Op::Negate, &[Type::Int, Type::Real]),
            Unary::Not => (Op::Not, &[Type::Bool]),
            Unary::BitNot => (Op::BitNot, &[Type::Int]),
        };
        self.emit(op);
        if kind != Type::Unknown && !allowed.contains(&kind) {
            let name = self.types.name(kind);
            let sign = match operator {
                Unary::Minus => "-",
                Unary::Not => "NOT",
                Unary::BitNot => "B_NOT",
            };
            self.problem(sign, format!("{sign} does not go with {name}"));
            return Type::Unknown;
        }
        kind
    }

    /// A value that must be of this type; INT and REAL are changed into each other, as KRL does.
    pub(super) fn typed_value(&mut self, expression: &Expression, wanted: Type, key: &str) {
        let found = self.value(expression, wanted);
        self.convert(found, wanted, key);
    }

    pub(super) fn convert(&mut self, found: Type, wanted: Type, key: &str) {
        match (found, wanted) {
            (Type::Unknown, _) | (_, Type::Unknown) => {}
            (found, wanted) if found == wanted => {}
            (Type::Int, Type::Real) => {
                self.emit(Op::ToReal(0));
            }
            (Type::Real, Type::Int) => {
                self.emit(Op::ToInt);
            }
            _ => {
                let (found, wanted) = (self.types.name(found), self.types.name(wanted));
                self.problem(key, format!("{wanted} is wanted, {found} is given"));
            }
        }
    }
}
