//! Where a NATS broker is, and how it knows us: the same keys in a cell's file and in that of the archive.

use super::devices::is_this_computer;
use crate::config::Section;
use std::path::{Path, PathBuf};

/// A broker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Broker {
    /// Its address, `nats://HOST:PORT` or `tls://HOST:PORT`.
    pub address: String,
    /// The certificate authority's file, PEM; without it the system's ones count.
    pub ca: Option<PathBuf>,
    /// How it knows us.
    pub login: BrokerLogin,
}

/// How a broker knows who comes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BrokerLogin {
    /// It lets anybody in.
    Anybody,
    /// By a file of credentials, as `nsc` writes it.
    Credentials(PathBuf),
    /// By a user's name and the password that stands alone in a file.
    Password {
        /// The user.
        user: String,
        /// The file.
        file: PathBuf,
    },
}

const PORT: u16 = 4222;

impl Broker {
    /// Takes the address under this key and what belongs to it; the outer `None` is a problem, the inner one no broker.
    pub fn take(folder: &Path, section: &Section<'_, '_>, key: &'static str) -> Option<Option<Broker>> {
        let keys = [key, "ca", "credentials", "user", "password_file"];
        let [address, ca, credentials, user, password_file] =
            keys.map(|key| section.take::<Option<String>>(key, (), Some(None)));
        let (address, ca, credentials, user, password_file) = (address?, ca?, credentials?, user?, password_file?);
        let file = |name: String| folder.join(name);
        let login = match (credentials, user, password_file) {
            (None, None, None) => BrokerLogin::Anybody,
            (Some(name), None, None) => BrokerLogin::Credentials(file(name)),
            (None, Some(user), Some(name)) => BrokerLogin::Password { user, file: file(name) },
            _ => {
                section.problem("user", "user and password_file belong together, and not beside credentials");
                return None;
            }
        };
        let Some(address) = address else { return Some(None) };
        match read(&address) {
            Ok(address) => {
                let is_open = address.starts_with("nats://");
                let host = address.trim_start_matches("nats://").rsplit_once(':').map_or("", |(host, _)| host);
                if is_open && ca.is_some() {
                    section.problem("ca", "is used with tls:// alone, and the address begins with nats://");
                    return None;
                }
                if is_open && login != BrokerLogin::Anybody && !is_this_computer(host.trim_matches(['[', ']'])) {
                    let message = "begins with nats://: everybody on the way to another computer could read the password; write tls://";
                    section.problem(key, message);
                    return None;
                }
                Some(Some(Broker { address, ca: ca.map(file), login }))
            }
            Err(problem) => {
                section.problem(key, problem);
                None
            }
        }
    }
}

/// The address with its port.
fn read(text: &str) -> Result<String, String> {
    let allowed = || {
        format!(
            "found \"{text}\", allowed is an address such as \"nats://office.example:4222\" or \"tls://office.example:4222\""
        )
    };
    let (scheme, rest) = text.split_once("://").ok_or_else(allowed)?;
    let (host, port) = match rest.rsplit_once(':') {
        Some((host, port)) => (host, port.parse::<u16>().ok().filter(|port| *port > 0).ok_or_else(allowed)?),
        None => (rest, PORT),
    };
    let is_host = !host.is_empty() && host.chars().all(|c| c.is_ascii_alphanumeric() || ".-[]:".contains(c));
    match ["nats", "tls"].contains(&scheme) && is_host {
        true => Ok(format!("{scheme}://{host}:{port}")),
        false => Err(allowed()),
    }
}

#[cfg(test)]
mod tests {
    use super::read;

    #[test]
    fn an_address_has_a_scheme_a_host_and_a_port() {
        assert_eq!(read("nats://office"), Ok("nats://office:4222".to_owned()));
        assert_eq!(read("tls://10.0.0.7:4223"), Ok("tls://10.0.0.7:4223".to_owned()));
        assert_eq!(read("nats://[::1]:4222"), Ok("nats://[::1]:4222".to_owned()));
        for wrong in ["office", "http://office", "nats://", "nats://office:0", "nats://office:x", "nats://a@b:1"] {
            assert!(
                read(wrong).is_err_and(|problem| problem.starts_with(&format!("found \"{wrong}\""))),
                "{wrong}"
            );
        }
    }

    /// What would go to another computer so that everybody on the way reads it is refused.
    #[test]
    fn a_password_goes_encrypted() {
        use super::super::Cell;
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
            (format!("broker = 'nats://office'\n{login}"), "office.broker: begins with nats://: everybody"),
            (
                "broker = 'nats://office'\ncredentials = 'c'".to_owned(),
                "office.broker: begins with nats://: everybody",
            ),
            ("broker = 'nats://127.0.0.1'\nca = 'c'".to_owned(), "office.ca: is used with tls:// alone"),
            ("behind_min = 5".to_owned(), "office.broker: is missing: the address of the office's broker"),
        ] {
            let problem = found(&wrong).expect_err("wrong");
            assert!(problem.contains(words), "{wrong}: {problem}");
        }
    }
}
