//! Executes one statement: step after step until the next statement begins, or until a step must wait.

use super::super::code::{Cell, MemoryAddress, MemorySpace, Op};
use super::super::program::Program;
use super::host::Host;
use super::interpreter::Interpreter;
use super::memory::Memory;
use super::outcome::{StepError, StepFlow, StepPause, StepResult};
use super::stack::INVALID;

impl Interpreter {
    /// Executes the next statement, or continues one that waits.
    pub fn step(&mut self, program: &Program, memory: &mut Memory, host: &mut dyn Host) -> StepPause {
        if self.frames.is_empty() {
            return StepPause::Ended;
        }
        loop {
            let Some(op) = program.code.get(self.step_index) else { return StepPause::Ended };
            if let Op::Statement(index) = op {
                self.begin_statement(*index as usize, program, memory);
                // It ends here by name: a skipped statement would make every result behind it a guess.
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

    /// ON_ERROR_PROCEED: skips the rest of the statement.
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

    /// Leaves a routine, with its return value on the stack.
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
