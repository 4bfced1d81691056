//! The table "To be proven" of the installation page: the assumptions about the controller, and the results of their
//! tests.

use panelprep_cell::cell::ProofStage;

/// An assumption about the controller: a row of the table on the installation page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Assumption {
    /// The stage in which the assumption is tested.
    pub(super) stage: ProofStage,
    /// The number of the row on the installation page.
    pub(super) number: u32,
    pub(super) assumed: String,
    pub(super) to_do: String,
    /// The expected observation if the assumption is true.
    pub(super) to_see: String,
    /// The consequence if the assumption is false.
    pub(super) otherwise: String,
}

/// The result of a test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub(super) enum Finding {
    Proven,
    Wrong,
    Open,
}

impl Finding {
    pub(super) fn keyword(self) -> &'static str {
        self.into()
    }
}

/// The evidence of a test that was not run.
const NOT_DONE: &str = "not done";

impl Proof {
    /// Creates the open test of an assumption.
    pub(super) fn open(assumption: Assumption) -> Self {
        Proof { assumption, finding: Finding::Open, evidence: NOT_DONE.to_owned(), tried: false }
    }

    /// Returns whether the test has passed, with evidence.
    pub(super) fn is_proven(&self) -> bool {
        self.finding == Finding::Proven && !self.evidence.is_empty()
    }
}

/// The test of an assumption, with its result: a row of the page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Proof {
    pub(super) assumption: Assumption,
    pub(super) finding: Finding,
    pub(super) evidence: String,
    /// Whether this program ran the test; otherwise a person reported the result.
    pub(super) tried: bool,
}

/// The installation page with the table of assumptions.
pub(super) const INSTALLATION: &str = include_str!("../../../config/kuka/README.md");

/// Returns the rows of the table "To be proven", in the order of the stages.
pub(super) fn assumptions(page: &str) -> Vec<Assumption> {
    let table = page.split("\n## To be proven\n").nth(1).and_then(|rest| rest.split("\n## ").next());
    let mut stage = None::<ProofStage>;
    let mut rows = Vec::new();
    for line in table.unwrap_or_default().lines() {
        if let Some(heading) = line.strip_prefix("### Stage ") {
            stage = heading.split(':').next().and_then(|letter| letter.parse().ok());
        }
        rows.extend(stage.and_then(|stage| row(stage, line)));
    }
    rows
}

/// Parses a row: number, assumption, what to do, what to observe, consequence otherwise; the last column is for the
/// person.
fn row(stage: ProofStage, line: &str) -> Option<Assumption> {
    let mut cells = line.strip_prefix('|')?.split(" | ").map(str::trim);
    let number = cells.next()?.parse().ok()?;
    let mut text = || cells.next().unwrap_or_default().trim_end_matches('|').trim().to_owned();
    let (assumed, to_do, to_see, otherwise) = (text(), text(), text(), text());
    Some(Assumption { stage, number, assumed, to_do, to_see, otherwise })
}

#[cfg(test)]
mod tests {
    use super::super::unattended;
    use super::*;

    /// Returns the errors in the table of an installation page.
    fn wrong(page: &str) -> Vec<String> {
        let rows = assumptions(page);
        let mut found = Vec::new();
        let mut numbers: Vec<u32> = rows.iter().map(|row| row.number).collect();
        for two in rows.windows(2) {
            if (two[1].stage, two[1].number) <= (two[0].stage, two[0].number) {
                found.push(format!("{} follows {}", two[1].number, two[0].number));
            }
        }
        numbers.sort_unstable();
        if numbers != (1..=56).collect::<Vec<_>>() {
            found.push(format!("the numbers are not 1 to 56: {numbers:?}"));
        }
        for row in &rows {
            let number = row.number;
            // What to do must name a command of this program, a step of the first test, an item on the controller's
            // screen, or something at the cell.
            let is_doable =
                ["`panelprep ", "step ", "steps ", "**Display", "Install, ", "`cell_motion`", "as row "]
                    .iter()
                    .any(|how| row.to_do.contains(how));
            let is_by_hand = ["by hand", "a script"].iter().any(|words| row.to_do.contains(words));
            if !is_doable || is_by_hand {
                found.push(format!("{number}: neither a command nor steps: {}", row.to_do));
            }
            if row.assumed.len() < 10 || row.to_see.len() < 10 {
                found.push(format!("{number}: what is assumed, or what to see, is missing"));
            }
            if row.otherwise.len() < 10 {
                found.push(format!("{number}: what breaks otherwise is missing"));
            }
            // If this program runs the test, the table must state that no person is needed.
            let is_tried = unattended::find_test_for_row(number).is_some();
            if is_tried != row.to_do.contains("`panelprep robot prove") {
                found.push(format!("{number}: whether this program tries it is stated wrongly"));
            }
        }
        let in_automatic = ["air-run", "panelprep cycle", " AUT", "panelprep ctl"];
        for row in rows.iter().filter(|row| row.stage == ProofStage::A) {
            let early: Vec<_> = in_automatic.iter().filter(|words| row.to_do.contains(**words)).collect();
            if !early.is_empty() {
                found.push(format!("{}: {early:?} before stage A is signed", row.number));
            }
        }
        let contact = |row: &&Assumption| row.stage != ProofStage::C && row.to_do.contains("foam");
        found.extend(rows.iter().filter(contact).map(|row| format!("{}: contact before stage C", row.number)));
        found
    }

    #[test]
    fn every_row_can_be_done_in_its_stage_and_states_what_breaks_otherwise() {
        assert_eq!(wrong(INSTALLATION), [""; 0]);
        let changed = |from: &str, to: &str| {
            let page = INSTALLATION.replacen(from, to, 1);
            assert_ne!(page, INSTALLATION, "{from}");
            wrong(&page)
        };
        // The inserted errors are: exchanged stages, a wrong row number, a row without a program test, a row without
        // its last column.
        assert!(!changed("### Stage A:", "### Stage C:").is_empty());
        assert!(changed("\n| 9 | `RESUME`", "\n| 57 | `RESUME`").iter().any(|words| words.contains("1 to 56")));
        let row = assumptions(INSTALLATION).into_iter().find(|row| row.number == 16).expect("a row");
        assert!(changed(&row.to_do, "by hand").iter().any(|words| words.starts_with("16: neither")));
        assert!(changed(&row.otherwise, "").iter().any(|words| words.starts_with("16: what breaks")));
        assert!(
            changed(&row.to_do, "`panelprep air-run --recipe FILE`")
                .iter()
                .any(|words| words.contains("before stage A"))
        );
    }
}
