//! The compiled form of a program: a list of small operations (steps) for a stack machine, divided into statements;
//! also the routines, the memory and the texts of the program.
//!
//! Another interpreter may run, or an interrupt may occur, only between two statements.
//!
//! For speed, several steps are combined to one operation: an expression without calls, a conditional jump on an
//! expression, or an assignment of an expression. The list of steps stays unchanged and defines the meaning of the
//! program. It is executed step by step if one of the steps may wait for the arm. For each step, the combined operation
//! that begins there is stored, together with the step that follows it. So the targets of jumps stay valid.

use super::routines::Builtin;
use super::syntax::{Approximation, Binary, Motion};
use super::system::SYSTEM_VARIABLES;
use std::collections::BTreeMap;

/// One value in memory or on the stack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cell {
    /// A value that was never assigned; reading it stops the interpreter.
    Unset,
    /// INT
    Int(i32),
    /// REAL
    Real(f32),
    /// BOOL
    Bool(bool),
    /// CHAR
    Char(u8),
    /// An enumeration constant, as its index in the enumeration.
    Word(u16),
    /// A text, as its index in the list of the program's texts.
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

/// A memory space.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemorySpace {
    /// The memory of the data lists, which all interpreters share.
    Global,
    /// The parameters and local variables of one interpreter.
    Frame,
    /// A system variable, by its index in the table of system variables.
    System(u16),
}

/// One step.
#[allow(missing_docs)] // a field is what the step's sentence says of it
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Op {
    /// Marks the start of a statement; the operand is its index in the list of statements.
    Statement(u32),
    /// Pushes a value on the stack.
    Push(Cell),
    /// The following operations push an address: of a shared variable, of a local variable, of the variable to which a
    /// parameter refers, or of a system variable.
    Global(u32),
    /// See [`Op::Global`].
    Local(u32),
    /// See [`Op::Global`].
    Referred(u32),
    /// See [`Op::Global`].
    System(u16),
    /// Advances the address on the stack by this number of cells.
    Component(u32),
    /// Pops an index, and advances the address on the stack to that element of an array of `count` elements with `size`
    /// cells each.
    Index { count: u32, size: u32 },
    /// Replaces the address on the stack by the value at this address.
    Load,
    /// Pushes the value of this shared or local cell.
    LoadGlobal(u32),
    /// See [`Op::LoadGlobal`].
    LoadLocal(u32),
    /// Replaces the address on the stack by the values of this number of cells, which begin at the address.
    LoadBlock(u32),
    /// Pops a value and the address below it, and writes the value to the address.
    Store,
    /// Pops this number of cells and the address below them, and writes the cells to the address.
    StoreBlock(u32),
    /// Like [`Op::StoreBlock`], for an aggregate `{…}`, in which components may be omitted.
    StoreAggregate(u32),
    /// Pops a text and an address, and writes at most this number of characters.
    StoreText(u32),
    /// Converts an INT to REAL; the INT is this number of cells below the top of the stack.
    ToReal(u32),
    /// Converts a REAL to the nearest INT.
    ToInt,
    /// Changes the sign.
    Negate,
    /// NOT
    Not,
    /// B_NOT
    BitNot,
    /// Applies a binary operator to two simple values.
    Binary(Binary),
    /// Applies the geometric operator `:` to two frames of six numbers.
    Geometric,
    /// Keeps the first `first` of the top `of` cells and drops the others, for example to convert a POS to a FRAME.
    Keep { first: u32, of: u32 },
    /// Jumps to another step.
    Jump(u32),
    /// Pops a BOOL and jumps to another step if it is FALSE.
    JumpIfNot(u32),
    /// Jumps to another step if the left operand decides the result of AND or OR and the controller skips the right
    /// operand (short-circuit evaluation).
    JumpDecided { decided: bool, to: u32 },
    /// Pops step, end value and counter of a FOR loop, and pushes whether the loop continues.
    ForTest,
    /// Calls a routine; its arguments are on the stack.
    Call(u32),
    /// Calls one of the controller's own routines.
    Builtin(Builtin),
    /// Returns from the routine with a value of this number of cells.
    Return(u32),
    /// Stops the interpreter, because a function has ended without RETURN.
    NoReturn,
    /// Removes this number of cells from the stack.
    Drop(u32),
    /// Requests a motion. Its target is six numbers on the stack: axis angles or a pose.
    Motion { motion: Motion, axes: bool, approximates: Option<Approximation> },
    /// Pops the waiting time in seconds, and waits.
    WaitSeconds,
    /// Pops a BOOL. If it is FALSE, jumps to the given step, which evaluates the condition again.
    WaitFor(u32),
    /// Declares an interrupt, whose number is popped. The code of the condition begins at the next step, the code of
    /// the call at `call`, and the program continues at `after`.
    InterruptDeclaration { global: bool, call: u32, after: u32 },
    /// Pops the number of an interrupt, and switches the interrupt on or off.
    InterruptSwitch { on: bool },
    /// Switches all interrupts.
    InterruptSwitchAll { on: bool },
    /// Ends the code of a condition; its result is on the stack.
    EndCondition,
    /// Ends the code that an interrupt or a trigger calls.
    EndInterrupt,
    /// Brakes the arm: BRAKE or BRAKE F.
    Brake { fast: bool },
    /// RESUME
    Resume,
    /// HALT
    Halt,
    /// CONTINUE
    Continue,
    /// Declares a trigger; pops its priority, delay and distance. The code of the call begins at the next step, and the
    /// program continues at `after`.
    Trigger { after: u32 },
}

/// The location of a statement in a source file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Location {
    /// Index of the file in the list of files.
    pub file: usize,
    /// Line, from 1.
    pub line: usize,
}

/// A routine of the program.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// In upper case.
    pub name: String,
    /// Index of the first step of the routine.
    pub start: u32,
    /// The number of cells of the routine's parameters.
    pub parameter_cells: u32,
    /// The number of cells of the parameters, local variables and counters.
    pub frame_cells: u32,
    /// Index of the file in the list of files.
    pub file: usize,
    /// The routine's parameters and local variables.
    pub locals: Vec<LocalVariable>,
}

/// A parameter or a local variable of a routine.
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
    /// Index of the first cell of the variable.
    pub offset: u32,
    /// The number of cells of the variable.
    pub cells: u32,
}

/// A compiled program.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Program {
    /// The steps.
    pub code: Vec<Op>,
    /// The location of each statement.
    pub statements: Vec<Location>,
    /// All routines.
    pub routines: Vec<Entry>,
    /// The initial values of the shared memory, from the data lists.
    pub memory: Vec<Cell>,
    /// All shared variables.
    pub shared: Vec<Shared>,
    /// All texts.
    pub texts: Vec<String>,
    /// The files' names.
    pub files: Vec<String>,
    /// The statements that are checked but not executed: their index, and a description of the unsupported part.
    pub unexecuted: BTreeMap<u32, String>,
    /// Whether the program exceeds the maximum number of steps. Such a program must not be executed.
    pub is_too_large: bool,
    /// The steps in their combined form.
    pub(super) condensed: Condensed,
}

impl Program {
    /// Returns the index of the routine with this name.
    pub fn routine(&self, name: &str) -> Option<u32> {
        self.routines.iter().position(|routine| routine.name == name).and_then(|index| u32::try_from(index).ok())
    }

    /// Returns the index of the first cell of the shared variable with this name.
    pub fn cell(&self, name: &str) -> Option<u32> {
        self.shared.iter().find(|shared| shared.name == name).map(|shared| shared.offset)
    }
}

/// Maximum number of values on the stack for one combined expression. More values occur only in a list, and lists are
/// not combined.
const MAX_STACK_DEPTH: usize = 32;

/// The combined operation that begins at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum CombinedOp {
    /// The step is not combined with others.
    Nothing,
    /// The steps push a value on the stack.
    Value { value: u32, next: u32 },
    /// The steps jump if a value is FALSE; `at` is the index of the jump step.
    Branch { value: u32, at: u32, to: u32, next: u32 },
    /// The steps assign a value to a memory location.
    Assign { place: u32, value: u32, next: u32 },
}

/// A value in the combined form; operands are indices in the list of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum CondensedValue {
    Fixed(Cell),
    Global(u32),
    Local(u32),
    At(u32),
    Binary(Binary, u32, u32),
    /// AND or OR whose right operand may be skipped.
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

/// The base of a memory location.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum LocationStart {
    Space(MemorySpace),
    /// The location whose address is in this local cell.
    Referred(u32),
}

/// A memory location: a variable, a component of it or an element of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MemoryRef {
    pub(super) start: LocationStart,
    pub(super) offset: u32,
    pub(super) index: Option<Index>,
}

/// An index into an array of `count` elements with `size` cells each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Index {
    pub(super) value: u32,
    pub(super) count: u32,
    pub(super) size: u32,
}

/// The combined form of a whole program.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Condensed {
    /// For each step, the combined operation that begins there, and whether it may wait for the arm.
    pub(super) steps: Vec<(CombinedOp, bool)>,
    pub(super) values: Vec<CondensedValue>,
    pub(super) places: Vec<MemoryRef>,
}

/// A value or a memory location that a step would push on the stack.
#[derive(Debug, Clone, Copy)]
enum StackItem {
    Memory(MemoryRef),
    Value(u32),
}

/// Combines steps from one index onward, as long as they are supported.
struct CondenseReader<'a> {
    all: &'a mut Condensed,
    stack: Vec<StackItem>,
    /// The steps at which the right operands of the open AND and OR operators end.
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
    /// Finds the longest sequence of steps that forms one value, or the jump or assignment that ends the sequence.
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

    /// Adds one step to the expression; returns `None` if the step cannot be part of an expression.
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
                // The right operand of this operator must end exactly at this step.
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

/// Returns whether an access to a memory location may stop the advance run. For a variable that is passed by reference,
/// this is assumed.
fn may_stop_advance(place: &MemoryRef) -> bool {
    match place.start {
        LocationStart::Space(MemorySpace::System(index)) => SYSTEM_VARIABLES[index as usize].stops_advance,
        LocationStart::Space(_) => false,
        LocationStart::Referred(_) => true,
    }
}
