//! The reason why the archive cannot work.

use crate::broker::BrokerError;
use panelprep_base::trust::TrustError;
use panelprep_store::store::StoreError;
use std::path::{Path, PathBuf};

/// Errors of the archive.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// The database cannot be reached, or refuses the connection.
    #[error("the database {place} cannot be used: {problem}")]
    Connect {
        /// User, host, port and name of the database.
        place: String,
        /// The connection's message.
        problem: String,
    },
    /// The database refused a statement.
    #[error("the database: cannot {operation}: {problem}")]
    Database {
        /// The attempted operation.
        operation: &'static str,
        /// PostgreSQL's message.
        problem: String,
    },
    /// The database accepts what it is sent and does not answer.
    #[error("the database has not responded for {seconds} s")]
    Silent {
        /// Time without an answer, s.
        seconds: u64,
    },
    /// The database's encoding cannot represent every text.
    #[error(
        "the database has the encoding {found}, but UTF8 is required: create the database with `createdb -E UTF8 \
         -T template0`"
    )]
    Encoding {
        /// Encoding of the database.
        found: String,
    },
    /// The tables are of a later version of this program.
    #[error(
        "the database has tables of version {found}, this program supports versions up to {known}: use the newer \
         program"
    )]
    Newer {
        /// Version of the tables.
        found: i32,
        /// The newest version that this program supports.
        known: i32,
    },
    /// The broker.
    #[error(transparent)]
    Broker(#[from] BrokerError),
    /// A stored file that a record names cannot be used.
    #[error(transparent)]
    Kept(#[from] StoreError),
    /// A file operation failed.
    #[error("cannot {operation} {}: {source}", path.display())]
    File {
        /// The attempted operation.
        operation: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's message.
        source: std::io::Error,
    },
    /// A certificate or a password cannot be used.
    #[error(transparent)]
    Trust(#[from] TrustError),
}

impl ArchiveError {
    pub(super) fn database(doing: &'static str) -> impl Fn(tokio_postgres::Error) -> ArchiveError {
        move |error| {
            // The library's error contains the server's own message.
            let problem = error.as_db_error().map_or(error.to_string(), ToString::to_string);
            ArchiveError::Database { operation: doing, problem }
        }
    }

    pub(super) fn file_error<'p>(
        doing: &'static str,
        path: &'p Path,
    ) -> impl Fn(std::io::Error) -> ArchiveError + 'p {
        move |source| ArchiveError::File { operation: doing, path: path.to_owned(), source }
    }

    /// Returns whether the error may end without intervention, such as a network failure, a server restart or a full
    /// disk.
    pub fn is_transient(&self) -> bool {
        !matches!(self, ArchiveError::Newer { .. } | ArchiveError::Encoding { .. } | ArchiveError::Trust(_))
    }
}
