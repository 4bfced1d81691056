//! The memory that a step reads and writes: cells of the data lists, of a frame, and of the system. An access to a
//! system variable may have to wait for the arm.

use super::super::code::{Cell, MemoryAddress, MemorySpace};
use super::super::program::Program;
use super::super::system::SYSTEM_VARIABLES;
use super::host::Host;
use super::interpreter::Interpreter;
use super::memory::Memory;
use super::outcome::{StepError, StepFlow, StepResult};
use super::stack::INVALID;

impl Interpreter {
    #[inline]
    pub(super) fn base(&self) -> usize {
        match self.condition_base {
            Some((base, frames)) if frames == self.frames.len() => base,
            _ => self.frames.last().map_or(0, |frame| frame.base),
        }
    }

    /// Returns whether reading this address must wait for the arm.
    #[inline]
    pub(super) fn must_wait_for_arm(&self, address: MemoryAddress, host: &mut dyn Host) -> bool {
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

    pub(super) fn store_text(
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
