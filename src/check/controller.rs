//! Checks the controller's files against a cell's file: contradictions between them, and the checksum by which the
//! programs identify themselves.

use super::report::FileReport;
use crate::cell::{Cell, RobotKind};
use crate::config::{Problem, line_of_key};
use crate::controller::{
    COMMANDS, CONFIG, ControllerFiles, DATA, MOTION, STATES, SumError, base_name, differences, program_sum,
};

/// Compares the controller's files with the cell, if one cell with a controller is among the files.
pub(super) fn hold_against_the_cell(
    files: &[(&str, &str)],
    (cell_place, cell): (usize, &Cell),
    reports: &mut [FileReport],
) {
    if cell.robot().kind() != RobotKind::Eki {
        return;
    }
    let place = |name: &str| files.iter().position(|(file, _)| base_name(file).eq_ignore_ascii_case(name));
    let text = |name: &str| place(name).map(|place| files[place].1);
    let named = ControllerFiles {
        config: text(CONFIG),
        motion: text(MOTION),
        commands: text(COMMANDS),
        states: text(STATES),
    };
    for difference in differences(&named, cell) {
        let Some(place) = place(difference.file) else { continue };
        let problems = &mut reports[place].problems;
        if !problems.contains(&difference.problem) {
            problems.push(difference.problem);
        }
    }
    let not_named: Vec<&str> =
        [CONFIG, MOTION, COMMANDS, STATES].into_iter().filter(|name| place(name).is_none()).collect();
    let cell_text = files[cell_place].1;
    if !not_named.is_empty() {
        let message = format!(
            "not compared with {}: it is not verified that a stop is received and switches tool and water off, or that \
             signals and ports are the same on both sides. Check this file together with the controller's files",
            not_named.join(", ")
        );
        reports[cell_place].says.push(message);
    }
    let key = "robot.programs_sum";
    match (program_sum(files), cell.robot().programs_sum()) {
        (Ok(sum), Some(kept)) if sum != kept => reports[cell_place].problems.push(Problem {
            line: line_of_key(cell_text, key),
            key: key.to_owned(),
            message: format!(
                "is {kept}, but the checksum of the controller's files is {sum}; the cell was accepted with other files"
            ),
        }),
        (Ok(sum), _) => {
            if let Some(place) = place(CONFIG) {
                let message = format!(
                    "the checksum of the programs with this file is {sum}; state it as programs_sum in [robot] of the \
                     cell's file"
                );
                reports[place].says.push(message);
            }
        }
        (Err(error @ SumError::Edited { line, .. }), _) => {
            if let Some(place) = place(DATA) {
                let problem = Problem { line, key: "CELL_PROGRAM_SUM".to_owned(), message: error.to_string() };
                reports[place].problems.push(problem);
            }
        }
        (Err(error), Some(kept)) => {
            reports[cell_place].says.push(format!("programs_sum {kept} was not compared: {error}"));
        }
        (Err(_), None) => {}
    }
}
