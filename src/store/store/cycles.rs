//! Cycles: their inputs, the findings of their phases, and their end.
//!
//! Also the data that later cycles and `history` read: the record, the part and the disc of a cycle, the cycles of a
//! panel in order, and the sanding passes on a part in earlier cycles.

use super::commit::{TransactionFailure, WriteTransaction};
use super::database::{Store, unix_ms};
use super::error::StoreError;
use super::{outbox, search};
use crate::history::{DiscWear, PastCycle, TrendPoint};
use crate::office::Kind;
use panelprep_base::verdict::{Judgement, Limit, Reason, Verdict};
use panelprep_cell::record::{
    Budget, CycleId, CycleRecord, Finding, KeptFile, LostPasses, PartNames, RecordingFile, conclude,
    removed_bound_um, touching_passes,
};
use rusqlite::{OptionalExtension, Row, params};
use serde::Serialize;
use serde::de::DeserializeOwned;

pub(super) const TABLES: &str = "
    CREATE TABLE cycles (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        started_unix_s INTEGER NOT NULL,
        ended_unix_s INTEGER,
        panel TEXT NOT NULL,
        taught_version TEXT NOT NULL,
        recipe_hash TEXT NOT NULL,
        files TEXT NOT NULL,
        program_version TEXT NOT NULL,
        verdict TEXT,
        reasons TEXT,
        budget TEXT
    ) STRICT;
    CREATE TABLE findings (
        id INTEGER PRIMARY KEY,
        cycle_id INTEGER NOT NULL REFERENCES cycles (id),
        kind TEXT NOT NULL,
        pass INTEGER NOT NULL,
        finding TEXT NOT NULL,
        unix_ms INTEGER NOT NULL
    ) STRICT;
    CREATE INDEX findings_by_cycle ON findings (cycle_id);
";

/// The inputs of a new cycle. Each text is stored unchanged in a file named by its hash; equal texts are stored only
/// once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CycleStart {
    /// Name of the panel.
    pub panel: String,
    /// The version of the taught panel.
    pub taught_version: String,
    /// The text of the recipe.
    pub recipe_text: String,
    /// The texts of the cell's file and its calibrations, each with its purpose, such as `base_from_camera`.
    pub file_texts: Vec<(String, String)>,
    /// The file with the recording of the cycle, if it is recorded.
    pub recording: Option<RecordingFile>,
    /// Whether the cycle is an air-run, without contact.
    pub is_air_run: bool,
}

/// Numbers of cycles and of contact paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleCounts {
    /// Number of ended cycles.
    pub ended: i64,
    /// Number of ended cycles with the verdict pass.
    pub passed: i64,
    /// Number of contact paths that were started.
    pub contacts: i64,
}

/// The sanding passes on a part in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassesOfCycle {
    /// Number of the cycle.
    pub cycle: CycleId,
    /// Start time of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// Number of passes in which the tool was, or may have been, in contact with the part.
    pub passes: usize,
    /// Upper 95 % bound of the removed depth at any place of the part after this cycle, µm; `None` if it is unknown.
    pub removed_um: Option<f64>,
}

impl Store {
    /// Stores the start of a cycle with all its inputs.
    ///
    /// # Errors
    /// If the start cannot be written. Also if cycles were lost by a restore and the start does not state the sanding
    /// passes on the part in these cycles.
    pub fn begin_cycle(&mut self, start: &CycleStart) -> Result<CycleId, StoreError> {
        self.check_count(start)?;
        let kept = |(name, text): &(String, String)| {
            Ok(KeptFile { name: name.clone(), hash: self.store_blob(text.as_bytes())? })
        };
        let files: Vec<KeptFile> = start.file_texts.iter().map(kept).collect::<Result<_, StoreError>>()?;
        let recipe_hash = self.store_blob(start.recipe_text.as_bytes())?;
        let (started_unix_s, files) = (self.unix_s(), self.text(&files)?);
        let part = search::parse_part(&start.file_texts);
        let above = self.numbered_above()?;
        let id = self.commit("write a cycle to", |writing| {
            let (panel, version, program) = (&start.panel, &start.taught_version, env!("CARGO_PKG_VERSION"));
            writing.execute(
                "INSERT INTO cycles (id, started_unix_s, panel, taught_version, recipe_hash, files, program_version)
                 VALUES (1 + max(?7, (SELECT coalesce(max(id), 0) FROM cycles)), ?1, ?2, ?3, ?4, ?5, ?6)",
                params![started_unix_s, panel, version, recipe_hash, files, program, above],
            )?;
            let id = writing.last_insert_rowid();
            writing.chain("cycles", id)?;
            part.as_ref().map_or(Ok(()), |part| search::insert_part(writing, id, part))?;
            Ok(CycleId(id))
        })?;
        start.recording.as_ref().map_or(Ok(()), |file| self.store_recording(id, file))?;
        Ok(id)
    }

    /// Returns whether the cycle with this number exists.
    ///
    /// # Errors
    /// If the cycle cannot be read.
    pub fn has_cycle(&self, id: CycleId) -> Result<bool, StoreError> {
        let sql = "SELECT EXISTS (SELECT 1 FROM cycles WHERE id = ?1)";
        let there = self.connection.query_row(sql, [id.0], |row| row.get(0));
        there.map_err(|error| self.database_error("read a cycle of", &error))
    }

    /// Stores the end of a cycle and returns its verdict. The verdict is that of the state table, but never better than
    /// the findings allow ([`conclude`](panelprep_cell::record::conclude)). `because` are the reasons for ending the
    /// cycle early, if it ended early.
    ///
    /// # Errors
    /// If the end cannot be written, the cycle does not exist, or it has already ended.
    pub fn conclude(&mut self, id: CycleId, ended: Verdict, because: &[Reason]) -> Result<Judgement, StoreError> {
        let judgement = conclude(ended, &self.cycle_findings(id)?, &self.requests_in_cycle(id)?, because);
        let Judgement { verdict, reasons } = &judgement;
        let (ended_unix_s, reasons) = (self.unix_s(), self.text(reasons)?);
        let unix_ms = unix_ms(self.clock());
        self.change(
            (id, "cycle_ends"),
            "UPDATE cycles SET ended_unix_s = ?2, verdict = ?3, reasons = ?4 WHERE id = ?1 AND verdict IS NULL",
            params![id.0, ended_unix_s, verdict.keyword(), reasons],
            |writing| outbox::insert(writing, Kind::Cycle, id.0, unix_ms),
        )?;
        Ok(judgement)
    }

    /// Stores the error budget at the tool, which may be incomplete. It replaces an earlier value.
    ///
    /// # Errors
    /// If the budget cannot be written, a component is not finite, the cycle does not exist, or it has already ended.
    pub fn set_budget(&mut self, id: CycleId, budget: &Budget) -> Result<(), StoreError> {
        let parts = [budget.hand_eye_mm, budget.locate_mm, budget.fit_mm, budget.robot_mm, budget.stated_mm];
        if parts.into_iter().flatten().any(|part| !part.is_finite()) {
            return Err(StoreError::NotFinite { name: "error budget".to_owned() });
        }
        let budget = self.text(budget)?;
        let sql = "UPDATE cycles SET budget = ?2 WHERE id = ?1 AND verdict IS NULL";
        self.change((id, "cycle_budgets"), sql, params![id.0, budget], |_| Ok(()))
    }

    fn change(
        &mut self,
        (id, part): (CycleId, &'static str),
        sql: &str,
        values: &[&dyn rusqlite::ToSql],
        beside: impl Fn(&mut WriteTransaction<'_>) -> Result<(), TransactionFailure>,
    ) -> Result<(), StoreError> {
        self.require_writable()?;
        let path = self.path().to_owned();
        self.commit("write a cycle to", |writing| match writing.execute(sql, values)? {
            1 => {
                writing.chain(part, id.0)?;
                beside(writing)
            }
            _ => Err(StoreError::UnknownCycle { path: path.clone(), what: "running cycle", id: id.0 }.into()),
        })
    }

    /// Stores a finding of a cycle. The caller must have stored its pictures with [`Store::store_blob`].
    ///
    /// # Errors
    /// If the finding cannot be written, a number is not finite, a picture is missing, or the cycle does not exist.
    pub fn store_finding(&mut self, id: CycleId, finding: &Finding) -> Result<(), StoreError> {
        self.require_writable()?;
        let finite = |number: Option<f64>| number.is_none_or(f64::is_finite);
        if let Some(bad) =
            finding.checks.iter().find(|number| !finite(number.value) || !finite(number.limit.value()))
        {
            return Err(StoreError::NotFinite { name: bad.name.clone() });
        }
        finding.pictures.iter().try_for_each(|picture| self.blob(&picture.hash).map(drop))?;
        finding.shots.iter().try_for_each(|shot| self.blob(&shot.hash).map(drop))?;
        let (kind, text) = (self.text(&finding.kind)?, self.text(finding)?);
        let unix_ms = unix_ms(self.clock());
        self.commit("write a finding to", |writing| {
            writing.execute(
                "INSERT INTO findings (cycle_id, kind, pass, finding, unix_ms) VALUES (?1, ?2, ?3, ?4, ?5)",
                params![id.0, kind.trim_matches('"'), finding.pass, text, unix_ms],
            )?;
            writing.chain("findings", writing.last_insert_rowid())
        })
    }

    /// Returns all stored data of a cycle.
    ///
    /// # Errors
    /// If the cycle does not exist, or cannot be read.
    pub fn cycle(&self, id: CycleId) -> Result<CycleRecord, StoreError> {
        let read = |error: rusqlite::Error| self.database_error("read a cycle of", &error);
        let Some(mut record) = self.cycle_row(id)? else { return Err(self.unknown_cycle("cycle", id)) };
        record.findings = self.cycle_findings(id)?;
        record.motions = self.cycle_motions(id)?;
        record.asked_before = self.requests_before_cycle(id, record.started_unix_s)?;
        record.asked = self.requests_in_cycle(id)?;
        record.clocks = self.clocks(id)?;
        record.recording = self.recording_file(id)?;
        let count = "SELECT count(*) FROM journal WHERE cycle_id = ?1";
        let events: i64 = self.connection.query_row(count, [id.0], |row| row.get(0)).map_err(read)?;
        record.events = events as u64;
        Ok(record)
    }

    fn cycle_row(&self, id: CycleId) -> Result<Option<CycleRecord>, StoreError> {
        let columns = |row: &Row<'_>| {
            let record = CycleRecord {
                id,
                started_unix_s: row.get(0)?,
                ended_unix_s: row.get(1)?,
                panel: row.get(2)?,
                taught_version: row.get(3)?,
                recipe_hash: row.get(4)?,
                files: Vec::new(),
                program_version: row.get(5)?,
                judgement: None,
                budget: None,
                findings: Vec::new(),
                motions: Vec::new(),
                asked_before: Vec::new(),
                asked: Vec::new(),
                clocks: [None, None],
                recording: None,
                events: 0,
            };
            let texts = [row.get(6)?, row.get(7)?, row.get(8)?, row.get(9)?];
            Ok((record, texts))
        };
        let sql = "SELECT started_unix_s, ended_unix_s, panel, taught_version, recipe_hash, program_version,
                files, verdict, reasons, budget FROM cycles WHERE id = ?1";
        let row = self.connection.query_row(sql, [id.0], columns).optional();
        let Some((mut record, texts)) = row.map_err(|error| self.database_error("read a cycle of", &error))? else {
            return Ok(None);
        };
        let [files, verdict, reasons, budget]: [Option<String>; 4] = texts;
        if let Some(files) = files {
            record.files = self.parse_stored(&files)?;
        }
        if let (Some(word), Some(reasons)) = (verdict, reasons) {
            let verdict = self.parse_stored(&format!("\"{word}\""))?;
            record.judgement = Some(Judgement { verdict, reasons: self.parse_stored(&reasons)? });
        }
        record.budget = budget.map(|text| self.parse_stored(&text)).transpose()?;
        Ok(Some(record))
    }

    /// Returns the number of the newest cycle.
    ///
    /// # Errors
    /// If the cycles cannot be read.
    pub fn newest_cycle(&self) -> Result<Option<CycleId>, StoreError> {
        let last = self.connection.query_row("SELECT max(id) FROM cycles", [], |row| row.get::<_, Option<i64>>(0));
        Ok(last.map_err(|error| self.database_error("read the cycles of", &error))?.map(CycleId))
    }

    /// Returns the numbers of all ended cycles, in order.
    ///
    /// # Errors
    /// If the cycles cannot be read.
    pub fn ended_cycles(&self) -> Result<Vec<CycleId>, StoreError> {
        self.find_cycles("verdict IS NOT NULL")
    }

    /// Returns the numbers of all cycles without an end, in order: the cycle in progress and, before
    /// [`Store::recover`], the cycles that ended by a crash.
    ///
    /// # Errors
    /// If the cycles cannot be read.
    pub fn open_cycles(&self) -> Result<Vec<CycleId>, StoreError> {
        self.find_cycles("verdict IS NULL")
    }

    fn find_cycles(&self, condition: &str) -> Result<Vec<CycleId>, StoreError> {
        let read = || -> Result<Vec<CycleId>, rusqlite::Error> {
            let mut rows =
                self.connection.prepare(&format!("SELECT id FROM cycles WHERE {condition} ORDER BY id"))?;
            rows.query_map([], |row| row.get(0).map(CycleId))?.collect()
        };
        read().map_err(|error| self.database_error("read the cycles of", &error))
    }

    fn unknown_cycle(&self, what: &'static str, id: CycleId) -> StoreError {
        StoreError::UnknownCycle { path: self.path().to_owned(), what, id: id.0 }
    }

    pub(super) fn text(&self, value: &impl Serialize) -> Result<String, StoreError> {
        serde_json::to_string(value).map_err(|error| self.unreadable_error(&error))
    }

    pub(super) fn parse_stored<T: DeserializeOwned>(&self, text: &str) -> Result<T, StoreError> {
        serde_json::from_str(text).map_err(|error| self.unreadable_error(&error))
    }

    fn unreadable_error(&self, error: &serde_json::Error) -> StoreError {
        StoreError::Unreadable { path: self.path().to_owned(), problem: error.to_string() }
    }

    /// Returns the numbers of cycles and contact paths.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub fn cycle_counts(&self) -> Result<CycleCounts, StoreError> {
        let sql = "SELECT (SELECT count(*) FROM cycles WHERE verdict IS NOT NULL),
            (SELECT count(*) FROM cycles WHERE verdict = 'pass'),
            (SELECT count(*) FROM motions WHERE motion ->> 'path' = 'contact')";
        let counts = |row: &rusqlite::Row<'_>| {
            Ok(CycleCounts { ended: row.get(0)?, passed: row.get(1)?, contacts: row.get(2)? })
        };
        self.connection
            .query_row(sql, [], counts)
            .map_err(|error| self.database_error("count the cycles of", &error))
    }

    /// Returns a cycle with its part and the wear of the disc in this cycle.
    ///
    /// # Errors
    /// If the cycle does not exist, or cannot be read.
    pub fn past_cycle(&self, id: CycleId) -> Result<PastCycle, StoreError> {
        Ok(PastCycle { record: self.cycle(id)?, part: self.cycle_part(id)?, disc: self.disc_wear_of_cycle(id)? })
    }

    /// Returns the last ended cycles of a panel, at most `most`, the oldest first.
    ///
    /// # Errors
    /// If the cycles cannot be read.
    pub fn past_cycles(&self, panel: &str, most: usize) -> Result<Vec<PastCycle>, StoreError> {
        let most = i64::try_from(most).unwrap_or(i64::MAX);
        let read = || -> Result<Vec<CycleId>, rusqlite::Error> {
            let sql = "SELECT id FROM cycles WHERE panel = ?1 AND verdict IS NOT NULL ORDER BY id DESC LIMIT ?2";
            let mut rows = self.connection.prepare_cached(sql)?;
            rows.query_map(rusqlite::params![panel, most], |row| row.get(0).map(CycleId))?.collect()
        };
        let ids = read().map_err(|error| self.database_error("read the cycles of", &error))?;
        ids.into_iter().rev().map(|id| self.past_cycle(id)).collect()
    }

    /// Returns the names of all panels with cycles.
    ///
    /// # Errors
    /// If the names cannot be read.
    pub fn cycle_panels(&self) -> Result<Vec<String>, StoreError> {
        let read = || -> Result<Vec<String>, rusqlite::Error> {
            let sql = "SELECT DISTINCT panel FROM cycles ORDER BY panel";
            self.connection.prepare_cached(sql)?.query_map([], |row| row.get(0))?.collect()
        };
        read().map_err(|error| self.database_error("read the panels of", &error))
    }

    /// Returns the last verifications of a device without those that are struck out, at most `most`, the oldest first.
    ///
    /// # Errors
    /// If the verifications cannot be read.
    pub fn verification_points(&self, subject: &str, most: usize) -> Result<Vec<TrendPoint>, StoreError> {
        let all = self.verifications(subject)?;
        let points = all.into_iter().filter(|it| it.struck.is_none()).map(|it| TrendPoint {
            cycle: None,
            at_unix_s: it.at_unix_s,
            serial: None,
            value: it.error,
            limit: Limit::AtMost(it.limit),
        });
        let mut points: Vec<TrendPoint> = points.collect();
        points.drain(..points.len().saturating_sub(most));
        Ok(points)
    }

    /// Returns the wear of the disc in a cycle; `None` if the cycle had no contact.
    fn disc_wear_of_cycle(&self, id: CycleId) -> Result<Option<DiscWear>, StoreError> {
        let read = || -> Result<Option<DiscWear>, rusqlite::Error> {
            if !self.connection.table_exists(None, "discs")? {
                return Ok(None);
            }
            // After an interrupted path, the swept area is corrected by a second row of the same cycle.
            let sql = "SELECT sum(swept_mm2), max(id) FROM discs WHERE cycle_id = ?1";
            let swept = self
                .connection
                .prepare_cached(sql)?
                .query_row([id.0], |row| Ok((row.get::<_, Option<f64>>(0)?, row.get::<_, Option<i64>>(1)?)))?;
            let (Some(swept_mm2), Some(last)) = swept else { return Ok(None) };
            let sql = "SELECT sum(swept_mm2) FROM discs
                       WHERE id <= ?1 AND id > (SELECT coalesce(max(id), 0) FROM discs WHERE is_new AND id <= ?1)";
            let worn_mm2 = self.connection.prepare_cached(sql)?.query_row([last], |row| row.get(0))?;
            Ok(Some(DiscWear { swept_mm2, worn_mm2 }))
        };
        read().map_err(|error| self.database_error("read the disc's wear from", &error))
    }

    /// Returns the names of a cycle's part, from the text that the cycle stores; `None` if no name was stated, or the
    /// text is missing or damaged.
    pub fn stored_part(&self, record: &CycleRecord) -> Option<PartNames> {
        let kept = record.files.iter().find(|file| file.name == PartNames::FILE)?;
        PartNames::read(&String::from_utf8(self.blob(&kept.hash).ok()?).ok()?)
    }

    /// Returns the number of sanding passes in lost cycles that the start of this cycle stated; 0 if it stated none.
    ///
    /// # Errors
    /// If the statement is missing or damaged in the store, so that the number is unknown.
    pub fn lost_passes(&self, cycle: CycleId) -> Result<u8, StoreError> {
        let sql =
            "SELECT value ->> 'hash' FROM cycles, json_each(files) WHERE cycles.id = ?1 AND value ->> 'name' = ?2";
        let read = || -> Result<Option<String>, rusqlite::Error> {
            self.connection
                .prepare_cached(sql)?
                .query_row(params![cycle.0, LostPasses::FILE], |row| row.get(0))
                .optional()
        };
        let Some(hash) = read().map_err(|error| self.database_error("read a cycle of", &error))? else {
            return Ok(0);
        };
        let text = String::from_utf8(self.blob(&hash)?).unwrap_or_default();
        let stated = LostPasses::read(&text).ok_or_else(|| StoreError::Unreadable {
            path: self.path().to_owned(),
            problem: format!("the passes in lost cycles that the start of cycle {cycle} stated"),
        })?;
        Ok(stated.passes)
    }

    /// Returns the cycles in which the part with this serial number was sanded, or may have been, in order. With
    /// `before`, only cycles before this one are returned. The passes in lost cycles belong to the cycle whose start
    /// stated them.
    ///
    /// # Errors
    /// If a cycle cannot be read.
    pub fn sanding_passes_by_serial(
        &self,
        serial: &str,
        before: Option<CycleId>,
    ) -> Result<Vec<PassesOfCycle>, StoreError> {
        let read = || -> Result<Vec<CycleId>, rusqlite::Error> {
            let sql = "SELECT cycle_id, serial FROM cycle_parts WHERE serial NOTNULL AND (?1 IS NULL OR cycle_id < ?1) ORDER BY 1";
            let mut statement = self.connection.prepare(sql)?;
            let all = statement.query_map(params![before.map(|id| id.0)], |row| Ok((row.get(0)?, row.get(1)?)))?;
            // Serial numbers that differ only in surrounding blanks or in upper and lower case are equal. They are
            // compared here, because SQL ignores the case of ASCII letters only.
            let is_it = |row: &Result<(i64, String), _>| {
                row.as_ref().map_or(true, |(_, found): &(i64, String)| {
                    normalised_serial(found) == normalised_serial(serial)
                })
            };
            all.filter(is_it).map(|row| row.map(|(id, _)| CycleId(id))).collect()
        };
        let cycles = read().map_err(|error| self.database_error("read the cycles of", &error))?;
        let mut all = Vec::new();
        for cycle in cycles {
            let record = self.cycle(cycle)?;
            let own = touching_passes(&record.findings, &record.motions);
            let lost = usize::from(self.lost_passes(cycle)?);
            let passes = own + lost;
            if passes > 0 {
                // A person states only the number of lost passes, so the removed depth is unknown.
                let removed_um = removed_bound_um(&record.findings, own).filter(|_| lost == 0);
                let started_unix_s = record.started_unix_s;
                all.push(PassesOfCycle { cycle, started_unix_s, passes, removed_um });
            }
        }
        Ok(all)
    }
}

/// Returns a serial number for comparison: without surrounding blanks, in lower case.
pub(super) fn normalised_serial(serial: &str) -> String {
    serial.trim().to_uppercase()
}
