//! A connection to the database.

use super::error::ArchiveError;
use super::tables;
use crate::office::Database;
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio_postgres::{Client, Config, NoTls};
use tokio_postgres_rustls::MakeRustlsConnect;

const PATIENCE: Duration = Duration::from_secs(5);

/// Connects, and sees to the tables.
pub(super) async fn open(database: &Database) -> Result<Client, ArchiveError> {
    let mut client = connect(database).await?;
    tables::raise(&mut client).await?;
    Ok(client)
}

async fn connect(database: &Database) -> Result<Client, ArchiveError> {
    let Database { host, port, name, user, password_file, ca } = database;
    let place = format!("{name} of {user} at {host}:{port}");
    let failed = |error: tokio_postgres::Error| {
        let below = std::error::Error::source(&error).map_or(String::new(), |source| format!(": {source}"));
        ArchiveError::Connect { place: place.clone(), problem: format!("{error}{below}") }
    };
    let mut config = Config::new();
    config.host(host).port(*port).dbname(name).user(user).application_name("panelprep archive");
    config
        .connect_timeout(PATIENCE)
        .tcp_user_timeout(Duration::from_secs(30))
        .keepalives_idle(Duration::from_secs(10));
    if let Some(file) = password_file {
        config.password(password(file)?);
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
            let tls = MakeRustlsConnect::new(trusted(file)?);
            let (client, connection) = config.connect(tls).await.map_err(failed)?;
            tokio::spawn(async move { tell(connection.await) });
            Ok(client)
        }
    }
}

fn password(file: &Path) -> Result<String, ArchiveError> {
    let bytes = crate::disk::read(file).map_err(ArchiveError::file("read", file))?;
    let text = String::from_utf8(bytes)
        .map_err(|_| ArchiveError::Unfit { path: file.to_owned(), problem: "it is no UTF-8 text".to_owned() })?;
    Ok(text.trim().to_owned())
}

/// Trusts these certificate authorities and no others.
fn trusted(file: &Path) -> Result<rustls::ClientConfig, ArchiveError> {
    let unfit = |problem: String| ArchiveError::Unfit { path: file.to_owned(), problem };
    let bytes = crate::disk::read(file).map_err(ArchiveError::file("read", file))?;
    let mut roots = rustls::RootCertStore::empty();
    for certificate in CertificateDer::pem_slice_iter(&bytes) {
        let certificate = certificate.map_err(|error| unfit(error.to_string()))?;
        roots.add(certificate).map_err(|error| unfit(error.to_string()))?;
    }
    if roots.is_empty() {
        return Err(unfit("it holds no certificate".to_owned()));
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = rustls::ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
    let config = config.map_err(|error| unfit(error.to_string()))?;
    Ok(config.with_root_certificates(roots).with_no_client_auth())
}
