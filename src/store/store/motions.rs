//! Motions: their intents and their contact paths.
//!
//! An intent is committed before the first waypoint is sent, and closed after the robot has reported standstill. The
//! journal contains the same information, because intents are effects of its events. If a process ends between an event
//! and its effects, a row is missing; the next process writes it from the journal.
//!
//! The grids of a contact path are committed with its motion, and the number of permitted waypoints is committed before
//! these waypoints are sent. Therefore, after any end of the motion, the rows show which grids were sanded, or may have
//! been. The disc wears: the area that it has swept is stored for each path, and so is the time at which a new disc was
//! mounted.

use super::cycles::normalised_serial;
use super::database::{JournalFold, Store, unix_ms};
use super::error::StoreError;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{Event, Id, Motion, Outcome, Path, Report};
use panelprep_cell::record::{
    ANOTHER_PART_TEXT, AbradedGrid, Clock, Contact, ContactPath, CycleId, EarlierPass, Finding, Kind, MotionRecord,
    RecordingFile, abraded_grids,
};
use rusqlite::{OptionalExtension, Row, params};
use serde::Serialize;
use std::collections::BTreeSet;

/// The unique index `one_open_motion` permits at most one open motion, so that the database itself refuses a second
/// one. `cycle_facts` holds named facts of a cycle that are stored nowhere else: its clock, the file of its recording. A
/// row of `discs` is the area swept by one path, or a new disc with the area 0.
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
    CREATE TABLE contacts (
        id INTEGER PRIMARY KEY,
        motion_id INTEGER NOT NULL UNIQUE REFERENCES motions (id),
        path TEXT NOT NULL
    ) STRICT;
    CREATE TABLE permits (
        id INTEGER PRIMARY KEY,
        motion_id INTEGER NOT NULL REFERENCES motions (id),
        unix_ms INTEGER NOT NULL,
        waypoints INTEGER NOT NULL
    ) STRICT;
    CREATE INDEX permits_by_motion ON permits (motion_id);
    CREATE TABLE cycle_facts (
        id INTEGER PRIMARY KEY,
        cycle_id INTEGER NOT NULL REFERENCES cycles (id),
        name TEXT NOT NULL,
        fact TEXT NOT NULL
    ) STRICT;
    CREATE INDEX cycle_facts_by_cycle ON cycle_facts (cycle_id);
    CREATE TABLE discs (
        id INTEGER PRIMARY KEY,
        cycle_id INTEGER REFERENCES cycles (id),
        at_unix_s INTEGER NOT NULL,
        is_new INTEGER NOT NULL,
        swept_mm2 REAL NOT NULL
    ) STRICT;
";

/// What a cycle shows about a change of the part in the cell.
#[derive(Debug, Clone, Copy)]
struct PartChangeEvidence {
    /// Whether the cycle passed with a film; the part is then removed from the cell.
    passes: bool,
    /// Whether the cycle failed with a film.
    fails: bool,
    /// Whether the start request stated that a different part is in the fixture.
    is_other_part: bool,
}

const CLOCK: &str = "clock";
const RECORDING: &str = "recording";

const INSERT_PERMIT_SQL: &str = "INSERT INTO permits (motion_id, unix_ms, waypoints) VALUES (?1, ?2, ?3)";

impl Store {
    /// Commits that this motion may begin.
    ///
    /// # Errors
    /// If the intent cannot be written, or a motion is already open.
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

    /// Commits the outcome of the open motion, and the number of waypoints that the robot executed.
    ///
    /// # Errors
    /// If the outcome cannot be written, or another motion or no motion is open.
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

    /// Returns whether a motion is open, which a person must clear before any other motion. Rows that the next
    /// [`Store::recover`] will write are not considered.
    ///
    /// # Errors
    /// If the motions cannot be read.
    pub fn has_open_motion(&self) -> Result<bool, StoreError> {
        Ok(self.open_motion()?.is_some())
    }

    fn open_motion(&self) -> Result<Option<Motion>, StoreError> {
        let open = self
            .connection
            .query_row("SELECT motion, outcome, done FROM motions WHERE outcome IS NULL", [], motion_texts)
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
            // If lines of the journal are missing, the outcome of the motion is Cleared, because a person must then
            // clear the cell.
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
                // The program ended before a waypoint of the path was permitted.
                Some(id) if motion.path == Path::Contact => {
                    let nothing = ContactPath { id, pass: settled.state.job.pass, grids: vec![], wears_mm2: 0.0 };
                    self.open_contact(&motion, settled.cycle, (&nothing, 0))?;
                }
                _ => self.open_intent(&motion, settled.cycle)?,
            }
        }
        // A cycle that is still in progress according to the state table is concluded by the event Boot that follows.
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

    /// Commits in one transaction that a motion in contact may begin, its contact path, and the number of permitted
    /// waypoints.
    ///
    /// # Errors
    /// If the rows cannot be written, or a motion is already open.
    pub fn open_contact(
        &mut self,
        motion: &Motion,
        cycle: Option<CycleId>,
        (path, permitted): (&ContactPath, u32),
    ) -> Result<(), StoreError> {
        self.require_writable()?;
        let (motion, path, unix_ms) = (self.text(motion)?, self.text(path)?, unix_ms(self.clock()));
        self.commit("write a motion to", |writing| {
            let cycle = cycle.map(|id| id.0);
            writing.execute("INSERT INTO motions (cycle_id, motion) VALUES (?1, ?2)", params![cycle, motion])?;
            let id = writing.last_insert_rowid();
            writing.chain("motions", id)?;
            writing.execute("INSERT INTO contacts (motion_id, path) VALUES (?1, ?2)", params![id, path])?;
            writing.chain("contacts", writing.last_insert_rowid())?;
            writing.execute(INSERT_PERMIT_SQL, params![id, unix_ms, permitted])?;
            writing.chain("permits", writing.last_insert_rowid())
        })
    }

    /// Commits the number of permitted waypoints of the open motion.
    ///
    /// # Errors
    /// If the number cannot be written, or no motion is open.
    pub fn store_permit(&mut self, waypoints: u32) -> Result<(), StoreError> {
        self.require_writable()?;
        let open = self
            .connection
            .query_row("SELECT id FROM motions WHERE outcome IS NULL", [], |row| row.get::<_, i64>(0))
            .optional()
            .map_err(|error| self.database_error("read the motions of", &error))?;
        let Some(open) = open else {
            return Err(StoreError::MotionNotOpen {
                motion: "motion for which waypoints can be permitted".to_owned(),
            });
        };
        let unix_ms = unix_ms(self.clock());
        self.commit("write a motion to", |writing| {
            writing.execute(INSERT_PERMIT_SQL, params![open, unix_ms, waypoints])?;
            writing.chain("permits", writing.last_insert_rowid())
        })
    }

    /// Returns the contact path of the motion in this row.
    fn contact_of_motion(&self, cycle: CycleId, motion_row: i64) -> Result<Option<Contact>, StoreError> {
        let read = || -> Result<Option<(String, u32)>, rusqlite::Error> {
            let sql = "SELECT path, (SELECT coalesce(max(waypoints), 0) FROM permits WHERE motion_id = ?1)
                FROM contacts WHERE motion_id = ?1";
            self.connection.query_row(sql, [motion_row], |row| Ok((row.get(0)?, row.get(1)?))).optional()
        };
        let row = read().map_err(|error| self.database_error("read the motions of", &error))?;
        let Some((text, permitted)) = row else { return Ok(None) };
        let path: ContactPath = self.parse_stored(&text)?;
        let told = self.reported_waypoints(cycle, path.id)?;
        Ok(Some(Contact { path, told, permitted }))
    }

    /// Returns the number of executed waypoints that the robot reported for this action, according to the journal.
    fn reported_waypoints(&self, cycle: CycleId, act: Id) -> Result<u32, StoreError> {
        let read = || -> Result<Vec<String>, rusqlite::Error> {
            let sql = "SELECT event FROM journal WHERE cycle_id = ?1 AND event LIKE '{\"told\":{\"progress\":%'";
            self.connection.prepare(sql)?.query_map([cycle.0], |row| row.get(0))?.collect()
        };
        let mut reported = 0;
        for text in read().map_err(|error| self.database_error("read the journal of", &error))? {
            if let Event::Reported(Report::Progress { id, done }) = self.parse_stored(&text)?
                && id == act
            {
                reported = reported.max(done);
            }
        }
        Ok(reported)
    }

    /// Returns the contacts, certain or possible, between the tool and the part of this cycle in earlier cycles.
    /// Considered are cycles with the same serial number and cycles without one, back to these ends:
    ///
    /// - A cycle of this part that passed with a film: the part was then removed from the cell.
    /// - For cycles without a serial number, also a start request that stated a different part. Such a statement is no
    ///   end for a serial number, which identifies a part.
    /// - For a part with a serial number, also a cycle of this part that failed with a film. Without a serial number, a
    ///   failed film does not show that the next part is different.
    ///
    /// An air-run, an abort, a reject and a part with another serial number are no ends. Passes that a person stated
    /// after a restore are included.
    ///
    /// # Errors
    /// If the cycles cannot be read.
    pub fn earlier_abrasions(&self, id: CycleId) -> Result<Vec<EarlierPass>, StoreError> {
        let mut earlier: Vec<EarlierPass> = Vec::new();
        for cycle in self.earlier_cycles_of_part(id)? {
            let (findings, motions) = (self.cycle_findings(cycle)?, self.cycle_motions(cycle)?);
            for AbradedGrid { grid, pass, how } in abraded_grids(&findings, &motions) {
                let is_known =
                    |known: &&mut EarlierPass| (known.cycle, known.pass, &known.grid) == (cycle, pass, &grid);
                match earlier.iter_mut().find(is_known) {
                    Some(known) => known.is_sure |= how.is_certain(),
                    None => {
                        earlier.push(EarlierPass {
                            cycle,
                            pass,
                            grid,
                            is_sure: how.is_certain(),
                            is_stated: false,
                        });
                    }
                }
            }
            earlier.extend(self.stated_passes(cycle)?);
        }
        earlier.extend(self.stated_passes(id)?);
        Ok(earlier)
    }

    /// Returns the passes in lost cycles that the start request of this cycle stated.
    fn stated_passes(&self, cycle: CycleId) -> Result<impl Iterator<Item = EarlierPass> + use<>, StoreError> {
        let passes = self.lost_passes(cycle)?;
        let stated = move |pass| EarlierPass { cycle, pass, grid: None, is_sure: true, is_stated: true };
        Ok((1..=passes).map(stated))
    }

    /// Returns the earlier cycles that may have had the same part as this cycle, in order.
    fn earlier_cycles_of_part(&self, id: CycleId) -> Result<Vec<CycleId>, StoreError> {
        let failed = |error: rusqlite::Error| self.database_error("read the cycles of", &error);
        let read = || -> Result<Vec<(i64, String)>, rusqlite::Error> {
            let sql = "SELECT cycles.id, coalesce(serial, '') FROM cycles LEFT JOIN cycle_parts ON cycle_id = cycles.id
                 WHERE panel = (SELECT panel FROM cycles WHERE id = ?1) AND cycles.id <= ?1 ORDER BY cycles.id DESC";
            let mut statement = self.connection.prepare_cached(sql)?;
            statement.query_map([id.0], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        let mut cycles = read().map_err(failed)?.into_iter().map(|(id, serial)| (id, normalised_serial(&serial)));
        let Some((own, serial)) = cycles.next() else { return Ok(Vec::new()) };
        // Serial numbers of parts that cannot be this part in still earlier cycles; the empty text is a part without a
        // serial number.
        let (mut over, mut found) = (BTreeSet::new(), Vec::new());
        if self.part_change_evidence(own).map_err(failed)?.is_other_part {
            if serial.is_empty() {
                return Ok(found);
            }
            over.insert(String::new());
        }
        for (cycle, part_serial) in cycles {
            let may_be_it = serial.is_empty() || part_serial.is_empty() || part_serial == serial;
            if !may_be_it || over.contains(&part_serial) {
                continue;
            }
            let PartChangeEvidence { passes, fails, is_other_part: is_another } =
                self.part_change_evidence(cycle).map_err(failed)?;
            let is_over = passes || (fails && !serial.is_empty() && part_serial == serial);
            if !is_over {
                found.push(CycleId(cycle));
            }
            // A start request without a serial number stated a different part: all earlier parts without a serial
            // number are different from this part.
            if is_another && serial.is_empty() && part_serial.is_empty() {
                break;
            }
            // A start request with a serial number stated a different part: only earlier parts without a serial number
            // are different.
            if is_another && (part_serial.is_empty() || part_serial == serial) {
                over.insert(String::new());
            }
            if is_over {
                over.insert(part_serial);
            }
            if over.contains(&serial) && over.contains("") {
                break;
            }
        }
        found.reverse();
        Ok(found)
    }

    fn part_change_evidence(&self, cycle: i64) -> Result<PartChangeEvidence, rusqlite::Error> {
        let sql = "SELECT coalesce(verdict = ?2, 0) AND has_film, coalesce(verdict = ?3, 0) AND has_film, is_another FROM (
                 SELECT verdict, EXISTS (SELECT 1 FROM findings WHERE cycle_id = cycles.id AND kind = ?4) AS has_film,
                     EXISTS (SELECT 1 FROM json_each(files) WHERE value ->> 'name' = ?5) AS is_another
                 FROM cycles WHERE id = ?1
             )";
        let (pass, fail, film) = (Verdict::Pass.keyword(), Verdict::Fail.keyword(), Kind::Inspect.keyword());
        let ends = |row: &rusqlite::Row<'_>| {
            Ok(PartChangeEvidence { passes: row.get(0)?, fails: row.get(1)?, is_other_part: row.get(2)? })
        };
        self.connection.prepare_cached(sql)?.query_row(params![cycle, pass, fail, film, ANOTHER_PART_TEXT], ends)
    }

    /// Stores the clock of a cycle at its start or at its end.
    ///
    /// # Errors
    /// If the clock cannot be written.
    pub fn store_clock(&mut self, id: CycleId, clock: Clock) -> Result<(), StoreError> {
        self.store_fact(id, CLOCK, &clock)
    }

    /// Stores the name of the file with the recording of a cycle.
    ///
    /// # Errors
    /// If the name cannot be written.
    pub fn store_recording(&mut self, id: CycleId, file: &RecordingFile) -> Result<(), StoreError> {
        self.store_fact(id, RECORDING, file)
    }

    fn store_fact(&mut self, id: CycleId, name: &str, fact: &impl Serialize) -> Result<(), StoreError> {
        self.require_writable()?;
        let fact = self.text(fact)?;
        self.commit("write a cycle to", |writing| {
            let sql = "INSERT INTO cycle_facts (cycle_id, name, fact) VALUES (?1, ?2, ?3)";
            writing.execute(sql, params![id.0, name, fact])?;
            writing.chain("cycle_facts", writing.last_insert_rowid())
        })
    }

    fn facts(&self, id: CycleId, name: &str) -> Result<Vec<String>, StoreError> {
        let read = || -> Result<Vec<String>, rusqlite::Error> {
            let sql = "SELECT fact FROM cycle_facts WHERE cycle_id = ?1 AND name = ?2 ORDER BY id";
            self.connection.prepare(sql)?.query_map(params![id.0, name], |row| row.get(0))?.collect()
        };
        read().map_err(|error| self.database_error("read a cycle of", &error))
    }

    /// Returns the clock at the start and at the end of a cycle.
    pub(super) fn clocks(&self, id: CycleId) -> Result<[Option<Clock>; 2], StoreError> {
        let kept = self.facts(id, CLOCK)?;
        let clock = |text: Option<&String>| text.map(|text| self.parse_stored(text)).transpose();
        Ok([clock(kept.first())?, clock(kept.get(1))?])
    }

    /// Returns the file with the recording of a cycle, if it is recorded.
    pub(super) fn recording_file(&self, id: CycleId) -> Result<Option<RecordingFile>, StoreError> {
        self.facts(id, RECORDING)?.first().map(|text| self.parse_stored(text)).transpose()
    }

    pub(super) fn cycle_findings(&self, id: CycleId) -> Result<Vec<Finding>, StoreError> {
        let read = || -> Result<Vec<String>, rusqlite::Error> {
            let sql = "SELECT finding FROM findings WHERE cycle_id = ?1 ORDER BY id";
            self.connection.prepare(sql)?.query_map([id.0], |row| row.get(0))?.collect()
        };
        let texts = read().map_err(|error| self.database_error("read a cycle of", &error))?;
        texts.iter().map(|text| self.parse_stored(text)).collect()
    }

    /// Returns the motions of a cycle, with their contact paths.
    pub(super) fn cycle_motions(&self, id: CycleId) -> Result<Vec<MotionRecord>, StoreError> {
        let read = || -> Result<Vec<(i64, StoredMotionTexts)>, rusqlite::Error> {
            let sql = "SELECT motion, outcome, done, id FROM motions WHERE cycle_id = ?1 ORDER BY id";
            let row = |row: &rusqlite::Row<'_>| Ok((row.get(3)?, motion_texts(row)?));
            self.connection.prepare(sql)?.query_map([id.0], row)?.collect()
        };
        let rows = read().map_err(|error| self.database_error("read the motions of", &error))?;
        let whole = |(row, texts): &(i64, StoredMotionTexts)| {
            Ok(MotionRecord { contact: self.contact_of_motion(id, *row)?, ..self.motion(texts)? })
        };
        rows.iter().map(whole).collect()
    }

    /// Adds to the area that the mounted disc has swept, mm².
    ///
    /// # Errors
    /// If the store is open for reading only or cannot be written, or the area is not finite.
    pub fn wear_disc(&mut self, cycle: Option<CycleId>, swept_mm2: f64) -> Result<(), StoreError> {
        if !swept_mm2.is_finite() {
            return Err(StoreError::NotFinite { name: "area swept by the disc".to_owned() });
        }
        self.store_disc(cycle, false, swept_mm2)
    }

    /// Records that a new disc was mounted.
    ///
    /// # Errors
    /// If the store is open for reading only or cannot be written.
    pub fn mount_disc(&mut self) -> Result<(), StoreError> {
        self.store_disc(None, true, 0.0)
    }

    fn store_disc(&mut self, cycle: Option<CycleId>, is_new: bool, swept_mm2: f64) -> Result<(), StoreError> {
        self.require_writable()?;
        let at_unix_s = self.unix_s();
        self.commit("write the disc's wear to", |writing| {
            writing.execute(
                "INSERT INTO discs (cycle_id, at_unix_s, is_new, swept_mm2) VALUES (?1, ?2, ?3, ?4)",
                params![cycle.map(|id| id.0), at_unix_s, is_new, swept_mm2],
            )?;
            writing.chain("discs", writing.last_insert_rowid())
        })
    }

    /// Returns the area that the mounted disc has swept, mm².
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn disc_worn_mm2(&self) -> Result<f64, StoreError> {
        self.connection
            .query_row(
                "SELECT coalesce(sum(swept_mm2), 0.0) FROM discs
                 WHERE id > (SELECT coalesce(max(id), 0) FROM discs WHERE is_new)",
                [],
                |row| row.get(0),
            )
            .map_err(|error| self.database_error("read the disc's wear from", &error))
    }
}

/// The stored texts of a motion and of its outcome, and the number of executed waypoints.
type StoredMotionTexts = (String, Option<String>, u32);

fn motion_texts(row: &Row<'_>) -> Result<StoredMotionTexts, rusqlite::Error> {
    Ok((row.get(0)?, row.get(1)?, row.get(2)?))
}
