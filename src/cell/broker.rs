//! Where a NATS broker is, and how it knows us: the same keys in a cell's file and in that of the archive.

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
            Ok(address) => Some(Some(Broker { address, ca: ca.map(file), login })),
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
}
