//! Measures the 3D camera's worker process (`make bench-worker`): the transfer of a full-size shot through its socket,
//! compared with a simple copy of the same number of bytes. A worker is also killed two hundred times. Recorded shots
//! are replayed without a camera, so these numbers do not include the SDK.
//!
//! `cargo bench --bench worker -- [shots] [kills]`

#[path = "goal.rs"]
mod goal;
#[path = "../zivid/kills.rs"]
mod kills;
#[path = "../zivid/stub.rs"]
mod stub;

use goal::Figure;
use panelprep::devices::zivid::{Restarts, ZividScanner};
use rand::SeedableRng;
use std::time::{Duration, Instant};

const FULL: [usize; 2] = [1944, 1200];
/// Size of a full-size shot, bytes: x, y, z and signal to noise as f32, and three colours per pixel.
const BYTES: usize = 1944 * 1200 * (12 + 3 + 4);
const MAX_MS: f64 = 30.0;
const TIMEOUT: Duration = Duration::from_secs(120);

fn main() {
    let numbers: Vec<usize> = std::env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    let (shots, times) = (numbers.first().copied().unwrap_or(60), numbers.get(1).copied().unwrap_or(200));
    let folder = tempfile::tempdir().expect("a folder");
    let (mut setup, launch) = stub::camera(folder.path(), FULL, "");
    setup.restarts = Restarts { max_restarts: 10_000, ..Restarts::default() };
    let mut scanner = ZividScanner::start(setup, launch).expect("a thread");
    scanner.wait_ready(TIMEOUT).expect("ready");
    let median_ms = crossing(&mut scanner, shots);
    let begun = Instant::now();
    let killed = kills::kill_repeatedly(scanner, times, &mut rand_pcg::Pcg64::seed_from_u64(1));
    println!(
        "{times} kills at random moments in {:.0} s, {} shots and pictures were complete; reported faults:",
        begun.elapsed().as_secs_f64(),
        killed.delivered
    );
    for (name, count) in &killed.named {
        println!("  {count:4}  {name}");
    }
    let named = killed.named.values().sum::<usize>();
    let is_fast = Figure("cameras: 3D shot from the worker to the service, median").report(
        &format!("{MAX_MS} ms"),
        &format!("{median_ms:.1} ms"),
        median_ms <= MAX_MS,
    );
    let found = format!("{named} of {times}");
    let right = Figure("cameras: kills with a named fault").report("all", &found, named == times) && is_fast;
    println!("{}", if right { "all targets met" } else { "a target was MISSED" });
    std::process::exit(i32::from(!right));
}

/// Returns the time from a shot in the worker's memory to the checked shot in the daemon's memory.
fn crossing(scanner: &mut ZividScanner, shots: usize) -> f64 {
    let source: Vec<u8> = (0..BYTES).map(|k| k as u8).collect();
    let (mut crossed, mut copied) = (Vec::new(), Vec::new());
    for _ in 0..shots {
        let begun = Instant::now();
        std::hint::black_box(source.clone());
        copied.push(begun.elapsed().as_secs_f64() * 1e3);
        let shot = scanner.take_scan().expect("a shot");
        kills::check_shot(&shot);
        crossed.push(shot.crossed_ms);
    }
    let [crossing, copying] = [&mut crossed, &mut copied].map(|times| {
        times.sort_by(f64::total_cmp);
        (times[times.len() / 2], times[0], times[times.len() - 1])
    });
    println!(
        "a 3D shot of {}x{}, {:.1} MB, from the worker's memory to the daemon's, checked, over {shots} shots:",
        FULL[0],
        FULL[1],
        BYTES as f64 * 1e-6
    );
    println!(
        "  through the socket  median {:6.1} ms, {:.1} to {:.1}; target at most {MAX_MS} ms",
        crossing.0, crossing.1, crossing.2
    );
    println!("  a plain copy        median {:6.1} ms, {:.1} to {:.1}", copying.0, copying.1, copying.2);
    crossing.0
}
