//! The pages of cycles and their signatures, for the operator's page.

use super::load::CellFiles;
use super::report::{self, Kept};
use super::{disk, record, sheet};
use crate::daemon::RecordSource;
use crate::record::CycleId;
use crate::store::PersonSigns;
use std::sync::Arc;

/// The cycles of a cell's store.
pub struct StoreRecords(pub Arc<CellFiles>);

impl RecordSource for StoreRecords {
    fn page(&self, cycle: CycleId) -> Result<String, String> {
        let files = &self.0;
        let page = report::page_file(files.store_folder(), cycle);
        // One that is there has what came of the recording, too.
        if let Ok(text) = disk::read_text(&page) {
            return Ok(text);
        }
        let made = files.store().and_then(|store| Kept::read(&store, cycle));
        made.map(|kept| kept.html(None, vec![])).map_err(|fault| fault.to_string())
    }

    fn pdf(&self, cycle: CycleId) -> Result<Option<Vec<u8>>, String> {
        let store = self.0.store().map_err(|fault| fault.to_string())?;
        let rows = store.signatures_of(cycle).map_err(|error| error.to_string())?;
        let Some(row) = rows.iter().find(|row| !row.is_of_person) else { return Ok(None) };
        let kept = Kept::read(&store, cycle);
        let pdf = kept.and_then(|kept| {
            let figures: Vec<_> = kept.figures().collect();
            sheet::document(&store, (&kept.record, &figures), row)
        });
        pdf.map(Some).map_err(|fault| fault.to_string())
    }

    fn sign(&self, signs: &PersonSigns) -> Result<u64, String> {
        record::sign_as(&self.0, signs).map(|row| row.number).map_err(|fault| fault.to_string())
    }
}
