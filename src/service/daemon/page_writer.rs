//! The end of each cycle of the service, in parallel to the loop: the record is signed, its page is written, and files
//! whose retention time is over are removed.

use super::free_memory::give_back_free_memory;
use super::replay::Recording;
use super::request_handler::{EndedCycle, LastWrittenPage};
use crate::setup::{
    CellFiles, RecordingResult, SetupFault, StoredCycle, make_missing_pages, page_file, sign_missing,
};
use panelprep_cell::record::CycleId;
use panelprep_store::store::{PrunedFiles, Store};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::thread::JoinHandle;

/// Signs the record and writes the page of each ended cycle, in parallel to the loop, until the channel is closed.
///
/// # Errors
/// If the system provides no thread.
pub fn write_pages(
    files: Arc<CellFiles>,
    ended: Receiver<EndedCycle>,
    written: LastWrittenPage,
) -> std::io::Result<JoinHandle<()>> {
    let again = files.clone();
    let page = move |cycle, recorded: Option<&RecordingResult>| -> Result<PathBuf, SetupFault> {
        let page = page_file(files.store_folder(), cycle);
        StoredCycle::read(&files.store()?, cycle)?.write(files.cell.retention(), &page, recorded)?;
        Ok(page)
    };
    let each = move || {
        // The records are signed before the pages are made, because the pages show the signatures.
        sign(&again);
        if let Err(fault) = make_missing_pages(&again, &log_page) {
            tracing::warn!(
                "missing pages of earlier cycles could not be written: {fault}; write a page with `panelprep page N`"
            );
        }
        prune(&again);
        for EndedCycle { id: cycle, recording } in ended {
            let recorded = recording.map(Recording::finish);
            if let Some(RecordingResult { message, .. }) = &recorded {
                tracing::info!("cycle {cycle}: {message}");
            }
            sign(&again);
            let made = page(cycle, recorded.as_ref());
            if let Ok(page) = &made {
                written.set_page(cycle, page);
            }
            log_page(cycle, made);
            prune(&again);
            give_back_free_memory();
        }
    };
    std::thread::Builder::new().name("pages".to_owned()).spawn(each)
}

fn log_page(cycle: CycleId, page: Result<PathBuf, SetupFault>) {
    match page {
        Ok(page) => tracing::info!("page of cycle {cycle}: {}", page.display()),
        Err(fault) => tracing::warn!(
            "the page of cycle {cycle} could not be made: {fault}; make it with `panelprep page {cycle}`"
        ),
    }
}

/// Signs each cycle that is over and not yet signed; if this fails, it is tried again after the next cycle.
fn sign(files: &CellFiles) {
    let report = |result: Result<String, String>| match result {
        Ok(words) => tracing::info!("{words}"),
        Err(problem) => tracing::warn!("{problem}"),
    };
    if let Err(fault) = sign_missing(files, &report) {
        tracing::warn!("the records could not be signed: {fault}; this is repeated after the next cycle");
    }
}

/// Removes files whose retention time is over; if this fails, it is tried again after the next cycle.
fn prune(files: &CellFiles) {
    match Store::prune(files.store_folder(), files.cell.retention()) {
        Ok(PrunedFiles { files: 0, .. }) => {}
        Ok(PrunedFiles { files, bytes, .. }) => {
            tracing::info!(
                "{files} files of old clips and scans were removed, {} MB, by the rules of [store] keep",
                bytes / 1_000_000
            );
        }
        Err(error) => tracing::warn!(
            "old clips and scans could not be removed: {error}; this is repeated after the next cycle"
        ),
    }
}
