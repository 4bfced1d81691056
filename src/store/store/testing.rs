//! What the tests of other rooms need, too.

use super::Store;
use std::time::SystemTime;

/// Sets the clock that dates the rows of a store.
pub fn set_clock(store: &mut Store, clock: fn() -> SystemTime) {
    store.clock = clock;
}
