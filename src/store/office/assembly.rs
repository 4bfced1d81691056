//! Joins parts into a message or a file; parts may arrive in any order and any number of times.
//!
//! Each part arrives with a receipt, with which it is acknowledged to the broker once the whole item is stored. A
//! repeated part brings a new receipt, which replaces the previous one. So an item that never becomes complete does
//! not grow.

use super::chunk::{Chunk, ChunkOwner};
use super::error::OfficeError;
use panelprep_cell::cell::CellName;
use panelprep_cell::files::content_hash;
use std::collections::BTreeMap;

/// Limit of the bytes of all incomplete items. If more bytes arrive, the oldest item is dropped: it is sent again.
const MAX_BYTES: usize = 512 << 20;

/// A message or a file of which all parts have arrived.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AssembledItem<R> {
    /// The cell that sent the data.
    pub cell: CellName,
    /// The message or the file to which the part belongs.
    pub what: ChunkOwner,
    /// The bytes of the item. If it is a file, the hash of the bytes is the name of the file.
    pub bytes: Vec<u8>,
    /// The receipts of all parts.
    pub receipts: Vec<R>,
}

/// A message or a file that can never become complete.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InvalidItem<R> {
    /// The error.
    pub error: OfficeError,
    /// The receipts of all parts received so far.
    pub receipts: Vec<R>,
}

/// The messages and files that are not complete yet.
#[derive(Debug)]
pub struct PartAssembly<R> {
    partial: BTreeMap<(CellName, ChunkOwner), PartialItem<R>>,
    bytes: usize,
    turn: u64,
}

#[derive(Debug)]
struct PartialItem<R> {
    parts: Vec<Option<(Vec<u8>, R)>>,
    turn: u64,
}

impl<R> PartialItem<R> {
    fn bytes(&self) -> usize {
        self.parts.iter().flatten().map(|(bytes, _)| bytes.len()).sum()
    }

    fn receipts(self) -> Vec<R> {
        self.parts.into_iter().flatten().map(|(_, receipt)| receipt).collect()
    }
}

impl<R> Default for PartAssembly<R> {
    fn default() -> Self {
        PartAssembly { partial: BTreeMap::new(), bytes: 0, turn: 0 }
    }
}

impl<R> PartAssembly<R> {
    /// Adds a part; returns the whole if this part completes it.
    ///
    /// # Errors
    /// If the part contradicts earlier parts, or the hash of the complete file differs from its name. All parts
    /// received until then are dropped.
    pub fn add(&mut self, chunk: Chunk, receipt: R) -> Result<Option<AssembledItem<R>>, InvalidItem<R>> {
        let Chunk { cell, what, part, parts, bytes } = chunk;
        let key = (cell, what);
        self.turn += 1;
        let new = || PartialItem { parts: (0..parts).map(|_| None).collect(), turn: 0 };
        let begun = self.partial.entry(key.clone()).or_insert_with(new);
        begun.turn = self.turn;
        let before = u32::try_from(begun.parts.len()).unwrap_or(u32::MAX);
        if before != parts {
            let mut receipts = self.forget(&key).map_or(Vec::new(), PartialItem::receipts);
            receipts.push(receipt);
            return Err(InvalidItem { error: OfficeError::Parts { part, found: parts, before }, receipts });
        }
        if let Some(place) = begun.parts.get_mut(part as usize - 1) {
            self.bytes += bytes.len();
            self.bytes -= place.replace((bytes, receipt)).map_or(0, |(old, _)| old.len());
        }
        if !begun.parts.iter().all(Option::is_some) {
            self.limit_partial_items(&key);
            return Ok(None);
        }
        let Some(whole) = self.forget(&key) else { return Ok(None) };
        let (bytes, receipts): (Vec<Vec<u8>>, Vec<R>) = whole.parts.into_iter().flatten().unzip();
        let bytes = bytes.concat();
        if let ChunkOwner::File(stated) = &key.1 {
            let found = content_hash(&bytes);
            if found != *stated {
                let problem = format!("the SHA-256 of the file is {found}, but its name states {stated}");
                return Err(InvalidItem { error: OfficeError::form_error("file", problem), receipts });
            }
        }
        let (cell, what) = key;
        Ok(Some(AssembledItem { cell, what, bytes, receipts }))
    }

    fn forget(&mut self, key: &(CellName, ChunkOwner)) -> Option<PartialItem<R>> {
        let begun = self.partial.remove(key)?;
        self.bytes -= begun.bytes();
        Some(begun)
    }

    fn limit_partial_items(&mut self, newest: &(CellName, ChunkOwner)) {
        while self.bytes > MAX_BYTES {
            let others = self.partial.iter().filter(|(key, _)| *key != newest);
            let Some(oldest) = others.min_by_key(|(_, begun)| begun.turn).map(|(key, _)| key.clone()) else {
                return;
            };
            self.forget(&oldest);
        }
    }
}
