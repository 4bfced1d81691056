//! Checkpoints: the folded state of the journal at one of its lines, so that a start reads only later lines.
//!
//! A checkpoint is used only if the same version of the program wrote it and the journal still contains the line
//! that it names.

use super::commit::{TransactionFailure, WriteTransaction};
use super::database::Store;
use super::error::StoreError;
use super::fold::JournalFold;
use rusqlite::{OptionalExtension, params};

pub(super) const TABLES: &str = "
    CREATE TABLE checkpoints (
        sequence INTEGER PRIMARY KEY,
        journal_chain TEXT NOT NULL,
        program_version TEXT NOT NULL,
        folded TEXT NOT NULL
    ) STRICT;
";

/// Number of journal lines from one checkpoint to the next.
pub(super) const CHECKPOINT_INTERVAL: i64 = 10_000;
/// A start that had to read more lines than this writes a checkpoint.
pub(super) const TAIL: i64 = 2_000;

/// A position from which the journal can be read.
pub(super) struct Checkpoint {
    pub sequence: i64,
    pub journal_chain: String,
    pub settled: JournalFold,
}

/// Writes one.
pub(super) fn write(
    writing: &mut WriteTransaction<'_>,
    (sequence, journal_chain): (i64, &str),
    folded: &str,
) -> Result<(), TransactionFailure> {
    writing.execute(
        "INSERT OR IGNORE INTO checkpoints (sequence, journal_chain, program_version, folded) VALUES (?1, ?2, ?3, ?4)",
        params![sequence, journal_chain, env!("CARGO_PKG_VERSION"), folded],
    )?;
    if writing.changes() == 1 { writing.chain("checkpoints", sequence) } else { Ok(()) }
}

impl Store {
    /// Returns the last usable checkpoint.
    pub(super) fn checkpoint(&self) -> Result<Option<Checkpoint>, StoreError> {
        let sql = "SELECT c.sequence, c.journal_chain, c.folded FROM checkpoints c JOIN journal j
                ON j.sequence = c.sequence AND j.chain = c.journal_chain
             WHERE c.program_version = ?1 ORDER BY c.sequence DESC LIMIT 1";
        let found = self
            .connection
            .query_row(sql, [env!("CARGO_PKG_VERSION")], |row| {
                Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?, row.get::<_, String>(2)?))
            })
            .optional()
            .map_err(|error| self.database_error("read a checkpoint of", &error))?;
        // A checkpoint that this program can no longer read is ignored: the journal is folded from the beginning.
        Ok(found.and_then(|(sequence, journal_chain, folded)| {
            let settled = serde_json::from_str(&folded).ok()?;
            Some(Checkpoint { sequence, journal_chain, settled })
        }))
    }
}
