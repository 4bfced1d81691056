//! The addresses on which this program accepts connections: `[page]` for the operator's page, and `[opcua]` for the OPC
//! UA server. Each is off until its key `listen` is set.

use core::net::SocketAddr;
use panelprep_base::config::{Choice, Section};
use std::path::{Path, PathBuf};

/// The settings of the operator's page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Page {
    /// IP address and port on which the page is served; `None` if the page is off.
    pub listen: Option<SocketAddr>,
    /// The files of the certificate and its key, PEM. If they are not stated and other computers can reach the page,
    /// the program creates its own certificate.
    pub certificate: Option<[PathBuf; 2]>,
    /// The folder with the recipes that can be started on the page.
    pub recipes: PathBuf,
    /// The file of a translation table, with the page's texts in further languages.
    pub translations: Option<PathBuf>,
    /// Time without an action after which a session ends, minutes.
    pub idle_min: usize,
    /// Maximum number of simultaneous sessions of one account.
    pub sessions: usize,
}

const IDLE_MIN: std::ops::RangeInclusive<usize> = 1..=720;
const SESSIONS: std::ops::RangeInclusive<usize> = 1..=20;

pub(super) fn parse_page(folder: &Path, section: &Section<'_, '_>) -> Option<Page> {
    let listen = section.parse::<Option<String>>("listen", (), Some(None));
    let [certificate, key] =
        ["certificate", "certificate_key"].map(|key| section.parse::<Option<String>>(key, (), Some(None)));
    let recipes = section.parse::<String>("recipes", (), Some(".".to_owned()));
    let words = section.parse::<Option<String>>("words", (), Some(None));
    let idle_min = section.parse::<usize>("idle_min", IDLE_MIN, Some(30));
    let sessions = section.parse::<usize>("sessions", SESSIONS, Some(3));
    section.finish();
    let (certificate, key) = (certificate?, key?);
    if certificate.is_some() != key.is_some() {
        let missing = if key.is_some() { "certificate" } else { "certificate_key" };
        section.problem(missing, "is missing; state both certificate and certificate_key, or neither");
        return None;
    }
    let listen = listen?;
    let address = match &listen {
        None => None,
        Some(text) => match text.parse::<SocketAddr>() {
            Ok(address) if address.port() > 0 => Some(address),
            _ => {
                let allowed = "valid: an IP address and a port, such as \"127.0.0.1:8443\" or \"0.0.0.0:8443\"";
                section.problem("listen", format!("found \"{text}\", {allowed}"));
                return None;
            }
        },
    };
    Some(Page {
        listen: address,
        certificate: certificate.zip(key).map(|(file, key)| [folder.join(file), folder.join(key)]),
        recipes: folder.join(recipes?),
        translations: words?.map(|name| folder.join(name)),
        idle_min: idle_min?,
        sessions: sessions?,
    })
}

/// The permissions of an OPC UA client that has not logged in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum AnonymousAccess {
    /// No permissions: every session needs an account.
    Nothing,
    /// Permission to read, and to stop or abort as on the operator's page.
    Read,
}

impl Choice for AnonymousAccess {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("nothing", AnonymousAccess::Nothing), ("read", AnonymousAccess::Read)];
}

/// The settings of the OPC UA server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OpcUa {
    /// IP address and port of the server; `None` if the server is off.
    pub listen: Option<SocketAddr>,
    /// The host name or address of the server in the endpoint URLs that it sends to clients.
    pub host: Option<String>,
    /// The permissions of a client that has not logged in.
    pub anonymous: AnonymousAccess,
    /// Whether a connection without signature and encryption is accepted. No person can log in through such a
    /// connection.
    pub is_unencrypted_allowed: bool,
    /// The folder with the certificates, in the folders `own`, `private`, `trusted` and `rejected`.
    pub certificates: PathBuf,
}

/// The name of the certificate folder inside the store.
const CERTIFICATES_FOLDER: &str = "opcua";

impl OpcUa {
    /// Returns the settings with the certificate folder of this store, if the file does not name a folder.
    pub(super) fn with_store_certificates(self, store: &Path) -> Self {
        let certificates = if self.certificates.as_os_str().is_empty() {
            store.join(CERTIFICATES_FOLDER)
        } else {
            self.certificates
        };
        OpcUa { certificates, ..self }
    }
}

pub(super) fn parse_opcua(folder: &Path, section: &Section<'_, '_>) -> Option<OpcUa> {
    let listen = section.parse::<Option<String>>("listen", (), Some(None));
    let host = section.parse::<Option<String>>("host", (), Some(None));
    let anonymous = section.parse::<AnonymousAccess>("anonymous", (), Some(AnonymousAccess::Nothing));
    let unencrypted = section.parse::<bool>("unencrypted", (), Some(false));
    let certificates = section.parse::<Option<String>>("certificates", (), Some(None));
    section.finish();
    let (anonymous, is_unencrypted_allowed) = (anonymous?, unencrypted?);
    if is_unencrypted_allowed && anonymous == AnonymousAccess::Nothing {
        let message = "found true, but log-in is not possible over an unencrypted connection, because the password \
                       could be read on the network; true is valid only together with anonymous = \"read\"";
        section.problem("unencrypted", message);
        return None;
    }
    let host = host?;
    if let Some(host) = host.as_ref().filter(|host| !is_valid_host(host)) {
        let message = format!(
            "found \"{}\", valid: a computer's name or an IP address, such as \"cell-1.plant.example\"",
            host.escape_debug()
        );
        section.problem("host", message);
        return None;
    }
    let address = match &listen? {
        None => {
            section.missing_required("listen", "the address and port of the server, such as \"0.0.0.0:4840\"")?
        }
        Some(text) => match text.parse::<SocketAddr>() {
            Ok(address) if address.port() > 0 => Some(address),
            _ => {
                let allowed = "valid: an IP address and a port, such as \"0.0.0.0:4840\"";
                section.problem("listen", format!("found \"{text}\", {allowed}"));
                return None;
            }
        },
    };
    let certificates = certificates?.map_or_else(PathBuf::new, |name| folder.join(name));
    Some(OpcUa { listen: address, host, anonymous, is_unencrypted_allowed, certificates })
}

/// Returns whether the text is a valid host in an endpoint URL.
fn is_valid_host(text: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-');
    (1..=253).contains(&text.len()) && text.chars().all(is_plain)
}
