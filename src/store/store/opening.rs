//! Opens and closes a store.

use super::blobs::Blobs;
use super::chain::ChainPosition;
use super::database::{DATABASE, Steps, Store};
use super::error::StoreError;
use super::flush::{file_hash, log_path};
use super::fullness::{DiskFullness, ReserveFile};
use super::head::{Head, HeadFile};
use super::lease::WriteLease;
use super::{chain, copy, flush, fullness, head, schema};
use rusqlite::{Connection, OpenFlags, TransactionBehavior};
use std::path::Path;
use std::time::SystemTime;

/// Maximum number of compiled SQL statements in the cache: for the rows of every table, for the chain, and for each
/// write.
const CACHED_STATEMENTS: usize = 100;

impl Store {
    /// Opens the store in this folder for reading, also while another process writes to it. Nothing is created or
    /// changed.
    ///
    /// # Errors
    /// If there is no store, it is damaged, or it was written by another version of this program or by another program.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let store = Store::open_any_schema(folder)?;
        schema::require_current(schema::version(&store.connection, store.path())?, folder)?;
        Ok(store)
    }

    /// Opens the store as [`Store::open`] does, also if its tables are not yet updated.
    pub(super) fn open_any_schema(folder: &Path) -> Result<Self, StoreError> {
        let path = folder.join(DATABASE);
        if !path.is_file() {
            return Err(StoreError::Missing { path: folder.to_owned() });
        }
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(&path, flags)
            .map_err(|error| StoreError::database("open", &path, &error))?;
        if schema::version(&connection, &path)? == 0 {
            return Err(StoreError::Missing { path: folder.to_owned() });
        }
        schema::check_pages(&connection, &path)?;
        Ok(Store::new((connection, Blobs::open_for_reading(folder)), folder))
    }

    /// Opens the store in this folder for writing, as the only writer. In an empty or absent folder a new store is
    /// created. The tables of an earlier version of this program are updated after a copy of the database was made
    /// beside it. A change made outside this program is stored as an incident, see [`Store::changed`].
    ///
    /// # Errors
    /// If another process writes to it, the folder cannot be written, its disk is full, or the store is damaged, or was
    /// written by a later version of this program or by another program.
    pub fn create(folder: &Path) -> Result<Self, StoreError> {
        let opened = match Store::create_store(folder) {
            // The cell must be able to start on a full disk: the reserve contains enough space to open the store and to
            // stop the cell safely.
            Err(error) if is_open_failure_full(&error, folder) && ReserveFile::new(folder).release() => {
                Store::create_store(folder)
            }
            opened => opened,
        };
        opened.map_err(
            |error| if is_open_failure_full(&error, folder) { fullness::disk_full_error(folder) } else { error },
        )
    }

    /// Opens a store to sign records, also while another process writes to it. If the head contradicts the rows,
    /// nothing is signed, and the head stays unchanged until the next start has checked it.
    pub(super) fn for_signing(folder: &Path) -> Result<Self, StoreError> {
        let store = Store::open_beside_writer(folder)?;
        let (head_read, last) = match head::read_locked(folder, || chain::last_link(&store.connection)) {
            Ok((head_read, last)) => (Ok(head_read), last),
            Err(error) => (Err(error), chain::last_link(&store.connection)),
        };
        let last = last.map_err(|error| store.database_error("read the chain of", &error))?;
        match store.end_contradictions(head_read, last)?.first() {
            None => Ok(store),
            Some(words) => Err(StoreError::Damaged { path: store.path().to_owned(), problem: words.clone() }),
        }
    }

    fn create_store(folder: &Path) -> Result<Self, StoreError> {
        let blobs = Blobs::create(folder)?;
        // The lock is acquired before anything is read: otherwise a second writer could read the head while the first
        // one changes it, and would report damage.
        let lease = WriteLease::acquire(folder)?;
        let path = folder.join(DATABASE);
        // First flush data that the last process wrote but did not flush: a power failure could still remove them.
        flush::flush_after_kill(&path)?;
        let head_read = head::read(folder);
        let failed = |error: rusqlite::Error| StoreError::database("open", &path, &error);
        let connection = Connection::open(&path).map_err(failed)?;
        let version = schema::version(&connection, &path)?;
        schema::check_pages(&connection, &path)?;
        if version > 0 && version < schema::SCHEMA {
            let kept = copy::keep_earlier_version(&connection, folder, version)?;
            tracing::info!("the store's tables are updated; a copy of the old ones is kept in {}", kept.display());
        }
        schema::prepare(&connection).map_err(failed)?;
        let head = HeadFile::open(folder).map_err(|error| head_error(folder, error))?;
        let mut store = Store::new((connection, blobs), folder);
        (store.lease, store.head) = (Some(lease), Some(head));
        let found = store.update_tables(version).map_err(failed)?.map_err(|error| head_error(folder, error))?;
        store.external_changes = store.head_contradictions(head_read, found)?;
        if store.external_changes.is_empty() {
            // The head is written only if there are no contradictions: a new head would remove the evidence of missing
            // rows.
            store.update_head(found).map_err(|error| head_error(folder, error))?;
        } else {
            store.external_changes.iter().for_each(|words| tracing::warn!("the store was changed: {words}"));
            // The event is written to the journal before the incident, for any use of the store: a stored incident is
            // not reported again, and a cell with an incident must stay in Aborted until a person clears it.
            store.recover()?;
            store.store_incident(&store.external_changes.clone())?;
            // The office server may have received other rows with the numbers of the missing ones.
            store.begin_epoch("rows of the store were changed or are missing")?;
        }
        store.begin_epoch_if_restored()?;
        if let Err(error) = store.reserve.allocate() {
            tracing::warn!(
                "the reserve for a full disk could not be created in {}: {error}; free space on this disk",
                folder.display()
            );
            if error.kind() == std::io::ErrorKind::StorageFull {
                store.fullness.mark_full();
                // If there is no space for the journal, the store is not opened, so that no cycle can begin.
                if fullness::is_too_full_for_journal(folder) {
                    return Err(fullness::disk_full_error(folder));
                }
            }
        }
        Ok(store)
    }

    fn new((connection, blobs): (Connection, Blobs), folder: &Path) -> Self {
        connection.set_prepared_statement_cache_capacity(CACHED_STATEMENTS);
        Store {
            connection,
            blobs,
            lease: None,
            head: None,
            is_journal_in_doubt: false,
            folded_state: None,
            external_changes: Vec::new(),
            is_change_recorded: false,
            reserve: ReserveFile::new(folder),
            fullness: DiskFullness::default(),
            clock: SystemTime::now,
            steps: Steps::default(),
        }
    }

    /// Updates the tables and returns the chain's previous position; the start of the chain if there was none.
    fn update_tables(&mut self, version: i64) -> Result<Result<ChainPosition, std::io::Error>, rusqlite::Error> {
        let Some(head) = &self.head else { return Ok(Ok(ChainPosition::START)) };
        let transaction = self.connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let before = if version == 0 { ChainPosition::START } else { chain::last_link(&transaction)? };
        let Some(after) = schema::update(&transaction)? else { return Ok(Ok(before)) };
        // A head that has content is checked before it is overwritten.
        let is_new = matches!(head::read(self.blobs.store()), Ok(None));
        if is_new && let Err(error) = head.prepare(before, after) {
            return Ok(Err(error));
        }
        transaction.commit()?;
        Ok(Ok(before))
    }

    /// Returns contradictions between the end of the chain and the head, and between recently written rows and the
    /// chain, as texts. Stored incidents are not reported again.
    fn head_contradictions(
        &self,
        head_read: Result<Option<head::HeadRead>, std::io::Error>,
        found: ChainPosition,
    ) -> Result<Vec<String>, StoreError> {
        let mut changed = self.end_contradictions(head_read, found)?;
        changed.extend(self.recent_contradictions()?);
        let known: Vec<String> = self.incidents()?.into_iter().flat_map(|incident| incident.found).collect();
        changed.retain(|words| !known.contains(words));
        Ok(changed)
    }

    fn update_head(&self, found: ChainPosition) -> Result<(), std::io::Error> {
        let Some(head) = &self.head else { return Ok(()) };
        let _turn = head.acquire_write_guard()?;
        // Another process may have stored a verification after the position was read.
        let at = chain::last_link(&self.connection).unwrap_or(found);
        head.write_position(at)
    }
}

impl Drop for Store {
    /// Closes the database. The last connection removes the write-ahead log, and the hash of the database file is
    /// written to the head.
    fn drop(&mut self) {
        let (Some(_), Some(head)) = (&self.lease, &self.head) else { return };
        let Ok(last) = chain::last_link(&self.connection) else { return };
        let Ok(Some(head::HeadRead { head: Head { position: at, next_position: next, .. }, .. })) =
            head::read(self.folder())
        else {
            return;
        };
        let path = self.path().to_owned();
        let Ok(nothing) = Connection::open_in_memory() else { return };
        // If the database was not closed, or its rows do not match the head, the head must not contain the hash of the
        // file.
        if std::mem::replace(&mut self.connection, nothing).close().is_err() || at != last {
            return;
        }
        // If another connection is open, the write-ahead log still exists, and the database file is incomplete without
        // it.
        let is_log_left = log_path(&path).exists();
        if is_log_left && next.is_some() {
            // Both a commit and closing the database have failed. The rows of the commit may still be in the log and
            // will then be found at the next start. The head contains both possible positions.
            return;
        }
        let database = if is_log_left { None } else { file_hash(&path).ok() };
        #[expect(
            clippy::let_underscore_must_use,
            reason = "without this write the head still describes the same end of the chain"
        )]
        let _ = head.acquire_write_guard().and_then(|_turn| head.close(last, database));
    }
}

fn head_error(folder: &Path, source: std::io::Error) -> StoreError {
    StoreError::File { operation: "write the head", path: folder.join(head::FILE), source }
}

/// Returns whether the cause for which a store cannot be opened is a full disk.
fn is_open_failure_full(error: &StoreError, folder: &Path) -> bool {
    match error {
        StoreError::Full { .. } => true,
        StoreError::File { source, .. } => source.kind() == std::io::ErrorKind::StorageFull,
        StoreError::Database { .. } => fullness::has_no_space(folder),
        _ => false,
    }
}
