//! The part that a cycle treats. Its names are checked when they are given, stored with the cycle as a text, and shown
//! first on the page of the cycle.

use super::fault::SetupFault;
use crate::report::page::{Row, Section};
use panelprep_base::number_text::{check_printable, utc_day};
use panelprep_cell::record::{ANOTHER_PART_TEXT, CycleRecord, LostPasses, PartNames, describe_part};
use panelprep_store::store::{PassesOfCycle, Store};

/// Maximum length of each name of a part, characters.
const MAX_CHARACTERS: usize = 120;

/// Checks the names of a part; returns `None` if no name is given.
///
/// # Errors
/// If one is empty, too long, or cannot be printed as it is.
pub fn parse_part_names(part: PartNames) -> Result<Option<PartNames>, SetupFault> {
    let named = [("--part", &part.serial), ("--order", &part.order), ("--operator", &part.operator)];
    for (option, name) in named {
        let Some(name) = name else { continue };
        check_printable(name, MAX_CHARACTERS).map_err(|problem| {
            let found = name.escape_debug().to_string();
            SetupFault::PartName { option, found, problem }
        })?;
    }
    Ok((part != PartNames::default()).then_some(part))
}

/// Returns the names of a part as the TOML text that is stored.
///
/// # Errors
/// If it cannot be written as TOML.
pub fn text(part: &PartNames) -> Result<String, SetupFault> {
    toml::to_string(part).map_err(SetupFault::stage)
}

/// Returns the file name and the text that record, at the start of a cycle, that another part than before is in the
/// fixture.
pub fn another_part_text() -> (String, String) {
    (
        ANOTHER_PART_TEXT.to_owned(),
        "this cycle was started with the statement that another part than before is in the fixture\n".to_owned(),
    )
}

/// Returns the file name and the text that record, at the start of a cycle, how many sanding passes the part had in
/// lost cycles.
///
/// # Errors
/// If it cannot be written as TOML.
pub fn lost(passes: u8) -> Result<(String, String), SetupFault> {
    Ok((LostPasses::FILE.to_owned(), toml::to_string(&LostPasses { passes }).map_err(SetupFault::stage)?))
}

/// Checks that a part may be sanded once more: after these cycles, and after this number of passes in lost cycles, it
/// must have had fewer than `most` passes.
///
/// # Errors
/// If the part has already had `most` passes; the error lists the cycles.
pub fn check_pass_limit(
    part: Option<&PartNames>,
    (earlier, lost): (&[PassesOfCycle], u8),
    most: usize,
) -> Result<(), SetupFault> {
    let part = describe_part(part.and_then(|part| part.serial.as_deref()).unwrap_or_default());
    let used: usize = earlier.iter().map(|cycle| cycle.passes).sum::<usize>() + usize::from(lost);
    if used < most {
        return Ok(());
    }
    let stated = (lost > 0).then(|| format!("lost cycles, as stated: {}", format_pass_count(usize::from(lost))));
    let known = (!earlier.is_empty()).then(|| history(earlier));
    let history = known.into_iter().chain(stated).collect::<Vec<_>>().join("; ");
    Err(SetupFault::PartUsedUp { part, most, history })
}

/// Returns a number of passes with its noun, for example "2 passes".
fn format_pass_count(passes: usize) -> String {
    if passes == 1 { "1 pass".to_owned() } else { format!("{passes} passes") }
}

/// Returns a list of cycles with their numbers of passes, as a text.
pub fn history(earlier: &[PassesOfCycle]) -> String {
    let words = |PassesOfCycle { cycle, started_unix_s, passes, .. }: &PassesOfCycle| {
        format!("cycle {cycle} of {}: {}", utc_day(*started_unix_s), format_pass_count(*passes))
    };
    earlier.iter().map(words).collect::<Vec<_>>().join("; ")
}

/// Returns the section about the part for the page of a cycle; `None` if no part was named.
pub fn section(store: &Store, record: &CycleRecord) -> Option<Section> {
    record.files.iter().find(|file| file.name == PartNames::FILE)?;
    let (text, part) = match store.stored_part(record) {
        Some(part) => ("The part as it was named when the cycle was started.", part),
        None => ("The part was named, but its data is missing or damaged in the store.", PartNames::default()),
    };
    let row =
        |name: &str, value: Option<String>| Row::new(name, value.unwrap_or_else(|| "not named".to_owned()), "");
    let rows = vec![
        row("serial number", part.serial),
        row("work order", part.order),
        row("operator, as named at the start", part.operator),
    ];
    Some(Section { heading: "The part".to_owned(), text: text.to_owned(), rows, figures: vec![] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::record::CycleId;

    /// Expected results, calculated by hand: 2 + 1 earlier passes leave one pass if the limit is 4, and none if it is
    /// 3.
    #[test]
    fn a_part_at_its_pass_limit_is_refused_with_its_history() {
        let cycle = |id, passes| PassesOfCycle {
            cycle: CycleId(id),
            started_unix_s: 86_400 * id,
            passes,
            removed_um: None,
        };
        let earlier = [cycle(4, 2), cycle(9, 1)];
        let part = PartNames { serial: Some("SN 17".to_owned()), ..PartNames::default() };
        assert!(
            check_pass_limit(Some(&part), (&earlier, 0), 4).is_ok() && check_pass_limit(None, (&[], 0), 1).is_ok()
        );
        let refused = check_pass_limit(Some(&part), (&earlier, 0), 3).expect_err("used up").to_string();
        let words = "the part SN 17 has reached the limit of 3 passes ([process] max_passes_per_part): cycle 4 of \
                     1970-01-05: 2 passes; cycle 9 of 1970-01-10: 1 pass; take the part out";
        assert!(refused.starts_with(words), "{refused}");
        let refused =
            check_pass_limit(Some(&part), (&earlier, 1), 4).expect_err("a stated pass counts").to_string();
        assert!(refused.contains("1 pass; lost cycles, as stated: 1 pass; take the part out"), "{refused}");
        let refused = check_pass_limit(None, (&[], 3), 3).expect_err("three stated passes").to_string();
        let words = "a part without a serial number has reached the limit of 3 passes ([process] max_passes_per_part): \
                     lost cycles, as stated: 3 passes; take the part out";
        assert!(refused.starts_with(words), "{refused}");
    }

    #[test]
    fn names_are_accepted_unchanged_or_refused() {
        let part = |serial: &str| PartNames { serial: Some(serial.to_owned()), ..PartNames::default() };
        assert_eq!(parse_part_names(PartNames::default()).expect("no name"), None);
        let good = part("SN 0017/ä \"7\"");
        assert_eq!(parse_part_names(good.clone()).expect("good"), Some(good.clone()));
        assert_eq!(toml::from_str::<PartNames>(&text(&good).expect("TOML")), Ok(good));
        for (bad, words) in [("", "empty"), (" a", "space"), ("a\nb", "line feed"), (&"x".repeat(121), "120")] {
            let error = parse_part_names(part(bad)).expect_err("refused").to_string();
            assert!(error.contains("--part") && error.contains(words) && !error.contains('\n'), "{error}");
        }
    }
}
