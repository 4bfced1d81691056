//! Who asks: the users of this computer by their names.

use crate::record::{Front, Who};

/// The list of local users. A user of a directory service alone has no name here: to ask such a service may take long.
const USERS: &str = "/etc/passwd";

/// The user with this number, who came by this way.
pub fn user(front: Front, uid: Option<u32>) -> Who {
    let user = uid.and_then(|uid| named(&std::fs::read_to_string(USERS).ok()?, uid));
    Who { front, uid, user }
}

/// Who runs this program, by the command that runs one cycle.
pub fn whoever_runs_this() -> Who {
    user(Front::Command, Some(rustix::process::getuid().as_raw()))
}

fn named(users: &str, uid: u32) -> Option<String> {
    users.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, number) = (fields.next()?, fields.nth(1)?);
        (number.parse() == Ok(uid) && !name.is_empty()).then(|| name.to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_user_is_named_by_the_number() {
        let users =
            "root:x:0:0:root:/root:/bin/bash\n# a remark\nbroken\nada:x:1000:1000:Ada,,,:/home/ada:/bin/sh\n";
        assert_eq!(named(users, 1_000).as_deref(), Some("ada"));
        assert_eq!((named(users, 0).as_deref(), named(users, 7)), (Some("root"), None));
    }
}
