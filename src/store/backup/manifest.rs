//! The first entry of an archive: a list of the other entries.

use super::entry::Entry;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Name of the manifest's entry.
pub const NAME: &str = "manifest.json";
/// The newest format that this program supports.
pub const FORMAT: u32 = 1;
/// Maximum size of a manifest that is read.
pub const MAX_BYTES: u64 = 256 << 20;

/// The content of an archive.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// The archive's format.
    pub format: u32,
    /// The version of the program that wrote the archive.
    pub program: String,
    /// Time at which the archive was made, s since 1970; only a label.
    pub made_unix_s: i64,
    /// Links of the store's chain; `None` without a store.
    pub links: Option<u64>,
    /// The entries that follow, in their order.
    pub entries: Vec<ManifestEntry>,
}

/// An entry of the manifest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ManifestEntry {
    /// Its name.
    pub name: String,
    /// Its size.
    pub bytes: u64,
    /// SHA-256 of the entry's content, hexadecimal.
    pub sha256: String,
}

impl Manifest {
    /// Returns the entries by their meaning, if all names have known forms and none occurs twice.
    ///
    /// # Errors
    /// States the problem.
    pub fn parse_entries(&self) -> Result<Vec<Entry>, String> {
        let mut seen = BTreeSet::new();
        let parse = |listed: &ManifestEntry| {
            let name = &listed.name;
            let entry = Entry::parse(name).ok_or_else(|| {
                format!("the backup contains \"{}\", which is not a file of a backup", name.escape_debug())
            })?;
            if !seen.insert(entry.clone()) {
                return Err(format!("the backup contains {name} twice"));
            }
            match &entry {
                Entry::Blob(hash) if *hash != listed.sha256 => {
                    Err(format!("the manifest states a SHA-256 of {name} that differs from its name"))
                }
                _ => Ok(entry),
            }
        };
        self.entries.iter().map(parse).collect()
    }

    /// Returns whether the backup contains a store.
    pub fn has_store(&self) -> bool {
        self.links.is_some()
    }

    /// Returns whether the backup contains a configuration.
    pub fn has_configuration(&self) -> bool {
        self.entries.iter().any(|listed| listed.name == Entry::Cell.name())
    }

    /// Bytes of the store's files.
    pub fn store_bytes(&self) -> u64 {
        let of_store =
            |listed: &&ManifestEntry| Entry::parse(&listed.name).is_some_and(|entry| entry.belongs_to_store());
        self.entries.iter().filter(of_store).fold(0, |sum, listed| sum.saturating_add(listed.bytes))
    }
}
