//! The compiled form of a program: one list of small steps for a stack machine, divided into statements.
//!
//! Between two statements another interpreter may run or an interrupt may occur; within a statement neither is
//! possible.

use super::routines::Builtin;
use super::syntax::{Approximation, Binary, Motion};

/// One value in memory or on the stack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cell {
    /// A value that was never assigned: reading it stops an interpreter.
    Unset,
    /// INT
    Int(i32),
    /// REAL
    Real(f32),
    /// BOOL
    Bool(bool),
    /// CHAR
    Char(u8),
    /// An enumeration constant, by its index in the enumeration.
    Word(u16),
    /// A text, by its index among the program's texts.
    Text(u32),
    /// The address of a variable.
    Address(MemoryAddress),
}

/// A location in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryAddress {
    /// The memory space.
    pub space: MemorySpace,
    /// The cell within the memory.
    pub offset: u32,
}

/// A memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemorySpace {
    /// Data lists, shared by all interpreters.
    Global,
    /// Parameters and local variables of one interpreter.
    Frame,
    /// A system variable, by its index in the table.
    System(u16),
}

/// One step.
#[allow(missing_docs)] // a field is what the step's sentence says of it
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Op {
    /// Begins a statement, given by its index among the program's statements.
    Statement(u32),
    /// Puts a value on the stack.
    Push(Cell),
    /// Puts an address on the stack: of a shared variable, of a local variable, of the variable to which a
    /// parameter refers, or of a system variable.
    Global(u32),
    /// See [`Op::Global`].
    Local(u32),
    /// See [`Op::Global`].
    Referred(u32),
    /// See [`Op::Global`].
    System(u16),
    /// Advances the address by this many cells.
    Component(u32),
    /// Pops an index and advances the address to that element, of `count` elements with `size` cells each.
    Index { count: u32, size: u32 },
    /// Replaces an address by the value at this address.
    Load,
    /// Puts the value of this shared or local cell on the stack.
    LoadGlobal(u32),
    /// See [`Op::LoadGlobal`].
    LoadLocal(u32),
    /// Replaces an address by the values of this many cells from this address on.
    LoadBlock(u32),
    /// Pops a value and the address below it, and writes the value to the address.
    Store,
    /// Pops this many cells and the address below them, and writes the cells to the address.
    StoreBlock(u32),
    /// As [`Op::StoreBlock`], for `{…}`, in which components may be left out.
    StoreAggregate(u32),
    /// Pops a text and an address, and writes this many characters at most.
    StoreText(u32),
    /// Converts an INT to REAL; the INT lies this number of cells below the top of the stack.
    ToReal(u32),
    /// Converts a REAL to INT, rounded.
    ToInt,
    /// Changes the sign.
    Negate,
    /// NOT
    Not,
    /// B_NOT
    BitNot,
    /// Applies an operator to two simple values.
    Binary(Binary),
    /// Applies `:` to two frames of 6 numbers.
    Geometric,
    /// Keeps the first cells of this many and drops the others, for example to get a FRAME from a POS.
    Keep { first: u32, of: u32 },
    /// Continues at another step.
    Jump(u32),
    /// Pops a BOOL and continues at another step if it is FALSE.
    JumpIfNot(u32),
    /// Continues at another step if AND or OR is decided by its left side and the controller leaves out the right
    /// one.
    JumpDecided { decided: bool, to: u32 },
    /// Pops step, end and counter of a FOR and reports whether the loop continues.
    ForTest,
    /// Calls a routine with its arguments on the stack.
    Call(u32),
    /// Calls a routine of the controller.
    Builtin(Builtin),
    /// Leaves the routine with a value of this many cells.
    Return(u32),
    /// Reports that a function ended without RETURN.
    NoReturn,
    /// Discards this many cells of the stack.
    Drop(u32),
    /// Requests a motion; its target is 6 numbers on the stack, axes or a pose.
    Motion { motion: Motion, axes: bool, approximates: Option<Approximation> },
    /// Pops the waiting time in seconds.
    WaitSeconds,
    /// Pops a BOOL; if it is FALSE, continues at this step, which evaluates the condition again.
    WaitFor(u32),
    /// Pops the number of the interrupt. The code of the condition begins at the next step, the code of the call at
    /// `call`, and the program continues at `after`.
    InterruptDeclaration { global: bool, call: u32, after: u32 },
    /// Pops the number of an interrupt and switches it.
    InterruptSwitch { on: bool },
    /// Switches all interrupts.
    InterruptSwitchAll { on: bool },
    /// Ends a condition; its value is on the stack.
    EndCondition,
    /// Ends the call of an interrupt or a trigger.
    EndInterrupt,
    /// BRAKE or BRAKE F.
    Brake { fast: bool },
    /// RESUME
    Resume,
    /// HALT
    Halt,
    /// CONTINUE
    Continue,
    /// Pops priority, delay and distance. The code of the call begins at the next step, and the program continues at
    /// `after`.
    Trigger { after: u32 },
}

/// The location of a statement in the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Location {
    /// Index of the file in the list of files.
    pub file: usize,
    /// Line, from 1.
    pub line: usize,
}

/// A routine that can be called.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// In upper case.
    pub name: String,
    /// Its first step.
    pub start: u32,
    /// The number of cells of the routine's parameters.
    pub parameter_cells: u32,
    /// The number of cells of the parameters, local variables and counters.
    pub frame_cells: u32,
    /// Index of the file in the list of files.
    pub file: usize,
    /// Parameters and local variables.
    pub locals: Vec<LocalVariable>,
}

/// A parameter or local variable.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalVariable {
    /// In upper case.
    pub name: String,
    /// The first cell of the variable in the routine's frame.
    pub offset: u32,
    /// Whether the cell contains the address of the variable that the caller passed.
    pub by_reference: bool,
}

/// A shared variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Shared {
    /// In upper case.
    pub name: String,
    /// Its first cell.
    pub offset: u32,
    /// The number of cells of the variable.
    pub cells: u32,
}
