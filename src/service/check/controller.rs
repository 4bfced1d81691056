//! Checks the files of a controller.
//!
//! - Programs and data lists (`.src`, `.sub`, `.dat`) are checked as one program.
//! - All files are compared with a cell's file: contradictions between them, and the checksum by which the programs
//!   identify themselves.

use super::report::{FileReport, RECIPE, reports_of_kind};
use crate::requirements::recipe_fits::parse_plausible_recipe;
use panelprep_base::config::{Problem, key_line};
use panelprep_cell::cell::Cell;
use panelprep_cell::controller::{
    COMMANDS, CONFIG, ControllerFiles, DATA, Difference, MOTION, STATES, SUBMIT, SumError, USER, among_programs,
    compare, highest_acceleration_m_s2, is_named, program_sum,
};
use panelprep_kuka::krl::{File, Kss, analyse, parse};
use std::collections::BTreeMap;

/// Compares the controller's programs with each other, if no cell with a controller is among the files.
pub(super) fn compare_programs(files: &[(&str, &str)], reports: &mut [FileReport]) {
    report_differences(among_programs(&ControllerFiles::among(files)), files, reports);
    compare_accelerations(files, reports);
}

/// Adds each difference to the report of the file that contains it.
fn report_differences(differences: Vec<Difference>, files: &[(&str, &str)], reports: &mut [FileReport]) {
    for difference in differences {
        let Some(place) = file_index(difference.file, files) else { continue };
        let problems = &mut reports[place].problems;
        if !problems.contains(&difference.problem) {
            problems.push(difference.problem);
        }
    }
}

/// Reports recipes whose acceleration is above the maximum that the controller accepts.
fn compare_accelerations(files: &[(&str, &str)], reports: &mut [FileReport]) {
    let Some(config) = file_index(CONFIG, files) else { return };
    let Some(most_m_s2) = highest_acceleration_m_s2(files[config].1) else { return };
    for place in reports_of_kind(RECIPE, reports) {
        let (name, text) = files[place];
        let Ok(recipe) = parse_plausible_recipe(name, text) else { continue };
        let found_m_s2 = recipe.path().acceleration_mm_s2() / 1_000.0;
        if found_m_s2 > most_m_s2 {
            let key = "path.acceleration_mm_s2".to_owned();
            let message = format!(
                "is {found_m_s2} m/s², and CELL_ACC_MAX of {CONFIG} is {most_m_s2} m/s²: the controller would refuse the path; \
                 lower the acceleration, or raise CELL_ACC_MAX"
            );
            reports[place].problems.push(Problem { line: key_line(text, &key), key, message });
        }
    }
}

fn file_index(name: &str, files: &[(&str, &str)]) -> Option<usize> {
    files.iter().position(|(file, _)| is_named(file, name))
}

/// Compares the controller's files with a cell that has a controller.
pub(super) fn compare_with_cell(
    files: &[(&str, &str)],
    (cell_place, cell): (usize, &Cell),
    reports: &mut [FileReport],
) {
    let file_index = |name: &str| file_index(name, files);
    let comparison = compare(&ControllerFiles::among(files), cell);
    report_differences(comparison.differences, files, reports);
    compare_accelerations(files, reports);
    reports[cell_place]
        .descriptions
        .extend(comparison.not_compared.into_iter().map(|why| format!("not compared: {why}")));
    let not_named: Vec<&str> =
        [CONFIG, MOTION, COMMANDS, STATES].into_iter().filter(|name| file_index(name).is_none()).collect();
    let cell_text = files[cell_place].1;
    if !not_named.is_empty() {
        let message = format!(
            "not compared with {}: it is not verified that a stop is received and switches tool and water off, or that \
             signals and ports are the same on both sides. Check this file together with the controller's files",
            not_named.join(", ")
        );
        reports[cell_place].descriptions.push(message);
    }
    let not_called: Vec<&str> = [USER, SUBMIT].into_iter().filter(|name| file_index(name).is_none()).collect();
    if let (Some(config), false) = (file_index(CONFIG), not_called.is_empty()) {
        let message = format!(
            "not compared with {}: it is not known whether the cell's own subroutines are those of this list, nor \
             whether the submit interpreter calls CELL_INIT( ) and CELL_CYCLE( )",
            not_called.join(", ")
        );
        reports[config].descriptions.push(message);
    }
    let key = "robot.programs_sum";
    match (program_sum(files), cell.robot().programs_sum()) {
        (Ok(sum), Some(kept)) if sum != kept => reports[cell_place].problems.push(Problem {
            line: key_line(cell_text, key),
            key: key.to_owned(),
            message: format!(
                "is {kept}, but the checksum of the controller's files is {sum}; the cell was accepted with other files: \
                 check what was changed, then accept the files with `panelprep doctor --kuka DIR --accept`"
            ),
        }),
        (Ok(sum), kept) => {
            let advice = match kept {
                Some(_) => "as [robot] programs_sum of the cell's file states",
                None => {
                    "and [robot] programs_sum of the cell's file is missing: `panelprep doctor --kuka DIR --accept` compares it with \
                     the controller and prints the line"
                }
            };
            if let Some(place) = file_index(CONFIG) {
                let message = format!("the checksum of the programs with this file is {sum}, {advice}");
                reports[place].descriptions.push(message);
            }
        }
        (Err(error @ SumError::Edited { line, .. }), _) => {
            if let Some(place) = file_index(DATA) {
                let problem = Problem { line, key: "CELL_PROGRAM_SUM".to_owned(), message: error.to_string() };
                reports[place].problems.push(problem);
            }
        }
        // The report of the file that contains this value already states this problem.
        (Err(SumError::UserEdited { .. }), _) => {}
        (Err(error), Some(kept)) => {
            reports[cell_place].descriptions.push(format!("programs_sum {kept} was not compared: {error}"));
        }
        (Err(_), None) => {}
    }
}

/// Maximum number of names that one warning lists.
const MAX_LISTED: usize = 12;

/// Returns whether this is the name of a KRL file.
pub fn is_krl(name: &str) -> bool {
    let name = name.to_lowercase();
    [".src", ".sub", ".dat"].iter().any(|ending| name.ends_with(ending))
}

/// Checks KRL files, each given with its index among all files, its name and its text. `kss` is the lowest version of
/// KSS on which the files must run; `None` if it is not known.
pub(super) fn check_krl_files(files: &[(usize, &str, &str)], kss: Option<Kss>) -> Vec<(usize, FileReport)> {
    let read: Vec<File> = files.iter().map(|(_, name, text)| parse(name, text)).collect();
    let analysis = analyse(&read, kss);
    let found = analysis.problems.into_iter().zip(analysis.warnings).zip(analysis.unexecuted).zip(&read);
    let report = |(place, (((problems, warnings), unexecuted), file)): (usize, (((_, Vec<_>), Vec<_>), &File))| {
        let says = [file.sentence()].into_iter().chain(unexecuted_kinds(&unexecuted)).collect();
        (
            place,
            FileReport { kind: Some("KRL"), problems, warnings: merge_duplicates(warnings), descriptions: says },
        )
    };
    files.iter().map(|(place, ..)| *place).zip(found).map(report).collect()
}

/// Merges warnings with the same message about different names into one warning, at the line of the first.
fn merge_duplicates(warnings: Vec<Problem>) -> Vec<Problem> {
    let mut all: BTreeMap<String, Vec<Problem>> = BTreeMap::new();
    for warning in warnings {
        all.entry(warning.message.clone()).or_default().push(warning);
    }
    let mut all: Vec<Problem> = all.into_values().map(merge_problems).collect();
    all.sort_by(|a, b| (a.line, &a.key).cmp(&(b.line, &b.key)));
    all
}

/// Merges one or more problems with the same message into one problem that lists their names in the order of the lines.
fn merge_problems(mut same: Vec<Problem>) -> Problem {
    let first = same.remove(0);
    if same.is_empty() {
        return first;
    }
    let others = same.iter().take(MAX_LISTED - 1).map(|other| format!("{} (line {})", other.key, other.line));
    let mut names: Vec<String> = [first.key].into_iter().chain(others).collect();
    if same.len() >= MAX_LISTED {
        names.push(format!("{} more", same.len() + 1 - MAX_LISTED));
    }
    Problem { line: first.line, key: names.join(", "), message: first.message }
}

/// Describes the kinds of statements that were checked but are not executed in a rehearsal, each kind with its first
/// lines; `None` if every statement is executed. At most [`MAX_LISTED`] kinds are listed.
fn unexecuted_kinds(unexecuted: &[Problem]) -> Option<String> {
    let mut lines: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for place in unexecuted {
        lines.entry(&place.key).or_default().push(place.line);
    }
    let mut each: Vec<(usize, String)> = Vec::new();
    for (what, mut of) in lines {
        of.dedup();
        let more = if of.len() > 3 { format!(" and {} more", of.len() - 3) } else { String::new() };
        let first: Vec<String> = of.iter().take(3).map(usize::to_string).collect();
        each.push((of.len(), format!("{what} (line {}{more})", first.join(", "))));
    }
    // The most frequent kind comes first.
    each.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    let rest = each.len().saturating_sub(MAX_LISTED);
    let mut each: Vec<String> = each.into_iter().take(MAX_LISTED).map(|(_, words)| words).collect();
    if rest > 0 {
        each.push(format!("{rest} more"));
    }
    (!each.is_empty()).then(|| format!("checked, not executed by `mock-robot --programs`: {}", each.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::super::check_files;
    use panelprep_cell::controller::planted::{MISTAKES, texts, texts_with_edit, unreported_mistakes};

    fn reported(texts: &[(&'static str, String)]) -> Vec<String> {
        let named: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (*name, text.as_str())).collect();
        let problems = check_files(&named, None).into_iter().flat_map(|report| report.problems);
        problems.map(|problem| format!("line {}: {}: {}", problem.line, problem.key, problem.message)).collect()
    }

    #[test]
    fn check_names_each_planted_mistake() {
        assert_eq!(reported(&texts()), [""; 0]);
        let missed = unreported_mistakes(reported);
        assert!(missed.is_empty(), "{} of {}:\n{}", missed.len(), MISTAKES.len(), missed.join("\n"));
    }

    /// If no cell's file is given, the programs are compared with each other.
    #[test]
    fn programs_are_compared_with_each_other_without_a_cell() {
        for (from, to) in [("DECL GLOBAL INT CELL_OFF_MS[31]\n", ""), ("CELL_USER_N=1", "CELL_USER_N=2")] {
            let mut all = texts_with_edit("cell_config.dat", from, to);
            all.retain(|(name, _)| *name != "cell");
            assert!(!reported(&all).is_empty(), "{from}");
        }
    }
    /// The recipe's acceleration of 3 m/s² exceeds the controller's limit of 2 m/s²; 1 m/s² does not.
    #[test]
    fn a_recipe_above_the_controllers_acceleration_is_reported() {
        let recipe = include_str!("../../../config/panels/example.toml");
        let has_line = |line: &&str| !line.starts_with("acceleration_mm_s2");
        let recipe = recipe.lines().filter(has_line).collect::<Vec<_>>().join("\n");
        for (found_mm_s2, is_refused) in [(1_000, false), (3_000, true)] {
            let line = format!("[path]\nacceleration_mm_s2 = {found_mm_s2}");
            let mut all = texts_with_edit("cell_config.dat", "CELL_ACC_MAX=10.0", "CELL_ACC_MAX=2.0");
            assert_eq!(recipe.matches("\n[path]").count(), 1);
            all.push(("recipe.toml", recipe.replace("\n[path]", &format!("\n{line}"))));
            let words = "path.acceleration_mm_s2: is 3 m/s², and CELL_ACC_MAX of cell_config.dat is 2 m/s²";
            assert_eq!(
                reported(&all).iter().any(|reported| reported.contains(words)),
                is_refused,
                "{:#?}",
                reported(&all)
            );
        }
    }
}
