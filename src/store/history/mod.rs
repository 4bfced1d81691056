//! The cell's past as data: cycles that match a search, the result of a cycle, the differences between two cycles, the
//! trend of a panel's numbers, and the alarms.
//!
//! This module uses records that exist already, and each number is stored with the limit against which it was checked.
//! The results of the Western Electric rules are a hint for a person: this module gives no verdict. It reads no store
//! and no file, and draws nothing; `store` searches, and `report` draws.

mod acknowledgement;
mod alarms;
mod codes;
mod compare;
mod dates;
mod grid;
mod heat;
mod past_cycle;
mod quantity;
mod query;
mod summary;
mod table;
mod tables;
#[cfg(test)]
mod tests;
mod trend;
pub mod western_electric;

pub use acknowledgement::Acknowledgement;
pub use alarms::{Alarm, AlarmTimes, alarms};
pub use codes::{Code, Priority, Row, code, codes, languages, row};
pub use compare::{CheckPair, Comparison, GridPair, InputPair, compare};
pub use dates::{DateError, Edge, unix_s};
pub use grid::{GridPast, grid_row_and_column, grid_states, is_valid_film, reported_grids, touched_grids};
pub use heat::{HeatCell, HeatMap, heat_map};
pub use past_cycle::{DiscWear, PastCycle, touching_passes};
pub use quantity::{KnownQuantity, Quantity};
pub use query::{Hit, Hits, MAX_HITS, Query, RequiredEnd};
pub use summary::{Films, Summary, summary};
pub use table::{Cell, Table};
pub use tables::{alarm_table, comparison_table, heat_table, hits_table, summary_table, trend_table};
pub use trend::{Trend, TrendPoint, trend};
