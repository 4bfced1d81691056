//! Who asks: the user at the other end of the socket, by number and name.

use crate::disk;
use std::fmt;
use std::os::fd::AsFd;
use std::path::Path;

/// A user, as the system knows the other end of a connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Caller {
    /// The user's number; `None` where the system does not say.
    pub uid: Option<u32>,
    /// The user's name; `None` where the number has none on this computer.
    pub user: Option<String>,
}

impl Caller {
    /// The user at the other end of this connection, without a name.
    pub fn of(connection: impl AsFd) -> Self {
        let uid = rustix::net::sockopt::socket_peercred(connection).ok().map(|who| who.uid.as_raw());
        Caller { uid, user: None }
    }

    /// The same with the name.
    pub fn named(self) -> Self {
        Caller { user: self.uid.and_then(name), ..self }
    }
}

impl fmt::Display for Caller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.user, self.uid) {
            (Some(user), Some(uid)) => write!(f, "{user} (uid {uid})"),
            (None, Some(uid)) => write!(f, "uid {uid}"),
            (_, None) => f.write_str("an unknown user"),
        }
    }
}

/// The name that this computer's list of users has for a number. A directory service is not asked: it may hang.
fn name(uid: u32) -> Option<String> {
    let list = disk::read(Path::new("/etc/passwd")).ok()?;
    name_in(&String::from_utf8_lossy(&list), uid)
}

fn name_in(list: &str, uid: u32) -> Option<String> {
    let of_line = |line: &str| {
        let mut fields = line.split(':');
        let (name, number) = (fields.next()?, fields.nth(1)?);
        let is_plain = !name.is_empty() && name.chars().all(|c| c.is_ascii_graphic());
        (number.parse() == Ok(uid) && is_plain).then(|| name.to_owned())
    };
    list.lines().find_map(of_line)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_told_by_its_name() {
        let list =
            "root:x:0:0:root:/root:/bin/bash\nbroken\nanna:x:1001:1001:Anna:/home/anna:/bin/sh\n:x:7:7::/:\n";
        let caller = |uid| Caller { uid: Some(uid), user: name_in(list, uid) }.to_string();
        assert_eq!((caller(0), caller(1_001)), ("root (uid 0)".to_owned(), "anna (uid 1001)".to_owned()));
        assert_eq!((caller(7), caller(5)), ("uid 7".to_owned(), "uid 5".to_owned()), "no name, no such user");
        assert_eq!(Caller { uid: None, user: None }.to_string(), "an unknown user");
    }
}
