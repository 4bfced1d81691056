//! The data that pages of the office read: cells, cycles, statistics across cells, verifications, recipes, accounts.
//!
//! Every query uses an index and ends after a limited number of rows, so that it is as fast with a million records as
//! with a thousand.

mod accounts;
mod cells;
mod cycles;
mod numbers;
mod reader;
mod recipes;

pub use accounts::OfficeAccount;
pub use cells::{CellNow, VerdictCount};
pub use cycles::{CycleQuery, CycleRow, Record, RecordSignature};
pub use numbers::CellNumbers;
pub use reader::Reader;
pub use recipes::RecipeUse;
