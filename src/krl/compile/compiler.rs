//! What is known while files are compiled, and how steps and problems are noted.

use crate::config::Problem;
use crate::krl::code::{Cell, Location, Op};
use crate::krl::program::Program;
use crate::krl::syntax::File;
use crate::krl::system::Kss;
use crate::krl::types::{Type, Types};
use std::collections::BTreeMap;

/// Longer names do not compile on a controller.
const LONGEST_NAME: usize = 24;

/// Where a variable lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Home {
    Global(u32),
    Local(u32),
    Referred(u32),
    System(u16),
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Variable {
    pub(super) kind: Type,
    /// 0 where the size is the caller's.
    pub(super) dimensions: Vec<usize>,
    pub(super) home: Home,
    pub(super) constant: bool,
    /// Of a constant.
    pub(super) value: Option<Cell>,
    pub(super) writable: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Argument {
    pub(super) name: String,
    pub(super) by_value: bool,
    pub(super) kind: Type,
    pub(super) dimensions: Vec<usize>,
}

/// What a caller must know of a routine.
#[derive(Debug, Clone)]
pub(super) struct Signature {
    pub(super) name: String,
    pub(super) file: usize,
    pub(super) global: bool,
    pub(super) arguments: Vec<Argument>,
    pub(super) returns: Option<Type>,
}

pub(super) struct Compiler<'a> {
    pub(super) files: &'a [File],
    pub(super) kss: Kss,
    pub(super) types: Types,
    /// Variables that every file sees.
    pub(super) globals: BTreeMap<String, Variable>,
    /// Variables of a data list that only the program of the same name sees.
    pub(super) of_module: BTreeMap<(String, String), Variable>,
    pub(super) routines: Vec<Signature>,
    pub(super) program: Program,
    pub(super) problems: Vec<Vec<Problem>>,
    pub(super) warnings: Vec<Vec<Problem>>,
    /// Of what is being compiled.
    pub(super) file: usize,
    pub(super) line: usize,
    pub(super) locals: BTreeMap<String, Variable>,
    pub(super) frame_cells: usize,
    pub(super) returns: Option<Type>,
    /// Counters of FOR with known first and last value.
    pub(super) ranges: BTreeMap<String, (i32, i32)>,
    /// Jumps of EXIT that wait for the end of their loop.
    pub(super) exits: Vec<Vec<usize>>,
}

impl<'a> Compiler<'a> {
    /// Nothing is declared yet, but the files are known.
    pub(super) fn new(files: &'a [File], kss: Kss) -> Self {
        Compiler {
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
        }
    }
}

impl Compiler<'_> {
    pub(super) fn problem(&mut self, key: &str, message: impl Into<String>) {
        let problem = Problem { line: self.line, key: key.to_owned(), message: message.into() };
        self.problems[self.file].push(problem);
    }

    pub(super) fn warn(&mut self, key: &str, message: impl Into<String>) {
        let problem = Problem { line: self.line, key: key.to_owned(), message: message.into() };
        self.warnings[self.file].push(problem);
    }

    pub(super) fn check_name(&mut self, name: &str) {
        if name.len() > LONGEST_NAME {
            let length = name.len();
            self.problem(name, format!("the name has {length} characters; KRL allows {LONGEST_NAME}"));
        }
        if RESERVED.contains(&name) {
            self.problem(name, "this is a word of KRL itself; choose another name");
        }
    }

    pub(super) fn emit(&mut self, op: Op) -> usize {
        self.program.code.push(op);
        self.program.code.len() - 1
    }

    pub(super) fn here(&self) -> u32 {
        cells_u32(self.program.code.len())
    }

    /// A statement begins.
    pub(super) fn mark(&mut self, line: usize) {
        self.line = line;
        let index = cells_u32(self.program.statements.len());
        self.program.statements.push(Location { file: self.file, line });
        self.emit(Op::Statement(index));
    }

    /// Lets a jump lead to where the next step will be.
    pub(super) fn lead_here(&mut self, jump: usize) {
        let here = self.here();
        match &mut self.program.code[jump] {
            Op::Jump(to) | Op::JumpIfNot(to) | Op::JumpDecided { to, .. } => *to = here,
            Op::InterruptDeclaration { after, .. } | Op::Trigger { after } => *after = here,
            _ => {}
        }
    }

    /// Cells of the frame for a counter.
    pub(super) fn reserve(&mut self, cells: usize) -> u32 {
        let offset = self.frame_cells;
        self.frame_cells += cells;
        cells_u32(offset)
    }
}

/// Programs of a cell are small; a place beyond 32 bits cannot occur.
pub(super) fn cells_u32(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// Words that no variable and no routine may be called.
pub const RESERVED: [&str; 58] = [
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
