//! The broker between the cells and the office server: NATS with JetStream, reduced to the few functions that cells and
//! archive need.
//!
//! There are three streams. `PANELPREP` contains records and files in transit; each message stays until the archive has
//! acknowledged it. If the stream is full, the broker refuses a message and the cell sends it again later.
//! `PANELPREP_ARCHIVED` contains one message for each cell and epoch: the number up to which the office server has all
//! records. `PANELPREP_OFFERS` contains the last recipe that the office has offered for each panel. The archive creates
//! the streams; a cell creates none.

mod link;
mod office_link;

pub use link::{BrokerError, CellLink, PendingMessage};
pub use office_link::{Delivery, OfficeLink, Receipt, StateSubscription};
