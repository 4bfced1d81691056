//! Motion intents: committed before the first waypoint is sent, closed when the robot has reported standstill.
//!
//! The journal implies the same, since intents are effects of its events. If a process ends between an event and
//! its effects, a row is missing; the next process writes it from the journal.

use super::database::{JournalFold, Store};
use super::error::StoreError;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{Motion, Outcome, Path};
use panelprep_cell::record::{ContactPath, CycleId, MotionRecord};
use rusqlite::{OptionalExtension, Row, params};

/// `one_open_motion` holds at most one row: a second motion is refused by the database itself.
pub(super) const TABLES: &str = "
    CREATE TABLE motions (
        id INTEGER PRIMARY KEY,
        cycle_id INTEGER REFERENCES cycles (id),
        motion TEXT NOT NULL,
        outcome TEXT,
        done INTEGER NOT NULL DEFAULT 0
    ) STRICT;
    CREATE UNIQUE INDEX one_open_motion ON motions ((outcome IS NULL)) WHERE outcome IS NULL;
    CREATE INDEX motions_by_cycle ON motions (cycle_id);
";

impl Store {
    /// Commits that this motion may begin.
    ///
    /// # Errors
    /// If it cannot be written, or a motion is open already.
    pub fn open_intent(&mut self, motion: &Motion, cycle: Option<CycleId>) -> Result<(), StoreError> {
        self.require_writable()?;
        let text = self.text(motion)?;
        self.commit("write a motion to", |writing| {
            writing.execute(
                "INSERT INTO motions (cycle_id, motion) VALUES (?1, ?2)",
                params![cycle.map(|id| id.0), text],
            )?;
            writing.chain("motions", writing.last_insert_rowid())
        })
    }

    /// Commits how the open motion ended, with the waypoints that the robot executed.
    ///
    /// # Errors
    /// If it cannot be written, or this motion is not the open one.
    pub fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), StoreError> {
        self.require_writable()?;
        let (text, outcome) = (self.text(motion)?, self.text(&outcome)?);
        self.commit("write a motion to", |writing| {
            let sql =
                "UPDATE motions SET outcome = ?2, done = ?3 WHERE outcome IS NULL AND motion = ?1 RETURNING id";
            let closed = writing.query_row(sql, params![text, outcome, done], |row| row.get(0)).optional()?;
            match closed {
                Some(id) => writing.chain("motion_ends", id),
                None => Err(StoreError::MotionNotOpen { motion: text.clone() }.into()),
            }
        })
    }

    /// Returns whether a motion is open: a person must clear it before anything moves. The answer is that of the last
    /// [`Store::recover`].
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn has_open_motion(&self) -> Result<bool, StoreError> {
        Ok(self.open_motion()?.is_some())
    }

    fn open_motion(&self) -> Result<Option<Motion>, StoreError> {
        let open = self
            .connection
            .query_row("SELECT motion, outcome, done FROM motions WHERE outcome IS NULL", [], texts)
            .optional()
            .map_err(|error| self.database_error("read the motions of", &error))?;
        Ok(open.map(|row| self.motion(&row)).transpose()?.map(|record| record.motion))
    }

    /// Writes the rows that the last process did not write: the effects of its last event.
    pub(super) fn write_missing_rows(&mut self, settled: &JournalFold) -> Result<(), StoreError> {
        let expected = settled.state.intent.map(|intent| intent.motion);
        let mut open = self.open_motion()?;
        if let Some(motion) = open.filter(|motion| Some(*motion) != expected) {
            let closed = settled.closed.filter(|(closed, ..)| *closed == motion);
            // If lines of the journal were removed, a person ends the motion, with the clear that the store then
            // requires.
            let cleared = (!self.external_changes.is_empty()).then_some((motion, Outcome::Cleared, 0));
            let Some((_, outcome, done)) = closed.or(cleared) else {
                return Err(self.journal_problem(
                    0,
                    format!("the journal does not contain the open motion {}", self.text(&motion)?),
                ));
            };
            self.close_intent(&motion, outcome, done)?;
            open = None;
        }
        if let (Some(motion), None) = (expected, open) {
            match settled.state.intent.map(|intent| intent.id) {
                // The program ended before it permitted any waypoint of the path.
                Some(id) if motion.path == Path::Contact => {
                    let nothing = ContactPath { id, pass: settled.state.job.pass, grids: vec![], wears_mm2: 0.0 };
                    self.open_contact(&motion, settled.cycle, (&nothing, 0))?;
                }
                _ => self.open_intent(&motion, settled.cycle)?,
            }
        }
        // A cycle that still runs according to the state machine is concluded by the Boot event that follows.
        let mut over = self.open_cycles()?;
        if settled.state.job.running {
            over.pop();
        }
        for id in over {
            let conclusion = settled.concluded.filter(|(cycle, _)| *cycle == Some(id));
            let judgement = Judgement {
                verdict: conclusion.map_or(Verdict::Aborted, |(_, verdict)| verdict),
                reasons: vec![Reason::new(
                    "interrupted",
                    "the program ended before it could record the cycle's end",
                )],
            };
            self.conclude(id, judgement.verdict, &judgement.reasons)?;
        }
        Ok(())
    }

    pub(super) fn motion(&self, (motion, outcome, done): &StoredMotionTexts) -> Result<MotionRecord, StoreError> {
        let outcome = outcome.as_deref().map(|text| self.parse_stored(text)).transpose()?;
        Ok(MotionRecord { motion: self.parse_stored(motion)?, outcome, done: *done, contact: None })
    }
}

/// A motion, its outcome and its number of executed waypoints, as stored.
pub(super) type StoredMotionTexts = (String, Option<String>, u32);

pub(super) fn texts(row: &Row<'_>) -> Result<StoredMotionTexts, rusqlite::Error> {
    Ok((row.get(0)?, row.get(1)?, row.get(2)?))
}
