//! Tests the state table against a simulated cell with its own true state.
//!
//! `cell` is the simulated cell: it performs the effects and reports every forbidden effect and every forbidden state
//! (`faults.md` 3.2). `healthy` generates the next events of a cell without faults and its operator. `scenarios` and
//! `troubles` are single scenarios. `walks` contains thousands of seeded random walks, and a search through all states.

mod cell;
mod healthy;
mod oracles;
mod scenarios;
mod troubles;
mod walks;
