//! Message parts (chunks): a message or file is divided into parts that are small enough for the broker. A part
//! consists of one line of JSON that names the message or file, and the bytes. Parts may arrive in any order and
//! several times; [`PartAssembly`] joins them.
//!
//! Each part arrives with a receipt, which is acknowledged to the broker after the whole item is stored. A repeated
//! part arrives with a new receipt, which replaces the previous one, so that an incomplete item needs limited memory.

use super::message::{OfficeError, Position, check_epoch_name};
use panelprep_cell::cell::CellName;
use panelprep_cell::files::{content_hash, is_hex};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

const PART_FORMAT: &str = "panelprep-part-1";
/// Maximum number of content bytes in a message part. Together with its line of JSON, the part is smaller than 1 MB,
/// the default limit of the broker.
const PART_BYTES: usize = 512 * 1024;
/// Maximum number of parts of a message or file, 2 GB in total.
const MAX_PARTS: u32 = 4_096;
/// Maximum length of the line of JSON, bytes.
const MAX_HEAD_BYTES: usize = 1_024;

/// The message or file to which a part belongs.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ChunkOwner {
    /// The [`Message`](super::Message) with this position.
    Message(Position),
    /// The file with this SHA-256.
    File(String),
}

/// One part of a message or file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chunk {
    /// The cell that sends the part.
    pub cell: CellName,
    /// The message or file to which the part belongs.
    pub what: ChunkOwner,
    /// Number of the part within its message or file, from 1.
    pub part: u32,
    /// Total number of parts of the message or file.
    pub parts: u32,
    /// The content of the part.
    pub bytes: Vec<u8>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    form: String,
    cell: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    position: Option<Position>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    file: Option<String>,
    part: u32,
    parts: u32,
}

/// Divides a message or file into parts; an empty content gives one part.
///
/// # Errors
/// If more than `MAX_PARTS` parts would be needed.
pub fn chunks(cell: &CellName, what: &ChunkOwner, bytes: &[u8]) -> Result<Vec<Chunk>, OfficeError> {
    let count = bytes.len().div_ceil(PART_BYTES).max(1);
    let allowed = || OfficeError::Large { found: format!("{count} parts"), allowed: format!("{MAX_PARTS} parts") };
    let parts = u32::try_from(count).ok().filter(|parts| *parts <= MAX_PARTS).ok_or_else(allowed)?;
    let of = |part: u32| {
        let from = (part as usize - 1) * PART_BYTES;
        let bytes = bytes[from..bytes.len().min(from + PART_BYTES)].to_vec();
        Chunk { cell: cell.clone(), what: what.clone(), part, parts, bytes }
    };
    Ok((1..=parts).map(of).collect())
}

impl Chunk {
    /// Returns the id by which the broker recognises a duplicate of the part. `again` changes the id, for a part that
    /// is sent again because the office server does not have it.
    pub fn message_id(&self, again: u64) -> String {
        let Chunk { cell, what, part, .. } = self;
        let name = match what {
            ChunkOwner::Message(Position { epoch, number }) => format!("{cell}/{epoch}/{number}/{part}"),
            ChunkOwner::File(hash) => format!("{cell}/file/{hash}/{part}"),
        };
        if again == 0 { name } else { format!("{name}/{again}") }
    }

    /// Encodes the message part for sending.
    ///
    /// # Errors
    /// If JSON cannot represent its line.
    pub fn bytes(&self) -> Result<Vec<u8>, OfficeError> {
        let (position, file) = match &self.what {
            ChunkOwner::Message(position) => (Some(position.clone()), None),
            ChunkOwner::File(hash) => (None, Some(hash.clone())),
        };
        let cell = self.cell.as_str().to_owned();
        let head = Head { form: PART_FORMAT.to_owned(), cell, position, file, part: self.part, parts: self.parts };
        let mut bytes =
            serde_json::to_vec(&head).map_err(|error| OfficeError::form_error("line of a message part", error))?;
        bytes.push(b'\n');
        bytes.extend_from_slice(&self.bytes);
        Ok(bytes)
    }

    /// Parses one part of a message or file.
    ///
    /// # Errors
    /// If the bytes are not a valid part, or exceed its maximum size.
    pub fn read(bytes: &[u8]) -> Result<Self, OfficeError> {
        let wrong = |problem: String| OfficeError::form_error("line of a message part", problem);
        let end = bytes.iter().take(MAX_HEAD_BYTES).position(|byte| *byte == b'\n');
        let end = end.ok_or_else(|| wrong("the end of the line is missing".to_owned()))?;
        let head: Head = serde_json::from_slice(&bytes[..end]).map_err(|error| wrong(error.to_string()))?;
        if head.form != PART_FORMAT {
            return Err(wrong(format!(
                "the field \"form\" is \"{}\", expected \"{PART_FORMAT}\"",
                head.form.escape_debug()
            )));
        }
        let what = match (head.position, head.file) {
            (Some(position), None) => {
                check_epoch_name(&position.epoch).map_err(wrong)?;
                ChunkOwner::Message(position)
            }
            (None, Some(hash)) => {
                check_hash(&hash).map_err(wrong)?;
                ChunkOwner::File(hash)
            }
            _ => return Err(wrong("the message part must name either a message or a file".to_owned())),
        };
        if !(1..=MAX_PARTS).contains(&head.parts) || !(1..=head.parts).contains(&head.part) {
            return Err(wrong(format!(
                "invalid message part {} of {}: a message or file has 1 to {MAX_PARTS} parts",
                head.part, head.parts
            )));
        }
        let bytes = bytes[end + 1..].to_vec();
        if bytes.len() > PART_BYTES {
            let [found, allowed] = [bytes.len(), PART_BYTES].map(|count| format!("{count} bytes"));
            return Err(OfficeError::Large { found, allowed });
        }
        let cell = CellName::new(&head.cell).map_err(wrong)?;
        Ok(Chunk { cell, what, part: head.part, parts: head.parts, bytes })
    }
}

/// Checks that the name of a file is a SHA-256 hash. The name is used in a path, so no other name is accepted.
fn check_hash(hash: &str) -> Result<(), String> {
    match is_hex(hash, 64) {
        true => Ok(()),
        false => Err(format!("the file name is \"{}\", valid: a SHA-256", hash.escape_debug())),
    }
}

/// Maximum size of all incomplete items, bytes. If it is exceeded, the oldest item is dropped and will be sent again.
const MAX_ITEM_BYTES: usize = 512 << 20;

/// A complete message or file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AssembledItem<R> {
    /// The cell that sent the item.
    pub cell: CellName,
    /// Which message or file it is.
    pub what: ChunkOwner,
    /// The content. The hash of a file's content is equal to the file's name.
    pub bytes: Vec<u8>,
    /// The receipts of all parts.
    pub receipts: Vec<R>,
}

/// A message or file whose parts contradict each other.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InvalidItem<R> {
    /// The contradiction between the parts.
    pub error: OfficeError,
    /// The receipts of all parts that were received.
    pub receipts: Vec<R>,
}

/// The messages and files of which parts are still missing.
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
    /// Adds a part, and returns the item if it is now complete.
    ///
    /// # Errors
    /// If the part contradicts earlier parts, or the hash of the complete file differs from its name. All parts of the
    /// item are then dropped.
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
        while self.bytes > MAX_ITEM_BYTES {
            let others = self.partial.iter().filter(|(key, _)| *key != newest);
            let Some(oldest) = others.min_by_key(|(_, begun)| begun.turn).map(|(key, _)| key.clone()) else {
                return;
            };
            self.forget(&oldest);
        }
    }
}
