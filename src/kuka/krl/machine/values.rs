//! Steps that pop and push values: operators and functions of the language.

use super::super::code::{Cell, Op};
use super::super::program::Program;
use super::super::routines::Builtin;
use super::calculate;
use super::host::Host;
use super::interpreter::Interpreter;
use super::memory::Memory;
use super::outcome::StepError;
use super::stack::INVALID;

impl Interpreter {
    /// Executes a step that only pops and pushes values; returns false for other steps.
    pub(super) fn value_op(&mut self, op: &Op) -> Result<bool, StepError> {
        match *op {
            Op::Binary(operator) => {
                let right = self.pop()?;
                let left = self.pop()?;
                self.stack.push(calculate::binary(operator, left, right)?);
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
                self.stack.push(calculate::round_to_int(number)?);
            }
            Op::Negate => match self.pop()? {
                Cell::Int(number) => self.stack.push(calculate::negate(number)?),
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
                let right = super::robot::numbers(self.pop_block()?)?;
                let left = super::robot::numbers(self.pop_block()?)?;
                self.stack.extend(super::robot::compose_frames(left, right).map(Cell::Real));
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
