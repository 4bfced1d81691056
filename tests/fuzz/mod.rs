//! Tests the readers of bytes from outside with unexpected bytes: the corpus in `fixtures/fuzz/`, the seeds, and random
//! changes of both. `make fuzz` searches further, guided by coverage (`main.rs`).

mod change;
mod judged;
mod seeds;
mod session;
mod targets;

pub use seeds::hostile_programs;
pub use targets::documents;
