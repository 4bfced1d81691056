//! One statement: step after step until the next one begins, or until it must wait.

use super::super::code::{Address, Cell, Op, Space};
use super::super::program::Program;
use super::super::system::{Builtin, SYSTEM_VARIABLES};
use super::calculate;
use super::host::Host;
use super::interpreter::Interpreter;
use super::memory::Memory;
use super::outcome::{Flow, Pause, Wrong};

type Stepped = Result<Flow, Wrong>;

pub(super) const INVALID: &str = "a value is invalid: it was never assigned";

impl Interpreter {
    /// Executes the statement that comes next, or goes on with one that waits.
    pub fn step(&mut self, program: &Program, memory: &mut Memory, host: &mut dyn Host) -> Pause {
        if self.frames.is_empty() {
            return Pause::Ended;
        }
        loop {
            let Some(op) = program.code.get(self.at) else { return Pause::Ended };
            if let Op::Statement(index) = op {
                self.begin_statement(*index as usize, program, memory);
                self.at += 1;
            } else {
                let stepped = match self.condensed(program, memory, host) {
                    Ok(true) => Ok(Flow::Next),
                    Ok(false) => self.op(op, program, memory, host),
                    Err(wrong) => Err(wrong),
                };
                match stepped {
                    Ok(Flow::Next) => {}
                    Ok(Flow::Wait) => return Pause::Waits,
                    Ok(Flow::Ended) => return Pause::Ended,
                    Err(_) if self.proceeds > 0 => self.skip_statement(program),
                    Err(wrong) => {
                        return Pause::Fault(format!("{}: {}", self.place(program), String::from(wrong)));
                    }
                }
            }
            if matches!(program.code.get(self.at), Some(Op::Statement(_))) {
                return Pause::Statement;
            }
        }
    }

    fn begin_statement(&mut self, index: usize, program: &Program, memory: &mut Memory) {
        memory.hits[index] += 1;
        self.statement = index;
        self.statement_height = self.stack.len();
        self.proceeds = self.proceeds.saturating_sub(1);
        self.planned = false;
        if self.keeps_going.is_some_and(|line| line + 1 < program.statements[index].line) {
            self.keeps_going = None;
        }
    }

    /// ON_ERROR_PROCEED: the statement is left where it is.
    fn skip_statement(&mut self, program: &Program) {
        self.stack.truncate(self.statement_height);
        let behind = &program.code[self.at..];
        self.at += behind.iter().position(|op| matches!(op, Op::Statement(_))).unwrap_or(behind.len());
    }

    pub(super) fn pop(&mut self) -> Result<Cell, Wrong> {
        self.stack.pop().ok_or_else(|| "the stack is empty".into())
    }

    pub(super) fn pop_int(&mut self) -> Result<i32, Wrong> {
        match self.pop()? {
            Cell::Int(number) => Ok(number),
            _ => Err(INVALID.into()),
        }
    }

    pub(super) fn pop_real(&mut self) -> Result<f32, Wrong> {
        match self.pop()? {
            Cell::Real(number) => Ok(number),
            _ => Err(INVALID.into()),
        }
    }

    pub(super) fn pop_bool(&mut self) -> Result<bool, Wrong> {
        match self.pop()? {
            Cell::Bool(value) => Ok(value),
            _ => Err(INVALID.into()),
        }
    }

    pub(super) fn pop_address(&mut self) -> Result<Address, Wrong> {
        match self.pop()? {
            Cell::Address(address) => Ok(address),
            _ => Err("an address is missing".into()),
        }
    }

    /// The newest cells of the stack, taken off.
    pub(super) fn pop_block<const N: usize>(&mut self) -> Result<[Cell; N], Wrong> {
        let at = self.stack.len().checked_sub(N).ok_or("the stack is empty")?;
        let mut cells = [Cell::Unset; N];
        cells.copy_from_slice(&self.stack[at..]);
        self.stack.truncate(at);
        Ok(cells)
    }

    pub(super) fn base(&self) -> usize {
        match self.condition_base {
            Some((base, frames)) if frames == self.frames.len() => base,
            _ => self.frames.last().map_or(0, |frame| frame.base),
        }
    }

    /// Whether reading this must wait for the arm.
    fn must_wait(&self, address: Address, host: &mut dyn Host) -> bool {
        let Space::System(index) = address.space else { return false };
        if !SYSTEM_VARIABLES[index as usize].stops_advance {
            return false;
        }
        self.stops_advance_run(host)
    }

    pub(super) fn stops_advance_run(&self, host: &mut dyn Host) -> bool {
        if !self.moves || self.keeps_going.is_some() || self.in_interrupt() || host.arm_stands() {
            return false;
        }
        host.let_arm_finish();
        true
    }

    pub(super) fn read(&self, address: Address, memory: &Memory, host: &mut dyn Host) -> Result<Cell, Wrong> {
        let at = address.offset as usize;
        let cell = match address.space {
            Space::Global => memory.cells.get(at).copied(),
            Space::Frame => self.cells.get(at).copied(),
            Space::System(index) => return Ok(host.read(index, address.offset)?),
        };
        cell.ok_or_else(|| "outside of memory".into())
    }

    pub(super) fn write(
        &mut self,
        address: Address,
        value: Cell,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), Wrong> {
        let at = address.offset as usize;
        let cell = match address.space {
            Space::Global => memory.cells.get_mut(at),
            Space::Frame => self.cells.get_mut(at),
            Space::System(index) => return Ok(host.write(index, address.offset, value)?),
        };
        *cell.ok_or("outside of memory")? = value;
        Ok(())
    }

    fn push_address(&mut self, space: Space, offset: u32) {
        self.stack.push(Cell::Address(Address { space, offset }));
    }

    fn valid(cell: Cell) -> Result<Cell, Wrong> {
        if cell == Cell::Unset { Err(INVALID.into()) } else { Ok(cell) }
    }

    pub(super) fn op(&mut self, op: &Op, program: &Program, memory: &mut Memory, host: &mut dyn Host) -> Stepped {
        match *op {
            Op::Push(cell) => self.stack.push(cell),
            Op::Global(offset) => self.push_address(Space::Global, offset),
            Op::Local(offset) => self.push_address(Space::Frame, self.base() as u32 + offset),
            Op::Referred(offset) => {
                let cell = self.cells.get(self.base() + offset as usize).copied();
                self.stack.push(cell.unwrap_or(Cell::Unset));
            }
            Op::System(index) => self.push_address(Space::System(index), 0),
            Op::Component(cells) => {
                let mut address = self.pop_address()?;
                address.offset += cells;
                self.stack.push(Cell::Address(address));
            }
            Op::Index { count, size } => {
                let index = self.pop_int()?;
                let mut address = self.pop_address()?;
                let inside = u32::try_from(index).ok().filter(|index| (1..=count).contains(index));
                let inside =
                    inside.ok_or_else(|| format!("the index {index} is outside of the array, 1 to {count}"))?;
                address.offset += (inside - 1) * size;
                self.stack.push(Cell::Address(address));
            }
            Op::LoadGlobal(at) => {
                let cell = memory.cells.get(at as usize).copied().unwrap_or(Cell::Unset);
                self.stack.push(Self::valid(cell)?);
            }
            Op::LoadLocal(at) => {
                let cell = self.cells.get(self.base() + at as usize).copied().unwrap_or(Cell::Unset);
                self.stack.push(Self::valid(cell)?);
            }
            Op::Load => return self.load(1, memory, host),
            Op::LoadBlock(cells) => return self.load(cells, memory, host),
            Op::Store => {
                let value = self.pop()?;
                let address = self.pop_address()?;
                if self.must_wait(address, host) {
                    self.stack.extend([Cell::Address(address), value]);
                    return Ok(Flow::Wait);
                }
                self.write(address, value, memory, host)?;
            }
            Op::StoreBlock(cells) => self.store(cells as usize, false, memory, host)?,
            Op::StoreAggregate(cells) => {
                self.store(cells as usize, self.meaning.aggregate_keeps_rest, memory, host)?
            }
            Op::StoreText(cells) => self.store_text(cells, program, memory, host)?,
            Op::Jump(to) => {
                self.at = to as usize;
                return Ok(Flow::Next);
            }
            Op::JumpIfNot(to) => {
                let value = self.pop_bool()?;
                memory.branches[self.at][usize::from(value)] = true;
                if !value {
                    self.at = to as usize;
                    return Ok(Flow::Next);
                }
            }
            Op::JumpDecided { decided, to } => {
                let is_decided = self.stack.last() == Some(&Cell::Bool(decided));
                if self.meaning.short_circuit && is_decided {
                    self.at = to as usize;
                    return Ok(Flow::Next);
                }
            }
            Op::Call(routine) => {
                let parameters = program.routines[routine as usize].parameter_cells as usize;
                let height = self.stack.len().saturating_sub(parameters);
                if self.frames.len() > 100 {
                    return Err("too many calls inside each other".into());
                }
                self.enter(program, routine, self.at + 1, height);
                return Ok(Flow::Next);
            }
            Op::Builtin(builtin) => self.builtin(builtin, program, memory, host)?,
            Op::Return(cells) => return self.leave(cells as usize),
            Op::NoReturn => return Err("a function ended without RETURN".into()),
            Op::Drop(cells) => self.stack.truncate(self.stack.len().saturating_sub(cells as usize)),
            Op::Keep { first, of } => {
                let dropped = (of - first) as usize;
                self.stack.truncate(self.stack.len().saturating_sub(dropped));
            }
            _ => match self.value_op(op)? {
                true => {}
                false => return self.robot_op(op, program, memory, host),
            },
        }
        self.at += 1;
        Ok(Flow::Next)
    }

    /// Steps that take and give values alone; false where this is none.
    fn value_op(&mut self, op: &Op) -> Result<bool, Wrong> {
        match *op {
            Op::Binary(operator) => {
                let right = self.pop()?;
                let left = self.pop()?;
                self.stack.push(calculate::binary(operator, left, right)?);
            }
            Op::ToReal(below) => {
                let at = self.stack.len().checked_sub(1 + below as usize).ok_or("the stack is empty")?;
                match self.stack[at] {
                    Cell::Int(number) => self.stack[at] = Cell::Real(number as f32),
                    Cell::Real(_) => {}
                    _ => return Err(INVALID.into()),
                }
            }
            Op::ToInt => {
                let number = self.pop_real()?;
                self.stack.push(calculate::round(number)?);
            }
            Op::Negate => match self.pop()? {
                Cell::Int(number) => self.stack.push(calculate::negated(number)?),
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
                self.stack.extend(super::robot::composed(left, right).map(Cell::Real));
            }
            Op::ForTest => {
                let (step, last, now) = (self.pop_int()?, self.pop_int()?, self.pop_int()?);
                self.stack.push(Cell::Bool(if step >= 0 { now <= last } else { now >= last }));
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn load(&mut self, cells: u32, memory: &Memory, host: &mut dyn Host) -> Stepped {
        let address = self.pop_address()?;
        if self.must_wait(address, host) {
            self.stack.push(Cell::Address(address));
            return Ok(Flow::Wait);
        }
        let mut any = false;
        for cell in 0..cells {
            let value = self.read(Address { offset: address.offset + cell, ..address }, memory, host)?;
            any |= value != Cell::Unset;
            self.stack.push(value);
        }
        if !any {
            return Err(INVALID.into());
        }
        self.at += 1;
        Ok(Flow::Next)
    }

    fn store(
        &mut self,
        cells: usize,
        keeps_rest: bool,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), Wrong> {
        let at = self.stack.len().checked_sub(cells).filter(|at| *at > 0).ok_or("the stack is empty")?;
        let Cell::Address(address) = self.stack[at - 1] else { return Err("an address is missing".into()) };
        let to = address.offset as usize..address.offset as usize + cells;
        let plain = match address.space {
            Space::Global if !keeps_rest => memory.cells.get_mut(to),
            Space::Frame if !keeps_rest => self.cells.get_mut(to),
            _ => None,
        };
        if let Some(plain) = plain {
            plain.copy_from_slice(&self.stack[at..]);
            self.stack.truncate(at - 1);
            return Ok(());
        }
        for (index, offset) in (at..self.stack.len()).zip(address.offset..) {
            let value = self.stack[index];
            if value != Cell::Unset || !keeps_rest {
                self.write(Address { offset, ..address }, value, memory, host)?;
            }
        }
        self.stack.truncate(at - 1);
        Ok(())
    }

    fn store_text(
        &mut self,
        cells: u32,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), Wrong> {
        let text = self.pop_text(program)?;
        let address = self.pop_address()?;
        if text.len() > cells as usize {
            return Err(format!("the text has {} characters, the variable {cells}", text.len()).into());
        }
        for cell in 0..cells {
            let value = text.as_bytes().get(cell as usize).map_or(Cell::Unset, |byte| Cell::Char(*byte));
            self.write(Address { offset: address.offset + cell, ..address }, value, memory, host)?;
        }
        Ok(())
    }

    pub(super) fn pop_text<'a>(&mut self, program: &'a Program) -> Result<&'a str, Wrong> {
        let index = self.pop_text_index()?;
        program.texts.get(index).map(String::as_str).ok_or_else(|| "a text is missing".into())
    }

    /// The place of a text among the program's texts.
    pub(super) fn pop_text_index(&mut self) -> Result<usize, Wrong> {
        match self.pop()? {
            Cell::Text(index) => Ok(index as usize),
            _ => Err("a text in quotation marks is needed here; CHAR variables are not executed".into()),
        }
    }

    /// Leaves a routine, its value on the stack.
    fn leave(&mut self, cells: usize) -> Stepped {
        let Some(frame) = self.frames.pop() else { return Ok(Flow::Ended) };
        let level = self.frames.len();
        if !self.interrupts.is_empty() {
            self.interrupts.retain(|interrupt| interrupt.global || interrupt.declared_in < level);
        }
        let value = self.stack.len().saturating_sub(cells);
        let above = self.stack.len();
        if value > frame.height {
            self.stack.copy_within(value..above, frame.height);
            self.stack.truncate(frame.height + above - value);
        }
        self.cells.truncate(frame.base);
        self.at = frame.return_to;
        if self.frames.is_empty() { Ok(Flow::Ended) } else { Ok(Flow::Next) }
    }

    fn builtin(
        &mut self,
        builtin: Builtin,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), Wrong> {
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
            _ => return Err("the result is no number".into()),
        }
        Ok(())
    }
}
