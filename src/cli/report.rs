//! `panelprep page`: makes a cycle's page again; and a description for a terminal of what the cycle did to the panel,
//! which grids it abraded and how much it removed.

use super::args::{Common, PageOf};
use super::fault::Fault;
use super::output::Outcome;
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::record::{self, AbradedGrid, CycleId, CycleRecord, PathRemoval};
use panelprep_service::setup::{CellFiles, StoredCycle, page_file, recording_status};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Makes the page, and reports what the store no longer has of the cycle.
///
/// # Errors
/// If there is no such cycle, it cannot be read back, or writing to the disk fails.
pub fn run_page(args: &PageOf, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let kept = StoredCycle::read(&files.store()?, CycleId(args.cycle))?;
    let page = args.out.clone().unwrap_or_else(|| page_file(files.store_folder(), CycleId(args.cycle)));
    kept.write(files.cell.retention(), &page, recording_status(files.store_folder(), &kept.record).as_ref())?;
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

/// Describes each grid with the passes that touched it; unknown facts are marked as such.
pub fn describe_grids(record: &CycleRecord) -> Vec<String> {
    let mut passes: BTreeMap<(String, u8), bool> = BTreeMap::new();
    for AbradedGrid { grid, pass, how } in record::abraded_grids(&record.findings, &record.motions) {
        let grid = grid.unwrap_or_else(|| "any grid".to_owned());
        *passes.entry((grid, pass)).or_default() |= how.is_certain();
    }
    let mut grids: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for ((grid, _), is_sure) in &passes {
        grids.entry(grid).or_default()[usize::from(!is_sure)] += 1;
    }
    let words = |(grid, [sure, perhaps]): (&&str, &[usize; 2])| match (sure, perhaps) {
        (sure, 0) => format!("{grid} ×{sure}"),
        (0, _) => format!("{grid} possibly (not confirmed)"),
        (sure, _) => format!("{grid} ×{sure}, possibly once more (not confirmed)"),
    };
    grids.iter().map(words).collect()
}

/// Describes the removal of each path, a line for each; empty if the recipe does not request a removal.
pub fn removed(record: &CycleRecord) -> Vec<String> {
    let line = |path: PathRemoval| {
        format!(
            "removed in pass {}: mean {} µm over the treated grids; at most {} µm so far at any point of the part (95 % bound)",
            path.pass,
            fixed_decimals(path.mean_um, 1),
            fixed_decimals(path.bound_um, 1)
        )
    };
    record::path_removals(&record.findings).into_iter().map(line).collect()
}

/// Returns the removal of each path for scripts.
pub fn removed_json(record: &CycleRecord) -> Value {
    let path = |path: PathRemoval| json!({"pass": path.pass, "mean_um": path.mean_um, "bound_um": path.bound_um});
    record::path_removals(&record.findings).into_iter().map(path).collect()
}
