//! Addresses of servers in the cell's file: a scheme, a host, a port and, for some, a path.

use super::devices::is_valid_host;
use hyper::Uri;

/// An address after parsing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Address {
    pub scheme: &'static str,
    /// The name or IP address, without brackets.
    pub host: String,
    pub port: u16,
    /// The path, from its first `/` and without `/` at its end; empty if there is none.
    pub path: String,
}

/// Reads an address of one of these schemes, each with its usual port. A user, a query or a parent folder (`..`) is
/// refused.
pub(super) fn read(text: &str, schemes: [(&'static str, u16); 2]) -> Option<Address> {
    let uri: Uri = text.parse().ok()?;
    let (scheme, usual) = schemes.into_iter().find(|(scheme, _)| uri.scheme_str() == Some(scheme))?;
    let authority = uri.authority()?;
    // The library ignores anything before @, and a port that is not a number.
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

/// Returns host and port as they are written in an address.
pub fn authority(host: &str, port: u16) -> String {
    if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_read_whole_or_not_at_all() {
        let of = |text| {
            let read = read(text, [("nats", 4_222), ("tls", 4_222)])?;
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
}
