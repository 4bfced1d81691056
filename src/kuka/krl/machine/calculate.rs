//! Arithmetic as in KRL: INT of 32 bits with truncation, REAL of 32 bits, enumeration constants and BOOL.

use super::super::code::Cell;
use super::super::syntax::Binary;
use super::outcome::StepError;

/// Returns the result of an operator between two values of the same type.
pub(super) fn binary(operator: Binary, left: Cell, right: Cell) -> Result<Cell, StepError> {
    match (left, right) {
        (Cell::Int(left), Cell::Int(right)) => integer_operation(operator, left, right),
        (Cell::Real(left), Cell::Real(right)) => real_operation(operator, left, right),
        (Cell::Bool(left), Cell::Bool(right)) => bool(operator, left, right),
        (Cell::Word(left), Cell::Word(right)) => compare(operator, left.cmp(&right)),
        (Cell::Char(left), Cell::Char(right)) => compare(operator, left.cmp(&right)),
        _ => Err("a variable is used before a value is assigned to the variable".into()),
    }
}

fn integer_operation(operator: Binary, left: i32, right: i32) -> Result<Cell, StepError> {
    let result = match operator {
        Binary::Plus => left.checked_add(right),
        Binary::Minus => left.checked_sub(right),
        Binary::Multiply => left.checked_mul(right),
        Binary::Divide if right == 0 => return Err("division by zero".into()),
        Binary::Divide => left.checked_div(right),
        Binary::BitAnd => Some(left & right),
        Binary::BitOr => Some(left | right),
        Binary::BitExor => Some(left ^ right),
        _ => return compare(operator, left.cmp(&right)),
    };
    result
        .map(Cell::Int)
        .ok_or_else(|| format!("the result of an operation on {left} and {right} does not fit into an INT").into())
}

fn real_operation(operator: Binary, left: f32, right: f32) -> Result<Cell, StepError> {
    let result = match operator {
        Binary::Plus => left + right,
        Binary::Minus => left - right,
        Binary::Multiply => left * right,
        Binary::Divide if right == 0.0 => return Err("division by zero".into()),
        Binary::Divide => left / right,
        _ => return compare(operator, left.partial_cmp(&right).unwrap_or(std::cmp::Ordering::Less)),
    };
    if result.is_finite() { Ok(Cell::Real(result)) } else { Err("the result does not fit into a REAL".into()) }
}

fn bool(operator: Binary, left: bool, right: bool) -> Result<Cell, StepError> {
    Ok(Cell::Bool(match operator {
        Binary::And => left && right,
        Binary::Or => left || right,
        Binary::Exor | Binary::Unequal => left != right,
        Binary::Equal => left == right,
        _ => return Err("this operator is not valid for BOOL values".into()),
    }))
}

fn compare(operator: Binary, order: std::cmp::Ordering) -> Result<Cell, StepError> {
    Ok(Cell::Bool(match operator {
        Binary::Equal => order.is_eq(),
        Binary::Unequal => order.is_ne(),
        Binary::Less => order.is_lt(),
        Binary::AtMost => order.is_le(),
        Binary::Greater => order.is_gt(),
        Binary::AtLeast => order.is_ge(),
        _ => return Err("this operator is not valid for values of this type".into()),
    }))
}

/// Changes the sign.
pub(super) fn negate(number: i32) -> Result<Cell, StepError> {
    number.checked_neg().map(Cell::Int).ok_or_else(|| "the result does not fit into an INT".into())
}

/// Converts a REAL to the nearest INT.
pub(super) fn round_to_int(number: f32) -> Result<Cell, StepError> {
    let rounded = f64::from(number).round();
    if rounded.abs() <= 2_147_483_647.0 {
        Ok(Cell::Int(rounded as i32))
    } else {
        Err(format!("{number} does not fit into an INT").into())
    }
}
