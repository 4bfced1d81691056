//! The broker between cells and the office: NATS with JetStream, as the few calls that cells and the archive need.
//!
//! Two streams. `PANELPREP` holds records and files on their way, each message until the archive has acknowledged
//! it; what finds no room in it is refused, and the cell sends it again. `PANELPREP_ARCHIVED` holds one message for
//! each cell and epoch: up to which number the office has everything. The archive makes both; a cell makes none.

mod cell_link;
mod error;
mod link;
mod office_link;

pub use cell_link::{CellLink, Sending};
pub use error::BrokerError;
pub use office_link::{Delivery, OfficeLink, Receipt, States};
