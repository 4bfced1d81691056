//! The wall clock of a world: the real one, moved by jumps. Only labels may depend on it.

use std::cell::Cell;

thread_local! {
    static MOVED_S: Cell<i64> = const { Cell::new(0) };
}

/// By how many seconds the clock of this thread is moved.
pub fn moved_s() -> i64 {
    MOVED_S.get()
}

/// Moves the clock of this thread.
pub fn jump(seconds: i64) {
    MOVED_S.set(MOVED_S.get().saturating_add(seconds).clamp(-4_000_000_000, 4_000_000_000));
}

/// It is right again.
pub fn right() {
    MOVED_S.set(0);
}
