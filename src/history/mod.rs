//! The cell's past as data: cycles that match a search, what one came to, how two of them differ, how numbers of a panel
//! develop, and which alarms there were.
//!
//! Everything here is made from records that are kept already, and each number keeps the limit that it was held against. What
//! the Western Electric rules say is a hint for a person: no verdict comes from this room. It reads no store and no file, and
//! draws nothing; `store` searches, and `report` draws.

mod acknowledgement;
mod alarms;
mod codes;
mod compare;
mod dates;
mod grid;
mod heat;
mod past;
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
pub use grid::{GridPast, grid_place, grid_states, seen_grids};
pub use heat::{HeatCell, HeatMap, heat_map};
pub use past::{DiscWear, PastCycle};
pub use quantity::{Known, Quantity};
pub use query::{End, Hit, Hits, MOST_HITS, Query};
pub use summary::{Films, Summary, summary};
pub use table::{Cell, Table};
pub use tables::{alarm_table, comparison_table, heat_table, hits_table, summary_table, trend_table};
pub use trend::{Trend, TrendPoint, trend};
