//! The cell's past as data: cycles that match a search, the result of a cycle, the differences between two cycles, the
//! trend of a panel's numbers, and the alarms.
//!
//! This module uses records that exist already, and each number is stored with the limit against which it was checked.
//! The results of the Western Electric rules are a hint for a person: this module gives no verdict. It reads no store
//! and no file, and draws nothing; `store` searches, and `report` draws.

mod alarms;
mod codes;
mod past_cycle;
mod query;
mod tables;
#[cfg(test)]
mod tests;
mod trend;
pub mod western_electric;

pub use alarms::{Acknowledgement, Alarm, AlarmTimes, alarms};
pub use codes::{Code, Priority, Row, code, codes, languages, row};
pub use past_cycle::{
    CheckPair, Comparison, DiscWear, Films, GridPair, GridPast, InputPair, PastCycle, Summary, compare,
    grid_row_and_column, grid_states, is_valid_film, reported_grids, summary, touched_grids, touching_passes,
};
pub use query::{DateError, Edge, Hit, Hits, MAX_HITS, Query, RequiredEnd, unix_s};
pub use tables::{Cell, Table, alarm_table, comparison_table, heat_table, hits_table, summary_table, trend_table};
pub use trend::{HeatCell, HeatMap, KnownQuantity, Quantity, Trend, TrendPoint, heat_map, trend};
