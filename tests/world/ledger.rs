//! The acknowledgements of the store, recorded outside of the store. After every start, whatever ended the process
//! before, the store must contain all of them.

use super::touched::Touched;
use panelprep::cycle::{At, Event, Motion, Request, State};
use panelprep::daemon::{Note, RecordAnswer, RecordCommand};
use panelprep::record::{Answer, CycleId, CycleRecord, Kind, MotionRecord, RequestedAction};
use panelprep::report::cycle_page;
use panelprep::store::{Store, StoreError};
use panelprep::verdict::Verdict;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// The acknowledged data.
#[derive(Debug, Clone, Default)]
pub struct Ledger {
    /// The journal's events.
    events: Vec<Event>,
    verdicts: BTreeMap<CycleId, Verdict>,
    /// The verdict that the loop is about to write for a cycle; the events that led to the verdict are in the journal.
    decided: BTreeMap<CycleId, Verdict>,
    /// For each cycle, the number of waypoints of each contact path that may be sent.
    permitted: BTreeMap<CycleId, Vec<u32>>,
    findings: BTreeMap<CycleId, usize>,
    asked: BTreeMap<CycleId, usize>,
    /// For each cycle, the number of waypoints of the closed motions.
    done: BTreeMap<CycleId, u32>,
    /// The open motion, if there is one.
    open: Option<Motion>,
    /// The present cycle.
    pub cycle: Option<CycleId>,
    /// The last cycle that ever began, even if its store was replaced later.
    last: Option<CycleId>,
    /// The grids that the arm touched.
    pub touched: Touched,
    /// The file that also receives each acknowledgement, for a reader that continues after this process has ended.
    pub told_to: Option<Arc<File>>,
}

/// The data of a command that are needed when its answer arrives.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub enum CommandSummary {
    Event(Event),
    Verdict(Verdict),
    Decided(Verdict),
    Finding,
    Asked,
    Open(Motion),
    OpenContact(Motion, u32),
    Permit(u32),
    Close(u32),
    Between,
    Begin,
    Nothing,
}

/// Checks that no record has a verdict that is better than its worst finding, and checks the conditions of a pass
/// again.
fn check_verdict(record: &CycleRecord) -> Result<(), String> {
    if let Some(words) = record.verdict_contradictions().first() {
        return Err(words.clone());
    }
    let Some(judgement) = record.judgement.as_ref().filter(|judgement| judgement.verdict == Verdict::Pass) else {
        return Ok(());
    };
    let found = |index: usize| (record.findings[index].kind, record.findings[index].judgement.verdict);
    let decided = |index: usize| {
        record.asked.iter().any(|asked| {
            let decides = matches!(asked.wanted, RequestedAction::For(Request::Accept | Request::Unhold { .. }));
            decides && asked.answer == Some(Answer::Done) && asked.findings.is_some_and(|kept| kept > index as u64)
        })
    };
    for index in 0..record.findings.len() {
        let is_bad = match found(index) {
            (_, Verdict::Reject | Verdict::Invalid | Verdict::Aborted) => true,
            (_, Verdict::Review) => !decided(index),
            // The last finding is that of a film, or of the motion of an air-run.
            (_, Verdict::Fail) => index + 1 == record.findings.len(),
            (_, Verdict::Accept | Verdict::Pass) => false,
        };
        if is_bad {
            return Err(format!("{judgement:?} over the finding {:?}", found(index)));
        }
    }
    Ok(())
}

impl CommandSummary {
    /// Creates the summary of this command.
    pub fn from_command(command: &RecordCommand) -> Self {
        match command {
            RecordCommand::Event(event) => CommandSummary::Event(*event),
            RecordCommand::Conclude { verdict, .. } => CommandSummary::Verdict(*verdict),
            RecordCommand::Note(Note::Finding(_)) => CommandSummary::Finding,
            RecordCommand::Asked(_) => CommandSummary::Asked,
            RecordCommand::OpenIntent(motion) => CommandSummary::Open(*motion),
            RecordCommand::OpenContact { motion, permitted, .. } => {
                CommandSummary::OpenContact(*motion, *permitted)
            }
            RecordCommand::Permit(permitted) => CommandSummary::Permit(*permitted),
            RecordCommand::CloseIntent { done, .. } => CommandSummary::Close(*done),
            RecordCommand::BetweenCycles => CommandSummary::Between,
            RecordCommand::Begin(_) => CommandSummary::Begin,
            _ => CommandSummary::Nothing,
        }
    }
}

impl Ledger {
    /// Returns the last cycle that ever began.
    pub fn last(&self) -> Option<CycleId> {
        self.last
    }

    /// Records a command that the store has acknowledged.
    pub fn acknowledged(&mut self, told: CommandSummary, answer: &RecordAnswer) {
        let begun = if let RecordAnswer::Cycle(cycle) = answer { Some(*cycle) } else { None };
        self.record(told, begun);
    }

    /// Records the verdict that the loop is about to write.
    pub fn decided(&mut self, verdict: Verdict) {
        self.record(CommandSummary::Decided(verdict), None);
    }

    fn record(&mut self, told: CommandSummary, begun: Option<CycleId>) {
        if let Some(mut file) = self.told_to.as_deref() {
            let line = format!("{}\n", serde_json::to_string(&(told, begun)).expect("plain data"));
            file.write_all(line.as_bytes()).expect("a pipe that somebody reads");
        }
        self.apply(told, begun);
    }

    /// Records an acknowledgement that was read as a line of `told_to`.
    ///
    /// # Errors
    /// If the text is not a line of this file.
    pub fn take_line(&mut self, line: &str) -> Result<(), String> {
        let (told, begun) = serde_json::from_str(line).map_err(|error| format!("{line}: {error}"))?;
        self.apply(told, begun);
        Ok(())
    }

    fn apply(&mut self, reported: CommandSummary, begun: Option<CycleId>) {
        match (reported, self.cycle) {
            (CommandSummary::Event(event), _) => self.events.push(event),
            (CommandSummary::Verdict(verdict), Some(cycle)) => drop(self.verdicts.insert(cycle, verdict)),
            (CommandSummary::Decided(verdict), Some(cycle)) => drop(self.decided.insert(cycle, verdict)),
            (CommandSummary::Finding, Some(cycle)) => *self.findings.entry(cycle).or_default() += 1,
            (CommandSummary::Asked, Some(cycle)) => *self.asked.entry(cycle).or_default() += 1,
            (CommandSummary::Open(motion), _) => self.open = Some(motion),
            (CommandSummary::OpenContact(motion, permitted), cycle) => {
                self.open = Some(motion);
                if let Some(cycle) = cycle {
                    self.permitted.entry(cycle).or_default().push(permitted);
                }
            }
            (CommandSummary::Permit(permitted), Some(cycle)) => {
                if let Some(last) = self.permitted.entry(cycle).or_default().last_mut() {
                    *last = permitted;
                }
            }
            (CommandSummary::Close(done), cycle) => {
                self.open = None;
                if let Some(cycle) = cycle {
                    *self.done.entry(cycle).or_default() += done;
                }
            }
            (CommandSummary::Between, _) => self.cycle = None,
            (CommandSummary::Begin, _) => self.cycle = begun.or(self.cycle),
            _ => {}
        }
    }

    /// Starts on this store as a process would, and checks whether the store contains everything that was acknowledged.
    ///
    /// # Errors
    /// If the process cannot start, or the store is incomplete; the message states why or what is missing.
    pub fn check_start(&mut self, folder: &Path) -> Result<(), String> {
        let words = |error: StoreError| error.to_string();
        let mut store = Store::create(folder).map_err(words)?;
        let rested = store.recover().map_err(words)?;
        self.check(&store, &rested)?;
        self.cycle = store.open_cycles().map_err(words)?.pop();
        Ok(())
    }

    /// Records the beginning of a cycle; returns whether its number was never used before.
    pub fn is_new(&mut self, cycle: CycleId) -> bool {
        self.last.replace(cycle).is_none_or(|last| last < cycle)
    }

    /// Returns this ledger of an earlier store, which replaces the store of the later ledger; numbers continue above
    /// those of the replaced store.
    pub fn replaces(self, later: &mut Ledger) -> Self {
        let touched = self.touched.replaces(&later.touched);
        Ledger { told_to: later.told_to.take(), last: later.last, touched, ..self }
    }

    /// Returns a hash of the journal.
    pub fn trace(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.events.hash(&mut hasher);
        hasher.finish()
    }

    /// Checks, after a start, whether the store contains everything that was acknowledged, and the state of the cell.
    ///
    /// # Errors
    /// If the store is incomplete; the message states what is missing.
    pub fn check(&mut self, store: &Store, rested: &State) -> Result<(), String> {
        let words = |error: &dyn std::error::Error| error.to_string();
        if let Some(changed) = store.changed().first() {
            return Err(format!("the store calls itself changed: {changed}"));
        }
        let journal = store.journal().map_err(|error| words(&error))?;
        let same = journal.iter().zip(&self.events).take_while(|(kept, reported)| kept == reported).count();
        if same < self.events.len() {
            return Err(format!(
                "{} events were acknowledged; of the journal's {} only {same} agree",
                self.events.len(),
                journal.len()
            ));
        }
        if journal.len() > self.events.len() + 1 {
            return Err(format!(
                "{} events were acknowledged, the journal has {}",
                self.events.len(),
                journal.len()
            ));
        }
        self.events = journal;
        let at_rest = matches!(rested.at, At::Stopped | At::Aborted { .. });
        if !at_rest || (self.open.is_some() && rested.at == At::Stopped && rested.intent.is_some()) {
            return Err(format!("a start in {:?}, with the motion {:?}", rested.at, self.open));
        }
        let left = store.state().map_err(|error| words(&error))?;
        let may_run = left.facts.tool_may_run || left.facts.water_may_run;
        let is_aborted = matches!(left.at, At::Aborting { .. } | At::Aborted { .. } | At::Clearing { .. });
        if (may_run || is_aborted) && rested.at == At::Stopped {
            return Err(format!("a start in Stopped after {:?}, tool or water may run {may_run}", left.at));
        }
        let open = store.open_cycles().map_err(|error| words(&error))?;
        if open.len() > usize::from(left.job.running) {
            return Err(format!("cycles {open:?} have no end, running {}", left.job.running));
        }
        self.cycles(store)?;
        // A start keeps a verdict that was decided but not yet reported; a pass by a film resets the part's count.
        if let Some(last) = self.decided.keys().next_back() {
            let record = store.cycle(*last).map_err(|error| words(&error))?;
            let verdict = record.judgement.as_ref().map(|judgement| judgement.verdict);
            let has_film = record.findings.iter().any(|finding| finding.kind == Kind::Inspect);
            if has_film && verdict == Some(Verdict::Pass) {
                self.touched.has_result(*last);
            }
        }
        Ok(())
    }

    fn cycles(&self, store: &Store) -> Result<(), String> {
        let told =
            self.verdicts.keys().chain(self.findings.keys()).chain(self.done.keys()).chain(self.asked.keys());
        let told = told.chain(self.decided.keys()).chain(self.permitted.keys()).chain(self.touched.cycles());
        told.collect::<BTreeSet<_>>().into_iter().try_for_each(|cycle| {
            let record = store.cycle(*cycle).map_err(|error| error.to_string())?;
            self.check_cycle(*cycle, &record).map_err(|words| format!("cycle {cycle}: {words}"))
        })
    }

    /// Checks that the record of a cycle contains everything that was acknowledged for the cycle.
    fn check_cycle(&self, cycle: CycleId, record: &CycleRecord) -> Result<(), String> {
        let kept = record.judgement.as_ref().map(|judgement| judgement.verdict);
        if let Some(verdict) = self.verdicts.get(&cycle).filter(|verdict| kept != Some(**verdict)) {
            return Err(format!("it was concluded as {}, the store has {kept:?}", verdict.keyword()));
        }
        if let Some(verdict) = self.decided.get(&cycle).filter(|verdict| kept != Some(**verdict)) {
            return Err(format!("it was about to be concluded as {}, a start has {kept:?}", verdict.keyword()));
        }
        let paths = record.motions.iter().filter_map(|motion| motion.contact.as_ref());
        let may: Vec<u32> = paths.map(|contact| contact.permitted).collect();
        let permitted = self.permitted.get(&cycle).map_or(&[][..], Vec::as_slice);
        if may.len() < permitted.len() || may.iter().zip(permitted).any(|(may, reported)| may < reported) {
            return Err(format!("of its contact paths {permitted:?} were permitted, kept are {may:?}"));
        }
        if let Some(forgotten) = self.touched.unrecorded(cycle, record) {
            return Err(forgotten);
        }
        let done: u32 = record.motions.iter().map(|motion| motion.done).sum();
        let counts = [
            ("findings", record.findings.len(), self.findings.get(&cycle).copied()),
            ("waypoints of closed motions", done as usize, self.done.get(&cycle).map(|done| *done as usize)),
            ("requests", record.asked.len() + record.asked_before.len(), self.asked.get(&cycle).copied()),
        ];
        match counts.into_iter().find(|(_, kept, reported)| reported.is_some_and(|reported| *kept < reported)) {
            Some((what, kept, Some(reported))) => {
                Err(format!("{reported} {what} were acknowledged, {kept} are kept"))
            }
            _ => Ok(()),
        }
    }

    /// Checks, at the end of a world, that every verdict has its record and its page with the same content, that the
    /// store is as it was written, and that every cycle has an end.
    ///
    /// # Errors
    /// If one of these requirements is violated; the message describes the violation.
    pub fn close(&self, folder: &Path) -> Result<(), String> {
        let words = |error: &dyn std::error::Error| error.to_string();
        let verified = Store::verify(folder, true).map_err(|error| words(&error))?;
        if let Some(found) = verified.differences.first() {
            return Err(format!("the store does not verify: {found}"));
        }
        let store = Store::open(folder).map_err(|error| words(&error))?;
        self.cycles(&store)?;
        if let Some(open) = store.open_cycles().map_err(|error| words(&error))?.first() {
            return Err(format!("cycle {open} has no end"));
        }
        for cycle in store.ended_cycles().map_err(|error| words(&error))? {
            let record = store.cycle(cycle).map_err(|error| words(&error))?;
            check_verdict(&record).map_err(|words| format!("cycle {cycle}: {words}"))?;
            let beyond = |motion: &&MotionRecord| {
                motion.contact.as_ref().is_some_and(|contact| motion.done > contact.permitted)
            };
            if let Some(motion) = record.motions.iter().find(beyond) {
                return Err(format!("cycle {cycle} has a contact path beyond its permit: {motion:?}"));
            }
            let page = cycle_page(&record, &BTreeMap::new()).html();
            let Some(judgement) = &record.judgement else {
                return Err(format!("cycle {cycle} ended without a verdict"));
            };
            let word = judgement.verdict.keyword();
            // The page of a cycle that a person stopped states this.
            let is_stopped = judgement.verdict == Verdict::Aborted && page.contains("<b>stopped on request</b>");
            if !is_stopped && !page.contains(&format!("<b>{word}</b>")) {
                return Err(format!("the page of cycle {cycle} does not say {word}"));
            }
        }
        Ok(())
    }
}
