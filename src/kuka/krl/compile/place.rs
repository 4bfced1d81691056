//! Compiles the addresses of variables, and of their components and elements.

use super::super::code::{Cell, Op};
use super::super::routines::VARIABLES_OF_ETHERNET_KRL_6;
use super::super::syntax::{Expression, Step, VariableRef};
use super::super::system::{self, LOWEST_KSS, SYSTEM_VARIABLES};
use super::super::types::{Component, Type};
use super::compiler::{Compiler, Variable, VariableLocation, cells_u32};
use super::data::untyped_location;

/// A variable, or a part of it, whose address is on the stack.
pub(super) struct ResolvedVariable {
    pub(super) kind: Type,
    /// The sizes of the dimensions if the value is a whole array; empty for a single value.
    pub(super) dimensions: Vec<usize>,
    pub(super) writable: bool,
    pub(super) constant: bool,
}

impl Compiler<'_> {
    fn variable(&mut self, name: &str) -> Option<Variable> {
        if let Some(variable) = self.locals.get(name) {
            return Some(variable.clone());
        }
        if let Some(variable) = self.shared_variable(name) {
            return Some(variable.clone());
        }
        if let Some(index) = system::find(name) {
            return Some(self.system_variable(index));
        }
        if let Some(named) = system::find_variable(name) {
            let kind = if named.type_name == "ANY" { Type::Unknown } else { self.types.kuka_type(named.type_name) };
            return (kind != Type::Unknown).then(|| untyped_location(kind, vec![0; named.dimensions]));
        }
        self.report_unknown(name);
        None
    }

    /// Checks that a variable is writable. Writing a constant is an error. Writing another read-only variable is a
    /// warning, because it is not known whether a controller refuses the program.
    pub(super) fn check_writable(&mut self, name: &str, found: &ResolvedVariable, message: &str) {
        if found.writable {
            return;
        }
        self.record_unexecuted(name);
        if found.constant {
            self.problem(name, message);
        } else {
            self.warn(name, message);
        }
    }

    fn report_unknown(&mut self, name: &str) {
        if self.reported.contains(&(self.file, name.to_owned())) {
            return;
        }
        let hidden = self.of_module.iter().find(|((_, known), _)| known == name).map(|(_, shared)| shared.file);
        let message = if let Some(file) = hidden {
            let other = &self.files[file].name;
            format!(
                "this name is visible only in the program of {other}; to make it visible to all programs, declare it \
                 GLOBAL in a PUBLIC data list"
            )
        } else if VARIABLES_OF_ETHERNET_KRL_6.contains(&name) {
            "this name belongs to EthernetKRL 6 (iiQKA.OS2) and does not exist in KSS 8".to_owned()
        } else if name.starts_with('$') {
            "this program does not know this system variable; look it up in KUKA's list for your KSS version"
                .to_owned()
        } else {
            "this name is declared in none of the given files; add the file with its declaration".to_owned()
        };
        self.warn_once(name, message);
    }

    fn system_variable(&mut self, index: usize) -> Variable {
        let row = SYSTEM_VARIABLES[index];
        let kss = self.kss.unwrap_or(LOWEST_KSS);
        if row.since > kss.minor {
            let message =
                format!("KSS {kss} does not have this system variable (available from 8.{} on)", row.since);
            match self.kss {
                Some(_) => self.problem(row.name, message),
                None => self.warn_once(row.name, format!("{message}; state your controller's version with --kss")),
            }
        }
        Variable {
            kind: self.types.kuka_type(row.type_name),
            dimensions: if row.count > 0 { vec![row.count] } else { Vec::new() },
            location: VariableLocation::System(u16::try_from(index).unwrap_or_default()),
            constant: false,
            value: None,
            writable: row.writable,
        }
    }

    /// Pushes the address of a variable, or of a part of it. Returns `None` if the variable is not known; the statement
    /// is then not executed.
    pub(super) fn address(&mut self, place: &VariableRef) -> Option<ResolvedVariable> {
        let Some(variable) = self.variable(&place.name) else {
            self.record_unexecuted(&place.name);
            self.check_indices(place);
            return None;
        };
        self.push_base_address(&place.name, &variable);
        let by_reference = matches!(variable.location, VariableLocation::Referred(_));
        let Variable { kind, dimensions, writable, constant, .. } = variable;
        let mut found = ResolvedVariable { kind, dimensions, writable, constant };
        for step in &place.steps {
            match step {
                Step::Index(indices) => self.index(&place.name, indices, &mut found, by_reference)?,
                Step::Component(name) => self.component(&place.name, name, &mut found)?,
            }
        }
        Some(found)
    }

    fn push_base_address(&mut self, name: &str, variable: &Variable) {
        if variable.location == VariableLocation::Nowhere {
            self.record_unexecuted(name);
        }
        self.emit(match variable.location {
            VariableLocation::Global(offset) => Op::Global(offset),
            VariableLocation::Local(offset) => Op::Local(offset),
            VariableLocation::Referred(offset) => Op::Referred(offset),
            VariableLocation::System(index) | VariableLocation::Bit { variable: index, .. } => Op::System(index),
            VariableLocation::Nowhere => Op::Push(Cell::Unset),
        });
        if let VariableLocation::Bit { variable, number } = variable.location {
            let count = cells_u32(SYSTEM_VARIABLES[usize::from(variable)].count);
            self.emit(Op::Push(Cell::Int(number)));
            self.emit(Op::Index { count, size: 1 });
        }
    }

    /// Checks the index expressions of an unknown variable, because they may contain known variables.
    fn check_indices(&mut self, place: &VariableRef) {
        for step in &place.steps {
            if let Step::Index(indices) = step {
                indices.iter().flatten().for_each(|index| self.typed_value(index, Type::Int, &place.name));
            }
        }
    }

    /// Returns the component with this name; reports a problem if the type has no such component.
    pub(super) fn resolve_component(&mut self, variable: &str, kind: Type, name: &str) -> Option<Component> {
        let struc = self.types.structure(kind);
        if let Some(component) = struc.and_then(|struc| struc.component(name)) {
            return Some(component.clone());
        }
        let (is_kukas, known) =
            struc.map_or((false, String::new()), |struc| (struc.kuka, struc.describe_components()));
        let is_complete = self.types.is_pose(kind) || self.types.is_axes(kind);
        let type_name = self.types.name(kind);
        if is_kukas && !is_complete {
            let key = format!("{variable}.{name}");
            self.warn_once(
                &key,
                format!("not checked: of {type_name}, this program knows only the components {known}"),
            );
            self.record_unexecuted(&key);
            return None;
        }
        let known = if known.is_empty() { String::new() } else { format!("; its components are {known}") };
        self.problem(variable, format!("{type_name} has no component {name}{known}"));
        None
    }

    fn component(&mut self, variable: &str, name: &str, found: &mut ResolvedVariable) -> Option<()> {
        if found.kind == Type::Unknown {
            return None;
        }
        if !found.dimensions.is_empty() {
            self.problem(variable, format!("an index is missing before .{name}"));
            return None;
        }
        let component = self.resolve_component(variable, found.kind, name)?;
        let offset = cells_u32(component.offset);
        match self.program.code.last_mut() {
            Some(Op::Global(at) | Op::Local(at)) => *at = at.saturating_add(offset),
            _ if offset == 0 => {}
            _ => {
                self.emit(Op::Component(offset));
            }
        }
        (found.kind, found.dimensions) = (component.kind, component.dimensions);
        Some(())
    }

    fn index(
        &mut self,
        variable: &str,
        indices: &[Option<Expression>],
        found: &mut ResolvedVariable,
        by_reference: bool,
    ) -> Option<()> {
        if indices.iter().all(Option::is_none) {
            // The whole array.
            return Some(());
        }
        if found.kind == Type::Unknown && found.dimensions.is_empty() {
            indices.iter().flatten().for_each(|index| self.typed_value(index, Type::Int, variable));
            return None;
        }
        if indices.len() != found.dimensions.len() {
            let (given, has) = (indices.len(), found.dimensions.len());
            self.problem(variable, format!("found {given} indices, expected {has}"));
            return None;
        }
        let size = self.types.size(found.kind);
        let dimensions = std::mem::take(&mut found.dimensions);
        for (place, (index, &count)) in indices.iter().zip(&dimensions).enumerate() {
            let Some(index) = index else {
                found.dimensions.push(count);
                self.record_unexecuted("a row of an array");
                continue;
            };
            self.check_bounds(variable, index, count);
            let inner = dimensions[place + 1..].iter().fold(size, |cells, count| cells.saturating_mul(*count));
            self.typed_value(index, Type::Int, variable);
            if count == 0 && !by_reference {
                self.record_unexecuted(variable);
            }
            let count = if count == 0 { u32::MAX } else { cells_u32(count) };
            self.emit(Op::Index { count, size: cells_u32(inner) });
        }
        Some(())
    }

    /// Checks an index whose value is known at compile time, or whose range is known from an enclosing FOR loop.
    fn check_bounds(&mut self, variable: &str, index: &Expression, count: usize) {
        if count == 0 {
            return;
        }
        let is_outside =
            |index: &i32| usize::try_from(*index).is_ok_and(|index| !(1..=count).contains(&index)) || *index < 1;
        let message = |index: i32| format!("the index {index} is outside of the array (valid: 1 to {count})");
        if let Some(Cell::Int(index)) = self.evaluate_constant(index) {
            if is_outside(&index) {
                self.problem(variable, message(index));
            }
            return;
        }
        let Expression::Variable(place) = index else { return };
        let range = self.ranges.get(&place.name).filter(|_| place.steps.is_empty()).copied();
        // This is only a warning, because an IF may exclude this value of the index.
        if let Some(wrong) = range.and_then(|(low, high)| [low, high].into_iter().find(is_outside)) {
            self.warn(variable, message(wrong));
        }
    }

    /// Replaces an address on the stack by the value at this address.
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
