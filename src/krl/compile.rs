//! Compiles KRL files to one program: names, types, memory, steps; and reports all their problems.
//!
//! `data` lays out the data lists, `place` finds variables, `value` and `operate` do expressions, `call` arguments,
//! `body` statements; `flow` asks what may be read before it was assigned, and what ends without RETURN.

mod body;
mod call;
mod compiler;
mod data;
mod flow;
mod operate;
mod place;
mod value;

use super::code::{Entry, LocalVariable, Op};
use super::condense::Condensed;
use super::program::Program;
use super::syntax::{Declared, File, Routine};
use super::system::Kss;
use super::types::Type;
use crate::config::Problem;
pub use compiler::RESERVED;
use compiler::{Argument, Compiler, Home, Signature, Variable, cells_u32};
use std::collections::BTreeMap;

/// What was found in files that belong together.
#[derive(Debug)]
pub struct Analysis {
    /// What a controller refuses, or stops at when it runs; for each file in the order of its lines.
    pub problems: Vec<Vec<Problem>>,
    /// What these files cannot tell: names that another file may declare.
    pub warnings: Vec<Vec<Problem>>,
    /// The program; it may be executed where there are neither problems nor warnings.
    pub program: Program,
}

/// Checks files that belong together for a controller with this version of KSS, and makes a program of them.
pub fn analyse(files: &[File], kss: Kss) -> Analysis {
    let mut compiler = Compiler::new(files, kss);
    compiler.program.files = files.iter().map(|file| file.name.clone()).collect();
    compiler.declare_types();
    compiler.declare_data();
    compiler.declare_routines();
    compiler.compile_routines();
    let Compiler { mut problems, mut warnings, mut program, .. } = compiler;
    program.condensed = Condensed::new(&program.code);
    for found in problems.iter_mut().chain(&mut warnings) {
        found.sort_by(|a, b| (a.line, &a.key, &a.message).cmp(&(b.line, &b.key, &b.message)));
        found.dedup();
    }
    Analysis { problems, warnings, program }
}

impl Compiler<'_> {
    fn declare_routines(&mut self) {
        let files = self.files;
        for (index, file) in files.iter().enumerate() {
            self.file = index;
            for (place, routine) in file.routines.iter().enumerate() {
                self.line = routine.line;
                self.check_name(&routine.name);
                let global = routine.global || (place == 0 && routine.name == file.module);
                let clash = self
                    .routines
                    .iter()
                    .any(|known| known.name == routine.name && (known.file == index || (known.global && global)));
                if clash {
                    self.problem(&routine.name, "a routine of this name is defined already");
                }
                let returns = routine.returns.as_deref().map(|name| self.type_named(name));
                let arguments = routine.parameters.iter().map(|parameter| {
                    let declared = declared(routine, &parameter.name);
                    (parameter, declared)
                });
                let mut found = Vec::new();
                for (parameter, declared) in arguments.collect::<Vec<_>>() {
                    let (kind, dimensions) = match declared {
                        Some((type_name, item)) => {
                            let open = item.dimensions.iter().map(|size| self.dimension(size.as_ref()));
                            let dimensions = open.collect::<Vec<_>>();
                            (self.type_named(&type_name), dimensions)
                        }
                        None => {
                            self.problem(&parameter.name, "the parameter's type is not declared");
                            (Type::Unknown, Vec::new())
                        }
                    };
                    found.push(Argument {
                        name: parameter.name.clone(),
                        by_value: parameter.by_value,
                        kind,
                        dimensions,
                    });
                }
                let name = routine.name.clone();
                self.routines.push(Signature { name, file: index, global, arguments: found, returns });
            }
        }
    }

    fn type_named(&mut self, name: &str) -> Type {
        self.types.find(name).unwrap_or_else(|| {
            self.warn(
                name,
                "this type is declared in none of the files named; name the file that declares it, too",
            );
            Type::Unknown
        })
    }

    fn compile_routines(&mut self) {
        let files = self.files;
        let mut place = 0;
        for (index, file) in files.iter().enumerate() {
            for routine in &file.routines {
                self.file = index;
                self.compile_routine(routine, place);
                place += 1;
            }
        }
    }

    fn compile_routine(&mut self, routine: &Routine, place: usize) {
        let signature = self.routines[place].clone();
        self.line = routine.line;
        (self.locals, self.frame_cells) = (BTreeMap::new(), 0);
        (self.ranges, self.returns) = (BTreeMap::new(), signature.returns);
        let mut locals = Vec::new();
        for argument in &signature.arguments {
            self.check_name(&argument.name);
            let cells = self.types.cells(argument.kind, &argument.dimensions);
            let offset = self.reserve(if argument.by_value { cells } else { 1 });
            let home = if argument.by_value { Home::Local(offset) } else { Home::Referred(offset) };
            let (kind, dimensions) = (argument.kind, argument.dimensions.clone());
            let variable = Variable { kind, dimensions, home, constant: false, value: None, writable: true };
            self.locals.insert(argument.name.clone(), variable);
            locals.push(LocalVariable { name: argument.name.clone(), offset, by_reference: !argument.by_value });
        }
        let parameter_cells = cells_u32(self.frame_cells);
        let start = self.here();
        self.declare_locals(routine, &signature, &mut locals);
        self.block(&routine.body);
        self.line = routine.end_line;
        match signature.returns {
            Some(_) => {
                self.emit(Op::NoReturn);
            }
            None => {
                self.emit(Op::Return(0));
            }
        }
        flow::check(self, routine, &signature);
        self.program.routines.push(Entry {
            name: routine.name.clone(),
            start,
            parameter_cells,
            frame_cells: cells_u32(self.frame_cells),
            file: self.file,
            locals,
        });
    }

    fn declare_locals(&mut self, routine: &Routine, signature: &Signature, locals: &mut Vec<LocalVariable>) {
        for declaration in &routine.declarations {
            self.line = declaration.line;
            let Declared::Variables { type_name, items, constant } = &declaration.kind else { continue };
            if declaration.global || *constant {
                self.problem(&items[0].name, "GLOBAL and CONST belong into a data list, not into a routine");
            }
            for item in items {
                if signature.arguments.iter().any(|argument| argument.name == item.name) {
                    continue;
                }
                self.check_name(&item.name);
                let kind = self.type_named(type_name);
                let dimensions: Vec<usize> =
                    item.dimensions.iter().map(|size| self.dimension(size.as_ref())).collect();
                let offset = self.reserve(self.types.cells(kind, &dimensions));
                let variable = Variable {
                    kind,
                    dimensions,
                    home: Home::Local(offset),
                    constant: false,
                    value: None,
                    writable: true,
                };
                if self.locals.insert(item.name.clone(), variable).is_some() {
                    self.problem(&item.name, "this name is declared twice in the routine");
                }
                if item.value.is_some() {
                    self.problem(&item.name, "a local variable takes its first value by an assignment, not here");
                }
                locals.push(LocalVariable { name: item.name.clone(), offset, by_reference: false });
            }
        }
    }
}

/// How a parameter is declared in its routine.
fn declared(routine: &Routine, name: &str) -> Option<(String, super::syntax::Item)> {
    routine.declarations.iter().find_map(|declaration| match &declaration.kind {
        Declared::Variables { type_name, items, .. } => {
            items.iter().find(|item| item.name == name).map(|item| (type_name.clone(), item.clone()))
        }
        _ => None,
    })
}
