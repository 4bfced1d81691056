//! The table against a cell with a truth of its own.
//!
//! `cell` is the true cell: it does what the effects say, and names every effect and every state that must not be
//! (`faults.md` 3.2). `healthy` says what a healthy cell and its operator say next. `scenarios`, `stops` and
//! `troubles` are stories to read, `walks` are thousands of seeded ones, `search` visits every state.

mod cell;
mod healthy;
mod oracles;
mod scenarios;
mod search;
mod stops;
mod story;
mod troubles;
mod walks;
