//! The broker between cells and the office: NATS with JetStream, reduced to the few calls that cells and the archive
//! need.
//!
//! There are three streams. `PANELPREP` contains records and files in transit, each message until the archive has
//! acknowledged it; if the stream has no space for a message, the broker refuses it and the cell sends it again.
//! `PANELPREP_ARCHIVED` contains one message for each cell and epoch: the number up to which the office has all
//! records. `PANELPREP_OFFERS` contains the last recipe that the office offered for each panel. The archive creates all
//! three; a cell creates none.

mod link;
mod office_link;

pub use link::{BrokerError, CellLink, PendingMessage};
pub use office_link::{Delivery, OfficeLink, Receipt, StateSubscription};
