//! The compiled form of a program: one list of small steps for a stack machine, divided into statements; routines,
//! memory and texts.
//!
//! Between two statements another interpreter may run or an interrupt may occur; within a statement neither is
//! possible.
//!
//! Steps are combined for speed: an expression without calls, a jump on the value of an expression, or an
//! assignment of that value. The list of steps is not changed: it defines the meaning of a program, and is executed
//! step by step if one of the steps may wait for the arm. For each step, the combined operation that begins there
//! and the next step are stored, so that jumps lead to the same steps as before.

use super::routines::Builtin;
use super::syntax::{Approximation, Binary, Motion};
use super::system::SYSTEM_VARIABLES;
use std::collections::BTreeMap;

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
    /// Index of the memory cell within the memory space.
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
    /// Advances the address by this number of cells.
    Component(u32),
    /// Pops an index and advances the address to that element, of `count` elements with `size` cells each.
    Index { count: u32, size: u32 },
    /// Replaces an address by the value at this address.
    Load,
    /// Puts the value of this shared or local cell on the stack.
    LoadGlobal(u32),
    /// See [`Op::LoadGlobal`].
    LoadLocal(u32),
    /// Replaces an address by the values of this number of cells from this address on.
    LoadBlock(u32),
    /// Pops a value and the address below it, and writes the value to the address.
    Store,
    /// Pops this number of cells and the address below them, and writes the cells to the address.
    StoreBlock(u32),
    /// As [`Op::StoreBlock`], for `{…}`, in which components may be left out.
    StoreAggregate(u32),
    /// Pops a text and an address, and writes at most this number of characters.
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
    /// Keeps the `first` cells of `of` cells and drops the others, for example to get a FRAME from a POS.
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
    /// Leaves the routine with a value of this number of cells.
    Return(u32),
    /// Reports that a function ended without RETURN.
    NoReturn,
    /// Discards this number of cells of the stack.
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

/// A program that can be executed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Program {
    /// The steps.
    pub code: Vec<Op>,
    /// The location of each statement.
    pub statements: Vec<Location>,
    /// All routines.
    pub routines: Vec<Entry>,
    /// Shared memory with the values of the data lists.
    pub memory: Vec<Cell>,
    /// All shared variables.
    pub shared: Vec<Shared>,
    /// All texts.
    pub texts: Vec<String>,
    /// The files' names.
    pub files: Vec<String>,
    /// Statements that are not executed, by their indices, each with a description of the part that is not
    /// executed.
    pub unexecuted: BTreeMap<u32, String>,
    /// Whether the program has more steps than are stored; it must not be executed then.
    pub is_too_large: bool,
    /// The steps in combined form.
    pub(super) condensed: Condensed,
}

impl Program {
    /// Returns the routine of this name.
    pub fn routine(&self, name: &str) -> Option<u32> {
        self.routines.iter().position(|routine| routine.name == name).and_then(|index| u32::try_from(index).ok())
    }

    /// Returns the first cell of the shared variable of this name.
    pub fn cell(&self, name: &str) -> Option<u32> {
        self.shared.iter().find(|shared| shared.name == name).map(|shared| shared.offset)
    }
}

/// The maximum number of values on the stack of one expression. More values are a list and not an expression, and a
/// list is never condensed.
const MAX_STACK_DEPTH: usize = 32;

/// The operation that combines the steps from one index onward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum CombinedOp {
    /// The step is combined with no other.
    Nothing,
    /// The steps put a value on the stack.
    Value { value: u32, next: u32 },
    /// The steps jump if a value is FALSE; `at` is the index of the jump.
    Branch { value: u32, at: u32, to: u32, next: u32 },
    /// The steps assign a value to a memory location.
    Assign { place: u32, value: u32, next: u32 },
}

/// A value, composed of other values by their indices in the list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum CondensedValue {
    Fixed(Cell),
    Global(u32),
    Local(u32),
    At(u32),
    Binary(Binary, u32, u32),
    /// AND or OR with a right side that may be left out.
    Decided {
        operator: Binary,
        left: u32,
        right: u32,
    },
    ToReal(u32),
    ToInt(u32),
    Negate(u32),
    Not(u32),
    BitNot(u32),
    ForTest([u32; 3]),
}

/// The start of a memory location.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum LocationStart {
    Space(MemorySpace),
    /// The memory at the address in this local cell.
    Referred(u32),
}

/// A variable, a component or an element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MemoryRef {
    pub(super) start: LocationStart,
    pub(super) offset: u32,
    pub(super) index: Option<Index>,
}

/// An element of an array of `count` elements with `size` cells each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Index {
    pub(super) value: u32,
    pub(super) count: u32,
    pub(super) size: u32,
}

/// The condensed form of a whole program.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Condensed {
    /// For each step, the combined operation that begins there, and whether it may wait for the arm.
    pub(super) steps: Vec<(CombinedOp, bool)>,
    pub(super) values: Vec<CondensedValue>,
    pub(super) places: Vec<MemoryRef>,
}

/// A value or a memory location that a step would have put on the stack.
#[derive(Debug, Clone, Copy)]
enum StackItem {
    Memory(MemoryRef),
    Value(u32),
}

/// Reads the steps from one index onward, as far as they are understood.
struct CondenseReader<'a> {
    all: &'a mut Condensed,
    stack: Vec<StackItem>,
    /// The ends of the right sides of AND and OR that have begun.
    decided: Vec<u32>,
    waits: bool,
}

impl Condensed {
    pub(super) fn new(code: &[Op]) -> Self {
        let mut all = Condensed::default();
        for at in 0..code.len() {
            let (values, places) = (all.values.len(), all.places.len());
            let mut reading =
                CondenseReader { all: &mut all, stack: Vec::new(), decided: Vec::new(), waits: false };
            let found = reading.read(code, at);
            if found.0 == CombinedOp::Nothing {
                all.values.truncate(values);
                all.places.truncate(places);
            }
            all.steps.push(found);
        }
        all
    }

    fn add(&mut self, value: CondensedValue) -> u32 {
        self.values.push(value);
        self.values.len() as u32 - 1
    }
}

impl CondenseReader<'_> {
    /// Reads the longest run of steps that forms one value, or the jump or assignment with which the run ends.
    fn read(&mut self, code: &[Op], from: usize) -> (CombinedOp, bool) {
        let mut found = (CombinedOp::Nothing, false);
        for (at, op) in code.iter().enumerate().skip(from) {
            let next = at as u32 + 1;
            match (*op, self.stack.as_slice()) {
                (Op::JumpIfNot(to), &[StackItem::Value(value)]) if self.decided.is_empty() && at > from => {
                    return (CombinedOp::Branch { value, at: at as u32, to, next }, self.waits);
                }
                (Op::Store, &[StackItem::Memory(place), StackItem::Value(value)]) if self.decided.is_empty() => {
                    self.waits |= may_stop_advance(&place);
                    let place = self.location_index(place);
                    return (CombinedOp::Assign { place, value, next }, self.waits);
                }
                _ => {}
            }
            if self.push_op(op, next).is_none() || self.stack.len() > MAX_STACK_DEPTH {
                return found;
            }
            if let (&[StackItem::Value(value)], true) =
                (self.stack.as_slice(), self.decided.is_empty() && at > from)
            {
                found = (CombinedOp::Value { value, next }, self.waits);
            }
        }
        found
    }

    fn location_index(&mut self, place: MemoryRef) -> u32 {
        self.all.places.push(place);
        self.all.places.len() as u32 - 1
    }

    fn value(&mut self) -> Option<u32> {
        match self.stack.pop()? {
            StackItem::Value(value) => Some(value),
            StackItem::Memory(_) => None,
        }
    }

    fn push(&mut self, value: CondensedValue) -> Option<()> {
        let value = self.all.add(value);
        self.stack.push(StackItem::Value(value));
        Some(())
    }

    fn start(&mut self, start: LocationStart, offset: u32) -> Option<()> {
        self.stack.push(StackItem::Memory(MemoryRef { start, offset, index: None }));
        Some(())
    }

    /// Adds one step; `None` if it is not part of an expression.
    fn push_op(&mut self, op: &Op, next: u32) -> Option<()> {
        match *op {
            Op::Push(cell) => self.push(CondensedValue::Fixed(cell)),
            Op::LoadGlobal(cell) => self.push(CondensedValue::Global(cell)),
            Op::LoadLocal(cell) => self.push(CondensedValue::Local(cell)),
            Op::Global(offset) => self.start(LocationStart::Space(MemorySpace::Global), offset),
            Op::Local(offset) => self.start(LocationStart::Space(MemorySpace::Frame), offset),
            Op::System(index) => self.start(LocationStart::Space(MemorySpace::System(index)), 0),
            Op::Referred(cell) => self.start(LocationStart::Referred(cell), 0),
            Op::Component(cells) => match self.stack.last_mut()? {
                StackItem::Memory(place) => {
                    place.offset += cells;
                    Some(())
                }
                StackItem::Value(_) => None,
            },
            Op::Index { count, size } => {
                let value = self.value()?;
                match self.stack.last_mut()? {
                    StackItem::Memory(place) if place.index.is_none() => {
                        place.index = Some(Index { value, count, size });
                        Some(())
                    }
                    _ => None,
                }
            }
            Op::Load => {
                let StackItem::Memory(place) = self.stack.pop()? else { return None };
                self.waits |= may_stop_advance(&place);
                let place = self.location_index(place);
                self.push(CondensedValue::At(place))
            }
            Op::JumpDecided { to, .. } => {
                self.decided.push(to);
                Some(())
            }
            _ => self.combine_op(op, next),
        }
    }

    fn combine_op(&mut self, op: &Op, next: u32) -> Option<()> {
        let last = self.value()?;
        match *op {
            Op::ToReal(0) => self.push(CondensedValue::ToReal(last)),
            Op::ToInt => self.push(CondensedValue::ToInt(last)),
            Op::Negate => self.push(CondensedValue::Negate(last)),
            Op::Not => self.push(CondensedValue::Not(last)),
            Op::BitNot => self.push(CondensedValue::BitNot(last)),
            Op::Binary(operator) => {
                let left = self.value()?;
                if !matches!(operator, Binary::And | Binary::Or) {
                    return self.push(CondensedValue::Binary(operator, left, last));
                }
                // The right side of this operator, and of no other, must end at this step.
                (self.decided.pop()? == next).then_some(())?;
                self.push(CondensedValue::Decided { operator, left, right: last })
            }
            Op::ForTest => {
                let (end, now) = (self.value()?, self.value()?);
                self.push(CondensedValue::ForTest([now, end, last]))
            }
            _ => None,
        }
    }
}

/// Returns whether reading or writing a memory location may stop the advance run. For a variable that the caller
/// passed, this is assumed.
fn may_stop_advance(place: &MemoryRef) -> bool {
    match place.start {
        LocationStart::Space(MemorySpace::System(index)) => SYSTEM_VARIABLES[index as usize].stops_advance,
        LocationStart::Space(_) => false,
        LocationStart::Referred(_) => true,
    }
}
