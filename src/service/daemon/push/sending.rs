//! One round: puts the next file on the server.

use super::connection::Connection;
use super::parts::PushParts;
use super::status::PushStatus;
use crate::daemon::background::Rounds;
use crate::daemon::progress_file;
use crate::daemon::record_source::{RecordPdf, RecordSource};
use axum::body::Bytes;
use panelprep_cell::cell::PushSettings;
use panelprep_cell::record::CycleId;
use panelprep_store::signing::{self, Statement, StatementContent};
use panelprep_store::store::{SignatureRow, Store};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

/// The file in the store's folder that records up to which signature the files were put.
const PROGRESS: &str = "push.json";
/// The text with which the names of pictures, recipes and calibrations begin.
const FILES: &str = "files/";
/// Largest number of remembered names of such files: most records name the same recipe and calibrations.
const MAX_FILES: usize = 50_000;
const JSON: &str = "application/json";
const PDF: &str = "application/pdf";
const BYTES: &str = "application/octet-stream";

/// The last signature up to which this server has everything.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
struct Progress {
    to: String,
    number: u64,
    /// SHA-256 of the statement of the last signature.
    record_hash: String,
}

/// A file for the server.
#[derive(Clone)]
struct File {
    name: String,
    kind: &'static str,
    bytes: Bytes,
}

/// Returns the page of a cycle, and the part that the cell signs.
fn page_files(cycle: CycleId, RecordPdf { pdf, page, signature }: RecordPdf) -> Vec<File> {
    let stem = signing::page_stem(cycle);
    let file = |name: String, kind, bytes: Vec<u8>| File { name, kind, bytes: bytes.into() };
    vec![
        file(signing::pdf_name(cycle), PDF, pdf),
        file(format!("{stem}.sig"), BYTES, signature),
        file(format!("{stem}.json"), JSON, page),
    ]
}

/// The task that sends records.
pub(super) struct Sender {
    push: PushSettings,
    folder: PathBuf,
    records: Arc<dyn RecordSource>,
    status: PushStatus,
    progress: Progress,
    store: Option<Store>,
    connection: Option<Connection>,
    /// Names of files that the server has.
    stored_names: BTreeSet<String>,
    /// The files of the page that was made for the signature with this number.
    page: Option<(u64, Vec<File>)>,
}

impl Sender {
    pub fn new(parts: &PushParts) -> Self {
        let PushParts { push, folder, records, status } = parts;
        let (push, folder, records, status) = (push.clone(), folder.clone(), records.clone(), status.clone());
        let mut progress: Progress = progress_file::read(&folder, PROGRESS);
        let to = push.target_folder.to_string();
        if progress.to != to {
            progress = Progress { to, ..Progress::default() };
        }
        Sender {
            push,
            folder,
            records,
            status,
            progress,
            store: None,
            connection: None,
            stored_names: BTreeSet::new(),
            page: None,
        }
    }
}

impl Rounds for Sender {
    async fn run_round(&mut self) -> Result<bool, String> {
        // The connection's own files are read even if nothing is to be put, so that errors in them are reported at
        // once.
        let mut connection = match self.connection.take() {
            Some(connection) => connection,
            None => Connection::new(&self.push)?,
        };
        let store = match self.store.take() {
            Some(store) => store,
            None => Store::open(&self.folder).map_err(|error| error.to_string())?,
        };
        self.resume_position(&store)?;
        let waiting = store.next_signature(self.progress.number).map_err(|error| error.to_string())?;
        let Some((row, behind)) = waiting else {
            self.status.lock_waiting().record_backlog(0, None);
            (self.store, self.connection) = (Some(store), Some(connection));
            return Ok(false);
        };
        self.status.lock_waiting().record_backlog(behind, Some(row.unix_ms));
        match self.next_file(&store, &row).await? {
            Some(File { name, kind, bytes }) => {
                connection.put_file(&name, kind, bytes).await?;
                self.stored_names.insert(name);
            }
            None => {
                let (to, number, record_hash) = (self.progress.to.clone(), row.number, row.record_hash.clone());
                self.progress = Progress { to, number, record_hash };
                progress_file::write(&self.folder, PROGRESS, &self.progress)?;
                // Pictures, recipes and calibrations have the same name in every record, so these names stay in the
                // list.
                self.stored_names.retain(|name| name.starts_with(FILES));
                if self.stored_names.len() >= MAX_FILES {
                    self.stored_names.clear();
                }
            }
        }
        (self.store, self.connection) = (Some(store), Some(connection));
        Ok(true)
    }

    fn forget(&mut self) {
        (self.store, self.connection) = (None, None);
    }

    fn report_result(&self, problem: Option<&str>) -> bool {
        self.status.lock_waiting().record_problem(problem)
    }
}

impl Sender {
    /// Continues after the last completed signature. If the store was restored from a backup, other signatures have
    /// the same numbers, and all of them are put again.
    fn resume_position(&mut self, store: &Store) -> Result<(), String> {
        let Progress { number, record_hash, .. } = &self.progress;
        if *number == 0 {
            return Ok(());
        }
        let last = store.next_signature(number - 1).map_err(|error| error.to_string())?;
        if last.is_none_or(|(row, _)| row.number != *number || row.record_hash != *record_hash) {
            tracing::warn!(
                "record number {number} in the store differs from the record that was sent last: all records are \
                 sent again"
            );
            self.progress = Progress { to: self.progress.to.clone(), ..Progress::default() };
        }
        Ok(())
    }

    /// Returns the first file of a cycle's page that was not put yet: the PDF, and the part that the cell signs.
    /// The page is made once for each signature.
    async fn next_page_file(&mut self, row: &SignatureRow) -> Result<Option<File>, String> {
        if self.page.as_ref().is_none_or(|(number, _)| *number != row.number) {
            let (records, cycle) = (self.records.clone(), row.cycle);
            let made = tokio::task::spawn_blocking(move || records.pdf(cycle)).await;
            let made = made.map_err(|error| error.to_string())?.unwrap_or_else(|problem| {
                tracing::warn!("cannot send the page of cycle {cycle} to the quality system: {problem}");
                None
            });
            self.page = Some((row.number, made.map_or(vec![], |made| page_files(cycle, made))));
        }
        let files = self.page.iter().flat_map(|(_, files)| files);
        Ok(files.into_iter().find(|file| !self.stored_names.contains(&file.name)).cloned())
    }

    /// Returns the first file of a signature that was not put yet. A file that is damaged, or was deleted after its
    /// retention time, is skipped: `record verify` reports it.
    async fn next_file(&mut self, store: &Store, row: &SignatureRow) -> Result<Option<File>, String> {
        let record = store.blob(&row.record_hash).map_err(|error| error.to_string())?;
        if let StatementContent::Cycle(cycle) = Statement::read(&record).map_err(|error| error.to_string())?.says {
            for (what, hash) in signing::exported_files(&cycle) {
                let name = format!("{FILES}{hash}");
                if self.stored_names.contains(&name) {
                    continue;
                }
                match store.blob(&hash) {
                    Ok(bytes) => return Ok(Some(File { name, kind: BYTES, bytes: bytes.into() })),
                    Err(error) => {
                        tracing::warn!("cannot send {what} of cycle {} to the quality system: {error}", row.cycle);
                        self.stored_names.insert(name);
                    }
                }
            }
        }
        if let Some(file) = self.next_page_file(row).await? {
            return Ok(Some(file));
        }
        let stem = match row.is_of_person {
            false => signing::cycle_stem(row.cycle),
            true => signing::person_signature_stem(row.cycle, row.number),
        };
        let last = [("sig", BYTES, row.signature.clone()), ("json", JSON, record)];
        let mut last = last.into_iter().map(|(ending, kind, bytes)| File {
            name: format!("{stem}.{ending}"),
            kind,
            bytes: bytes.into(),
        });
        Ok(last.find(|file| !self.stored_names.contains(&file.name)))
    }
}
