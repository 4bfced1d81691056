//! The coverage of the programs by the walks: executed statements and branches.

use panelprep::devices::mock::{Controller, Programs};
use panelprep::krl::{Op, Program};
use std::collections::BTreeMap;

/// Number of executions of each statement and branch over many walks.
#[derive(Clone, Default)]
pub struct Coverage {
    hits: Vec<u64>,
    branches: Vec<[bool; 2]>,
}

/// Lines that no walk reaches: file, a part of the line, and the reason.
const UNREACHABLE: [(&str, &str, &str); 2] = [
    ("cell_motion.src", "CELL_E_OPERATION", " (CELL_WHY_NOT refuses it before)"),
    // Only reached in the CASE of an output on the path, if the motion ends between two statements of this command.
    ("cell_motion.src", "$OUT[CMD.N1]=(CMD.N2==1)", " (no walk has met this moment yet)"),
];

impl Coverage {
    /// Returns the number of executions on this controller.
    pub fn from_controller(controller: &Controller) -> Self {
        let hits = controller.statement_hits().iter().map(|&hits| u64::from(hits)).collect();
        Coverage { hits, branches: controller.branches().to_vec() }
    }

    /// Returns the sum of both coverages.
    pub fn with(mut self, other: &Coverage) -> Self {
        self.hits.resize(self.hits.len().max(other.hits.len()), 0);
        self.branches.resize(self.branches.len().max(other.branches.len()), [false; 2]);
        self.hits.iter_mut().zip(&other.hits).for_each(|(all, hits)| *all += hits);
        for (all, branch) in self.branches.iter_mut().zip(&other.branches) {
            *all = [all[0] || branch[0], all[1] || branch[1]];
        }
        self
    }

    /// Prints the coverage of each file and every statement or branch that was not executed; returns the lines that no
    /// walk has executed.
    pub fn print(&self, programs: &Programs, texts: &[(String, String)]) -> Vec<String> {
        let program = programs.program();
        let line_of = |file: usize, line: usize| {
            let text = texts.iter().find(|(name, _)| *name == program.files[file]).map_or("", |(_, text)| text);
            text.lines().nth(line - 1).unwrap_or_default().trim().to_owned()
        };
        let mut missing = Vec::new();
        for (file, name) in program.files.iter().enumerate() {
            let lines = lines(program, &self.hits, file);
            let branches = branches(program, &self.branches, file);
            let done = lines.values().filter(|hits| **hits > 0).count();
            let taken: usize = branches.iter().map(|(_, [no, yes])| usize::from(*no) + usize::from(*yes)).sum();
            if !lines.is_empty() {
                println!("{name}: {done} of {} lines, {taken} of {} branches", lines.len(), 2 * branches.len());
            }
            for (line, _) in lines.iter().filter(|(_, hits)| **hits == 0) {
                let text = line_of(file, *line);
                let known = UNREACHABLE.iter().find(|(of, piece, _)| of == name && text.contains(piece));
                println!("  {name}:{line} never: {text}{}", known.map_or("", |(_, _, why)| why));
                if known.is_none() {
                    missing.push(format!("{name}:{line}: {text}"));
                }
            }
            for (line, [no, yes]) in branches.iter().filter(|(_, taken)| *taken != [true; 2]) {
                if lines.get(line).is_some_and(|hits| *hits > 0) {
                    let which = if !yes && !no {
                        "neither way"
                    } else if *yes {
                        "always TRUE"
                    } else {
                        "always FALSE"
                    };
                    println!("  {name}:{line} {which}: {}", line_of(file, *line));
                }
            }
        }
        missing
    }
}

/// Returns each line that can be executed, and the number of its executions.
fn lines(program: &Program, hits: &[u64], file: usize) -> BTreeMap<usize, u64> {
    let mut lines = BTreeMap::new();
    for (at, hits) in program.statements.iter().zip(hits).filter(|(at, _)| at.file == file) {
        let most: &mut u64 = lines.entry(at.line).or_default();
        *most = (*most).max(*hits);
    }
    lines
}

/// Returns each condition of the file: its line, and whether it was FALSE at least once and TRUE at least once.
fn branches(program: &Program, taken: &[[bool; 2]], file: usize) -> Vec<(usize, [bool; 2])> {
    let mut found = Vec::new();
    let mut at = None;
    for (op, taken) in program.code.iter().zip(taken) {
        match op {
            Op::Statement(index) => at = program.statements.get(*index as usize),
            Op::JumpIfNot(_) => found.extend(at.filter(|at| at.file == file).map(|at| (at.line, *taken))),
            _ => {}
        }
    }
    found
}
