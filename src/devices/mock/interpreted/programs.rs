//! The programs that a mock controller executes.

use super::super::error::MockError;
use super::super::options::CHECKSUM;
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
    /// The submit interpreter begins its next cycle at once where one ends without waiting; else with the next tick.
    pub busy_submit: bool,
    /// Told in place of the checksum that the programs make, so that no client takes a mock controller for a real one.
    pub checksum: Option<i32>,
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
    /// Reads programs and data lists, each a name and a text.
    ///
    /// # Errors
    /// Where a file is not right, with file and line.
    pub fn load(files: &[(&str, &str)]) -> Result<Self, MockError> {
        let (read, told): (Vec<_>, Vec<_>) = files.iter().map(|(name, text)| parse(name, text)).unzip();
        // The versions of KSS differ in what they lack; a program that asks for it is told so by `panelprep check`.
        let analysis = analyse(&read, Kss { major: 8, minor: 7 });
        let all = told.into_iter().zip(analysis.problems).zip(analysis.warnings);
        for ((name, _), ((told, problems), warnings)) in files.iter().zip(all) {
            if let Some(problem) = told.iter().chain(&problems).chain(&warnings).next() {
                let message = format!("{name}:{}: {}: {}", problem.line, problem.key, problem.message);
                return Err(MockError::Program(message));
            }
        }
        for name in ["CELL_INIT", "CELL_CYCLE", "CELL_MOTION"] {
            if analysis.program.routine(name).is_none() {
                return Err(MockError::Program(format!("the programs define no {name}")));
            }
        }
        let program = Arc::new(analysis.program);
        Ok(Programs {
            program,
            meaning: Meaning::default(),
            seed: 0,
            adverse: false,
            cold_start: false,
            uptime_ms: 0,
            busy_submit: false,
            checksum: None,
        })
    }

    /// The programs that ship, as a mock controller executes them: told by its own checksum.
    ///
    /// # Errors
    /// Never for the files that this program was built with; they are read as every other.
    pub fn shipped() -> Result<Self, MockError> {
        Ok(Programs { checksum: Some(CHECKSUM), ..Programs::load(&SHIPPED)? })
    }

    /// The program, for what a test says of its statements.
    pub fn program(&self) -> &Program {
        &self.program
    }
}
