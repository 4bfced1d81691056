//! A transaction: the rows, their links in the hash chain, and the head outside of the database are committed
//! completely or not at all.

use super::chain::ChainPosition;
use super::database::{Step, Store};
use super::error::StoreError;
use super::{chain, fullness};
use rusqlite::{Connection, Params, Row, Transaction, TransactionBehavior};
use std::ops::Deref;

/// A transaction in progress.
pub(super) struct WriteTransaction<'t> {
    transaction: Transaction<'t>,
    last: ChainPosition,
}

impl Deref for WriteTransaction<'_> {
    type Target = Connection;

    fn deref(&self) -> &Connection {
        &self.transaction
    }
}

impl WriteTransaction<'_> {
    /// Executes an SQL statement, which is compiled only once, and returns the number of changed rows.
    pub fn execute(&self, sql: &str, values: impl Params) -> Result<usize, rusqlite::Error> {
        self.transaction.prepare_cached(sql)?.execute(values)
    }

    /// Reads a row with an SQL statement that is compiled only once.
    pub fn query_row<T>(
        &self,
        sql: &str,
        values: impl Params,
        row: impl FnOnce(&Row<'_>) -> Result<T, rusqlite::Error>,
    ) -> Result<T, rusqlite::Error> {
        self.transaction.prepare_cached(sql)?.query_row(values, row)
    }

    /// Adds a link to the chain for the values that were just written to this row.
    pub fn chain(&mut self, part: &'static str, row_key: i64) -> Result<(), TransactionFailure> {
        let part = chain::hashed_table(part).ok_or_else(|| rusqlite::Error::InvalidColumnName(part.to_owned()))?;
        self.last = chain::add_link(&self.transaction, self.last, part, row_key)?;
        Ok(())
    }
}

/// The reason why a transaction was not committed.
#[derive(Debug)]
pub(super) enum TransactionFailure {
    Sql(rusqlite::Error),
    Head(std::io::Error),
    /// The values to write are not valid.
    InvalidValue(StoreError),
}

impl From<rusqlite::Error> for TransactionFailure {
    fn from(error: rusqlite::Error) -> Self {
        TransactionFailure::Sql(error)
    }
}

impl From<StoreError> for TransactionFailure {
    fn from(error: StoreError) -> Self {
        TransactionFailure::InvalidValue(error)
    }
}

impl Store {
    /// Commits the rows that `write` writes. `write` is called a second time if the disk was full and the reserve was
    /// released.
    pub(super) fn commit<T>(
        &mut self,
        doing: &'static str,
        write: impl Fn(&mut WriteTransaction<'_>) -> Result<T, TransactionFailure>,
    ) -> Result<T, StoreError> {
        let mut done = self.run_transaction(&write);
        if done.as_ref().is_err_and(|failed| self.is_disk_full_failure(failed)) {
            self.fullness.mark_full();
            // The reserve is released only once: if the transaction fails again, the error is a full disk.
            if self.reserve.release() {
                tracing::warn!(
                    "the disk of the store is full; the reserve of {} MB is released",
                    fullness::RESERVE_MB
                );
                done = self.run_transaction(&write);
            }
        }
        done.map_err(|failed| match failed {
            failed if self.is_disk_full_failure(&failed) => self.disk_full_error(),
            TransactionFailure::Sql(error) => self.database_error(doing, &error),
            TransactionFailure::Head(source) => {
                StoreError::File { operation: "write the head of", path: self.path().to_owned(), source }
            }
            TransactionFailure::InvalidValue(error) => error,
        })
    }

    fn run_transaction<T>(
        &mut self,
        write: impl Fn(&mut WriteTransaction<'_>) -> Result<T, TransactionFailure>,
    ) -> Result<T, TransactionFailure> {
        let Some(head) = &self.head else {
            return Err(TransactionFailure::InvalidValue(StoreError::ReadOnly { path: self.path().to_owned() }));
        };
        let _turn = head.acquire_write_guard().map_err(TransactionFailure::Head)?;
        // The write lock is taken at the beginning. If a transaction first reads and takes the lock later, it can fail
        // with an error that waiting cannot solve.
        let transaction = self.connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let before = chain::last_link(&transaction)?;
        let mut writing = WriteTransaction { transaction, last: before };
        let done = write(&mut writing)?;
        let WriteTransaction { transaction, last } = writing;
        // Before the commit, the head file contains both the present and the next position. After a power failure at
        // any moment, the chain ends at one of the two.
        head.prepare(before, last).map_err(TransactionFailure::Head)?;
        self.steps.reach(Step::Prepared);
        transaction.commit()?;
        self.steps.reach(Step::Committed);
        // This error is only logged, because the head file already contains this position as the possible next one.
        if let Err(error) = head.write_position(last) {
            tracing::warn!("the head of the store could not be written: {error}");
        }
        self.steps.reach(Step::Settled);
        Ok(done)
    }

    fn is_disk_full_failure(&self, failed: &TransactionFailure) -> bool {
        match failed {
            TransactionFailure::Sql(error) => fullness::is_disk_full_error(error, self.folder()),
            TransactionFailure::Head(error) => error.kind() == std::io::ErrorKind::StorageFull,
            TransactionFailure::InvalidValue(error) => matches!(error, StoreError::Full { .. }),
        }
    }
}
