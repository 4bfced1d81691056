//! After a cycle, returns the memory of its pictures and scans to the operating system.
//!
//! The C library keeps freed memory for later allocations. If small objects stay allocated between freed blocks, the
//! free memory is fragmented. The memory of a service that runs for weeks then grows with every picture for which no
//! free block is large enough.
#![cfg_attr(target_env = "gnu", allow(unsafe_code, reason = "malloc_trim of the C library has no safe wrapper"))]

/// Returns all free memory of the process to the operating system, if the C library can do this. The call takes about
/// 10 ms for each 30 MB; meanwhile, threads that allocate memory may wait. Call it only while the robot is stationary.
#[cfg(target_env = "gnu")]
pub fn give_back_free_memory() {
    let begun = std::time::Instant::now();
    // SAFETY: `malloc_trim` may be called at any time by any thread; it locks the pools one after the other.
    let is_any = unsafe { libc::malloc_trim(0) } == 1;
    tracing::debug!("memory returned to the system: {is_any}, in {:.1} ms", begun.elapsed().as_secs_f64() * 1e3);
}

/// Does nothing: other C libraries return memory automatically, or cannot return it.
#[cfg(not(target_env = "gnu"))]
pub fn give_back_free_memory() {}
