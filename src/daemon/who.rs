//! Who asked, for the record.

use super::caller::Caller;
use crate::record::{Front, Who};

/// Who came to the service's socket.
pub(super) fn at_the_socket(caller: Caller) -> Who {
    Who { front: Front::Socket, uid: caller.uid, user: caller.user }
}

/// Who runs this program, by a command that runs one cycle or clears an abort.
pub fn whoever_runs_this() -> Who {
    let caller = Caller { uid: Some(rustix::process::getuid().as_raw()), user: None }.named();
    Who { front: Front::Command, uid: caller.uid, user: caller.user }
}
