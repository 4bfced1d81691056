//! `panelprep replay`: runs a recorded cycle again without devices and finds the differences.

use super::args::Replay;
use super::fault::Fault;
use super::output::Outcome;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_service::daemon::{self, Computing, LoopPorts, LoopStart, Player, ReplayResult};
use panelprep_service::setup::{CellSetup, CycleSetup, RecordedCycle};
use panelprep_store::tape::{self, CheckedRecording, EntryReader};
use serde_json::json;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

/// Number of differences that are shown to a person; the JSON has them all.
const MAX_SHOWN_DIFFERENCES: usize = 20;

/// Runs the recorded cycle again and reports the differences.
///
/// # Errors
/// If the recording cannot be used: it is not a recording, has a gap, has another format, or was not finished.
pub fn run(args: &Replay) -> Result<Outcome, Fault> {
    let file = args.recording.as_path();
    let refused = |error| Fault::file_fault(file, error);
    let checked = tape::check_recording(open(file)?).map_err(refused)?;
    let recorded = RecordedCycle::read(file, &checked)?;
    let RecordedCycle { cell, recipe, taught, calibrations, lens, removed_before } = recorded;
    let cell = Arc::new(CellSetup::new(&cell).map_err(Fault::stage)?.for_replay());
    let setup = CycleSetup::new(cell.clone(), recipe, (taught.panel, taught.corners), (calibrations, lens))
        .map(|setup| setup.with_earlier_removal(removed_before));
    let cycle = Some(Arc::new(setup.map_err(Fault::stage)?));

    let start = &checked.start;
    let player = Player::new(EntryReader::new(open(file)?, start.unix_ns), start.lock_step);
    let ports = LoopPorts {
        robot: &mut player.clone(),
        tool: &mut player.clone(),
        record: &mut player.clone(),
        requests: &mut player.clone(),
        computing: Computing::inline(Box::new(player.clone()), start.lock_step),
        lock_step: start.lock_step,
    };
    let ended = daemon::run(LoopStart { cell, cycle, state: start.state, before: start.begin.clone() }, ports);
    let played = player.replay_result();
    if let Some(error) = played.error {
        return Err(refused(error));
    }
    if played.is_complete && played.differences.is_empty() {
        ended.as_ref().map_err(|error| Fault::file_fault(file, error.to_string()))?;
    }
    let verdict = ended.ok().and_then(|ended| ended.verdict);
    Ok(outcome(&checked, &played, verdict))
}

fn open(file: &Path) -> Result<BufReader<File>, Fault> {
    panelprep_base::disk::open(file).map(BufReader::new).map_err(|error| Fault::file_fault(file, error))
}

fn outcome(checked: &CheckedRecording, played: &ReplayResult, verdict: Option<Verdict>) -> Outcome {
    let same = played.is_complete && played.differences.is_empty();
    let (entries, length_s, by) = (played.entries, checked.length_s, &checked.start.program);
    let reasons = match same {
        true => vec![],
        false => vec![Reason::new(
            "differs",
            format!("the replayed cycle differs from the recording in {} places", played.differences.len()),
        )],
    };
    let judgement = Judgement { verdict: if same { Verdict::Pass } else { Verdict::Fail }, reasons };
    let mut outcome = Outcome::from_judgement(&judgement);
    // The verdict of this command is about the replay; the cycle has its own verdict.
    let word = if same { "the same as recorded" } else { "not the same as recorded" };
    outcome.lines[0] = format!("replay: {word}");
    outcome.add_value("same", json!(same));
    outcome.add_value("differences", json!(played.differences));
    outcome.add_value("to_the_end", json!(played.is_complete));
    outcome.add_value("entries", json!(entries));
    outcome.add_value("recorded_s", json!(length_s));
    outcome.add_value("recorded_by", json!(by));
    outcome.add_value("cycle_verdict", json!(verdict));
    outcome.add_line(format!(
        "{entries} of {} entries replayed, over {length_s:.1} s, recorded by panelprep {by}",
        checked.entries
    ));
    if let Some(verdict) = verdict {
        outcome.add_line(format!("the cycle's verdict: {}", verdict.keyword()));
    }
    for difference in played.differences.iter().take(MAX_SHOWN_DIFFERENCES) {
        outcome.add_line(format!("  {difference}"));
    }
    if let Some(more @ 1..) = played.differences.len().checked_sub(MAX_SHOWN_DIFFERENCES) {
        outcome.add_line(format!("  and {more} more; --json lists all of them"));
    }
    if !played.is_complete {
        outcome.add_line("the replay stopped at the point where it differs from the recording");
    }
    outcome
}
