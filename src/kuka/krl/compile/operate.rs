//! Compiles operators between two values.

use super::super::code::Op;
use super::super::syntax::{Binary, Expression};
use super::super::types::Type;
use super::compiler::{Compiler, cells_u32};

impl Compiler<'_> {
    pub(super) fn binary(&mut self, operator: Binary, left: &Expression, right: &Expression) -> Type {
        match operator {
            Binary::And | Binary::Or => self.compile_logical(operator, left, right),
            Binary::Geometric => self.compile_geometric(left, right),
            Binary::Equal | Binary::Unequal => {
                // An enumeration constant belongs to the enumeration on the other side; a text of one character is
                // a CHAR if the other side is a CHAR.
                let is_of_other = matches!(left, Expression::Word(_) | Expression::Text(_));
                let (left, right) = if is_of_other { (right, left) } else { (left, right) };
                self.compare(operator, left, right)
            }
            Binary::Less | Binary::AtMost | Binary::Greater | Binary::AtLeast => {
                self.compare(operator, left, right)
            }
            Binary::Multiply | Binary::Divide | Binary::Plus | Binary::Minus => {
                let (left, right) = self.compile_operands(left, right);
                let kind = self.number(operator, left, right);
                self.emit(Op::Binary(operator));
                kind
            }
            Binary::Exor => self.compile_same_type(operator, left, right, Type::Bool),
            Binary::BitAnd | Binary::BitOr | Binary::BitExor => {
                self.compile_same_type(operator, left, right, Type::Int)
            }
        }
    }

    fn compile_operands(&mut self, left: &Expression, right: &Expression) -> (Type, Type) {
        let left = self.value(left, Type::Unknown);
        (left, self.value(right, left))
    }

    /// Compiles an arithmetic operator: INT with REAL gives REAL; CHAR is a number from 0 to 255.
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
            (Type::Char | Type::Int | Type::Real, Type::Char | Type::Int | Type::Real) => {
                self.record_unexecuted("a calculation with CHAR");
                if left == Type::Real || right == Type::Real { Type::Real } else { Type::Int }
            }
            _ => self.report_operand_mismatch(operator, left, right),
        }
    }

    fn report_operand_mismatch(&mut self, operator: Binary, left: Type, right: Type) -> Type {
        let (left, right) = (self.types.name(left), self.types.name(right));
        let hint = match operator {
            Binary::And | Binary::Or | Binary::Exor => {
                "; in KRL, comparisons have a lower precedence: put each comparison in brackets"
            }
            _ => "",
        };
        self.problem(sign(operator), format!("this operator is not valid between {left} and {right}{hint}"));
        Type::Unknown
    }

    fn compile_same_type(&mut self, operator: Binary, left: &Expression, right: &Expression, wanted: Type) -> Type {
        let (left, right) = self.compile_operands(left, right);
        self.emit(Op::Binary(operator));
        if wanted == Type::Int && (left == Type::Char || right == Type::Char) {
            self.record_unexecuted("a calculation with CHAR");
        }
        let fits =
            |kind: Type| kind == wanted || kind == Type::Unknown || (wanted == Type::Int && kind == Type::Char);
        if fits(left) && fits(right) { wanted } else { self.report_operand_mismatch(operator, left, right) }
    }

    fn compile_logical(&mut self, operator: Binary, left: &Expression, right: &Expression) -> Type {
        let kind = self.value(left, Type::Bool);
        let jump = self.emit(Op::JumpDecided { decided: operator == Binary::Or, to: 0 });
        let other = self.value(right, Type::Bool);
        self.emit(Op::Binary(operator));
        self.set_jump_target(jump);
        let fits = |kind: Type| matches!(kind, Type::Bool | Type::Unknown);
        if fits(kind) && fits(other) { Type::Bool } else { self.report_operand_mismatch(operator, kind, other) }
    }

    fn compare(&mut self, operator: Binary, left: &Expression, right: &Expression) -> Type {
        let (left, right) = self.compile_operands(left, right);
        let ordered = !matches!(operator, Binary::Equal | Binary::Unequal);
        match (left, right) {
            (Type::Struc(_), Type::Struc(_)) if !ordered && self.types.are_same_type(left, right) => {
                self.record_unexecuted("a comparison of structures");
            }
            (Type::Text | Type::Char, Type::Text) | (Type::Text, Type::Char) => {
                self.record_unexecuted("a comparison of texts");
            }
            _ if self.types.are_same_type(left, right)
                && (!ordered || matches!(left, Type::Int | Type::Real | Type::Char | Type::Enumeration(_))) => {}
            _ => {
                self.number(operator, left, right);
            }
        }
        self.emit(Op::Binary(operator));
        Type::Bool
    }

    /// Compiles `POS:FRAME` and similar expressions: two values of 6 numbers each, with 6 numbers as the result.
    fn compile_geometric(&mut self, left: &Expression, right: &Expression) -> Type {
        let frame = self.types.kuka_type("FRAME");
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
        if sides.into_iter().all(fits) {
            frame
        } else {
            self.report_operand_mismatch(Binary::Geometric, sides[0], sides[1])
        }
    }
}

fn sign(operator: Binary) -> &'static str {
    match operator {
        Binary::Multiply => "*",
        Binary::Divide => "/",
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
