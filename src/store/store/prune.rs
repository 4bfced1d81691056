//! Removes old files: the clips and scans of ended cycles. Pages and records are kept for ever.

use super::database::Store;
use super::error::StoreError;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cell::Retention;
use panelprep_cell::record::{CycleId, Finding};
use rusqlite::params;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

pub(super) const TABLES: &str = "
    CREATE TABLE pruned (
        id INTEGER PRIMARY KEY,
        cycle_id INTEGER NOT NULL REFERENCES cycles (id),
        hash TEXT NOT NULL,
        bytes INTEGER NOT NULL,
        at_unix_s INTEGER NOT NULL
    ) STRICT;
";

/// Number of files that are removed in one transaction. The removal ends if a cycle begins between two transactions.
const BATCH_FILES: usize = 64;
const DAY_S: i64 = 86_400;

/// Number and size of removed files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PrunedFiles {
    /// Number of removed files.
    pub files: u64,
    /// Total size of the removed files, bytes.
    pub bytes: u64,
    /// Time of the last removal, s since 1970.
    pub at_unix_s: Option<i64>,
}

/// An ended cycle whose files may be removed.
struct EndedCycleFiles {
    id: i64,
    at_unix_s: i64,
    verdict: String,
}

impl Store {
    /// Removes the clips and scans of ended cycles from the store in this folder, after the time in `keep`. Another
    /// process may write to the store meanwhile, but no file is removed while a cycle is in progress. Files of cycles
    /// that need a person's decision (verdict review), files that are on a page, and files that another row names are
    /// kept. Each file is recorded in the hash chain before it is removed, so that it can be distinguished from a
    /// missing file.
    ///
    /// # Errors
    /// If the store cannot be read or written, or a file cannot be removed.
    pub fn prune(folder: &Path, keep: &Retention) -> Result<PrunedFiles, StoreError> {
        let mut pruned = PrunedFiles::default();
        if keep.is_unlimited() {
            return Ok(pruned);
        }
        let mut store = Store::open_beside_writer(folder)?;
        let due = store.due_cycles(keep)?;
        let needed = named_files(&store, &|id| due.contains(&id))?;
        let gone = removed_files(&store)?;
        for id in due {
            let old = removable_files(&store, id)?;
            for hashes in old.difference(&needed).cloned().collect::<Vec<_>>().chunks(BATCH_FILES) {
                if !store.prune_files(id, (hashes, &gone), &mut pruned)? {
                    return Ok(pruned);
                }
            }
        }
        Ok(pruned)
    }

    /// Returns the number and the size of the files that were removed from a cycle; `None` if no file was removed.
    ///
    /// # Errors
    /// If the list of removed files cannot be read.
    pub fn pruned_files(&self, id: CycleId) -> Result<Option<PrunedFiles>, StoreError> {
        let sql = "SELECT count(*), coalesce(sum(bytes), 0), max(at_unix_s) FROM pruned WHERE cycle_id = ?1";
        let row = |row: &rusqlite::Row<'_>| {
            let (files, bytes): (i64, i64) = (row.get(0)?, row.get(1)?);
            Ok(PrunedFiles { files: files as u64, bytes: bytes as u64, at_unix_s: row.get(2)? })
        };
        let pruned = self.connection.query_row(sql, [id.0], row);
        let pruned = pruned.map_err(|error| self.database_error("read the list of removed files from", &error))?;
        Ok(Some(pruned).filter(|pruned| pruned.files > 0))
    }

    /// Returns the cycles whose clips and scans may be removed. Days are counted back from the end of the newest cycle,
    /// not from the present time, so that a wrong clock removes nothing.
    fn due_cycles(&self, keep: &Retention) -> Result<Vec<i64>, StoreError> {
        let read = || -> Result<Vec<EndedCycleFiles>, rusqlite::Error> {
            let sql = "SELECT id, ended_unix_s, verdict FROM cycles WHERE verdict IS NOT NULL ORDER BY id DESC";
            let row = |row: &rusqlite::Row<'_>| {
                Ok(EndedCycleFiles { id: row.get(0)?, at_unix_s: row.get(1)?, verdict: row.get(2)? })
            };
            self.connection.prepare(sql)?.query_map([], row)?.collect()
        };
        let ended = read().map_err(|error| self.database_error("read the cycles of", &error))?;
        let newest_s = ended.first().map_or(0, |cycle| cycle.at_unix_s.min(self.unix_s()));
        let has_passed = |cycle: &EndedCycleFiles| {
            [Verdict::Pass, Verdict::Accept].iter().any(|it| it.keyword() == cycle.verdict)
        };
        let mut due = Vec::new();
        // Passed and failed cycles are counted separately, so that many passed cycles do not displace the few failed
        // ones.
        for (passed, keep) in [(true, keep.passed), (false, keep.failed)] {
            let of_kind = ended.iter().filter(|cycle| has_passed(cycle) == passed);
            for (newer, cycle) in of_kind.filter(|cycle| cycle.verdict != Verdict::Review.keyword()).enumerate() {
                let old_s = newest_s - cycle.at_unix_s;
                let too_old = keep.days.is_some_and(|days| old_s > days as i64 * DAY_S);
                if too_old || keep.cycles.is_some_and(|most| newer >= most) {
                    due.push(cycle.id);
                }
            }
        }
        Ok(due)
    }

    /// Records files of a cycle as removed, and then deletes them. Returns false, without removing files, if a cycle is
    /// in progress.
    fn prune_files(
        &mut self,
        id: i64,
        (hashes, gone): (&[String], &BTreeSet<String>),
        pruned: &mut PrunedFiles,
    ) -> Result<bool, StoreError> {
        let blobs = self.blobs.folder().to_owned();
        // A file that is already missing is not recorded as removed, so that the verification reports it.
        let there: Vec<(&String, i64)> = hashes
            .iter()
            .filter_map(|hash| Some((hash, i64::try_from(blobs.join(hash).metadata().ok()?.len()).ok()?)))
            .collect();
        let at_unix_s = self.unix_s();
        let may = self.commit("write the list of removed files to", |writing| {
            let sql = "SELECT count(*) FROM cycles WHERE verdict IS NULL";
            let running: i64 = writing.query_row(sql, [], |row| row.get(0))?;
            // This check is part of the transaction, so that no cycle can begin between the check and the rows.
            if running > 0 {
                return Ok(false);
            }
            // The rows already exist if an earlier process ended after it wrote them and before it deleted the files.
            for (hash, bytes) in there.iter().filter(|(hash, _)| !gone.contains(*hash)) {
                let sql = "INSERT INTO pruned (cycle_id, hash, bytes, at_unix_s) VALUES (?1, ?2, ?3, ?4)";
                writing.execute(sql, params![id, hash, bytes, at_unix_s])?;
                writing.chain("pruned", writing.last_insert_rowid())?;
            }
            Ok(true)
        })?;
        if may {
            for (hash, bytes) in &there {
                let path = blobs.join(hash);
                fs::remove_file(&path).map_err(|source| StoreError::File { operation: "remove", path, source })?;
                (pruned.files, pruned.bytes) = (pruned.files + 1, pruned.bytes + bytes.unsigned_abs());
            }
            pruned.at_unix_s = Some(at_unix_s);
        }
        Ok(may)
    }
}

/// Returns the files of a cycle that can be removed: the pictures of its clips, and the original pictures and scans of
/// the cameras. The lists of the clips are kept, because they name the pictures.
fn removable_files(store: &Store, id: i64) -> Result<BTreeSet<String>, StoreError> {
    let mut old = BTreeSet::new();
    for (_, finding) in findings(store, Some(id))? {
        for shot in finding.shots {
            if shot.name.starts_with(CLIP_LIST_NAME) {
                old.extend(clip(store, &shot.hash));
            } else {
                old.insert(shot.hash);
            }
        }
    }
    Ok(old)
}

/// Returns all files that a row names. For cycles in `due`, the files that can be removed are not included.
pub(super) fn named_files(store: &Store, due: &dyn Fn(i64) -> bool) -> Result<BTreeSet<String>, StoreError> {
    let read = |error: rusqlite::Error| store.database_error("read the names of files in", &error);
    let mut named = BTreeSet::new();
    let sql = "SELECT scan_hash FROM taught_panels UNION SELECT picture_hash FROM taught_corners
        UNION SELECT recipe_hash FROM cycles UNION SELECT value ->> 'hash' FROM cycles, json_each(files)
        UNION SELECT record_hash FROM signatures";
    let mut statement = store.connection.prepare(sql).map_err(read)?;
    for hash in statement.query_map([], |row| row.get::<_, String>(0)).map_err(read)? {
        named.insert(hash.map_err(read)?);
    }
    for (cycle, finding) in findings(store, None)? {
        named.extend(finding.pictures.into_iter().map(|picture| picture.hash));
        for shot in finding.shots {
            let is_list = shot.name.starts_with(CLIP_LIST_NAME);
            if is_list && !due(cycle) {
                named.extend(clip(store, &shot.hash));
            }
            if is_list || !due(cycle) {
                named.insert(shot.hash);
            }
        }
    }
    Ok(named)
}

/// Returns the findings of one cycle, or of all cycles, each with its cycle.
fn findings(store: &Store, id: Option<i64>) -> Result<Vec<(i64, Finding)>, StoreError> {
    let read = || -> Result<Vec<(i64, String)>, rusqlite::Error> {
        let sql = "SELECT cycle_id, finding FROM findings WHERE ?1 IS NULL OR cycle_id = ?1 ORDER BY id";
        store.connection.prepare(sql)?.query_map([id], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
    };
    let rows = read().map_err(|error| store.database_error("read the findings of", &error))?;
    rows.into_iter().map(|(cycle, text)| Ok((cycle, store.parse_stored(&text)?))).collect()
}

/// Beginning of the name under which a finding stores the list of a clip's pictures.
const CLIP_LIST_NAME: &str = "clip.csv";

/// Returns the hashes of the pictures in a clip's list; empty if the list is missing.
fn clip(store: &Store, hash: &str) -> Vec<String> {
    let list = store.blob(hash).ok().and_then(|bytes| String::from_utf8(bytes).ok());
    let lines = list.as_deref().unwrap_or_default().lines().skip(1);
    lines.filter_map(|line| Some(line.split_once(',')?.0.to_owned())).collect()
}

/// Returns the hashes of all removed files.
pub(super) fn removed_files(store: &Store) -> Result<BTreeSet<String>, StoreError> {
    let read = |error: rusqlite::Error| store.database_error("read the list of removed files from", &error);
    let mut statement = store.connection.prepare("SELECT hash FROM pruned").map_err(read)?;
    statement.query_map([], |row| row.get(0)).map_err(read)?.collect::<Result<_, _>>().map_err(read)
}
