//! Executes one statement: step after step until the next statement begins, or until a step must wait.

use super::super::code::{Address, Cell, Op, Space};
use super::super::program::Program;
use super::host::Host;
use super::interpreter::Interpreter;
use super::memory::Memory;
use super::outcome::{Flow, Pause, Stepped, Wrong};
use super::stack::INVALID;

impl Interpreter {
    /// Executes the next statement, or continues one that waits.
    pub fn step(&mut self, program: &Program, memory: &mut Memory, host: &mut dyn Host) -> Pause {
        if self.frames.is_empty() {
            return Pause::Ended;
        }
        loop {
            let Some(op) = program.code.get(self.at) else { return Pause::Ended };
            if let Op::Statement(index) = op {
                self.begin_statement(*index as usize, program, memory);
                // It ends here by name: a skipped statement would make every result behind it a guess.
                if let Some(what) = program.unexecuted.get(index) {
                    return Pause::Fault(format!(
                        "{}: this interpreter does not execute {what}",
                        self.place(program)
                    ));
                }
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

    /// ON_ERROR_PROCEED: skips the rest of the statement.
    fn skip_statement(&mut self, program: &Program) {
        self.stack.truncate(self.statement_height);
        let behind = &program.code[self.at..];
        self.at += behind.iter().position(|op| matches!(op, Op::Statement(_))).unwrap_or(behind.len());
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
                let inside = inside
                    .ok_or_else(|| format!("the index {index} is outside of the array (valid: 1 to {count})"))?;
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
                    return Err("routine calls are nested more than 100 levels deep".into());
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

    /// Leaves a routine, with its return value on the stack.
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
}
