//! The journal: every event of the table, one JSON line each, in order and without gaps.
//!
//! A line carries the first 16 digits of a hash over its own content and that of the line before. A line that was
//! changed, lost or put in is found when the journal is read.

use super::error::StoreError;
use super::{Store, now};
use crate::cycle::{Event, State};
use crate::files::content_hash;
use crate::record::CycleId;
use rusqlite::{OptionalExtension, Row, TransactionBehavior, params};

pub(super) const TABLES: &str = "
    CREATE TABLE journal (
        sequence INTEGER PRIMARY KEY,
        cycle_id INTEGER REFERENCES cycles (id),
        unix_ms INTEGER NOT NULL,
        event TEXT NOT NULL,
        chain TEXT NOT NULL
    ) STRICT;
    CREATE INDEX journal_by_cycle ON journal (cycle_id);
";

/// One line.
struct Line {
    sequence: i64,
    cycle: Option<i64>,
    unix_ms: i64,
    event: String,
    chain: String,
}

impl Line {
    fn of(row: &Row<'_>) -> Result<Self, rusqlite::Error> {
        let (sequence, cycle, unix_ms) = (row.get(0)?, row.get(1)?, row.get(2)?);
        Ok(Line { sequence, cycle, unix_ms, event: row.get(3)?, chain: row.get(4)? })
    }

    fn chained(&self, before: &str) -> String {
        let Line { sequence, cycle, unix_ms, event, .. } = self;
        content_hash(format!("{before} {sequence} {cycle:?} {unix_ms} {event}").as_bytes())[..16].to_owned()
    }
}

/// The chain before the first line.
const BEGIN: &str = "";

impl Store {
    /// Commits an event to the disk and answers its sequence number, from 1. To be called before the event's effects.
    ///
    /// # Errors
    /// Where it cannot be written. Then nothing more is appended until the store is opened anew.
    pub fn append(&mut self, event: &Event, cycle: Option<CycleId>) -> Result<u64, StoreError> {
        self.writable()?;
        if self.journal_in_doubt {
            return Err(StoreError::JournalInDoubt { path: self.path().to_owned() });
        }
        let unix_ms = now()?.as_millis() as i64;
        let event = serde_json::to_string(event).map_err(|error| self.journal_problem(0, error.to_string()))?;
        let cycle = cycle.map(|id| id.0);
        let line = Line { sequence: 0, cycle, unix_ms, event, chain: String::new() };
        let written = self.write_line(line);
        self.journal_in_doubt = written.is_err();
        written.map_err(|error| self.failed("write the journal of", &error))
    }

    fn write_line(&mut self, mut line: Line) -> Result<u64, rusqlite::Error> {
        let transaction = self.connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let last: Option<(i64, String)> = transaction
            .prepare_cached("SELECT sequence, chain FROM journal ORDER BY sequence DESC LIMIT 1")?
            .query_row([], |row| Ok((row.get(0)?, row.get(1)?)))
            .optional()?;
        let (sequence, before) = last.unwrap_or((0, BEGIN.to_owned()));
        line.sequence = sequence + 1;
        line.chain = line.chained(&before);
        transaction
            .prepare_cached(
                "INSERT INTO journal (sequence, cycle_id, unix_ms, event, chain) VALUES (?1, ?2, ?3, ?4, ?5)",
            )?
            .execute(params![line.sequence, line.cycle, line.unix_ms, line.event, line.chain])?;
        transaction.commit()?;
        Ok(line.sequence as u64)
    }

    /// Every event so far, in order.
    ///
    /// # Errors
    /// Where it cannot be read, or a line is not what was written.
    pub fn journal(&self) -> Result<Vec<Event>, StoreError> {
        let mut events = Vec::new();
        self.each_event(|event, _| events.push(event))?;
        Ok(events)
    }

    /// Where a program starts that has this store: what the journal folds to, then at rest, Aborted or Stopped. Rows of
    /// motions and cycles that the last process did not come to write after its last event are written first.
    ///
    /// # Errors
    /// Where the journal cannot be read, a line is not what was written, or a motion is open that it does not know.
    pub fn recover(&mut self) -> Result<State, StoreError> {
        let mut settled = super::motions::Settled::NEW;
        self.each_event(|event, cycle| settled.step(event, cycle))?;
        self.settle(&settled)?;
        Ok(settled.rested())
    }

    /// Calls with each event and its cycle, in order, and holds one line at a time.
    fn each_event(&self, mut each: impl FnMut(Event, Option<CycleId>)) -> Result<(), StoreError> {
        let failed = |error: rusqlite::Error| self.failed("read the journal of", &error);
        let mut lines = self
            .connection
            .prepare("SELECT sequence, cycle_id, unix_ms, event, chain FROM journal ORDER BY sequence")
            .map_err(failed)?;
        let mut before = BEGIN.to_owned();
        let mut expected = 1;
        for line in lines.query_map([], Line::of).map_err(failed)? {
            let line = line.map_err(failed)?;
            if line.sequence != expected {
                return Err(self.journal_problem(expected, format!("the next line is {}", line.sequence)));
            }
            if line.chained(&before) != line.chain {
                return Err(self.journal_problem(expected, "it is not what was written".to_owned()));
            }
            let event = serde_json::from_str(&line.event);
            each(
                event.map_err(|error| self.journal_problem(expected, error.to_string()))?,
                line.cycle.map(CycleId),
            );
            (before, expected) = (line.chain, expected + 1);
        }
        Ok(())
    }

    pub(super) fn journal_problem(&self, sequence: i64, problem: String) -> StoreError {
        StoreError::DamagedJournal { path: self.path().to_owned(), sequence, problem }
    }
}
