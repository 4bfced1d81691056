//! Files of KRL to one program: names, types, places in memory, steps; all that is wrong with them on the way.
//!
//! `data` lays out the data lists, `place` finds variables, `value` and `operate` do expressions, `call` arguments,
//! `body` statements; `flow` asks what may be read before it was assigned, and what ends without RETURN.

mod body;
mod call;
mod data;
mod flow;
mod operate;
mod place;
mod value;

use super::code::{Cell, Entry, LocalVariable, Location, Op, Program};
use super::condense::Condensed;
use super::syntax::{Declared, File, Routine};
use super::system::Kss;
use super::types::{Type, Types};
use crate::config::Problem;
use std::collections::BTreeMap;

/// Longer names do not compile on a controller.
const LONGEST_NAME: usize = 24;

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
    let mut compiler = Compiler {
        files,
        kss,
        types: Types::default(),
        globals: BTreeMap::new(),
        of_module: BTreeMap::new(),
        routines: Vec::new(),
        program: Program::default(),
        problems: vec![Vec::new(); files.len()],
        warnings: vec![Vec::new(); files.len()],
        file: 0,
        line: 1,
        locals: BTreeMap::new(),
        frame_cells: 0,
        returns: None,
        ranges: BTreeMap::new(),
        exits: Vec::new(),
    };
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

/// Where a variable lies.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Home {
    Global(u32),
    Local(u32),
    Referred(u32),
    System(u16),
}

#[derive(Debug, Clone, PartialEq)]
struct Variable {
    kind: Type,
    /// 0 where the size is the caller's.
    dimensions: Vec<usize>,
    home: Home,
    constant: bool,
    /// Of a constant.
    value: Option<Cell>,
    writable: bool,
}

#[derive(Debug, Clone, PartialEq)]
struct Argument {
    name: String,
    by_value: bool,
    kind: Type,
    dimensions: Vec<usize>,
}

/// What a caller must know of a routine.
#[derive(Debug, Clone)]
struct Signature {
    name: String,
    file: usize,
    global: bool,
    arguments: Vec<Argument>,
    returns: Option<Type>,
}

struct Compiler<'a> {
    files: &'a [File],
    kss: Kss,
    types: Types,
    /// Variables that every file sees.
    globals: BTreeMap<String, Variable>,
    /// Variables of a data list that only the program of the same name sees.
    of_module: BTreeMap<(String, String), Variable>,
    routines: Vec<Signature>,
    program: Program,
    problems: Vec<Vec<Problem>>,
    warnings: Vec<Vec<Problem>>,
    /// Of what is being compiled.
    file: usize,
    line: usize,
    locals: BTreeMap<String, Variable>,
    frame_cells: usize,
    returns: Option<Type>,
    /// Counters of FOR with known first and last value.
    ranges: BTreeMap<String, (i32, i32)>,
    /// Jumps of EXIT that wait for the end of their loop.
    exits: Vec<Vec<usize>>,
}

impl Compiler<'_> {
    fn problem(&mut self, key: &str, message: impl Into<String>) {
        let problem = Problem { line: self.line, key: key.to_owned(), message: message.into() };
        self.problems[self.file].push(problem);
    }

    fn warn(&mut self, key: &str, message: impl Into<String>) {
        let problem = Problem { line: self.line, key: key.to_owned(), message: message.into() };
        self.warnings[self.file].push(problem);
    }

    fn check_name(&mut self, name: &str) {
        if name.len() > LONGEST_NAME {
            let length = name.len();
            self.problem(name, format!("the name has {length} characters; KRL allows {LONGEST_NAME}"));
        }
        if RESERVED.contains(&name) {
            self.problem(name, "this is a word of KRL itself; choose another name");
        }
    }

    fn emit(&mut self, op: Op) -> usize {
        self.program.code.push(op);
        self.program.code.len() - 1
    }

    fn here(&self) -> u32 {
        cells_u32(self.program.code.len())
    }

    /// A statement begins.
    fn mark(&mut self, line: usize) {
        self.line = line;
        let index = cells_u32(self.program.statements.len());
        self.program.statements.push(Location { file: self.file, line });
        self.emit(Op::Statement(index));
    }

    /// Lets a jump lead to where the next step will be.
    fn lead_here(&mut self, jump: usize) {
        let here = self.here();
        match &mut self.program.code[jump] {
            Op::Jump(to) | Op::JumpIfNot(to) | Op::JumpDecided { to, .. } => *to = here,
            Op::InterruptDeclaration { after, .. } | Op::Trigger { after } => *after = here,
            _ => {}
        }
    }

    /// Cells of the frame for a counter.
    fn reserve(&mut self, cells: usize) -> u32 {
        let offset = self.frame_cells;
        self.frame_cells += cells;
        cells_u32(offset)
    }

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

/// Programs of a cell are small; a place beyond 32 bits cannot occur.
fn cells_u32(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// Words that no variable and no routine may be called.
const RESERVED: [&str; 58] = [
    "AND",
    "BRAKE",
    "B_AND",
    "B_EXOR",
    "B_NOT",
    "B_OR",
    "CASE",
    "CHAR",
    "CIRC",
    "CONST",
    "CONTINUE",
    "DECL",
    "DEF",
    "DEFAULT",
    "DEFDAT",
    "DEFFCT",
    "DELAY",
    "DISTANCE",
    "DO",
    "ELSE",
    "END",
    "ENDDAT",
    "ENDFCT",
    "ENDFOR",
    "ENDIF",
    "ENDLOOP",
    "ENDSWITCH",
    "ENDWHILE",
    "ENUM",
    "EXIT",
    "EXOR",
    "EXT",
    "EXTFCT",
    "FALSE",
    "FOR",
    "GLOBAL",
    "GOTO",
    "HALT",
    "IF",
    "INTERRUPT",
    "LIN",
    "LOOP",
    "NOT",
    "OR",
    "PTP",
    "REPEAT",
    "RESUME",
    "RETURN",
    "SIGNAL",
    "STRUC",
    "SWITCH",
    "THEN",
    "TRIGGER",
    "TRUE",
    "UNTIL",
    "WAIT",
    "WHEN",
    "WHILE",
];
