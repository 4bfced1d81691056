//! A network between cells and broker that cuts and delays connections.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

#[derive(Default)]
struct Counts {
    is_healed: AtomicBool,
    cut: AtomicU64,
    held_up: AtomicU64,
}

/// The simulated network; cells connect to its port.
pub struct Network {
    pub port: u16,
    counts: Arc<Counts>,
}

impl Network {
    /// Starts a network to the broker on this port.
    pub fn to(broker_port: u16, seed: u64) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("its number").port();
        let counts = Arc::new(Counts::default());
        let shared = counts.clone();
        thread::spawn(move || {
            for (number, cell) in listener.incoming().enumerate() {
                let (Ok(cell), Ok(broker)) = (cell, TcpStream::connect(("127.0.0.1", broker_port))) else {
                    continue;
                };
                for (number, from, to) in [(2 * number, &cell, &broker), (2 * number + 1, &broker, &cell)] {
                    let (from, to) = (from.try_clone().expect("a copy"), to.try_clone().expect("a copy"));
                    let (counts, random) = (shared.clone(), Pcg64Mcg::seed_from_u64(seed ^ ((number as u64) << 8)));
                    thread::spawn(move || pass(from, to, random, &counts));
                }
            }
        });
        Network { port, counts }
    }

    /// Connections are no longer cut from now on.
    pub fn heal(&self) {
        self.counts.is_healed.store(true, Ordering::Relaxed);
    }

    pub fn cut(&self) -> u64 {
        self.counts.cut.load(Ordering::Relaxed)
    }

    pub fn held_up(&self) -> u64 {
        self.counts.held_up.load(Ordering::Relaxed)
    }
}

/// Forwards bytes. One block in 200 is cut in its middle and the connection ends; one in 100 is delayed by up to three
/// seconds.
fn pass(mut from: TcpStream, mut to: TcpStream, mut random: Pcg64Mcg, counts: &Counts) {
    let mut buffer = [0; 16_384];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        let mut count = count;
        let mut is_cut = false;
        if !counts.is_healed.load(Ordering::Relaxed) {
            if random.random_range(0..100) == 0 {
                counts.held_up.fetch_add(1, Ordering::Relaxed);
                thread::sleep(Duration::from_millis(random.random_range(0..3_000)));
            }
            is_cut = random.random_range(0..200) == 0;
            if is_cut {
                counts.cut.fetch_add(1, Ordering::Relaxed);
                count = random.random_range(0..count);
            }
        }
        if to.write_all(&buffer[..count]).is_err() || is_cut {
            break;
        }
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}
