//! Servers outside of the cell that receive its records: their addresses (scheme, host, port and, for some, a path), a
//! NATS broker, `[office]` and `[push]`.
//!
//! A broker has the same keys in the files of a cell and of the archive. `[office]`, the office server that receives
//! the cell's records, is off until `broker` is set. `[push]`, which sends signed records by HTTP to a quality system,
//! is off until `to` is set.

use super::devices::{is_local_host, is_valid_host};
use hyper::Uri;
use panelprep_base::config::Section;
use std::fmt;
use std::path::{Path, PathBuf};

/// A parsed server address.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Address {
    pub scheme: &'static str,
    /// The host name or IP address, without brackets.
    pub host: String,
    pub port: u16,
    /// The path from its first `/`, without a final `/`; empty if there is none.
    pub path: String,
}

/// Parses an address with one of these schemes, each with its default port. An address with a user, a query or a parent
/// folder (`..`) is refused.
fn read_address(text: &str, schemes: [(&'static str, u16); 2]) -> Option<Address> {
    let uri: Uri = text.parse().ok()?;
    let (scheme, usual) = schemes.into_iter().find(|(scheme, _)| uri.scheme_str() == Some(scheme))?;
    let authority = uri.authority()?;
    // The library ignores the text before @, and a port that is not a number.
    let port = match authority.as_str().strip_prefix(authority.host())? {
        "" => usual,
        port => port.strip_prefix(':')?.parse().ok()?,
    };
    let host = authority.host().trim_matches(['[', ']']);
    let path = uri.path();
    let is_plain = path.chars().all(|c| c.is_ascii_alphanumeric() || "-._~/".contains(c));
    let is_path = is_plain && !path.contains("//") && !path.split('/').any(|part| part == "..");
    let is_right = is_valid_host(host) && port > 0 && is_path && uri.query().is_none();
    (is_right && !text.contains('#')).then(|| Address {
        scheme,
        host: host.to_owned(),
        port,
        path: path.trim_end_matches('/').to_owned(),
    })
}

/// Returns host and port in the form of an address, with brackets around IPv6.
pub fn authority(host: &str, port: u16) -> String {
    if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
}

/// The settings of a NATS broker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Broker {
    /// The broker's address, `nats://HOST:PORT` or `tls://HOST:PORT`.
    pub address: String,
    /// The file of the certificate authority, PEM; `None` to use the authorities of the system.
    pub ca: Option<PathBuf>,
    /// How this program logs in at the broker.
    pub login: BrokerLogin,
}

/// How a client logs in at a broker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BrokerLogin {
    /// Without a login: the broker accepts every client.
    Anybody,
    /// With a credentials file, as written by `nsc`.
    Credentials(PathBuf),
    /// With a user name, and a file that contains only the password.
    Password {
        /// The user name at the broker.
        user: String,
        /// The file that contains the password.
        file: PathBuf,
    },
}

/// The scheme without encryption.
const PLAIN_SCHEME: &str = "nats";
const SCHEMES: [(&str, u16); 2] = [(PLAIN_SCHEME, 4_222), ("tls", 4_222)];

impl Broker {
    /// Parses the address under this key and the other keys of the broker. The outer `None` is a problem in the file,
    /// the inner `None` means that no broker is configured.
    pub fn parse(folder: &Path, section: &Section<'_, '_>, key: &'static str) -> Option<Option<Broker>> {
        let keys = [key, "ca", "credentials", "user", "password_file"];
        let [address, ca, credentials, user, password_file] =
            keys.map(|key| section.parse::<Option<String>>(key, (), Some(None)));
        let (address, ca, credentials, user, password_file) = (address?, ca?, credentials?, user?, password_file?);
        let file = |name: String| folder.join(name);
        let login = match (credentials, user, password_file) {
            (None, None, None) => BrokerLogin::Anybody,
            (Some(name), None, None) => BrokerLogin::Credentials(file(name)),
            (None, Some(user), Some(name)) => BrokerLogin::Password { user, file: file(name) },
            _ => {
                section.problem("user", "state both user and password_file, or only credentials");
                return None;
            }
        };
        let Some(address) = address else { return Some(None) };
        let Some(Address { scheme, host, port, .. }) =
            read_address(&address, SCHEMES).filter(|read| read.path.is_empty())
        else {
            let allowed =
                "valid: an address such as \"nats://office.example:4222\" or \"tls://office.example:4222\"";
            section.problem(key, format!("found \"{}\", {allowed}", address.escape_debug()));
            return None;
        };
        if scheme == PLAIN_SCHEME && ca.is_some() {
            section.problem("ca", "is used only with tls://, but the address begins with nats://");
            return None;
        }
        if scheme == PLAIN_SCHEME && login != BrokerLogin::Anybody && !is_local_host(&host) {
            let message = "begins with nats://, but the broker is on another computer: the password could be read on \
                           the network; write tls://";
            section.problem(key, message);
            return None;
        }
        let address = format!("{scheme}://{}", authority(&host, port));
        Some(Some(Broker { address, ca: ca.map(file), login }))
    }
}

/// Maximum length of a cell's name, characters.
const MAX_CELL_NAME_CHARACTERS: usize = 40;
const ALARM_DELAY_RANGE_MIN: std::ops::RangeInclusive<usize> = 1..=100_000;

/// The office server that receives the cell's records.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Office {
    /// The broker that transfers the records.
    pub broker: Broker,
    /// The name of this cell on the office server.
    pub cell: CellName,
    /// Time until an alarm is raised if the office server does not have a record, minutes.
    pub alarm_delay_min: usize,
}

/// The name of a cell: letters, digits, `-` and `_`, so that it is also valid in a NATS subject, a message name and a
/// URL.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellName(String);

impl CellName {
    /// Checks the name of a cell.
    ///
    /// # Errors
    /// If the name is invalid; the error states the valid characters.
    pub fn new(name: &str) -> Result<Self, String> {
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if !name.is_empty() && name.len() <= MAX_CELL_NAME_CHARACTERS && name.chars().all(is_allowed) {
            return Ok(CellName(name.to_owned()));
        }
        Err(format!(
            "found \"{}\", valid: 1 to {MAX_CELL_NAME_CHARACTERS} letters, digits, '-' and '_', such as \"cell-1\"",
            name.escape_debug()
        ))
    }

    /// Returns the name as it is written.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for CellName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Parses `[office]`. The outer `None` is a problem in the file, the inner `None` means that no office server is
/// configured.
pub(super) fn parse_office(folder: &Path, section: &Section<'_, '_>) -> Option<Option<Office>> {
    let broker = Broker::parse(folder, section, "broker");
    let cell = section.parse::<Option<String>>("cell", (), Some(None));
    let behind_min = section.parse::<usize>("behind_min", ALARM_DELAY_RANGE_MIN, Some(60));
    // Check the name even if the broker is wrong, so that both problems are reported.
    let cell = cell.and_then(|name| match name.as_deref().map(CellName::new).transpose() {
        Ok(name) => Some(name),
        Err(problem) => {
            section.problem("cell", problem);
            None
        }
    });
    section.finish();
    let (Some(broker), Some(cell), Some(behind_min)) = (broker, cell, behind_min) else { return None };
    let Some(broker) = broker else {
        return section.missing_required(
            "broker",
            "the address of the office server's broker, such as \"tls://office.example:4222\"",
        );
    };
    let Some(cell) = cell else {
        section.problem("cell", "is missing; state the name of this cell on the office server, such as \"cell-1\"");
        return None;
    };
    Some(Some(Office { broker, cell, alarm_delay_min: behind_min }))
}

/// The schemes of a quality system's address, each with its default port.
const PUSH_SCHEMES: [(&str, u16); 2] = [("https", 443), ("http", 80)];

/// The HTTP server that receives signed records.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PushSettings {
    /// The folder on the server into which the files are written.
    pub target_folder: WebFolder,
    /// The certificate of the authority that signed the server's certificate, PEM; required for `https://`.
    pub ca_certificate: Option<PathBuf>,
    /// The file with the access token, if the server requires one.
    pub token_file: Option<PathBuf>,
    /// Time until an alarm is raised if the server does not have a record, minutes.
    pub alarm_delay_min: usize,
}

/// A folder on an HTTP server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WebFolder {
    /// Whether TLS is used.
    pub is_encrypted: bool,
    /// The server's host name or address.
    pub host: String,
    /// The server's TCP port.
    pub port: u16,
    /// The path of the folder, from `/` and without a final `/`.
    pub path: String,
}

impl WebFolder {
    /// Returns host and port in the form of an address, with brackets around IPv6.
    pub fn authority(&self) -> String {
        authority(&self.host, self.port)
    }
}

impl fmt::Display for WebFolder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (scheme, usual) = PUSH_SCHEMES[usize::from(!self.is_encrypted)];
        let authority = self.authority();
        let usual = format!(":{usual}");
        write!(f, "{scheme}://{}{}", authority.strip_suffix(&usual).unwrap_or(&authority), self.path)
    }
}

/// Parses `[push]`. The outer `None` is a problem in the file, the inner `None` means that records are not pushed.
pub(super) fn parse_push(folder: &Path, section: &Section<'_, '_>) -> Option<Option<PushSettings>> {
    if !section.is_present() {
        return Some(None);
    }
    let to = section.parse::<String>("to", (), None);
    let [ca_certificate, token_file] =
        ["ca_certificate", "token_file"].map(|key| section.parse::<Option<String>>(key, (), Some(None)));
    let behind_min = section.parse::<usize>("behind_min", ALARM_DELAY_RANGE_MIN, Some(60));
    section.finish();
    let (to, ca_certificate, token_file, behind_min) = (to?, ca_certificate?, token_file?, behind_min?);
    let Some(to) = parse_web_folder(&to) else {
        let allowed = "valid: an address such as \"https://quality.example/cells/cell-1\", with letters, digits \
                       and the characters - . _ ~ / in its path";
        section.problem("to", format!("found \"{}\", {allowed}", to.escape_debug()));
        return None;
    };
    match (to.is_encrypted, &ca_certificate) {
        (true, None) => {
            section.problem(
                "ca_certificate",
                "is missing; https:// needs the certificate of the authority (CA) that signed the server's certificate",
            );
            return None;
        }
        (false, Some(_)) => {
            section.problem(
                "ca_certificate",
                "is used only with https://, but the address in to begins with \
                                               http://",
            );
            return None;
        }
        (false, None) if token_file.is_some() && !is_local_host(&to.host) => {
            section.problem(
                "token_file",
                "the token could be read on the network; write https:// for the address of another computer",
            );
            return None;
        }
        _ => {}
    }
    let file = |name: String| folder.join(name);
    Some(Some(PushSettings {
        target_folder: to,
        ca_certificate: ca_certificate.map(file),
        token_file: token_file.map(file),
        alarm_delay_min: behind_min,
    }))
}

fn parse_web_folder(text: &str) -> Option<WebFolder> {
    let Address { scheme, host, port, path } = read_address(text, PUSH_SCHEMES)?;
    Some(WebFolder { is_encrypted: scheme == "https", host, port, path })
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;

    /// A password is refused if it would be sent to another computer without encryption, because it could be read on
    /// the network.
    #[test]
    fn a_password_is_only_sent_encrypted() {
        let found = |keys: &str| {
            let text = format!("[office]\ncell = 'a'\n{keys}");
            Cell::check("cell.toml", &text).map(drop).map_err(|problems| problems.to_string())
        };
        let login = "user = 'u'\npassword_file = 'p'";
        for right in [
            "broker = 'nats://office'".to_owned(),
            format!("broker = 'nats://127.0.0.1'\n{login}"),
            format!("broker = 'tls://office'\nca = 'c'\n{login}"),
            format!("broker = 'nats://[::1]:4222'\n{login}"),
        ] {
            assert_eq!(found(&right), Ok(()), "{right}");
        }
        for (wrong, words) in [
            (
                format!("broker = 'nats://office'\n{login}"),
                "office.broker: begins with nats://, but the broker is on another computer",
            ),
            (
                "broker = 'nats://office'\ncredentials = 'c'".to_owned(),
                "office.broker: begins with nats://, but the broker is on another computer",
            ),
            ("broker = 'nats://127.0.0.1'\nca = 'c'".to_owned(), "office.ca: is used only with tls://"),
            (
                "broker = 'nats://office/a'".to_owned(),
                "office.broker: found \"nats://office/a\", valid: an address",
            ),
            ("behind_min = 5".to_owned(), "office.broker: is missing: the address of the office server's broker"),
        ] {
            let problem = found(&wrong).expect_err("wrong");
            assert!(problem.contains(words), "{wrong}: {problem}");
        }
    }

    #[test]
    fn an_address_is_accepted_only_as_a_whole() {
        let of = |text| {
            let read = read_address(text, [("nats", 4_222), ("tls", 4_222)])?;
            Some((read.scheme, read.host, read.port, read.path))
        };
        let whole = |scheme, host: &str, port, path: &str| Some((scheme, host.to_owned(), port, path.to_owned()));
        assert_eq!(of("nats://office"), whole("nats", "office", 4_222, ""));
        assert_eq!(of("tls://10.0.0.7:4223/a/b.c/"), whole("tls", "10.0.0.7", 4_223, "/a/b.c"));
        assert_eq!(of("nats://[::1]:4222"), whole("nats", "::1", 4_222, ""));
        assert_eq!([authority("::1", 1), authority("a", 2)], ["[::1]:1", "a:2"]);
        for wrong in [
            "",
            "office",
            "http://office",
            "nats://",
            "nats://office:0",
            "nats://office:x",
            "nats://office:",
            "nats://a@b:1",
            "nats://a?b",
            "nats://a#b",
            "nats://a//b",
            "nats://a/../b",
            "nats://a/b c",
            "nats://a/%41",
            "nats://-a",
            "nats://a:99999",
        ] {
            assert_eq!(of(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_wrong_name_and_a_wrong_broker_are_reported_at_once() {
        let text = "[office]\ncell = 'c 1'\nbroker = 'nats://10.0.0.1:a'\n";
        let problems = Cell::check("cell.toml", text).expect_err("wrong").to_string();
        for words in ["office.cell: found \"c 1\"", "office.broker: found \"nats://10.0.0.1:a\""] {
            assert!(problems.contains(words), "{problems}");
        }
    }

    fn found(table: &str) -> Result<Option<PushSettings>, String> {
        let cell = Cell::check("cells/cell.toml", table).map_err(|problems| problems.to_string())?;
        Ok(cell.push().cloned())
    }

    #[test]
    fn push_is_off_until_an_address_is_stated() {
        assert_eq!(found(""), Ok(None));
        let push = found(
            "[push]\nto = 'https://quality.example/cells/1/'\nca_certificate = 'ca.pem'\ntoken_file = 'token'\n",
        );
        let push = push.expect("right").expect("there");
        assert_eq!(push.target_folder.to_string(), "https://quality.example/cells/1");
        assert_eq!((push.target_folder.port, push.alarm_delay_min), (443, 60));
        assert_eq!(push.token_file.as_deref(), Some(Path::new("cells/token")));
        for address in ["http://127.0.0.1:8080", "http://[::1]:8080/a", "http://quality/a.b/c_d~e-f"] {
            let push = found(&format!("[push]\nto = '{address}'")).expect("right").expect("there");
            assert_eq!(push.target_folder.to_string(), address);
        }
    }

    #[test]
    fn what_is_wrong_is_reported() {
        for wrong in [
            "quality.example",
            "ftp://a/b",
            "https://",
            "http://a:0/",
            "http://a:b/",
            "http://a//b",
            "http://a/../b",
            "http://u@a/",
            "http://a/b?c",
            "http://a/b c",
        ] {
            let problem = found(&format!("[push]\nto = '{wrong}'")).expect_err(wrong);
            assert!(
                problem.contains(&format!("push.to: found \"{wrong}\", valid: an address such as")),
                "{problem}"
            );
        }
        for (table, problem) in [
            ("to = 'https://a'", "push.ca_certificate: is missing; https:// needs"),
            ("to = 'http://a'\nca_certificate = 'x'", "push.ca_certificate: is used only with https://"),
            ("to = 'http://a'\ntoken_file = 'x'", "push.token_file: the token could be read on the network"),
            ("to = 'http://a'\nbehind_min = 0", "push.behind_min: found 0"),
            ("ca = 'x'\nto = 'http://a'", "push.ca: unknown key"),
            ("behind_min = 5", "push.to: is missing; this key has no default"),
        ] {
            let found = found(&format!("[push]\n{table}")).expect_err(table);
            assert!(found.contains(problem), "{table}: {found}");
        }
        assert!(
            found("[push]\nto = 'http://localhost'\ntoken_file = 'x'").is_ok(),
            "the text does not leave the computer"
        );
    }
}
