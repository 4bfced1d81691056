//! `panelprep replay`: runs a recorded cycle again without devices and finds the differences.

use super::args::Replay;
use super::fault::Fault;
use super::outcome::Outcome;
use super::recording::RecordedCycle;
use crate::daemon::{self, CellSetup, Computing, CycleSetup, LoopStart, Played, Player, Ports};
use crate::tape::{self, Checked, Entries};
use crate::verdict::{Judgement, Reason, Verdict};
use serde_json::json;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

/// Number of differences that are shown to a person; the JSON has them all.
const MAX_SHOWN: usize = 20;

/// Runs the recorded cycle again and reports the differences.
///
/// # Errors
/// If the recording cannot be used: it is not a recording, has a gap, has another format, or was not finished.
pub fn run(args: &Replay) -> Result<Outcome, Fault> {
    let file = args.recording.as_path();
    let refused = |error| Fault::file(file, error);
    let checked = tape::check(open(file)?).map_err(refused)?;
    let recorded = RecordedCycle::read(file, &checked)?;
    let RecordedCycle { cell, recipe, taught, calibrations, lens, removed_before } = recorded;
    let cell = Arc::new(CellSetup::new(&cell).map_err(Fault::stage)?);
    let setup = CycleSetup::new(cell.clone(), recipe, (taught.panel, taught.corners), (calibrations, lens))
        .map(|setup| setup.after(removed_before));
    let cycle = Some(Arc::new(setup.map_err(Fault::stage)?));

    let start = &checked.start;
    let player = Player::new(Entries::new(open(file)?, start.unix_ns), start.lock_step);
    let ports = Ports {
        robot: &mut player.clone(),
        tool: &mut player.clone(),
        record: &mut player.clone(),
        requests: &mut player.clone(),
        computing: Computing::inline(Box::new(player.clone()), start.lock_step),
        lock_step: start.lock_step,
    };
    let ended = daemon::run(LoopStart { cell, cycle, state: start.state, before: start.begin.clone() }, ports);
    let played = player.played();
    if let Some(error) = played.error {
        return Err(refused(error));
    }
    if played.to_the_end && played.differences.is_empty() {
        ended.as_ref().map_err(|error| Fault::file(file, error.to_string()))?;
    }
    let verdict = ended.ok().and_then(|ended| ended.verdict);
    Ok(outcome(&checked, &played, verdict))
}

fn open(file: &Path) -> Result<BufReader<File>, Fault> {
    crate::disk::open(file).map(BufReader::new).map_err(|error| Fault::file(file, error))
}

fn outcome(checked: &Checked, played: &Played, verdict: Option<Verdict>) -> Outcome {
    let same = played.to_the_end && played.differences.is_empty();
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
    outcome.words[0] = format!("replay: {word}");
    outcome.put("same", json!(same));
    outcome.put("differences", json!(played.differences));
    outcome.put("to_the_end", json!(played.to_the_end));
    outcome.put("entries", json!(entries));
    outcome.put("recorded_s", json!(length_s));
    outcome.put("recorded_by", json!(by));
    outcome.put("cycle_verdict", json!(verdict));
    outcome.add_line(format!(
        "{entries} of {} entries replayed, over {length_s:.1} s, recorded by panelprep {by}",
        checked.entries
    ));
    if let Some(verdict) = verdict {
        outcome.add_line(format!("the cycle's verdict: {}", verdict.word()));
    }
    for difference in played.differences.iter().take(MAX_SHOWN) {
        outcome.add_line(format!("  {difference}"));
    }
    if let Some(more @ 1..) = played.differences.len().checked_sub(MAX_SHOWN) {
        outcome.add_line(format!("  and {more} more; --json lists all of them"));
    }
    if !played.to_the_end {
        outcome.add_line("the replay stopped at the point where it differs from the recording");
    }
    outcome
}
