//! Records on their way to the office: their content, how it is cut into messages, and whether cell and office hold
//! the same.
//!
//! A cell numbers everything that the office must receive (see `store`, table `outbox`): the end of each cycle,
//! each signature with the statement that it signs, each verification. The cell, the epoch and the number name one
//! of these items for ever; its content is named by its SHA-256. An item is sent at least once, and the office
//! keeps the first one of each name. A second one with the same hash is ignored. A second one with another hash is
//! a contradiction: it is kept and reported, and never replaces the first.
//!
//! Files that a record names (pictures, recipe, calibrations) are sent before it, under their hash.
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

pub use archive_settings::{ArchiveSettings, Database, FleetPage};
pub use assembly::{Assembled, Assembly, Unfit};
pub use body::{Body, CycleEnd, Envelope, NamedFile, VerificationSeen};
pub use cell_state::{CellState, ReasonText};
pub use chunk::{Chunk, ChunkOwner, chunks};
pub use compare::{Compared, compare};
pub use error::OfficeError;
pub use message::Message;
pub use offer::RecipeOffer;
pub use position::{Kind, Listed, Position};
pub use progress::{OfficeSays, Progress};

#[cfg(test)]
mod tests;
