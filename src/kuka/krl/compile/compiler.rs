//! The data that are collected while files are compiled, and the functions that add steps and problems.

use crate::krl::code::{Cell, Location, Op};
use crate::krl::kuka_types::{is_name_only_type, kuka_types};
use crate::krl::lex::RESERVED;
use crate::krl::limits::{MEMORY_VALUES, REPORTS, STEPS};
use crate::krl::program::Program;
use crate::krl::syntax::File;
use crate::krl::system::Kss;
use crate::krl::types::{Scope, Type, Types};
use panelprep_base::config::Problem;
use std::collections::{BTreeMap, BTreeSet};

/// The maximum length of a name; longer names do not compile on a controller.
const MAX_NAME_LENGTH: usize = 24;

/// The location of a variable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum VariableHome {
    Global(u32),
    Local(u32),
    Referred(u32),
    System(u16),
    /// One input or output, numbered from 1: a SIGNAL.
    Bit {
        variable: u16,
        number: i32,
    },
    /// Not in memory, because only the variable's type is known: a statement that names the variable is not executed.
    Nowhere,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Variable {
    pub(super) kind: Type,
    /// The sizes of an array; 0 if the caller determines the size, or if it is not known.
    pub(super) dimensions: Vec<usize>,
    pub(super) home: VariableHome,
    pub(super) constant: bool,
    /// Value of a constant.
    pub(super) value: Option<Cell>,
    pub(super) writable: bool,
}

/// A variable of a data list, and the location of its declaration.
#[derive(Debug, Clone)]
pub(super) struct SharedVariable {
    pub(super) variable: Variable,
    pub(super) file: usize,
    pub(super) line: usize,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Argument {
    pub(super) name: String,
    pub(super) by_value: bool,
    pub(super) kind: Type,
    pub(super) dimensions: Vec<usize>,
}

/// The data of a routine that a caller needs.
#[derive(Debug, Clone)]
pub(super) struct Signature {
    pub(super) file: usize,
    pub(super) line: usize,
    pub(super) global: bool,
    pub(super) arguments: Vec<Argument>,
    pub(super) returns: Option<Type>,
}

pub(super) struct Compiler<'a> {
    pub(super) files: &'a [File],
    pub(super) kss: Option<Kss>,
    pub(super) types: Types,
    /// The module of each file: a data list and the program of the same name share one.
    pub(super) modules: Vec<usize>,
    /// Variables that are visible in every file.
    pub(super) globals: BTreeMap<String, SharedVariable>,
    /// Variables of a data list that are visible only in the program of the same name.
    pub(super) of_module: BTreeMap<(usize, String), SharedVariable>,
    /// Values of constants, of a module or of all files.
    pub(super) constants: BTreeMap<(Option<usize>, String), Cell>,
    pub(super) routines: Vec<Signature>,
    /// The indices of all routines with the same name.
    pub(super) routine_places: BTreeMap<String, Vec<usize>>,
    pub(super) program: Program,
    pub(super) problems: Vec<Vec<Problem>>,
    pub(super) warnings: Vec<Vec<Problem>>,
    /// Statements that are understood but not executed.
    pub(super) unexecuted: Vec<Vec<Problem>>,
    /// Names that were reported as unknown, for each file.
    pub(super) reported: BTreeSet<(usize, String)>,
    pub(super) text_places: BTreeMap<String, u32>,
    /// The file that is being compiled.
    pub(super) file: usize,
    pub(super) line: usize,
    pub(super) routine: Option<usize>,
    /// The statement that is being compiled, by its number in the program.
    pub(super) statement: u32,
    pub(super) locals: BTreeMap<String, Variable>,
    pub(super) frame_cells: usize,
    pub(super) returns: Option<Type>,
    /// Counters of FOR with known initial and final value.
    pub(super) ranges: BTreeMap<String, (i32, i32)>,
    /// Jumps of EXIT that wait for the end of their loop.
    pub(super) exits: Vec<Vec<usize>>,
}

impl<'a> Compiler<'a> {
    /// Creates a compiler that knows the files, with nothing declared yet.
    pub(super) fn new(files: &'a [File], kss: Option<Kss>) -> Self {
        Compiler {
            files,
            kss,
            types: kuka_types().clone(),
            modules: modules(files),
            globals: BTreeMap::new(),
            of_module: BTreeMap::new(),
            constants: BTreeMap::new(),
            routines: Vec::new(),
            routine_places: BTreeMap::new(),
            program: Program::default(),
            problems: files.iter().map(|file| file.problems.clone()).collect(),
            warnings: files.iter().map(|file| file.warnings.clone()).collect(),
            unexecuted: vec![Vec::new(); files.len()],
            reported: BTreeSet::new(),
            text_places: BTreeMap::new(),
            file: 0,
            line: 1,
            routine: None,
            statement: 0,
            locals: BTreeMap::new(),
            frame_cells: 0,
            returns: None,
            ranges: BTreeMap::new(),
            exits: Vec::new(),
        }
    }
}

/// Assigns files to modules: files with the same name are one module. If several data lists have this name, the
/// files of one folder are one module.
fn modules(files: &[File]) -> Vec<usize> {
    let folder = |file: &File| file.name.rfind(['/', '\\']).map_or(String::new(), |at| file.name[..at].to_owned());
    let mut lists: BTreeMap<&str, usize> = BTreeMap::new();
    for file in files.iter().filter(|file| file.data.is_some()) {
        *lists.entry(&file.module).or_default() += 1;
    }
    let mut known: BTreeMap<(String, String), usize> = BTreeMap::new();
    let mut number = |file: &File| {
        let is_one = lists.get(file.module.as_str()).is_none_or(|count| *count < 2);
        let key = (file.module.clone(), if is_one { String::new() } else { folder(file) });
        let next = known.len();
        *known.entry(key).or_insert(next)
    };
    files.iter().map(&mut number).collect()
}

impl Compiler<'_> {
    pub(super) fn problem(&mut self, key: &str, message: impl Into<String>) {
        let problem = Problem { line: self.line, key: key.to_owned(), message: message.into() };
        push(&mut self.problems[self.file], problem);
    }

    pub(super) fn warn(&mut self, key: &str, message: impl Into<String>) {
        let problem = Problem { line: self.line, key: key.to_owned(), message: message.into() };
        push(&mut self.warnings[self.file], problem);
    }

    /// Warns about a name once for each file.
    pub(super) fn warn_once(&mut self, name: &str, message: impl Into<String>) {
        if self.reported.insert((self.file, name.to_owned())) {
            self.warn(name, message);
        }
    }

    /// Records that the statement being compiled is understood but not executed.
    pub(super) fn record_unexecuted(&mut self, what: &str) {
        let problem = Problem { line: self.line, key: what.to_owned(), message: "is not executed".to_owned() };
        push(&mut self.unexecuted[self.file], problem);
        self.program.unexecuted.entry(self.statement).or_insert_with(|| what.to_owned());
    }

    pub(super) fn check_name(&mut self, name: &str) {
        if name.len() > MAX_NAME_LENGTH {
            let length = name.len();
            self.problem(name, format!("the name has {length} characters (limit {MAX_NAME_LENGTH})"));
        }
        if RESERVED.binary_search(&name).is_ok() {
            self.problem(name, "the name is a reserved word of KRL; choose another name");
        }
    }

    /// The scopes in which a type is looked for, the innermost one first.
    pub(super) fn type_scopes(&self) -> Vec<Scope> {
        let routine = self.routine.map(|place| Scope::Routine { file: self.file, place });
        routine.into_iter().chain([Scope::Module(self.modules[self.file])]).collect()
    }

    /// Returns the type of this name, and warns if the name is unknown.
    pub(super) fn resolve_type(&mut self, name: &str) -> Type {
        if let Some(kind) = self.types.find(name, &self.type_scopes()) {
            return kind;
        }
        if is_name_only_type(name) {
            return Type::Unknown;
        }
        self.warn_once(
            name,
            if self.types.is_hidden(name) {
                "this type is visible only in another module; declare the type GLOBAL to make it visible to all modules"
            } else {
                "this type is declared in none of the given files; add the file with its declaration"
            },
        );
        Type::Unknown
    }

    pub(super) fn emit(&mut self, op: Op) -> usize {
        if self.program.code.len() < STEPS {
            self.program.code.push(op);
        } else {
            self.program.is_too_large = true;
        }
        self.program.code.len() - 1
    }

    pub(super) fn next_step(&self) -> u32 {
        cells_u32(self.program.code.len())
    }

    /// Begins a statement.
    pub(super) fn begin_statement(&mut self, line: usize) {
        self.line = line;
        self.statement = cells_u32(self.program.statements.len());
        self.program.statements.push(Location { file: self.file, line });
        self.emit(Op::Statement(self.statement));
    }

    /// Sets the target of a jump to the next step.
    pub(super) fn set_jump_target(&mut self, jump: usize) {
        let here = self.next_step();
        match &mut self.program.code[jump] {
            Op::Jump(to) | Op::JumpIfNot(to) | Op::JumpDecided { to, .. } => *to = here,
            Op::InterruptDeclaration { after, .. } | Op::Trigger { after } => *after = here,
            _ => {}
        }
    }

    /// Reserves cells of the frame for a variable or a counter. Variables that do not fit into memory are not
    /// allocated.
    pub(super) fn reserve(&mut self, cells: usize) -> u32 {
        let offset = self.frame_cells;
        if cells <= MEMORY_VALUES.saturating_sub(offset) {
            self.frame_cells += cells;
        } else {
            self.record_unexecuted("a variable of this size");
        }
        cells_u32(offset)
    }
}

fn push(list: &mut Vec<Problem>, problem: Problem) {
    if list.len() < REPORTS {
        list.push(problem);
    }
}

/// Converts a number to 32 bits. A cell's programs are so small that a larger index cannot occur.
pub(super) fn cells_u32(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}
