//! After a cycle the memory of its pictures and scans goes back to the system.
//!
//! The C library keeps what was freed for whatever is allocated next. Beside small things that stay, such free memory breaks into
//! pieces, so that a service that runs for weeks holds more of it with every picture that found no piece of its size.
#![cfg_attr(target_env = "gnu", allow(unsafe_code, reason = "the C library's own function, which takes a number"))]

/// Gives all free memory of the process back to the system, where the C library can: some 10 ms for each 30 MB, in which threads that
/// allocate may wait. For moments at which the robot stands.
#[cfg(target_env = "gnu")]
pub fn give_back_free_memory() {
    let begun = std::time::Instant::now();
    // SAFETY: `malloc_trim` may be called at any time by any thread; it takes the locks of the pools one after the other.
    let is_any = unsafe { libc::malloc_trim(0) } == 1;
    tracing::debug!("free memory was given back: {is_any}, in {:.1} ms", begun.elapsed().as_secs_f64() * 1e3);
}

/// Other C libraries give it back by themselves, or cannot.
#[cfg(not(target_env = "gnu"))]
pub fn give_back_free_memory() {}
