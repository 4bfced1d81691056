//! The pages of the controller's proofs: each proven page and each signature is a row among the requests, with the
//! person, the date and the checksum of the programs. No row is changed, and each is part of the chain.

use super::database::Store;
use super::error::StoreError;
use panelprep_cell::cell::ProofStage;
use panelprep_cell::record::{Answer, RequestAuthor, RequestRecord, RequestedAction};
use std::path::Path;

/// A page of proofs of which each row was proven, or its signature.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProofsPage {
    /// The stage that the page proves.
    pub stage: ProofStage,
    /// The checksum that the controller's programs reported.
    pub programs_sum: i32,
    /// SHA-256 of the page.
    pub page_sha256: String,
    /// The person at the controller, or the one who signed.
    pub by: String,
    /// Whether this is the signature; otherwise the page as it was proven.
    pub is_signed: bool,
}

impl ProofsPage {
    fn to_action(&self) -> RequestedAction {
        let Self { stage, programs_sum, page_sha256, by, is_signed } = self.clone();
        RequestedAction::Proofs { stage: stage.letter().to_owned(), programs_sum, page_sha256, by, is_signed }
    }
}

impl Store {
    /// Stores a page or its signature in the store in this folder, also while a service writes to it.
    ///
    /// # Errors
    /// If the store cannot be opened or written.
    pub fn store_proofs_in(folder: &Path, page: &ProofsPage, who: RequestAuthor) -> Result<(), StoreError> {
        let (wanted, answer) = (page.to_action(), Some(Answer::Done));
        let row = RequestRecord { unix_ms: 0, wanted, who: Some(who), answer, reasons: vec![], findings: None };
        Store::open_for_one_row(folder)?.insert_request(&row, None, None)
    }

    /// Returns the newest page or signature that fits; `None` if there is none.
    ///
    /// # Errors
    /// If the rows cannot be read. A row with an unknown stage is one of them: an older one must not count in its place.
    pub fn newest_proofs(&self, fits: impl Fn(&ProofsPage) -> bool) -> Result<Option<ProofsPage>, StoreError> {
        if !self.has_table("requests")? {
            return Ok(None);
        }
        let read = || -> Result<Vec<String>, rusqlite::Error> {
            let sql =
                "SELECT request FROM requests WHERE request ->> '$.wanted.proofs' IS NOT NULL ORDER BY id DESC";
            self.connection.prepare(sql)?.query_map([], |row| row.get(0))?.collect()
        };
        let rows = read().map_err(|error| self.database_error("read the proofs of", &error))?;
        for text in rows {
            let request: RequestRecord = self.parse_stored(&text)?;
            let RequestedAction::Proofs { stage, programs_sum, page_sha256, by, is_signed } = request.wanted else {
                continue;
            };
            let stage = stage.parse().map_err(|_| StoreError::Unreadable {
                path: self.path().to_owned(),
                problem: format!("the stage of the proofs is \"{stage}\", valid: A, B, C"),
            })?;
            let page = ProofsPage { stage, programs_sum, page_sha256, by, is_signed };
            if fits(&page) {
                return Ok(Some(page));
            }
        }
        Ok(None)
    }
}
