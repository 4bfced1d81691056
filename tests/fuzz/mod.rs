//! What reads bytes from outside, fed with bytes that nobody meant: the corpus in `fixtures/fuzz/`, the seeds, and seeded
//! changes of both. `make fuzz` searches further, led by coverage (`main.rs`).

mod change;
mod judged;
mod seeds;
mod session;
mod targets;

pub use seeds::hostile_programs;
pub use targets::documents;
