//! Backup and restore of a cell: store, configuration and calibrations in one archive.
//!
//! The archive is a tar file compressed with zstd, which other programs can open too. Its first entry is a manifest
//! with the size and SHA-256 of every other entry. Its last bytes are a seal, the SHA-256 of all bytes before. Only
//! entries with names of a known form are restored (`entry`). Before any file of the cell is changed, they are compared
//! with the manifest, unpacked beside their final path, and verified (`restore`).
//!
//! The seal detects damage. It is not a signature: a person who can write the archive can also write a new seal.
//!
//! - `entry`: the valid entries, and the manifest · `write` · `read`: also the seal · `restore` · `placing`

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
