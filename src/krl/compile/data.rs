//! Data lists: types, variables, their place in shared memory and their first values.

use super::super::code::{Cell, Shared};
use super::super::syntax::{Action, Data, Declaration, Declared, Expression, Item, Step, Unary};
use super::super::types::{Type, Types};
use super::compiler::{Compiler, Home, Variable, cells_u32};

impl Compiler<'_> {
    /// STRUC and ENUM of all files. A structure may use one that stands behind it.
    pub(super) fn declare_types(&mut self) {
        let files = self.files;
        let mut strucs = Vec::new();
        for (index, file) in files.iter().enumerate() {
            let of_data = file.data.iter().flat_map(|data| &data.declarations);
            let of_routines = file.routines.iter().flat_map(|routine| &routine.declarations);
            for declaration in of_data.chain(of_routines) {
                (self.file, self.line) = (index, declaration.line);
                match &declaration.kind {
                    Declared::Enumeration { name, words } => {
                        self.check_name(name);
                        if !self.types.add_enumeration(name, words.clone()) {
                            self.problem(name, "a type of this name is declared already");
                        }
                    }
                    Declared::Struc { name, components } => {
                        strucs.push((index, declaration.line, name, components))
                    }
                    Declared::Variables { .. } | Declared::Foreign => {}
                }
            }
        }
        while !strucs.is_empty() {
            let known = |types: &Types, components: &[(String, Item)]| {
                components.iter().all(|(type_name, _)| types.find(type_name).is_some())
            };
            // Where none is ready the first one is told to be wrong.
            let ready = strucs.iter().position(|(_, _, _, components)| known(&self.types, components));
            let (file, line, name, components) = strucs.remove(ready.unwrap_or(0));
            (self.file, self.line) = (file, line);
            self.declare_struc(name, components);
        }
    }

    fn declare_struc(&mut self, name: &str, components: &[(String, Item)]) {
        self.check_name(name);
        let mut placed = Vec::new();
        for (type_name, item) in components {
            let kind = self.type_named(type_name);
            let dimensions = item.dimensions.iter().map(|size| self.dimension(size.as_ref())).collect();
            placed.push((item.name.clone(), kind, dimensions));
        }
        if !self.types.add_struc(name, placed) {
            self.problem(name, "a type of this name is declared already");
        }
    }

    /// An array's size; 0 where it is the caller's.
    pub(super) fn dimension(&mut self, size: Option<&Expression>) -> usize {
        let Some(size) = size else { return 0 };
        match self.constant(size) {
            Some(Cell::Int(size)) if size >= 1 => usize::try_from(size).unwrap_or(1),
            _ => {
                self.problem("", "an array's size is a whole number of at least 1 that is known before the start");
                1
            }
        }
    }

    /// The variables of all data lists, and their first values.
    pub(super) fn declare_data(&mut self) {
        let files = self.files;
        for (index, file) in files.iter().enumerate() {
            self.file = index;
            let Some(data) = &file.data else { continue };
            for declaration in &data.declarations {
                self.line = declaration.line;
                self.declare_shared(declaration, data, &file.module);
            }
            for value in &data.values {
                self.line = value.line;
                if let Action::Assign { to, value } = &value.action {
                    self.first_value(to, value);
                }
            }
        }
    }

    fn declare_shared(&mut self, declaration: &Declaration, data: &Data, module: &str) {
        let Declared::Variables { type_name, items, constant } = &declaration.kind else { return };
        if declaration.global && !data.public {
            self.problem(&items[0].name, "GLOBAL needs a data list that is PUBLIC");
        }
        for item in items {
            self.check_name(&item.name);
            let kind = self.type_named(type_name);
            let dimensions: Vec<usize> = item.dimensions.iter().map(|size| self.dimension(size.as_ref())).collect();
            let cells = self.types.cells(kind, &dimensions);
            let offset = cells_u32(self.program.memory.len());
            self.program.memory.resize(self.program.memory.len() + cells, Cell::Unset);
            self.program.shared.push(Shared { name: item.name.clone(), offset, cells: cells_u32(cells) });
            let mut value = None;
            if let Some(expression) = &item.value {
                let at = usize::try_from(offset).unwrap_or_default();
                self.write_value(at, kind, &dimensions, expression);
                value = self.program.memory.get(at).copied().filter(|_| *constant && cells == 1);
            } else if *constant {
                self.problem(&item.name, "a CONST takes its value in its declaration");
            }
            let home = Home::Global(offset);
            let variable = Variable { kind, dimensions, home, constant: *constant, value, writable: !*constant };
            let name = item.name.clone();
            let taken = if declaration.global {
                self.globals.insert(name, variable)
            } else {
                self.of_module.insert((module.to_owned(), name), variable)
            };
            if taken.is_some() {
                self.problem(&item.name, "this name is declared twice");
            }
        }
    }

    /// `NAME[1]=17` in a data list.
    fn first_value(&mut self, to: &super::super::syntax::VariableRef, value: &Expression) {
        let module = self.files[self.file].module.clone();
        let of_module = self.of_module.get(&(module, to.name.clone()));
        let Some(variable) = of_module.or_else(|| self.globals.get(&to.name)).cloned() else {
            if !to.name.starts_with('$') {
                self.problem(&to.name, "a value is given to a name that this data list does not declare");
            }
            return;
        };
        let (Home::Global(start), mut kind) = (variable.home, variable.kind) else { return };
        let (mut at, mut dimensions) = (start as usize, variable.dimensions);
        for step in &to.steps {
            match step {
                Step::Index(indices) => {
                    let Some(offset) = self.constant_index(&to.name, indices, &dimensions) else { return };
                    at += offset * self.types.size(kind);
                    dimensions = Vec::new();
                }
                Step::Component(name) => {
                    let found = self.types.struc(kind).and_then(|struc| {
                        struc.components.iter().find(|component| component.name == *name).cloned()
                    });
                    let Some(component) = found else {
                        let type_name = self.types.name(kind);
                        return self.problem(&to.name, format!("{type_name} has no component {name}"));
                    };
                    at += component.offset;
                    (kind, dimensions) = (component.kind, component.dimensions);
                }
                Step::Whole => {}
            }
        }
        self.write_value(at, kind, &dimensions, value);
    }

    fn constant_index(&mut self, name: &str, indices: &[Expression], dimensions: &[usize]) -> Option<usize> {
        if indices.len() != dimensions.len() {
            self.problem(name, format!("{} indices for {} dimensions", indices.len(), dimensions.len()));
            return None;
        }
        let mut offset = 0;
        for (index, &count) in indices.iter().zip(dimensions) {
            let index = match self.constant(index) {
                Some(Cell::Int(index)) => index,
                _ => {
                    self.problem(name, "in a data list an index is a whole number");
                    return None;
                }
            };
            let inside = usize::try_from(index).ok().filter(|index| (1..=count).contains(index));
            let Some(inside) = inside else {
                self.problem(name, format!("the index {index} is outside of the array, 1 to {count}"));
                return None;
            };
            offset = offset * count + inside - 1;
        }
        Some(offset)
    }

    fn write_value(&mut self, at: usize, kind: Type, dimensions: &[usize], value: &Expression) {
        match value {
            Expression::Text(text) if kind == Type::Char => {
                let cells = self.types.cells(kind, dimensions);
                if text.len() > cells {
                    self.problem("", format!("the text has {} characters, the variable {cells}", text.len()));
                }
                for (place, byte) in text.bytes().take(cells).enumerate() {
                    self.program.memory[at + place] = Cell::Char(byte);
                }
            }
            Expression::Aggregate { parts, .. } if self.types.struc(kind).is_some() => {
                for (component, value) in parts {
                    let found = self.types.struc(kind).and_then(|struc| {
                        struc.components.iter().find(|known| known.name == component.name).cloned()
                    });
                    match found {
                        Some(found) => self.write_value(at + found.offset, found.kind, &found.dimensions, value),
                        None => {
                            let type_name = self.types.name(kind);
                            self.problem(&component.name, format!("{type_name} has no such component"));
                        }
                    }
                }
            }
            Expression::Word(word) => match self.types.word(kind, word).and_then(|word| u16::try_from(word).ok()) {
                Some(place) => self.program.memory[at] = Cell::Word(place),
                None => {
                    let type_name = self.types.name(kind);
                    self.problem("", format!("#{word} is no word of {type_name}"));
                }
            },
            _ => {
                let found = match (self.constant(value), kind) {
                    (_, Type::Unknown) => return,
                    (Some(Cell::Int(number)), Type::Real) => Some(Cell::Real(number as f32)),
                    (Some(Cell::Real(number)), Type::Int) => Some(Cell::Int(number.round() as i32)),
                    (Some(cell @ Cell::Int(_)), Type::Int) => Some(cell),
                    (Some(cell @ Cell::Real(_)), Type::Real) => Some(cell),
                    (Some(cell @ Cell::Bool(_)), Type::Bool) => Some(cell),
                    _ => None,
                };
                match found {
                    Some(cell) => self.program.memory[at] = cell,
                    None => {
                        let type_name = self.types.name(kind);
                        self.problem(
                            "",
                            format!("a first value of type {type_name} is expected that is known here"),
                        );
                    }
                }
            }
        }
    }

    /// The value of an expression that is known before the program runs.
    pub(super) fn constant(&self, expression: &Expression) -> Option<Cell> {
        use super::super::syntax::Binary::{By, Minus, Plus, Times};
        match expression {
            Expression::Int(number) => Some(Cell::Int(*number)),
            Expression::Real(number) => Some(Cell::Real(*number)),
            Expression::Bool(value) => Some(Cell::Bool(*value)),
            Expression::Variable(place) if place.steps.is_empty() => {
                if self.locals.contains_key(&place.name) {
                    return None;
                }
                self.shared_variable(&place.name).filter(|variable| variable.constant)?.value
            }
            Expression::Unary(Unary::Minus, inner) => match self.constant(inner)? {
                Cell::Int(number) => Some(Cell::Int(number.checked_neg()?)),
                Cell::Real(number) => Some(Cell::Real(-number)),
                _ => None,
            },
            Expression::Binary(operator, left, right) => {
                let (Cell::Int(left), Cell::Int(right)) = (self.constant(left)?, self.constant(right)?) else {
                    return None;
                };
                match operator {
                    Plus => left.checked_add(right),
                    Minus => left.checked_sub(right),
                    Times => left.checked_mul(right),
                    By => left.checked_div(right),
                    _ => None,
                }
                .map(Cell::Int)
            }
            _ => None,
        }
    }

    /// A variable of a data list that this file sees.
    pub(super) fn shared_variable(&self, name: &str) -> Option<&Variable> {
        let module = &self.files[self.file].module;
        self.of_module.get(&(module.clone(), name.to_owned())).or_else(|| self.globals.get(name))
    }
}
