//! Tests the table against a cell with its own true state.
//!
//! `cell` is the true cell: it does what the effects state, and names every effect and every state that is forbidden
//! (`faults.md` 3.2). `healthy` gives the next events of a healthy cell and its operator. `scenarios` and `troubles`
//! are scenarios to read; `walks` has thousands of seeded random walks, and a search that visits every state.

mod cell;
mod healthy;
mod oracles;
mod scenarios;
mod troubles;
mod walks;
