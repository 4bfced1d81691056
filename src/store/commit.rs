//! A transaction: rows, their links in the chain, and the head outside of the database, committed completely or not at all.

use super::chain::{self, ChainPosition};
use super::database::Store;
use super::error::StoreError;
use super::reserve;
use super::steps::Step;
use rusqlite::{Connection, Params, Row, Transaction, TransactionBehavior};
use std::ops::Deref;

/// A transaction under way.
pub(super) struct Writing<'t> {
    transaction: Transaction<'t>,
    last: ChainPosition,
}

impl Deref for Writing<'_> {
    type Target = Connection;

    fn deref(&self) -> &Connection {
        &self.transaction
    }
}

impl Writing<'_> {
    /// Writes rows with a statement that is compiled once; returns the number of rows.
    pub fn execute(&self, sql: &str, values: impl Params) -> Result<usize, rusqlite::Error> {
        self.transaction.prepare_cached(sql)?.execute(values)
    }

    /// Reads a row with a statement that is compiled once.
    pub fn query_row<T>(
        &self,
        sql: &str,
        values: impl Params,
        row: impl FnOnce(&Row<'_>) -> Result<T, rusqlite::Error>,
    ) -> Result<T, rusqlite::Error> {
        self.transaction.prepare_cached(sql)?.query_row(values, row)
    }

    /// Adds a link to the chain for the data that were just written to this row.
    pub fn chain(&mut self, part: &'static str, row_key: i64) -> Result<(), Failed> {
        let part = chain::part(part).ok_or_else(|| rusqlite::Error::InvalidColumnName(part.to_owned()))?;
        self.last = chain::add(&self.transaction, self.last, part, row_key)?;
        Ok(())
    }
}

/// Why a transaction failed.
#[derive(Debug)]
pub(super) enum Failed {
    Sql(rusqlite::Error),
    Head(std::io::Error),
    /// The data to write are not valid.
    Unfit(StoreError),
}

impl From<rusqlite::Error> for Failed {
    fn from(error: rusqlite::Error) -> Self {
        Failed::Sql(error)
    }
}

impl From<StoreError> for Failed {
    fn from(error: StoreError) -> Self {
        Failed::Unfit(error)
    }
}

impl Store {
    /// Commits the rows that `write` writes. `write` may be called again if the disk was full and the reserve was
    /// released.
    pub(super) fn commit<T>(
        &mut self,
        doing: &'static str,
        write: impl Fn(&mut Writing<'_>) -> Result<T, Failed>,
    ) -> Result<T, StoreError> {
        let mut done = self.attempt(&write);
        if done.as_ref().is_err_and(|failed| self.is_full(failed)) {
            self.fullness.fill();
            // Once only: a second failure with the reserve gone is reported as a full disk.
            if self.reserve.release() {
                tracing::warn!("the disk of the store is full; the reserve of {} MB is released", reserve::MB);
                done = self.attempt(&write);
            }
        }
        done.map_err(|failed| match failed {
            failed if self.is_full(&failed) => self.full(),
            Failed::Sql(error) => self.failed(doing, &error),
            Failed::Head(source) => {
                StoreError::File { doing: "write the head of", path: self.path().to_owned(), source }
            }
            Failed::Unfit(error) => error,
        })
    }

    fn attempt<T>(&mut self, write: impl Fn(&mut Writing<'_>) -> Result<T, Failed>) -> Result<T, Failed> {
        let Some(head) = &self.head else {
            return Err(Failed::Unfit(StoreError::ReadOnly { path: self.path().to_owned() }));
        };
        let _turn = head.acquire_turn().map_err(Failed::Head)?;
        // The write lock is taken at the beginning: a transaction that reads first and then writes can fail in between
        // with nothing to retry.
        let transaction = self.connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let before = chain::last(&transaction)?;
        let mut writing = Writing { transaction, last: before };
        let done = write(&mut writing)?;
        let Writing { transaction, last } = writing;
        // The head names both ends before the commit: a power cut at any moment then leaves a chain that ends at one of
        // the two.
        head.prepare(before, last).map_err(Failed::Head)?;
        self.steps.reach(Step::Prepared);
        transaction.commit()?;
        self.steps.reach(Step::Committed);
        // If the head cannot be written, the chain's position is still explained: the head file already names it as
        // the possible next position.
        if let Err(error) = head.settle(last) {
            tracing::warn!("the head of the store could not be written: {error}");
        }
        self.steps.reach(Step::Settled);
        Ok(done)
    }

    fn is_full(&self, failed: &Failed) -> bool {
        match failed {
            Failed::Sql(error) => reserve::is_full(error, self.folder()),
            Failed::Head(error) => error.kind() == std::io::ErrorKind::StorageFull,
            Failed::Unfit(error) => matches!(error, StoreError::Full { .. }),
        }
    }
}
