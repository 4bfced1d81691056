//! A backup of a cell: store, configuration and calibrations in one archive, and back.
//!
//! The archive is a tar file compressed by zstd, so that other programs open it too. Its first entry is a manifest with the size
//! and SHA-256 of every other entry; its last bytes are a seal, the SHA-256 of everything before. What is restored is taken
//! from entries whose names have a known form alone (`entry`), is compared with the manifest, and stands beside its place,
//! verified and whole, before anything in the cell is changed (`restore`).
//!
//! The seal finds damage. It is no signature: whoever can write the archive can write another one.
//!
//! - `entry`: what may be in an archive · `seal` · `manifest` · `write` · `read` · `restore` · `placing`

mod entry;
mod error;
mod manifest;
mod placing;
mod read;
mod restore;
mod seal;
#[cfg(test)]
mod tests;
mod write;

pub use entry::Entry;
pub use error::BackupError;
pub use manifest::{Listed, Manifest};
pub use read::Archive;
pub use restore::{Permission, Plan, Restored, Wanted, named_files, restore};
pub use write::{Configuration, Written, write};
