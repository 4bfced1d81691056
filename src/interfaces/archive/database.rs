//! The connection to the database, the tables and their migration, and the errors of the archive.

use crate::broker::BrokerError;
use panelprep_base::trust::{self, TrustError};
use panelprep_store::office::DatabaseSettings;
use panelprep_store::store::StoreError;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::time::timeout;
use tokio_postgres::{Client, Config, NoTls};
use tokio_postgres_rustls::MakeRustlsConnect;

const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Maximum time to connect, and to create or update the tables.
const OPEN_TIMEOUT: Duration = Duration::from_secs(10);

/// Errors of the archive.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// The database cannot be reached, or refuses the connection.
    #[error("the database {place} cannot be used: {problem}")]
    Connect {
        /// User, host, port and name of the database.
        place: String,
        /// The message of the connection.
        problem: String,
    },
    /// The database refused a statement.
    #[error("the database: cannot {operation}: {problem}")]
    Database {
        /// The operation that failed.
        operation: &'static str,
        /// The message of PostgreSQL.
        problem: String,
    },
    /// The database accepted a statement but does not reply.
    #[error("the database has not responded for {seconds} s; check the database server and the network")]
    Silent {
        /// Time without a reply, s.
        seconds: u64,
    },
    /// The encoding of the database cannot represent all texts.
    #[error(
        "the database has the encoding {found}, but UTF8 is required: create the database with `createdb -E UTF8 \
         -T template0`"
    )]
    Encoding {
        /// Encoding of the database.
        found: String,
    },
    /// The tables were written by a newer version of this program.
    #[error(
        "the database has tables of version {found}, this program supports versions up to {known}: use the newer \
         program"
    )]
    Newer {
        /// Version of the tables in the database.
        found: i32,
        /// Newest version of the tables that this program supports.
        known: i32,
    },
    /// An error of the broker connection.
    #[error(transparent)]
    Broker(#[from] BrokerError),
    /// A file that a record names cannot be read or written.
    #[error(transparent)]
    Kept(#[from] StoreError),
    /// A file operation failed.
    #[error("cannot {operation} {}: {source}", path.display())]
    File {
        /// The operation that failed.
        operation: &'static str,
        /// The path of the file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A certificate or a password cannot be used.
    #[error(transparent)]
    Trust(#[from] TrustError),
}

impl ArchiveError {
    pub(super) fn database(doing: &'static str) -> impl Fn(tokio_postgres::Error) -> ArchiveError {
        move |error| {
            // The error of the library contains the server's message.
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

    /// Returns whether the error may be temporary, such as a network failure, a restart of the server or a full disk.
    pub fn is_transient(&self) -> bool {
        !matches!(self, ArchiveError::Newer { .. } | ArchiveError::Encoding { .. } | ArchiveError::Trust(_))
    }
}

/// Returns the address of a database as text for people.
fn describe_address(DatabaseSettings { host, port, name, user, .. }: &DatabaseSettings) -> String {
    format!("{name} (user {user}) at {host}:{port}")
}

/// Runs an operation with a time limit.
///
/// # Errors
/// If the database does not reply in time, or the operation fails.
pub(super) async fn with_timeout<T>(
    limit: Duration,
    doing: impl Future<Output = Result<T, ArchiveError>>,
) -> Result<T, ArchiveError> {
    timeout(limit, doing).await.unwrap_or(Err(ArchiveError::Silent { seconds: limit.as_secs() }))
}

/// Connects to the database, and creates or updates the tables.
pub(super) async fn open(database: &DatabaseSettings) -> Result<Client, ArchiveError> {
    let opening = async {
        let mut client = connect(database).await?;
        update_tables(&mut client).await?;
        Ok(client)
    };
    let silent = |_| {
        let problem = format!("no reply within {} s", OPEN_TIMEOUT.as_secs());
        Err(ArchiveError::Connect { place: describe_address(database), problem })
    };
    timeout(OPEN_TIMEOUT, opening).await.unwrap_or_else(silent)
}

async fn connect(database: &DatabaseSettings) -> Result<Client, ArchiveError> {
    let DatabaseSettings { host, port, name, user, password_file, ca } = database;
    let place = describe_address(database);
    let failed = |error: tokio_postgres::Error| {
        let below = std::error::Error::source(&error).map_or(String::new(), |source| format!(": {source}"));
        let below = match error.to_string().contains("unexpected") || below.contains("bytes remaining") {
            true => format!("{below}; the server at this address is not PostgreSQL"),
            false => below,
        };
        ArchiveError::Connect { place: place.clone(), problem: format!("{error}{below}") }
    };
    let mut config = Config::new();
    config.host(host).port(*port).dbname(name).user(user).application_name("panelprep archive");
    config
        .connect_timeout(CONNECT_TIMEOUT)
        .tcp_user_timeout(Duration::from_secs(30))
        .keepalives_idle(Duration::from_secs(10));
    if let Some(file) = password_file {
        config.password(trust::secret(file)?);
    }
    let tell = |ended: Result<(), tokio_postgres::Error>| {
        if let Err(error) = ended {
            tracing::warn!("the connection to the database ended: {error}");
        }
    };
    match ca {
        None => {
            let (client, connection) = config.connect(NoTls).await.map_err(failed)?;
            tokio::spawn(async move { tell(connection.await) });
            Ok(client)
        }
        Some(file) => {
            config.ssl_mode(tokio_postgres::config::SslMode::Require);
            let tls = MakeRustlsConnect::new(trust::client_config(file, None)?);
            let (client, connection) = config.connect(tls).await.map_err(failed)?;
            tokio::spawn(async move { tell(connection.await) });
            Ok(client)
        }
    }
}

/// Newest version of the tables that this program supports.
const TABLES_VERSION: i32 = 1;

/// `records` contains the records that the cells have sent, `epochs` the number up to which each epoch is complete, and
/// `contradictions` the messages with the name of a stored record but other content. All other tables are derived from
/// the records, for the pages.
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

/// Creates or updates the tables. A lock makes two archives that start at the same time wait for each other.
async fn update_tables(client: &mut Client) -> Result<(), ArchiveError> {
    let failed = ArchiveError::database("make its tables");
    let transaction = client.transaction().await.map_err(&failed)?;
    let begin = "SELECT pg_advisory_xact_lock(7062651);
        CREATE TABLE IF NOT EXISTS panelprep_version (version INTEGER NOT NULL)";
    transaction.batch_execute(begin).await.map_err(&failed)?;
    let row = transaction.query_opt("SELECT max(version) FROM panelprep_version", &[]).await.map_err(&failed)?;
    let found: i32 = row.and_then(|row| row.get::<_, Option<i32>>(0)).unwrap_or(0);
    if found > TABLES_VERSION {
        return Err(ArchiveError::Newer { found, known: TABLES_VERSION });
    }
    let encoding: String = transaction.query_one("SHOW server_encoding", &[]).await.map_err(&failed)?.get(0);
    if encoding != "UTF8" {
        return Err(ArchiveError::Encoding { found: encoding });
    }
    if found < 1 {
        transaction.batch_execute(TABLES).await.map_err(&failed)?;
    }
    if found < TABLES_VERSION {
        let set = "INSERT INTO panelprep_version (version) VALUES ($1)";
        transaction.execute(set, &[&TABLES_VERSION]).await.map_err(&failed)?;
    }
    transaction.commit().await.map_err(&failed)
}
