//! Copies the database with SQLite's online backup, while a service may write to it. The copy is made for a backup, and
//! before the tables of an earlier program version are migrated.

use super::chain::ChainPosition;
use super::database::{DATABASE, Store};
use super::error::StoreError;
use super::flush::file_hash;
use super::head::HeadFile;
use super::{chain, flush, head, prune};
use rusqlite::Connection;
use rusqlite::backup::{Backup, StepResult};
use rustix::fs::{CWD, RenameFlags, renameat_with};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Maximum time that the copy waits for a lock of the database.
const LOCK_TIMEOUT: Duration = Duration::from_secs(30);
const LOCK_RETRY_INTERVAL: Duration = Duration::from_millis(10);

/// The result of copying the rows of a store.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CopiedStore {
    /// Contradictions found in the store, as texts. If there are any, no copy was made.
    pub deviations: Vec<String>,
    /// Number of links in the copied chain.
    pub links: u64,
    /// The hashes of the files that the copied rows name, without the files that were removed according to `[store]
    /// keep`.
    pub files: Vec<String>,
}

/// The files of a store, in addition to the folder `blobs/`.
pub const ROW_FILES: [&str; 2] = [DATABASE, head::FILE];
/// The folder of the files to which the rows of the database refer.
pub const BLOBS: &str = "blobs";

impl Store {
    /// Copies the rows of the store in `folder`, and the head of its chain, into the folder `to`, and verifies the
    /// copy. A service may write to the store meanwhile; the copy contains the state at one moment.
    ///
    /// # Errors
    /// If there is no store, it was written by an earlier program version, or the copy cannot be written.
    pub fn copy_rows(folder: &Path, to: &Path) -> Result<CopiedStore, StoreError> {
        let store = Store::open(folder)?;
        // A read transaction begins: from now on the rows do not change for this connection, and the head is that of
        // the same moment.
        let begin = || -> Result<ChainPosition, rusqlite::Error> {
            store.connection.execute_batch("BEGIN")?;
            chain::last_link(&store.connection)
        };
        let (head_read, last) = match head::read_locked(folder, begin) {
            Ok((head_read, last)) => (Ok(head_read), last),
            // A lock that is not released in time does not mean that the store was changed.
            Err(error) if error.kind() == std::io::ErrorKind::TimedOut => {
                return Err(file_error("read the head in", folder)(error));
            }
            Err(error) => (Err(error), begin()),
        };
        let last = last.map_err(|error| store.database_error("read the chain of", &error))?;
        // The copy gets a new head, which must not hide contradictions between the store and its head.
        let found = store.end_contradictions(head_read, last)?;
        if !found.is_empty() {
            return Ok(CopiedStore { deviations: found, ..CopiedStore::default() });
        }
        let copy = to.join(DATABASE);
        fs::create_dir_all(to).map_err(file_error("create", to))?;
        copy_database(&store.connection, &copy).map_err(|error| StoreError::database("write", &copy, &error))?;
        let write_head = || {
            let hash = file_hash(&copy)?;
            HeadFile::open(to)?.close(last, Some(hash))
        };
        write_head().map_err(file_error("write the head in", to))?;
        let removed = prune::removed_files(&store)?;
        let named = prune::named_files(&store, &|_| false)?;
        let files = named.into_iter().filter(|hash| !is_removed_file(&store, &removed, hash)).collect();
        let verified = Store::verify(to, false)?;
        Ok(CopiedStore { deviations: verified.differences, links: verified.links, files })
    }
}

fn is_removed_file(store: &Store, removed: &std::collections::BTreeSet<String>, hash: &str) -> bool {
    removed.contains(hash) && !store.folder().join(BLOBS).join(hash).exists()
}

/// Copies the database, as this connection sees it, to a new file without a write-ahead log.
fn copy_database(connection: &Connection, to: &Path) -> Result<(), rusqlite::Error> {
    let mut copy = Connection::open(to)?;
    {
        let backup = Backup::new(connection, &mut copy)?;
        let since = Instant::now();
        loop {
            match backup.step(-1)? {
                StepResult::Done => break,
                StepResult::Busy | StepResult::Locked if since.elapsed() > LOCK_TIMEOUT => {
                    let busy = rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_BUSY);
                    return Err(rusqlite::Error::SqliteFailure(busy, None));
                }
                StepResult::Busy | StepResult::Locked => std::thread::sleep(LOCK_RETRY_INTERVAL),
                _ => {}
            }
        }
    }
    copy.pragma_update(None, "journal_mode", "DELETE")?;
    copy.close().map_err(|(_, error)| error)
}

/// Keeps a copy of the database and the head of its chain before the tables of an earlier version of this program are
/// changed: `panelprep.schema-1.sqlite`, `panelprep.schema-1.head`. An existing copy is never overwritten. Returns the
/// copy's file.
pub(super) fn keep_earlier_version(
    connection: &Connection,
    folder: &Path,
    version: i64,
) -> Result<PathBuf, StoreError> {
    let part = folder.join(format!("panelprep.schema-{version}.part"));
    let remove = || {
        for file in [part.clone(), folder.join(format!("panelprep.schema-{version}.part-journal"))] {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "a file that cannot be removed is reported by the next step"
            )]
            let _ = fs::remove_file(file);
        }
    };
    // These temporary files were left by a process that ended.
    remove();
    let kept = copy_to_free_name(connection, (folder, &part), version);
    if kept.is_err() {
        remove();
    }
    kept
}

fn copy_to_free_name(
    connection: &Connection,
    (folder, part): (&Path, &Path),
    version: i64,
) -> Result<PathBuf, StoreError> {
    copy_database(connection, part).map_err(|error| StoreError::database("copy", part, &error))?;
    File::open(part).and_then(|file| file.sync_all()).map_err(file_error("flush", part))?;
    let hash = |file: &Path| file_hash(file).map_err(file_error("read", file));
    let copied = hash(part)?;
    let mut number = 1;
    let [database, head] = loop {
        let suffix = if number == 1 { String::new() } else { format!("-{number}") };
        let name = |ending: &str| folder.join(format!("panelprep.schema-{version}{suffix}.{ending}"));
        let database = name("sqlite");
        if !database.exists() {
            break [database, name("head")];
        }
        // An interrupted migration has already stored the same copy.
        if hash(&database)? == copied {
            fs::remove_file(part).map_err(file_error("remove", part))?;
            return Ok(database);
        }
        number += 1;
    };
    let own_head = folder.join(head::FILE);
    if own_head.exists() {
        fs::copy(&own_head, &head).map_err(file_error("write", &head))?;
        File::open(&head).and_then(|file| file.sync_all()).map_err(file_error("flush", &head))?;
    }
    let renamed = renameat_with(CWD, part, CWD, &database, RenameFlags::NOREPLACE);
    renamed.map_err(|error| file_error("rename", part)(error.into()))?;
    flush::flush_folder(folder).map_err(file_error("flush", folder))?;
    Ok(database)
}

fn file_error<'p>(doing: &'static str, path: &'p Path) -> impl Fn(std::io::Error) -> StoreError + 'p {
    move |source| StoreError::File { operation: doing, path: path.to_owned(), source }
}
