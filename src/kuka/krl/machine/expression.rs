//! Executes at once the steps that [`condense`](super::super::condense) has combined.

use super::super::code::{Cell, MemoryAddress, MemorySpace};
use super::super::condense::{CombinedOp, CondensedValue, LocationStart};
use super::super::program::Program;
use super::super::syntax::Binary;
use super::calculate;
use super::host::Host;
use super::interpreter::Interpreter;
use super::memory::Memory;
use super::outcome::StepError;
use super::stack::INVALID;

impl Interpreter {
    /// Executes the combined steps that begin here; returns false if they must be executed one by one.
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
        // The steps must be executed one by one if the robot program may have to wait for the arm in the middle of
        // them.
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

    /// Evaluates an operand of another value: most operands are constants and variables.
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
        // A value that was never assigned is also evaluated by `value`, which reports it.
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
                return calculate::binary(operator, left, right);
            }
            CondensedValue::Decided { operator, left, right } => {
                let left = self.part(left, base, program, memory, host)?;
                if self.meaning.short_circuit && left == Cell::Bool(operator == Binary::Or) {
                    return Ok(left);
                }
                let right = self.part(right, base, program, memory, host)?;
                return calculate::binary(operator, left, right);
            }
            CondensedValue::ForTest(parts) => return self.for_test(parts, base, program, memory, host),
            CondensedValue::ToReal(of) => match self.value(of, base, program, memory, host)? {
                Cell::Int(number) => return Ok(Cell::Real(number as f32)),
                real @ Cell::Real(_) => return Ok(real),
                _ => Cell::Unset,
            },
            CondensedValue::ToInt(of) => match self.value(of, base, program, memory, host)? {
                Cell::Real(number) => return calculate::round_to_int(number),
                _ => Cell::Unset,
            },
            CondensedValue::Negate(of) => match self.value(of, base, program, memory, host)? {
                Cell::Int(number) => return calculate::negate(number),
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
