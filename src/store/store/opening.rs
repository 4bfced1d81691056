//! Opening and closing a store.

use super::blobs::Blobs;
use super::chain::ChainPosition;
use super::database::{DATABASE, Steps, Store};
use super::error::StoreError;
use super::flush::{file_hash, log_path};
use super::fullness::{DiskFullness, ReserveFile};
use super::head::{Head, HeadFile};
use super::lease::WriteLease;
use super::{chain, copy, flush, fullness, head, schema, search};
use rusqlite::{Connection, OpenFlags, TransactionBehavior};
use std::path::Path;
use std::time::SystemTime;

/// Number of statements that stay compiled: those of every table's rows, of the chain, and of each write.
const STATEMENTS: usize = 100;

impl Store {
    /// Opens the store in this folder for reading, also beside a writer. Nothing is made or changed.
    ///
    /// # Errors
    /// If there is no store, it is damaged, or it belongs to a newer program or to another one.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
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

    /// Opens the store in this folder for writing, as the only writer. An empty or absent folder becomes a new store.
    /// An earlier program's store is brought up to date, after a copy of its database was made beside it. A change
    /// made outside this program is stored as an incident, see [`Store::changed`].
    ///
    /// # Errors
    /// If another process writes to it, the folder cannot be written, its disk is full, or the store is damaged, or
    /// belongs to a newer program or to another one.
    pub fn create(folder: &Path) -> Result<Self, StoreError> {
        let opened = match Store::create_store(folder) {
            // A full disk must not keep the cell from starting: the reserve holds the space for opening and for an
            // orderly end.
            Err(error) if is_open_failure_full(&error, folder) && ReserveFile::new(folder).release() => {
                Store::create_store(folder)
            }
            opened => opened,
        };
        opened.map_err(
            |error| if is_open_failure_full(&error, folder) { fullness::disk_full_error(folder) } else { error },
        )
    }

    /// Opens a store for signing, beside its writer, if it has one. Signing does not handle a change made outside this
    /// program: a head that contradicts the rows must stay as it is until the next start has checked it.
    pub(super) fn for_signing(folder: &Path) -> Result<Self, StoreError> {
        let store = Store::open_beside_writer(folder)?;
        let version = schema::version(&store.connection, store.path())?;
        if version < schema::SCHEMA {
            return Err(StoreError::Older { path: folder.to_owned(), found: version, known: schema::SCHEMA });
        }
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
        // Before anything is read: a second writer would find a head that the first one is about to change, and report
        // it as damage.
        let lease = WriteLease::acquire(folder)?;
        let path = folder.join(DATABASE);
        // Data that the last process wrote but did not flush is flushed first: a power cut after this start could
        // otherwise still lose it.
        flush::flush_after_kill(&path)?;
        let head_read = head::read(folder);
        let failed = |error: rusqlite::Error| StoreError::database("open", &path, &error);
        let connection = Connection::open(&path).map_err(failed)?;
        let version = schema::version(&connection, &path)?;
        schema::check_pages(&connection, &path)?;
        if (1..schema::SCHEMA).contains(&version) {
            let kept = copy::keep_earlier_version(&connection, folder, version)?;
            tracing::info!("the store's tables are updated; a copy of the old ones is kept in {}", kept.display());
        }
        schema::prepare(&connection).map_err(failed)?;
        let head = HeadFile::open(folder).map_err(|error| head_error(folder, error))?;
        let mut store = Store::new((connection, blobs), folder);
        (store.lease, store.head) = (Some(lease), Some(head));
        let found = store.raise(version).map_err(failed)?.map_err(|error| head_error(folder, error))?;
        store.external_changes = store.head_contradictions(head_read, found)?;
        if store.external_changes.is_empty() {
            // Only if nothing contradicts it: a new head would remove the evidence that rows are missing.
            store.update_head(found).map_err(|error| head_error(folder, error))?;
        } else {
            store.external_changes.iter().for_each(|words| tracing::warn!("the store was changed: {words}"));
            // The journal is written first, for every purpose of opening: a stored incident is not reported again,
            // and a cell with an incident must rest in Aborted until a person clears it.
            store.recover()?;
            store.store_incident(&store.external_changes.clone())?;
            // The office may already have the numbers of the missing rows.
            store.begin_epoch("rows of the store were changed or are missing")?;
        }
        store.begin_epoch_if_restored()?;
        if let Err(error) = store.reserve.allocate() {
            tracing::warn!("the reserve for a full disk could not be created in {}: {error}", folder.display());
            if error.kind() == std::io::ErrorKind::StorageFull {
                store.fullness.mark_full();
                // Without space for the journal no cycle may begin, and the store may not be opened.
                if fullness::is_too_full_for_journal(folder) {
                    return Err(fullness::disk_full_error(folder));
                }
            }
        }
        Ok(store)
    }

    fn new((connection, blobs): (Connection, Blobs), folder: &Path) -> Self {
        connection.set_prepared_statement_cache_capacity(STATEMENTS);
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

    /// Brings the tables up to date and returns the chain's previous position: the beginning if there was none.
    fn raise(&mut self, version: i64) -> Result<Result<ChainPosition, std::io::Error>, rusqlite::Error> {
        let Some(head) = &self.head else { return Ok(Ok(ChainPosition::START)) };
        let transaction = self.connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let before = if version < schema::CHAINED { ChainPosition::START } else { chain::last_link(&transaction)? };
        let Some(after) = schema::raise(&transaction)? else { return Ok(Ok(before)) };
        search::fill_missing_parts(&transaction, &self.blobs)?;
        // A head that has content is checked before it is overwritten.
        let is_new = matches!(head::read(self.blobs.store()), Ok(None));
        if is_new && let Err(error) = head.prepare(before, after) {
            return Ok(Err(error));
        }
        transaction.commit()?;
        Ok(Ok(before))
    }

    /// Returns contradictions between the chain's end and the head, and between recently written rows and the
    /// chain. Stored incidents are not reported again.
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
        let _turn = head.acquire_turn()?;
        // Another process may have stored a verification meanwhile.
        let at = chain::last_link(&self.connection).unwrap_or(found);
        head.write_position(at)
    }
}

impl Drop for Store {
    /// The last writer leaves a database without a log, and the database's hash in the head.
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
        // The hash of a database that did not close, or that has other rows than the head states, would explain a wrong
        // file.
        if std::mem::replace(&mut self.connection, nothing).close().is_err() || at != last {
            return;
        }
        // If another connection is open, the log stays, and the file alone is not the database.
        let is_log_left = log_path(&path).exists();
        if is_log_left && next.is_some() {
            // A commit failed at the disk, and so did closing the database. The commit's lines may still be in the
            // log, and then the next start finds them. The head continues to state this.
            return;
        }
        let database = if is_log_left { None } else { file_hash(&path).ok() };
        #[expect(
            clippy::let_underscore_must_use,
            reason = "without this write the head still describes the same end of the chain"
        )]
        let _ = head.acquire_turn().and_then(|_turn| head.close(last, database));
    }
}

fn head_error(folder: &Path, source: std::io::Error) -> StoreError {
    StoreError::File { operation: "write the head", path: folder.join(head::FILE), source }
}

/// Returns whether a store cannot be opened because its disk is full.
fn is_open_failure_full(error: &StoreError, folder: &Path) -> bool {
    match error {
        StoreError::Full { .. } => true,
        StoreError::File { source, .. } => source.kind() == std::io::ErrorKind::StorageFull,
        StoreError::Database { .. } => fullness::has_no_space(folder),
        _ => false,
    }
}
