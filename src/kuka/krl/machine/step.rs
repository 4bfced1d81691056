//! Executes one statement: its steps one after another, until the next statement begins or a step must wait.
//!
//! A step reads and writes cells of the data lists, of a frame, and of system variables. An access to a system variable
//! may have to wait for the arm.

use super::super::code::{Cell, MemoryAddress, MemorySpace, Op, Program};
use super::super::system::SYSTEM_VARIABLES;
use super::host::Host;
use super::interpreter::{INVALID, Interpreter, Memory, StepError, StepFlow, StepPause, StepResult};

impl Interpreter {
    /// Executes the next statement, or continues a statement that waits.
    pub fn step(&mut self, program: &Program, memory: &mut Memory, host: &mut dyn Host) -> StepPause {
        if self.frames.is_empty() {
            return StepPause::Ended;
        }
        loop {
            let Some(op) = program.code.get(self.step_index) else { return StepPause::Ended };
            if let Op::Statement(index) = op {
                self.begin_statement(*index as usize, program, memory);
                // The program stops here with a message that names the statement. If the statement were skipped, all
                // later results would be unreliable.
                if let Some(what) = program.unexecuted.get(index) {
                    return StepPause::Fault(format!(
                        "{}: this interpreter does not execute {what}",
                        self.current_location(program)
                    ));
                }
                self.step_index += 1;
            } else {
                let stepped = match self.run_condensed(program, memory, host) {
                    Ok(true) => Ok(StepFlow::Next),
                    Ok(false) => self.run_op(op, program, memory, host),
                    Err(wrong) => Err(wrong),
                };
                match stepped {
                    Ok(StepFlow::Next) => {}
                    Ok(StepFlow::Wait) => return StepPause::Waits,
                    Ok(StepFlow::Ended) => return StepPause::Ended,
                    Err(_) if self.error_suppression > 0 => self.skip_statement(program),
                    Err(wrong) => {
                        return StepPause::Fault(format!(
                            "{}: {}",
                            self.current_location(program),
                            String::from(wrong)
                        ));
                    }
                }
            }
            if matches!(program.code.get(self.step_index), Some(Op::Statement(_))) {
                return StepPause::Statement;
            }
        }
    }

    fn begin_statement(&mut self, index: usize, program: &Program, memory: &mut Memory) {
        memory.hits[index] += 1;
        self.statement = index;
        self.statement_height = self.stack.len();
        self.error_suppression = self.error_suppression.saturating_sub(1);
        self.planned = false;
        if self.continue_statement.is_some_and(|line| line + 1 < program.statements[index].line) {
            self.continue_statement = None;
        }
    }

    /// Skips the rest of the statement after an error that ON_ERROR_PROCEED suppresses.
    fn skip_statement(&mut self, program: &Program) {
        self.stack.truncate(self.statement_height);
        let behind = &program.code[self.step_index..];
        self.step_index += behind.iter().position(|op| matches!(op, Op::Statement(_))).unwrap_or(behind.len());
    }

    fn push_address(&mut self, space: MemorySpace, offset: u32) {
        self.stack.push(Cell::Address(MemoryAddress { space, offset }));
    }

    fn require_valid(cell: Cell) -> Result<Cell, StepError> {
        if cell == Cell::Unset { Err(INVALID.into()) } else { Ok(cell) }
    }

    pub(super) fn run_op(
        &mut self,
        op: &Op,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> StepResult {
        match *op {
            Op::Push(cell) => self.stack.push(cell),
            Op::Global(offset) => self.push_address(MemorySpace::Global, offset),
            Op::Local(offset) => self.push_address(MemorySpace::Frame, self.base() as u32 + offset),
            Op::Referred(offset) => {
                let cell = self.cells.get(self.base() + offset as usize).copied();
                self.stack.push(cell.unwrap_or(Cell::Unset));
            }
            Op::System(index) => self.push_address(MemorySpace::System(index), 0),
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
                self.stack.push(Self::require_valid(cell)?);
            }
            Op::LoadLocal(at) => {
                let cell = self.cells.get(self.base() + at as usize).copied().unwrap_or(Cell::Unset);
                self.stack.push(Self::require_valid(cell)?);
            }
            Op::Load => return self.load(1, memory, host),
            Op::LoadBlock(cells) => return self.load(cells, memory, host),
            Op::Store => {
                let value = self.pop()?;
                let address = self.pop_address()?;
                if self.must_wait_for_arm(address, host) {
                    self.stack.extend([Cell::Address(address), value]);
                    return Ok(StepFlow::Wait);
                }
                self.write(address, value, memory, host)?;
            }
            Op::StoreBlock(cells) => self.store(cells as usize, false, memory, host)?,
            Op::StoreAggregate(cells) => {
                self.store(cells as usize, self.meaning.aggregate_keeps_rest, memory, host)?
            }
            Op::StoreText(cells) => self.store_text(cells, program, memory, host)?,
            Op::Jump(to) => {
                self.step_index = to as usize;
                return Ok(StepFlow::Next);
            }
            Op::JumpIfNot(to) => {
                let value = self.pop_bool()?;
                memory.branches[self.step_index][usize::from(value)] = true;
                if !value {
                    self.step_index = to as usize;
                    return Ok(StepFlow::Next);
                }
            }
            Op::JumpDecided { decided, to } => {
                let is_decided = self.stack.last() == Some(&Cell::Bool(decided));
                if self.meaning.short_circuit && is_decided {
                    self.step_index = to as usize;
                    return Ok(StepFlow::Next);
                }
            }
            Op::Call(routine) => {
                let parameters = program.routines[routine as usize].parameter_cells as usize;
                let height = self.stack.len().saturating_sub(parameters);
                if self.frames.len() > 100 {
                    return Err("routine calls are nested more than 100 levels deep".into());
                }
                self.enter_routine(program, routine, self.step_index + 1, height);
                return Ok(StepFlow::Next);
            }
            Op::Builtin(builtin) => self.builtin(builtin, program, memory, host)?,
            Op::Return(cells) => return self.leave_routine(cells as usize),
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
        self.step_index += 1;
        Ok(StepFlow::Next)
    }

    /// Returns from a routine and pushes its return value.
    fn leave_routine(&mut self, cells: usize) -> StepResult {
        let Some(frame) = self.frames.pop() else { return Ok(StepFlow::Ended) };
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
        self.step_index = frame.return_to;
        if self.frames.is_empty() { Ok(StepFlow::Ended) } else { Ok(StepFlow::Next) }
    }
}

impl Interpreter {
    #[inline]
    pub(super) fn base(&self) -> usize {
        match self.condition_base {
            Some((base, frames)) if frames == self.frames.len() => base,
            _ => self.frames.last().map_or(0, |frame| frame.base),
        }
    }

    /// Returns whether an access to this address must wait for the arm.
    #[inline]
    fn must_wait_for_arm(&self, address: MemoryAddress, host: &mut dyn Host) -> bool {
        let MemorySpace::System(index) = address.space else { return false };
        if !SYSTEM_VARIABLES[index as usize].stops_advance {
            return false;
        }
        self.stops_advance_run(host)
    }

    pub(super) fn stops_advance_run(&self, host: &mut dyn Host) -> bool {
        if !self.moves || self.continue_statement.is_some() || self.is_in_interrupt() || host.is_arm_at_rest() {
            return false;
        }
        host.finish_motions();
        true
    }

    #[inline]
    pub(super) fn read(
        &self,
        address: MemoryAddress,
        memory: &Memory,
        host: &mut dyn Host,
    ) -> Result<Cell, StepError> {
        let at = address.offset as usize;
        let cell = match address.space {
            MemorySpace::Global => memory.cells.get(at).copied(),
            MemorySpace::Frame => self.cells.get(at).copied(),
            MemorySpace::System(index) => return Ok(host.read(index, address.offset)?),
        };
        cell.ok_or_else(|| "outside of memory".into())
    }

    #[inline]
    pub(super) fn write(
        &mut self,
        address: MemoryAddress,
        value: Cell,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), StepError> {
        let at = address.offset as usize;
        let cell = match address.space {
            MemorySpace::Global => memory.cells.get_mut(at),
            MemorySpace::Frame => self.cells.get_mut(at),
            MemorySpace::System(index) => return Ok(host.write(index, address.offset, value)?),
        };
        *cell.ok_or("outside of memory")? = value;
        Ok(())
    }

    #[inline]
    pub(super) fn load(&mut self, cells: u32, memory: &Memory, host: &mut dyn Host) -> StepResult {
        let address = self.pop_address()?;
        if self.must_wait_for_arm(address, host) {
            self.stack.push(Cell::Address(address));
            return Ok(StepFlow::Wait);
        }
        let mut any = false;
        for cell in 0..cells {
            let value = self.read(MemoryAddress { offset: address.offset + cell, ..address }, memory, host)?;
            any |= value != Cell::Unset;
            self.stack.push(value);
        }
        if !any {
            return Err(INVALID.into());
        }
        self.step_index += 1;
        Ok(StepFlow::Next)
    }

    pub(super) fn store(
        &mut self,
        cells: usize,
        keeps_rest: bool,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), StepError> {
        let at = self
            .stack
            .len()
            .checked_sub(cells)
            .filter(|at| *at > 0)
            .ok_or("internal error of the KRL interpreter: its stack is empty")?;
        let Cell::Address(address) = self.stack[at - 1] else {
            return Err("internal error of the KRL interpreter: an address is missing".into());
        };
        let to = address.offset as usize..address.offset as usize + cells;
        let plain = match address.space {
            MemorySpace::Global if !keeps_rest => memory.cells.get_mut(to),
            MemorySpace::Frame if !keeps_rest => self.cells.get_mut(to),
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
                self.write(MemoryAddress { offset, ..address }, value, memory, host)?;
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
    ) -> Result<(), StepError> {
        let text = self.pop_text(program)?;
        let address = self.pop_address()?;
        if text.len() > cells as usize {
            return Err(
                format!("the string has {} characters, but the variable has only {cells}", text.len()).into()
            );
        }
        for cell in 0..cells {
            let value = text.as_bytes().get(cell as usize).map_or(Cell::Unset, |byte| Cell::Char(*byte));
            self.write(MemoryAddress { offset: address.offset + cell, ..address }, value, memory, host)?;
        }
        Ok(())
    }
}
