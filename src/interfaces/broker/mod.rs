//! The broker between cells and the office: NATS with JetStream, reduced to the few calls that cells and the archive
//! need.
//!
//! There are two streams. `PANELPREP` contains records and files in transit, each message until the archive has
//! acknowledged it; if the stream has no room for a message, the broker refuses it and the cell sends it again.
//! `PANELPREP_ARCHIVED` contains one message for each cell and epoch, the number up to which the office has
//! everything. The archive creates both; a cell creates none.

mod link;
mod office_link;

pub use link::{BrokerError, CellLink, PendingMessage};
pub use office_link::{Delivery, OfficeLink, Receipt, StateSubscription};
