//! A clip's labels on the disk: `labels.json` with its mask and times, the earlier versions, and the draft of
//! unsaved changes.
//!
//! A former `labels.json` is copied to the first free `labels.N.json` before it is replaced, so that none is lost;
//! the one with the lowest number is the oldest. Mask and times are written before `labels.json`, and the draft is
//! removed last. After a power cut in between, the draft still exists and is saved again.

use super::super::calibrate::date::now_unix_s;
use super::super::disk;
use super::super::fault::{ClipFault, Fault};
use crate::files;
use crate::labels::{self, ClipFrame, DRAFT, LABELS, LabelFile, MASK, Statement, TIMES, VERSION, broken, problems};
use crate::number_text::utc;
use crate::page::label::{LabelStorage, Now, Saved};
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
    pub fn now(&self) -> Result<Now, Fault> {
        let (labels, draft) = (self.labels()?, self.read(DRAFT)?);
        let saved_at = labels.as_ref().map(|labels| labels.saved_at.clone());
        let is_draft = draft.is_some();
        let Some(found) = draft.or(labels) else {
            return Ok(Now { said: Statement::default(), saved_at, is_draft, note: None });
        };
        let note = (found.clip_sha256 != self.clip_sha256).then(|| {
            "the clip has changed since these labels were made: check each break again, and save".to_owned()
        });
        Ok(Now { said: found.statement(), saved_at, is_draft, note })
    }

    fn file(&self, said: &Statement) -> LabelFile {
        LabelFile {
            version: VERSION,
            author: said.author.trim().to_owned(),
            saved_at: utc(now_unix_s()),
            clip_sha256: self.clip_sha256.clone(),
            size_px: self.frame.size_px,
            clean: said.clean,
            breaks: said.breaks.clone(),
        }
    }

    /// Copies the present labels to a file with the first free number.
    fn keep_former(&self) -> Result<Option<String>, Fault> {
        let file = self.folder.join(LABELS);
        if !file.exists() {
            return Ok(None);
        }
        let bytes = disk::read(&file)?;
        let mut number = 1_u32;
        loop {
            let name = format!("labels.{number}.json");
            match disk::write_new(&self.folder.join(&name), &bytes) {
                Err(Fault::IsThere { .. }) => number += 1,
                written => return written.map(|()| Some(name)),
            }
        }
    }

    /// Writes labels, mask and times; returns the file name under which the former labels are kept.
    fn write(&self, labels: &LabelFile) -> Result<Option<String>, Fault> {
        let broken = broken(&labels.breaks, &self.frame);
        let pictures = [
            (MASK, files::write_gray_png(&broken.mask().to_gray())),
            (TIMES, files::write_color_png(&broken.times())),
        ];
        let former = self.keep_former()?;
        for (name, bytes) in pictures {
            disk::write_through(&self.folder.join(name), bytes.map_err(Fault::stage)?)?;
        }
        disk::write_through(&self.folder.join(LABELS), labels::write(labels))?;
        let draft = self.folder.join(DRAFT);
        if draft.exists() {
            std::fs::remove_file(&draft).map_err(|error| Fault::file(&draft, error))?;
        }
        Ok(former)
    }
}

impl LabelStorage for LabelFolder {
    fn now(&self) -> Result<Now, String> {
        LabelFolder::now(self).map_err(|fault| fault.to_string())
    }

    fn draft(&self, said: &Statement) -> Result<(), String> {
        let text = labels::write(&self.file(said));
        disk::write(&self.folder.join(DRAFT), text).map_err(|fault| fault.to_string())
    }

    fn save(&self, said: &Statement) -> Result<Saved, Vec<String>> {
        let problems = problems(said, &self.frame);
        if !problems.is_empty() {
            return Err(problems.iter().map(ToString::to_string).collect());
        }
        let labels = self.file(said);
        let former = self.write(&labels).map_err(|fault| vec![fault.to_string()])?;
        Ok(Saved { labels: self.folder.join(LABELS).display().to_string(), saved_at: labels.saved_at, former })
    }
}
