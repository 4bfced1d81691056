//! Moves the unpacked files to their final path, step by step. If a step fails, the previous steps are undone.
//!
//! Each step is a rename, which the file system performs completely or not at all. A file that is replaced is first
//! exchanged with the new file, and then renamed. Therefore one of the two is at the final path at any time.

use super::error::BackupError;
use rustix::fs::{CWD, RenameFlags, renameat_with};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// A completed step that can be undone.
#[derive(Debug)]
enum Step {
    /// A folder was created.
    Folder(PathBuf),
    /// A file or folder was unpacked beside its final path (staged).
    Staged(PathBuf),
    /// The staged file or folder was moved to its final path, at which nothing existed.
    Placed { staged: PathBuf, destination: PathBuf },
    /// The staged file or folder was exchanged with the one at the final path.
    Swapped { staged: PathBuf, destination: PathBuf },
    /// The replaced file or folder was renamed, so that it is kept.
    Kept { staged: PathBuf, kept: PathBuf },
}

/// The steps that were performed so far.
#[derive(Debug, Default)]
pub(super) struct RestoreTransaction {
    steps: Vec<Step>,
}

impl RestoreTransaction {
    /// Creates a folder and its parent folders, if they do not exist.
    pub fn make_folder(&mut self, folder: &Path) -> Result<(), BackupError> {
        let is_there = |folder: &&Path| folder.as_os_str().is_empty() || folder.is_dir();
        let missing: Vec<&Path> = folder.ancestors().take_while(|folder| !is_there(folder)).collect();
        for folder in missing.into_iter().rev() {
            fs::create_dir(folder).map_err(BackupError::file_error("create", folder))?;
            self.steps.push(Step::Folder(folder.to_owned()));
        }
        Ok(())
    }

    /// Records a staged file or folder, so that a rollback removes it.
    pub fn record_staged(&mut self, path: &Path) {
        self.steps.push(Step::Staged(path.to_owned()));
    }

    /// Moves a staged file or folder to its final path. With `may_replace`, an existing file or folder is kept as
    /// `NAME.before-restore-N`, unless it is an empty folder.
    pub fn move_to_final(&mut self, staged: &Path, at: &Path, may_replace: bool) -> Result<(), BackupError> {
        let rename = |from: &Path, to: &Path, flags: RenameFlags| {
            let renamed = renameat_with(CWD, from, CWD, to, flags);
            renamed.map_err(|error| BackupError::file_error("rename", from)(error.into()))
        };
        let [own_staged, own_at] = [staged, at].map(Path::to_owned);
        let is_empty = is_empty_folder(at);
        let is_replaced = may_replace && at.symlink_metadata().is_ok();
        if !is_empty && !is_replaced {
            rename(staged, at, RenameFlags::NOREPLACE)?;
            self.steps.push(Step::Placed { staged: own_staged, destination: own_at });
            return Ok(());
        }
        rename(staged, at, RenameFlags::EXCHANGE)?;
        self.steps.push(Step::Swapped { staged: own_staged, destination: own_at });
        if !is_empty {
            let kept = free_name(at);
            rename(staged, &kept, RenameFlags::NOREPLACE)?;
            self.steps.push(Step::Kept { staged: staged.to_owned(), kept });
        }
        Ok(())
    }

    /// Completes the restore, which can then no longer be undone. Returns the paths of the replaced files, which are
    /// kept.
    pub fn commit(self) -> Result<Vec<PathBuf>, BackupError> {
        let mut kept_all = Vec::new();
        for step in &self.steps {
            match step {
                Step::Kept { kept, .. } => kept_all.push(kept.clone()),
                // After the exchange, the staged path contains the empty folder that was replaced; it is removed.
                Step::Swapped { staged, .. } => drop(fs::remove_dir(staged)),
                Step::Placed { destination: at, .. } => flush_parent_folder(at)?,
                Step::Folder(_) | Step::Staged(_) => {}
            }
            if let Step::Swapped { destination: at, .. } = step {
                flush_parent_folder(at)?;
            }
        }
        Ok(kept_all)
    }

    /// Undoes all steps, the last one first, and returns the error. If a step cannot be undone, the error states the
    /// remaining changes.
    pub fn roll_back(self, cause: BackupError) -> BackupError {
        for (index, step) in self.steps.iter().enumerate().rev() {
            if let Err(words) = step.roll_back() {
                // The steps before this one cannot be undone either.
                let more = (index > 0).then(|| format!("{index} earlier steps were not undone"));
                return BackupError::RollbackFailed {
                    cause: Box::new(cause),
                    undone: std::iter::once(words).chain(more).collect(),
                };
            }
        }
        cause
    }
}

impl Step {
    fn roll_back(&self) -> Result<(), String> {
        let rename = |from: &Path, to: &Path, flags: RenameFlags| {
            renameat_with(CWD, from, CWD, to, flags)
                .map_err(|error| format!("{} could not be renamed to {}: {error}", from.display(), to.display()))
        };
        let removed =
            |path: &Path, error: std::io::Error| format!("{} could not be removed: {error}", path.display());
        match self {
            Step::Folder(folder) => fs::remove_dir(folder).map_err(|error| removed(folder, error)),
            Step::Staged(path) if path.is_dir() => fs::remove_dir_all(path).map_err(|error| removed(path, error)),
            Step::Staged(path) if path.symlink_metadata().is_err() => Ok(()),
            Step::Staged(path) => fs::remove_file(path).map_err(|error| removed(path, error)),
            Step::Placed { staged, destination: at } => rename(at, staged, RenameFlags::NOREPLACE),
            Step::Swapped { staged, destination: at } => rename(staged, at, RenameFlags::EXCHANGE),
            Step::Kept { staged, kept } => rename(kept, staged, RenameFlags::NOREPLACE),
        }
    }
}

fn is_empty_folder(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|found| found.is_dir())
        && fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none())
}

/// Returns the path of a new file beside this path.
fn free_name(at: &Path) -> PathBuf {
    let mut number = 1_u32;
    loop {
        let mut name = at.as_os_str().to_owned();
        name.push(format!(".before-restore-{number}"));
        let path = PathBuf::from(name);
        if path.symlink_metadata().is_err() {
            return path;
        }
        number += 1;
    }
}

fn flush_parent_folder(path: &Path) -> Result<(), BackupError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(BackupError::file_error("flush", folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file that exists at a final path is not replaced, and the three steps before are undone.
    #[test]
    fn a_failed_step_undoes_the_earlier_steps() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let write = |name: &str| fs::write(at(name), name).expect("written");
        let listed = || {
            let names =
                fs::read_dir(folder.path()).expect("listed").map(|entry| entry.expect("an entry").file_name());
            let mut names: Vec<String> = names.filter_map(|name| name.into_string().ok()).collect();
            names.sort();
            names
        };
        write("cell.toml");
        write("lens.toml");
        fs::create_dir(at("store")).expect("an empty folder");
        let before = listed();
        let mut placing = RestoreTransaction::default();
        placing.make_folder(&at("a/b")).expect("made");
        for name in ["new-cell", "new-lens"] {
            write(name);
            placing.record_staged(&at(name));
        }
        fs::create_dir(at("new-store")).expect("made");
        fs::write(at("new-store/rows"), "rows").expect("written");
        placing.record_staged(&at("new-store"));
        placing.move_to_final(&at("new-store"), &at("store"), false).expect("nothing was there");
        placing.move_to_final(&at("new-cell"), &at("cell.toml"), true).expect("replaced");
        assert_eq!(fs::read_to_string(at("cell.toml")).expect("read"), "new-cell");
        assert_eq!(fs::read_to_string(at("cell.toml.before-restore-1")).expect("kept"), "cell.toml");
        let error = placing.move_to_final(&at("new-lens"), &at("lens.toml"), false).expect_err("it is there");
        let error = placing.roll_back(error).to_string();
        assert!(error.contains("cannot rename") && !error.contains("could not be undone"), "{error}");
        assert_eq!(listed(), before);
        assert_eq!(fs::read_to_string(at("cell.toml")).expect("read"), "cell.toml");
        assert!(is_empty_folder(&at("store")));
    }
}
