//! The journal: every event of the cycle's state table as one line of JSON, in order and without gaps.
//!
//! A line contains the first 16 digits of a hash of its own content and of the previous line. Therefore a changed,
//! missing or inserted line is detected when the journal is read. The lines are also part of the store's hash chain
//! (see `chain`).
//!
//! A checkpoint contains the state after one line of the journal, so that a start reads only the lines after it. It is
//! used only if the same program version wrote it, and the journal still contains its line.

use super::commit::{TransactionFailure, WriteTransaction};
use super::database::{JournalFold, Store, unix_ms};
use super::error::StoreError;
use panelprep_cell::cycle::{Event, Report, State};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::CycleId;
use rusqlite::{OptionalExtension, Row, params};

pub(super) const TABLES: &str = "
    CREATE TABLE journal (
        sequence INTEGER PRIMARY KEY,
        cycle_id INTEGER REFERENCES cycles (id),
        unix_ms INTEGER NOT NULL,
        event TEXT NOT NULL,
        chain TEXT NOT NULL
    ) STRICT;
    CREATE INDEX journal_by_cycle ON journal (cycle_id);
    CREATE TABLE checkpoints (
        sequence INTEGER PRIMARY KEY,
        journal_chain TEXT NOT NULL,
        program_version TEXT NOT NULL,
        folded TEXT NOT NULL
    ) STRICT;
";

/// A line of the journal.
struct Line {
    sequence: i64,
    cycle: Option<i64>,
    unix_ms: i64,
    event: String,
    chain: String,
}

impl Line {
    fn from_row(row: &Row<'_>) -> Result<Self, rusqlite::Error> {
        let (sequence, cycle, unix_ms) = (row.get(0)?, row.get(1)?, row.get(2)?);
        Ok(Line { sequence, cycle, unix_ms, event: row.get(3)?, chain: row.get(4)? })
    }

    fn chain_hash(&self, before: &str) -> String {
        let Line { sequence, cycle, unix_ms, event, .. } = self;
        content_hash(format!("{before} {sequence} {cycle:?} {unix_ms} {event}").as_bytes())[..16].to_owned()
    }
}

/// The hash in front of the first line.
const CHAIN_START: &str = "";

impl Store {
    /// Commits an event to the disk, and returns its sequence number, from 1. It must be called before the effects of
    /// the event are performed.
    ///
    /// # Errors
    /// If the event cannot be written. No further event is then written until the store is opened again.
    pub fn append(&mut self, event: &Event, cycle: Option<CycleId>) -> Result<u64, StoreError> {
        self.require_writable()?;
        if self.is_journal_in_doubt {
            return Err(StoreError::JournalInDoubt { path: self.path().to_owned() });
        }
        let unix_ms = unix_ms(self.clock());
        let text = serde_json::to_string(event).map_err(|error| self.journal_problem(0, error.to_string()))?;
        let number = cycle.map(|id| id.0);
        let line = Line { sequence: 0, cycle: number, unix_ms, event: text, chain: String::new() };
        // The new state is computed on a copy: if the write fails, the state in memory must still be that of the lines
        // on the disk.
        let folded = self.folded_state.clone().map(|mut folded| {
            folded.step(*event, cycle);
            folded
        });
        let checkpoint = folded.as_ref().map(|folded| self.text(folded)).transpose()?;
        let written =
            self.commit("write the journal of", |writing| write_line(writing, &line, checkpoint.as_deref()));
        // If the disk is full, nothing was written. After any other error, it is unknown whether the line was written.
        self.is_journal_in_doubt = matches!(&written, Err(error) if !matches!(error, StoreError::Full { .. }));
        if written.is_ok() {
            self.folded_state = folded;
        }
        written
    }

    /// Returns all events, in order.
    ///
    /// # Errors
    /// If the journal cannot be read, or a line was changed.
    pub fn journal(&self) -> Result<Vec<Event>, StoreError> {
        let mut events = Vec::new();
        self.for_each_event((0, CHAIN_START.to_owned()), |event, _| events.push(event))?;
        Ok(events)
    }

    /// Computes the state at the start of a program from the journal; the state is at rest, Aborted or Stopped. First,
    /// the rows of motions and cycles that the last process could not write after its last event are written. If
    /// another program has changed the store, this is one more event, and the state is Aborted until a person clears
    /// it.
    ///
    /// # Errors
    /// If the journal cannot be read, a line was changed, or a motion is open that the journal does not contain.
    pub fn recover(&mut self) -> Result<State, StoreError> {
        let (settled, last, tail) = self.fold_from_checkpoint()?;
        // The missing rows of the last process are written first, because the new event may refer to them.
        self.write_missing_rows(&settled)?;
        if self.require_writable().is_ok() {
            if tail > MAX_LINES_WITHOUT_CHECKPOINT {
                let told = self.text(&settled)?;
                self.commit("write a checkpoint to", |writing| {
                    write_checkpoint(writing, (last.0, &last.1), &told)
                })?;
            }
            self.folded_state = Some(settled.clone());
            if !std::mem::replace(&mut self.is_change_recorded, true) && !self.external_changes.is_empty() {
                self.append(&Event::Reported(Report::StoreChanged), None)?;
            }
        }
        Ok(self.folded_state.as_ref().unwrap_or(&settled).after_restart())
    }

    /// Returns the state after the last line of the journal, before a restart of the program.
    ///
    /// # Errors
    /// The errors of [`Store::recover`].
    pub fn state(&self) -> Result<State, StoreError> {
        match &self.folded_state {
            Some(folded) => Ok(folded.state()),
            None => Ok(self.fold_from_checkpoint()?.0.state()),
        }
    }

    /// Returns the number of lines in the journal.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn lines(&self) -> Result<i64, StoreError> {
        let last =
            self.connection.query_row("SELECT coalesce(max(sequence), 0) FROM journal", [], |row| row.get(0));
        last.map_err(|error| self.database_error("read the journal of", &error))
    }

    /// Computes the state from the last checkpoint and the lines after it. Returns the state, the last line, and the
    /// number of lines read.
    fn fold_from_checkpoint(&self) -> Result<(JournalFold, (i64, String), i64), StoreError> {
        let (mut settled, from) = match self.checkpoint()? {
            Some(checkpoint) => (checkpoint.settled, (checkpoint.sequence, checkpoint.journal_chain)),
            None => (JournalFold::INITIAL, (0, CHAIN_START.to_owned())),
        };
        let first = from.0;
        let last = self.for_each_event(from, |event, cycle| settled.step(event, cycle))?;
        let tail = last.0 - first;
        Ok((settled, last, tail))
    }

    /// Calls `each` with each event after a line, and with its cycle, in order; only one line at a time is in memory.
    /// Returns the number and the hash of the last line.
    fn for_each_event(
        &self,
        (after, mut before): (i64, String),
        mut each: impl FnMut(Event, Option<CycleId>),
    ) -> Result<(i64, String), StoreError> {
        let failed = |error: rusqlite::Error| self.database_error("read the journal of", &error);
        let mut lines = self
            .connection
            .prepare(
                "SELECT sequence, cycle_id, unix_ms, event, chain FROM journal WHERE sequence > ?1 ORDER BY sequence",
            )
            .map_err(failed)?;
        let mut expected = after + 1;
        for line in lines.query_map([after], Line::from_row).map_err(failed)? {
            let line = line.map_err(failed)?;
            // Without this check, a missing line would lead to another state without an error.
            if line.sequence != expected {
                return Err(self.journal_problem(
                    expected,
                    format!("the line is missing; the next line is {}", line.sequence),
                ));
            }
            if line.chain_hash(&before) != line.chain {
                return Err(self.journal_problem(expected, "the line differs from what was written".to_owned()));
            }
            let event = serde_json::from_str(&line.event);
            each(
                event.map_err(|error| self.journal_problem(expected, error.to_string()))?,
                line.cycle.map(CycleId),
            );
            (before, expected) = (line.chain, expected + 1);
        }
        Ok((expected - 1, before))
    }

    pub(super) fn journal_problem(&self, sequence: i64, problem: String) -> StoreError {
        StoreError::DamagedJournal { path: self.path().to_owned(), sequence, problem }
    }
}

/// Writes many lines at once, like a store after years of operation.
#[cfg(test)]
pub(super) fn fill(store: &mut Store, lines: u32) -> Result<(), StoreError> {
    let line = |done| Line {
        sequence: 0,
        cycle: None,
        unix_ms: 1_795_297_432_000 + i64::from(done),
        event: format!("{{\"told\":{{\"progress\":{{\"id\":18446744073709551614,\"done\":{done}}}}}}}"),
        chain: String::new(),
    };
    store.commit("fill", |writing| (0..lines).try_for_each(|done| write_line(writing, &line(done), None).map(drop)))
}

/// Writes a line after the last one, and a checkpoint if one is due. `folded` is the state after the line.
fn write_line(
    writing: &mut WriteTransaction<'_>,
    line: &Line,
    folded: Option<&str>,
) -> Result<u64, TransactionFailure> {
    let last: Option<(i64, String)> = writing
        .prepare_cached("SELECT sequence, chain FROM journal ORDER BY sequence DESC LIMIT 1")?
        .query_row([], |row| Ok((row.get(0)?, row.get(1)?)))
        .optional()?;
    let (sequence, before) = last.unwrap_or((0, CHAIN_START.to_owned()));
    let line = Line { sequence: sequence + 1, event: line.event.clone(), chain: String::new(), ..*line };
    let chain = line.chain_hash(&before);
    writing
        .prepare_cached(
            "INSERT INTO journal (sequence, cycle_id, unix_ms, event, chain) VALUES (?1, ?2, ?3, ?4, ?5)",
        )?
        .execute(params![line.sequence, line.cycle, line.unix_ms, line.event, chain])?;
    writing.chain("journal", line.sequence)?;
    if let (0, Some(folded)) = (line.sequence % CHECKPOINT_INTERVAL, folded) {
        write_checkpoint(writing, (line.sequence, &chain), folded)?;
    }
    Ok(line.sequence as u64)
}

/// Number of journal lines between two checkpoints.
const CHECKPOINT_INTERVAL: i64 = 10_000;
/// Maximum number of lines that a start may read without writing a checkpoint.
const MAX_LINES_WITHOUT_CHECKPOINT: i64 = 2_000;

/// A checkpoint: a line of the journal, and the state after it.
pub(super) struct Checkpoint {
    pub sequence: i64,
    pub journal_chain: String,
    pub settled: JournalFold,
}

/// Writes a checkpoint after this line.
fn write_checkpoint(
    writing: &mut WriteTransaction<'_>,
    (sequence, journal_chain): (i64, &str),
    folded: &str,
) -> Result<(), TransactionFailure> {
    writing.execute(
        "INSERT OR IGNORE INTO checkpoints (sequence, journal_chain, program_version, folded) VALUES (?1, ?2, ?3, ?4)",
        params![sequence, journal_chain, env!("CARGO_PKG_VERSION"), folded],
    )?;
    if writing.changes() == 1 { writing.chain("checkpoints", sequence) } else { Ok(()) }
}

impl Store {
    /// Returns the newest checkpoint that this program version can use.
    pub(super) fn checkpoint(&self) -> Result<Option<Checkpoint>, StoreError> {
        let sql = "SELECT c.sequence, c.journal_chain, c.folded FROM checkpoints c JOIN journal j
                ON j.sequence = c.sequence AND j.chain = c.journal_chain
             WHERE c.program_version = ?1 ORDER BY c.sequence DESC LIMIT 1";
        let found = self
            .connection
            .query_row(sql, [env!("CARGO_PKG_VERSION")], |row| {
                Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?, row.get::<_, String>(2)?))
            })
            .optional()
            .map_err(|error| self.database_error("read a checkpoint of", &error))?;
        // A checkpoint that cannot be parsed is ignored; the state is then computed from the first line.
        Ok(found.and_then(|(sequence, journal_chain, folded)| {
            let settled = serde_json::from_str(&folded).ok()?;
            Some(Checkpoint { sequence, journal_chain, settled })
        }))
    }
}
