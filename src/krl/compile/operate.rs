//! Operators between two values.

use super::super::code::Op;
use super::super::syntax::{Binary, Expression};
use super::super::types::Type;
use super::compiler::{Compiler, cells_u32};

impl Compiler<'_> {
    pub(super) fn binary(&mut self, operator: Binary, left: &Expression, right: &Expression) -> Type {
        match operator {
            Binary::And | Binary::Or => self.logical(operator, left, right),
            Binary::Geometric => self.geometric(left, right),
            Binary::Equal | Binary::Unequal => {
                // A word is of the enumeration on the other side.
                let (left, right) = if matches!(left, Expression::Word(_)) { (right, left) } else { (left, right) };
                self.compare(operator, left, right)
            }
            Binary::Less | Binary::AtMost | Binary::Greater | Binary::AtLeast => {
                self.compare(operator, left, right)
            }
            Binary::Times | Binary::By | Binary::Plus | Binary::Minus => {
                let (left, right) = self.two(left, right);
                let kind = self.number(operator, left, right);
                self.emit(Op::Binary(operator));
                kind
            }
            Binary::Exor => self.same(operator, left, right, Type::Bool),
            Binary::BitAnd | Binary::BitOr | Binary::BitExor => self.same(operator, left, right, Type::Int),
        }
    }

    fn two(&mut self, left: &Expression, right: &Expression) -> (Type, Type) {
        let left = self.value(left, Type::Unknown);
        (left, self.value(right, left))
    }

    /// INT beside REAL becomes REAL.
    fn number(&mut self, operator: Binary, left: Type, right: Type) -> Type {
        match (left, right) {
            (Type::Unknown, _) | (_, Type::Unknown) => Type::Unknown,
            (Type::Int, Type::Int) => Type::Int,
            (Type::Real, Type::Real) => Type::Real,
            (Type::Int, Type::Real) => {
                self.emit(Op::ToReal(1));
                Type::Real
            }
            (Type::Real, Type::Int) => {
                self.emit(Op::ToReal(0));
                Type::Real
            }
            _ => self.mismatch(operator, left, right),
        }
    }

    fn mismatch(&mut self, operator: Binary, left: Type, right: Type) -> Type {
        let (left, right) = (self.types.name(left), self.types.name(right));
        let hint = match operator {
            Binary::And | Binary::Or | Binary::Exor => "; in KRL comparisons bind weaker: put them in brackets",
            _ => "",
        };
        self.problem(sign(operator), format!("this does not go between {left} and {right}{hint}"));
        Type::Unknown
    }

    fn same(&mut self, operator: Binary, left: &Expression, right: &Expression, wanted: Type) -> Type {
        let (left, right) = self.two(left, right);
        self.emit(Op::Binary(operator));
        let fits = |kind: Type| kind == wanted || kind == Type::Unknown;
        if fits(left) && fits(right) { wanted } else { self.mismatch(operator, left, right) }
    }

    fn logical(&mut self, operator: Binary, left: &Expression, right: &Expression) -> Type {
        let kind = self.value(left, Type::Bool);
        let jump = self.emit(Op::JumpDecided { decided: operator == Binary::Or, to: 0 });
        let other = self.value(right, Type::Bool);
        self.emit(Op::Binary(operator));
        self.lead_here(jump);
        let fits = |kind: Type| matches!(kind, Type::Bool | Type::Unknown);
        if fits(kind) && fits(other) { Type::Bool } else { self.mismatch(operator, kind, other) }
    }

    fn compare(&mut self, operator: Binary, left: &Expression, right: &Expression) -> Type {
        let (left, right) = self.two(left, right);
        let ordered = !matches!(operator, Binary::Equal | Binary::Unequal);
        let simple = |kind: Type| !matches!(kind, Type::Struc(_) | Type::Text);
        if left == right && simple(left) && (!ordered || matches!(left, Type::Int | Type::Real | Type::Char)) {
            self.emit(Op::Binary(operator));
            return Type::Bool;
        }
        self.number(operator, left, right);
        self.emit(Op::Binary(operator));
        Type::Bool
    }

    /// `POS:FRAME` and so on: 6 numbers each, 6 numbers come out.
    fn geometric(&mut self, left: &Expression, right: &Expression) -> Type {
        let frame = self.types.find("FRAME").unwrap_or(Type::Unknown);
        let mut sides = [Type::Unknown; 2];
        for (side, expression) in sides.iter_mut().zip([left, right]) {
            *side = self.value(expression, frame);
            let cells = cells_u32(self.types.size(*side));
            if self.types.is_pose(*side) && cells > 6 {
                self.emit(Op::Keep { first: 6, of: cells });
            }
        }
        self.emit(Op::Geometric);
        let fits = |kind: Type| kind == Type::Unknown || self.types.is_pose(kind);
        if sides.into_iter().all(fits) { frame } else { self.mismatch(Binary::Geometric, sides[0], sides[1]) }
    }
}

fn sign(operator: Binary) -> &'static str {
    match operator {
        Binary::Times => "*",
        Binary::By => "/",
        Binary::Plus => "+",
        Binary::Minus => "-",
        Binary::Geometric => ":",
        Binary::And => "AND",
        Binary::Or => "OR",
        Binary::Exor => "EXOR",
        Binary::BitAnd => "B_AND",
        Binary::BitOr => "B_OR",
        Binary::BitExor => "B_EXOR",
        Binary::Equal => "==",
        Binary::Unequal => "<>",
        Binary::Less => "<",
        Binary::AtMost => "<=",
        Binary::Greater => ">",
        Binary::AtLeast => ">=",
    }
}
