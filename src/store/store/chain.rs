//! The hash chain over all rows that are written to the store. Each link contains the SHA-256 of the previous link.
//!
//! A link contains the hash of the columns that one transaction has written; a row whose end is written later has two
//! links. The last link is the head, which is also stored in a file outside of the database (see `head`). Rows that are
//! changed, deleted, added or reordered without this program contradict a link; a truncated chain contradicts the head.

use rusqlite::types::ValueRef;
use rusqlite::{Connection, OptionalExtension, params};
use sha2::{Digest, Sha256};

pub(super) const TABLES: &str = "
    CREATE TABLE chain (
        link INTEGER PRIMARY KEY,
        part TEXT NOT NULL,
        row_key INTEGER NOT NULL,
        row_hash BLOB NOT NULL,
        hash BLOB NOT NULL
    ) STRICT;
";

/// A SHA-256 hash.
pub(super) type Hash = [u8; 32];

/// A position in the chain: the number of a link, and its hash. Link 0 is the start of the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ChainPosition {
    pub link: i64,
    pub hash: Hash,
}

impl ChainPosition {
    pub const START: ChainPosition = ChainPosition { link: 0, hash: [0; 32] };

    /// Returns the position after a new link for this row.
    pub fn next_position(&self, part: &str, row_key: i64, row_hash: &Hash) -> ChainPosition {
        let link = self.link + 1;
        let mut hasher = Sha256::new();
        hasher.update(self.hash);
        hasher.update(link.to_be_bytes());
        hash_text(&mut hasher, part);
        hasher.update(row_key.to_be_bytes());
        hasher.update(row_hash);
        ChainPosition { link, hash: hasher.finalize().into() }
    }
}

/// The columns of a table that are written together.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct HashedTable {
    /// The permanent name of the table in the chain.
    pub name: &'static str,
    /// How messages name a row of the table.
    pub row_term: &'static str,
    pub table: &'static str,
    /// SQL expression for the key of a row.
    pub key: &'static str,
    pub columns: &'static [&'static str],
    /// SQL condition for the rows in which these columns are already written.
    pub is_written_sql: &'static str,
    /// Whether these columns may be written again with other values.
    pub is_replaced: bool,
}

impl HashedTable {
    const fn row(name: &'static str, words: &'static str, columns: &'static [&'static str]) -> HashedTable {
        HashedTable {
            name,
            row_term: words,
            table: name,
            key: "id",
            columns,
            is_written_sql: "TRUE",
            is_replaced: false,
        }
    }
}

/// Every table with its columns.
pub(super) static HASHED_TABLES: [HashedTable; 25] = [
    HashedTable::row(
        "taught_panels",
        "taught panel",
        &[
            "name",
            "version",
            "taught_at_unix_s",
            "scan_hash",
            "recipe_text",
            "scanner_calibration_text",
            "base_from_camera_text",
            "flange_camera_text",
            "flange_from_camera_text",
        ],
    ),
    HashedTable {
        key: "panel_id * 65536 + position",
        ..HashedTable::row(
            "taught_corners",
            "taught corner",
            &["panel_id", "position", "picture_hash", "base_from_flange"],
        )
    },
    HashedTable::row(
        "cycles",
        "cycle",
        &["started_unix_s", "panel", "taught_version", "recipe_hash", "files", "program_version"],
    ),
    HashedTable::row("findings", "finding", &["cycle_id", "kind", "pass", "finding", "unix_ms"]),
    HashedTable {
        key: "sequence",
        ..HashedTable::row("journal", "journal line", &["cycle_id", "unix_ms", "event", "chain"])
    },
    HashedTable::row("motions", "motion", &["cycle_id", "motion"]),
    HashedTable {
        table: "motions",
        is_written_sql: "outcome IS NOT NULL OR done <> 0",
        ..HashedTable::row("motion_ends", "end of motion", &["outcome", "done"])
    },
    HashedTable {
        table: "cycles",
        is_written_sql: "budget IS NOT NULL",
        is_replaced: true,
        ..HashedTable::row("cycle_budgets", "error budget of cycle", &["budget"])
    },
    HashedTable {
        table: "cycles",
        is_written_sql: "verdict IS NOT NULL OR reasons IS NOT NULL OR ended_unix_s IS NOT NULL",
        ..HashedTable::row("cycle_ends", "end of cycle", &["ended_unix_s", "verdict", "reasons"])
    },
    HashedTable::row(
        "verifications",
        "verification",
        &["subject", "error_mm", "limit_mm", "calibration_hash", "at_unix_s"],
    ),
    HashedTable {
        key: "verification_id",
        ..HashedTable::row("verification_strikes", "strike of verification", &["by", "why", "at_unix_s"])
    },
    HashedTable::row("discs", "entry of the disc's wear", &["cycle_id", "at_unix_s", "is_new", "swept_mm2"]),
    HashedTable {
        key: "sequence",
        ..HashedTable::row("checkpoints", "checkpoint", &["journal_chain", "program_version", "folded"])
    },
    HashedTable::row("incidents", "incident", &["at_unix_s", "found"]),
    HashedTable::row("pruned", "entry of a removed file", &["cycle_id", "hash", "bytes", "at_unix_s"]),
    HashedTable::row("requests", "request", &["cycle_id", "journal_sequence", "unix_ms", "request"]),
    HashedTable::row("contacts", "contact path", &["motion_id", "path"]),
    HashedTable::row("permits", "permit of waypoints", &["motion_id", "unix_ms", "waypoints"]),
    HashedTable::row("cycle_facts", "fact of a cycle", &["cycle_id", "name", "fact"]),
    HashedTable::row("accounts", "account", &["unix_ms", "account"]),
    HashedTable::row("audit", "line of the audit trail", &["unix_ms", "entry"]),
    HashedTable::row(
        "acknowledgements",
        "acknowledgement",
        &["unix_ms", "cycle_id", "code", "raised_unix_ms", "who"],
    ),
    HashedTable::row(
        "signatures",
        "signature",
        &["cycle_id", "kind", "unix_ms", "record_hash", "previous_hash", "signature", "public_key"],
    ),
    HashedTable::row("outbox_epochs", "epoch of the office's outbox", &["epoch", "unix_ms", "why"]),
    HashedTable::row(
        "outbox",
        "entry of the office's outbox",
        &["epoch_id", "number", "kind", "row_key", "unix_ms"],
    ),
];

/// Returns the table with this name in the chain.
pub(super) fn hashed_table(name: &str) -> Option<&'static HashedTable> {
    HASHED_TABLES.iter().find(|part| part.name == name)
}

/// Returns the position of the last link; the start of the chain if there are no links.
pub(super) fn last_link(connection: &Connection) -> Result<ChainPosition, rusqlite::Error> {
    let last = connection
        .prepare_cached("SELECT link, hash FROM chain ORDER BY link DESC LIMIT 1")?
        .query_row([], |row| Ok(ChainPosition { link: row.get(0)?, hash: row.get(1)? }))
        .optional()?;
    Ok(last.unwrap_or(ChainPosition::START))
}

/// Returns the hash of the values in these columns of a row; `None` if the row does not exist.
pub(super) fn row_hash(
    connection: &Connection,
    part: &HashedTable,
    row_key: i64,
) -> Result<Option<Hash>, rusqlite::Error> {
    let HashedTable { table, key, columns, .. } = part;
    let sql = format!("SELECT {} FROM {table} WHERE {key} = ?1", columns.join(", "));
    let mut statement = connection.prepare_cached(&sql)?;
    let mut rows = statement.query([row_key])?;
    let Some(row) = rows.next()? else { return Ok(None) };
    let mut hasher = Sha256::new();
    for (index, column) in columns.iter().enumerate() {
        hash_value(&mut hasher, column, row.get_ref(index)?);
    }
    Ok(Some(hasher.finalize().into()))
}

/// Adds the name and the value of a column to a hash. NULL values are skipped, so that a column that is added in a
/// newer program version does not change earlier hashes.
fn hash_value(hasher: &mut Sha256, column: &str, value: ValueRef<'_>) {
    if value == ValueRef::Null {
        return;
    }
    hash_text(hasher, column);
    match value {
        ValueRef::Null => {}
        ValueRef::Integer(number) => {
            hasher.update(b"i");
            hasher.update(number.to_be_bytes());
        }
        ValueRef::Real(number) => {
            hasher.update(b"r");
            hasher.update(number.to_bits().to_be_bytes());
        }
        ValueRef::Text(bytes) => {
            hasher.update(b"t");
            hash_with_length(hasher, bytes);
        }
        ValueRef::Blob(bytes) => {
            hasher.update(b"b");
            hash_with_length(hasher, bytes);
        }
    }
}

fn hash_text(hasher: &mut Sha256, text: &str) {
    hash_with_length(hasher, text.as_bytes());
}

fn hash_with_length(hasher: &mut Sha256, bytes: &[u8]) {
    hasher.update((bytes.len() as u64).to_be_bytes());
    hasher.update(bytes);
}

/// Adds a link for the values that were just written to a row, and returns the new position.
pub(super) fn add_link(
    connection: &Connection,
    last: ChainPosition,
    part: &HashedTable,
    row_key: i64,
) -> Result<ChainPosition, rusqlite::Error> {
    let row_hash = row_hash(connection, part, row_key)?.ok_or(rusqlite::Error::QueryReturnedNoRows)?;
    let place = last.next_position(part.name, row_key, &row_hash);
    connection
        .prepare_cached("INSERT INTO chain (link, part, row_key, row_hash, hash) VALUES (?1, ?2, ?3, ?4, ?5)")?
        .execute(params![place.link, part.name, row_key, row_hash, place.hash])?;
    Ok(place)
}
