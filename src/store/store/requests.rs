//! Requests to the cell: the requested action, the sender, and the answer. A row is written once, together with the
//! answer.
//!
//! A request that the state table decides is also in the journal, where it is written before its effects. If the
//! program ended between the two writes, only the journal contains the request; its sender and answer are then unknown,
//! and the record states this.
//!
//! The pages of the controller's acceptance tests are stored as requests, too: one row for each completed page and for
//! each signature, with the person, the date and the checksum of the programs. A page with a failed test is stored as
//! well. Rows are never changed, and each row is part of the hash chain.

use super::database::{Store, unix_ms};
use super::error::StoreError;
use super::people::TrailPosition;
use panelprep_cell::cell::{ProofStage, SignedPage};
use panelprep_cell::cycle::Event;
use panelprep_cell::record::{Answer, CycleId, ProofsResult, RequestAuthor, RequestRecord, RequestedAction};
use rusqlite::params;
use std::path::Path;

pub(super) const TABLES: &str = "
    CREATE TABLE requests (
        id INTEGER PRIMARY KEY,
        cycle_id INTEGER REFERENCES cycles (id),
        journal_sequence INTEGER UNIQUE REFERENCES journal (sequence),
        unix_ms INTEGER NOT NULL,
        request TEXT NOT NULL
    ) STRICT;
    CREATE INDEX requests_by_cycle ON requests (cycle_id);
";

/// A request with its number in the store.
#[derive(Debug, Clone, PartialEq)]
pub struct NumberedRequest {
    /// Number of the request, from 1.
    pub number: i64,
    /// The cycle during which the request was sent; `None` between cycles.
    pub cycle: Option<CycleId>,
    /// The request with its answer.
    pub request: RequestRecord,
}

/// A page of the controller's acceptance tests, or its signature.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProofsPage {
    /// The stage that the page covers.
    pub stage: ProofStage,
    /// The checksum that the controller reported for its programs.
    pub programs_sum: i32,
    /// SHA-256 of the page.
    pub page_sha256: String,
    /// The person who performed the tests, or who signed the page.
    pub by: String,
    /// The result of the tests, or that the page was signed.
    pub result: ProofsResult,
}

impl ProofsPage {
    fn to_action(&self) -> RequestedAction {
        let Self { stage, programs_sum, page_sha256, by, result } = self.clone();
        RequestedAction::Proofs { stage: stage.letter().to_owned(), programs_sum, page_sha256, by, result }
    }
}

impl Store {
    /// Stores a request with its answer and the present time. `journal` is its line in the journal, if it has one.
    ///
    /// # Errors
    /// If the request cannot be written.
    pub fn store_request(
        &mut self,
        asked: &RequestRecord,
        cycle: Option<CycleId>,
        journal: Option<u64>,
    ) -> Result<(), StoreError> {
        self.require_writable()?;
        self.insert_request(asked, cycle, journal)
    }

    pub(super) fn insert_request(
        &mut self,
        asked: &RequestRecord,
        cycle: Option<CycleId>,
        journal: Option<u64>,
    ) -> Result<(), StoreError> {
        let unix_ms = unix_ms(self.clock());
        let text = self.text(&RequestRecord { unix_ms, ..asked.clone() })?;
        self.commit("write a request to", |writing| {
            writing.execute(
                "INSERT INTO requests (cycle_id, journal_sequence, unix_ms, request) VALUES (?1, ?2, ?3, ?4)",
                params![cycle.map(|id| id.0), journal.map(|sequence| sequence as i64), unix_ms, text],
            )?;
            writing.chain("requests", writing.last_insert_rowid())
        })
    }

    /// Returns the newest requests, during and between cycles, at most `most`, the newest first; with `before`, only
    /// requests before this position.
    ///
    /// # Errors
    /// If the requests cannot be read.
    pub fn requests(&self, before: Option<TrailPosition>, most: usize) -> Result<Vec<NumberedRequest>, StoreError> {
        let TrailPosition { unix_ms, number } = before.unwrap_or(TrailPosition::END);
        let most = i64::try_from(most).unwrap_or(i64::MAX);
        let read = || -> Result<Vec<(i64, Option<i64>, String)>, rusqlite::Error> {
            let sql = "SELECT id, cycle_id, request FROM requests WHERE (unix_ms, id) < (?1, ?2)
                ORDER BY unix_ms DESC, id DESC LIMIT ?3";
            let row = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, row.get(1)?, row.get(2)?));
            self.connection.prepare(sql)?.query_map([unix_ms, number, most], row)?.collect()
        };
        let rows = read().map_err(|error| self.database_error("read the requests of", &error))?;
        let request = |(number, cycle, text): (i64, Option<i64>, String)| {
            Ok(NumberedRequest { number, cycle: cycle.map(CycleId), request: self.parse_stored(&text)? })
        };
        rows.into_iter().map(request).collect()
    }

    /// Returns the requests during a cycle, in order. A request that is only in the journal is read from there.
    pub(super) fn requests_in_cycle(&self, id: CycleId) -> Result<Vec<RequestRecord>, StoreError> {
        let mut asked = self.requests_where("cycle_id = ?1", "cycle_id = ?1", id)?;
        let sql = "SELECT unix_ms, event FROM journal WHERE cycle_id = ?1 AND event LIKE '{\"asked\":%'
             AND sequence NOT IN (SELECT journal_sequence FROM requests WHERE journal_sequence NOT NULL)
             ORDER BY sequence";
        for (unix_ms, text) in self.request_rows(sql, id)? {
            if let Event::Asked(request) = self.parse_stored(&text)? {
                let wanted = RequestedAction::For(request);
                asked.push(RequestRecord {
                    unix_ms,
                    wanted,
                    who: None,
                    answer: None,
                    reasons: Vec::new(),
                    findings: None,
                });
            }
        }
        asked.sort_by_key(|asked| asked.unix_ms);
        Ok(asked)
    }

    /// Returns the requests between the previous cycle and this one, in order.
    pub(super) fn requests_before_cycle(
        &self,
        id: CycleId,
        started_unix_s: i64,
    ) -> Result<Vec<RequestRecord>, StoreError> {
        let after = "id > (SELECT coalesce(max(id), 0) FROM requests WHERE cycle_id < ?1)";
        let before = "id < (SELECT coalesce(min(id), 9223372036854775807) FROM requests WHERE cycle_id >= ?1)";
        let mut asked = self.requests_where(&format!("cycle_id IS NULL AND {after}"), before, id)?;
        asked.retain(|asked| asked.unix_ms.div_euclid(1_000) <= started_unix_s);
        Ok(asked)
    }

    fn requests_where(&self, one: &str, other: &str, id: CycleId) -> Result<Vec<RequestRecord>, StoreError> {
        let sql = format!("SELECT unix_ms, request FROM requests WHERE {one} AND {other} ORDER BY id");
        self.request_rows(&sql, id)?.iter().map(|(_, text)| self.parse_stored(text)).collect()
    }

    fn request_rows(&self, sql: &str, id: CycleId) -> Result<Vec<(i64, String)>, StoreError> {
        let read = || -> Result<Vec<_>, rusqlite::Error> {
            let mut rows = self.connection.prepare(sql)?;
            rows.query_map([id.0], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        read().map_err(|error| self.database_error("read the requests of", &error))
    }

    /// Stores a page, or its signature, in the store in this folder, also while a service writes to it.
    ///
    /// # Errors
    /// If the store cannot be opened or written.
    pub fn store_proofs_in(folder: &Path, page: &ProofsPage, who: RequestAuthor) -> Result<(), StoreError> {
        let (wanted, answer) = (page.to_action(), Some(Answer::Done));
        let row = RequestRecord { unix_ms: 0, wanted, who: Some(who), answer, reasons: vec![], findings: None };
        Store::open_for_one_row(folder)?.insert_request(&row, None, None)
    }

    /// Returns the newest signed page, with the failed tests since then; `None` if no page is signed.
    ///
    /// # Errors
    /// The errors of [`Store::proofs`].
    pub fn signed_proofs(&self) -> Result<Option<SignedPage>, StoreError> {
        let mut wrong_since = None;
        for page in self.proofs()? {
            match page.result {
                ProofsResult::Proven => {}
                ProofsResult::Wrong => {
                    wrong_since = Some(wrong_since.map_or(page.stage, |wrong: ProofStage| wrong.min(page.stage)));
                }
                ProofsResult::Signed => {
                    let (stage, programs_sum) = (page.stage, page.programs_sum);
                    return Ok(Some(SignedPage { stage, programs_sum, wrong_since }));
                }
            }
        }
        Ok(None)
    }

    /// Returns all pages of the controller's acceptance tests and all signatures on them, the newest first.
    ///
    /// # Errors
    /// If the rows cannot be read, or one has an unknown stage: an older row must not be used instead of it.
    pub fn proofs(&self) -> Result<Vec<ProofsPage>, StoreError> {
        let read = || -> Result<Vec<String>, rusqlite::Error> {
            let sql =
                "SELECT request FROM requests WHERE request ->> '$.wanted.proofs' IS NOT NULL ORDER BY id DESC";
            self.connection.prepare(sql)?.query_map([], |row| row.get(0))?.collect()
        };
        let rows = read().map_err(|error| self.database_error("read the proofs of", &error))?;
        let mut pages = vec![];
        for text in rows {
            let request: RequestRecord = self.parse_stored(&text)?;
            let RequestedAction::Proofs { stage, programs_sum, page_sha256, by, result } = request.wanted else {
                continue;
            };
            let stage = stage.parse().map_err(|_| StoreError::Unreadable {
                path: self.path().to_owned(),
                problem: format!("the stage of the acceptance tests is \"{stage}\", valid: A, B, C"),
            })?;
            pages.push(ProofsPage { stage, programs_sum, page_sha256, by, result });
        }
        Ok(pages)
    }
}
