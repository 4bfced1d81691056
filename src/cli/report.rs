//! Writes a cycle's page from the data in the store to a file.

use super::disk;
use super::fault::Fault;
use super::load::CellFiles;
use super::part;
use super::record_data;
use super::recording;
use super::retention;
use panelprep_base::number_text::utc_text;
use panelprep_cell::cell::Retention;
use panelprep_cell::record::{CycleId, CycleRecord, RecordingFile};
use panelprep_service::daemon::{self, RecordingResult};
use panelprep_service::report::cycle_page;
use panelprep_service::report::page::{Figure, Page, Section};
use panelprep_service::report::record_pdf::{RecordSheet, html as sheet_html};
use panelprep_store::store::{PrunedFiles, Store};
use panelprep_store::tape;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The stored data of a cycle, with its pictures by their hash.
pub struct StoredCycle {
    /// The record.
    pub record: CycleRecord,
    /// Data that was removed from the cycle.
    pub pruned: Option<PrunedFiles>,
    pictures: BTreeMap<String, Vec<u8>>,
    /// The section about the part, if it was named.
    part: Option<Section>,
    /// The page to read and sign.
    sheet: RecordSheet,
}

impl StoredCycle {
    /// Reads a cycle back. A missing or damaged picture is left out; the page reports this.
    ///
    /// # Errors
    /// If there is no such cycle, or it cannot be read back.
    pub fn read(store: &Store, cycle: CycleId) -> Result<Self, Fault> {
        let record = store.cycle(cycle).map_err(Fault::stage)?;
        let shown = record.findings.iter().flat_map(|finding| &finding.pictures);
        let pictures = shown.filter_map(|picture| Some((picture.hash.clone(), store.blob(&picture.hash).ok()?)));
        let pictures = pictures.collect();
        // A store of an earlier version of this program has no list of removed files: nothing was removed.
        let pruned = store.pruned_files(cycle).unwrap_or_default();
        let part = part::section(store, &record);
        let sheet = record_data::read(store, &record)?;
        Ok(StoredCycle { record, pruned, pictures, part, sheet })
    }

    /// Writes the page into its store, with the result of the recording and how long clips and scans are kept.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn write(&self, keep: &Retention, file: &Path, recorded: Option<&RecordingResult>) -> Result<(), Fault> {
        self.write_with(file, recorded, retention::section(keep, &self.record, self.pruned).into_iter().collect())
    }

    /// Writes the page, with `more` and the result of the recording at its end.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn write_with(
        &self,
        file: &Path,
        recorded: Option<&RecordingResult>,
        more: Vec<Section>,
    ) -> Result<(), Fault> {
        disk::write_durable(file, self.html(recorded, more))
    }

    /// Returns the page as HTML. `more` and the result of the cycle's recording are at its end.
    pub fn html(&self, recorded: Option<&RecordingResult>, more: Vec<Section>) -> String {
        let page = cycle_page(&self.record, &self.pictures);
        let recorded = recorded.map(recording::section);
        let first = sheet_html(&self.sheet);
        let sections = self.part.iter().cloned().chain(page.sections).chain(more).chain(recorded).collect();
        Page { first, sections, made: describe_page_version(), ..page }.html()
    }

    /// Returns the pictures that the store has, in order, each only once.
    pub fn stored_figures(&self) -> impl Iterator<Item = Figure> + '_ {
        let mut shown = BTreeSet::new();
        let all = self.record.findings.iter().flat_map(|finding| &finding.pictures);
        let all = all.filter(move |picture| shown.insert(picture.hash.clone()));
        all.filter_map(|picture| {
            Some(Figure { caption: picture.caption.clone(), jpeg: self.pictures.get(&picture.hash)?.clone() })
        })
    }

    /// Describes the pictures that the page shows and that are missing or damaged in the store.
    pub fn describe_missing_figures(&self) -> impl Iterator<Item = String> + '_ {
        let shown = self.record.findings.iter().flat_map(|finding| &finding.pictures);
        let missing = shown.filter(|picture| !self.pictures.contains_key(&picture.hash));
        missing
            .map(|picture| format!("the picture {} (SHA-256 {}) is missing or damaged", picture.name, picture.hash))
    }

    /// Writes the pictures into a folder, numbered in order; those of an earlier cycle in the folder are removed.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn write_pictures(&self, folder: &Path) -> Result<(), Fault> {
        remove_numbered(folder).map_err(|error| Fault::file_fault(folder, error))?;
        let named = self.record.findings.iter().flat_map(|finding| {
            finding.pictures.iter().map(|picture| {
                let pass = if finding.pass > 0 { format!("_pass{}", finding.pass) } else { String::new() };
                (format!("{}{pass}", picture.name), &picture.hash)
            })
        });
        for (index, (name, hash)) in named.enumerate() {
            if let Some(jpeg) = self.pictures.get(hash) {
                disk::write(&folder.join(format!("{:02}_{name}.jpg", index + 1)), jpeg)?;
            }
        }
        Ok(())
    }
}

/// Removes the pictures that [`StoredCycle::write_pictures`] wrote, `01_….jpg`, and nothing else.
fn remove_numbered(folder: &Path) -> Result<(), std::io::Error> {
    if !folder.is_dir() {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder)? {
        let (path, name) = entry.map(|entry| (entry.path(), entry.file_name()))?;
        let name = name.to_string_lossy();
        let number = name.split_once('_').filter(|_| name.ends_with(".jpg")).map(|(number, _)| number);
        if number.is_some_and(|number| number.len() == 2 && number.bytes().all(|digit| digit.is_ascii_digit())) {
            std::fs::remove_file(path)?;
        }
    }
    Ok(())
}

/// Returns a text that states when and by which version a page was made: the only line in which two pages of the same
/// cycle differ.
fn describe_page_version() -> String {
    let unix_s = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let made = utc_text(i64::try_from(unix_s).unwrap_or_default());
    format!("This page was made on {made} by panelprep {} from the store.", env!("CARGO_PKG_VERSION"))
}

/// The state of a cycle's recording, read from its file; `None` if the cycle was not recorded.
pub fn recording_status(store: &Path, record: &CycleRecord) -> Option<RecordingResult> {
    let file = match record.recording.as_ref()? {
        RecordingFile::InStore => daemon::recording_file(store, record.id),
        RecordingFile::Named(file) => PathBuf::from(file),
    };
    let name = file.display().to_string();
    let checked = panelprep_base::disk::open(&file).map_err(|error| error.to_string());
    let checked =
        checked.and_then(|out| tape::check_recording(BufReader::new(out)).map_err(|error| error.to_string()));
    Some(match checked {
        Ok(checked) => RecordingResult::complete_recording(name, checked.entries),
        Err(why) => RecordingResult::incomplete_recording(name, &why),
    })
}

/// Makes the pages of finished cycles that have none or only an incomplete one, because the program or the power
/// ended between a verdict and its page. Each is reported through `made`; one that cannot be made does not prevent
/// the others.
///
/// # Errors
/// If the store cannot be read.
pub fn make_missing_pages(files: &CellFiles, made: &dyn Fn(CycleId, Result<PathBuf, Fault>)) -> Result<(), Fault> {
    let store = files.store()?;
    for cycle in store.ended_cycles().map_err(Fault::stage)? {
        let page = page_file(files.store_folder(), cycle);
        if !is_page_complete(&page) {
            let kept = StoredCycle::read(&store, cycle);
            let recorded = |kept: &StoredCycle| recording_status(files.store_folder(), &kept.record);
            let written = kept.and_then(|kept| kept.write(files.cell.retention(), &page, recorded(&kept).as_ref()));
            made(cycle, written.map(|()| page));
        }
    }
    Ok(())
}

/// Returns whether a page is complete to its last line.
fn is_page_complete(page: &Path) -> bool {
    let end = || -> std::io::Result<Vec<u8>> {
        let mut file = panelprep_base::disk::open(page)?;
        let from = file.metadata()?.len().saturating_sub(PAGE_END.len() as u64);
        file.seek(SeekFrom::Start(from))?;
        let mut end = Vec::new();
        file.read_to_end(&mut end)?;
        Ok(end)
    };
    end().is_ok_and(|end| end == PAGE_END)
}

/// The last line of a page.
const PAGE_END: &[u8] = b"</html>\n";

/// The path of a cycle's page in its store.
pub fn page_file(store: &Path, cycle: CycleId) -> PathBuf {
    store.join("reports").join(format!("cycle-{:06}.html", cycle.0))
}
