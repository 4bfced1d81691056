//! The programs that a mock controller executes.

use super::super::channel_file::MockError;
use panelprep_base::config::Problem;
use panelprep_cell::controller::is_named;
use panelprep_kuka::krl::{Kss, Program, UndocumentedBehaviour, analyse, parse};
use std::sync::Arc;

/// The programs that a mock controller executes, and the options of their execution.
#[derive(Debug, Clone, PartialEq)]
pub struct Programs {
    pub(super) program: Arc<Program>,
    /// The behaviour that public documents do not define.
    pub meaning: UndocumentedBehaviour,
    /// Seed of the scheduler.
    pub seed: u64,
    /// The scheduler chooses turns of any length; otherwise each interpreter runs until it waits.
    pub is_adverse_scheduling: bool,
    /// A start of the controller uses the values of the data lists; otherwise it uses the values at the last end.
    pub cold_start: bool,
    /// The value of `$ROB_TIMER` at the start, ms.
    pub uptime_ms: u64,
    /// The submit interpreter begins its next cycle at once if one ends without waiting; otherwise with the next
    /// tick.
    pub busy_submit: bool,
    /// Inputs and outputs are those of `cell_config.dat`; otherwise those of the mock controller's setup replace
    /// them.
    pub uses_config_io: bool,
    /// Remarks for a person about these programs: file, line, and what is not executed or not known.
    pub remarks: Vec<String>,
}

/// The shipped programs and data lists.
const SHIPPED_FILES: [(&str, &str); 8] = [
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
    /// Reads programs and data lists, each given as a name and a text. Statements that are not executed, or are
    /// doubtful, are listed in the remarks.
    ///
    /// # Errors
    /// If a file is not correct, with file and line.
    pub fn load(files: &[(&str, &str)]) -> Result<Self, MockError> {
        let read: Vec<_> = files.iter().map(|(name, text)| parse(name, text)).collect();
        // Each version of KSS lacks some functions; `panelprep check` reports what a version lacks, so the newest
        // version is used here.
        let analysis = analyse(&read, Some(Kss { major: 8, minor: 7 }));
        let place =
            |name: &str, Problem { line, key, message }: &Problem| format!("{name}:{line}: {key}: {message}");
        for ((name, _), problems) in files.iter().zip(&analysis.problems) {
            if let Some(problem) = problems.first() {
                return Err(MockError::Program(place(name, problem)));
            }
        }
        if analysis.program.is_too_large {
            return Err(MockError::Program("the programs are too large for the mock controller".to_owned()));
        }
        for name in ["CELL_INIT", "CELL_CYCLE", "CELL_MOTION"] {
            if analysis.program.routine(name).is_none() {
                return Err(MockError::Program(format!("the programs do not define the routine {name}")));
            }
        }
        let remarks = files.iter().zip(analysis.warnings.iter().zip(&analysis.unexecuted));
        let remarks = remarks.flat_map(|((name, _), (warnings, unexecuted))| {
            warnings.iter().chain(unexecuted).map(|problem| place(name, problem))
        });
        Ok(Programs {
            remarks: remarks.collect(),
            program: Arc::new(analysis.program),
            meaning: UndocumentedBehaviour::default(),
            seed: 0,
            is_adverse_scheduling: false,
            cold_start: false,
            uptime_ms: 0,
            busy_submit: false,
            uses_config_io: false,
        })
    }

    /// Returns the shipped programs together with the user's own files. A file replaces the shipped one of the same
    /// name.
    ///
    /// # Errors
    /// If a file is not correct, with file and line.
    pub fn with_user_files(own: &[(&str, &str)]) -> Result<Self, MockError> {
        let is_own = |name: &str| own.iter().any(|(of, _)| is_named(of, name));
        let shipped = SHIPPED_FILES.iter().copied().filter(|(name, _)| !is_own(name));
        let files: Vec<_> = own.iter().copied().chain(shipped).collect();
        let keeps_config = is_own("cell_config.dat");
        Ok(Programs { uses_config_io: keeps_config, ..Programs::load(&files)? })
    }

    /// Returns the shipped programs, as a mock controller executes them.
    ///
    /// # Errors
    /// Never for the files with which this program was built; they are read like all others.
    pub fn shipped() -> Result<Self, MockError> {
        Programs::load(&SHIPPED_FILES)
    }

    /// Returns the program, for tests that refer to its statements.
    pub fn program(&self) -> &Program {
        &self.program
    }
}
