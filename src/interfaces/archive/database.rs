//! A connection to the database.

use super::error::ArchiveError;
use super::tables;
use panelprep_base::trust;
use panelprep_store::office::DatabaseSettings;
use std::time::Duration;
use tokio::time::timeout;
use tokio_postgres::{Client, Config, NoTls};
use tokio_postgres_rustls::MakeRustlsConnect;

const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Time limit for connecting and for updating the tables.
const OPEN_TIMEOUT: Duration = Duration::from_secs(10);

/// Describes the address of a database for people.
fn describe_address(DatabaseSettings { host, port, name, user, .. }: &DatabaseSettings) -> String {
    format!("{name} (user {user}) at {host}:{port}")
}

/// Runs an operation within a time limit; an operation that is not complete in time counts as failed.
///
/// # Errors
/// If the database does not answer in time, and the errors of the operation.
pub(super) async fn with_timeout<T>(
    limit: Duration,
    doing: impl Future<Output = Result<T, ArchiveError>>,
) -> Result<T, ArchiveError> {
    timeout(limit, doing).await.unwrap_or(Err(ArchiveError::Silent { seconds: limit.as_secs() }))
}

/// Connects, and creates the tables or brings them up to date.
pub(super) async fn open(database: &DatabaseSettings) -> Result<Client, ArchiveError> {
    let opening = async {
        let mut client = connect(database).await?;
        tables::raise(&mut client).await?;
        Ok(client)
    };
    let silent = |_| {
        let problem = format!("no answer within {} s", OPEN_TIMEOUT.as_secs());
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
