//! `panelprep doctor`: checks the cell from the bottom up, with one line per item and advice if an item is not right.

use super::args::{Common, Doctor};
use super::fault::Fault;
use super::output::Outcome;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_service::daemon::{ExaminationOptions, ExaminedItem, ItemStatus, examine_cell};
use serde_json::json;

/// Checks everything and reports.
///
/// # Errors
/// None: what cannot be read is a finding.
pub fn run(args: &Doctor, common: &Common) -> Result<Outcome, Fault> {
    let options = ExaminationOptions { kuka: args.kuka.clone(), warm_up: args.warm_up, accept: args.accept };
    Ok(outcome(&examine_cell(&options, &common.paths())))
}

fn outcome(checks: &[ExaminedItem]) -> Outcome {
    let wrong: Vec<&ExaminedItem> = checks.iter().filter(|check| !check.is_passed()).collect();
    let reason = |check: &&ExaminedItem| Reason::new("not_right", format!("{}: {}", check.name, check.found));
    let verdict = if wrong.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons: wrong.iter().map(reason).collect() });
    let width = checks.iter().map(|check| check.name.chars().count()).max().unwrap_or(0);
    outcome.lines = Vec::new();
    for check in checks {
        let mark = match check.status {
            ItemStatus::Right => "ok   ",
            ItemStatus::Wrong => "WRONG",
            ItemStatus::Open => "open ",
        };
        outcome.add_line(format!("{mark}  {:width$}  {}", check.name, check.found));
        if !check.advice.is_empty() {
            outcome.add_line(format!("       {:width$}  → {}", "", check.advice));
        }
    }
    let (all, right) = (checks.len(), checks.len() - wrong.len());
    outcome.add_line(match wrong.len() {
        0 => format!("all {all} checks passed"),
        _ => format!("{right} of {all} checks passed; correct the first failed check first"),
    });
    let of_check = |check: &ExaminedItem| {
        let advice = Some(&check.advice).filter(|advice| !advice.is_empty());
        json!({"name": check.name, "ok": check.is_passed(), "found": check.found, "advice": advice})
    };
    outcome.add_value("checks", json!(checks.iter().map(of_check).collect::<Vec<_>>()));
    outcome
}
