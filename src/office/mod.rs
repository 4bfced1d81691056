//! Records on their way to the office: what is sent, how it is cut into messages, and whether cell and office hold the same.
//!
//! A cell numbers everything that the office is to have (see `store`, table `outbox`): the end of each cycle, each signature with the
//! statement that it signs, each verification. The cell, the epoch and the number name one of them for ever; its content is named
//! by its SHA-256. It is sent at least once, and the office keeps the first one of each name. A second one with the same hash is
//! nothing new; a second one with another hash is a contradiction, which is kept and told, and never replaces the first.
//!
//! Files that a record names (pictures, recipe, calibrations) are sent before it, under their hash.
//!
//! Pure: sockets are the business of `broker`, `daemon/office` and `archive`.

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
pub use cell_state::{CellState, Told};
pub use chunk::{Chunk, What, chunks};
pub use compare::{Compared, compare};
pub use error::OfficeError;
pub use message::Message;
pub use offer::RecipeOffer;
pub use position::{Kind, Listed, Position};
pub use progress::{OfficeSays, Progress};

#[cfg(test)]
mod tests;
