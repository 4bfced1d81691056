//! `archive.toml`: the settings of the archive, with its broker, database and folder of files.

use core::net::SocketAddr;
use panelprep_base::config::{self, Problems, Section};
use panelprep_cell::cell::Broker;
use std::path::{Path, PathBuf};

/// The settings of the archive on the office server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ArchiveSettings {
    /// The broker from which the archive receives.
    pub broker: Broker,
    /// Maximum size of the data that wait in the broker, GB; further data wait in their cell.
    pub waiting_gb: usize,
    /// The database with the records.
    pub database: DatabaseSettings,
    /// The folder of the files: pictures, recipes and calibrations.
    pub files: PathBuf,
    /// The settings of the office's page; `None` if the page is off.
    pub fleet: Option<FleetPage>,
}

/// The settings of the office's page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FleetPage {
    /// IP address and port of the page.
    pub listen: SocketAddr,
    /// The files of the certificate and its key, PEM. If they are not stated and other computers can reach the page,
    /// the program creates its own certificate.
    pub certificate: Option<[PathBuf; 2]>,
}

/// The settings of a PostgreSQL database.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DatabaseSettings {
    /// Host name or address of the database, or the folder of its Unix socket.
    pub host: String,
    /// TCP port of the database.
    pub port: u16,
    /// Name of the database.
    pub name: String,
    /// User name for the database.
    pub user: String,
    /// The file that contains only the password; `None` if the database needs no password.
    pub password_file: Option<PathBuf>,
    /// The file of the certificate authority, PEM. If it is stated, the connection is encrypted, and a certificate of
    /// another authority is refused.
    pub ca: Option<PathBuf>,
}

const VALID_WAITING_GB: std::ops::RangeInclusive<usize> = 1..=10_000;
const VALID_PORTS: std::ops::RangeInclusive<usize> = 1..=65_535;

const BYTES_PER_GB: i64 = 1_000_000_000;

impl ArchiveSettings {
    /// Returns the maximum size of the data that wait in the broker, bytes.
    pub fn max_waiting_bytes(&self) -> i64 {
        i64::try_from(self.waiting_gb).unwrap_or(i64::MAX).saturating_mul(BYTES_PER_GB)
    }

    /// Parses and checks `archive.toml`. File names in it are relative to its folder.
    ///
    /// # Errors
    /// All problems of the file, each with its line and key.
    pub fn check(file: &str, text: &str) -> Result<Self, Problems> {
        let folder = Path::new(file).parent().unwrap_or(Path::new(""));
        config::parse_file(file, text, |top| {
            let broker = parse_broker(folder, &top.section("broker"));
            let database = parse_database(folder, &top.section("database"));
            let files = top.parse::<String>("files", (), Some("archive".to_owned()));
            let fleet = parse_fleet(folder, &top.section("fleet"));
            top.finish();
            let (broker, waiting_gb) = broker?;
            Some(ArchiveSettings {
                broker,
                waiting_gb,
                database: database?,
                files: folder.join(files?),
                fleet: fleet?,
            })
        })
    }
}

fn parse_broker(folder: &Path, section: &Section<'_, '_>) -> Option<(Broker, usize)> {
    let broker = Broker::parse(folder, section, "address");
    let waiting_gb = section.parse::<usize>("waiting_gb", VALID_WAITING_GB, Some(5));
    section.finish();
    let Some(broker) = broker? else {
        section.problem("address", "is missing: the broker's address, such as \"nats://127.0.0.1:4222\"");
        return None;
    };
    Some((broker, waiting_gb?))
}

/// Parses the settings of the office's page. The outer `None` is a problem in the file, the inner `None` means that the
/// page is off.
fn parse_fleet(folder: &Path, section: &Section<'_, '_>) -> Option<Option<FleetPage>> {
    let [listen, certificate, key] = ["listen", "certificate", "certificate_key"]
        .map(|key| section.parse::<Option<String>>(key, (), Some(None)));
    section.finish();
    let (listen, certificate, key) = (listen?, certificate?, key?);
    if certificate.is_some() != key.is_some() {
        section.problem("certificate", "certificate and certificate_key must be set together");
        return None;
    }
    let Some(text) = listen else {
        return section.missing_required("listen", "the address and port of the page, such as \"127.0.0.1:8444\"");
    };
    match text.parse::<SocketAddr>() {
        Ok(listen) => {
            let certificate = certificate.zip(key).map(|(file, key)| [folder.join(file), folder.join(key)]);
            Some(Some(FleetPage { listen, certificate }))
        }
        Err(_) => {
            let allowed = "valid: an IP address and a port, such as \"127.0.0.1:8444\"";
            section.problem("listen", format!("found \"{text}\", {allowed}"));
            None
        }
    }
}

fn parse_database(folder: &Path, section: &Section<'_, '_>) -> Option<DatabaseSettings> {
    let host = section.parse::<String>("host", (), Some("127.0.0.1".to_owned()));
    let port = section.parse::<usize>("port", VALID_PORTS, Some(5_432));
    let name = section.parse::<String>("name", (), Some("panelprep".to_owned()));
    let user = section.parse::<String>("user", (), Some("panelprep".to_owned()));
    let [password_file, ca] =
        ["password_file", "ca"].map(|key| section.parse::<Option<String>>(key, (), Some(None)));
    section.finish();
    Some(DatabaseSettings {
        host: host?,
        port: u16::try_from(port?).ok()?,
        name: name?,
        user: user?,
        password_file: password_file?.map(|name| folder.join(name)),
        ca: ca?.map(|name| folder.join(name)),
    })
}
