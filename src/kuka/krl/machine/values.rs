//! Steps that only pop and push values: the operators and functions of the language.
//!
//! Combined steps are executed as one operation. Arithmetic is that of KRL: 32-bit INT with truncating division, 32-bit
//! REAL, enumeration constants and BOOL.

use super::super::code::{
    Cell, CombinedOp, CondensedValue, LocationStart, MemoryAddress, MemorySpace, Op, Program,
};
use super::super::routines::Builtin;
use super::super::syntax::Binary;
use super::host::{Host, compose_frames, numbers};
use super::interpreter::{INVALID, Interpreter, Memory, StepError};

impl Interpreter {
    /// Executes a step that only pops and pushes values; returns false for other steps.
    pub(super) fn value_op(&mut self, op: &Op) -> Result<bool, StepError> {
        match *op {
            Op::Binary(operator) => {
                let right = self.pop()?;
                let left = self.pop()?;
                self.stack.push(binary(operator, left, right)?);
            }
            Op::ToReal(below) => {
                let at = self
                    .stack
                    .len()
                    .checked_sub(1 + below as usize)
                    .ok_or("internal error of the KRL interpreter: its stack is empty")?;
                match self.stack[at] {
                    Cell::Int(number) => self.stack[at] = Cell::Real(number as f32),
                    Cell::Real(_) => {}
                    _ => return Err(INVALID.into()),
                }
            }
            Op::ToInt => {
                let number = self.pop_real()?;
                self.stack.push(round_to_int(number)?);
            }
            Op::Negate => match self.pop()? {
                Cell::Int(number) => self.stack.push(negate(number)?),
                Cell::Real(number) => self.stack.push(Cell::Real(-number)),
                _ => return Err(INVALID.into()),
            },
            Op::Not => {
                let value = self.pop_bool()?;
                self.stack.push(Cell::Bool(!value));
            }
            Op::BitNot => {
                let value = self.pop_int()?;
                self.stack.push(Cell::Int(!value));
            }
            Op::Geometric => {
                let right = numbers(self.pop_block()?)?;
                let left = numbers(self.pop_block()?)?;
                self.stack.extend(compose_frames(left, right).map(Cell::Real));
            }
            Op::ForTest => {
                let (step, last, now) = (self.pop_int()?, self.pop_int()?, self.pop_int()?);
                self.stack.push(Cell::Bool(if step >= 0 { now <= last } else { now >= last }));
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    pub(super) fn builtin(
        &mut self,
        builtin: Builtin,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), StepError> {
        let one = |value: f32, f: fn(f64) -> f64| Cell::Real(f(f64::from(value)) as f32);
        let result = match builtin {
            Builtin::Abs => one(self.pop_real()?, f64::abs),
            Builtin::Sqrt => one(self.pop_real()?, f64::sqrt),
            Builtin::Sin => one(self.pop_real()?, |degrees| degrees.to_radians().sin()),
            Builtin::Cos => one(self.pop_real()?, |degrees| degrees.to_radians().cos()),
            Builtin::Tan => one(self.pop_real()?, |degrees| degrees.to_radians().tan()),
            Builtin::Acos => one(self.pop_real()?, |cosine| cosine.acos().to_degrees()),
            Builtin::Atan2 => {
                let (x, y) = (self.pop_real()?, self.pop_real()?);
                Cell::Real(f64::from(y).atan2(f64::from(x)).to_degrees() as f32)
            }
            _ => return self.controller_call(builtin, program, memory, host),
        };
        match result {
            Cell::Real(number) if number.is_finite() => self.stack.push(result),
            _ => return Err("the result is not a finite number".into()),
        }
        Ok(())
    }
}

impl Interpreter {
    /// Executes the combined operation that begins at this step; returns false if its steps must be executed one by
    /// one.
    pub(super) fn run_condensed(
        &mut self,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<bool, StepError> {
        let (together, waits) = match program.condensed.steps.get(self.step_index) {
            None | Some((CombinedOp::Nothing, _)) => return Ok(false),
            Some((together, waits)) => (together, *waits),
        };
        // The steps must be executed one by one if the robot program may have to wait for the arm between them.
        let may_not = self.condition_base.is_none() || matches!(together, CombinedOp::Assign { .. });
        if waits && self.moves && may_not {
            return Ok(false);
        }
        let base = self.base();
        match *together {
            CombinedOp::Nothing => return Ok(false),
            CombinedOp::Value { value, next } => {
                let cell = self.part(value, base, program, memory, host)?;
                self.stack.push(cell);
                self.step_index = next as usize;
            }
            CombinedOp::Branch { value, at, to, next } => {
                let Cell::Bool(holds) = self.part(value, base, program, memory, host)? else {
                    return Err(INVALID.into());
                };
                memory.branches[at as usize][usize::from(holds)] = true;
                self.step_index = if holds { next } else { to } as usize;
            }
            CombinedOp::Assign { place, value, next } => {
                let address = self.address(place, base, program, memory, host)?;
                let cell = self.part(value, base, program, memory, host)?;
                self.write(address, cell, memory, host)?;
                self.step_index = next as usize;
            }
        }
        Ok(true)
    }

    fn address(
        &self,
        place: u32,
        base: usize,
        program: &Program,
        memory: &Memory,
        host: &mut dyn Host,
    ) -> Result<MemoryAddress, StepError> {
        let place = &program.condensed.places[place as usize];
        let mut address = match place.start {
            LocationStart::Space(MemorySpace::Frame) => {
                MemoryAddress { space: MemorySpace::Frame, offset: base as u32 + place.offset }
            }
            LocationStart::Space(space) => MemoryAddress { space, offset: place.offset },
            LocationStart::Referred(cell) => match self.cells.get(base + cell as usize) {
                Some(Cell::Address(address)) => MemoryAddress { offset: address.offset + place.offset, ..*address },
                _ => return Err("internal error of the KRL interpreter: an address is missing".into()),
            },
        };
        if let Some(index) = place.index {
            let Cell::Int(number) = self.part(index.value, base, program, memory, host)? else {
                return Err(INVALID.into());
            };
            let count = index.count;
            if number < 1 || number.cast_unsigned() > count {
                return Err(format!("the index {number} is outside of the array (valid: 1 to {count})").into());
            }
            address.offset += (number.cast_unsigned() - 1) * index.size;
        }
        Ok(address)
    }

    /// Evaluates an operand. Constants and variables, the most common operands, are handled here without a call.
    #[inline(always)]
    fn part(
        &self,
        value: u32,
        base: usize,
        program: &Program,
        memory: &Memory,
        host: &mut dyn Host,
    ) -> Result<Cell, StepError> {
        let cell = match program.condensed.values[value as usize] {
            CondensedValue::Fixed(cell) => cell,
            CondensedValue::Global(at) => memory.cells[at as usize],
            CondensedValue::Local(at) => self.cells[base + at as usize],
            _ => Cell::Unset,
        };
        // If the value was never assigned, `value` is called because it reports the error.
        if cell == Cell::Unset { self.value(value, base, program, memory, host) } else { Ok(cell) }
    }

    fn value(
        &self,
        value: u32,
        base: usize,
        program: &Program,
        memory: &Memory,
        host: &mut dyn Host,
    ) -> Result<Cell, StepError> {
        let cell = match program.condensed.values[value as usize] {
            CondensedValue::Fixed(cell) => return Ok(cell),
            CondensedValue::Global(at) => memory.cells.get(at as usize).copied().unwrap_or(Cell::Unset),
            CondensedValue::Local(at) => self.cells.get(base + at as usize).copied().unwrap_or(Cell::Unset),
            CondensedValue::At(place) => {
                let address = self.address(place, base, program, memory, host)?;
                self.read(address, memory, host)?
            }
            CondensedValue::Binary(operator, left, right) => {
                let left = self.part(left, base, program, memory, host)?;
                let right = self.part(right, base, program, memory, host)?;
                return binary(operator, left, right);
            }
            CondensedValue::Decided { operator, left, right } => {
                let left = self.part(left, base, program, memory, host)?;
                if self.meaning.short_circuit && left == Cell::Bool(operator == Binary::Or) {
                    return Ok(left);
                }
                let right = self.part(right, base, program, memory, host)?;
                return binary(operator, left, right);
            }
            CondensedValue::ForTest(parts) => return self.for_test(parts, base, program, memory, host),
            CondensedValue::ToReal(of) => match self.value(of, base, program, memory, host)? {
                Cell::Int(number) => return Ok(Cell::Real(number as f32)),
                real @ Cell::Real(_) => return Ok(real),
                _ => Cell::Unset,
            },
            CondensedValue::ToInt(of) => match self.value(of, base, program, memory, host)? {
                Cell::Real(number) => return round_to_int(number),
                _ => Cell::Unset,
            },
            CondensedValue::Negate(of) => match self.value(of, base, program, memory, host)? {
                Cell::Int(number) => return negate(number),
                Cell::Real(number) => return Ok(Cell::Real(-number)),
                _ => Cell::Unset,
            },
            CondensedValue::Not(of) => match self.value(of, base, program, memory, host)? {
                Cell::Bool(value) => return Ok(Cell::Bool(!value)),
                _ => Cell::Unset,
            },
            CondensedValue::BitNot(of) => match self.value(of, base, program, memory, host)? {
                Cell::Int(number) => return Ok(Cell::Int(!number)),
                _ => Cell::Unset,
            },
        };
        if cell == Cell::Unset { Err(INVALID.into()) } else { Ok(cell) }
    }

    fn for_test(
        &self,
        parts: [u32; 3],
        base: usize,
        program: &Program,
        memory: &Memory,
        host: &mut dyn Host,
    ) -> Result<Cell, StepError> {
        let mut numbers = [0; 3];
        for (number, part) in numbers.iter_mut().zip(parts) {
            match self.part(part, base, program, memory, host)? {
                Cell::Int(found) => *number = found,
                _ => return Err(INVALID.into()),
            }
        }
        let [now, last, step] = numbers;
        Ok(Cell::Bool(if step >= 0 { now <= last } else { now >= last }))
    }
}

/// Applies an operator to two values of the same type.
fn binary(operator: Binary, left: Cell, right: Cell) -> Result<Cell, StepError> {
    match (left, right) {
        (Cell::Int(left), Cell::Int(right)) => integer_operation(operator, left, right),
        (Cell::Real(left), Cell::Real(right)) => real_operation(operator, left, right),
        (Cell::Bool(left), Cell::Bool(right)) => bool_operation(operator, left, right),
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

fn bool_operation(operator: Binary, left: bool, right: bool) -> Result<Cell, StepError> {
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
fn negate(number: i32) -> Result<Cell, StepError> {
    number.checked_neg().map(Cell::Int).ok_or_else(|| "the result does not fit into an INT".into())
}

/// Converts a REAL to the nearest INT.
fn round_to_int(number: f32) -> Result<Cell, StepError> {
    let rounded = f64::from(number).round();
    if rounded.abs() <= 2_147_483_647.0 {
        Ok(Cell::Int(rounded as i32))
    } else {
        Err(format!("{number} does not fit into an INT").into())
    }
}
