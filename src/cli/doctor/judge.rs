//! From a fact of the computer to a line for a person. Pure.

use super::Check;
use crate::daemon::FLOOR_MB;

/// Below this there is room for a few cycles only, MB.
const SCARCE_MB: u64 = 10_000;
/// A camera's frames are received into a socket buffer of this size.
pub(super) const RECEIVE_BUFFER_BYTES: u64 = 8 * 1024 * 1024;
/// What is written and read in the same minute may differ by as much, s.
const CLOCK_SLACK_S: i64 = 60;

/// Room for what a cycle leaves behind.
pub(super) fn disk(folder: &str, free_mb: u64) -> Check {
    let found = format!("{free_mb} MB free where the store is, {folder}");
    match free_mb {
        ..FLOOR_MB => Check::wrong(
            "disk",
            found,
            format!("make room: no cycle begins below {FLOOR_MB} MB; a film takes 100 to 500"),
        ),
        FLOOR_MB..SCARCE_MB => Check::right("disk", format!("{found}; room for a few cycles only")),
        _ => Check::right("disk", found),
    }
}

/// Is the clock kept by another one? `None` where nobody knows.
pub(super) fn clock_is_kept(kept: Option<bool>) -> Check {
    match kept {
        Some(true) => Check::right("clock", "set by a time server"),
        // Records carry times that an inspector signs; a cell without a network may still be set by hand.
        Some(false) => Check::right("clock", "not set by a time server; records carry this computer's own time"),
        None => Check::right("clock", "whether a time server sets it is not known here"),
    }
}

/// What was written last must not lie ahead.
pub(super) fn clock_behind(written_unix_s: i64, now_unix_s: i64) -> Check {
    let ahead_s = written_unix_s - now_unix_s;
    if ahead_s > CLOCK_SLACK_S {
        let found = format!("the store was last written {:.1} h ahead of now", ahead_s as f64 / 3600.0);
        return Check::wrong("clock beside the store", found, "set the computer's clock: `timedatectl`");
    }
    Check::right("clock beside the store", format!("last written {:.1} h ago", -ahead_s as f64 / 3600.0))
}

/// May a socket have the buffer that a GigE Vision camera needs? `largest` is the kernel's `rmem_max`.
pub(super) fn receive_buffer(largest_bytes: Option<u64>) -> Check {
    let name = "socket buffers";
    let advice = format!(
        "put `net.core.rmem_max = {RECEIVE_BUFFER_BYTES}` into /etc/sysctl.d/60-panelprep.conf and run `sysctl --system`"
    );
    match largest_bytes {
        Some(bytes) if bytes >= RECEIVE_BUFFER_BYTES => {
            Check::right(name, format!("up to {bytes} bytes; a camera's takes {RECEIVE_BUFFER_BYTES}"))
        }
        Some(bytes) => {
            let found =
                format!("up to {bytes} bytes; a camera's takes {RECEIVE_BUFFER_BYTES}, and loses frames with less");
            Check::wrong(name, found, advice)
        }
        None => Check::wrong(
            name,
            "the kernel does not say how large they may be (/proc/sys/net/core/rmem_max)",
            advice,
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_and_a_small_buffer_say_what_to_do() {
        assert!(disk("store", FLOOR_MB).ok && disk("store", 50_000).found.starts_with("50000 MB free"));
        let full = disk("store", FLOOR_MB - 1);
        assert!(!full.ok && full.advice.contains("1000 MB"));
        assert!(receive_buffer(Some(RECEIVE_BUFFER_BYTES)).ok);
        for small in [Some(212_992), None] {
            let check = receive_buffer(small);
            assert!(!check.ok && check.advice.contains("net.core.rmem_max = 8388608"), "{check:?}");
        }
    }

    /// By hand: written at 10:02, now 10:00 is two minutes ahead, more than the one allowed.
    #[test]
    fn a_clock_that_was_set_back_is_noticed() {
        assert!(clock_behind(36_060, 36_000).ok && clock_behind(0, 36_000).found.contains("10.0 h ago"));
        let behind = clock_behind(36_120, 36_000);
        assert!(!behind.ok && behind.found.contains("0.0 h ahead"));
    }
}
