//! The table of all alarm codes (ISA-18.2), each with its priority, its meaning and what to do.
//!
//! Meaning and remedy are those on the manual's page of messages; a test compares that page with the sources. The
//! priorities are defined here. None of the codes is a safety function: an immediate stop of the robot is the task of
//! the cell's own safety circuit.

use serde::Serialize;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::LazyLock;

const PAGE: &str = include_str!("../../../config/manual/messages.md");
/// The page of messages in each language, English first. All languages have the same rows.
const PAGES: [(&str, &str); 2] = [("en", PAGE), ("de", include_str!("../../../config/manual/messages.de.md"))];

/// The priority of a code: how soon a person must act.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, strum::IntoStaticStr)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Priority {
    /// No action: the code reports an event.
    Note,
    /// Action when there is time: a request or a command was not performed, without any other effect.
    Low,
    /// Action soon: a cycle waits for a person, or has ended without a result.
    Medium,
    /// Action now: the cell was aborted, or its state is unknown. A person must check the cell before any motion.
    High,
}

impl Priority {
    /// Returns the keyword of the priority, such as `high`.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}

/// An alarm code with its explanation.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Code {
    /// The stable keyword, such as `low_overlap`.
    pub code: Cow<'static, str>,
    /// Urgency of the code.
    pub priority: Priority,
    /// The meaning of the code and its cause.
    pub cause: Cow<'static, str>,
    /// What a person must do.
    pub remedy: Cow<'static, str>,
}

/// Codes after which the cell was aborted, or its state is unknown.
const HIGH_PRIORITY_CODES: [&str; 32] = [
    "other_programs",
    "link_lost",
    "no_route",
    "unknown_place",
    "not_sent",
    "robot_restarted",
    "emergency_stop",
    "guard_open",
    "drives_off",
    "refused",
    "echo",
    "protocol",
    "sequence",
    "watchdog",
    "late",
    "short",
    "deviation",
    "unexpected",
    "feedback",
    "gate",
    "stop_timed_out",
    "stop_not_confirmed",
    "interrupted",
    "outputs_on",
    "water_may_run",
    "tool_may_run",
    "store",
    "store_changed",
    "store_restored",
    "disk_full",
    "silent",
    "ended",
];

/// Codes of intended events. For example, it is the purpose of the test to find places where the film breaks.
const NOTE_PRIORITY_CODES: [&str; 7] =
    ["asked", "stopped", "robot_ready", "broken", "off_path", "running", "waypoints"];

/// Headings of the sections with the codes of commands and requests. A section ends at the next heading.
const COMMAND_SECTIONS: [&str; 4] = ["Requests that are refused", "Calibration", "Teaching", "Commands and files"];

/// Codes in the sections `COMMAND_SECTIONS` that prevent the start of a cycle.
const START_PREVENTING_CODES: [&str; 6] = [
    "verification_limit",
    "verification_old",
    "verification_ahead",
    "verification_other",
    "verification_struck",
    "calibration",
];

static CODES: LazyLock<Vec<Code>> = LazyLock::new(|| {
    let of = |(section, row): (&'static str, Row)| Code {
        code: row.code.into(),
        priority: priority(row.code, row.cause, section),
        cause: row.cause.into(),
        remedy: row.remedy.into(),
    };
    rows(PAGE).into_iter().map(of).collect()
});

/// The row of a code on the page of messages in one language.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// The stable keyword, such as `low_overlap`.
    pub code: &'static str,
    /// The meaning of the code and its cause.
    pub cause: &'static str,
    /// What a person must do.
    pub remedy: &'static str,
}

type Table = BTreeMap<&'static str, Row>;

static ROWS: LazyLock<BTreeMap<&'static str, Table>> = LazyLock::new(|| {
    let table = |page| rows(page).into_iter().map(|(_, row)| (row.code, row)).collect();
    PAGES.into_iter().map(|(language, page)| (language, table(page))).collect()
});

/// Returns the row of a code in this language; `None` if the code or the language is unknown.
pub fn row(code: &str, language: &str) -> Option<Row> {
    ROWS.get(language)?.get(code).copied()
}

/// Returns the languages of the page of messages, English first.
pub fn languages() -> impl Iterator<Item = &'static str> {
    PAGES.into_iter().map(|(language, _)| language)
}

/// Returns all codes in the order of the manual.
pub fn codes() -> &'static [Code] {
    &CODES
}

/// Returns the code with this keyword.
pub fn code(word: &str) -> Option<&'static Code> {
    CODES.iter().find(|code| code.code == word)
}

/// Returns the rows of a page, each with the heading of its section.
fn rows(page: &'static str) -> Vec<(&'static str, Row)> {
    let mut section = "";
    let mut rows = Vec::new();
    for line in page.lines() {
        if let Some(title) = line.strip_prefix("## ") {
            section = title;
        }
        let Some(row) = line.strip_prefix("| `").and_then(|row| row.strip_suffix('|')) else { continue };
        let cells: Vec<&'static str> = row.split('|').map(str::trim).collect();
        if let [code, cause, remedy] = cells[..] {
            rows.push((section, Row { code: code.trim_end_matches('`'), cause, remedy }));
        }
    }
    rows
}

fn priority(code: &str, cause: &str, section: &str) -> Priority {
    let is_command =
        COMMAND_SECTIONS.contains(&section) || cause.contains("A single function of `panelprep robot`");
    match code {
        _ if HIGH_PRIORITY_CODES.contains(&code) => Priority::High,
        _ if NOTE_PRIORITY_CODES.contains(&code) || cause.starts_with("A note on the page") => Priority::Note,
        _ if is_command && !START_PREVENTING_CODES.contains(&code) => Priority::Low,
        _ => Priority::Medium,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_code_has_its_priority_cause_and_remedy() {
        for (word, priority) in [
            ("no_panel", Priority::Medium),
            ("other_scan", Priority::Medium),
            ("low_overlap", Priority::Medium),
            ("link_lost", Priority::High),
            ("broken", Priority::Note),
            ("part", Priority::Medium),
            ("not_now", Priority::Low),
            ("guard", Priority::Low),
            ("few_pictures", Priority::Low),
            ("verification_old", Priority::Medium),
        ] {
            let code = code(word).unwrap_or_else(|| panic!("{word}"));
            assert_eq!(code.priority, priority, "{word}");
            assert!(code.cause.ends_with('.') && code.remedy.len() > 10, "{code:?}");
        }
        assert!(code("no_such_code").is_none() && codes().len() > 150);
    }

    /// The page in each language has the same rows, with the same codes, commands, keys and files.
    #[test]
    fn each_language_has_the_same_rows_and_codes() {
        let marked = |row: &Row| {
            let text = format!("{} {}", row.cause, row.remedy);
            let mut marked: Vec<String> = text.split('`').skip(1).step_by(2).map(str::to_owned).collect();
            marked.sort();
            marked
        };
        let of = |page| rows(page).into_iter().map(|(_, row)| row).collect::<Vec<Row>>();
        let english = of(PAGE);
        for (language, page) in &PAGES[1..] {
            let others = of(page);
            let words = |rows: &[Row]| rows.iter().map(|row| row.code).collect::<Vec<_>>();
            assert_eq!(words(&others), words(&english), "{language}");
            for (row, other) in english.iter().zip(&others) {
                assert_eq!(marked(other), marked(row), "{language}: {}", row.code);
                assert!(other.cause != row.cause && other.remedy != row.remedy, "{language}: {}", row.code);
            }
        }
    }

    /// Every code in one of the lists here is a code of the manual.
    #[test]
    fn every_listed_code_is_one_of_the_manual() {
        let unknown: Vec<&&str> = HIGH_PRIORITY_CODES
            .iter()
            .chain(&NOTE_PRIORITY_CODES)
            .chain(&START_PREVENTING_CODES)
            .filter(|word| code(word).is_none())
            .collect();
        assert_eq!(unknown, [] as [&&str; 0]);
        let headings: Vec<&str> = PAGE.lines().filter_map(|line| line.strip_prefix("## ")).collect();
        assert!(COMMAND_SECTIONS.iter().all(|section| headings.contains(section)), "{headings:?}");
    }

    /// Codes that abort the cycle according to the manual have high priority, because the cell must be checked before
    /// any motion.
    #[test]
    fn codes_that_abort_a_cycle_have_high_priority() {
        let aborts = |code: &&Code| code.cause.starts_with("Aborted") || code.cause.contains("cycle is aborted");
        let found: Vec<_> = codes().iter().filter(aborts).filter(|code| code.priority < Priority::High).collect();
        assert_eq!(found.iter().map(|code| &*code.code).collect::<Vec<_>>(), [] as [&str; 0]);
    }
}
