//! `panelprep page N`: makes a cycle's page again, only from the store.

use super::args::{Common, PageOf};
use super::fault::Fault;
use super::load::CellFiles;
use super::outcome::Outcome;
use super::report::{self, StoredCycle};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::record::CycleId;
use serde_json::json;

/// Makes the page, and reports what the store no longer has of the cycle.
///
/// # Errors
/// If there is no such cycle, it cannot be read back, or writing to the disk fails.
pub fn run(args: &PageOf, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let kept = StoredCycle::read(&files.store()?, CycleId(args.cycle))?;
    let page = args.out.clone().unwrap_or_else(|| report::page_file(files.store_folder(), CycleId(args.cycle)));
    kept.write(
        files.cell.retention(),
        &page,
        report::recording_status(files.store_folder(), &kept.record).as_ref(),
    )?;
    let found: Vec<Reason> =
        kept.describe_missing_figures().map(|words| Reason::new("picture_missing", words)).collect();
    let ok = found.is_empty();
    let verdict = if ok { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons: found.clone() });
    // The verdict of this command is not the verdict of the cycle.
    outcome.lines[0] = match ok {
        true => "the page is complete".to_owned(),
        false => "the page was made, but data of the cycle is missing or damaged in the store:".to_owned(),
    };
    outcome.add_value("ok", json!(ok));
    outcome.add_value("found", json!(found));
    outcome.add_value("cycle_id", json!(args.cycle));
    outcome.add_value("cycle_verdict", json!(kept.record.judgement.as_ref().map(|judgement| judgement.verdict)));
    outcome.add_value("report", json!(page));
    outcome.add_line(match &kept.record.judgement {
        Some(judgement) => format!("the cycle's verdict: {}", judgement.verdict.keyword()),
        None => "the cycle has not ended: this page does not show its final result".to_owned(),
    });
    outcome.add_line(format!("page: {}", page.display()));
    Ok(outcome)
}
