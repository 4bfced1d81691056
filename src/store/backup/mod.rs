//! A backup of a cell: store, configuration and calibrations in one archive, and their restoration.
//!
//! The archive is a tar file compressed by zstd, so that other programs can open it too. Its first entry is a manifest
//! with the size and SHA-256 of every other entry. Its last bytes are a seal, the SHA-256 of everything before. Only
//! entries with names of a known form are restored (`entry`). They are compared with the manifest, then unpacked and
//! verified beside their final path, before anything in the cell is changed (`restore`).
//!
//! The seal detects damage. It is not a signature: a person who can write the archive can write another seal.
//!
//! - `entry`: what may be in an archive, and its manifest · `write` · `read`: also the seal · `restore` · `placing`

mod entry;
mod error;
mod placing;
mod read;
mod restore;
#[cfg(test)]
mod tests;
mod write;

pub use entry::{Entry, Manifest, ManifestEntry};
pub use error::BackupError;
pub use read::Archive;
pub use restore::{Permission, Plan, RestoreReport, RestoredParts, named_files, restore};
pub use write::{BackupReport, Configuration, write};
