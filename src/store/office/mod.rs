//! Records that are sent to the office: their content, their division into messages, and the comparison of the data of
//! cell and office.
//!
//! A cell numbers everything that the office must receive (see `store`, table `outbox`): the end of each cycle, each
//! signature with the statement that it signs, each verification. The cell, the epoch and the number identify each of
//! these items permanently; the SHA-256 identifies its content. An item is sent at least once, and the office stores
//! the first item with each name. A second item with the same hash is ignored. A second item with another hash is a
//! contradiction: it is stored and reported, and never replaces the first.
//!
//! Files that a record names (pictures, recipe, calibrations) are sent before the record, under their hash.
//!
//! Pure: sockets are handled in `broker`, `daemon/office` and `archive`.

mod archive_settings;
mod assembly;
mod body;
mod cell_state;
mod chunk;
mod compare;
mod error;
mod message;
mod offer;
mod position;
mod progress;
pub mod subject;

pub use archive_settings::{ArchiveSettings, DatabaseSettings, FleetPage};
pub use assembly::{AssembledItem, InvalidItem, PartAssembly};
pub use body::{Body, CycleEnd, ItemEnvelope, NamedFile, VerificationSeen};
pub use cell_state::{CellState, ReasonText};
pub use chunk::{Chunk, ChunkOwner, chunks};
pub use compare::{Comparison, compare};
pub use error::OfficeError;
pub use message::Message;
pub use offer::RecipeOffer;
pub use position::{Kind, ListEntry, Position};
pub use progress::{Progress, ReportOutcome};

#[cfg(test)]
mod tests;
