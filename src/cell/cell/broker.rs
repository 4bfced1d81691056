//! The address of a NATS broker, and the login there: the same keys in a cell's file and in that of the archive.

use super::address::{Address, authority, read};
use super::devices::is_local_host;
use panelprep_base::config::Section;
use std::path::{Path, PathBuf};

/// A broker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Broker {
    /// The broker's address, `nats://HOST:PORT` or `tls://HOST:PORT`.
    pub address: String,
    /// The certificate authority's file, PEM; without it the system's authorities are used.
    pub ca: Option<PathBuf>,
    /// How the broker identifies this program.
    pub login: BrokerLogin,
}

/// How a broker identifies a client.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BrokerLogin {
    /// The broker accepts every client.
    Anybody,
    /// With a file of credentials, as `nsc` writes it.
    Credentials(PathBuf),
    /// With a user's name, and a file that contains only the password.
    Password {
        /// The user.
        user: String,
        /// The file.
        file: PathBuf,
    },
}

/// The scheme without encryption; `SCHEMES` contains both schemes with their usual port, which is the same.
const PLAIN_SCHEME: &str = "nats";
const SCHEMES: [(&str, u16); 2] = [(PLAIN_SCHEME, 4_222), ("tls", 4_222)];

impl Broker {
    /// Reads the address under this key and the keys that belong to it. The outer `None` means that there is a
    /// problem, the inner one that no broker is named.
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
                section.problem(
                    "user",
                    "user and password_file belong together, and cannot be combined with \
                                         credentials",
                );
                return None;
            }
        };
        let Some(address) = address else { return Some(None) };
        let Some(Address { scheme, host, port, .. }) = read(&address, SCHEMES).filter(|read| read.path.is_empty())
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

#[cfg(test)]
mod tests {
    use super::super::Cell;

    /// A password is refused if it would go to another computer without encryption, since anyone on the network could
    /// read it.
    #[test]
    fn a_password_goes_encrypted() {
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
            ("behind_min = 5".to_owned(), "office.broker: is missing: the address of the office's broker"),
        ] {
            let problem = found(&wrong).expect_err("wrong");
            assert!(problem.contains(words), "{wrong}: {problem}");
        }
    }
}
