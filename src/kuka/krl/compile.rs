//! Compiles KRL files to one program (names, types, memory, steps), and reports all problems in the files.
//!
//! `compiler` declares structures and enumerations, `data` allocates the data lists, `place` resolves variables,
//! `value` compiles expressions, `call` compiles calls with their arguments, `body` compiles statements. `flow` finds
//! variables that may be read before they are assigned, and functions that may end without RETURN; it also checks the
//! buffers that EthernetKRL reads.

mod body;
mod call;
mod compiler;
mod data;
mod flow;
mod place;
mod value;

use super::code::{Condensed, Entry, LocalVariable, Op, Program};
use super::syntax::{DeclarationContent, File, Item, Routine};
use super::system::Kss;
use super::types::Type;
use compiler::{Argument, Compiler, Signature, Variable, VariableLocation, cells_u32};
use panelprep_base::config::Problem;
use std::collections::BTreeMap;

/// The result of compiling a set of files.
#[derive(Debug)]
pub struct Analysis {
    /// The problems that a controller refuses; one list for each file, in the order of its lines.
    pub problems: Vec<Vec<Problem>>,
    /// For each file: the parts that were not checked, because they were not parsed or another file declares them, and
    /// errors that may occur at run time.
    pub warnings: Vec<Vec<Problem>>,
    /// For each file: the parts that were checked but are not executed, each with its line and a description.
    pub unexecuted: Vec<Vec<Problem>>,
    /// The compiled program. It may be executed if there are no problems. A statement that is not supported stops the
    /// execution; the message contains its line.
    pub program: Program,
}

/// Checks a set of files for a controller with this version of KSS, and compiles them to a program. A feature that the
/// given version does not have is a problem. If no version is given, a feature that the lowest supported version does
/// not have is a warning.
pub fn analyse(files: &[File], kss: Option<Kss>) -> Analysis {
    let mut compiler = Compiler::new(files, kss);
    compiler.program.files = files.iter().map(|file| file.name.clone()).collect();
    compiler.find_constants();
    compiler.declare_types();
    compiler.declare_data();
    compiler.declare_routines();
    compiler.compile_routines();
    let Compiler { mut problems, mut warnings, mut unexecuted, mut program, .. } = compiler;
    if !program.is_too_large {
        program.condensed = Condensed::new(&program.code);
    }
    for found in problems.iter_mut().chain(&mut warnings).chain(&mut unexecuted) {
        found.sort_by(|a, b| (a.line, &a.key, &a.message).cmp(&(b.line, &b.key, &b.message)));
        found.dedup();
    }
    Analysis { problems, warnings, unexecuted, program }
}

impl Compiler<'_> {
    fn declare_routines(&mut self) {
        let files = self.files;
        let mut place = 0;
        for (index, file) in files.iter().enumerate() {
            self.file = index;
            for (nth, routine) in file.routines.iter().enumerate() {
                self.routine = Some(place);
                self.line = routine.line;
                self.statement = u32::MAX;
                self.check_name(&routine.name);
                let global = routine.global || nth == 0;
                self.report_name_conflict(routine, global);
                let returns = routine.returns.as_ref().map(|returned| {
                    let kind = self.resolve_type(&returned.type_name);
                    if kind == Type::Char && !returned.dimensions.is_empty() { Type::Text } else { kind }
                });
                let arguments = routine.parameters.iter().map(|parameter| {
                    let declared = parameter_declaration(routine, &parameter.name);
                    self.compile_parameter(&parameter.name, parameter.by_value, declared)
                });
                let arguments = arguments.collect();
                self.routine_places.entry(routine.name.clone()).or_default().push(place);
                self.routines.push(Signature { file: index, line: routine.line, global, arguments, returns });
                place += 1;
            }
        }
    }

    fn compile_parameter(&mut self, name: &str, by_value: bool, declared: Option<(&str, &Item)>) -> Argument {
        let (kind, dimensions) = match declared {
            Some((type_name, item)) => {
                let dimensions = item.dimensions.iter().map(|size| self.dimension(size.as_ref())).collect();
                (self.resolve_type(type_name), dimensions)
            }
            None => {
                self.problem(name, "the parameter's type is not declared");
                (Type::Unknown, Vec::new())
            }
        };
        Argument { name: name.to_owned(), by_value, kind, dimensions }
    }

    fn report_name_conflict(&mut self, routine: &Routine, global: bool) {
        let places = self.routine_places.get(&routine.name).into_iter().flatten();
        let mut known = places.map(|place| &self.routines[*place]);
        let clash = known.find(|known| known.file == self.file || (known.global && global));
        let Some(Signature { file, line, .. }) = clash.filter(|_| !routine.name.is_empty()) else { return };
        let place = if *file == self.file {
            format!("line {line}")
        } else {
            format!("{}, line {line}", self.files[*file].name)
        };
        self.problem(&routine.name, format!("a routine of this name is already defined: {place}"));
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
        self.routine = Some(place);
        self.line = routine.line;
        // The routine starts at the next statement that is emitted.
        self.statement = cells_u32(self.program.statements.len());
        (self.locals, self.frame_cells) = (BTreeMap::new(), 0);
        (self.ranges, self.returns) = (BTreeMap::new(), signature.returns);
        let mut locals = Vec::new();
        for argument in &signature.arguments {
            self.check_name(&argument.name);
            let cells = self.types.cells(argument.kind, &argument.dimensions);
            let offset = self.reserve(if argument.by_value { cells } else { 1 });
            let location = if argument.by_value {
                VariableLocation::Local(offset)
            } else {
                VariableLocation::Referred(offset)
            };
            let (kind, dimensions) = (argument.kind, argument.dimensions.clone());
            let variable = Variable { kind, dimensions, location, constant: false, value: None, writable: true };
            self.locals.insert(argument.name.clone(), variable);
            locals.push(LocalVariable { name: argument.name.clone(), offset, by_reference: !argument.by_value });
        }
        let parameter_cells = cells_u32(self.frame_cells);
        let start = self.next_step();
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
        flow::check_assignments(self, routine, &signature);
        self.check_labels(&routine.body);
        self.check_memories(&routine.body);
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
            let (type_name, items) = match &declaration.kind {
                DeclarationContent::Variables { type_name, items, constant } => {
                    if declaration.global || *constant {
                        let message = "GLOBAL and CONST are valid only in a data list, not in a routine";
                        self.problem(&items[0].name, message);
                    }
                    (type_name, items)
                }
                DeclarationContent::Import { type_name, name } => {
                    let kind = self.resolve_type(type_name);
                    self.locals.insert(name.clone(), data::untyped_location(kind, Vec::new()));
                    continue;
                }
                DeclarationContent::Signal { name, from, to } => {
                    let variable = self.signal(name, [from, to]);
                    self.locals.insert(name.clone(), variable);
                    continue;
                }
                _ => continue,
            };
            for item in items {
                if signature.arguments.iter().all(|argument| argument.name != item.name) {
                    self.declare_local(type_name, item, locals);
                }
            }
        }
    }

    fn declare_local(&mut self, type_name: &str, item: &Item, locals: &mut Vec<LocalVariable>) {
        self.check_name(&item.name);
        let kind = self.resolve_type(type_name);
        let dimensions: Vec<usize> = item.dimensions.iter().map(|size| self.dimension(size.as_ref())).collect();
        let offset = self.reserve(self.types.cells(kind, &dimensions));
        let location = VariableLocation::Local(offset);
        let variable = Variable { kind, dimensions, location, constant: false, value: None, writable: true };
        if self.locals.insert(item.name.clone(), variable).is_some() {
            self.problem(&item.name, "this name is declared twice in the routine");
        }
        if item.value.is_some() {
            self.problem(
                &item.name,
                "the declaration of a local variable must not contain a value; assign the value in a statement",
            );
        }
        locals.push(LocalVariable { name: item.name.clone(), offset, by_reference: false });
    }
}

/// Returns the type and the item with which the routine declares this parameter.
fn parameter_declaration<'a>(routine: &'a Routine, name: &str) -> Option<(&'a str, &'a Item)> {
    routine.declarations.iter().find_map(|declaration| match &declaration.kind {
        DeclarationContent::Variables { type_name, items, .. } => {
            items.iter().find(|item| item.name == name).map(|item| (type_name.as_str(), item))
        }
        _ => None,
    })
}
