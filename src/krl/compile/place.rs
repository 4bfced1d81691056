//! Addresses of variables and of their components and elements.

use super::super::code::Cell;
use super::super::code::Op;
use super::super::syntax::{Expression, Step, VariableRef};
use super::super::system::{self, SYSTEM_VARIABLES};
use super::super::types::Type;
use super::compiler::{Compiler, Home, Variable, cells_u32};

/// A variable or part of one, whose address the steps have put on the stack.
pub(super) struct Found {
    pub(super) kind: Type,
    /// Of an array as a whole; empty for one value.
    pub(super) dimensions: Vec<usize>,
    pub(super) writable: bool,
}

impl Compiler<'_> {
    fn variable(&mut self, name: &str) -> Option<Variable> {
        if let Some(variable) = self.locals.get(name) {
            return Some(variable.clone());
        }
        if let Some(variable) = self.shared_variable(name) {
            return Some(variable.clone());
        }
        if !name.starts_with('$') {
            self.warn(name, "declared in none of the files named; name the file that declares it, too");
            return None;
        }
        let Some(index) = system::find(name) else {
            self.warn(
                name,
                "this system variable is not among those that are known here; see KUKA's list for your KSS",
            );
            return None;
        };
        let row = SYSTEM_VARIABLES[index];
        if row.since > self.kss.minor {
            let kss = self.kss;
            self.problem(
                name,
                format!(
                    "KSS {kss} has no such variable (from 8.{} on); do without, or raise the lowest KSS",
                    row.since
                ),
            );
        }
        Some(Variable {
            kind: self.types.find(row.type_name).unwrap_or(Type::Unknown),
            dimensions: if row.count > 0 { vec![row.count] } else { Vec::new() },
            home: Home::System(u16::try_from(index).unwrap_or_default()),
            constant: false,
            value: None,
            writable: row.writable,
        })
    }

    /// Puts the address of a variable or of a part of it on the stack; `None` where it is not known.
    pub(super) fn address(&mut self, place: &VariableRef) -> Option<Found> {
        let variable = self.variable(&place.name)?;
        self.emit(match variable.home {
            Home::Global(offset) => Op::Global(offset),
            Home::Local(offset) => Op::Local(offset),
            Home::Referred(offset) => Op::Referred(offset),
            Home::System(index) => Op::System(index),
        });
        let mut found = Found { kind: variable.kind, dimensions: variable.dimensions, writable: variable.writable };
        for step in &place.steps {
            match step {
                Step::Index(indices) => self.index(&place.name, indices, &mut found)?,
                Step::Component(name) => self.component(&place.name, name, &mut found)?,
                Step::Whole => {}
            }
        }
        Some(found)
    }

    fn component(&mut self, variable: &str, name: &str, found: &mut Found) -> Option<()> {
        if found.kind == Type::Unknown {
            return None;
        }
        if !found.dimensions.is_empty() {
            self.problem(variable, format!("an index is missing before .{name}"));
            return None;
        }
        let component = self
            .types
            .struc(found.kind)
            .and_then(|struc| struc.components.iter().find(|component| component.name == name).cloned());
        let Some(component) = component else {
            let type_name = self.types.name(found.kind);
            let known = self.types.struc(found.kind).map(|struc| {
                struc.components.iter().map(|component| component.name.as_str()).collect::<Vec<_>>().join(", ")
            });
            let known = known.map_or(String::new(), |known| format!("; it has {known}"));
            self.problem(variable, format!("{type_name} has no component {name}{known}"));
            return None;
        };
        let offset = cells_u32(component.offset);
        match self.program.code.last_mut() {
            Some(Op::Global(at) | Op::Local(at)) => *at += offset,
            _ if offset == 0 => {}
            _ => {
                self.emit(Op::Component(offset));
            }
        }
        (found.kind, found.dimensions) = (component.kind, component.dimensions);
        Some(())
    }

    fn index(&mut self, variable: &str, indices: &[Expression], found: &mut Found) -> Option<()> {
        if indices.len() != found.dimensions.len() {
            let (given, has) = (indices.len(), found.dimensions.len());
            self.problem(variable, format!("{given} indices are given, the variable has {has}"));
            return None;
        }
        let size = self.types.size(found.kind);
        let dimensions = std::mem::take(&mut found.dimensions);
        for (place, (index, &count)) in indices.iter().zip(&dimensions).enumerate() {
            self.check_bounds(variable, index, count);
            let inner: usize = dimensions[place + 1..].iter().product();
            self.typed_value(index, Type::Int, variable);
            let count = if count == 0 { u32::MAX } else { cells_u32(count) };
            self.emit(Op::Index { count, size: cells_u32(size * inner) });
        }
        Some(())
    }

    /// An index that is known before the program runs, or by the FOR around it.
    fn check_bounds(&mut self, variable: &str, index: &Expression, count: usize) {
        let range = match (self.constant(index), index) {
            (Some(Cell::Int(index)), _) => Some((index, index)),
            (_, Expression::Variable(place)) if place.steps.is_empty() => self.ranges.get(&place.name).copied(),
            _ => None,
        };
        let Some((low, high)) = range.filter(|_| count > 0) else { return };
        let inside = |index: i32| usize::try_from(index).is_ok_and(|index| (1..=count).contains(&index));
        if let Some(wrong) = [low, high].into_iter().find(|index| !inside(*index)) {
            self.problem(variable, format!("the index {wrong} is outside of the array, 1 to {count}"));
        }
    }

    /// An address on the stack becomes the value there.
    pub(super) fn load(&mut self, kind: Type) {
        let cells = cells_u32(self.types.size(kind));
        if cells != 1 {
            self.emit(Op::LoadBlock(cells));
            return;
        }
        match self.program.code.last_mut() {
            Some(op @ Op::Global(_)) => {
                if let Op::Global(at) = *op {
                    *op = Op::LoadGlobal(at);
                }
            }
            Some(op @ Op::Local(_)) => {
                if let Op::Local(at) = *op {
                    *op = Op::LoadLocal(at);
                }
            }
            _ => {
                self.emit(Op::Load);
            }
        }
    }
}
