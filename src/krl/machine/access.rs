//! The memory that a step reads and writes: cells of the data lists, of a frame, and of the system. An access to a
//! system variable may have to wait for the arm.

use super::super::code::{Address, Cell, Space};
use super::super::program::Program;
use super::super::system::SYSTEM_VARIABLES;
use super::host::Host;
use super::interpreter::Interpreter;
use super::memory::Memory;
use super::outcome::{Flow, Stepped, Wrong};
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
    pub(super) fn must_wait(&self, address: Address, host: &mut dyn Host) -> bool {
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

    #[inline]
    pub(super) fn read(&self, address: Address, memory: &Memory, host: &mut dyn Host) -> Result<Cell, Wrong> {
        let at = address.offset as usize;
        let cell = match address.space {
            Space::Global => memory.cells.get(at).copied(),
            Space::Frame => self.cells.get(at).copied(),
            Space::System(index) => return Ok(host.read(index, address.offset)?),
        };
        cell.ok_or_else(|| "outside of memory".into())
    }

    #[inline]
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

    #[inline]
    pub(super) fn load(&mut self, cells: u32, memory: &Memory, host: &mut dyn Host) -> Stepped {
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

    pub(super) fn store(
        &mut self,
        cells: usize,
        keeps_rest: bool,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), Wrong> {
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

    pub(super) fn store_text(
        &mut self,
        cells: u32,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), Wrong> {
        let text = self.pop_text(program)?;
        let address = self.pop_address()?;
        if text.len() > cells as usize {
            return Err(
                format!("the string has {} characters, but the variable has only {cells}", text.len()).into()
            );
        }
        for cell in 0..cells {
            let value = text.as_bytes().get(cell as usize).map_or(Cell::Unset, |byte| Cell::Char(*byte));
            self.write(Address { offset: address.offset + cell, ..address }, value, memory, host)?;
        }
        Ok(())
    }
}
