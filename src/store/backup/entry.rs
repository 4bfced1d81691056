//! The entries of a backup archive. Only names of known forms are accepted: any other name (an absolute path, a path
//! with `..`) is refused before the content of its entry is read. The first entry is the manifest, a list of all other
//! entries.

use crate::store::{BLOBS, ROW_FILES};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Component, Path};

/// An entry of a backup archive.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Entry {
    /// A file of the store that contains rows: the database, or the head of the chain.
    Rows(&'static str),
    /// A file of the store to which the rows of the database refer, named by its SHA-256 hash.
    Blob(String),
    /// The cell's file.
    Cell,
    /// A configuration file that the cell's file names, identified by its key, such as `calibration.scanner`.
    Named(String),
    /// A recipe in the folder of the cell's file, as a relative path.
    Recipe(String),
}

/// The keys of the cell's file that name configuration files.
pub const NAMED_KEYS: [&str; 9] = [
    "calibration.scanner",
    "calibration.flange_camera",
    "calibration.base_from_camera",
    "calibration.flange_from_camera",
    "calibration.flange_from_tool",
    "calibration.robot_correction",
    "calibration.removal",
    "scanner.settings",
    "scanner.settings_2d",
];

const STORE: &str = "store";
const CELL: &str = "configuration/cell.toml";
const NAMED: &str = "configuration/named";
const RECIPES: &str = "configuration/recipes";
/// Maximum number of components in the relative path of a recipe. Each component may have up to `MAX_NAME_BYTES` bytes.
const MAX_PATH_NAMES: usize = 4;
const MAX_NAME_BYTES: usize = 255;

impl Entry {
    /// Returns the entry's name in the archive.
    pub fn name(&self) -> String {
        match self {
            Entry::Rows(file) => format!("{STORE}/{file}"),
            Entry::Blob(hash) => format!("{STORE}/{BLOBS}/{hash}"),
            Entry::Cell => CELL.to_owned(),
            Entry::Named(key) => format!("{NAMED}/{key}"),
            Entry::Recipe(path) => format!("{RECIPES}/{path}"),
        }
    }

    /// Parses the name of an entry; `None` if the name has no known form.
    pub fn parse(name: &str) -> Option<Self> {
        if name == CELL {
            return Some(Entry::Cell);
        }
        if let Some(key) = name.strip_prefix(NAMED).and_then(|rest| rest.strip_prefix('/')) {
            return NAMED_KEYS.contains(&key).then(|| Entry::Named(key.to_owned()));
        }
        if let Some(path) = name.strip_prefix(RECIPES).and_then(|rest| rest.strip_prefix('/')) {
            return is_plain_relative_path(path).then(|| Entry::Recipe(path.to_owned()));
        }
        let rest = name.strip_prefix(STORE)?.strip_prefix('/')?;
        if let Some(file) = ROW_FILES.into_iter().find(|file| *file == rest) {
            return Some(Entry::Rows(file));
        }
        let hash = rest.strip_prefix(BLOBS)?.strip_prefix('/')?;
        let is_hash = hash.len() == 64 && hash.bytes().all(|c| matches!(c, b'0'..=b'9' | b'a'..=b'f'));
        is_hash.then(|| Entry::Blob(hash.to_owned()))
    }

    /// Returns whether the entry is part of the store.
    pub fn belongs_to_store(&self) -> bool {
        matches!(self, Entry::Rows(_) | Entry::Blob(_))
    }
}

/// Returns whether a text is the relative path of a TOML file in the same folder or below, without `.` and `..`.
fn is_plain_relative_path(path: &str) -> bool {
    let parts: Vec<Component<'_>> = Path::new(path).components().collect();
    let text = |part: &Component<'_>| match part {
        Component::Normal(name) => name.to_str().map(str::to_owned),
        _ => None,
    };
    let names: Option<Vec<String>> = parts.iter().map(text).collect();
    names.is_some_and(|names| {
        names.join("/") == path
            && names.len() <= MAX_PATH_NAMES
            && names
                .iter()
                .all(|name| name.len() <= MAX_NAME_BYTES && !name.contains(['\0', '\\']) && !name.starts_with('.'))
            && path.ends_with(".toml")
    })
}

/// Name of the manifest's entry.
pub const MANIFEST_NAME: &str = "manifest.json";
/// Newest format of the manifest that this program supports.
pub const MANIFEST_FORMAT: u32 = 1;
/// Maximum size of a manifest, bytes.
pub const MAX_MANIFEST_BYTES: u64 = 256 << 20;

/// The list of the entries of an archive.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// The archive's format.
    pub format: u32,
    /// The version of the program that wrote the archive.
    pub program: String,
    /// Time at which the archive was written, s since 1970; for information only.
    pub made_unix_s: i64,
    /// Number of links in the store's hash chain; `None` without a store.
    pub links: Option<u64>,
    /// The entries after the manifest, in their order.
    pub entries: Vec<ManifestEntry>,
}

/// An entry of the manifest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ManifestEntry {
    /// Name of the entry.
    pub name: String,
    /// Size of the entry, bytes.
    pub bytes: u64,
    /// SHA-256 of the entry's content, hexadecimal.
    pub sha256: String,
}

impl Manifest {
    /// Parses the names of all entries.
    ///
    /// # Errors
    /// If a name has no known form, occurs twice, or differs from the hash of its entry.
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

    /// Returns the total size of the store's files, bytes.
    pub fn store_bytes(&self) -> u64 {
        let of_store =
            |listed: &&ManifestEntry| Entry::parse(&listed.name).is_some_and(|entry| entry.belongs_to_store());
        self.entries.iter().filter(of_store).fold(0, |sum, listed| sum.saturating_add(listed.bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_unknown_form_are_refused() {
        let hash = "0123456789abcdef".repeat(4);
        let blob = format!("store/blobs/{hash}");
        for name in [
            "store/panelprep.sqlite",
            "store/panelprep.head",
            &blob,
            "configuration/cell.toml",
            "configuration/named/calibration.scanner",
            "configuration/named/scanner.settings_2d",
            "configuration/recipes/panels/door-skin.toml",
        ] {
            assert_eq!(Entry::parse(name).map(|entry| entry.name()).as_deref(), Some(name));
        }
        let capital = format!("store/blobs/{}", hash.to_uppercase());
        let longer = format!("{blob}0");
        for name in [
            "",
            "store",
            "store/",
            "/store/panelprep.sqlite",
            "store/panelprep.lock",
            "store/../panelprep.sqlite",
            "store/blobs/../../x",
            &capital,
            &longer,
            "configuration/named/robot.host",
            "configuration/named/../cell.toml",
            "configuration/recipes//etc/panel.toml",
            "configuration/recipes/../panel.toml",
            "configuration/recipes/a/../panel.toml",
            "configuration/recipes/a//panel.toml",
            "configuration/recipes/./panel.toml",
            "configuration/recipes/.hidden.toml",
            "configuration/recipes/panel.sh",
            "configuration/recipes/a/b/c/d/panel.toml",
            "configuration/cell.toml/",
        ] {
            assert_eq!(Entry::parse(name), None, "{name}");
        }
    }
}
