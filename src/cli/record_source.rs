//! Provides the pages of cycles and their signatures for the operator's page.

use super::fault::Fault;
use super::load::CellFiles;
use super::report::{self, StoredCycle};
use super::{disk, record};
use panelprep_cell::record::CycleId;
use panelprep_service::daemon::{RecordPdf, RecordSource};
use panelprep_store::store::PersonSigningRequest;
use std::sync::Arc;

/// The cycles of a cell's store.
pub struct StoreRecords(pub Arc<CellFiles>);

impl RecordSource for StoreRecords {
    fn page(&self, cycle: CycleId) -> Result<String, String> {
        let files = &self.0;
        let page = report::page_file(files.store_folder(), cycle);
        // An existing page also contains the result of the recording.
        if let Ok(text) = disk::read_text(&page) {
            return Ok(text);
        }
        let made = files.store().and_then(|store| StoredCycle::read(&store, cycle));
        made.map(|kept| kept.html(None, vec![])).map_err(|fault| fault.to_string())
    }

    fn pdf(&self, cycle: CycleId) -> Result<Option<RecordPdf>, String> {
        let made = || {
            let (store, key) = (self.0.store()?, record::key(&self.0)?);
            let rows = store.cycle_signatures(cycle).map_err(Fault::stage)?;
            record::signed_pdf(&store, &key, &rows)
        };
        made().map_err(|fault| fault.to_string())
    }

    fn sign(&self, signs: &PersonSigningRequest) -> Result<u64, String> {
        record::sign_by_person(&self.0, signs).map(|row| row.number).map_err(|fault| fault.to_string())
    }
}
