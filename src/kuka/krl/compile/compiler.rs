//! The state of the compiler while files are compiled, and functions that add types, steps and problems.
//!
//! The STRUC and ENUM declarations of all files are processed here. A structure may refer to a structure that is
//! declared after it.

use crate::krl::code::{Cell, Location, Op, Program};
use crate::krl::lex::RESERVED_WORDS;
use crate::krl::syntax::{
    Data, Declaration, DeclarationContent, File, Item, MAX_ARRAY_VALUES, MAX_MEMORY_VALUES, MAX_PROGRAM_STEPS,
    MAX_REPORTS,
};
use crate::krl::system::Kss;
use crate::krl::types::{NewComponent, Scope, Type, Types, is_type_known_by_name_only, kuka_types};
use panelprep_base::config::Problem;
use std::collections::{BTreeMap, BTreeSet};

/// Maximum length of a name, characters; a controller refuses longer names.
const MAX_NAME_LENGTH: usize = 24;

/// The location of a variable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum VariableLocation {
    Global(u32),
    Local(u32),
    Referred(u32),
    System(u16),
    /// A single input or output, whose number starts at 1; declared by SIGNAL.
    Bit {
        variable: u16,
        number: i32,
    },
    /// The variable has no memory, because only its type is known. A statement that names the variable is not executed.
    Nowhere,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Variable {
    pub(super) kind: Type,
    /// The size of each dimension of an array; 0 if the caller determines the size, or if the size is not known.
    pub(super) dimensions: Vec<usize>,
    pub(super) location: VariableLocation,
    pub(super) constant: bool,
    /// The value, if the variable is a constant.
    pub(super) value: Option<Cell>,
    pub(super) writable: bool,
}

/// A variable of a data list, with the location of its declaration.
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

/// The signature of a routine: the data that a caller needs.
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
    /// The module of each file. A data list and the program of the same name are one module.
    pub(super) modules: Vec<usize>,
    /// Variables that are visible in every file.
    pub(super) globals: BTreeMap<String, SharedVariable>,
    /// Variables of a data list that are visible only in the program with the same name.
    pub(super) of_module: BTreeMap<(usize, String), SharedVariable>,
    /// The values of constants, for one module or (`None`) for all files.
    pub(super) constants: BTreeMap<(Option<usize>, String), Cell>,
    pub(super) routines: Vec<Signature>,
    /// The indices of all routines that have the same name.
    pub(super) routine_places: BTreeMap<String, Vec<usize>>,
    pub(super) program: Program,
    pub(super) problems: Vec<Vec<Problem>>,
    pub(super) warnings: Vec<Vec<Problem>>,
    /// The statements that are checked but not executed, for each file.
    pub(super) unexecuted: Vec<Vec<Problem>>,
    /// The unknown names that were already reported, for each file.
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
    /// The FOR counters whose initial and final values are known.
    pub(super) ranges: BTreeMap<String, (i32, i32)>,
    /// For each open loop, the jumps of its EXIT statements, whose target is set at the end of the loop.
    pub(super) exits: Vec<Vec<usize>>,
}

impl<'a> Compiler<'a> {
    /// Creates a compiler for these files; nothing is declared yet.
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

/// Assigns each file to a module: files with the same name are one module. If several data lists have this name, the
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

    /// Adds a warning about a name, at most once for each file.
    pub(super) fn warn_once(&mut self, name: &str, message: impl Into<String>) {
        if self.reported.insert((self.file, name.to_owned())) {
            self.warn(name, message);
        }
    }

    /// Records that the current statement is checked but not executed.
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
        if RESERVED_WORDS.binary_search(&name).is_ok() {
            self.problem(name, "the name is a reserved word of KRL; choose another name");
        }
    }

    /// Returns the scopes in which a type is searched, the innermost first.
    fn type_scopes(&self) -> Vec<Scope> {
        let routine = self.routine.map(|place| Scope::Routine { file: self.file, place });
        routine.into_iter().chain([Scope::Module(self.modules[self.file])]).collect()
    }

    /// Returns the type with this name; adds a warning if the name is unknown.
    pub(super) fn resolve_type(&mut self, name: &str) -> Type {
        if let Some(kind) = self.types.find(name, &self.type_scopes()) {
            return kind;
        }
        if is_type_known_by_name_only(name) {
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
        if self.program.code.len() < MAX_PROGRAM_STEPS {
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

    /// Reserves cells in the routine's frame for a variable or a counter. A variable that exceeds the memory limit is
    /// not allocated.
    pub(super) fn reserve(&mut self, cells: usize) -> u32 {
        let offset = self.frame_cells;
        if cells <= MAX_MEMORY_VALUES.saturating_sub(offset) {
            self.frame_cells += cells;
        } else {
            self.record_unexecuted("a variable of this size");
        }
        cells_u32(offset)
    }
}

fn push(list: &mut Vec<Problem>, problem: Problem) {
    if list.len() < MAX_REPORTS {
        list.push(problem);
    }
}

/// Converts an index to 32 bits. The memory limits exclude larger indices.
pub(super) fn cells_u32(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// A structure that is not declared yet.
struct PendingStructure<'a> {
    file: usize,
    routine: Option<usize>,
    line: usize,
    scope: Scope,
    name: &'a str,
    components: &'a [(String, Item)],
}

impl<'a> Compiler<'a> {
    pub(super) fn declare_types(&mut self) {
        let files: &'a [_] = self.files;
        let mut waiting = Vec::new();
        let mut place = 0;
        for (file, read) in files.iter().enumerate() {
            if let Some(data) = &read.data {
                let of_list = (file, None);
                data.declarations
                    .iter()
                    .for_each(|declaration| self.collect(of_list, Some(data), declaration, &mut waiting));
            }
            for routine in &read.routines {
                let of_routine = (file, Some(place));
                routine
                    .declarations
                    .iter()
                    .for_each(|declaration| self.collect(of_routine, None, declaration, &mut waiting));
                place += 1;
            }
        }
        self.declare_strucs(&waiting);
        self.routine = None;
    }

    /// Declares an enumeration, or adds a structure to the waiting list until all enumerations are known.
    fn collect(
        &mut self,
        (file, routine): (usize, Option<usize>),
        data: Option<&Data>,
        declaration: &'a Declaration,
        waiting: &mut Vec<PendingStructure<'a>>,
    ) {
        (self.file, self.routine, self.line) = (file, routine, declaration.line);
        let is_seen = declaration.global || data.is_some_and(is_visible_everywhere);
        let scope = match routine {
            _ if is_seen => Scope::Everywhere,
            Some(place) => Scope::Routine { file, place },
            None => Scope::Module(self.modules[file]),
        };
        match &declaration.kind {
            DeclarationContent::Enumeration { name, words } => {
                self.check_name(name);
                let is_free = self.types.add_enumeration(scope, name, words.clone());
                self.report_if_declared(is_free, name);
            }
            DeclarationContent::Struc { name, components } => {
                waiting.push(PendingStructure { file, routine, line: declaration.line, scope, name, components });
            }
            _ => {}
        }
    }

    fn report_if_declared(&mut self, is_free: bool, name: &str) {
        let in_own_list = self.files[self.file].data.as_ref().is_some_and(is_visible_everywhere);
        if !is_free && !in_own_list {
            self.problem(name, "a type of this name is already declared");
        }
    }

    /// Declares each structure after the structures to which it refers. Structures that remain form a circular
    /// reference.
    fn declare_strucs(&mut self, waiting: &[PendingStructure<'_>]) {
        let mut by_name: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (place, struc) in waiting.iter().enumerate() {
            by_name.entry(struc.name).or_default().push(place);
        }
        // For each structure: the number of its referenced structures that are not declared yet, and the structures
        // that wait for it.
        let mut awaits = vec![0_usize; waiting.len()];
        let mut waiters: Vec<Vec<usize>> = vec![Vec::new(); waiting.len()];
        for (place, struc) in waiting.iter().enumerate() {
            for (type_name, _) in struc.components {
                for &other in by_name
                    .get(type_name.as_str())
                    .into_iter()
                    .flatten()
                    .filter(|other| self.is_visible_to(struc, &waiting[**other]))
                {
                    awaits[place] += 1;
                    waiters[other].push(place);
                }
            }
        }
        let mut ready: Vec<usize> = (0..waiting.len()).rev().filter(|place| awaits[*place] == 0).collect();
        let mut is_declared = vec![false; waiting.len()];
        while let Some(place) = ready.pop() {
            is_declared[place] = true;
            self.declare_struc(&waiting[place]);
            for &waiter in waiters[place].iter().rev() {
                awaits[waiter] -= 1;
                if awaits[waiter] == 0 {
                    ready.push(waiter);
                }
            }
        }
        for (struc, _) in waiting.iter().zip(is_declared).filter(|(_, is_declared)| !is_declared) {
            (self.file, self.routine, self.line) = (struc.file, struc.routine, struc.line);
            let named: Vec<&str> = struc.components.iter().map(|(type_name, _)| type_name.as_str()).collect();
            let mut named: Vec<&str> = named.into_iter().filter(|name| by_name.contains_key(name)).collect();
            named.dedup();
            let message =
                format!("structures must not contain each other: {} contains {}", struc.name, named.join(", "));
            self.problem(struc.name, message);
            self.types.add_struc(struc.scope, struc.name, Vec::new());
        }
    }

    /// Returns whether the declaration of the first structure can refer to the second one.
    fn is_visible_to(&self, from: &PendingStructure<'_>, other: &PendingStructure<'_>) -> bool {
        other.scope == Scope::Everywhere
            || other.scope == Scope::Module(self.modules[from.file])
            || (other.file == from.file && other.routine == from.routine)
    }

    fn declare_struc(&mut self, struc: &PendingStructure<'_>) {
        (self.file, self.routine, self.line) = (struc.file, struc.routine, struc.line);
        self.check_name(struc.name);
        let mut placed: Vec<NewComponent> = Vec::new();
        for (type_name, item) in struc.components {
            let kind = self.resolve_type(type_name);
            let dimensions = item.dimensions.iter().map(|size| self.dimension(size.as_ref())).collect();
            placed.push(NewComponent { name: item.name.clone(), kind, dimensions });
        }
        let cells = placed
            .iter()
            .fold(0_usize, |sum, part| sum.saturating_add(self.types.cells(part.kind, &part.dimensions)));
        if cells > MAX_ARRAY_VALUES {
            self.problem(
                struc.name,
                format!("the structure has more than {MAX_ARRAY_VALUES} values, the limit of this program"),
            );
            placed.clear();
        }
        let is_free = self.types.add_struc(struc.scope, struc.name, placed);
        self.report_if_declared(is_free, struc.name);
    }
}

/// Returns whether a data list is visible in every program. The controller's own data lists (`$config.dat` and others)
/// are visible even without PUBLIC and GLOBAL.
pub(super) fn is_visible_everywhere(data: &Data) -> bool {
    data.name.starts_with('$')
}
