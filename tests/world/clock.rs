//! The wall clock of a world: the real clock with an offset that changes in jumps. Only labels may depend on it.

use std::cell::Cell;

thread_local! {
    static MOVED_S: Cell<i64> = const { Cell::new(0) };
}

/// Returns the offset of this thread's clock, s.
pub fn offset_s() -> i64 {
    MOVED_S.get()
}

/// Changes the offset of this thread's clock by a jump.
pub fn jump(seconds: i64) {
    MOVED_S.set(MOVED_S.get().saturating_add(seconds).clamp(-4_000_000_000, 4_000_000_000));
}

/// Sets the offset of this thread's clock to zero.
pub fn reset() {
    MOVED_S.set(0);
}
