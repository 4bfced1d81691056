//! Records that are sent to the office: their content, their division into messages, and the comparison of the cell's
//! data with the office's data.
//!
//! A cell numbers everything that the office must receive (see `store`, table `outbox`): the end of each cycle, each
//! signature with the statement that it signs, each verification. The cell, the epoch and the number identify each of
//! these items permanently; the SHA-256 identifies its content. An item is sent at least once, and the office stores
//! the first item with each name. A second item with the same hash is ignored. A second item with another hash is a
//! contradiction: it is stored and reported, and never replaces the first.
//!
//! Files that a record names (pictures, recipe, calibrations) are sent before the record, under their hash.
//!
//! The module is pure: sockets are handled in `broker`, `daemon/office` and `archive`.

mod archive_settings;
mod chunk;
mod message;
mod notices;
mod progress;
pub mod subject;

pub use archive_settings::{ArchiveSettings, DatabaseSettings, FleetPage};
pub use chunk::{AssembledItem, Chunk, ChunkOwner, InvalidItem, PartAssembly, chunks};
pub use message::{
    Body, CycleEnd, ItemEnvelope, Kind, ListEntry, Message, NamedFile, OfficeError, OfficeVerification, Position,
};
pub use notices::{CellState, ReasonText, RecipeOffer};
pub use progress::{Comparison, Progress, ReportOutcome, compare};

#[cfg(test)]
mod tests;
