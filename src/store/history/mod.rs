//! The history of a cell as data: cycles that match a search, the summary of a cycle, the comparison of two cycles, the
//! trend of a panel's measured values, and the alarms.
//!
//! This module uses existing records, in which each value is stored with its limit at that time. The results of the
//! Western Electric rules are hints for a person: this module gives no verdicts. It reads no store and no files, and
//! draws nothing; `store` executes a search, and `report` draws.

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
pub use query::{DateError, Edge, Hit, Hits, MAX_HITS_PER_PAGE, Query, RequiredEnd, unix_s};
pub use tables::{Cell, Table, alarm_table, comparison_table, heat_table, hits_table, summary_table, trend_table};
pub use trend::{HeatCell, HeatMap, KnownQuantity, Quantity, Trend, TrendPoint, heat_map, trend};
