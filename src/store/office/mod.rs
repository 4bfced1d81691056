//! The data that a cell sends to the office server: their content, their division into message parts, and the
//! comparison between the data of the cell and of the office server.
//!
//! A cell numbers all items that the office server must receive (see `store`, table `outbox`): the end of each cycle,
//! each signature with its statement, and each verification. Cell, epoch and number identify an item permanently; the
//! SHA-256 identifies its content. An item is sent at least once, and the office server stores the first item with each
//! position. Another item with the same position and hash is ignored. An item with the same position but another hash
//! is a contradiction: it is stored and reported, and never replaces the first one.
//!
//! Files that a record names (pictures, recipe, calibrations) are sent before the record, named by their hash.
//!
//! All functions are pure; `broker`, `daemon/office` and `archive` contain the sockets.

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
