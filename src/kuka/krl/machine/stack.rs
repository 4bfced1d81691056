//! The stack of an interpreter: removes a cell of the expected kind, or returns the reason why there is none.

use super::super::code::{Cell, MemoryAddress};
use super::super::program::Program;
use super::interpreter::Interpreter;
use super::outcome::StepError;

pub(super) const INVALID: &str = "a variable is used before a value is assigned to the variable";

impl Interpreter {
    #[inline]
    pub(super) fn pop(&mut self) -> Result<Cell, StepError> {
        self.stack.pop().ok_or_else(|| "internal error of the KRL interpreter: its stack is empty".into())
    }

    #[inline]
    pub(super) fn pop_int(&mut self) -> Result<i32, StepError> {
        match self.pop()? {
            Cell::Int(number) => Ok(number),
            _ => Err(INVALID.into()),
        }
    }

    #[inline]
    pub(super) fn pop_real(&mut self) -> Result<f32, StepError> {
        match self.pop()? {
            Cell::Real(number) => Ok(number),
            _ => Err(INVALID.into()),
        }
    }

    #[inline]
    pub(super) fn pop_bool(&mut self) -> Result<bool, StepError> {
        match self.pop()? {
            Cell::Bool(value) => Ok(value),
            _ => Err(INVALID.into()),
        }
    }

    #[inline]
    pub(super) fn pop_address(&mut self) -> Result<MemoryAddress, StepError> {
        match self.pop()? {
            Cell::Address(address) => Ok(address),
            _ => Err("internal error of the KRL interpreter: an address is missing".into()),
        }
    }

    /// Removes the newest cells from the stack and returns them.
    pub(super) fn pop_block<const N: usize>(&mut self) -> Result<[Cell; N], StepError> {
        let at =
            self.stack.len().checked_sub(N).ok_or("internal error of the KRL interpreter: its stack is empty")?;
        let mut cells = [Cell::Unset; N];
        cells.copy_from_slice(&self.stack[at..]);
        self.stack.truncate(at);
        Ok(cells)
    }

    pub(super) fn pop_text<'a>(&mut self, program: &'a Program) -> Result<&'a str, StepError> {
        let index = self.pop_text_index()?;
        program.texts.get(index).map(String::as_str).ok_or_else(|| "a text is missing".into())
    }

    /// Removes a text's index among the program's texts from the stack and returns it.
    pub(super) fn pop_text_index(&mut self) -> Result<usize, StepError> {
        match self.pop()? {
            Cell::Text(index) => Ok(index as usize),
            _ => Err(
                "a string in quotation marks is required here; this interpreter does not execute CHAR variables"
                    .into(),
            ),
        }
    }
}
