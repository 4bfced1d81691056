//! Parts put together again, in whatever order and however often they come.

use super::chunk::{Chunk, What};
use super::error::OfficeError;
use crate::cell::CellName;
use crate::files::content_hash;
use std::collections::BTreeMap;

/// What is put together at one time, bytes. Whoever begins more loses what began first: it is sent again.
const MOST_BYTES: usize = 512 << 20;

/// Something that is whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assembled {
    /// Which cell sent it.
    pub cell: CellName,
    /// What.
    pub what: What,
    /// Its bytes; those of a file have the hash that names it.
    pub bytes: Vec<u8>,
}

/// What is not whole yet.
#[derive(Debug, Default)]
pub struct Assembly {
    begun: BTreeMap<(CellName, What), Begun>,
    bytes: usize,
    turn: u64,
}

#[derive(Debug)]
struct Begun {
    parts: Vec<Option<Vec<u8>>>,
    turn: u64,
}

impl Begun {
    fn bytes(&self) -> usize {
        self.parts.iter().flatten().map(Vec::len).sum()
    }
}

impl Assembly {
    /// Takes a part; what it makes whole comes back.
    ///
    /// # Errors
    /// Where it contradicts the parts before it, or the whole is not the file that its name says. What was begun is then forgotten.
    pub fn take(&mut self, chunk: Chunk) -> Result<Option<Assembled>, OfficeError> {
        let Chunk { cell, what, part, parts, bytes } = chunk;
        let key = (cell, what);
        self.turn += 1;
        let new = || Begun { parts: vec![None; parts as usize], turn: 0 };
        let begun = self.begun.entry(key.clone()).or_insert_with(new);
        begun.turn = self.turn;
        let before = u32::try_from(begun.parts.len()).unwrap_or(u32::MAX);
        if before != parts {
            self.forget(&key);
            return Err(OfficeError::Parts { part, found: parts, before });
        }
        if let Some(place) = begun.parts.get_mut(part as usize - 1) {
            self.bytes += bytes.len();
            self.bytes -= place.replace(bytes).map_or(0, |old| old.len());
        }
        if !begun.parts.iter().all(Option::is_some) {
            self.keep_small(&key);
            return Ok(None);
        }
        let Some(whole) = self.forget(&key) else { return Ok(None) };
        let bytes = whole.parts.into_iter().flatten().flatten().collect::<Vec<u8>>();
        if let What::File(stated) = &key.1 {
            let found = content_hash(&bytes);
            if found != *stated {
                return Err(OfficeError::form("file", format!("its SHA-256 is {found}, it was named {stated}")));
            }
        }
        let (cell, what) = key;
        Ok(Some(Assembled { cell, what, bytes }))
    }

    /// Whether parts of this were taken and others are missing.
    pub fn waits_for(&self, cell: &CellName, what: &What) -> bool {
        self.begun.contains_key(&(cell.clone(), what.clone()))
    }

    fn forget(&mut self, key: &(CellName, What)) -> Option<Begun> {
        let begun = self.begun.remove(key)?;
        self.bytes -= begun.bytes();
        Some(begun)
    }

    fn keep_small(&mut self, newest: &(CellName, What)) {
        while self.bytes > MOST_BYTES {
            let others = self.begun.iter().filter(|(key, _)| *key != newest);
            let Some(oldest) = others.min_by_key(|(_, begun)| begun.turn).map(|(key, _)| key.clone()) else {
                return;
            };
            self.forget(&oldest);
        }
    }
}
