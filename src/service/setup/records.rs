//! The signed records of a cell: its key, the signatures of the cell and of people, and the page of a cycle as PDF.

use super::cell_files::CellFiles;
use super::fault::SetupFault;
use super::pages::{StoredCycle, page_file, recording_status, sheet_document};
use crate::report::page::Figure;
use panelprep_cell::record::CycleId;
use panelprep_store::signing::{CellKey, SignedPage};
use panelprep_store::store::{self, KeyLocation, PersonSigningRequest, SignatureRow, Store};
use std::path::PathBuf;

/// The name under which systemd provides the cell's key, with `LoadCredential=`.
const CREDENTIAL: &str = "panelprep-record-key";

/// A cycle's page as PDF, with the part that the cell signs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordPdf {
    /// The PDF.
    pub pdf: Vec<u8>,
    /// The signed page, which contains the SHA-256 of the PDF.
    pub page: Vec<u8>,
    /// The signature of the signed page.
    pub signature: Vec<u8>,
}

/// Returns the key with which this cell signs: the file that the cell's file names, else a credential, else one in the
/// store.
///
/// # Errors
/// If it cannot be read or made.
pub fn key(files: &CellFiles) -> Result<CellKey, SetupFault> {
    let credential = std::env::var_os("CREDENTIALS_DIRECTORY").map(|folder| PathBuf::from(folder).join(CREDENTIAL));
    let place = match (files.cell.record_key(), credential.filter(|file| file.exists())) {
        (Some(file), _) => KeyLocation::File(file.to_owned()),
        (None, Some(file)) => KeyLocation::Provided(file),
        (None, None) => KeyLocation::InStore,
    };
    store::cell_key(files.store_folder(), &place).map_err(SetupFault::stage)
}

/// Signs every finished cycle that is unsigned, and reports each as text; a warning is reported as such.
///
/// # Errors
/// If the key or the store cannot be used.
pub fn sign_missing(files: &CellFiles, report: &dyn Fn(Result<String, String>)) -> Result<(), SetupFault> {
    let key = key(files)?;
    let each = |cycle, signed: Result<&SignatureRow, store::StoreError>| match signed {
        Ok(row) => report(Ok(format!(
            "the record of cycle {cycle} was signed: record number {}, SHA-256 {}",
            row.number, row.record_hash
        ))),
        Err(error) => report(Err(format!("the record of cycle {cycle} could not be signed: {error}"))),
    };
    Store::sign_missing(files.store_folder(), &key, &each).map_err(SetupFault::stage)
}

/// Signs the record of a cycle as this person and makes the cycle's page again, which then shows the signature. This
/// is for interfaces that have already identified the person.
///
/// # Errors
/// If the cycle is not over, the person has already signed with this meaning, or the store or the page cannot be
/// written.
pub fn sign_by_person(files: &CellFiles, signs: &PersonSigningRequest) -> Result<SignatureRow, SetupFault> {
    let row = Store::sign_by_person(files.store_folder(), &key(files)?, signs).map_err(SetupFault::stage)?;
    let page = page_file(files.store_folder(), signs.cycle);
    let kept = StoredCycle::read(&files.store()?, signs.cycle)?;
    kept.write(files.cell.retention(), &page, recording_status(files.store_folder(), &kept.record).as_ref())?;
    Ok(row)
}

/// Returns the signed record of a cycle with its page as PDF/A-3; `None` if the cycle is not signed yet.
///
/// # Errors
/// As [`signed_pdf`], and if the key or the store cannot be read.
pub fn cycle_pdf(files: &CellFiles, cycle: CycleId) -> Result<Option<RecordPdf>, SetupFault> {
    let (store, key) = (files.store()?, key(files)?);
    let rows = store.cycle_signatures(cycle).map_err(SetupFault::stage)?;
    signed_pdf(&store, &key, &rows)
}

/// Makes the page of a cycle as PDF, with all signatures of that cycle and what the cell signs for it. `None` if
/// the cell has not signed the cycle.
///
/// # Errors
/// If the store no longer has the signed record complete, or the PDF cannot be written.
pub fn signed_pdf(store: &Store, key: &CellKey, rows: &[SignatureRow]) -> Result<Option<RecordPdf>, SetupFault> {
    let (Some(row), Some(last)) = (rows.iter().find(|row| !row.is_of_person), rows.last()) else { return Ok(None) };
    let kept = StoredCycle::read(store, row.cycle)?;
    let figures: Vec<Figure> = kept.stored_figures().collect();
    let pdf = sheet_document(store, (&kept.record, &figures), row)?;
    let shows = (row.cycle, row.record_hash.as_str(), last.number);
    let (page, signature) = SignedPage::sign(&pdf, shows, last.unix_ms, key).map_err(SetupFault::stage)?;
    Ok(Some(RecordPdf { pdf, page, signature }))
}
