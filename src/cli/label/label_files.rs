//! A clip's labels on the disk: `labels.json` with its mask and times, the earlier versions, and the draft of
//! unsaved changes.
//!
//! A former `labels.json` is copied to the first free `labels.N.json` before it is replaced, so that none is lost;
//! the one with the lowest number is the oldest. Mask and times are written before `labels.json`, and the draft is
//! removed last. After a power cut in between, the draft still exists and is saved again.

use super::super::calibrate::now_unix_s;
use super::super::disk;
use super::super::fault::{ClipFault, Fault};
use panelprep_base::number_text::utc_text;
use panelprep_cell::files;
use panelprep_cell::labels::{
    self, ClipFrame, DRAFT_FILE, LABELS, LabelFile, MASK, Statement, TIMES_FILE, VERSION, broken_pixels, problems,
};
use panelprep_interfaces::page::label::{CurrentLabels, LabelStorage, SaveResult};
use std::path::{Path, PathBuf};

/// The folder in which the labels of a clip are stored.
pub struct LabelFolder {
    folder: PathBuf,
    clip_sha256: String,
    frame: ClipFrame,
}

impl LabelFolder {
    /// Creates the storage of labels for the clip in this folder.
    pub fn new(folder: &Path, clip_sha256: String, frame: ClipFrame) -> Self {
        LabelFolder { folder: folder.to_owned(), clip_sha256, frame }
    }

    fn read(&self, name: &str) -> Result<Option<LabelFile>, Fault> {
        let file = self.folder.join(name);
        if !file.exists() {
            return Ok(None);
        }
        let found = labels::read(&disk::read(&file)?)
            .map_err(|error| ClipFault::BadLabels { file: file.clone(), cause: error })?;
        Ok(Some(found))
    }

    /// The labels as they were saved last.
    ///
    /// # Errors
    /// If the file is invalid.
    pub fn labels(&self) -> Result<Option<LabelFile>, Fault> {
        self.read(LABELS)
    }

    /// The present contents: the draft if there is one, else the labels.
    ///
    /// # Errors
    /// If a file is invalid.
    pub fn now(&self) -> Result<CurrentLabels, Fault> {
        let (labels, draft) = (self.labels()?, self.read(DRAFT_FILE)?);
        let saved_at = labels.as_ref().map(|labels| labels.saved_at.clone());
        let is_draft = draft.is_some();
        let Some(found) = draft.or(labels) else {
            return Ok(CurrentLabels { said: Statement::default(), saved_at, is_draft, note: None });
        };
        let note = (found.clip_sha256 != self.clip_sha256).then(|| {
            "the clip has changed since these labels were made: check each break again, and save".to_owned()
        });
        Ok(CurrentLabels { said: found.statement(), saved_at, is_draft, note })
    }

    fn label_file(&self, said: &Statement) -> LabelFile {
        LabelFile {
            version: VERSION,
            author: said.author.trim().to_owned(),
            saved_at: utc_text(now_unix_s()),
            clip_sha256: self.clip_sha256.clone(),
            size_px: self.frame.size_px,
            clean: said.clean,
            breaks: said.breaks.clone(),
        }
    }

    /// Copies the present labels to a file with the first free number.
    fn back_up_former(&self) -> Result<Option<String>, Fault> {
        let file = self.folder.join(LABELS);
        if !file.exists() {
            return Ok(None);
        }
        let bytes = disk::read(&file)?;
        let mut number = 1_u32;
        loop {
            let name = format!("labels.{number}.json");
            match disk::write_new(&self.folder.join(&name), &bytes) {
                Err(Fault::AlreadyExists { .. }) => number += 1,
                written => return written.map(|()| Some(name)),
            }
        }
    }

    /// Writes labels, mask and times; returns the file name under which the former labels are kept.
    fn write(&self, labels: &LabelFile) -> Result<Option<String>, Fault> {
        let broken = broken_pixels(&labels.breaks, &self.frame);
        let pictures = [
            (MASK, files::write_gray_png(&broken.mask().to_gray())),
            (TIMES_FILE, files::write_color_png(&broken.times())),
        ];
        let former = self.back_up_former()?;
        for (name, bytes) in pictures {
            disk::write_durable(&self.folder.join(name), bytes.map_err(Fault::stage)?)?;
        }
        disk::write_durable(&self.folder.join(LABELS), labels::write(labels))?;
        let draft = self.folder.join(DRAFT_FILE);
        if draft.exists() {
            std::fs::remove_file(&draft).map_err(|error| Fault::file_fault(&draft, error))?;
        }
        Ok(former)
    }
}

impl LabelStorage for LabelFolder {
    fn now(&self) -> Result<CurrentLabels, String> {
        LabelFolder::now(self).map_err(|fault| fault.to_string())
    }

    fn store_draft(&self, said: &Statement) -> Result<(), String> {
        let text = labels::write(&self.label_file(said));
        disk::write(&self.folder.join(DRAFT_FILE), text).map_err(|fault| fault.to_string())
    }

    fn save(&self, said: &Statement) -> Result<SaveResult, Vec<String>> {
        let problems = problems(said, &self.frame);
        if !problems.is_empty() {
            return Err(problems.iter().map(ToString::to_string).collect());
        }
        let labels = self.label_file(said);
        let former = self.write(&labels).map_err(|fault| vec![fault.to_string()])?;
        Ok(SaveResult { labels: self.folder.join(LABELS).display().to_string(), saved_at: labels.saved_at, former })
    }
}
