//! What is remembered: taught panels, and the files that they were made from.
//!
//! A folder with `panelprep.sqlite` (WAL, synchronous FULL, one writer at a time) and `blobs/`, where scans and
//! pictures lie under their SHA-256. Blobs are written first, the row that names them last and in one
//! transaction: a row never names a file that is not whole. Rows and blobs are never changed. Only raw inputs are
//! kept; what is derived from them is derived again on loading, by others.

mod blobs;
mod error;
mod teaching;

pub use error::StoreError;
pub use teaching::{Taught, TaughtCorner, Teaching};

use blobs::Blobs;
use rusqlite::{Connection, TransactionBehavior};
use std::path::Path;

const DATABASE: &str = "panelprep.sqlite";
/// Raised with every change of the tables; each older one gets a step in [`Store::open`].
const SCHEMA: i64 = 1;

/// An open store.
#[derive(Debug)]
pub struct Store {
    connection: Connection,
    blobs: Blobs,
}

impl Store {
    /// Opens the store in this folder; an empty or absent folder becomes a new one.
    ///
    /// # Errors
    /// Where the folder cannot be written, or holds the database of a newer program or of another one.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let blobs = Blobs::open(folder)?;
        let path = folder.join(DATABASE);
        let failed = |error: rusqlite::Error| StoreError::database("open", &path, &error);
        let mut connection = Connection::open(&path).map_err(failed)?;
        // Looked at before anything is set: a database that is not ours stays as it is.
        match schema(&connection).map_err(failed)? {
            (SCHEMA, _) | (0, 0) => {}
            (found, _) if found > SCHEMA => return Err(StoreError::Newer { path, found, known: SCHEMA }),
            _ => return Err(StoreError::Foreign { path }),
        }
        prepare(&mut connection).map_err(failed)?;
        Ok(Store { connection, blobs })
    }

    /// Keeps these bytes; the hash is what [`Store::blob`] finds them by. Bytes that are there already are kept once.
    ///
    /// # Errors
    /// Where the file cannot be written, or is there already and damaged.
    pub fn put_blob(&self, bytes: &[u8]) -> Result<String, StoreError> {
        self.blobs.put(bytes)
    }

    /// The bytes with this hash.
    ///
    /// # Errors
    /// Where the file is missing or no longer has this hash.
    pub fn blob(&self, hash: &str) -> Result<Vec<u8>, StoreError> {
        self.blobs.get(hash)
    }

    fn failed(&self, doing: &'static str, error: &rusqlite::Error) -> StoreError {
        StoreError::database(doing, Path::new(self.connection.path().unwrap_or(DATABASE)), error)
    }
}

/// The schema's version and the number of tables and indices.
fn schema(connection: &Connection) -> Result<(i64, i64), rusqlite::Error> {
    let version = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    let entries = connection.query_row("SELECT count(*) FROM sqlite_master", [], |row| row.get(0))?;
    Ok((version, entries))
}

fn prepare(connection: &mut Connection) -> Result<(), rusqlite::Error> {
    connection.pragma_update(None, "journal_mode", "WAL")?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", "ON")?;
    let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    // Asked again under the lock: another program may have made the tables meanwhile.
    if schema(&transaction)? == (0, 0) {
        transaction.execute_batch(teaching::TABLES)?;
        transaction.pragma_update(None, "user_version", SCHEMA)?;
    }
    transaction.commit()
}

#[cfg(test)]
mod tests;
