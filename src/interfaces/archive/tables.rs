//! The database tables, brought up to date step by step.

use super::error::ArchiveError;
use tokio_postgres::Client;

/// The newest version that this program supports.
const VERSION: i32 = 1;

/// `records` contains what cells sent; `epochs` contains the number up to which each epoch is complete;
/// `contradictions` contains messages under a name that is stored with another content. The other tables are derived
/// from records, for pages.
const TABLES: &str = "
    CREATE TABLE records (
        cell TEXT NOT NULL,
        epoch TEXT NOT NULL,
        number BIGINT NOT NULL,
        kind TEXT NOT NULL,
        unix_ms BIGINT NOT NULL,
        hash TEXT NOT NULL,
        content BYTEA NOT NULL,
        signature BYTEA,
        public_key TEXT,
        received_at TIMESTAMPTZ NOT NULL DEFAULT now(),
        PRIMARY KEY (cell, epoch, number)
    );
    CREATE TABLE record_files (
        cell TEXT NOT NULL,
        epoch TEXT NOT NULL,
        number BIGINT NOT NULL,
        name TEXT NOT NULL,
        hash TEXT NOT NULL,
        gone TEXT,
        PRIMARY KEY (cell, epoch, number, name, hash),
        FOREIGN KEY (cell, epoch, number) REFERENCES records (cell, epoch, number)
    );
    CREATE TABLE contradictions (
        cell TEXT NOT NULL,
        epoch TEXT NOT NULL,
        number BIGINT NOT NULL,
        hash TEXT NOT NULL,
        content BYTEA NOT NULL,
        received_at TIMESTAMPTZ NOT NULL DEFAULT now(),
        PRIMARY KEY (cell, epoch, number, hash)
    );
    CREATE TABLE epochs (
        cell TEXT NOT NULL,
        epoch TEXT NOT NULL,
        archived BIGINT NOT NULL,
        PRIMARY KEY (cell, epoch)
    );
    CREATE TABLE cycles (
        cell TEXT NOT NULL,
        cycle BIGINT NOT NULL,
        started_unix_s BIGINT NOT NULL,
        ended_unix_s BIGINT,
        panel TEXT NOT NULL,
        serial TEXT,
        work_order TEXT,
        operator TEXT,
        verdict TEXT NOT NULL,
        reasons TEXT NOT NULL,
        recipe_hash TEXT NOT NULL,
        program_version TEXT NOT NULL,
        PRIMARY KEY (cell, cycle, started_unix_s)
    );
    CREATE INDEX cycles_by_time ON cycles (started_unix_s DESC);
    CREATE INDEX cycles_by_cell ON cycles (cell, started_unix_s DESC);
    CREATE INDEX cycles_by_panel ON cycles (panel, started_unix_s DESC);
    CREATE INDEX cycles_by_serial ON cycles (lower(serial));
    CREATE TABLE signatures (
        cell TEXT NOT NULL,
        cycle BIGINT NOT NULL,
        statement BIGINT NOT NULL,
        record_hash TEXT NOT NULL,
        epoch TEXT NOT NULL,
        number BIGINT NOT NULL,
        unix_ms BIGINT NOT NULL,
        name TEXT,
        meaning TEXT,
        PRIMARY KEY (cell, statement, record_hash)
    );
    CREATE INDEX signatures_by_cycle ON signatures (cell, cycle);
    CREATE TABLE quantities (
        cell TEXT NOT NULL,
        cycle BIGINT NOT NULL,
        started_unix_s BIGINT NOT NULL,
        panel TEXT NOT NULL,
        quantity TEXT NOT NULL,
        value DOUBLE PRECISION NOT NULL,
        allowed TEXT NOT NULL,
        PRIMARY KEY (panel, quantity, started_unix_s, cell, cycle)
    );
    CREATE TABLE verifications (
        cell TEXT NOT NULL,
        subject TEXT NOT NULL,
        at_unix_s BIGINT NOT NULL,
        error DOUBLE PRECISION NOT NULL,
        allowed DOUBLE PRECISION NOT NULL,
        calibration_hash TEXT NOT NULL,
        PRIMARY KEY (cell, subject, at_unix_s, calibration_hash)
    );
    CREATE TABLE recipe_uses (
        panel TEXT NOT NULL,
        recipe_hash TEXT NOT NULL,
        cell TEXT NOT NULL,
        first_unix_s BIGINT NOT NULL,
        last_unix_s BIGINT NOT NULL,
        cycles BIGINT NOT NULL,
        passed BIGINT NOT NULL,
        PRIMARY KEY (panel, recipe_hash, cell)
    );
    CREATE TABLE offers (
        panel TEXT PRIMARY KEY,
        recipe_hash TEXT NOT NULL,
        offer BYTEA NOT NULL
    );
    CREATE TABLE accounts (
        name TEXT PRIMARY KEY,
        printed_name TEXT NOT NULL,
        password_hash TEXT NOT NULL
    );
    CREATE TABLE cells (
        cell TEXT PRIMARY KEY,
        heard_unix_ms BIGINT NOT NULL,
        state TEXT NOT NULL
    );
";

/// Makes the tables, or brings them up to date. Two archives that start at once wait for each other.
pub(super) async fn raise(client: &mut Client) -> Result<(), ArchiveError> {
    let failed = ArchiveError::database("make its tables");
    let transaction = client.transaction().await.map_err(&failed)?;
    let begin = "SELECT pg_advisory_xact_lock(7062651);
        CREATE TABLE IF NOT EXISTS panelprep_version (version INTEGER NOT NULL)";
    transaction.batch_execute(begin).await.map_err(&failed)?;
    let row = transaction.query_opt("SELECT max(version) FROM panelprep_version", &[]).await.map_err(&failed)?;
    let found: i32 = row.and_then(|row| row.get::<_, Option<i32>>(0)).unwrap_or(0);
    if found > VERSION {
        return Err(ArchiveError::Newer { found, known: VERSION });
    }
    let encoding: String = transaction.query_one("SHOW server_encoding", &[]).await.map_err(&failed)?.get(0);
    if encoding != "UTF8" {
        return Err(ArchiveError::Encoding { found: encoding });
    }
    if found < 1 {
        transaction.batch_execute(TABLES).await.map_err(&failed)?;
    }
    if found < VERSION {
        let set = "INSERT INTO panelprep_version (version) VALUES ($1)";
        transaction.execute(set, &[&VERSION]).await.map_err(&failed)?;
    }
    transaction.commit().await.map_err(&failed)
}
