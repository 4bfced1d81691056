//! Identifies the origin of a request: the operating system's user at the other end of a connection, by number and
//! name.

use panelprep_base::disk;
use panelprep_cell::record::{RequestAuthor, RequestSource};
use std::os::fd::AsFd;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;

/// Looks up the name for a user's number. It may wait for the disk.
pub(super) type NameLookup = dyn Fn(u32) -> Option<String> + Send + Sync;

/// The user at the other end of this connection to the service's socket, still without a name.
pub(super) fn socket_peer(connection: impl AsFd) -> RequestAuthor {
    let uid = rustix::net::sockopt::socket_peercred(connection).ok().map(|peer| peer.uid.as_raw());
    RequestAuthor { front: RequestSource::Socket, uid, user: None, from: None }
}

/// The user who runs this program, with a command that runs one cycle or clears an abort.
pub fn current_user() -> RequestAuthor {
    with_name(RequestAuthor {
        front: RequestSource::Command,
        uid: Some(rustix::process::getuid().as_raw()),
        user: None,
        from: None,
    })
}

/// Returns the same user with a name, if this computer's list of users has one.
pub(super) fn with_name(who: RequestAuthor) -> RequestAuthor {
    match who.uid {
        Some(uid) => RequestAuthor { user: name(uid), ..who },
        None => who,
    }
}

/// Returns the same user with the name that the lookup gives. It runs on a separate thread: a disk that hangs must not
/// delay the request of any user. After the time limit, the user has no name and is known by the number alone.
pub(super) async fn named_within(who: RequestAuthor, lookup: Arc<NameLookup>, limit: Duration) -> RequestAuthor {
    let Some(uid) = who.uid else { return who };
    let found = timeout(limit, tokio::task::spawn_blocking(move || lookup(uid))).await;
    RequestAuthor { user: found.ok().and_then(Result::ok).flatten(), ..who }
}

/// Formats a user for a line of the log: `anna (uid 1001)`.
pub(super) fn format_for_log(who: &RequestAuthor) -> String {
    match (&who.user, who.uid) {
        (Some(user), Some(uid)) => format!("{user} (uid {uid})"),
        (None, Some(uid)) => format!("uid {uid}"),
        (Some(user), None) => user.clone(),
        (None, None) => "an unknown user".to_owned(),
    }
}

/// The name for a number in the list of users. A directory service is not queried, since it may hang.
pub(super) fn name(uid: u32) -> Option<String> {
    let list = disk::read(Path::new("/etc/passwd")).ok()?;
    find_user_name(&String::from_utf8_lossy(&list), uid)
}

fn find_user_name(list: &str, uid: u32) -> Option<String> {
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
    fn a_number_is_identified_by_its_name() {
        let list =
            "root:x:0:0:root:/root:/bin/bash\nbroken\nanna:x:1001:1001:Anna:/home/anna:/bin/sh\n:x:7:7::/:\n";
        let who = |uid| RequestAuthor {
            front: RequestSource::Socket,
            uid,
            user: uid.and_then(|uid| find_user_name(list, uid)),
            from: None,
        };
        let told = |uid| format_for_log(&who(Some(uid)));
        assert_eq!((told(0), told(1_001)), ("root (uid 0)".to_owned(), "anna (uid 1001)".to_owned()));
        assert_eq!((told(7), told(5)), ("uid 7".to_owned(), "uid 5".to_owned()), "no name, no such user");
        assert_eq!(format_for_log(&who(None)), "an unknown user");
    }
}
