//! Compiles data lists: variables, their addresses in shared memory, and their initial values.

use super::super::code::{Cell, Shared};
use super::super::syntax::{
    Action, Data, Declaration, DeclarationContent, Expression, Item, MAX_ARRAY_VALUES, MAX_MEMORY_VALUES, Step,
    Unary, VariableRef,
};
use super::super::system;
use super::super::types::Type;
use super::compiler::{Compiler, SharedVariable, Variable, VariableLocation, cells_u32, is_visible_everywhere};
use std::collections::{BTreeMap, BTreeSet};

/// The part of a shared variable to which an initial value is assigned.
#[derive(Clone)]
struct InitialPart {
    /// The first cell of the part; `None` if no memory is allocated.
    at: Option<usize>,
    kind: Type,
    dimensions: Vec<usize>,
}

impl Compiler<'_> {
    /// Returns the size of one dimension of an array; 0 if the caller determines it.
    pub(super) fn dimension(&mut self, size: Option<&Expression>) -> usize {
        let Some(size) = size else { return 0 };
        match self.evaluate_constant(size) {
            Some(Cell::Int(size)) if size >= 1 => usize::try_from(size).unwrap_or(1),
            None if self.is_size_possibly_constant(size) => 0,
            _ => {
                self.problem("", "the size of an array must be a constant whole number of at least 1");
                1
            }
        }
    }

    /// Returns whether the controller may know a size that is unknown here, because a constant may be declared in a
    /// file that was not given.
    fn is_size_possibly_constant(&self, size: &Expression) -> bool {
        match size {
            Expression::Variable(place) => self.shared_variable(&place.name).is_none_or(|known| known.constant),
            Expression::Binary(_, left, right) => {
                self.is_size_possibly_constant(left) || self.is_size_possibly_constant(right)
            }
            Expression::Unary(_, inner) => self.is_size_possibly_constant(inner),
            _ => false,
        }
    }

    /// Evaluates the constants of all data lists. Array sizes in other lists may use them before memory is allocated.
    pub(super) fn find_constants(&mut self) {
        let files = self.files;
        // Two passes are needed, because a constant may refer to a constant of a subsequent list.
        for _ in 0..2 {
            for (index, file) in files.iter().enumerate() {
                self.file = index;
                let Some(data) = &file.data else { continue };
                let below = data.values.iter().filter_map(|value| match &value.action {
                    Action::Assign { to, value } if to.steps.is_empty() => Some((to.name.as_str(), value)),
                    _ => None,
                });
                let below: BTreeMap<&str, &Expression> = below.collect();
                for declaration in &data.declarations {
                    let DeclarationContent::Variables { constant: true, items, .. } = &declaration.kind else {
                        continue;
                    };
                    let is_global = declaration.global || is_visible_everywhere(data);
                    let module = if is_global { None } else { Some(self.modules[index]) };
                    for item in items.iter().filter(|item| item.dimensions.is_empty()) {
                        let value = item.value.as_ref().or_else(|| below.get(item.name.as_str()).copied());
                        if let Some(cell) = value.and_then(|value| self.evaluate_constant(value)) {
                            self.constants.insert((module, item.name.clone()), cell);
                        }
                    }
                }
            }
        }
    }

    /// Declares the variables of all data lists, with their initial values.
    pub(super) fn declare_data(&mut self) {
        let files = self.files;
        for (index, file) in files.iter().enumerate() {
            self.file = index;
            let Some(data) = &file.data else { continue };
            self.declare_list(data);
            self.check_constant_values(data);
            for value in &data.values {
                self.line = value.line;
                if let Action::Assign { to, value } = &value.action {
                    self.compile_initial_value(to, value);
                }
            }
        }
    }

    fn declare_list(&mut self, data: &Data) {
        for declaration in &data.declarations {
            self.line = declaration.line;
            // Declarations belong to no executed statement.
            self.statement = u32::MAX;
            match &declaration.kind {
                DeclarationContent::Variables { constant, type_name, items } => {
                    self.declare_shared(declaration, data, type_name, items, *constant);
                }
                DeclarationContent::Signal { name, from, to } => {
                    let variable = self.signal(name, [from, to]);
                    self.add_shared(declaration, data, name, variable);
                }
                DeclarationContent::Import { type_name, name } => {
                    let kind = self.resolve_type(type_name);
                    let variable = untyped_location(kind, Vec::new());
                    self.add_shared(declaration, data, name, variable);
                }
                _ => {}
            }
        }
    }

    fn declare_shared(
        &mut self,
        declaration: &Declaration,
        data: &Data,
        type_name: &str,
        items: &[Item],
        constant: bool,
    ) {
        if declaration.global && !data.public && !is_visible_everywhere(data) {
            self.warn(
                &items[0].name,
                "GLOBAL needs a PUBLIC data list; otherwise, other programs may not see this variable",
            );
        }
        for item in items {
            self.check_name(&item.name);
            let kind = self.resolve_type(type_name);
            let dimensions: Vec<usize> = item.dimensions.iter().map(|size| self.dimension(size.as_ref())).collect();
            let at = self.allocate_variable(&item.name, kind, &dimensions);
            let mut value = None;
            if let Some(expression) = &item.value {
                self.write_value(&item.name, InitialPart { at, kind, dimensions: dimensions.clone() }, expression);
                let is_simple = dimensions.is_empty() && self.types.size(kind) == 1;
                value = at.and_then(|at| self.program.memory.get(at).copied()).filter(|_| constant && is_simple);
            }
            let location = at.map_or(VariableLocation::Nowhere, |at| VariableLocation::Global(cells_u32(at)));
            let variable = Variable { kind, dimensions, location, constant, value, writable: !constant };
            self.add_shared(declaration, data, &item.name, variable);
        }
    }

    /// Allocates memory for a shared variable and returns its first cell; `None` if it exceeds the memory limit.
    fn allocate_variable(&mut self, name: &str, kind: Type, dimensions: &[usize]) -> Option<usize> {
        let cells = self.types.cells(kind, dimensions);
        if cells > MAX_ARRAY_VALUES {
            let message =
                format!("the array has more than {MAX_ARRAY_VALUES} values: no controller has memory for them");
            self.problem(name, message);
        }
        let offset = self.program.memory.len();
        if cells > MAX_MEMORY_VALUES.saturating_sub(offset) {
            self.record_unexecuted("a variable of this size");
            return None;
        }
        self.program.memory.resize(offset + cells, Cell::Unset);
        self.program.shared.push(Shared {
            name: name.to_owned(),
            offset: cells_u32(offset),
            cells: cells_u32(cells),
        });
        Some(offset)
    }

    fn add_shared(&mut self, declaration: &Declaration, data: &Data, name: &str, variable: Variable) {
        let (file, line) = (self.file, declaration.line);
        let shared = SharedVariable { variable, file, line };
        let own_list = is_visible_everywhere(data);
        let taken = if declaration.global || own_list {
            self.globals.insert(name.to_owned(), shared)
        } else {
            self.of_module.insert((self.modules[file], name.to_owned()), shared)
        };
        let Some(other) = taken else { return };
        let place = if other.file == file {
            format!("line {}", other.line)
        } else {
            format!("{}, line {}", self.files[other.file].name, other.line)
        };
        let is_of_controller = |file: usize| self.files[file].data.as_ref().is_some_and(is_visible_everywhere);
        if other.file != file && (own_list || is_of_controller(other.file)) {
            self.warn(
                name,
                format!("this name is also declared in one of the controller's own data lists: {place}"),
            );
        } else {
            self.problem(name, format!("this name is declared twice: {place}"));
        }
    }

    /// Declares a signal: `SIGNAL NAME $OUT[3]` is a BOOL, a signal of several outputs is an INT, and an analog signal
    /// is a REAL.
    pub(super) fn signal(&mut self, name: &str, [from, to]: [&Option<VariableRef>; 2]) -> Variable {
        self.check_name(name);
        let analog = from.as_ref().is_some_and(|from| matches!(from.name.as_str(), "$ANIN" | "$ANOUT"));
        let kind = match to {
            _ if analog => Type::Real,
            Some(_) => Type::Int,
            None => Type::Bool,
        };
        let mut variable = untyped_location(kind, Vec::new());
        if let (Some(from), None, false) = (from, to, analog)
            && let Some((index, number)) = self.bit(from)
        {
            variable.location = VariableLocation::Bit { variable: index, number };
            variable.writable = system::SYSTEM_VARIABLES[usize::from(index)].writable;
        }
        variable
    }

    /// Returns the index of the system variable and the number of the output, for example of `$OUT[3]`.
    fn bit(&mut self, place: &VariableRef) -> Option<(u16, i32)> {
        let index = system::find(&place.name)?;
        let [Step::Index(indices)] = &place.steps[..] else { return None };
        let [Some(number)] = &indices[..] else { return None };
        let Some(Cell::Int(number)) = self.evaluate_constant(number) else { return None };
        let count = system::SYSTEM_VARIABLES[index].count;
        if !usize::try_from(number).is_ok_and(|number| (1..=count).contains(&number)) {
            self.problem(&place.name, format!("the index {number} is outside of the array (valid: 1 to {count})"));
            return None;
        }
        Some((u16::try_from(index).ok()?, number))
    }

    /// Checks that each CONST without a value in its declaration receives one in a subsequent line.
    fn check_constant_values(&mut self, data: &Data) {
        let valued: BTreeSet<&str> = data
            .values
            .iter()
            .filter_map(|value| match &value.action {
                Action::Assign { to, .. } => Some(to.name.as_str()),
                _ => None,
            })
            .collect();
        for declaration in &data.declarations {
            let DeclarationContent::Variables { constant: true, items, .. } = &declaration.kind else { continue };
            self.line = declaration.line;
            for item in items.iter().filter(|item| item.value.is_none() && !valued.contains(item.name.as_str())) {
                self.warn(
                    &item.name,
                    "the CONST has no value: assign a value in its declaration or in a later line",
                );
            }
        }
    }

    /// Compiles an initial value in a data list, such as `NAME[1]=17`.
    fn compile_initial_value(&mut self, to: &VariableRef, value: &Expression) {
        self.statement = u32::MAX;
        let Some(variable) = self.shared_variable(&to.name).cloned() else {
            if !to.name.starts_with('$') {
                self.warn_once(
                    &to.name,
                    "not checked: a value is assigned to a name that none of the given files declares",
                );
            }
            return;
        };
        let at = if let VariableLocation::Global(start) = variable.location { Some(start as usize) } else { None };
        let mut part = InitialPart { at, kind: variable.kind, dimensions: variable.dimensions };
        for step in &to.steps {
            match step {
                Step::Index(indices) => {
                    if self.index_part(&to.name, indices, &mut part).is_none() {
                        return;
                    }
                }
                Step::Component(name) => {
                    if self.component_part(&to.name, name, &mut part).is_none() {
                        return;
                    }
                }
            }
        }
        self.write_value(&to.name, part.clone(), value);
        if to.steps.is_empty()
            && variable.constant
            && let Some(cell) = part.at.and_then(|at| self.program.memory.get(at).copied())
        {
            self.set_constant(&to.name, cell);
        }
    }

    fn set_constant(&mut self, name: &str, cell: Cell) {
        let of_module = self.of_module.get_mut(&(self.modules[self.file], name.to_owned()));
        if let Some(shared) = of_module.or_else(|| self.globals.get_mut(name)) {
            shared.variable.value = Some(cell);
        }
    }

    fn component_part(&mut self, variable: &str, name: &str, part: &mut InitialPart) -> Option<()> {
        if part.kind == Type::Unknown {
            return None;
        }
        let component = self.resolve_component(variable, part.kind, name)?;
        part.at = part.at.map(|at| at + component.offset);
        (part.kind, part.dimensions) = (component.kind, component.dimensions);
        Some(())
    }

    /// Selects an element of an array, or a row such as `NAME[2,]`.
    fn index_part(&mut self, name: &str, indices: &[Option<Expression>], part: &mut InitialPart) -> Option<()> {
        let dimensions = std::mem::take(&mut part.dimensions);
        if indices.len() != dimensions.len() {
            // `NAME[]` selects a whole row of characters, to which a string is assigned.
            if indices.iter().all(Option::is_none) {
                part.dimensions = dimensions;
                return Some(());
            }
            self.problem(name, format!("{} indices for {} dimensions", indices.len(), dimensions.len()));
            return None;
        }
        let mut offset = 0_usize;
        for (index, &count) in indices.iter().zip(&dimensions) {
            let Some(index) = index else {
                part.dimensions.push(count);
                offset = offset.saturating_mul(count);
                continue;
            };
            let Some(Cell::Int(index)) = self.evaluate_constant(index) else {
                part.at = None;
                continue;
            };
            let inside = usize::try_from(index).ok().filter(|index| *index >= 1 && (count == 0 || *index <= count));
            let Some(inside) = inside else {
                self.problem(name, format!("the index {index} is outside of the array (valid: 1 to {count})"));
                return None;
            };
            offset = offset.saturating_mul(count).saturating_add(inside - 1);
        }
        if dimensions.contains(&0) {
            part.at = None;
        }
        let size = self.types.size(part.kind);
        part.at = part.at.map(|at| at.saturating_add(offset.saturating_mul(size)));
        Some(())
    }

    fn write_value(&mut self, name: &str, part: InitialPart, value: &Expression) {
        let InitialPart { at, kind, dimensions } = part;
        match value {
            Expression::Text(text) if kind == Type::Char => {
                let cells = self.types.cells(kind, &dimensions);
                let length = text.chars().count();
                if length > cells && !dimensions.contains(&0) {
                    self.warn(
                        name,
                        format!("the string has {length} characters, but the variable has only {cells}"),
                    );
                }
                // At run time each character has one byte.
                let bytes = text.chars().map(|character| u8::try_from(u32::from(character)).unwrap_or(b'?'));
                for (place, byte) in bytes.take(cells).enumerate() {
                    self.set(at.map(|at| at + place), Cell::Char(byte));
                }
            }
            Expression::Aggregate { type_name, parts } => {
                self.write_aggregate(name, (at, kind), type_name.as_deref(), parts)
            }
            Expression::Word(word) => {
                if let Some(place) = self.constant_index(word, kind) {
                    self.set(at, Cell::Word(place));
                }
            }
            _ => self.write_simple(name, at, kind, value),
        }
    }

    fn write_aggregate(
        &mut self,
        name: &str,
        (at, kind): (Option<usize>, Type),
        type_name: Option<&str>,
        parts: &[(VariableRef, Expression)],
    ) {
        let stated = type_name.map(|name| self.resolve_type(name)).filter(|stated| *stated != Type::Unknown);
        let kind = match stated {
            Some(stated) if kind == Type::Unknown || self.types.are_convertible(stated, kind) => stated,
            _ => kind,
        };
        if kind == Type::Unknown {
            return;
        }
        if self.types.structure(kind).is_none() {
            let type_name = self.types.name(kind);
            return self.problem(name, format!("expected {type_name}, found components in braces"));
        }
        for (place, value) in parts {
            let Some(component) = self.resolve_component(name, kind, &place.name) else { continue };
            let at = at.map(|at| at + component.offset);
            let mut part = InitialPart { at, kind: component.kind, dimensions: component.dimensions };
            for step in &place.steps {
                let found = match step {
                    Step::Index(indices) => self.index_part(&place.name, indices, &mut part),
                    Step::Component(name) => self.component_part(&place.name, name, &mut part),
                };
                if found.is_none() {
                    part.kind = Type::Unknown;
                }
            }
            self.write_value(&place.name, part, value);
        }
    }

    fn write_simple(&mut self, name: &str, at: Option<usize>, kind: Type, value: &Expression) {
        let found = self.evaluate_constant(value);
        let cell = match (found, kind) {
            (_, Type::Unknown) => return,
            (Some(Cell::Int(number)), Type::Real) => Cell::Real(number as f32),
            (Some(Cell::Real(number)), Type::Int) => Cell::Int(number.round() as i32),
            (Some(Cell::Int(number)), Type::Char) => Cell::Char(number as u8),
            (Some(cell @ Cell::Int(_)), Type::Int) => cell,
            (Some(cell @ Cell::Real(_)), Type::Real) => cell,
            (Some(cell @ Cell::Bool(_)), Type::Bool) => cell,
            (Some(_), _) => {
                let type_name = self.types.name(kind);
                return self.problem(name, format!("expected an initial value of type {type_name}"));
            }
            (None, _) => {
                let message = "not checked: the initial value is not a constant";
                return self.warn(name, message);
            }
        };
        self.set(at, cell);
    }

    fn set(&mut self, at: Option<usize>, cell: Cell) {
        if let Some(place) = at.and_then(|at| self.program.memory.get_mut(at)) {
            *place = cell;
        }
    }

    /// Returns the value of an expression if it is a constant.
    pub(super) fn evaluate_constant(&self, expression: &Expression) -> Option<Cell> {
        use super::super::syntax::Binary::{Divide, Minus, Multiply, Plus};
        match expression {
            Expression::Int(number) => Some(Cell::Int(*number)),
            Expression::Real(number) => Some(Cell::Real(*number)),
            Expression::Bool(value) => Some(Cell::Bool(*value)),
            Expression::Variable(place) if place.steps.is_empty() => {
                if self.locals.contains_key(&place.name) {
                    return None;
                }
                match self.shared_variable(&place.name) {
                    Some(variable) => variable.value.filter(|_| variable.constant),
                    None => {
                        let module = self.modules[self.file];
                        let constant_in = |module| self.constants.get(&(module, place.name.clone())).copied();
                        constant_in(Some(module)).or_else(|| constant_in(None))
                    }
                }
            }
            Expression::Unary(Unary::Minus, inner) => match self.evaluate_constant(inner)? {
                Cell::Int(number) => Some(Cell::Int(number.checked_neg()?)),
                Cell::Real(number) => Some(Cell::Real(-number)),
                _ => None,
            },
            Expression::Binary(operator, left, right) => {
                let (Cell::Int(left), Cell::Int(right)) =
                    (self.evaluate_constant(left)?, self.evaluate_constant(right)?)
                else {
                    return None;
                };
                match operator {
                    Plus => left.checked_add(right),
                    Minus => left.checked_sub(right),
                    Multiply => left.checked_mul(right),
                    Divide => left.checked_div(right),
                    _ => None,
                }
                .map(Cell::Int)
            }
            _ => None,
        }
    }

    /// Returns a variable of a data list that is visible in this file.
    pub(super) fn shared_variable(&self, name: &str) -> Option<&Variable> {
        let module = self.modules[self.file];
        let of_module = self.of_module.get(&(module, name.to_owned()));
        of_module.or_else(|| self.globals.get(name)).map(|shared| &shared.variable)
    }
}

/// Returns a variable for which only the type is known, and no memory exists.
pub(super) fn untyped_location(kind: Type, dimensions: Vec<usize>) -> Variable {
    Variable { kind, dimensions, location: VariableLocation::Nowhere, constant: false, value: None, writable: true }
}
