//! Combines steps for speed: an expression without calls, a jump on the value of an expression, or an assignment of
//! that value.
//!
//! The list of steps is not changed: it defines the meaning of a program, and is executed step by step if one of the
//! steps may wait for the arm. For each step, the combined operation that begins there and the next step are stored,
//! so that jumps lead to the same steps as before.

use super::code::{Cell, MemorySpace, Op};
use super::syntax::Binary;
use super::system::SYSTEM_VARIABLES;

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
