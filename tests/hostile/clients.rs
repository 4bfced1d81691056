//! Clients that keep the service's socket busy, each in one of six ways.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

/// Acts as one kind of hostile client until the test ends.
pub fn harass(socket: &Path, kind: usize, ends: &AtomicBool, done: &AtomicUsize) {
    while !ends.load(Ordering::Relaxed) {
        let Ok(mut stream) = UnixStream::connect(socket) else { continue };
        stream.set_read_timeout(Some(Duration::from_millis(200))).expect("set");
        stream.set_write_timeout(Some(Duration::from_millis(200))).expect("set");
        let mut answer = [0; 4096];
        // The result is ignored: the request is refused or answered, or the connection is closed.
        let _ = match kind % 6 {
            0 => stream.read(&mut answer),
            1 => (0..20)
                .try_for_each(|_| {
                    std::thread::sleep(Duration::from_millis(10));
                    stream.write_all(b" ")
                })
                .map(|()| 0),
            2 => stream.write_all(b"{\"ask\":\"state\"}\n").and_then(|()| stream.read(&mut answer)),
            3 => stream.write_all(b"{\"ask\":\"accept\"}\n").and_then(|()| stream.read(&mut answer)),
            4 => stream.write_all(&[b'x'; 300_000]).and_then(|()| stream.read(&mut answer)),
            _ => stream.write_all(b"{\"ask\":\"start\",\"recipe\":\"a\",\"text\":\"").map(|()| 0),
        };
        done.fetch_add(1, Ordering::Relaxed);
    }
}
