//! The programs that a mock controller executes.

use super::super::error::MockError;
use crate::config::Problem;
use crate::controller::base_name;
use crate::krl::{Kss, Meaning, Program, analyse, parse};
use std::sync::Arc;

/// Programs that a mock controller executes, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Programs {
    pub(super) program: Arc<Program>,
    /// What public documents leave open.
    pub meaning: Meaning,
    /// Of the scheduler.
    pub seed: u64,
    /// The scheduler chooses turns of any length; else each interpreter runs until it waits.
    pub adverse: bool,
    /// A start of the controller begins with the values of the data lists; else with those of its end.
    pub cold_start: bool,
    /// What `$ROB_TIMER` counts at the start, ms.
    pub uptime_ms: u64,
    /// The submit interpreter begins its next cycle at once if one ends without waiting; otherwise with the next
    /// tick.
    pub busy_submit: bool,
    /// Inputs and outputs are those of `cell_config.dat`; otherwise those of the mock controller's setup replace
    /// them.
    pub keeps_config: bool,
    /// What a person should know before these programs are executed: file, line and what is not executed or not known.
    pub remarks: Vec<String>,
}

/// Programs and data lists as they ship.
const SHIPPED: [(&str, &str); 8] = [
    ("cell_config.dat", include_str!("../../../../config/kuka/cell_config.dat")),
    ("cell_data.dat", include_str!("../../../../config/kuka/cell_data.dat")),
    ("cell_judge.src", include_str!("../../../../config/kuka/cell_judge.src")),
    ("cell_link.src", include_str!("../../../../config/kuka/cell_link.src")),
    ("cell_motion.src", include_str!("../../../../config/kuka/cell_motion.src")),
    ("cell_submit.src", include_str!("../../../../config/kuka/cell_submit.src")),
    ("cell_tell.src", include_str!("../../../../config/kuka/cell_tell.src")),
    ("cell_user.src", include_str!("../../../../config/kuka/cell_user.src")),
];

impl Programs {
    /// Reads programs and data lists, each a name and a text. Statements that are not executed, or are doubtful,
    /// are remarked.
    ///
    /// # Errors
    /// If a file is not correct, with file and line.
    pub fn load(files: &[(&str, &str)]) -> Result<Self, MockError> {
        let read: Vec<_> = files.iter().map(|(name, text)| parse(name, text)).collect();
        // The versions of KSS differ in what they lack; `panelprep check` reports what a version does not have.
        let analysis = analyse(&read, Some(Kss { major: 8, minor: 7 }));
        let place =
            |name: &str, Problem { line, key, message }: &Problem| format!("{name}:{line}: {key}: {message}");
        for ((name, _), problems) in files.iter().zip(&analysis.problems) {
            if let Some(problem) = problems.first() {
                return Err(MockError::Program(place(name, problem)));
            }
        }
        if analysis.program.is_too_large {
            return Err(MockError::Program("the programs are too large to be executed here".to_owned()));
        }
        for name in ["CELL_INIT", "CELL_CYCLE", "CELL_MOTION"] {
            if analysis.program.routine(name).is_none() {
                return Err(MockError::Program(format!("the programs define no {name}")));
            }
        }
        let remarks = files.iter().zip(analysis.warnings.iter().zip(&analysis.unexecuted));
        let remarks = remarks.flat_map(|((name, _), (warnings, unexecuted))| {
            warnings.iter().chain(unexecuted).map(|problem| place(name, problem))
        });
        Ok(Programs {
            remarks: remarks.collect(),
            program: Arc::new(analysis.program),
            meaning: Meaning::default(),
            seed: 0,
            adverse: false,
            cold_start: false,
            uptime_ms: 0,
            busy_submit: false,
            keeps_config: false,
        })
    }

    /// Returns the shipped programs together with the user's own files. A file replaces the shipped one of the same
    /// name.
    ///
    /// # Errors
    /// If a file is not correct, with file and line.
    pub fn with_own(own: &[(&str, &str)]) -> Result<Self, MockError> {
        let is_own = |name: &str| own.iter().any(|(of, _)| base_name(of).eq_ignore_ascii_case(name));
        let shipped = SHIPPED.iter().copied().filter(|(name, _)| !is_own(name));
        let files: Vec<_> = own.iter().copied().chain(shipped).collect();
        let keeps_config = is_own("cell_config.dat");
        Ok(Programs { keeps_config, ..Programs::load(&files)? })
    }

    /// The programs that ship, as a mock controller executes them.
    ///
    /// # Errors
    /// Never for the files that this program was built with; they are read as every other.
    pub fn shipped() -> Result<Self, MockError> {
        Programs::load(&SHIPPED)
    }

    /// Returns the program, for tests that refer to its statements.
    pub fn program(&self) -> &Program {
        &self.program
    }
}
