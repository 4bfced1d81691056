//! Tests of the comparison between the controller's files and the cell's file, and of the checksum. The commands
//! `check` and `doctor` are tested with the same deliberate errors.

use super::planted::{FILES, MISTAKES, texts, texts_with_edit, unreported_mistakes};
use super::sum::checksum_value_names;
use super::*;
use crate::cell::Cell;

fn compared(texts: &[(&'static str, String)]) -> Comparison {
    let named: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let (_, cell) = named.iter().find(|(name, _)| *name == "cell").expect("the cell");
    let cell = Cell::check("cell.toml", cell).unwrap_or_else(|problems| panic!("{problems}"));
    compare(&ControllerFiles::among(&named), &cell)
}

fn found(texts: &[(&'static str, String)]) -> Vec<Difference> {
    compared(texts).differences
}

fn words(difference: Difference) -> String {
    let Difference { file, problem } = difference;
    format!("{file}:{}: {}: {}", problem.line, problem.key, problem.message)
}

/// Replaces a text in one of the files.
fn edit(texts: &mut [(&'static str, String)], file: &str, from: &str, to: &str) {
    let text = &mut texts.iter_mut().find(|(name, _)| *name == file).expect("a file").1;
    assert_eq!(text.matches(from).count(), 1, "{file}: {from}");
    *text = text.replace(from, to);
}

#[test]
fn untouched_files_give_no_difference() {
    assert_eq!(compared(&texts()), Comparison { differences: vec![], not_compared: vec![] });
}

#[test]
fn each_planted_mistake_is_named() {
    let missed = unreported_mistakes(|texts| found(texts).into_iter().map(words).collect());
    assert!(missed.is_empty(), "{} of {}:\n{}", missed.len(), MISTAKES.len(), missed.join("\n"));
}

/// The data list of an earlier release has neither the workspace nor the maximum step length. One message reports this,
/// instead of one message for each missing value.
#[test]
fn a_file_of_an_earlier_release_gives_one_message() {
    let is_later = |line: &&str| ["CELL_BOX_M", "CELL_STEP_MM"].iter().any(|name| line.contains(name));
    let mut all = texts();
    let config = &mut all.iter_mut().find(|(name, _)| *name == CONFIG).expect("it").1;
    let lines: Vec<&str> = config.lines().filter(|line| !is_later(line)).collect();
    assert_eq!(config.lines().count() - lines.len(), 9, "three declarations, six values");
    *config = lines.join("\n");
    let said: Vec<String> = found(&all).into_iter().map(words).collect();
    let [one] = said.as_slice() else { panic!("{said:#?}") };
    assert!(one.contains("of an earlier release: CELL_BOX_MIN, CELL_BOX_MAX, CELL_STEP_MM are missing"), "{one}");
}

/// An output that both files name and that is not switched off at a stop is an error, until the cell's file states
/// whether it may stay on.
#[test]
fn an_additional_output_is_an_error_until_the_cells_file_decides() {
    let mut all = texts_with_edit("cell", "spray = 18\n", "spray = 18\npump = 22\n");
    edit(&mut all, CONFIG, "CELL_OUT_N=5", "CELL_OUT_N=6");
    edit(&mut all, CONFIG, "CELL_OUT[5]=21", "CELL_OUT[5]=21\nCELL_OUT[6]=22");
    let said: Vec<String> = found(&all).into_iter().map(words).collect();
    assert!(said.len() == 1 && said[0].contains("NO STOP SWITCHES PUMP OFF: $OUT[22] (pump)"), "{said:#?}");
    let mut stays = all.clone();
    edit(&mut stays, "cell", "[io.feedbacks]\n", "[io]\nmay_stay_on = [\"pump\"]\n[io.feedbacks]\n");
    assert_eq!(found(&stays), []);
    edit(&mut all, "cell", "extraction = 30 ", "pump = 0\nextraction = 30 ");
    edit(&mut all, CONFIG, "CELL_OFF_N=4", "CELL_OFF_N=5");
    edit(&mut all, CONFIG, "CELL_OFF[4]=21", "CELL_OFF[4]=21\nCELL_OFF[5]=22");
    edit(&mut all, CONFIG, "CELL_OFF_MS[4]=0", "CELL_OFF_MS[4]=0\nCELL_OFF_MS[5]=0");
    assert_eq!(found(&all), []);
}

/// If the cell's file states a host name, its address is compared if the name was resolved; otherwise it is reported as
/// not compared.
#[test]
fn a_host_name_is_resolved_or_reported_as_not_compared() {
    let all = texts_with_edit("cell", "host = \"172.31.1.147\"", "host = \"krc\"");
    let Comparison { differences, not_compared } = compared(&all);
    assert_eq!((differences, not_compared.len()), (vec![], 2), "{not_compared:?}");
    assert!(not_compared[0].contains("host is the name krc: its address is not known here"), "{not_compared:?}");
    let named: Vec<(&str, &str)> = all.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let cell =
        Cell::check("cell.toml", &all.last().expect("the cell").1).unwrap_or_else(|problems| panic!("{problems}"));
    let at = |host_addresses: &[[u8; 4]]| {
        let files = ControllerFiles { host_addresses, ..ControllerFiles::among(&named) };
        let Comparison { differences, not_compared } = compare(&files, &cell);
        assert!(not_compared.is_empty());
        differences.into_iter().map(words).collect::<Vec<_>>()
    };
    assert!(at(&[[172, 31, 1, 147]]).is_empty());
    let others = at(&[[172, 31, 1, 10]]);
    assert!(
        others.len() == 2
            && others[0].contains("is 172.31.1.147, and [robot] host of the cell's file is krc (172.31.1.10)")
    );
}

/// A new subroutine is accepted if it is added as the file describes: with its CASE, the number of subroutines, and the
/// checksum of the text.
#[test]
fn a_subroutine_that_was_added_in_all_places_is_accepted() {
    let mut all = texts_with_edit(USER, "    CASE 0\n", "    CASE 1\n      CELL_USER_0( )\n    CASE 0\n");
    edit(&mut all, CONFIG, "CELL_USER_N=1", "CELL_USER_N=2");
    let [said] = &found(&all)[..] else { panic!("only the sum is missing") };
    let sum = said.problem.message.rsplit("write ").next().and_then(|rest| rest.split(',').next()).expect("a sum");
    edit(&mut all, CONFIG, "CELL_USER_REVISION=154822", &format!("CELL_USER_REVISION={sum}"));
    assert_eq!(found(&all), []);
}

/// The file of the example cell states the checksum of the release's files.
#[test]
fn the_example_cell_states_the_true_sum() {
    let sum = sum(&named(&texts())).expect("the shipped files");
    let stated = planted::CELL.lines().find_map(|line| line.strip_prefix("# programs_sum = ")).expect("a comment");
    assert_eq!(stated.split_whitespace().next(), Some(sum.to_string().as_str()));
}

/// The message names the line of the edit.
#[test]
fn a_difference_names_its_line() {
    let all = found(&texts_with_edit(CONFIG, "CELL_OFF_MS[4]=0", "CELL_OFF_MS[4]=1000"));
    let [one] = &all[..] else { panic!("{all:?}") };
    let line = FILES[0].1.lines().position(|line| line == "CELL_OFF_MS[4]=0").expect("there") + 1;
    assert_eq!((one.file, one.problem.line, one.problem.key.as_str()), (CONFIG, line, "CELL_OFF_MS"));
}

/// A flag that is changed in both the XML file and the data list is accepted, as the installation page describes.
#[test]
fn a_flag_that_was_changed_in_both_files_is_accepted() {
    let mut all = texts_with_edit(CONFIG, "CELL_F_CMD_ALIVE=850", "CELL_F_CMD_ALIVE=860");
    let commands = &mut all.iter_mut().find(|(name, _)| *name == COMMANDS).expect("it").1;
    *commands = commands.replace("Set_Flag=\"850\"", "Set_Flag=\"860\"");
    assert_eq!(found(&all), []);
}

fn named(all: &[(&'static str, String)]) -> Vec<(&'static str, String)> {
    all.iter().filter(|(name, _)| *name != "cell").cloned().collect()
}

fn sum(all: &[(&'static str, String)]) -> Result<i32, SumError> {
    let files: Vec<(&str, &str)> = all.iter().map(|(name, text)| (*name, text.as_str())).collect();
    program_sum(&files)
}

#[test]
fn the_sum_follows_each_value_and_refuses_an_edited_program() {
    let untouched = sum(&named(&texts())).expect("the shipped files");
    for (from, to) in [("CELL_OUT[1]=17", "CELL_OUT[1]=16"), ("CELL_VEL_MAX=0.25", "CELL_VEL_MAX=0.3")] {
        let other = sum(&named(&texts_with_edit(CONFIG, from, to))).expect("a sum");
        assert_ne!(other, untouched, "{from} → {to}");
    }
    // The checksum must not depend on line ends and the revision, which KSS changes.
    let ends: Vec<_> = named(&texts())
        .into_iter()
        .map(|(name, text)| (name, text.replace('\n', "\r\n").replace("&REL 1\r", "&REL 12\r")))
        .collect();
    assert_eq!(sum(&ends), Ok(untouched));
    let edit = texts_with_edit("cell_judge.src", "IF CMD.ID<>CELL_RX+1 THEN", "IF FALSE THEN");
    assert!(matches!(sum(&named(&edit)), Err(SumError::Edited { .. })));
    let edit = texts_with_edit(USER, "WAIT SEC 0.1", "WAIT SEC 0.2");
    assert!(matches!(sum(&named(&edit)), Err(SumError::UserEdited { .. })));
    let lacks: Vec<_> = named(&texts()).into_iter().filter(|(name, _)| *name != "cell_link.src").collect();
    assert_eq!(sum(&lacks), Err(SumError::Missing("cell_link.src")));
}

/// Changing any value of the data list changes the checksum.
#[test]
fn every_value_of_the_data_list_is_in_the_sum() {
    let stated = panelprep_kuka::krl::parse(CONFIG, FILES[0].1).stated_values();
    let mixed = checksum_value_names();
    for value in stated {
        assert!(mixed.contains(value.name.as_str()), "{} is not mixed in", value.name);
    }
}
