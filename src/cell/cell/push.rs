//! `[push]`: signed records by HTTP to a quality system. Off until `to` is set.

use super::address::{self, Address, read};
use super::devices::is_local_host;
use panelprep_base::config::Section;
use std::fmt;
use std::path::{Path, PathBuf};

const ALARM_DELAY_RANGE_MIN: std::ops::RangeInclusive<usize> = 1..=100_000;
/// The schemes with their usual ports.
const SCHEMES: [(&str, u16); 2] = [("https", 443), ("http", 80)];

/// The destination of signed records.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PushSettings {
    /// The folder of the server below which each file is put.
    pub target_folder: WebFolder,
    /// The certificate of the authority that has signed the server's certificate, PEM, with `https://`.
    pub ca_certificate: Option<PathBuf>,
    /// The file of the token that the server requires.
    pub token_file: Option<PathBuf>,
    /// A record that the server does not have after this many minutes raises an alarm.
    pub alarm_delay_min: usize,
}

/// A folder of an HTTP server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WebFolder {
    /// Whether TLS is used.
    pub is_encrypted: bool,
    /// The server's name or address.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// The folder's path, from `/` on and without `/` at its end.
    pub path: String,
}

impl WebFolder {
    /// Returns host and port as they are written in an address.
    pub fn authority(&self) -> String {
        address::authority(&self.host, self.port)
    }
}

impl fmt::Display for WebFolder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (scheme, usual) = SCHEMES[usize::from(!self.is_encrypted)];
        let authority = self.authority();
        let usual = format!(":{usual}");
        write!(f, "{scheme}://{}{}", authority.strip_suffix(&usual).unwrap_or(&authority), self.path)
    }
}

/// Reads `[push]`. The outer `None` is a problem, the inner one means that nothing is pushed.
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
    let Address { scheme, host, port, path } = read(text, SCHEMES)?;
    Some(WebFolder { is_encrypted: scheme == "https", host, port, path })
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;

    fn found(table: &str) -> Result<Option<PushSettings>, String> {
        let cell = Cell::check("cells/cell.toml", table).map_err(|problems| problems.to_string())?;
        Ok(cell.push().cloned())
    }

    #[test]
    fn it_is_off_until_an_address_is_there() {
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
