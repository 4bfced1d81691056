//! The labels of a clip on the disk, made by the renderer or by a person: its mask and, if known, its times.

use super::disk;
use super::fault::{ClipFault, Fault};
use panelprep_base::geometry::{ColorPicture, Mask};
use panelprep_cell::files::{self, Clip, content_hash};
use panelprep_cell::labels::{self, LABELS, MASK, TIMES_FILE, decoded};
use std::path::{Path, PathBuf};

/// The ground truth of a clip.
pub struct Labels {
    /// The pixels in which the film was broken at the clip's end.
    pub mask: Mask,
    times: Option<ColorPicture>,
}

impl Labels {
    /// Reads a folder's labels. Labels that a person made must belong to this clip.
    ///
    /// # Errors
    /// If there is no mask, a file is invalid, or the clip is not the one that a person labelled.
    pub fn read(folder: &Path, clip: &Path) -> Result<Self, Fault> {
        let file = folder.join(LABELS);
        if file.exists() {
            let labelled = labels::read(&disk::read(&file)?).map_err(|error| Fault::file_fault(&file, error))?;
            if labelled.clip_sha256 != clip_hash(clip, &read_clip(clip)?)? {
                return Err(ClipFault::OtherClip { labels: file, clip: clip.to_owned() }.into());
            }
        }
        let file = folder.join(MASK);
        let gray = files::read_gray(&disk::read(&file)?).map_err(|error| Fault::file_fault(&file, error))?;
        let file = folder.join(TIMES_FILE);
        let times = match file.exists() {
            true => Some(files::read_color(&disk::read(&file)?).map_err(|error| Fault::file_fault(&file, error))?),
            false => None,
        };
        Ok(Labels { mask: Mask::from_gray(&gray), times })
    }

    /// The time at which the film broke at a pixel, s; `None` also if the time is not known.
    pub fn time_s(&self, index: usize) -> Option<f64> {
        decoded(*self.times.as_ref()?.rgb.get(index)?)
    }
}

/// Finds the labels of a clip of a set. They are in its folder `truth`, where the renderer writes them, or else in
/// the clip's own folder, where a person's labels are kept.
///
/// # Errors
/// If the clip has no labels.
pub fn find_label_folder(clip: &Path) -> Result<PathBuf, Fault> {
    let folders = [clip.join("truth"), clip.to_owned()];
    let labelled = folders.into_iter().find(|folder| folder.join(MASK).exists());
    labelled.ok_or_else(|| ClipFault::NoLabels { clip: clip.to_owned() }.into())
}

/// Reads a clip's list.
///
/// # Errors
/// If the folder holds none, or it is invalid.
pub fn read_clip(folder: &Path) -> Result<Clip, Fault> {
    let list = folder.join("clip.csv");
    files::read_clip(&disk::read(&list)?).map_err(|error| Fault::file_fault(&list, error))
}

/// The hash of a clip: the hash of the output of `sha256sum clip.csv FILE…`.
///
/// # Errors
/// If one of its files cannot be read.
pub fn clip_hash(folder: &Path, clip: &Clip) -> Result<String, Fault> {
    let names = std::iter::once("clip.csv").chain(clip.entries().iter().map(|shot| shot.file.as_str()));
    let lines: Result<String, Fault> =
        names.map(|name| Ok(format!("{}  {name}\n", content_hash(&disk::read(&folder.join(name))?)))).collect();
    Ok(content_hash(lines?.as_bytes()))
}
