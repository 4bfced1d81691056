//! The section of a cycle's page about how long its clips and scans are kept.

use panelprep_base::verdict::Verdict;
use panelprep_cell::cell::{Date, Retention, RetentionTime};
use panelprep_cell::record::CycleRecord;
use panelprep_service::report::page::{Row, Section};
use panelprep_store::store::PrunedFiles;

/// Returns the section; `None` if everything is kept for ever.
pub fn section(keep: &Retention, record: &CycleRecord, pruned: Option<PrunedFiles>) -> Option<Section> {
    if keep.is_unlimited() && pruned.is_none() {
        return None;
    }
    let verdict = record.judgement.as_ref().map(|judgement| judgement.verdict);
    let (of, which) = match verdict {
        Some(Verdict::Pass | Verdict::Accept) => (keep.passed, "passed"),
        _ => (keep.failed, "did not pass"),
    };
    let kept = match verdict {
        None | Some(Verdict::Review) => "for ever: a person has not yet decided about the result".to_owned(),
        _ => describe_retention(of, which),
    };
    let mut rows = vec![Row::new("page and record", "for ever", ""), Row::new("clips and scans", kept, "")];
    if let Some(pruned) = pruned {
        let day = pruned.at_unix_s.map_or(String::new(), |at| format!(" on {}", Date::from_unix_s(at)));
        let removed = format!("{} files, {} MB, removed{day}", pruned.files, pruned.bytes / 1_000_000);
        rows.push(Row::new("clips and scans of this cycle", removed, ""));
    }
    let text = "How long the data of this cycle is kept, by [store] keep in the cell's file. The store's hash chain still \
                lists removed files."
        .to_owned();
    Some(Section { heading: "Kept".to_owned(), text, rows, figures: vec![] })
}

fn describe_retention(of: RetentionTime, which: &str) -> String {
    let days = of.days.map(|days| format!("{days} days before the newest cycle"));
    let cycles = of.cycles.map(|cycles| format!("while the cycle is among the newest {cycles} that {which}"));
    let limits: Vec<String> = days.into_iter().chain(cycles).collect();
    if limits.is_empty() { "for ever".to_owned() } else { limits.join(", and ") }
}
