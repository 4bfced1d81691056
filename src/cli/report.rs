//! A cycle's page: from what the store keeps to a file.

use super::disk;
use super::fault::Fault;
use super::part;
use crate::record::{CycleId, CycleRecord};
use crate::report::cycle_page;
use crate::report::page::{Page, Section};
use crate::store::{Pruned, Store};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What the store keeps of a cycle, with its pictures by their hash.
pub struct Kept {
    /// The record.
    pub record: CycleRecord,
    /// What was removed of it.
    pub pruned: Option<Pruned>,
    pictures: BTreeMap<String, Vec<u8>>,
    /// What is told of the part, where it was named.
    part: Option<Section>,
}

impl Kept {
    /// Reads a cycle back. A picture that is missing or damaged is left out; the page says so.
    ///
    /// # Errors
    /// Where there is no such cycle, or it does not read back.
    pub fn read(store: &Store, cycle: CycleId) -> Result<Self, Fault> {
        let record = store.cycle(cycle).map_err(Fault::stage)?;
        let shown = record.findings.iter().flat_map(|finding| &finding.pictures);
        let pictures = shown.filter_map(|picture| Some((picture.hash.clone(), store.blob(&picture.hash).ok()?)));
        let pictures = pictures.collect();
        // A store of an earlier program has removed nothing.
        let pruned = store.pruned_of(cycle).unwrap_or_default();
        let part = part::section(store, &record);
        Ok(Kept { record, pruned, pictures, part })
    }

    /// Writes the page, with `more` at its end.
    ///
    /// # Errors
    /// Where the disk refuses.
    pub fn write(&self, file: &Path, more: Vec<Section>) -> Result<(), Fault> {
        let page = cycle_page(&self.record, &self.pictures);
        let sections = self.part.iter().cloned().chain(page.sections).chain(more).collect();
        disk::write_through(file, Page { sections, ..page }.html())
    }

    /// Writes the pictures into a folder, numbered as they came; those of an earlier cycle there go.
    ///
    /// # Errors
    /// Where the disk refuses.
    pub fn write_pictures(&self, folder: &Path) -> Result<(), Fault> {
        remove_numbered(folder).map_err(|error| Fault::file(folder, error))?;
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

/// Removes the pictures that [`Kept::write_pictures`] wrote, `01_….jpg`, and nothing else.
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

/// Where the page of a cycle stands in its store.
pub fn page_file(store: &Path, cycle: CycleId) -> PathBuf {
    store.join("reports").join(format!("cycle-{:06}.html", cycle.0))
}
